"""What a Kalman filter is worth on ``AORO/PathTracking-v1``: ``python -m studies.pose_filter`` (six minutes on one core).

Told are, for a pose by constant gains and for one by :class:`aoro_gym.sensors.pose_filter.PoseFilter`:

- how far the estimate is off while the expert drives, who knows the true errors: root mean squares across the path, by
  reception and by the time without satellites; and of the heading;
- how many episodes controllers and policies succeed in: ``expert without the truth`` has the expert's gains, and sees the
  observation alone.

The paths are those that trainings are evaluated on. ``--episodes 80 expert limits-dagger`` drives less.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np

from aoro_gym.agents.controllers.path_tracking import PreviewDriver, Vehicle
from aoro_gym.agents.evaluation.evaluate import policy_factory
from aoro_gym.agents.evaluation.statistics import interval
from aoro_gym.agents.policies.policy import Policy
from aoro_gym.envs import register_envs
from aoro_gym.envs.limit_tracking.courses import validation_courses
from aoro_gym.envs.path_tracking.environment import LOCALISATIONS
from aoro_gym.sensors.attitude import wrapped
from aoro_gym.sensors.gps import FIXED, FLOAT, NONE

ENV, COUNT, SEED = "AORO/PathTracking-v1", 80, 7000
STEP = 0.05
"""[s] of control."""
EXPERT, UNTOLD, FILTERED = "expert", "expert without the truth", "limits-filter-dagger"
POLICIES = (EXPERT, UNTOLD, "preview", "preview-speed", "stanley", "limits-dagger", FILTERED)
AFTER = (3.0, 6.0, 10.0)
"""Times without satellites [s] at which errors are told, each over a second."""


def made(localisation: str) -> Any:
    """The environment."""
    register_envs()
    return gymnasium.make_vec(
        ENV, num_envs=COUNT, device="cpu:simd", courses=validation_courses(), autoreset_mode="SameStep",
        localisation=localisation,
    ).unwrapped  # fmt: skip


def policy_of(name: str, env: Any) -> Policy:
    """Who drives."""
    return PreviewDriver(Vehicle.of(env)) if name == UNTOLD else policy_factory(ENV, name)(env)


def driven(name: str, localisation: str, episodes: int) -> tuple[list[bool], dict[str, float]]:
    """Successes of the first episodes of every sub-environment, and how far the estimate was off."""
    env = made(localisation)
    policy, task = policy_of(name, env), env.task
    observations, _ = env.reset(seed=SEED)
    each = -(-episodes // COUNT)
    succeeded: list[list[bool]] = [[] for _ in range(COUNT)]
    lost, kept = np.zeros(COUNT), []
    while min(map(len, succeeded)) < each:
        view, quality = task.view(), task._sensors.gps.quality.copy()
        lost = np.where(quality == NONE, lost + STEP, 0.0)
        across, heading = (
            view.measured_cross_track - view.cross_track, view.measured_heading_error - view.heading_error,
        )  # fmt: skip
        kept.append(np.stack([quality, lost, across, wrapped(heading)]))
        observations, _, terminated, truncated, infos = env.step(policy(observations))
        ended = terminated | truncated
        policy.reset(ended)
        lost[ended] = 0.0
        for k in np.flatnonzero(ended):
            succeeded[k].append(bool(infos["final_info"]["is_success"][k]))
    env.close()
    return [one for row in succeeded for one in row[:each]], off(*np.concatenate(kept, axis=1))


def off(quality: Any, lost: Any, across: Any, heading: Any) -> dict[str, float]:
    """Root mean squares across [m] by reception, and of the heading [°]."""
    chosen = {"fixed": quality == FIXED, "float": quality == FLOAT}
    chosen |= {f"{time:g} s": (quality == NONE) & (np.abs(lost - time) < 0.5) for time in AFTER}
    found = {name: float(np.sqrt(np.mean(across[mask] ** 2))) for name, mask in chosen.items()}
    return found | {"heading": float(np.degrees(np.sqrt(np.mean(heading[quality == FIXED] ** 2))))}


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policies", nargs="*", default=POLICIES)
    parser.add_argument("--episodes", type=int, default=160)
    asked = parser.parse_args(arguments)
    for name in asked.policies:
        for localisation in LOCALISATIONS if name != FILTERED else ("filter",):
            succeeded, errors = driven(name, localisation, asked.episodes)
            rate = interval(np.array(succeeded, dtype=float), rate=True)
            said = f"{name}, {localisation}: {100 * rate.mean:.1f} % [{100 * rate.low95:.0f}, {100 * rate.high95:.0f}]"
            if name == EXPERT:
                said += "; off by " + ", ".join(f"{value:.3f} ({what})" for what, value in errors.items())
            print(f"{said}, {len(succeeded)} episodes", flush=True)


if __name__ == "__main__":
    main()
