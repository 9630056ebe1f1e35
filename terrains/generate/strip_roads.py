"""Strip roads: the ways between the trees that machines of harvesting drive on, side by side, with the ruts they leave.

>>> roads = StripRoads(axis=0, apart=20.0, width=4.2, offset=0.0)
>>> roads.distance(np.array([[1.0, 5.0], [19.0, 5.0], [10.0, 0.0]])).tolist()
[1.0, 1.0, 10.0]
>>> roads.rut_depth(np.array([[0.985, 0.0], [0.0, 0.0], [10.0, 0.0]]), 0.06).round(3).tolist()
[0.06, 0.0, 0.0]
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.terrains.generate.forest import RUT_APART, RUT_WIDTH

Array = NDArray[Any]


@dataclass(frozen=True)
class StripRoads:
    """Straight ways across one axis of the plan."""

    axis: int
    """0 or 1: x or y, along which they follow each other."""
    apart: float
    """[m] from middle to middle; 0: there are none."""
    width: float
    """[m]"""
    offset: float
    """Share of ``apart`` by which they are shifted."""

    def distance(self, points: Array) -> Array:
        """Distance [m] of points (N, 2) from the middle of the nearest one."""
        if self.apart == 0.0:
            return np.full(len(points), np.inf)
        across = points[:, self.axis] / self.apart + self.offset
        return np.abs(across - np.round(across)) * self.apart

    def rut_depth(self, points: Array, depth: float) -> Array:
        """Depth [m] of the two ruts at points (N, 2): ``depth`` where a tire's middle runs, in the trail's shape."""
        off = self.distance(points) - 0.5 * RUT_APART
        return depth * np.exp(-((off / (0.6 * RUT_WIDTH)) ** 2))
