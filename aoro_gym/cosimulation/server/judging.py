"""How well whoever commands the twin keeps to a path: by its true pose, which no client sees."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from aoro_gym.machine import Machine
from aoro_gym.sensors.attitude import in_world
from aoro_gym.terrains import Path

REACH = 1.5
"""Distance [m] along the path from the last projection within which the next one is looked for."""
END_TOLERANCE = 0.25
"""Distance [m] before the end of an open path from which on nothing counts; as in AORO/PathTracking-v0."""


class PathJudge:
    """Cross-track error of the middle of the front axle, from the first command to the path's end.

    Args:
        path: What is to be followed.
        machine: What follows it.
    """

    def __init__(self, path: Path, machine: Machine):
        self._path = path
        self._axle = np.array([float(np.max(machine.frame.front.axle_distance)), 0.0, 0.0])
        self._s: float | None = None
        self._squares, self._count = 0.0, 0
        self.largest = 0.0
        """Largest error so far [m]."""
        self.driven = 0.0
        """Arc length [m] that was gained so far."""

    @property
    def ended(self) -> bool:
        """Whether the end of an open path was reached."""
        if self._path.closed or self._s is None:
            return False
        return self._s >= self._path.length - END_TOLERANCE

    def see(self, position: Any, roll: Any, pitch: Any, yaw: Any) -> None:
        """One more pose: position of the hinge [m] (1, 3), angles [rad] (1,)."""
        if self.ended:
            return
        place = (position + in_world(roll, pitch, yaw, self._axle))[0, :2]
        s, error = (float(value) for value in self._path.project(place, near=self._s, reach=REACH))
        if self._s is not None:
            gained = s - self._s
            half = 0.5 * self._path.length
            self.driven += (gained + half) % self._path.length - half if self._path.closed else gained
        self._s = s
        self._squares, self._count = self._squares + error * error, self._count + 1
        self.largest = max(self.largest, abs(error))

    def to_json(self) -> dict[str, Any]:
        """Errors of the whole drive."""
        rms = math.sqrt(self._squares / self._count) if self._count else None
        return {
            "path": self._path.name,
            "cross_track_rms_m": rms,
            "cross_track_largest_m": self.largest,
            "driven_m": self.driven,
            "reached_end": self.ended,
        }
