"""Many vehicles on many paths at once: projections, headings and previews without a loop over either."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from aoro_gym.execution.array_api import HOST, Array, Arrays, namespace
from aoro_gym.terrains import Path


class PathTable:
    """Paths at points of one spacing, stacked, so that asking for N vehicles costs O(N) whatever the paths' lengths.

    Projections look at the segments near the last one only: a vehicle stays on its branch where a path crosses itself.
    Open paths go on straight beyond their ends, closed ones into the next lap.

    Args:
        paths: At least one.
        spacing: Distance [m] of the points; a chord cuts κ spacing²/8 off a bend, 1.6 mm at 5 m of radius.
        ahead: How far [m] beyond a path's end, and before its start, places may be asked for.
        arrays: Where the points live, and what is asked for.
    """

    def __init__(self, paths: Sequence[Path], *, spacing: float = 0.25, ahead: float = 12.0, arrays: Arrays = HOST):
        if not paths:
            raise ValueError("there is no path; give at least one")
        self.spacing = spacing
        self._beyond = math.ceil(ahead / spacing) + 2
        self.paths: list[Path] = []
        """In the order of the rows."""
        self.lengths = np.zeros(0)
        """Of each path [m], on the host; of one lap if it is closed."""
        self.closed = np.zeros(0, dtype=bool)
        """Whether it is, likewise."""
        self._arrays = arrays
        self._rows: list[NDArray[np.float64]] = []
        self.add(paths)

    def __len__(self) -> int:
        return len(self.paths)

    def add(self, paths: Sequence[Path]) -> None:
        """More rows, after those there are."""
        self._rows += [self._row(path) for path in paths]
        self.paths += paths
        self._stack()

    def shortened(self, count: int) -> None:
        """Keep the first ``count`` rows only."""
        del self.paths[count:], self._rows[count:]
        self._stack()

    def _stack(self) -> None:
        self.lengths = np.array([path.length for path in self.paths])
        self.closed = np.array([path.closed for path in self.paths])
        self._count = max(len(row) for row in self._rows)
        # what follows a shorter path's points is never asked for
        stacked = [np.pad(row, ((0, self._count - len(row)), (0, 0)), mode="edge") for row in self._rows]
        self._on_host = np.ascontiguousarray(np.concatenate(stacked).T)
        self._points = self._arrays.asarray(self._on_host)  # as in places()

    def _row(self, path: Path) -> NDArray[np.float64]:
        number = np.arange(-self._beyond, math.ceil(path.length / self.spacing) + self._beyond + 1)
        s = number * self.spacing
        xy, heading, curvature = path.position(s), path.heading(s), path.curvature(s)
        if not path.closed:
            for end, place in ((s < 0.0, 0.0), (s > path.length, path.length)):
                direction = path.heading(place)
                along = (s[end] - place)[:, None] * np.array([np.cos(direction), np.sin(direction)])
                xy[end] = path.position(place) + along
                curvature[end] = 0.0
        return np.column_stack([xy, np.cos(heading), np.sin(heading), curvature])

    def project(self, row: Array, xy: Array, near: Array, *, reach: float) -> tuple[Array, Array]:
        """Arc length and cross-track offset [m] (N,) of points on their paths, the offset positive left of the path.

        Args:
            row: Which path each is on (N,).
            xy: (N, 2) [m].
            near: Last known arc length [m] (N,).
            reach: How far [m] around it to look.
        """
        arrays, xp = self._arrays, self._arrays.xp
        half = math.ceil(reach / self.spacing)
        middle = xp.astype(xp.round(near / self.spacing), xp.int64) + self._beyond
        first = xp.clip(middle - half, 0, max(self._count - 1 - 2 * half, 0))
        around = (row * self._count + first)[:, None] + arrays.arange(min(2 * half + 1, self._count))
        x, y = self._points[0][around], self._points[1][around]
        side_x, side_y = x[:, 1:] - x[:, :-1], y[:, 1:] - y[:, :-1]
        apart_x, apart_y = xy[:, :1] - x[:, :-1], xy[:, 1:] - y[:, :-1]
        length = xp.clip(side_x**2 + side_y**2, 1e-12, None)
        along = xp.clip((apart_x * side_x + apart_y * side_y) / length, 0.0, 1.0)
        gap_x, gap_y = apart_x - along * side_x, apart_y - along * side_y
        gap = gap_x**2 + gap_y**2
        best, each = xp.argmin(gap, axis=1), arrays.arange(len(row))
        s = (first + best + along[each, best] - self._beyond) * self.spacing
        distance = xp.sqrt(gap[each, best])
        right = (side_x * gap_y - side_y * gap_x)[each, best] < 0.0
        return s, xp.where(right, -distance, distance)

    def places(self, row: Array, s: Array) -> Array:
        """What stands at arc lengths ``s`` (...) [m] of the paths ``row``, which broadcasts against it, (5, ...): x, y [m],
        cosine and sine of the heading, curvature [1/m]. On the host for arrays of the host."""
        xp = namespace(s)
        points = self._on_host if xp is np else self._points
        place = xp.clip(s / self.spacing + self._beyond, 0.0, self._count - 1.001)
        before = xp.astype(place, xp.int64)
        first, second = (points[:, row * self._count + before + step] for step in (0, 1))
        return first + (place - before) * (second - first)

    def at(self, row: Array, s: Array) -> tuple[Array, Array, Array]:
        """Position (..., 2) [m], heading (...) [rad] and curvature (...) [1/m] there."""
        xp = namespace(s)
        x, y, cosine, sine, curvature = self.places(row, s)
        return xp.stack([x, y], axis=-1), xp.atan2(sine, cosine), curvature
