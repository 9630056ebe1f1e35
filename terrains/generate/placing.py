"""Places on a terrain: where something may stand, how high the ground is there, and room between what stands."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from aoro_gym.terrains.heights import MOST_NODES, sample_triangles
from aoro_gym.terrains.paths.path import Path
from aoro_gym.terrains.terrain import Terrain

Array = NDArray[Any]
Place = tuple[float, float, float]
Rule = Callable[[Array, Any], NDArray[np.bool_]]
"""Of points (N, 2) and the radius [m] of what stands there (N,): whether it may."""

TRIES = 8
"""Places that are tried for each object before it is left out."""
FINEST_CELL = 0.25
"""Distance [m] of the heights that objects are put on."""
EDGE = 0.5
"""Distance [m] from the edge of the ground within which nothing stands. (E)"""
PATH_STEP = 0.25
"""Distance [m] of a path's points, from which its distance is measured: at most 0.5 % of a room of 1 m too far."""
ALONG = 0.2
"""Room [m] beside lying stems. (E)"""
BIN = 2.0
"""Side [m] of the squares in which neighbours are looked up."""


class Site:
    """A terrain to stand on."""

    def __init__(self, terrain: Terrain, standing: NDArray[np.bool_], clear: Sequence[tuple[Path, float]]):
        """Sample the ground.

        Args:
            terrain: The ground.
            standing: (V,) whether something may stand at each of its vertices.
            clear: Paths, and the distance [m] from each within which nothing stands.
        """
        self.low, self.high = terrain.extent
        sides = (self.high - self.low)[:2]
        cell = max(FINEST_CELL, float(np.sqrt(sides[0] * sides[1] / (0.9 * MOST_NODES))))
        self.heights, _ = sample_triangles(terrain.vertices, terrain.faces, cell)
        self.short_side = int(np.argmin(sides))
        self.clear = [(KDTree(path.resample(PATH_STEP).points), room) for path, room in clear]
        self.standing = standing
        self._nearest = None if standing.all() else KDTree(terrain.vertices[:, :2])

    @property
    def hectares(self) -> float:
        """Ground that things may stand on."""
        x, y = (np.arange(self.low[k] + 0.5, self.high[k], 1.0) for k in (0, 1))
        nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        return float(self.free(nodes).sum()) / 1e4

    def height(self, points: Array) -> Array:
        """(N,) height [m] of the ground at points (N, 2), between its nodes bilinearly; NaN where there is none."""
        z, cell = self.heights.z, self.heights.cell
        rows, columns = z.shape
        at = (np.asarray(points, dtype=np.float64) - self.heights.corner) / cell
        outside = np.any((at < 0.0) | (at > [columns - 1, rows - 1]), axis=1)
        column = np.clip(np.floor(at[:, 0]).astype(np.int64), 0, columns - 2)
        row = np.clip(np.floor(at[:, 1]).astype(np.int64), 0, rows - 2)
        u, v = at[:, 0] - column, at[:, 1] - row
        south = (1.0 - u) * z[row, column] + u * z[row, column + 1]
        north = (1.0 - u) * z[row + 1, column] + u * z[row + 1, column + 1]
        return np.where(outside, np.nan, (1.0 - v) * south + v * north)

    def free(self, points: Array, radius: Array | float = 0.0) -> NDArray[np.bool_]:
        """(N,) whether there is ground to stand on at points (N, 2) and around them, off the paths."""
        points = np.asarray(points, dtype=np.float64)
        reach = np.broadcast_to(radius, len(points))
        ok = np.isfinite(self.height(points))
        for dx, dy in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
            ok &= np.isfinite(self.height(points + (reach + EDGE)[:, None] * [dx, dy]))
        if self._nearest is not None:
            ok &= self.standing[self._nearest.query(points)[1]]
        for path, room in self.clear:
            ok &= path.query(points)[0] > room + reach
        return ok


