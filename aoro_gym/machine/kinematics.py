"""Where the parts of a machine are: frames, arms, wheels and cylinders."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from aoro_gym.machine.parameters import Machine
from aoro_gym.machine.rigid_bodies import BASE, REAR, Body, machine_bodies
from aoro_gym.machine.vehicle_crane import VehicleCrane
from aoro_gym.recording.commands import WHEELS

Floats = NDArray[np.float64]
Point = tuple[float, float, float]

STEERING_PIN_HEIGHT = 0.78
"""[m] of the steering cylinders over the frames' design ground plane (E)."""
ARM_CYLINDER_ASIDE = 0.1
"""[m] by which an arm's cylinder stands inside of its arm (E)."""


NODES = (
    "front_frame", "rear_frame",
    *(f"{part}_{wheel}" for part in ("arm", "wheel") for wheel in ("fl", "fr", "rl", "rr")),
    *(
        f"{part}_{cylinder}"
        for cylinder in ("steering_left", "steering_right", "arm_fl", "arm_fr", "arm_rl", "arm_rr")
        for part in ("barrel", "rod")
    ),
)  # fmt: skip
"""Names of a machine's parts, in the order of a stream of poses."""


@dataclass(frozen=True, eq=False)
class CranePose:
    """How a crane stands on its front frame, and what it holds."""

    vehicle: VehicleCrane
    """One variant."""
    joints: tuple[float, ...]
    """Slew, lift and fold [rad] and telescope [m]."""
    yaw: float = 0.0
    """Angle of the grapple to the pillar [rad]."""
    log: tuple[float, float] | None = None
    """Length and diameter [m] of the log that it holds."""


@dataclass(frozen=True, eq=False)
class Pose:
    """Where one machine is."""

    position: Floats
    """Hinge (3,) [m] in the world."""
    wxyz: Floats
    """Unit quaternion (4,) that turns the front frame's axes into the world's."""
    joint: float = 0.0
    """[rad], positive left."""
    arms: tuple[float, ...] = (0.0,) * 4
    """[rad] in the order of ``WHEELS``, positive raises the wheel."""
    wheels: tuple[float, ...] = (0.0,) * 4
    """[rad] against the arms, positive rolls forward."""
    crane: CranePose | None = None
    """Of a crane whose joints move; None: it is folded, a part of the front frame."""

    @property
    def heading(self) -> float:
        """Of the front frame [rad], from x to the left."""
        w, x, y, z = self.wxyz
        return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


Placement = tuple[tuple[float, float, float], tuple[float, float, float, float]]
"""Origin [m] and unit quaternion w, x, y, z of a part in the front frame's axes."""


