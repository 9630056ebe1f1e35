"""Moving things that rays meet: the own machine's bodies, other machines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, cast

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from aoro_gym.checks import check_choice, check_finite, check_integer, check_range
from aoro_gym.execution.devices import find
from aoro_gym.sensors.raytrace import device as device_code
from aoro_gym.sensors.raytrace.triangles import checked_triangles

KINDS: dict[str, int] = {"box": 0, "cylinder": 1, "capsule": 2, "mesh": 3}
MOST_BODIES = 1_000_000
"""Of all worlds: they are packed one by one, about 10 µs each. (E)"""
IDENTITY = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class Body:
    """One moving thing in its own axes.

    Raises ``ValueError`` naming the value and its bound.
    """

    kind: Literal["box", "cylinder", "capsule", "mesh"]
    instance: int
    """Its number, at least 1."""
    class_id: int
    """Its class, 0 to 254."""
    size: tuple[float, ...] = ()
    """[m] Box: half edges along x, y, z. Cylinder: radius and half its length, along z. Capsule: radius, and half the
    distance of the centres of its ends, along z."""
    vertices: ArrayLike | None = None
    """(V, 3) [m] of a mesh."""
    faces: ArrayLike | None = None
    """(F, 3) of a mesh."""
    world: int = 0
    """The one that it moves in."""

    def __post_init__(self) -> None:
        check_choice("body kind", self.kind, KINDS)
        check_integer("body instance", self.instance, note="; 0 is the ground")
        check_integer("body class_id", self.class_id, ge=0, le=254)
        check_integer("body world", self.world, ge=0)
        if self.kind == "mesh":
            if self.vertices is None or self.faces is None:
                raise ValueError("a body of kind mesh has no vertices and faces; give both")
            checked_triangles("body", self.vertices, self.faces)
            return
        count = 3 if self.kind == "box" else 2
        if len(self.size) != count:
            raise ValueError(f"size of a {self.kind} has {len(self.size)} numbers, but must have {count}")
        check_range(f"size of a {self.kind}", self.size, "m", gt=0.0, lt=1e4)


class Bodies:
    """Moving things of all worlds on a device; :meth:`move` them as often as needed.

    Args:
        bodies: At least one; those of a world in any order. Those of the same arrays share a mesh.
        num_worlds: How many worlds rays are cast in.
        device: Where they live.
    """

    def __init__(self, bodies: Sequence[Body], *, num_worlds: int = 1, device: str = "cpu"):
        check_integer("num_worlds", num_worlds)
        if not bodies:
            raise ValueError("bodies is empty; give at least one, or no bodies at all")
        note = "; bake what stands still into the scene's triangles"
        check_range("number of bodies", len(bodies), le=MOST_BODIES, note=note)
        worlds = np.array([body.world for body in bodies], dtype=np.int32)
        check_range("body world", worlds, ge=0, le=num_worlds - 1)
        find(device)
        self.num_worlds = num_worlds
        self.device = device
        self.class_ids = np.array([body.class_id for body in bodies])
        self._meshes: dict[tuple[int, int], tuple[wp.Mesh, Any, Any]] = {}
        struct: Any = device_code.Shape
        self.shapes = wp.array([self._shape(body) for body in bodies], dtype=struct, device=device)
        transform, vec3 = cast(Any, (wp.transform, wp.vec3))
        self.poses = wp.array(np.tile(IDENTITY, (len(bodies), 1)), dtype=transform, device=device)
        self._lowers = wp.empty(len(bodies), dtype=vec3, device=device)
        self._uppers = wp.empty(len(bodies), dtype=vec3, device=device)
        self._bound()
        groups = wp.array(worlds, dtype=wp.int32, device=device)
        self._tree = wp.Bvh(self._lowers, self._uppers, groups=groups)
        self.roots = wp.full(num_worlds, -1, dtype=wp.int32, device=device)
        filled = np.isin(np.arange(num_worlds), worlds)  # Warp gives an empty group the root of another one
        filled_on_device = wp.array(filled, dtype=wp.bool, device=device)
        wp.launch(
            device_code.find_roots,
            dim=num_worlds,
            inputs=[self._tree.id, filled_on_device],
            outputs=[self.roots],
            device=device,
        )

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def tree(self) -> int:
        """Identifier of the hierarchy for device code."""
        return int(self._tree.id)

    def move(self, poses: ArrayLike | wp.array) -> None:
        """Put all bodies to poses (B, 7): x, y, z [m], then the quaternion x, y, z, w to the world's axes.

        An array of ``wp.transform`` on the device is taken as it is.
        """
        if not isinstance(poses, wp.array):
            numbers = np.asarray(poses, dtype=np.float32)
            if numbers.shape != (len(self), 7):
                raise ValueError(f"poses has the shape {numbers.shape}, but must be ({len(self)}, 7)")
            check_finite("poses", numbers)
            length = np.linalg.norm(numbers[:, 3:], axis=1)
            check_range("length of the quaternion in poses", length, ge=0.99, le=1.01)
            numbers = np.concatenate([numbers[:, :3], numbers[:, 3:] / length[:, None]], axis=1)
            self.poses.assign(numbers)
        else:
            wp.copy(self.poses, poses)
        self._bound()
        self._tree.refit()

    def _bound(self) -> None:
        wp.launch(
            device_code.bound,
            dim=len(self),
            inputs=[self.shapes, self.poses],
            outputs=[self._lowers, self._uppers],
            device=self.device,
        )

    def _mesh_of(self, body: Body) -> tuple[wp.Mesh, Any, Any]:
        """Mesh and its bounds [m]."""
        key = id(body.vertices), id(body.faces)
        if key not in self._meshes:
            vertices, faces = checked_triangles("body", body.vertices, body.faces)
            mesh = wp.Mesh(
                wp.array(vertices, dtype=wp.vec3, device=self.device),
                wp.array(faces.ravel(), dtype=wp.int32, device=self.device),
            )
            self._meshes[key] = mesh, vertices.min(axis=0), vertices.max(axis=0)
        return self._meshes[key]

    def _shape(self, body: Body) -> Any:
        shape: Any = device_code.Shape()
        shape.kind = KINDS[body.kind]
        shape.instance, shape.kind_of_thing = body.instance, body.class_id
        if body.kind == "mesh":
            mesh, lower, upper = self._mesh_of(body)
            shape.mesh = mesh.id
        else:
            size, half = _extent(body)
            shape.size = wp.vec3(*map(float, size))
            lower, upper = -half, half
        shape.lower, shape.upper = wp.vec3(*map(float, lower)), wp.vec3(*map(float, upper))
        return shape


def _extent(body: Body) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Size as the device has it, and half the edges of the box around the body [m], both (3,)."""
    if body.kind == "box":
        return np.array(body.size), np.array(body.size)
    radius, half = body.size
    size = np.array([radius, radius, half])
    return size, size + (np.array([0.0, 0.0, radius]) if body.kind == "capsule" else 0.0)
