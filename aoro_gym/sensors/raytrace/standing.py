"""Trees of a generated forest as triangles: round trunks that taper, and cones for crowns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.sensors.raytrace.scene import BARE_GROUND, Scene
from aoro_gym.terrains.terrain import Terrain

if TYPE_CHECKING:
    from aoro_gym.terrains.generate.forest import Forest

GROUND, TRUNK, CROWN = 0, 1, 2
"""Classes of :func:`forest_scene`."""
REFLECTANCE = (BARE_GROUND, (0.4, 0.45), (0.5, 0.2))
"""Of ground, bark and needles at 905 nm and 1550 nm [-]: green leaves reflect half of the near infrared, and less where
water absorbs (Jacquemoud and Baret 1990, PROSPECT, Remote Sens. Environ. 34). E."""
SIDES = 12
"""Of a trunk and of a crown."""
CROWN_FROM, CROWN_WIDTH = 0.35, 0.08
"""Of a tree's height: where its crown begins, and the crown's radius there, as in scans of forests. E."""


def forest_scene(forest: Forest, **options: Any) -> Scene:
    """Ground of a generated forest with its trees, each an instance of its own from 1, in their order in ``forest``.

    ``options`` are those of :class:`~aoro_gym.sensors.raytrace.Scene`, such as ``device`` and ``bodies``.
    """
    return scene_with_trees(forest.terrain, forest.trees, **options)


def scene_with_trees(terrain: Terrain, trees: NDArray[np.float64], **options: Any) -> Scene:
    """A terrain with ``trees`` (K, 4), x, y, radius and height [m] of each; see :func:`forest_scene`."""
    vertices: list[NDArray[Any]] = [terrain.vertices]
    faces: list[NDArray[Any]] = [terrain.faces]
    labels = [np.zeros((len(terrain.faces), 2), dtype=np.int32)]
    first = len(terrain.vertices)
    for instance, (x, y, radius, height) in enumerate(trees, start=1):
        near = np.argmin(np.hypot(terrain.vertices[:, 0] - x, terrain.vertices[:, 1] - y))
        foot = terrain.vertices[near] * [0.0, 0.0, 1.0] + [x, y, -0.3]  # roots: no gap on a slope
        start = foot[2] + CROWN_FROM * height
        for kind, wide, low, high in (
            (TRUNK, radius, foot[2], foot[2] + 0.95 * height),
            (CROWN, CROWN_WIDTH * height, start, foot[2] + height),
        ):
            points, corners = _cone(np.array([x, y]), float(wide), float(low), float(high))
            vertices.append(points)
            faces.append(corners + first)
            labels.append(np.tile([instance, kind], (len(corners), 1)))
            first += len(points)
    label = np.concatenate(labels)
    settings: dict[str, Any] = {"reflectance": REFLECTANCE, **options}
    return Scene(
        np.concatenate(vertices),
        np.concatenate(faces),
        face_instance=label[:, 0],
        face_class=label[:, 1],
        **settings,
    )


def _cone(
    middle: NDArray[np.float64], radius: float, low: float, high: float
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Points (SIDES + 2, 3) and faces (2 SIDES, 3) of a closed upright cone."""
    angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
    rim = np.column_stack([middle + radius * np.column_stack([np.cos(angle), np.sin(angle)]), np.full(SIDES, low)])
    points = np.concatenate([rim, [[*middle, low], [*middle, high]]])
    here, following = np.arange(SIDES), (np.arange(SIDES) + 1) % SIDES
    bottom = np.column_stack([following, here, np.full(SIDES, SIDES)])
    side = np.column_stack([here, following, np.full(SIDES, SIDES + 1)])
    return points, np.concatenate([bottom, side]).astype(np.int32)
