"""What rays can meet, on a device, and the casting of many rays at once."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from aoro_gym.checks import check_finite, check_integer, check_range
from aoro_gym.execution.devices import find
from aoro_gym.execution.together import Together
from aoro_gym.sensors.raytrace import device as device_code
from aoro_gym.sensors.raytrace.bodies import Bodies
from aoro_gym.sensors.raytrace.downward import look_down
from aoro_gym.sensors.raytrace.triangles import checked_triangles
from aoro_gym.sensors.raytrace.undergrowth import Leaves
from aoro_gym.terrains.terrain import Terrain
from aoro_gym.terrains.world.materials import Surface
from aoro_gym.terrains.world.world import Undergrowth, World

NO_CLASS = 255
"""Class of a ray that met nothing."""
BARE_GROUND = (0.25, 0.35)
"""Reflectance [-] of :meth:`Scene.of_terrain`'s ground at 905 nm and 1550 nm where none is given: dry soil, whose
reflectance rises with wavelength (Baumgardner et al. 1985, Reflectance properties of soils, Adv. Agronomy 38). E."""
DEEP = 1.0e4
"""[m] that a probe looks up: more than any terrain's relief."""
PROBES = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
"""Directions in which a place looks whether it lies in something: up first."""


@dataclass(frozen=True, eq=False)
class Hits:
    """What R rays met first."""

    distance: NDArray[np.float32]
    """(R,) [m]; infinite where nothing was met within range."""
    normal: NDArray[np.float32]
    """(R, 3) unit, of the side that was met; zeros where nothing was met."""
    instance: NDArray[np.int32]
    """(R,) 0: ground, -1: nothing."""
    class_id: NDArray[np.uint8]
    """(R,) :data:`NO_CLASS`: nothing."""
    face: NDArray[np.int32]
    """(R,) of the still mesh, or of a body's mesh; -1: a box, cylinder or capsule, or nothing."""
    front: NDArray[np.bool_]
    """(R,) whether the outer side was met, or nothing."""


