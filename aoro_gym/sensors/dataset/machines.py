"""Other machines that stand in a world: placed as the twin comes to rest there, seen by rays as their own solids."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from aoro_gym.machine import Machine
from aoro_gym.machine.crane_solids import HELD_LOG, crane_placed, in_world, parts_of
from aoro_gym.machine.kinematics import CranePose, Placement, Pose
from aoro_gym.machine.solids import COLOURS
from aoro_gym.machine.vehicle_crane import GRAPPLE_DROP, VehicleCrane
from aoro_gym.sensors.camera import Appearance
from aoro_gym.sensors.dataset.carrier import carrier
from aoro_gym.sensors.raytrace import Bodies, Body, Scene
from aoro_gym.terrains.world.materials import material_table
from aoro_gym.terrains.world.objects import Log, along
from aoro_gym.terrains.world.places import HALF_LENGTH, HALF_WIDTH, circles, stands_free
from aoro_gym.terrains.world.world import World
from aoro_gym.twin import Twin
from aoro_gym.twin.poses import pose_of_state

Array = NDArray[np.float64]
APART = 2.0 * HALF_LENGTH + 1.5
"""Least distance [m] of two machines' hinges."""
BESIDE_PATH = HALF_LENGTH + HALF_WIDTH + 0.7
"""Least distance [m] of a standing machine's hinge from the way of one that drives."""
SWEPT = 10
"""Every tenth place of a way is kept clear of cranes: half a second of a drive, less than a metre."""
CIRCLES = 6
"""That cover half of a machine in plan."""
UNFOLDED = (
    (-np.pi, math.radians(15.0), math.radians(-125.0), 0.0),
    (np.pi, math.radians(60.0), math.radians(-60.0), 1.2),
)
"""Lowest and highest joints of unfolded cranes [rad, rad, rad, m]."""
LOWEST, HIGHEST = 0.1, 2.5
"""Height [m] of a grapple over the design ground plane."""
UNFOLDINGS = 60
"""That are drawn for a crane before it stays folded."""
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
    pose: Pose
    """Joint, arms and crane, too."""

    @classmethod
    def at(cls, machine: Machine, pose: Pose) -> StandingMachine:
        """``machine``, one variant, at a pose."""
        turned, parts = Rotation.from_quat(pose.wxyz, scalar_first=True), []
        for name, (solid, (origin, wxyz)) in parts_of(machine, pose).items():
            if name == HELD_LOG:  # an object of the world
                continue
            points, faces, shades = solid.triangles()
            own = Rotation.from_quat(wxyz, scalar_first=True).apply(points) + origin
            parts.append((turned.apply(own) + pose.position, faces, _number_of(shades[faces[:, 0]])))
        starts = np.cumsum([0, *(len(points) for points, _, _ in parts)])
        return cls(
            np.asarray(pose.position),
            pose.heading,
            np.concatenate([points for points, _, _ in parts]),
            np.concatenate([faces + start for (_, faces, _), start in zip(parts, starts[:-1], strict=True)]),
            np.concatenate([numbers for _, _, numbers in parts]),
            pose,
        )

    def crane_in_world(self) -> dict[str, Placement]:
        """Where the parts of its crane are in the world's axes, and the log that it holds; empty where it is folded."""
        return {} if self.pose.crane is None else {
            name: in_world(self.pose, one) for name, one in crane_placed(self.pose.crane).items()
        }  # fmt: skip

    def held_log(self, ground: float) -> Log | None:
        """The log in its grapple as an object of a world whose ``ground`` is so high [m] there; None: it holds none."""
        crane = self.pose.crane
        if crane is None or crane.log is None:
            return None
        middle, wxyz = self.crane_in_world()[HELD_LOG]
        length, radius = crane.log[0], 0.5 * crane.log[1]
        axis = Rotation.from_quat(wxyz, scalar_first=True).apply([1.0, 0.0, 0.0])
        thick = np.asarray(middle) - 0.5 * length * axis
        above = float(np.clip(middle[2] + radius - ground, 0.0, 10.0))
        x, y, z = (float(one) for one in thick)
        return Log((x, y, z), along(axis), "pine", length, radius, radius, above, 0)


def with_held_logs(world: World, machines: Sequence[StandingMachine]) -> tuple[World, dict[int, int]]:
    """The ``world`` with the logs that ``machines`` hold behind its objects, and their instances by the number of the
    machine that holds each."""
    found, held = [], {}
    for number, machine in enumerate(machines):
        log = machine.held_log(float(machine.position[2]))
        if log is not None:
            found.append(log)
            held[number] = len(world.objects) + len(found)
    return (replace(world, objects=(*world.objects, *found)) if found else world), held


