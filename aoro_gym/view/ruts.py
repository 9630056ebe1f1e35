"""Ruts of soft ground on the page: squares just above it, the darker the deeper."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.machine.kinematics import Floats
from aoro_gym.terrains import Plane, Terrain
from aoro_gym.terrains.world.world import World
from aoro_gym.twin.soil_ruts import Ruts
from aoro_gym.view.scene import WORLD, nearest_heights

ABOVE = 0.03
"""[m] of the squares above the ground, which hides what lies in it."""
LEAST = 5e-3
"""Depth [m] from which a node is drawn."""
DARKEST = 0.25
"""Depth [m] of a rut that is drawn in the darkest colour."""
SHALLOW, DEEP = np.array([155.0, 105.0, 50.0]), np.array([10.0, 4.0, 2.0])
"""Colours, red, green and blue, of the shallowest ruts and the deepest, linear as vertex colours are."""


class RutMarks:
    """The ruts of twins on one ground.

    Args:
        scene: Of a server of viser.
        terrain: The undisturbed ground.
    """

    def __init__(self, scene: Any, terrain: Plane | Terrain | World):
        self._scene, self._terrain = scene, terrain
        self._node: Any = None

    def show(self, ruts: Sequence[Ruts]) -> None:
        """Draw what there is now."""
        import trimesh

        vertices, faces, colours = squares(ruts, self._terrain)
        if self._node is not None:
            self._node.remove()
            self._node = None
        if len(faces):
            mesh = trimesh.Trimesh(vertices, faces, vertex_colors=colours, process=False)
            self._node = self._scene.add_mesh_trimesh(f"{WORLD}/ruts", mesh)


def squares(
    ruts: Sequence[Ruts], terrain: Plane | Terrain | World
) -> tuple[Floats, NDArray[np.int64], NDArray[np.uint8]]:
    """Vertices (4 K, 3) [m], triangles (2 K, 3) and colours of the vertices (4 K, 4) of the K nodes that lie in ruts."""
    corners, depths = [np.zeros((0, 4, 2))], [np.zeros(0)]
    for one in ruts:
        rows, columns = np.nonzero(one.depth > LEAST)
        centres = np.stack([columns, rows], axis=1) * one.cell + np.asarray(one.corner)
        around = 0.5 * one.cell * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        corners.append(centres[:, None] + around)
        depths.append(one.depth[rows, columns].astype(np.float64))
    plan = np.concatenate(corners).reshape(-1, 2)
    heights = nearest_heights(terrain, plan) if len(plan) else np.zeros(0)
    share = np.clip(np.concatenate(depths) / DARKEST, 0.0, 1.0)[:, None]
    colours = np.concatenate([(1.0 - share) * SHALLOW + share * DEEP, np.full_like(share, 255.0)], axis=1)
    first = 4 * np.arange(len(share))[:, None]
    faces = (first + np.array([0, 1, 2, 0, 2, 3])).reshape(-1, 3)
    return np.column_stack([plan, heights + ABOVE]), faces, np.repeat(colours, 4, axis=0).astype(np.uint8)
