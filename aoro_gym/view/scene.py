"""What is seen: machines, ground and path as nodes of a scene of viser.

Everything lies under ``/world``, which is moved instead of the camera: so the camera follows a machine while the user may
turn it as ever.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.machine import Machine
from aoro_gym.machine.crane_solids import CRANE_NODES, HELD_LOG, crane_placed, crane_solids, log_solid
from aoro_gym.machine.kinematics import CranePose, Floats, Kinematics, Pose
from aoro_gym.machine.solid import Solid
from aoro_gym.machine.solids import front_frame, machine_solids
from aoro_gym.terrains import Path, Plane, Terrain
from aoro_gym.terrains.colours import ground_colours, world_colours
from aoro_gym.terrains.world.world import World

WORLD = "/world"
FORCE_SCALE = 8e-5
"""Length of an arrow [m] a force [N]: 1 m for 12.5 kN, so that a wheel's load at rest reaches over the wheel."""
LEAST_FORCE = 200.0
"""[N] below which no arrow is drawn."""
PATH_ABOVE = 0.06
"""[m] of the path above the ground, so that it shows."""
PLANE_SIZE, PLANE_CELL = 200.0, 2.0
"""[m] edge of a drawn plane, which has none, and of its squares."""
TINTS = (None, (0.25, 0.55, 0.85), (0.85, 0.35, 0.35), (0.35, 0.7, 0.45), (0.6, 0.45, 0.8))
"""Colours by which several machines are told apart; the first is painted as it is."""
TINT_SHARE = 0.65


class MachineNodes:
    """One machine in the scene.

    Args:
        scene: Of a server of viser.
        name: Its node under ``/world``.
        machine: One variant; its proportions are drawn.
        tint: Colour (3,) from 0 to 1 that it is mixed with.
    """

    def __init__(self, scene: Any, name: str, machine: Machine, tint: tuple[float, float, float] | None = None):
        self.kinematics = Kinematics(machine)
        self._scene, self._name, self._machine, self._tint = scene, f"{WORLD}/{name}", machine, tint
        self._base = scene.add_frame(self._name, show_axes=False)
        self._parts = {part: self._part(part, solid) for part, solid in machine_solids(machine).items()}
        self._log: tuple[float, float] | None = None
        self._radius = float(machine.tire.radius)
        self._arrows = scene.add_arrows(
            f"{WORLD}/{name}_forces", np.zeros((0, 2, 3)), (30, 110, 220),
            shaft_radius=0.04, head_radius=0.1, head_length=0.18,
        )  # fmt: skip

    def _part(self, part: str, solid: Solid) -> Any:
        return self._scene.add_mesh_trimesh(f"{self._name}/{part}", _mesh(solid, self._tint))

    def _have_crane(self, crane: CranePose) -> None:
        """Make the parts of a crane whose joints move, in place of the folded one, and of the log that it holds."""
        if CRANE_NODES[0] not in self._parts:
            self._parts["front_frame"].remove()
            solids = {"front_frame": front_frame(self._machine, folded=False), **crane_solids(crane.vehicle)}
            self._parts |= {part: self._part(part, solid) for part, solid in solids.items()}
        if crane.log != self._log:
            if self._log is not None:
                self._parts.pop(HELD_LOG).remove()
            if crane.log is not None:
                self._parts[HELD_LOG] = self._part(HELD_LOG, log_solid(*crane.log))
            self._log = crane.log

    def show(self, pose: Pose) -> None:
        """Move it, all its parts, to ``pose``."""
        placed = self.kinematics.placed(pose.joint, pose.arms, pose.wheels)
        if pose.crane is not None:
            self._have_crane(pose.crane)
            placed |= crane_placed(pose.crane)
        self._base.position, self._base.wxyz = pose.position, pose.wxyz
        for name, handle in self._parts.items():
            handle.position, handle.wxyz = placed[name]

    def show_forces(self, feet: ArrayLike, forces: ArrayLike) -> None:
        """Draw forces (4, 3) [N] of the ground on the tires at contact points (4, 3) [m], in the world."""
        self._arrows.points = arrows(np.asarray(feet, dtype=np.float64), np.asarray(forces, dtype=np.float64))

    def set_forces_visible(self, visible: bool) -> None:
        """Show or hide the arrows."""
        self._arrows.visible = visible


def arrows(feet: Floats, forces: Floats) -> NDArray[np.float32]:
    """Starts and ends (K, 2, 3) [m] of an arrow for each of the forces (4, 3) [N] that is worth one: it starts at the
    contact, of ``feet`` (4, 3) [m], and is as long as ``FORCE_SCALE`` says."""
    worth = np.linalg.norm(forces, axis=1) >= LEAST_FORCE
    points = np.stack([feet, feet + FORCE_SCALE * forces], axis=1)[worth]
    return points.astype(np.float32)