def standing(
    world: World, count: int, rng: np.random.Generator, *, way: Array | None = None, cranes: bool = False
) -> tuple[StandingMachine, ...]:
    """Machines at free random places of a world, at rest there as the twin is; fewer where there is no room.

    Args:
        world: Its ground, and what is solid.
        count: Of machines, at most.
        rng: That draws places, headings and joint angles.
        way: (P, 4) x, y [m] of the hinge, heading of the front frame and joint angle [rad] of a machine that drives, of
            which they keep clear.
        cranes: Whether their cranes are unfolded, where there is room, and every other one holds a log.
    """
    machine = Machine.load("aoro")
    limit = 0.8 * float(machine.joint.range)
    low, high = (bound[:2] for bound in world.terrain.extent)
    solid, found = circles(world), []
    drawn = rng.uniform([*(low + 4.0), -np.pi, -limit], [*(high - 4.0), np.pi, limit], (PLACES, 4))
    free = stands_free(solid, drawn[:, :2], drawn[:, 2], drawn[:, 3])
    for place in drawn[free]:
        others = [one[:2] for one in found]
        in_way = way is not None and not is_beside(place, way)
        if in_way or any(np.linalg.norm(place[:2] - other) < APART for other in others):
            continue
        found.append(place)
        if len(found) == count:
            break
    if not found:
        return ()
    twin, places = Twin(len(found), machine=machine, terrain=world.terrain), np.array(found)
    twin.reset(position=places[:, :2], heading=places[:, 2], joint_angle=places[:, 3])
    states = twin.state.numpy()
    poses = [pose_of_state(states[:, k]) for k in range(len(found))]
    if cranes:
        swept = [] if way is None else [footprint(place) for place in way[::SWEPT]]
        poses = [unfolded(pose, np.concatenate([solid, *swept]), rng) for pose in poses]
    return tuple(StandingMachine.at(machine, pose) for pose in poses)


def is_beside(place: Array, way: Array) -> bool:
    """Whether a machine at a place (4,), as of :func:`footprint`, is off a way and touches nothing that drives along it."""
    apart = np.linalg.norm(way[:, :2] - place[:2], axis=1).min() >= BESIDE_PATH
    return bool(apart and stands_free(footprint(place), way[:, :2], way[:, 2], way[:, 3]).all())


def footprint(place: Array) -> Array:
    """(K, 3) circles, x, y and radius [m], that cover a machine that stands there.

    Args:
        place: (4,) x, y [m] of the hinge, heading of the front frame and joint angle [rad].
    """
    along = np.linspace(0.0, HALF_LENGTH, CIRCLES)
    radius = float(np.hypot(HALF_WIDTH, 0.5 * (along[1] - along[0])))
    ways = [place[2], place[2] - place[3] + np.pi]
    middles = np.concatenate([place[:2] + along[:, None] * [np.cos(way), np.sin(way)] for way in ways])
    return np.column_stack([middles, np.full(len(middles), radius)])


def unfolded(pose: Pose, solid: Array, rng: np.random.Generator) -> Pose:
    """The ``pose`` of a machine with its crane unfolded at random, with or without a log, clear of its own frames and of
    what is ``solid`` (K, 3) x, y, radius [m]; as it is where there is no such way."""
    vehicle = VehicleCrane()
    for _ in range(UNFOLDINGS):
        joints = tuple(rng.uniform(*UNFOLDED).tolist())
        log = (float(rng.uniform(3.0, 4.5)), float(rng.uniform(0.18, 0.35))) if rng.random() < 0.5 else None
        crane = CranePose(vehicle, joints, float(rng.uniform(-0.5, 0.5) - joints[0]), log)
        placed = crane_placed(crane)
        tip = np.asarray(placed["crane_grapple"][0])
        low = tip[2] - GRAPPLE_DROP - 0.3
        beside = abs(tip[1]) > HALF_WIDTH + 0.6 or tip[0] > HALF_LENGTH + 2.5
        if not beside or not LOWEST < low < HIGHEST:
            continue
        reach = np.linspace([0.0, 0.0, 0.0], tip, 8)
        half = 0.0 if log is None else 0.5 * log[0]
        ends = tip + np.linspace(-half, half, 8)[:, None] * [
            np.cos(joints[0] + crane.yaw),
            np.sin(joints[0] + crane.yaw),
            0,
        ]
        there = Rotation.from_quat(pose.wxyz, scalar_first=True).apply(np.concatenate([reach, ends])) + pose.position
        gaps = np.linalg.norm(there[:, None, :2] - solid[None, :, :2], axis=-1) - solid[None, :, 2]
        if gaps.size == 0 or gaps.min() > 0.3:
            return replace(pose, crane=crane)
    return pose


def scene_of(world: World, machines: Sequence[StandingMachine], *, device: str, carriers: int = 0) -> Scene:
    """A fine scene of a world with machines, whose instances follow those of its objects.

    Args:
        world: What stands still.
        machines: That stand in it; rays of all worlds meet them.
        device: Where rays are cast.
        carriers: Machines that carry cameras, the k-th of them in the rays' world k + 1 alone, so that a picture's light is
            kept off by its own; rays of world 0 meet none.
    """
    if not machines and not carriers:
        return Scene.of_world(world, fine=True, device=device)
    table = material_table()
    reflectance = np.column_stack([table.reflectance_905nm, table.reflectance_1550nm])
    paint = np.repeat(_linear().mean(axis=1)[:, None], 2, axis=1)
    first = len(world.objects) + 1
    parts = [
        (instance, len(reflectance) + colour, machine.vertices, faces)
        for instance, machine in enumerate(machines, start=first)
        for colour, faces in _by_colour(machine).items()
    ]
    bodies: list[Body] = []
    for number in range(1 + carriers):
        bodies += [Body("mesh", *part[:2], vertices=part[2], faces=part[3], world=number) for part in parts]
        bodies += carrier().bodies(first + len(machines), len(reflectance), number) if number else []
    return Scene.of_world(
        world,
        fine=True,
        device=device,
        bodies=Bodies(bodies, num_worlds=1 + carriers, device=device),
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
