"""Flat-faced solids."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Points = NDArray[np.float64]


class Solid:
    """Flat faces, counter-clockwise seen from outside, each of one colour."""

    def __init__(self) -> None:
        self._points: list[Points] = []
        self._colours: list[tuple[float, float, float]] = []
        self.hulls: list[Points] = []
        """Points of each convex piece, for its shadow."""

    def face(self, points: ArrayLike, colour: tuple[float, float, float]) -> None:
        """One face (P, 3)."""
        self._points.append(np.asarray(points, dtype=np.float64))
        self._colours.append(colour)

    def prism(self, outline: ArrayLike, depth: tuple[float, float], colour: Any, *, sides: Any = None) -> None:
        """An outline (P, 2) of x and z, counter-clockwise seen from the right (−y), drawn out from y ``depth[0]`` to the
        larger ``depth[1]``."""
        outline = np.asarray(outline, dtype=np.float64)
        right = np.stack([outline[:, 0], np.full(len(outline), depth[0]), outline[:, 1]], axis=1)
        left = right + np.array([0.0, depth[1] - depth[0], 0.0])
        self.face(right, sides or colour)
        self.face(left[::-1], sides or colour)
        for i in range(len(outline)):
            j = (i + 1) % len(outline)
            self.face([right[i], left[i], left[j], right[j]], colour)
        self.hulls.append(np.concatenate([right, left]))

    def box(self, x: tuple[float, float], y: tuple[float, float], z: tuple[float, float], colour: Any) -> None:
        """Between two values along each axis."""
        self.prism([(x[0], z[0]), (x[1], z[0]), (x[1], z[1]), (x[0], z[1])], y, colour)

    def bar(self, start: ArrayLike, end: ArrayLike, radius: float, colour: Any, *, sides: int = 8) -> None:
        """A rod between two points.

        Args:
            start: One end (3,) [m].
            end: The other end (3,) [m].
            radius: Of the rod [m].
            colour: Of its faces.
            sides: Number of its sides.
        """
        start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
        along = (end - start) / np.linalg.norm(end - start)
        aside = np.cross(along, [0.0, 0.0, 1.0] if abs(along[2]) < 0.9 else [1.0, 0.0, 0.0])
        aside /= np.linalg.norm(aside)
        up = np.cross(along, aside)
        turn = 2.0 * np.pi * np.arange(sides) / sides
        ring = radius * (np.cos(turn)[:, None] * aside + np.sin(turn)[:, None] * up)
        first, second = start + ring, end + ring
        self.face(first[::-1], colour)
        self.face(second, colour)
        for i in range(sides):
            j = (i + 1) % sides
            self.face([first[i], first[j], second[j], second[i]], colour)
        self.hulls.append(np.concatenate([first, second]))

    def packed(self) -> tuple[Points, NDArray[np.intp], Points]:
        """All points (V, 3), where each face begins (F + 1), and the faces' colours (F, 3)."""
        sizes = [len(points) for points in self._points]
        return np.concatenate(self._points), np.concatenate([[0], np.cumsum(sizes)]), np.array(self._colours)

    def triangles(self) -> tuple[Points, NDArray[np.int64], Points]:
        """Points (V, 3), triangles (F, 3), convex faces as fans, and the points' colours (V, 3) from 0 to 1; faces share no
        points, so that edges are sharp."""
        points, starts, colours = self.packed()
        sizes = np.diff(starts)
        fans = [
            (first, first + i, first + i + 1)
            for first, size in zip(starts, sizes, strict=False)
            for i in range(1, size - 1)
        ]
        return points, np.array(fans, dtype=np.int64), np.repeat(colours, sizes, axis=0)
