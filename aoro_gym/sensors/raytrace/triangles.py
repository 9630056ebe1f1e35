"""Triangles as rays need them, checked."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.checks import check_finite, check_range
from aoro_gym.terrains.terrain import LARGEST_COORDINATE

MOST_FACES = 50_000_000
"""Most triangles of a scene: with their hierarchy about 100 bytes each, 5 GB (E)."""


def checked_triangles(
    name: str, vertices: ArrayLike | None, faces: ArrayLike | None
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Vertices (V, 3) [m] and faces (F, 3) as float32 and int32; ValueError that begins with ``name`` otherwise."""
    points, corners = np.asarray(vertices), np.asarray(faces)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 3:
        raise ValueError(f"{name} vertices have the shape {points.shape}, but must be (V, 3) with at least 3 points")
    if corners.ndim != 2 or corners.shape[1] != 3 or len(corners) < 1:
        raise ValueError(f"{name} faces have the shape {corners.shape}, but must be (F, 3) with at least one triangle")
    if len(corners) > MOST_FACES:
        raise ValueError(
            f"{name} has {len(corners):.3g} faces, but rays take at most {MOST_FACES:.3g};"
            f" crop it, or give far things fewer triangles"
        )
    if not np.issubdtype(corners.dtype, np.integer):
        raise ValueError(f"{name} faces are of type {corners.dtype}, but must be integers")
    check_finite(f"{name} vertices", points, "m")
    note = "; shift the scene to its origin: float32 keeps millimetres only there"
    check_range(f"{name} vertices", points, "m", ge=-LARGEST_COORDINATE, le=LARGEST_COORDINATE, note=note)
    check_range(f"{name} faces", corners, ge=0, le=len(points) - 1, note=", the vertices that there are")
    return np.ascontiguousarray(points, dtype=np.float32), np.ascontiguousarray(corners, dtype=np.int32)
