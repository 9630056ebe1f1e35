"""The machine as a tree of rigid bodies on hinges, which every format of another simulator can hold.

Ten bodies: the front frame floats; on it hang the rear frame, on the articulated joint, and two arms with their wheels;
two more hang on the rear frame. Axes x forward, y left, z up, the same for all bodies while all angles are zero. The base's
origin lies on the joint's axis in the design ground plane, as that of the twin's position does. A positive joint angle turns
the front frame left against the rear one, a positive arm angle raises the wheel, a positive wheel angle rolls forward.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aoro_gym.machine.parameters import Machine
from aoro_gym.machine.sections import HalfFrame, Payload
from aoro_gym.recording.commands import WHEELS

Vector = NDArray[np.float64]
"""Three numbers, or three by three."""

BASE, REAR, JOINT = "front_frame", "rear_frame", "articulated_joint"
"""Names of both frames and of the hinge between them."""


@dataclass(frozen=True, eq=False)
class Box:
    """Hull of a frame, edges along the body's axes."""

    centre: Vector  # [m]
    size: Vector  # [m] edges


@dataclass(frozen=True, eq=False)
class Strut:
    """Beam of an arm, which touches nothing: a picture's."""

    end: Vector  # [m] from the body's origin
    radius: float  # [m]


@dataclass(frozen=True)
class Tire:
    """Wheel about the body's y axis: as high as the middle disc, as wide as the outer ones stand apart."""

    radius: float  # [m]
    width: float  # [m]


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body and the hinge that it turns on; lengths in m from the body's origin, a point of that hinge."""

    name: str
    parent: str | None  # None: floats
    hinge: str
    place: Vector  # of the origin, in the parent's axes
    axis: Vector
    limit: float  # [rad] to either side; infinite: turns freely
    mass: float  # [kg]
    centre: Vector  # of mass
    inertia: Vector  # (3, 3) [kg m²] about the centre of mass
    shape: Box | Strut | Tire


def machine_bodies(machine: Machine) -> tuple[Body, ...]:
    """The ten bodies of ``machine``, each after its parent and before what stands beside it (depth first)."""
    check_one(machine)
    front, rear = machine.frame.front, machine.frame.rear
    return (
        _frame(machine, BASE, front),
        _frame(machine, REAR, rear),
        *_corner(machine, "rl", rear),
        *_corner(machine, "rr", rear),
        *_corner(machine, "fl", front),
        *_corner(machine, "fr", front),
    )


def check_one(machine: Machine) -> None:
    """ValueError that names the fix if ``machine`` has several variants."""
    if machine.num_variants != 1:
        raise ValueError(f"the machine has {machine.num_variants} variants, but a model is one; give variant(i)")


def rest_angles(machine: Machine) -> dict[str, float]:
    """Angle [rad] of every hinge at rest on level ground."""
    rest = machine.rest
    front, rear = float(rest.arm_angle_front), float(rest.arm_angle_rear)
    arms = {f"arm_{name}": front if name[0] == "f" else rear for name in WHEELS}
    return {JOINT: 0.0} | arms | {f"wheel_{name}": 0.0 for name in WHEELS}


def _frame(machine: Machine, name: str, section: HalfFrame) -> Body:
    clearance, base = float(machine.frame.ground_clearance), name == BASE
    mass, centre, inertia = float(section.mass), _cog(section), _principal(section)
    if not base and machine.loaded:
        mass, centre, inertia = _joined((mass, centre, inertia), machine.payload)
    size = np.array([section.hull_length, section.hull_width, section.hull_height], dtype=np.float64)
    return Body(
        name=name,
        parent=None if base else BASE,
        hinge="base" if base else JOINT,
        place=np.zeros(3),
        axis=np.array([0.0, 0.0, -1.0]),
        limit=math.inf if base else float(machine.joint.range),
        mass=mass,
        centre=centre,
        inertia=inertia,
        shape=Box(np.array([float(section.cog_x), 0.0, clearance + 0.5 * size[2]]), size),
    )


def _cog(part: HalfFrame | Payload) -> Vector:
    """CoG [m] of a frame or of the load, in the frame's axes."""
    return np.array([part.cog_x, 0.0, part.cog_height], dtype=np.float64)


def _principal(part: HalfFrame | Payload) -> Vector:
    """Inertia (3, 3) [kg m²] about the CoG."""
    return np.diag([float(part.inertia_xx), float(part.inertia_yy), float(part.inertia_zz)])


def _joined(frame: tuple[float, Vector, Vector], load: Payload) -> tuple[float, Vector, Vector]:
    """Mass, CoG and inertia of a frame with the load in the middle of its bunk (parallel axes)."""
    mass, centre, inertia = frame
    carried = float(load.mass)
    apart, reduced = _cog(load) - centre, mass * carried / (mass + carried)
    inertia = inertia + _principal(load) + reduced * (apart @ apart * np.eye(3) - np.outer(apart, apart))
    return mass + carried, centre + carried / (mass + carried) * apart, inertia


