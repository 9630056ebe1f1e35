"""World and machine as one binary glTF file (GLB), whose nodes a stream of poses moves.

glTF has y up. Under the root a node ``aoro``, turned by -90 degrees about x, holds all else in the twin's own axes: x
forward, y left, z up, in metres. Each part of the machine is a node of its own directly below ``aoro``, so that its
translation and rotation are its pose in the world, as :func:`~aoro_gym.machine.kinematics.node_poses` and the server's
record ``poses`` have it.

Colours are those of corners, linear as glTF has them; there are no textures.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from aoro_gym.execution.files import write_bytes
from aoro_gym.machine import Machine
from aoro_gym.machine.crane_solids import in_world, parts_of
from aoro_gym.machine.kinematics import Placement, Pose
from aoro_gym.terrains.colours import ground_colours, world_colours
from aoro_gym.terrains.terrain import Terrain
from aoro_gym.terrains.world.objects import Kind
from aoro_gym.terrains.world.world import World

Array = NDArray[np.float64]
AXES, GROUND = "aoro", "ground"
"""Names of the node that holds all others, and of the ground's."""
Y_UP = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""From z up to y up."""
SUFFIX = ".glb"


def matrix_of(place: Placement | tuple[Array, Array]) -> Array:
    """(4, 4) of a translation and a quaternion w, x, y, z."""
    out = np.eye(4)
    out[:3, :3] = Rotation.from_quat(place[1], scalar_first=True).as_matrix()
    out[:3, 3] = place[0]
    return out


def scene(machine: Machine | None, pose: Pose | None, ground: Terrain | World | None = None) -> Any:
    """A ``trimesh.Scene`` of a machine at a pose and what it stands on.

    Args:
        machine: One variant; None: the ground alone.
        pose: Where the machine is; None with no machine.
        ground: Its triangles, of a world its objects too, a node a kind; None: nothing.

    Raises ``ValueError`` where there is neither machine nor ground, or a machine without a pose.
    """
    import trimesh

    if (machine is None) != (pose is None):
        raise ValueError("give machine and pose, or neither")
    if machine is None and ground is None:
        raise ValueError("a scene has a machine or a ground; give one of them")
    made = trimesh.Scene()
    made.graph.update(frame_from=made.graph.base_frame, frame_to=AXES, matrix=Y_UP)
    if ground is not None:
        for name, mesh in _ground_meshes(ground).items():
            made.add_geometry(mesh, node_name=name, geom_name=name, parent_node_name=AXES)
    if machine is not None and pose is not None:
        for name, (solid, placed) in parts_of(machine, pose).items():
            points, faces, shades = solid.triangles()
            mesh = _mesh(points, faces, _linear(shades))
            made.add_geometry(
                mesh, node_name=name, geom_name=name, parent_node_name=AXES, transform=matrix_of(in_world(pose, placed))
            )
    return made


def write_scene(file: Path, machine: Machine | None, pose: Pose | None, ground: Terrain | World | None = None) -> None:
    """Write :func:`scene` to ``file`` (``.glb``), whole or not at all."""
    if file.suffix != SUFFIX:
        raise ValueError(f"{file} ends in {file.suffix!r}; name a file that ends in {SUFFIX}")
    write_bytes(file, scene(machine, pose, ground).export(file_type="glb"))


def _ground_meshes(ground: Terrain | World) -> dict[str, Any]:
    """By node: the ground, and all objects of a kind."""
    if isinstance(ground, Terrain):
        return {GROUND: _mesh(ground.vertices, ground.faces, ground_colours(ground))}
    triangles = ground.scene()
    shades, kinds = world_colours(triangles), triangles.instance_kind[triangles.face_instance]
    found = {}
    for kind in Kind:
        used, faces = np.unique(triangles.faces[kinds == kind], return_inverse=True)
        if len(used):
            name = GROUND if kind is Kind.GROUND else f"{kind.name.lower()}s".replace("branchs", "branches")
            found[name] = _mesh(triangles.vertices[used], faces.reshape(-1, 3), shades[used])
    return found


def _mesh(points: Any, faces: Any, shades: Array) -> Any:
    import trimesh
    from trimesh.visual.color import ColorVisuals

    mesh = trimesh.Trimesh(points, faces, process=False)
    colours = np.column_stack([np.clip(shades, 0.0, 1.0), np.ones(len(shades))])
    mesh.visual = ColorVisuals(mesh, vertex_colors=np.round(255.0 * colours).astype(np.uint8))
    return mesh


def _linear(shown: Array) -> Array:
    """Of colours of a screen (IEC 61966-2-1)."""
    return np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
