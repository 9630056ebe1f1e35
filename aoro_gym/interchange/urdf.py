"""The machine as a URDF: links with masses, hulls and wheels, hinges with limits and friction, frames of the sensors.

Source: the XML specification of the Unified Robot Description Format (wiki.ros.org/urdf/XML).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from aoro_gym.interchange.limitations import Limitation
from aoro_gym.interchange.sensor_places import sensor_places
from aoro_gym.interchange.servos import Servo, WheelMotor, servos, wheel_motors
from aoro_gym.interchange.xml_text import Element, add, comment, numbers, text_of
from aoro_gym.machine import Machine
from aoro_gym.machine.rigid_bodies import (
    BASE,
    Body,
    Box,
    Strut,
    Tire,
    Vector,
    check_one,
    machine_bodies,
)

WORLD = "world"
"""The empty link that the base floats against, for readers that would nail a root to the ground."""
ROOTS = (WORLD, "frame")
"""What the root of the tree is: an empty link on which the base floats, or the base itself, for readers that free it."""
COLOURS = {"frame": "0.95 0.7 0.1 1", "arm": "0.3 0.3 0.3 1", "tire": "0.1 0.1 0.1 1"}


def urdf(machine: Machine, limitations: Sequence[Limitation] = (), root_link: str = WORLD) -> str:
    """URDF text of ``machine``, one variant; it says in comments what of the twin it cannot say. Links and hinges are
    named as in :func:`~aoro_gym.interchange.mjcf.mjcf`; ``root_link`` is one of :data:`ROOTS`.

    The ``effort`` of joint and arms is the smaller of both directions' torques at which a relief valve opens, a wheel's that
    of first gear; ``velocity`` is the larger rate.
    """
    check_one(machine)
    check_root(root_link)
    root = Element("robot", name=machine.name)
    for line in limitations:
        comment(root, f"not said: {line.sentence}")
    # bodies of sensors stay, and nothing is drawn that also collides twice
    add(add(root, "mujoco"), "compiler", fusestatic="false", discardvisual="false", strippath="false")
    for name, rgba in COLOURS.items():
        add(add(root, "material", name=name), "color", rgba=rgba)
    held = {servo.hinge: servo for servo in servos(machine)}
    motors = {motor.hinge: motor for motor in wheel_motors(machine)}
    if root_link == WORLD:
        add(root, "link", name=WORLD)
    for body in machine_bodies(machine):
        _link(root, body)
        if body.parent is None and root_link != WORLD:
            continue
        place = np.array([0.0, 0.0, float(machine.rest.height)]) if body.parent is None else body.place
        kind = "floating" if body.parent is None else "continuous" if math.isinf(body.limit) else "revolute"
        hinge = _joint(root, body.hinge, kind, body.parent or WORLD, body.name, place)
        if body.parent is not None:
            add(hinge, "axis", xyz=numbers(body.axis))
            _limits(hinge, body, held.get(body.hinge) or motors[body.hinge])
    for name, place in sensor_places().items():
        add(root, "link", name=name)
        _joint(root, f"{name}_mount", "fixed", BASE, name, place)
    return text_of(root)


def check_root(root_link: str) -> None:
    """ValueError that names the choices if ``root_link`` is none."""
    if root_link not in ROOTS:
        raise ValueError(f"root is {root_link!r}; choose one of: {', '.join(ROOTS)}")


def _joint(root: Element, name: str, kind: str, parent: str, child: str, place: Vector) -> Element:
    joint = add(root, "joint", name=name, type_=kind)
    add(joint, "origin", xyz=numbers(place), rpy="0 0 0")
    add(joint, "parent", link=parent)
    add(joint, "child", link=child)
    return joint


def _limits(hinge: Element, body: Body, drive: Servo | WheelMotor) -> None:
    if isinstance(drive, Servo):
        ends = {"lower": numbers(-body.limit), "upper": numbers(body.limit)}
        effort, velocity = min(np.abs(drive.held_torque)), max(np.abs(drive.rate))
        damping, friction = drive.damping, drive.friction
    else:
        ends, damping, friction = {}, 0.0, drive.brake
        effort, velocity = max(drive.torque.values()), max(drive.speed.values())
    add(hinge, "limit", **ends, effort=numbers(effort), velocity=numbers(velocity))
    add(hinge, "dynamics", damping=numbers(damping), friction=numbers(friction))


def _link(root: Element, body: Body) -> None:
    link = add(root, "link", name=body.name)
    inertial = add(link, "inertial")
    add(inertial, "origin", xyz=numbers(body.centre), rpy="0 0 0")
    add(inertial, "mass", value=numbers(body.mass))
    moments = {
        f"i{'xyz'[i]}{'xyz'[j]}": numbers(body.inertia[i, j])
        for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    }
    add(inertial, "inertia", **moments)
    if isinstance(body.shape, Box):
        _shape(link, "visual", body.shape.centre, "0 0 0", "frame", "box", size=numbers(body.shape.size))
        _shape(link, "collision", body.shape.centre, "0 0 0", None, "box", size=numbers(body.shape.size))
    elif isinstance(body.shape, Tire):
        size = {"radius": numbers(body.shape.radius), "length": numbers(body.shape.width)}
        across = numbers(0.5 * math.pi, 0, 0)  # cylinders stand along z
        _shape(link, "visual", np.zeros(3), across, "tire", "cylinder", **size)
        _shape(link, "collision", np.zeros(3), across, None, "cylinder", **size)
    elif isinstance(body.shape, Strut):
        end = body.shape.end
        length = float(np.linalg.norm(end))
        along = numbers(-math.asin(end[1] / length), 0.5 * math.pi if end[0] > 0.0 else -0.5 * math.pi, 0)
        size = {"radius": numbers(body.shape.radius), "length": numbers(length)}
        _shape(link, "visual", 0.5 * end, along, "arm", "cylinder", **size)


def _shape(link: Element, use: str, place: Vector, turned: str, material: str | None, kind: str, **size: str) -> None:
    element = add(link, use)
    add(element, "origin", xyz=numbers(place), rpy=turned)
    add(add(element, "geometry"), kind, **size)
    if material is not None:
        add(element, "material", name=material)
