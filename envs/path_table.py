"""Many vehicles on many paths at once: projections, headings and previews without a loop over either."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from aoro_gym.terrains import Path

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]


class PathTable:
    """Paths at points of one spacing, stacked, so that asking for N vehicles costs O(N) whatever the paths' lengths.

    Projections look at the segments near the last one only: a vehicle stays on its branch where a path crosses itself.
    Open paths go on straight beyond their ends, closed ones into the next lap.

    Args:
        paths: At least one.
        spacing: Distance [m] of the points; a chord cuts κ spacing²/8 off a bend, 1.6 mm at 5 m of radius.
        ahead: How far [m] beyond a path's end, and before its start, places may be asked for.
    """

    def __init__(self, paths: Sequence[Path], *, spacing: float = 0.25, ahead: float = 12.0):
        if not paths:
            raise ValueError("there is no path; give at least one")
        self.spacing = spacing
        self._beyond = math.ceil(ahead / spacing) + 2
        self.paths: list[Path] = []
        """In the order of the rows."""
        self.lengths = np.zeros(0)
        """Of each path [m]; of one lap if it is closed."""
        self._points = np.zeros((0, 0, 5))  # (paths, points): x, y [m], cosine and sine of the heading, curvature [1/m]
        self.add(paths)

    def __len__(self) -> int:
        return len(self.paths)

    def add(self, paths: Sequence[Path]) -> None:
        """More rows, after those there are."""
        rows = [self._row(path) for path in paths]
        longest = max([self._points.shape[1], *(len(row) for row in rows)])
        # what follows a shorter path's points is never asked for
        stacked = [np.pad(row, ((0, longest - len(row)), (0, 0)), mode="edge") for row in (*self._points, *rows)]
        self._points = np.stack(stacked)
        self.paths += paths
        self.lengths = np.array([path.length for path in self.paths])

    def shortened(self, count: int) -> None:
        """Keep the first ``count`` rows only."""
        del self.paths[count:]
        self._points, self.lengths = self._points[:count], self.lengths[:count]

    def _row(self, path: Path) -> Floats:
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

    def project(self, row: Rows, xy: Floats, near: Floats, *, reach: float) -> tuple[Floats, Floats]:
        """Arc length and cross-track offset [m] (N,) of points on their paths, the offset positive left of the path.

        Args:
            row: Which path each is on (N,).
            xy: (N, 2) [m].
            near: Last known arc length [m] (N,).
            reach: How far [m] around it to look.
        """
        half = math.ceil(reach / self.spacing)
        middle = np.rint(near / self.spacing).astype(np.intp) + self._beyond
        segment = middle[:, None] + np.arange(-half, half)
        segment = np.clip(segment, 0, self._points.shape[1] - 2)
        start = self._points[row[:, None], segment, :2]
        side = self._points[row[:, None], segment + 1, :2] - start
        apart = xy[:, None] - start
        length = side[..., 0] ** 2 + side[..., 1] ** 2
        along = np.clip(
            (apart[..., 0] * side[..., 0] + apart[..., 1] * side[..., 1]) / np.maximum(length, 1e-12), 0.0, 1.0
        )
        gap = apart - along[..., None] * side
        best = np.argmin(gap[..., 0] ** 2 + gap[..., 1] ** 2, axis=1)
        each = np.arange(len(row))
        s = (segment[each, best] + along[each, best] - self._beyond) * self.spacing
        off, on = gap[each, best], side[each, best]
        distance = np.sqrt(off[:, 0] ** 2 + off[:, 1] ** 2)
        return s, np.where(on[:, 0] * off[:, 1] - on[:, 1] * off[:, 0] < 0.0, -distance, distance)

    def at(self, row: Rows, s: Floats) -> tuple[Floats, Floats, Floats]:
        """Position (..., 2) [m], heading (...) [rad] and curvature (...) [1/m] at arc lengths ``s`` [m] of the paths
        ``row``, which broadcasts against it."""
        place = np.clip(s / self.spacing + self._beyond, 0.0, self._points.shape[1] - 1.001)
        before = place.astype(np.intp)
        share = (place - before)[..., None]
        first, second = self._points[row, before], self._points[row, before + 1]
        between = first + share * (second - first)
        return between[..., :2], np.arctan2(between[..., 3], between[..., 2]), between[..., 4]
