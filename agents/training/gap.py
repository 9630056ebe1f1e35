"""What a gap between twin and machine costs a policy, how much of it a diagnosis foresees, how much retraining wins back.

The same policy drives the same episodes in three places: in the twin that it was trained in (the baseline), in the plant,
which has a deviation that the baseline lacks, and in the twin that a diagnosis of the plant has improved. With retraining, a
copy of the policy that has learned on in the improved twin drives in the plant, and for comparison one that has learned on
as long in the baseline.

    loss       plant - baseline
    predicted  improved twin - baseline          as a share of the loss
    recovered  retrained in the plant - plant    as a share of the loss, less its sign

All differences are of the same episodes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import bootstrap

from aoro_gym.agents.controllers.reference import Factory
from aoro_gym.agents.evaluation.episodes import Episodes
from aoro_gym.agents.evaluation.evaluate import evaluate
from aoro_gym.agents.evaluation.leaderboard import SEED, forests
from aoro_gym.agents.evaluation.metrics import explained, named, shown
from aoro_gym.agents.evaluation.perturbations import SWITCHABLE
from aoro_gym.agents.evaluation.result import Evaluation
from aoro_gym.agents.evaluation.statistics import CONFIDENCE, RESAMPLES, Floats, Interval, interval, plain
from aoro_gym.agents.evaluation.tasks import TASKS
from aoro_gym.agents.policies.files import shipped_policies
from aoro_gym.agents.policies.policy import LearnedPolicy
from aoro_gym.agents.training.plan import HYPERPARAMS, TrainingPlan
from aoro_gym.effects.parsing import parse_effect
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.execution.files import read_json
from aoro_gym.machine import Machine
from aoro_gym.reporting.terminal import Comparison

BASELINE, PLANT, IMPROVED = "baseline", "plant", "improved twin"
"""Where the policy drives."""
RETRAINED, CONTROL = "retrained in the improved twin", "trained on in the baseline"
"""Who else drives in the plant."""
LEARNING_RATE, LOG_STD = "lin_3e-4", -2.0
"""Of retraining: a good policy is to be moved, not to be found."""


@dataclass(frozen=True)
class Gap:
    """Metrics of the same episodes by who drove where."""

    env: str
    episodes: int
    seed: int
    driven: Mapping[str, Episodes]
    """By ``BASELINE``, ``PLANT``, …."""

    @property
    def names(self) -> tuple[str, ...]:
        """Metrics that are reported."""
        return ("success_rate", *TASKS[self.env].decisive, "return")

    @cached_property
    def metrics(self) -> dict[str, dict[str, Interval]]:
        """Means by who drove where."""
        return {
            place: {
                name: interval(run.metrics[name], rate=name == "success_rate")._replace(
                    bounds=int(run.bounded(name).sum())
                )
                for name in self.names
            }
            for place, run in self.driven.items()
        }

    @cached_property
    def changes(self) -> dict[str, dict[str, Interval]]:
        """``loss``, ``predicted`` and, with retraining, ``recovered`` and ``control``: mean differences."""
        return {
            name: {metric: interval(self._change(name, metric)) for metric in self.names} for name in self._differences
        }

    @cached_property
    def shares(self) -> dict[str, dict[str, Interval]]:
        """The others as shares of the loss [-]: 1 is all of it. Wide, or without ends, where there is hardly a loss."""
        return {
            name: {
                metric: share_of(self._change(name, metric) * sign, self._change("loss", metric))
                for metric in self.names
            }
            for name, sign in (("predicted", 1.0), ("recovered", -1.0), ("control", -1.0))
            if name in self._differences
        }

    @property
    def _differences(self) -> dict[str, tuple[str, str]]:
        """What is less what."""
        found = {"loss": (PLANT, BASELINE), "predicted": (IMPROVED, BASELINE)}
        if RETRAINED in self.driven:
            found |= {"recovered": (RETRAINED, PLANT), "control": (CONTROL, PLANT)}
        return found

    def _change(self, name: str, metric: str) -> Floats:
        more, less = self._differences[name]
        return self.driven[more].exact(metric) - self.driven[less].exact(metric)

    def to_json(self) -> dict[str, Any]:
        """Content of ``gap.json``."""
        return {
            "env": self.env,
            "episodes": self.episodes,
            "seed": self.seed,
            "figures": plain(self.metrics),
            "changes": plain(self.changes),
            "shares": plain(self.shares),
        }


def share_of(part: Floats, whole: Floats) -> Interval:
    """Mean of ``part`` over that of ``whole`` [-], both (N,), with the percentiles' interval of a bootstrap over the pairs;
    pairs with a NaN are left out."""
    known = np.isfinite(part) & np.isfinite(whole)
    part, whole = part[known], whole[known]
    if not known.any() or whole.mean() == 0.0:
        return Interval(math.nan, math.nan, math.nan)
    share = float(part.mean() / whole.mean())
    if len(part) < 2:
        return Interval(share, math.nan, math.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        drawn = bootstrap(
            (part, whole),
            lambda p, w, axis=-1: p.mean(axis=axis) / w.mean(axis=axis),
            paired=True,
            n_resamples=RESAMPLES,
            method="percentile",
            batch=max(1, 1_000_000 // len(part)),
            rng=np.random.default_rng(0),
        ).bootstrap_distribution
    low, high = np.nanquantile(drawn, [0.5 * (1.0 - CONFIDENCE), 0.5 * (1.0 + CONFIDENCE)])
    return Interval(share, float(low), float(high))


def measure(
    env: str,
    policy: Factory,
    *,
    baseline: Machine,
    plant: Machine,
    improved: Machine,
    retrained: Factory | None = None,
    control: Factory | None = None,
    episodes: int = 64,
    seed: int = SEED,
    courses: Sequence[Course] | None = None,
    device: str = "cpu",
    kept: Path | None = None,
    progress: Callable[[str, float], Any] = lambda what, share: None,
) -> Gap:
    """Drive.

    Args:
        env: Id of the environment.
        policy: Who drives.
        baseline: The twin that the policy was trained in.
        plant: What it shall drive.
        improved: The twin after the diagnosis.
        retrained: The policy after it has learned on in ``improved``; likewise ``control`` in ``baseline``.
        control: See there.
        episodes: In each place.
        seed: Of the first episode.
        courses: Where to drive.
        device: Of the twins.
        kept: Folder to keep episodes in, see :func:`~aoro_gym.agents.evaluation.evaluate.evaluate`.
        progress: Called with what is driven and the share of everything that is done.
    """
    rounds: list[tuple[str, Factory, Machine]] = [
        (BASELINE, policy, baseline), (PLANT, policy, plant), (IMPROVED, policy, improved),
    ]  # fmt: skip
    if retrained is not None and control is not None:
        rounds += [(RETRAINED, retrained, plant), (CONTROL, control, plant)]
    driven = {}
    for done, (name, make, machine) in enumerate(rounds):

        def tell(_: str, share: float, name: str = name, before: int = done) -> None:
            progress(name, (before + share) / len(rounds))

        found: Evaluation = evaluate(
            env,
            {name: make},
            episodes=episodes,
            seed=seed,
            courses=courses,
            machine=baseline,
            # policies know the baseline, wherever they drive
            drawn=lambda known, seeds, machine=machine: machine,
            device=device,
            kept=kept,
            progress=tell,
        )
        driven[name] = found.runs[name]
    return Gap(env, episodes, seed, driven)


def courses(env: str) -> Sequence[Course] | None:
    """Courses that the policy drives on: forests; None where the environment has none."""
    return forests() if env == "AORO/PathTracking-v0" else None


def improved_machine(diagnosis: Path | None, improved: str | None) -> str:
    """The machine of the improved twin: the one that is named, or the likeliest of a folder of ``aoro-gym diagnose``.

    Raises ValueError unless one of them is given, and as :func:`likeliest_machine_file`.
    """
    if (diagnosis is None) == (improved is None):
        raise ValueError("give one of --diagnosis and --improved")
    return str(likeliest_machine_file(diagnosis)) if diagnosis is not None else str(improved)


def retraining_plan(env: str, policy: str, *, steps: int, seed: int, device: str) -> TrainingPlan:
    """Plan of a training in which a policy learns on: by PPO, or, with a memory, from the task's teacher.

    Args:
        env: Id of the environment.
        policy: Name of a shipped policy, or a file.
        steps: Environment steps.
        seed: Of the training.
        device: Of twins and networks.

    Raises ValueError if it is not of the package's own files, OSError if there is none.
    """
    file = shipped_policies(env).get(policy, Path(policy))
    if file.suffix not in (".json", ".safetensors"):
        raise ValueError(f"--policy {policy} cannot be retrained; give a file that 'aoro-gym train' wrote")
    learned = LearnedPolicy.load(file)
    network = ", ".join(str(size) for size in learned.sizes[1:-1])
    again = TrainingPlan(env=env, start=str(file), steps=steps, seed=seed, device=device)
    if learned.memory is not None:
        return replace(
            again,
            algo="dagger",
            curriculum=str(HYPERPARAMS / "fixed.yml"),
            param=[f"learning_rate={LEARNING_RATE}", f"memory={learned.memory.sizes[-1]}", f"net_arch=[{network}]"],
        )
    kwargs = f"{{log_std_init: {LOG_STD}, net_arch: [{network}]}}"
    return replace(again, param=[f"learning_rate={LEARNING_RATE}", f"policy_kwargs={kwargs}"])


def with_effects(machine: Machine, asked: Sequence[str]) -> Machine:
    """The machine with effects such as ``"seal_friction=3000"``, in SI as the catalogue has them.

    Raises ValueError naming what is wrong.
    """
    for text in asked:
        effect, magnitudes = parse_effect("--effect", text, SWITCHABLE)
        machine = effect.apply(machine, *magnitudes)
    return machine


def likeliest_machine_file(folder: Path) -> Path:
    """Machine file of the likeliest cause that has one, in a folder of ``aoro-gym diagnose``.

    Raises ValueError if there is none or the file is broken, OSError if there is no diagnosis.
    """
    causes = read_json(folder / "diagnosis.json").get("causes", ())
    files = [cause["machine_file"] for cause in causes if cause.get("machine_file")]
    if not files:
        raise ValueError(
            f"{folder / 'diagnosis.json'} names no machine file: nothing that it found would change the twin"
        )
    return folder / files[0]


def table(gap: Gap) -> Comparison:
    """For a terminal: metrics by who drove where, then the changes and their shares of the loss."""
    units = {name: named(name) for name in gap.names}
    head = ["", *(f"{words} [{unit}]" if unit else words for words, unit in units.values())]

    def row(what: str, values: Mapping[str, Interval], unit: str | None = None) -> list[str]:
        cells = (shown(values[name], unit or units[name][1], total=gap.episodes) for name in gap.names)
        return [what, *cells]

    rows = [row(place, values) for place, values in gap.metrics.items()]
    for name, values in gap.changes.items():
        rows.append(row(name, values))
        if name in gap.shares:
            rows.append(row("  share of the loss [%]", gap.shares[name], "%"))
    return Comparison(f"{gap.env}: {gap.episodes} episodes each, mean [95 %]", head, rows, note=explained(rows))