class Scene:
    """Ground and still objects as one mesh, and moving bodies, on a device.

    Args:
        vertices: (V, 3) [m], near the origin of the world's axes: x east, y north, z up.
        faces: (F, 3), counter-clockwise seen from outside, or from above the ground.
        face_instance: (F,) instance of each face: 0 ground, objects from 1. All ground by default.
        face_class: (F,) class of each face, 0 to 254. All 0 by default.
        reflectance: (C, 2) diffuse reflectance [-] of each class at 905 nm and at 1550 nm, in [0, 1].
        undergrowth: What is too fine for triangles; lidars alone meet it, :meth:`cast` looks through it.
        undergrowth_class: Its class.
        bodies: Moving things.
        num_worlds: How many worlds rays are cast in; the bodies' if there are some.
        device: Where all lives: ``"cpu"``, ``"cuda:0"``.

    Raises ``ValueError`` naming the value, its bound and the fix.
    """

    def __init__(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        *,
        face_instance: ArrayLike | None = None,
        face_class: ArrayLike | None = None,
        reflectance: ArrayLike = (BARE_GROUND,),
        undergrowth: Undergrowth | None = None,
        undergrowth_class: int = 0,
        bodies: Bodies | None = None,
        num_worlds: int = 1,
        device: str = "cpu",
    ):
        points, corners = checked_triangles("scene", vertices, faces)
        instances = _of_faces("face_instance", face_instance, len(corners), most=2**31 - 1).astype(np.int32)
        classes = _of_faces("face_class", face_class, len(corners), most=NO_CLASS - 1).astype(np.uint8)
        materials = np.asarray(reflectance, dtype=np.float64)
        if materials.ndim != 2 or materials.shape[1] != 2 or not len(materials):
            raise ValueError(f"reflectance has the shape {materials.shape}, but must be (C, 2), a row a class")
        check_range("reflectance", materials, ge=0.0, le=1.0)
        check_integer("undergrowth_class", undergrowth_class, ge=0, le=NO_CLASS - 1)
        highest = max(int(classes.max()), int(bodies.class_ids.max()) if bodies is not None else 0, undergrowth_class)
        if highest >= len(materials):
            raise ValueError(f"class {highest} has no reflectance: there are {len(materials)} rows; give {highest + 1}")
        check_integer("num_worlds", num_worlds)
        if bodies is not None and num_worlds not in (1, bodies.num_worlds):
            raise ValueError(f"num_worlds is {num_worlds}, but the bodies are those of {bodies.num_worlds} worlds")
        find(device)
        self.device = device
        self.fine = False
        """Whether foliage has gaps within its triangles, see :meth:`of_world`."""
        self.bodies = bodies
        self.num_worlds = num_worlds if bodies is None else bodies.num_worlds
        self.num_classes = len(materials)
        self.extent = points.min(axis=0), points.max(axis=0)
        self._indices = wp.array(corners.ravel(), dtype=wp.int32, device=device)
        self.mesh = wp.Mesh(wp.array(points, dtype=wp.vec3, device=device), self._indices)
        self.data: Any = self._packed(instances, classes, materials)
        if undergrowth is not None and (undergrowth.height > 0.0).any():
            self.data.leaves = self._leaves(undergrowth, undergrowth_class)

    @classmethod
    def of_terrain(cls, terrain: Terrain, **options: Any) -> Scene:
        """A scene of bare ground, all instance 0 and class 0; ``options`` are those of the constructor."""
        return cls(terrain.vertices, terrain.faces, **options)

    @classmethod
    def of_world(cls, world: World, *, fine: bool = False, **options: Any) -> Scene:
        """A world with all that stands, lies and grows on it; classes are its surfaces, with their reflectances.

        ``fine`` crowns have branches, and twigs between whose needles and leaves cameras see: lidars take them as whole.
        """
        parts = world.scene(fine=fine)
        materials = parts.materials
        given: dict[str, Any] = {
            "reflectance": np.column_stack([materials.reflectance_905nm, materials.reflectance_1550nm]),
            "undergrowth": world.undergrowth,
            "undergrowth_class": int(Surface.DWARF_SHRUBS),
            **options,
        }
        scene = cls(
            parts.vertices, parts.faces, face_instance=parts.face_instance, face_class=parts.face_class, **given
        )
        scene.fine = fine
        return scene

    @cached_property
    def densest(self) -> float:
        """Most area [1/m] of leaves of the undergrowth in a volume; 0 without any."""
        return float(self.data.leaves.nodes.numpy()[..., 2].max()) if self.data.leaves.tallest > 0.0 else 0.0

    @cached_property
    def ground(self) -> wp.Mesh:
        """The ground's triangles alone; ``ValueError`` where there are none."""
        mask = self.data.face_instance.numpy() == 0
        if mask.all():
            return self.mesh
        if not mask.any():
            raise ValueError("the scene has no ground: no face is of instance 0; name its faces in face_instance")
        faces = self._indices.numpy().reshape(-1, 3)[mask]
        return wp.Mesh(self.mesh.points, wp.array(faces.ravel(), dtype=wp.int32, device=self.device))

    def _packed(self, instances: NDArray[Any], classes: NDArray[Any], materials: NDArray[Any]) -> Any:
        """The struct that device code takes."""
        data: Any = device_code.Rays()
        device, vec2 = self.device, cast(Any, wp.vec2)
        transform, struct = cast(Any, (wp.transform, device_code.Shape))
        data.mesh = self.mesh.id
        data.face_instance = wp.array(instances, dtype=wp.int32, device=device)
        data.face_class = wp.array(classes, dtype=wp.uint8, device=device)
        data.reflectance = wp.array(materials, dtype=vec2, device=device)
        if self.bodies is None:
            data.roots = wp.full(self.num_worlds, -1, dtype=wp.int32, device=device)
            data.shapes = wp.empty(0, dtype=struct, device=device)
            data.poses = wp.empty(0, dtype=transform, device=device)
        else:
            data.bodies = self.bodies.tree
            data.roots, data.shapes, data.poses = self.bodies.roots, self.bodies.shapes, self.bodies.poses
        return data

    def _leaves(self, undergrowth: Undergrowth, kind: int) -> Any:
        """Undergrowth on the ground below its nodes, as device code has it; none grows where there is no ground."""
        rows, columns = undergrowth.height.shape
        if min(rows, columns) < 2:
            raise ValueError(f"undergrowth has {rows} x {columns} nodes, but must have at least 2 x 2")
        x, y = (undergrowth.corner[k] + undergrowth.cell * np.arange(n) for k, n in ((0, columns), (1, rows)))
        points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        top = float(self.extent[1][2]) + 1.0
        vec2, vec4 = cast(Any, (wp.vec2, wp.vec4))
        frames = wp.array(np.zeros((1, 4)), dtype=vec4, device=self.device)
        found = wp.empty((1, len(points)), dtype=float, device=self.device)
        inputs = [self.ground.id, frames, wp.array(points, dtype=vec2, device=self.device), top]
        wp.launch(look_down, dim=found.shape, inputs=inputs, outputs=[found], device=self.device)
        ground = found.numpy().reshape(rows, columns)
        known = np.isfinite(ground)
        if not known.any():
            raise ValueError("no node of the undergrowth lies over the scene's ground; shift its corner")
        rises = np.concatenate([np.abs(np.diff(ground, axis=axis)).ravel() for axis in (0, 1)]) / undergrowth.cell
        leaves: Any = Leaves()
        leaves.corner, leaves.cell, leaves.kind = wp.vec2(*undergrowth.corner), undergrowth.cell, kind
        leaves.tallest = float(undergrowth.height.max())
        leaves.steepest = math.sqrt(2.0) * float(np.max(rises[np.isfinite(rises)], initial=0.0))
        nodes = np.where(known, [ground, undergrowth.height, undergrowth.density], 0.0)
        nodes[0][~known] = np.mean(ground[known])
        leaves.nodes = wp.array(np.moveaxis(nodes, 0, -1), dtype=cast(Any, wp.vec3), device=self.device)
        return leaves

    def cast(
        self, origins: ArrayLike, directions: ArrayLike, *, max_range: float = 1000.0, worlds: ArrayLike = 0
    ) -> Hits:
        """What rays meet first; a scene's own surfaces from either side.

        Args:
            origins: (R, 3) or (3,) [m].
            directions: (R, 3), of any length above zero.
            max_range: [m] beyond which nothing is met.
            worlds: (R,) or one: whose bodies are met.
        """
        to = np.asarray(directions, dtype=np.float64)
        if to.ndim != 2 or to.shape[1] != 3 or not len(to):
            raise ValueError(f"directions have the shape {to.shape}, but must be (R, 3) with at least one ray")
        try:
            start = np.broadcast_to(np.asarray(origins, dtype=np.float32), to.shape)
            world = np.broadcast_to(np.asarray(worlds), len(to)).astype(np.int32)
        except ValueError:
            shapes = f"{np.shape(origins)} and {np.shape(worlds)}"
            raise ValueError(
                f"origins and worlds have the shapes {shapes}, but must be one, or one a ray ({len(to)})"
            ) from None
        check_finite("origins", start, "m")
        length = np.linalg.norm(to, axis=1)
        check_range("length of directions", length, gt=0.0, lt=np.inf)
        check_range("max_range", max_range, "m", gt=0.0, lt=np.inf)
        check_range("worlds", world, ge=0, le=self.num_worlds - 1)
        count, device, vec3 = len(to), self.device, cast(Any, wp.vec3)
        kinds = cast(Any, (wp.float32, wp.vec3, wp.int32, wp.uint8, wp.int32, wp.bool))
        home = Together([(count,)] * len(kinds), kinds, device=device)
        wp.launch(
            device_code.cast_many,
            dim=count,
            inputs=[
                self.data,
                wp.array(start, dtype=vec3, device=device),
                wp.array(to / length[:, None], dtype=vec3, device=device),
                float(max_range),
                wp.array(world, dtype=wp.int32, device=device),
            ],
            outputs=home.arrays,
            device=device,
        )
        return Hits(*home.home())

    def check_outside(self, name: str, points: ArrayLike) -> None:
        """ValueError where a sensor called ``name`` at one of ``points`` (K, 3) [m] lies in the ground or a still object."""
        places = np.atleast_2d(np.asarray(points, dtype=np.float64))
        inside, what, higher = self.lie_inside(places)
        if not inside.any():
            return
        index = int(np.argmax(inside))
        x, y, z = places[index]
        raise ValueError(
            f"{name} at x = {x:.2f} m, y = {y:.2f} m, z = {z:.2f} m lies inside"
            f" {'the ground' if what[index] == 0 else f'object {what[index]}'}, whose surface is {higher[index]:.2f} m"
            " higher; put it outside"
        )

    def lie_inside(self, points: ArrayLike) -> tuple[NDArray[np.bool_], NDArray[np.int32], NDArray[np.float32]]:
        """Which of ``points`` (K, 3) [m] lie below ground or in a still object; the instance above each, and how far [m].

        A point is below ground if it sees its inner side straight above, and inside an object if it sees that one's to all
        four sides, too: leaves are single triangles, whose inner side may be below.
        """
        places = np.atleast_2d(np.asarray(points, dtype=np.float64))
        seen = self.cast(np.tile(places, (5, 1)), np.repeat(PROBES, len(places), axis=0), max_range=DEEP)
        instance, front = seen.instance.reshape(5, -1), seen.front.reshape(5, -1)
        around = (~front[1:] & (instance[1:] == instance[0])).all(axis=0)
        inside = ~front[0] & ((instance[0] == 0) | around)
        return inside, instance[0], seen.distance.reshape(5, -1)[0]


def _of_faces(name: str, values: ArrayLike | None, count: int, *, most: int) -> NDArray[Any]:
    """(F,) whole numbers, zeros for None."""
    if values is None:
        return np.zeros(count, dtype=np.int64)
    array = np.asarray(values)
    if array.shape != (count,) or not np.issubdtype(array.dtype, np.integer):
        raise ValueError(f"{name} has the shape {array.shape} and type {array.dtype}, but must be ({count},) integers")
    check_range(name, array, ge=0, le=most)
    return array