class Places:
    """What stands on a site so far, as discs in plan."""

    def __init__(self, site: Site):
        self.site = site
        self.bins: dict[tuple[int, int], list[tuple[float, float, float, float]]] = {}
        """x, y, radius and room around [m] by squares."""
        self.widest = 0.0

    def scatter(
        self, rng: np.random.Generator, radii: Array, apart: float, rule: Rule | None
    ) -> Iterator[tuple[int, Place]]:
        """Number and place of each of several discs that finds one at random.

        Args:
            rng: Generator.
            radii: (N,) [m].
            apart: Room [m] between their edges; between those of two kinds, the less of theirs.
            rule: What else holds.
        """
        for i, points, ok in self._tries(rng, radii, rule):
            for (x, y), good in zip(points, ok, strict=True):
                if good and self._has_room(x, y, radii[i], apart):
                    self._take(x, y, radii[i], apart)
                    yield i, self._place(x, y)
                    break

    def scatter_lines(
        self, rng: np.random.Generator, lengths: Array, headings: Array, radii: Sequence[float], rule: Rule | None
    ) -> Iterator[tuple[int, Place]]:
        """Number and start of each of several lying stems that finds a place at random.

        Args:
            rng: Generator.
            lengths: (N,) [m].
            headings: (N,) [rad].
            radii: (N,) [m].
            rule: What else holds, all along.
        """
        for i, points, ok in self._tries(rng, np.asarray(radii), rule):
            steps = np.arange(0.0, lengths[i] + 0.25, 0.5)
            way = steps[:, None] * [np.cos(headings[i]), np.sin(headings[i])]
            for point, good in zip(points, ok, strict=True):
                if not good:
                    continue
                discs = point + way
                if not self.site.free(discs, radii[i]).all() or (rule and not rule(discs, radii[i]).all()):
                    continue
                if all(self._has_room(x, y, radii[i], ALONG) for x, y in discs):
                    for x, y in discs:
                        self._take(x, y, radii[i], ALONG)
                    yield i, self._place(*point)
                    break

    def loose(
        self, rng: np.random.Generator, count: int, rule: Callable[[Array], NDArray[np.bool_]], kept: NDArray[np.bool_]
    ) -> Iterator[tuple[int, Place]]:
        """Number and place of what lies anywhere, among other things, too.

        Args:
            rng: Generator.
            count: How many.
            rule: Where those that are ``kept`` to it lie.
            kept: (N,) which are.
        """
        for i, points, ok in self._tries(rng, np.full(count, 0.2), None):
            chosen = ok & rule(points) if kept[i] and (ok & rule(points)).any() else ok
            for x, y in points[chosen][:1]:
                yield i, self._place(x, y)

    def _tries(
        self, rng: np.random.Generator, radii: Array, rule: Rule | None
    ) -> Iterator[tuple[int, Array, NDArray[np.bool_]]]:
        """Number, (T, 2) points to try, and whether each may be taken."""
        count = len(radii)
        points = rng.uniform(self.site.low[:2], self.site.high[:2], (count, TRIES, 2))
        reach = np.repeat(radii, TRIES)
        flat = points.reshape(-1, 2)
        ok = self.site.free(flat, reach)
        if rule is not None:
            ok &= rule(flat, reach)
        for i in range(count):
            yield i, points[i], ok.reshape(count, TRIES)[i]

    def _place(self, x: float, y: float) -> Place:
        return float(x), float(y), float(self.site.height(np.array([[x, y]]))[0])

    def _take(self, x: float, y: float, radius: float, apart: float) -> None:
        self.bins.setdefault((int(x // BIN), int(y // BIN)), []).append((x, y, radius, apart))
        self.widest = max(self.widest, radius)

    def _has_room(self, x: float, y: float, radius: float, apart: float) -> bool:
        reach = radius + self.widest + apart
        columns = range(int((x - reach) // BIN), int((x + reach) // BIN) + 1)
        rows = range(int((y - reach) // BIN), int((y + reach) // BIN) + 1)
        near = (disc for c in columns for r in rows for disc in self.bins.get((c, r), ()))
        return all((x - a) ** 2 + (y - b) ** 2 >= (radius + r + min(apart, gap)) ** 2 for a, b, r, gap in near)