def _mesh(solid: Solid, tint: tuple[float, float, float] | None) -> Any:
    """A mesh with a colour a face."""
    import trimesh

    points, faces, colours = solid.triangles()
    if tint is not None:
        colours = (1.0 - TINT_SHARE) * colours + TINT_SHARE * np.asarray(tint)
    mesh = trimesh.Trimesh(points, faces, process=False)
    return _coloured(mesh, np.column_stack([colours, np.ones(len(colours))]))


def _coloured(mesh: Any, shades: Floats) -> Any:
    """``mesh`` with the colours (V, 4), from 0 to 1, of its points."""
    from trimesh.visual.color import ColorVisuals

    mesh.visual = ColorVisuals(mesh, vertex_colors=np.round(255.0 * shades).astype(np.uint8))
    return mesh


class Ground:
    """What the machines stand on, and its height.

    Args:
        scene: Of a server of viser.
        terrain: Drawn with its colours, or by height; a world with its objects, in the colours of their materials.
        colours: (V, 3) from 0 to 1 of a scan's points.
    """

    def __init__(self, scene: Any, terrain: Plane | Terrain | World, colours: NDArray[np.floating] | None = None):
        import trimesh

        if isinstance(terrain, World):
            triangles = terrain.scene()
            vertices, faces, shades = triangles.vertices, triangles.faces, world_colours(triangles)
        elif isinstance(terrain, Plane):
            vertices, faces = _plane(terrain)
            shades = _chequered(len(vertices))
        else:
            vertices, faces = terrain.vertices, terrain.faces
            shades = ground_colours(terrain) if colours is None else np.asarray(colours, dtype=np.float64)
        mesh = trimesh.Trimesh(vertices, faces, process=False)
        shades = np.column_stack([shades, np.ones(len(shades))])
        self.node = scene.add_mesh_trimesh(f"{WORLD}/ground", _coloured(mesh, shades), cast_shadow=False)


def _plane(plane: Plane) -> tuple[Floats, NDArray[np.int64]]:
    """Points (V, 3) and triangles (F, 3) of squares that do not share points."""
    n = np.broadcast_to(plane.normal, (1, 3))[0] if plane.normal.ndim == 1 else plane.normal[0]
    count = round(PLANE_SIZE / PLANE_CELL)
    low = PLANE_CELL * (np.arange(count) - 0.5 * count)
    corner = np.stack(np.meshgrid(low, low, indexing="ij"), axis=-1).reshape(-1, 1, 2)
    xy = (corner + PLANE_CELL * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])).reshape(-1, 2)
    z = -(xy @ n[:2]) / n[2]
    first = 4 * np.arange(len(corner))[:, None]
    faces = np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])])
    return np.column_stack([xy, z]), faces


def _chequered(points: int) -> Floats:
    """Colours (V, 3) of the plane's squares."""
    count = round(PLANE_SIZE / PLANE_CELL)
    square = np.arange(points // 4)
    dark = (square // count + square % count) % 2
    return np.repeat(np.where(dark[:, None] == 1, [[0.60, 0.63, 0.60]], [[0.66, 0.69, 0.66]]), 4, axis=0)


def draw_path(scene: Any, path: Path, heights: Sequence[float] | Floats) -> Any:
    """The path as a line over the ground, whose ``heights`` (P,) [m] at its points are given."""
    points = np.column_stack([path.points, np.asarray(heights) + PATH_ABOVE])
    if path.closed:
        points = np.concatenate([points, points[:1]])
    segments = np.stack([points[:-1], points[1:]], axis=1)
    return scene.add_line_segments(f"{WORLD}/path", segments, (31, 119, 180), thickness=4.0, thickness_units="screen")


def tints(count: int) -> list[tuple[float, float, float] | None]:
    """Tints of ``count`` machines, again and again those there are."""
    return [TINTS[i % len(TINTS)] for i in range(count)]


def nearest_heights(terrain: Plane | Terrain | World, xy: Floats) -> Floats:
    """Height [m] (P,) of the ground at points (P, 2): of the plane, or of the terrain's nearest vertex."""
    if isinstance(terrain, World):
        terrain = terrain.terrain
    if isinstance(terrain, Plane):
        n = terrain.normal if terrain.normal.ndim == 1 else terrain.normal[0]
        return -(xy @ n[:2]) / n[2]
    from scipy.spatial import KDTree

    return terrain.vertices[np.asarray(KDTree(terrain.vertices[:, :2]).query(xy)[1]), 2]
