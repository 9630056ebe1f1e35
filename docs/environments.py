"""Tables of actions, observations and rewards in docs/environments: ``python docs/environments.py`` writes them anew."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.envs import Course, ForestRunEnv, LevellingEnv, LimitTrackingEnv, LoadingEnv, PathTrackingEnv, TurningEnv
from aoro_gym.envs.core.terms import ObservationTerm, RewardTerm
from aoro_gym.envs.forest_run import rewards as forest_run_rewards
from aoro_gym.envs.levelling import rewards as levelling_rewards
from aoro_gym.envs.loading import rewards as loading_rewards
from aoro_gym.envs.path_tracking import rewards as path_rewards
from aoro_gym.envs.turning import rewards as turning_rewards
from aoro_gym.terrains import Path as Line
from aoro_gym.terrains import Plane

FOLDER = Path(__file__).parent / "environments"
ACTIONS = {
    "steering_signal": "signal of the steering valve, positive to the left",
    "drive_signal": "signal of pump 1, positive forward",
    **{
        f"arm_{corner}": f"signal of the arm valve {where}; positive lets the wheel down and the frame up"
        for corner, where in (("fl", "front left"), ("fr", "front right"), ("rl", "rear left"), ("rr", "rear right"))
    },
    "crane_slew": "signal of the slew's valve, positive to the left",
    "crane_lift": "signal of the main boom's valve, positive up",
    "crane_fold": "signal of the stick's valve, positive up and out",
    "crane_telescope": "signal of the telescope's valve, positive out",
    "rotator": "rate of the grapple against the pillar, 0.6 rad/s at 1, positive to the left",
    "grapple": "closed above 0, else open",
}


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    return "\n".join(f"| {' | '.join(row)} |" for row in [head, ["---"] * len(head), *rows])


def about(function: Callable[..., Any]) -> tuple[str, str]:
    """First sentence of what a term is, and its unit, of which it may name none."""
    text = " ".join((function.__doc__ or "").split())
    unit = re.search(r" \[([^\]]+)\]", text)
    sentence = re.sub(r" \((N, )?[N\d][^)]*\)", "", text.replace(unit[0], "") if unit else text)
    return sentence.removesuffix(".").replace("``", "`"), unit[1] if unit else "1"


def actions(layout: Mapping[str, slice]) -> str:
    """Every action: index, range, what it is."""
    return table(
        ["index", "action", "range", "what it is"],
        [[columns(where), f"`{name}`", "-1 to 1", ACTIONS[name]] for name, where in layout.items()],
    )


def observations(layout: Mapping[str, slice], terms: Mapping[str, ObservationTerm]) -> str:
    """Every term of the observation: indices, unit, range, what it is."""
    rows = []
    for name, where in layout.items():
        sentence, unit = about(terms[name].function)
        low, high = (f"{bound:.4g}" for bound in (terms[name].low, terms[name].high))
        rows.append([columns(where), f"`{name}`", unit, f"{low} to {high}", sentence])
    return table(["index", "term", "unit", "range", "what it is"], rows)


def rewards(terms: Mapping[str, RewardTerm], further: Mapping[str, Callable[..., Any]]) -> str:
    """Every term of the reward with its weight, then those that can be asked for by name."""
    named = [(name, f"{term.weight:g}", term.function) for name, term in terms.items()]
    named += [(name, "none", function) for name, function in further.items()]
    return table(
        ["term", "weight", "what it is"],
        [[f"`{name}`", weight, _with_unit(function)] for name, weight, function in named],
    )


def _with_unit(function: Callable[..., Any]) -> str:
    sentence, unit = about(function)
    return sentence if unit == "1" else f"{sentence} [{unit}]"


def columns(where: slice) -> str:
    """Indices of a part."""
    return f"{where.start}" if where.stop - where.start == 1 else f"{where.start} to {where.stop - 1}"


def parts() -> dict[str, dict[str, str]]:
    """Tables by page and name."""
    turning = TurningEnv()
    line = Line(np.array([[0.0, 0.0], [30.0, 0.0]]))
    path_tracking = PathTrackingEnv(terrain=Plane(), path=line)
    limits = LimitTrackingEnv(terrain=Plane(), path=line)
    levelling = LevellingEnv(terrain=Plane(), path=line)
    forest_run = ForestRunEnv(courses=[Course.over(Plane(), [line])])
    made = {}
    for page, env, module in (
        ("turning.md", turning, turning_rewards),
        ("path_tracking.md", path_tracking, path_rewards),
        ("path_tracking_limits.md", limits, path_rewards),
        ("levelling.md", levelling, levelling_rewards),
        ("forest_run.md", forest_run, forest_run_rewards),
        ("loading.md", LoadingEnv(), loading_rewards),
    ):
        task = env.vector.task
        made[page] = {
            "actions": actions(env.action_layout),
            "observations": observations(env.observation_layout, task.observation_terms),
            "rewards": rewards(task.reward_terms, module.FURTHER_REWARD_TERMS),
        }
        env.close()
    return made


def pages() -> dict[Path, str]:
    """The pages with their tables as the code has them."""
    found = {}
    for name, tables in parts().items():
        text = (FOLDER / name).read_text(encoding="utf-8")
        for part, made in tables.items():
            mark, end = f"<!-- {part} -->\n\n", f"\n\n<!-- {part} end -->"
            before, rest = text.split(mark)
            text = before + mark + made + end + rest.split(end)[1]
        found[FOLDER / name] = text
    return found


if __name__ == "__main__":
    for file, text in pages().items():
        file.write_text(text, encoding="utf-8")
