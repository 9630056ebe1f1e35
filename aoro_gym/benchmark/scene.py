"""What everything that is timed shares: one ground, where to stand on it, and commands that change."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from aoro_gym.terrains import Terrain
from aoro_gym.terrains.generate.forest import forest

GROUNDS = ("plane", "raster", "mesh")
"""Level asphalt, or a forest that the twins feel as a raster or as its triangles."""
FOREST_SEED = 7
NODES, CELL = 256, 0.25
"""Heights of the forest along a side, and their distance [m]."""
SIDE = (NODES - 1) * CELL
CONTROL_STEP = 0.02
"""Simulated time [s] between two changes of the commands."""
EPISODE = 500
"""Control steps after which all begin anew, so that nothing drives off the ground."""
CHANGES = 16
"""Different commands, in turn."""


@cache
def terrain() -> Terrain:
    """The forest, a square of ``NODES`` x ``NODES`` heights."""
    return forest(FOREST_SEED, size=(SIDE, SIDE), cell=CELL).terrain


def heights(ground: str) -> NDArray[np.float64]:
    """Heights [m] of ``ground`` (NODES, NODES), rows from south to north, the square's middle at the origin."""
    if ground == "plane":
        return np.zeros((NODES, NODES))
    return terrain().vertices[:, 2].reshape(NODES, NODES)


def starts(count: int, seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Plan positions (count, 2) [m] in the ground's inner half, and headings (count,) [rad]."""
    rng = np.random.default_rng((seed, 0))
    return rng.uniform(-0.25 * SIDE, 0.25 * SIDE, (count, 2)), rng.uniform(-np.pi, np.pi, count)


def signals(count: int, seed: int) -> NDArray[np.float32]:
    """Steering and drive signals (CHANGES, 2, count): all of the steering's range, half of the drive's."""
    rng = np.random.default_rng((seed, 1))
    drawn = rng.uniform(-1.0, 1.0, (CHANGES, 2, count)).astype(np.float32)
    drawn[:, 1] *= 0.5
    return drawn