class Kinematics:
    """Closed-form kinematics of one machine: frames, arms and wheels, and its six cylinders.

    Names of parts: ``front_frame``, ``rear_frame``, ``arm_fl`` ... ``wheel_rr``, and of each cylinder a ``barrel_...`` and a
    ``rod_...``, whose x axis runs from the barrel's pin to the rod's. Every part is turned about the frames' z axis, then
    about its own y axis.
    """

    def __init__(self, machine: Machine):
        self.bodies = {body.name: body for body in machine_bodies(machine)}
        self._arms = {name: _ArmPlaces.of(self.bodies, name) for name in WHEELS}
        steering, arm = machine.steering.cylinder.linkage, machine.arm.cylinder.linkage
        self._steering = float(steering.a), float(steering.b), 0.5 * float(steering.g0)
        self._arm = float(arm.a), float(arm.b), float(arm.g0)

    def placed(self, joint: float, arms: Sequence[float], wheels: Sequence[float]) -> dict[str, Placement]:
        """Where all parts are at a joint angle, four arm angles and four wheel angles [rad]."""
        found = {BASE: ((0.0, 0.0, 0.0), turned(0.0, 0.0)), REAR: ((0.0, 0.0, 0.0), turned(-joint, 0.0))}
        for (name, place), angle, roll in zip(self._arms.items(), arms, wheels, strict=True):
            about = -joint if name[0] == "r" else 0.0
            pitch = -place.outward * angle
            hub = place.hub(angle)
            found[f"arm_{name}"] = _about_z(about, place.pivot), turned(about, pitch)
            found[f"wheel_{name}"] = _about_z(about, hub), turned(about, pitch + roll)
        for name, (barrel, rod) in self.cylinder_pins(joint, arms).items():
            about = -joint if name.startswith("arm_r") else 0.0
            x, y, z = _about_z(-about, [b - a for a, b in zip(barrel, rod, strict=True)])
            arm = name.startswith("arm")
            along = turned(about, -math.atan2(z, x)) if arm else turned(math.atan2(y, x), 0.0)
            found[f"barrel_{name}"], found[f"rod_{name}"] = (barrel, along), (rod, along)
        return found

    def cylinder_pins(self, joint: float, arms: Sequence[float]) -> dict[str, tuple[Point, Point]]:
        """Pins of the barrel and of the rod [m] of every cylinder, in the front frame's axes.

        The distances of pins are those of the machine's linkages. Where in a plane a linkage lies is not known: it is drawn
        abreast of the joint, or at the arm's pivot with the pin of the frame above.
        """
        found: dict[str, tuple[Point, Point]] = {}
        a, b, half = self._steering
        for name, side in (("left", 1.0), ("right", -1.0)):
            back = (-a * math.sin(half), side * a * math.cos(half), STEERING_PIN_HEIGHT)
            front = (b * math.sin(half), side * b * math.cos(half), STEERING_PIN_HEIGHT)
            found[f"steering_{name}"] = _about_z(-joint, back), front
        a, b, opening = self._arm
        for (name, place), angle in zip(self._arms.items(), arms, strict=True):
            about = -joint if name[0] == "r" else 0.0
            frame_pin, arm_pin = (
                _about_z(about, place.beside(radius, at)) for radius, at in ((a, opening), (b, angle))
            )
            found[f"arm_{name}"] = frame_pin, arm_pin
        return found


def node_poses(kinematics: Kinematics, pose: Pose) -> dict[str, tuple[Floats, Floats]]:
    """Translation (3,) [m] and unit quaternion w, x, y, z (4,) of every node of :data:`NODES` in the world's axes.

    Args:
        kinematics: Of the machine.
        pose: Where it is.
    """
    placed = kinematics.placed(pose.joint, pose.arms, pose.wheels)
    turned = Rotation.from_quat(pose.wxyz, scalar_first=True)
    origins = turned.apply([placed[name][0] for name in NODES]) + pose.position
    rotations = turned * Rotation.from_quat([placed[name][1] for name in NODES], scalar_first=True)
    quaternions = rotations.as_quat(scalar_first=True)
    return {name: (origins[k], quaternions[k]) for k, name in enumerate(NODES)}


@dataclass(frozen=True)
class _ArmPlaces:
    """Of one arm, in its frame's axes."""

    pivot: Point
    length: float
    wheel_y: float
    side: float  # +1 left
    outward: float  # +1 front

    @classmethod
    def of(cls, bodies: Mapping[str, Body], name: str) -> _ArmPlaces:
        pivot, axle = bodies[f"arm_{name}"].place, bodies[f"wheel_{name}"].place
        x, y, z = map(float, pivot)
        outward, side = 1.0 if name[0] == "f" else -1.0, 1.0 if name[1] == "l" else -1.0
        return cls((x, y, z), abs(float(axle[0])), y + float(axle[1]), side, outward)

    def hub(self, angle: float) -> Point:
        """The wheel's centre [m]."""
        x, _, z = self.pivot
        return x + self.outward * self.length * math.cos(angle), self.wheel_y, z + self.length * math.sin(angle)

    def beside(self, radius: float, angle: float) -> Point:
        """A pin of the cylinder [m], at a radius from the pivot."""
        x, y, z = self.pivot
        aside = y - self.side * ARM_CYLINDER_ASIDE
        return x + self.outward * radius * math.cos(angle), aside, z + radius * math.sin(angle)


def _about_z(angle: float, point: Sequence[float]) -> Point:
    s, c = math.sin(angle), math.cos(angle)
    x, y, z = point
    return c * x - s * y, s * x + c * y, z


def turned(about_z: float, about_y: float) -> tuple[float, float, float, float]:
    """Quaternion w, x, y, z of R_z R_y."""
    sz, cz = math.sin(0.5 * about_z), math.cos(0.5 * about_z)
    sy, cy = math.sin(0.5 * about_y), math.cos(0.5 * about_y)
    return cz * cy, -sz * sy, cz * sy, sz * cy
