"""Heights on a regular grid: what rasters, clouds and meshes in need of repair become, and what is checked."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MOST_NODES = 4_000_000
"""Most heights of one terrain; eight million triangles are about what a GPU traverses without noticing."""

_PAIRS_AT_ONCE = 2_000_000
"""Pairs of a triangle and a node that are tried in one go, 100 bytes each."""


@dataclass(frozen=True, eq=False)
class Heights:
    """Heights at the nodes of a square grid, row 0 in the south and column 0 in the west."""

    z: NDArray[np.float64]
    """(rows, columns) [m]; NaN where there is no ground."""
    cell: float
    """Distance of neighbouring nodes [m]."""
    corner: tuple[float, float] = (0.0, 0.0)
    """x, y of ``z[0, 0]`` [m]."""

    @property
    def known(self) -> NDArray[np.bool_]:
        """Nodes with ground."""
        return np.isfinite(self.z)

    @property
    def covered(self) -> NDArray[np.bool_]:
        """(rows - 1, columns - 1): cells with ground at all four corners."""
        known = self.known
        return known[:-1, :-1] & known[:-1, 1:] & known[1:, :-1] & known[1:, 1:]

    @property
    def points(self) -> NDArray[np.float64]:
        """(K, 3) x, y, z of the nodes with ground."""
        row, column = np.nonzero(self.known)
        x, y = self.corner[0] + self.cell * column, self.corner[1] + self.cell * row
        return np.array([x, y, self.z[row, column]], dtype=np.float64).T

    def replaced(self, z: NDArray[np.float64]) -> Heights:
        """The same grid with other heights."""
        return Heights(z, self.cell, self.corner)

    def gradient(self) -> NDArray[np.float64]:
        """(rows - 1, columns - 1) steepness (tangent of the slope) of the cells; NaN where they are open."""
        z = self.z
        along_x = (z[:-1, 1:] - z[:-1, :-1] + z[1:, 1:] - z[1:, :-1]) / (2.0 * self.cell)
        along_y = (z[1:, :-1] - z[:-1, :-1] + z[1:, 1:] - z[:-1, 1:]) / (2.0 * self.cell)
        return np.asarray(np.hypot(along_x, along_y), dtype=np.float64)


def grid_shape(low: NDArray[np.float64], high: NDArray[np.float64], cell: float) -> tuple[int, int]:
    """Rows and columns of the grid over the rectangle between x, y ``low`` and ``high`` [m]; at least 2 x 2."""
    columns, rows = (int(n) for n in np.maximum(np.floor((high[:2] - low[:2]) / cell + 1e-6).astype(int) + 1, 2))
    return rows, columns


def sample_triangles(
    vertices: NDArray[np.float64], faces: NDArray[np.integer], cell: float
) -> tuple[Heights, NDArray[np.float64]]:
    """Lowest and highest surface of triangles over a grid that covers them in plan.

    Args:
        vertices: (V, 3) [m].
        faces: (F, 3); their winding does not matter, upright ones count for nothing.
        cell: Distance of the nodes [m].

    Returns:
        The lowest surface, and the (rows, columns) heights of the highest one.
    """
    low, high = vertices[faces].min(axis=(0, 1)), vertices[faces].max(axis=(0, 1))
    rows, columns = grid_shape(low, high, cell)
    lowest = np.full(rows * columns, np.inf)
    highest = np.full(rows * columns, -np.inf)
    for node, z in _nodes_in_triangles(vertices, faces, low, cell, columns, rows):
        np.minimum.at(lowest, node, z)
        np.maximum.at(highest, node, z)
    lowest[np.isinf(lowest)] = np.nan
    highest[np.isinf(highest)] = np.nan
    corner = (float(low[0]), float(low[1]))
    return Heights(lowest.reshape(rows, columns), cell, corner), highest.reshape(rows, columns)


def _nodes_in_triangles(
    vertices: NDArray[np.float64],
    faces: NDArray[np.integer],
    low: NDArray[np.float64],
    cell: float,
    columns: int,
    rows: int,
) -> Iterator[tuple[NDArray[np.intp], NDArray[np.float64]]]:
    """Flat indices of the nodes within each triangle, and its heights there, some triangles at a time."""
    corners = vertices[faces]
    plan = (corners[:, :, :2] - low[:2]) / cell  # in cells
    first = np.maximum(np.ceil(plan.min(axis=1) - 1e-6).astype(np.int64), 0)
    last = np.minimum(np.floor(plan.max(axis=1) + 1e-6).astype(np.int64), [columns - 1, rows - 1])
    size = np.maximum(last - first + 1, 0)
    count = size[:, 0] * size[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b, c = plan[:, 0], plan[:, 1], plan[:, 2]
        area = _cross(b - a, c - a)
        todo = np.flatnonzero((count > 0) & (np.abs(area) > 1e-12))
    ends = np.cumsum(count[todo])
    start = 0
    while start < len(todo):
        base = ends[start - 1] if start else 0
        stop = max(int(np.searchsorted(ends, base + _PAIRS_AT_ONCE, side="right")), start + 1)
        chosen = todo[start:stop]
        start = stop
        which = np.repeat(chosen, count[chosen])
        serial = np.arange(len(which)) - np.repeat(np.cumsum(count[chosen]) - count[chosen], count[chosen])
        column = first[which, 0] + serial % size[which, 0]
        row = first[which, 1] + serial // size[which, 0]
        offset = np.stack([column, row], axis=1) - a[which]
        v = _cross(offset, (c - a)[which]) / area[which]
        w = _cross((b - a)[which], offset) / area[which]
        inside = (v >= -1e-6) & (w >= -1e-6) & (v + w <= 1.0 + 1e-6)
        z = corners[:, :, 2][which[inside]]
        v, w = v[inside], w[inside]
        yield (row * columns + column)[inside], z[:, 0] + v * (z[:, 1] - z[:, 0]) + w * (z[:, 2] - z[:, 0])


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
