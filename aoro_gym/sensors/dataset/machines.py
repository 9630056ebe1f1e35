"""Other machines that stand in a world: placed as the twin comes to rest there, seen by rays as their own solids."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from aoro_gym.machine import Machine
from aoro_gym.machine.kinematics import Kinematics, Pose
from aoro_gym.machine.solids import COLOURS, machine_solids
from aoro_gym.sensors.camera import Appearance
from aoro_gym.sensors.raytrace import Bodies, Body, Scene
from aoro_gym.terrains.world.materials import material_table
from aoro_gym.terrains.world.places import HALF_LENGTH, HALF_WIDTH, circles, stands_free
from aoro_gym.terrains.world.world import World
from aoro_gym.twin import Twin
from aoro_gym.twin.poses import pose_of_state

Array = NDArray[np.float64]
APART = 2.0 * HALF_LENGTH + 1.5
"""Least distance [m] of two machines' hinges."""
BESIDE_PATH = HALF_LENGTH + HALF_WIDTH + 0.7
"""Least distance [m] of a standing machine's hinge from the way of one that drives."""
PLACES = 400
"""That are drawn for a machine before it is left out."""


@dataclass(frozen=True, eq=False)
class StandingMachine:
    """A machine at rest, as triangles in the world's axes."""

    position: Array
    """(3,) [m] of the hinge on the design ground plane."""
    heading: float
    """[rad] of the front frame."""
    vertices: Array
    """(V, 3) [m]."""
    faces: NDArray[np.int64]
    """(F, 3)."""
    colours: NDArray[np.int64]
    """(F,) of :data:`~aoro_gym.machine.solids.COLOURS`."""

    @classmethod
    def at(cls, machine: Machine, pose: Pose) -> StandingMachine:
        """``machine``, one variant, at a pose."""
        turned, parts = Rotation.from_quat(pose.wxyz, scalar_first=True), []
        placed = Kinematics(machine).placed(pose.joint, pose.arms, pose.wheels)
        for name, solid in machine_solids(machine).items():
            points, faces, shades = solid.triangles()
            origin, wxyz = placed[name]
            own = Rotation.from_quat(wxyz, scalar_first=True).apply(points) + origin
            parts.append((turned.apply(own) + pose.position, faces, _number_of(shades[faces[:, 0]])))
        starts = np.cumsum([0, *(len(points) for points, _, _ in parts)])
        return cls(
            np.asarray(pose.position),
            pose.heading,
            np.concatenate([points for points, _, _ in parts]),
            np.concatenate([faces + start for (_, faces, _), start in zip(parts, starts[:-1], strict=True)]),
            np.concatenate([numbers for _, _, numbers in parts]),
        )


def standing(
    world: World, count: int, rng: np.random.Generator, *, way: Array | None = None
) -> tuple[StandingMachine, ...]:
    """Machines at free random places of a world, at rest there as the twin is; fewer where there is no room.

    Args:
        world: Its ground, and what is solid.
        count: Of machines, at most.
        rng: That draws places, headings and joint angles.
        way: (P, 2) [m] points of a path that they keep clear of.
    """
    machine = Machine.load("aoro")
    limit = 0.8 * float(machine.joint.range)
    low, high = (bound[:2] for bound in world.terrain.extent)
    solid, found = circles(world), []
    drawn = rng.uniform([*(low + 4.0), -np.pi, -limit], [*(high - 4.0), np.pi, limit], (PLACES, 4))
    free = stands_free(solid, drawn[:, :2], drawn[:, 2], drawn[:, 3])
    for place in drawn[free]:
        others = [one[:2] for one in found]
        near_way = way is not None and np.linalg.norm(way - place[:2], axis=1).min() < BESIDE_PATH
        if near_way or any(np.linalg.norm(place[:2] - other) < APART for other in others):
            continue
        found.append(place)
        if len(found) == count:
            break
    if not found:
        return ()
    twin, places = Twin(len(found), machine=machine, terrain=world.terrain), np.array(found)
    twin.reset(position=places[:, :2], heading=places[:, 2], joint_angle=places[:, 3])
    states = twin.state.numpy()
    return tuple(StandingMachine.at(machine, pose_of_state(states[:, k])) for k in range(len(found)))


def scene_of(world: World, machines: Sequence[StandingMachine], *, device: str) -> Scene:
    """A fine scene of a world with machines, whose instances follow those of its objects."""
    if not machines:
        return Scene.of_world(world, fine=True, device=device)
    table = material_table()
    reflectance = np.column_stack([table.reflectance_905nm, table.reflectance_1550nm])
    paint = np.repeat(_linear().mean(axis=1)[:, None], 2, axis=1)
    bodies = [
        Body("mesh", instance, len(reflectance) + colour, vertices=machine.vertices, faces=faces)
        for instance, machine in enumerate(machines, start=len(world.objects) + 1)
        for colour, faces in _by_colour(machine).items()
    ]
    return Scene.of_world(
        world,
        fine=True,
        device=device,
        bodies=Bodies(bodies, device=device),
        reflectance=np.concatenate([reflectance, paint]),
    )


def with_machines(appearance: Appearance) -> Appearance:
    """A world's appearance and, behind its classes, the machines' colours, without texture."""
    albedo = np.concatenate([appearance.albedo, _linear()])
    texture = np.concatenate([appearance.texture, np.full(len(COLOURS), -1, dtype=np.int32)])
    return replace(appearance, albedo=albedo, texture=texture.astype(np.int32))


def _by_colour(machine: StandingMachine) -> dict[int, NDArray[np.int64]]:
    """Faces by their colour's number."""
    found: dict[int, Any] = defaultdict(list)
    for face, colour in zip(machine.faces, machine.colours, strict=True):
        found[int(colour)].append(face)
    return {colour: np.array(faces) for colour, faces in sorted(found.items())}


def _linear() -> Array:
    """(K, 3) linear albedo of the colours, which are those of a screen (IEC 61966-2-1); lidars take their mean. (E)"""
    shown = np.array(list(COLOURS.values()))
    return np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)


def _number_of(shades: Array) -> NDArray[np.int64]:
    """(F,) the colour's number of each face's shade (F, 3)."""
    known = np.array(list(COLOURS.values()))
    return np.argmin(np.abs(shades[:, None] - known[None]).sum(axis=2), axis=1)
