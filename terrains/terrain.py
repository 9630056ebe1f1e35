"""A terrain: triangles that a vehicle can stand on, in a small local frame, with what the ground is made of."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.checks import check_range

LARGEST_COORDINATE = 5000.0
"""Largest local coordinate [m]: float32 still resolves 0.5 mm there."""


@dataclass(frozen=True, eq=False)
class Terrain:
    """Triangles in a local frame: x east, y north, z up [m], near its origin so that float32 keeps millimetres.

    Raises ``ValueError`` naming the value, its bound and the fix.
    """

    vertices: NDArray[np.float64]
    """(V, 3) [m], finite, within ``LARGEST_COORDINATE`` of the local origin."""
    faces: NDArray[np.int32]
    """(F, 3) indices of vertices, counter-clockwise seen from above."""
    friction: float | NDArray[np.float64] = 1.0
    """Multiplier of the tires' friction (1 is dry asphalt): one, or (V,) one a vertex."""
    rolling_resistance: float | NDArray[np.float64] = 1.0
    """Multiplier of the tires' rolling resistance (1 is asphalt): one, or (V,) one a vertex."""
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Coordinates [m] of the local origin in ``crs``: world = local + origin."""
    crs: str | None = None
    """Coordinate reference system of the world's x and y, as pyproj reads it (``"EPSG:32633"``); None: unknown."""
    name: str = "terrain"

    def __post_init__(self) -> None:
        vertices = np.ascontiguousarray(self.vertices, dtype=np.float64)
        faces = np.ascontiguousarray(self.faces, dtype=np.int32)
        if vertices.ndim != 2 or vertices.shape[1:] != (3,) or len(vertices) < 3:
            raise ValueError(f"terrain vertices have the shape {vertices.shape}; give (V, 3) with at least 3 points")
        if faces.ndim != 2 or faces.shape[1:] != (3,) or len(faces) < 1:
            raise ValueError(f"terrain faces have the shape {faces.shape}; give (F, 3) with at least one triangle")
        if not np.isfinite(vertices).all():
            bad = int(np.argmin(np.isfinite(vertices).all(axis=1)))
            raise ValueError(f"terrain vertex {bad} is {vertices[bad].tolist()}, but must be finite")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise ValueError(f"terrain faces reach vertex {faces.max()}, but there are {len(vertices)}")
        farthest = float(np.abs(vertices).max())
        if farthest > LARGEST_COORDINATE:
            raise ValueError(
                f"a terrain vertex lies {farthest:.0f} m from the local origin, but float32 keeps millimetres only"
                f" within {LARGEST_COORDINATE:.0f} m; shift it by `origin` or crop it"
            )
        for name, value in {"vertices": vertices, "faces": faces}.items():
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        for name in ("friction", "rolling_resistance"):
            object.__setattr__(self, name, _multiplier(name, getattr(self, name), len(vertices)))

    def __repr__(self) -> str:
        (length, width), size = np.ptp(self.vertices[:, :2], axis=0), len(self.faces)
        return f"Terrain({self.name!r}, {size:,} triangles, {length:.4g} m x {width:.4g} m)"

    def __copy__(self) -> Terrain:
        return self  # immutable

    def __deepcopy__(self, memo: dict[int, Any]) -> Terrain:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(getattr(self, entry.name) for entry in fields(self))  # read-only again, and checked

    @classmethod
    def from_heights(
        cls,
        heights: ArrayLike,
        *,
        cell: float,
        corner: tuple[float, float] = (0.0, 0.0),
        friction: ArrayLike = 1.0,
        rolling_resistance: ArrayLike = 1.0,
        **rest: Any,
    ) -> Terrain:
        """Two triangles a cell over a regular grid.

        Args:
            heights: (rows, columns) [m]; row 0 is the southern edge, column 0 the western one. Cells with a NaN corner
                stay open.
            cell: Distance [m] of neighbouring heights.
            corner: x, y [m] of ``heights[0, 0]`` in the local frame.
            friction: Multiplier, one or (rows, columns).
            rolling_resistance: Multiplier, one or (rows, columns).
            rest: ``origin``, ``crs``, ``name``.
        """
        z = np.asarray(heights, dtype=np.float64)
        if z.ndim != 2 or min(z.shape) < 2:
            raise ValueError(f"terrain heights have the shape {z.shape}; give at least 2 rows and 2 columns")
        check_range("terrain cell", cell, "m", gt=0.0)
        rows, columns = z.shape
        y, x = np.meshgrid(corner[1] + cell * np.arange(rows), corner[0] + cell * np.arange(columns), indexing="ij")
        index = np.arange(z.size).reshape(z.shape)
        a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
        known = np.isfinite(z.ravel())
        whole = known[a] & known[b] & known[c] & known[d]
        if not whole.any():
            raise ValueError("terrain heights have no cell with four finite corners; there is no ground to stand on")
        faces = np.concatenate([np.stack([a, b, c], axis=1)[whole], np.stack([a, c, d], axis=1)[whole]])
        met = np.zeros(z.size, dtype=bool)
        met[faces.ravel()] = True
        used = np.flatnonzero(met)
        renumbered = np.zeros(z.size, dtype=np.int32)
        renumbered[used] = np.arange(len(used))
        cover = {"friction": friction, "rolling_resistance": rolling_resistance}
        for name, value in cover.items():
            array = np.asarray(value, dtype=np.float64)
            cover[name] = array if array.ndim == 0 else np.broadcast_to(array, z.shape).ravel()[used]
        vertices = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)[used]
        return cls(vertices=vertices, faces=renumbered[faces], **cover, **rest)

    @property
    def extent(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest and highest local x, y, z [m], each of shape (3,)."""
        return self.vertices.min(axis=0), self.vertices.max(axis=0)


def _multiplier(name: str, value: Any, count: int) -> float | NDArray[np.float64]:
    array = np.array(value, dtype=np.float64)
    if array.shape not in ((), (count,)):
        raise ValueError(f"terrain {name} has the shape {array.shape}; give one number or ({count},), one a vertex")
    low, high = {"friction": (0.01, 2.0), "rolling_resistance": (0.0, 50.0)}[name]
    check_range(f"terrain {name}", array, ge=low, le=high, note=" x asphalt")
    if array.ndim == 0:
        return float(array)
    array.flags.writeable = False
    return array
