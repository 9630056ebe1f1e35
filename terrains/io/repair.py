"""Repairs of heights on a grid: spikes, pieces that no vehicle can reach, and holes. Each says what it changed."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay, KDTree, QhullError

from aoro_gym.terrains.heights import Heights

SPIKE_STEEPNESS = 1.75
"""Tangent of the slope (60°) on both sides of what is a spike rather than ground."""

SAME_PLACE = 1e-6
"""Distance [m, or nodes] up to which two places are one."""
EIGHT = np.ones((3, 3), dtype=bool)
"""Nodes that share an edge or a corner of a cell are neighbours."""


def remove_spikes(heights: Heights, limit: float) -> tuple[Heights, int]:
    """Open the nodes that stick out of, or into, the ground; returns what is left and how many went.

    A spike is higher (or lower) than its surroundings by more than ``limit`` [m], is steeper than 60° on both sides and
    narrower than three nodes: a bird, a wire, a multiple echo. Steps, ledges and slopes are none.
    """
    z = heights.z
    known = heights.known
    threshold = max(limit, SPIKE_STEEPNESS * heights.cell)

    def lowest(a: NDArray[np.float64]) -> NDArray[np.float64]:
        return ndimage.minimum_filter(np.where(np.isfinite(a), a, np.inf), size=3, mode="nearest")

    def highest(a: NDArray[np.float64]) -> NDArray[np.float64]:
        return ndimage.maximum_filter(np.where(np.isfinite(a), a, -np.inf), size=3, mode="nearest")

    # Opening and closing by 3 x 3 nodes keep planes, steps and whatever is at least three nodes wide.
    with np.errstate(invalid="ignore"):
        sharp = (z - highest(lowest(z)) > threshold) | (lowest(highest(z)) - z > threshold)
    sharp &= known
    return heights.replaced(np.where(sharp, np.nan, z)), int(sharp.sum())


def remove_small_components(heights: Heights, smallest: float) -> tuple[Heights, list[float]]:
    """Open the pieces of ground below ``smallest`` [m²] apart from the largest; returns their areas [m²] with the rest.

    Pieces hang together by whole cells. Nodes of no cell go in silence: nothing could stand on them.
    """
    labels, count = cast(Any, ndimage.label(heights.covered, EIGHT))
    areas = np.bincount(labels.ravel(), minlength=count + 1)[1:] * heights.cell**2
    if count == 0:
        return heights.replaced(np.full_like(heights.z, np.nan)), []
    kept = areas >= min(smallest, areas.max())
    cells = np.concatenate([[False], kept])[labels]
    nodes = np.zeros(heights.z.shape, dtype=bool)
    for row in (slice(None, -1), slice(1, None)):
        for column in (slice(None, -1), slice(1, None)):
            nodes[row, column] |= cells
    return heights.replaced(np.where(nodes, heights.z, np.nan)), [float(area) for area in areas[~kept]]


def fill_holes(heights: Heights, limit: float) -> tuple[Heights, int]:
    """Bridge gaps up to ``limit`` [m] wide linearly between their rims; returns the result and how many nodes it gave.

    Gaps are closed by a disc of the diameter ``limit``, so bays of the edge are filled like holes inside, and ground is
    never continued outwards. What stays open is for the caller to name.
    """
    known = heights.known
    if not known.any() or known.all() or limit <= heights.cell:
        return heights, 0
    reach = 0.5 * limit / heights.cell  # in nodes
    margin = int(np.ceil(reach)) + 1
    padded = np.pad(known, margin)
    grown = _distance(~padded) <= reach
    closed = (_distance(grown) > reach)[margin:-margin, margin:-margin]
    missing = np.logical_and(closed, ~known)
    if not missing.any():
        return heights, 0
    rim = np.logical_and(known, ndimage.binary_dilation(~known, EIGHT))
    z = heights.z.copy()
    where = np.argwhere(rim).astype(np.float64)
    z[missing] = interpolate(where, z[rim], np.argwhere(missing).astype(np.float64))
    return heights.replaced(z), int(missing.sum())


def _distance(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Distance of each node of ``mask`` from the next one outside, in nodes."""
    return cast(Any, ndimage.distance_transform_edt(mask))


def interpolate(plan: NDArray[np.float64], z: NDArray[np.float64], wanted: NDArray[np.float64]) -> NDArray[np.float64]:
    """Heights at the positions ``wanted`` (M, 2), linear on the Delaunay triangles of ``plan`` (N, 2) with heights ``z``.

    Outside of the triangles, and where all positions lie on one line, the nearest height counts; positions that are one
    of ``plan`` have its height.
    """
    distance, nearest = KDTree(plan).query(wanted)
    found = z[nearest]
    apart = distance > SAME_PLACE
    if apart.any():
        try:
            linear = np.asarray(LinearNDInterpolator(_triangles(plan), z)(wanted[apart]))
        except (QhullError, ValueError):
            return found
        found[apart] = np.where(np.isfinite(linear), linear, found[apart])
    return found


def _triangles(plan: NDArray[np.float64]) -> Delaunay:
    """Triangles of ``plan`` with their barycentric transforms, as ``Delaunay.transform`` documents them.

    scipy gets these by a call of LAPACK a triangle, which takes sixty times longer where the threads of BLAS have to
    wait for other processes; set beforehand, they are taken as they are.
    """
    triangles = Delaunay(plan)
    a, b, c = (plan[triangles.simplices[:, corner]] for corner in range(3))
    u, v = a - c, b - c
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    flat = np.abs(area) <= 1e-12 * np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1)
    area = np.where(flat, np.nan, area)[:, np.newaxis]  # NaN, as scipy has it for triangles without an area
    first, second = np.stack([v[:, 1], -v[:, 0]], axis=1) / area, np.stack([-u[:, 1], u[:, 0]], axis=1) / area
    cast(Any, triangles)._transform = np.ascontiguousarray(np.stack([first, second, c], axis=1))
    return triangles