def _corner(machine: Machine, name: str, section: HalfFrame) -> tuple[Body, Body]:
    """Arm with the motor's housing, and wheel; the twin's :class:`~aoro_gym.machine.rest.Corner` joins them."""
    arm, wheel, tire = machine.arm, machine.wheel, machine.tire
    s, side = section.direction, 1.0 if name[1] == "l" else -1.0
    axle = np.array([s * float(arm.length), side * (0.5 * float(machine.frame.track) - float(arm.pivot_lateral)), 0.0])
    beam = np.array([s * float(arm.cog_fraction * arm.length), 0.5 * axle[1], 0.0])
    mass = float(arm.mass + arm.motor_mass)
    centre = (float(arm.mass) * beam + float(arm.motor_mass) * axle) / mass
    # two points on a line: reduced mass x (d.d E - d d')
    apart, reduced = axle - beam, float(arm.mass * arm.motor_mass) / mass
    inertia = np.diag([float(arm.inertia_axial), float(arm.inertia_transverse), float(arm.inertia_transverse)])
    inertia += reduced * (apart @ apart * np.eye(3) - np.outer(apart, apart))
    pivot_x = s * float(section.axle_distance - arm.length)
    pivot = np.array([pivot_x, side * float(arm.pivot_lateral), float(arm.pivot_height)])
    spin, transverse = float(wheel.inertia_spin), float(wheel.inertia_transverse)
    return (
        Body(
            name=f"arm_{name}",
            parent=BASE if s > 0.0 else REAR,
            hinge=f"arm_{name}",
            place=pivot,
            axis=np.array([0.0, -s, 0.0]),
            limit=float(arm.swing),
            mass=mass,
            centre=centre,
            inertia=inertia,
            shape=Strut(axle, 0.5 * float(arm.cylinder.bore)),
        ),
        Body(
            name=f"wheel_{name}",
            parent=f"arm_{name}",
            hinge=f"wheel_{name}",
            place=axle,
            axis=np.array([0.0, 1.0, 0.0]),
            limit=math.inf,
            mass=float(wheel.mass),
            centre=np.zeros(3),
            inertia=np.diag([transverse, spin, transverse]),
            shape=Tire(float(tire.radius), 2.0 * float(tire.disc_offset_outer)),
        ),
    )


def origins(bodies: Sequence[Body]) -> dict[str, Vector]:
    """Origin [m] of every body in the base's axes while all angles are zero."""
    found: dict[str, Vector] = {}
    for body in bodies:
        found[body.name] = body.place if body.parent is None else found[body.parent] + body.place
    return found


def inverse_weights(bodies: Sequence[Body]) -> tuple[dict[str, float], dict[str, float]]:
    """How easily the free machine moves while all angles are zero: by body, the mean of how a force at its centre of mass
    accelerates that along the three axes [1/kg]; by hinge, how a torque accelerates it [1/(kg m²)].

    The diagonals of J M⁻¹ Jᵀ and M⁻¹ (Featherstone, *Rigid Body Dynamics Algorithms*, 2008, ch. 6), with M the mass matrix.
    """
    hinges = [body.hinge for body in bodies if body.parent is not None]
    at = origins(bodies)
    moved: dict[str, list[tuple[int, Body]]] = {}  # hinges between the base and a body
    linear, mass = {}, np.zeros((6 + len(hinges), 6 + len(hinges)))
    for body in bodies:
        own = [] if body.parent is None else [*moved[body.parent], (6 + hinges.index(body.hinge), body)]
        moved[body.name] = own
        centre = at[body.name] + body.centre
        moving, turning = np.zeros((3, len(mass))), np.zeros((3, len(mass)))
        moving[:, :3], moving[:, 3:6], turning[:, 3:6] = np.eye(3), np.cross(np.eye(3), centre).T, np.eye(3)
        for column, ancestor in own:
            moving[:, column] = np.cross(ancestor.axis, centre - at[ancestor.name])
            turning[:, column] = ancestor.axis
        mass += body.mass * moving.T @ moving + turning.T @ body.inertia @ turning
        linear[body.name] = moving
    inverse = np.linalg.inv(mass)
    by_body = {name: float(np.trace(moving @ inverse @ moving.T)) / 3.0 for name, moving in linear.items()}
    return by_body, {name: float(inverse[6 + i, 6 + i]) for i, name in enumerate(hinges)}


def poses(bodies: Sequence[Body], angles: Mapping[str, float]) -> dict[str, tuple[Vector, Vector]]:
    """Rotation (3, 3) and origin [m] of every body in the base's axes, at ``angles`` [rad] of the hinges by name."""
    found: dict[str, tuple[Vector, Vector]] = {}
    for body in bodies:
        if body.parent is None:
            found[body.name] = np.eye(3), np.zeros(3)
            continue
        rotation, origin = found[body.parent]
        found[body.name] = rotation @ turned(body.axis, angles[body.hinge]), origin + rotation @ body.place
    return found


def turned(axis: Vector, angle: float) -> Vector:
    """Rotation (3, 3) about a unit ``axis`` by ``angle`` [rad] (Rodrigues)."""
    cross = np.cross(np.eye(3), axis)
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def composite(bodies: Sequence[Body], angles: Mapping[str, float]) -> tuple[float, Vector, Vector]:
    """Mass [kg], centre of mass [m] and inertia (3, 3) [kg m²] about it, in the base's axes, of all ``bodies`` held at
    ``angles`` [rad] of the hinges by name."""
    at = poses(bodies, angles)
    mass = sum(body.mass for body in bodies)
    centres = {body.name: at[body.name][1] + at[body.name][0] @ body.centre for body in bodies}
    centre = sum((body.mass * centres[body.name] for body in bodies), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for body in bodies:
        rotation, apart = at[body.name][0], centres[body.name] - centre
        inertia += rotation @ body.inertia @ rotation.T
        inertia += body.mass * (apart @ apart * np.eye(3) - np.outer(apart, apart))
    return mass, centre, inertia
