"""Drives along paths to their ends, of which tasks take their own metrics."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.agents.evaluation.runs import Runs, run_to_ends, spread
from aoro_gym.agents.evaluation.statistics import Floats
from aoro_gym.agents.policies.policy import Policy
from aoro_gym.envs.core.vector import TwinVectorEnv
from aoro_gym.envs.path_tracking.courses import Course

STATION = 0.25
"""Distance [m] at which the error of a drive is kept."""


@dataclass(frozen=True)
class Drives(Runs):
    """Runs of a task along paths."""

    @property
    def course(self) -> NDArray[np.intp]:
        """Which course, and which of its paths (N, 2)."""
        return np.stack([self.first["terrain"], self.first["path"]], axis=1)

    @property
    def tilt(self) -> Floats:
        """Angle [deg] of the front frame's upward axis to the vertical (N, 1 + T)."""
        upright = np.cos(self.data["roll"]) * np.cos(self.data["pitch"])
        return np.degrees(np.arccos(np.clip(upright, -1.0, 1.0)))

    def at_stations(self, errors: Sequence[Floats], along: str = "s") -> tuple[Floats, Floats]:
        """Errors (N, K) and places (N, K, 2) [m] at every :data:`STATION`, NaN beyond the end.

        Args:
            errors: Of the steps of each episode (N,), as long as its part.
            along: Channel [m] that says how far each has come.
        """
        farthest = max(float(np.ptp(self.data[along][i, : part.stop])) for i, part in enumerate(self.parts))
        stations = STATION * np.arange(1 + math.ceil(max(float(self.whole.max()), farthest) / STATION))
        n = len(self.steps)
        found, places = np.full((n, len(stations)), np.nan), np.full((n, len(stations), 2), np.nan)
        for i, part in enumerate(self.parts):
            # a vehicle may slide back: the first time that it came so far counts
            ahead = np.maximum.accumulate(self.data[along][i, part]) - self.data[along][i, 0]
            there = stations <= ahead[-1]
            when = np.searchsorted(ahead, stations[there])
            found[i, there] = errors[i][when]
            for axis, name in enumerate(("reference_x", "reference_y")):
                places[i, there, axis] = self.data[name][i, part][when]
        return found, places


def every_path(courses: Sequence[Course], seeds: Sequence[int]) -> dict[str, Any]:
    """Options of a reset that give each seed (N,) a path: as many seeds in a row as there are paths drive each once."""
    ground = np.array([number for number, course in enumerate(courses) for _ in course.paths])
    path = np.array([number for course in courses for number in range(len(course.paths))])
    chosen = spread(seeds, len(ground))
    return {"terrain": ground[chosen], "path": path[chosen]}


def drive_to_ends(
    env: TwinVectorEnv,
    policy: Policy,
    reset: Mapping[str, Any],
    tell: Callable[[float], Any],
    *,
    channels: Sequence[str],
    last: Sequence[str],
) -> Drives:
    """Drive every sub-environment along its path, by :func:`~aoro_gym.agents.evaluation.runs.run_to_ends`.

    Args:
        env: Of a task along paths.
        policy: Who drives.
        reset: Arguments of the environment's reset, which name paths.
        tell: Called with the share that is done.
        channels: Render channels to keep.
        last: Infos of the last step to keep.
    """
    return Drives(**vars(run_to_ends(env, policy, reset, tell, channels=channels, last=last)))
