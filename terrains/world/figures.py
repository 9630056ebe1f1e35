"""Pictures of a world: from above, and at a slant, in the colours of its materials and the light of a low sun."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from aoro_gym.reporting.style import INK, SOFT
from aoro_gym.terrains.world.world import Scene, World

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUN = (-0.5, -0.55, 0.67)
"""Direction towards the sun."""
SKY = 0.35
"""Light that shadows have, too, against the sun's. (E)"""
SLANT_DEG = 35.0
"""Elevation of the slanting view; it looks north."""
SAMPLES = 2_000_000
"""Points on the triangles that a picture is made of."""
GAP = 1.5
"""Distance [pixels] over which gaps between points are closed."""
BACKGROUND = (0.93, 0.95, 0.97)


def draw_world(world: World, *, width: int = 700) -> Figure:
    """A figure with both views; ``width`` is that of the ground [pixels]."""
    from matplotlib.figure import Figure

    scene = world.scene()
    low, high = world.terrain.extent
    views = [
        ("from above", view(scene, 90.0, width)),
        ("from the south, 35° above level", view(scene, SLANT_DEG, width)),
    ]
    figure = Figure(figsize=(12.0, 6.4), dpi=100, layout="constrained")
    for axes, (title, image) in zip(figure.subplots(1, 2), views, strict=True):
        axes.imshow(image)
        axes.set_title(title, loc="left", fontsize=9, color=SOFT)
        axes.set_axis_off()
    counts = ", ".join(f"{count:,} {name}{'es' if name == 'branch' else 's'}" for name, count in world.counts.items())
    size = f"{high[0] - low[0]:.0f} m x {high[1] - low[1]:.0f} m"
    figure.suptitle(f"{world.name}, {size}\n{counts}", x=0.01, ha="left", fontsize=10, color=INK, parse_math=False)
    return figure


def view(scene: Scene, elevation_deg: float, width: int) -> NDArray[np.float64]:
    """(rows, columns, 3) image in [0, 1], along parallel rays that look north and down.

    Args:
        scene: Triangles.
        elevation_deg: Of the eye above level [deg]; 90 looks straight down.
        width: Columns.
    """
    points, normals, face = _sampled(scene)
    tilt = np.radians(elevation_deg)
    right = points[:, 0]
    up = points[:, 1] * np.sin(tilt) + points[:, 2] * np.cos(tilt)
    nearness = points[:, 2] * np.sin(tilt) - points[:, 1] * np.cos(tilt)
    scale = (width - 1) / max(float(np.ptp(right)), 1e-9)
    column = np.rint((right - right.min()) * scale).astype(np.int64)
    row = np.rint((up.max() - up) * scale).astype(np.int64)
    rows = int(row.max()) + 1
    pixel = row * width + column
    order = np.argsort(nearness, kind="stable")  # what is assigned last stays: the nearest
    nearest = np.full(rows * width, -1)
    nearest[pixel[order]] = order
    nearest = _filled(nearest.reshape(rows, width)).ravel()
    seen = np.flatnonzero(nearest >= 0)
    hit = nearest[seen]
    lit = np.abs(normals[hit] @ (np.asarray(SUN) / np.linalg.norm(SUN)))
    colour = scene.materials.albedo[scene.face_class[face[hit]]] * (SKY + (1.0 - SKY) * lit)[:, None]
    image = np.tile(np.asarray(BACKGROUND), (rows * width, 1))
    image[seen] = np.clip(2.2 * colour, 0.0, 1.0) ** (1.0 / 2.2)
    return image.reshape(rows, width, 3)


def _filled(nearest: NDArray[np.int64]) -> NDArray[np.int64]:
    """(rows, columns) with what a neighbour shows where no point fell."""
    from scipy.ndimage import distance_transform_edt

    apart, indices = cast(Any, distance_transform_edt(nearest < 0, return_indices=True))
    return np.where(apart < GAP, nearest[tuple(indices)], nearest)


def _sampled(scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.intp]]:
    """(N, 3) points spread evenly over the triangles, at least one on each, their unit normals, and their faces."""
    corners = scene.vertices[scene.faces].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=1)
    count = np.maximum(np.rint(SAMPLES * size / max(float(size.sum()), 1e-9)).astype(np.int64), 1)
    face = np.repeat(np.arange(len(count)), count)
    u, v = np.random.default_rng(0).random((2, len(face)))
    over = u + v > 1.0
    u[over], v[over] = 1.0 - u[over], 1.0 - v[over]
    a, b, c = (corners[face, k] for k in range(3))
    unit: Any = normal / np.maximum(size, 1e-12)[:, None]
    return a + u[:, None] * (b - a) + v[:, None] * (c - a), unit[face], face
