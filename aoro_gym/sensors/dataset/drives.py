"""The drive of a machine along which pictures are taken: its motion, and when each picture is due."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path as File
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.execution.files import write_bytes
from aoro_gym.sensors.dataset.carrier import carrier
from aoro_gym.sensors.lidar import Motion
from aoro_gym.terrains import Path
from aoro_gym.terrains.world.world import World

Array = NDArray[np.float64]
BEFORE = 0.1
"""Time [s] that a drive must have gone on before a picture is taken: a lidar's sweep."""
AFTER = 0.3
"""Time [s] that it must go on after it: the next picture that flow is counted to."""


@dataclass(frozen=True, eq=False)
class Drive:
    """What a machine drove, from standstill on."""

    motion: Motion
    """Of its front frame, of one world, from 0 s on."""
    path: Array
    """(P, 2) [m] points of the path that it followed."""
    ending: str
    """Why it ended, in words."""
    posture: Array | None = None
    """(T, 9) [rad] of joint, four arms and four wheels; None: as at rest."""

    @property
    def places(self) -> Array:
        """(T, 4) x, y [m] of the hinge, heading of the front frame and joint angle [rad]."""
        joint = np.zeros(len(self.motion.time)) if self.posture is None else self.posture[:, 0]
        return np.column_stack([self.motion.position[:, 0, :2], self.motion.yaw[:, 0], joint])

    def posture_at(self, instant: float) -> Array:
        """(9,) at an instant [s]."""
        if self.posture is None:
            return carrier().rest
        return np.array([np.interp(instant, self.motion.time, angle) for angle in self.posture.T])

    @property
    def way(self) -> Array:
        """(T,) [m] that the hinge has come in plan."""
        steps = np.diff(self.motion.position[:, 0, :2], axis=0)
        return np.concatenate([[0.0], np.cumsum(np.hypot(*steps.T))])

    @property
    def last(self) -> float:
        """Time [s] of the last moment at which a picture can be taken."""
        return float(self.motion.time[-1]) - AFTER

    def instants(self, count: int) -> Array:
        """(count,) [s] at which the machine has come each of so many equal parts of its way: that of picture k in the middle
        of part k. ``ValueError`` if the drive is too short."""
        time, way = self.motion.time, self.way
        low, high = time[0] + BEFORE, self.last
        if high <= low:
            raise ValueError(
                f"the drive ended after {time[-1]:.2f} s ({self.ending}), too soon for a picture; give another path"
            )
        first, last = np.interp([low, high], time, way)
        wanted = first + (np.arange(count) + 0.5) / count * (last - first)
        forward = np.maximum.accumulate(way) + 1e-9 * np.arange(len(way))  # rising, so that it has an inverse
        return np.clip(np.interp(wanted, forward, time), low, high)

    def around(self, instant: float) -> Motion:
        """The motion from :data:`BEFORE` to :data:`AFTER` an instant [s], and the samples next to that."""
        motion = self.motion
        first = max(int(np.searchsorted(motion.time, instant - BEFORE)) - 1, 0)
        last = int(np.searchsorted(motion.time, instant + AFTER)) + 1
        part = slice(first, last)
        return Motion(motion.time[part], motion.position[part], motion.roll[part], motion.pitch[part], motion.yaw[part])

    def save(self, file: File) -> None:
        """Write it whole or not at all (``.npz``)."""
        motion, buffer = self.motion, io.BytesIO()
        arrays = {name: getattr(motion, name) for name in ("time", "position", "roll", "pitch", "yaw")}
        if self.posture is not None:
            arrays["posture"] = self.posture
        np.savez(buffer, **arrays, path=self.path, ending=np.array(self.ending))
        write_bytes(file, buffer.getvalue())

    @classmethod
    def load(cls, file: File) -> Drive:
        """What :meth:`save` wrote."""
        with np.load(file) as kept:
            motion = Motion(*(kept[name] for name in ("time", "position", "roll", "pitch", "yaw")))
            return cls(motion, kept["path"], str(kept["ending"]), kept.get("posture"))


Driver = Callable[[World, Path | None, int, Callable[[float], Any]], Drive]
"""Drives through a world along a path, or along one that is planned by a seed; told of the share that is done."""
