"""Ground told from vegetation and buildings: a cloth that is dropped on the upturned cloud.

W. Zhang et al., An Easy-to-Use Airborne LiDAR Data Filtering Method Based on Cloth Simulation, Remote Sensing 8 (2016)
501; here its authors' own implementation, cloth-simulation-filter. On steep ground a cloth hangs over valleys or tears
off ridges, so it is dropped on what stands above the coarse relief instead.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from aoro_gym.terrains.extras import import_extra
from aoro_gym.terrains.io.repair import interpolate

CLOTH = 0.5
"""Mesh width of the cloth [m]."""
CLASS_THRESHOLD = 0.5
"""Largest height above the cloth [m] of what is ground."""
STEEP_TERRAIN = 1
"""The softest of the three cloths: it follows slopes."""
COARSEST_CLOTH = 0.25
"""Largest mesh width of the cloth, by the distance of the points under it: finer ones only cost time."""
RELIEF_CELL = 10.0
"""Cell of the coarse relief [m]. What is narrower than two of them, such as a house, does not lift it."""
MOST_RELIEF = 1_000_000
"""Cells of the relief; over kilometres they become larger."""
TILE, OVERLAP = 400.0, 20.0
"""Side of what one cloth covers, and how far it reaches beyond [m]."""

Points = NDArray[np.float64]


def ground_points(points: Points, progress: Callable[[float], None] | None = None) -> NDArray[np.bool_]:
    """(N,) whether each of ``points`` (N, 3) [m] lies on the ground.

    Measured on alpine forest of 20° slope, beside the surveyor's classes: 0.1 m root mean square of the height.

    Args:
        points: The lowest points of small cells are enough, and fastest.
        progress: Told the share that is done.
    """
    csf = import_extra("CSF", "telling ground from vegetation")
    mask = np.zeros(len(points), dtype=bool)
    if len(points) < 10:  # too few to carry a cloth
        return mask
    above = np.column_stack([points[:, :2] - points[:, :2].min(axis=0), points[:, 2] - relief(points)])
    tiles = np.floor(above[:, :2] / TILE).astype(np.int64)
    corners = np.unique(tiles, axis=0)
    for done, tile in enumerate(list(corners)):
        near = np.flatnonzero(
            np.all((above[:, :2] >= tile * TILE - OVERLAP) & (above[:, :2] < (tile + 1) * TILE + OVERLAP), axis=1)
        )
        own = np.all(tiles[near] == tile, axis=1)
        lying = _simulate_cloth(csf, above[near]) if len(near) >= 10 else np.zeros(len(near), dtype=bool)
        mask[near[own]] = lying[own]
        if progress is not None:
            progress((done + 1) / len(corners))
    return mask


def relief(points: Points) -> Points:
    """(N,) coarse height of the ground below ``points``: the lowest of each cell, without what rises from it alone."""
    size = np.ptp(points[:, :2], axis=0)
    cell = max(RELIEF_CELL, float(np.sqrt(np.prod(size + RELIEF_CELL) / MOST_RELIEF)))
    plan = (points[:, :2] - points[:, :2].min(axis=0)) / cell
    shape = tuple(int(n) + 1 for n in plan.max(axis=0))
    number = np.floor(plan).astype(np.int64) @ np.array([shape[1], 1])
    order = np.lexsort((points[:, 2], number))
    _, first = np.unique(number[order], return_index=True)
    lowest = order[first]
    centres = np.indices(shape).reshape(2, -1).T.astype(np.float64) + 0.5
    z = interpolate(plan[lowest], points[lowest, 2], centres).reshape(shape)
    z = ndimage.maximum_filter(ndimage.minimum_filter(z, 3, mode="nearest"), 3, mode="nearest")
    return ndimage.map_coordinates(z, (plan - 0.5).T, order=1, mode="nearest")


def _simulate_cloth(csf: Any, points: Points) -> NDArray[np.bool_]:
    cloth = csf.CSF()
    spacing = float(np.sqrt(np.prod(np.ptp(points[:, :2], axis=0)) / len(points)))
    cloth.params.cloth_resolution = max(CLOTH, COARSEST_CLOTH * spacing)
    cloth.params.rigidness = STEEP_TERRAIN
    cloth.params.class_threshold = CLASS_THRESHOLD
    cloth.params.bSloopSmooth = True
    ground, rest = csf.VecInt(), csf.VecInt()
    with suppressed_output(1):
        cloth.setPointCloud(np.ascontiguousarray(points - points.min(axis=0)))
        cloth.do_filtering(ground, rest, False)
    mask = np.zeros(len(points), dtype=bool)
    mask[np.array(ground, dtype=np.intp)] = True
    return mask


@contextmanager
def suppressed_output(descriptor: int) -> Iterator[None]:
    """Keep what compiled code prints away from the standard output (1), or that for errors (2)."""
    (sys.stdout if descriptor == 1 else sys.stderr).flush()
    kept = os.dup(descriptor)
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), descriptor)
            yield
    finally:
        os.dup2(kept, descriptor)
        os.close(kept)
