"""A machine as a file of another simulator, and a JSON beside it with all that the file has no place for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.execution.files import write_json, write_text
from aoro_gym.interchange.limitations import FORMATS, Limitation, limitations
from aoro_gym.interchange.mjcf import mjcf, scrub_lever
from aoro_gym.interchange.sensor_places import sensor_places
from aoro_gym.interchange.servos import arm_displacement, gears, servos, steering_displacement, wheel_motors
from aoro_gym.interchange.urdf import WORLD, check_root, urdf
from aoro_gym.machine import Machine
from aoro_gym.machine.rigid_bodies import composite, inverse_weights, machine_bodies, rest_angles
from aoro_gym.recording.commands import WHEELS
from aoro_gym.version import VERSION

SUFFIXES = {"mjcf": ".xml", "urdf": ".urdf"}
"""Of the files, by format."""
POINTS = 9
"""Angles of a hinge at which the JSON has what its cylinders give."""


def check_target(format_: str, path: Path, root_link: str = WORLD) -> None:
    """ValueError that names the fix if ``format_`` or ``root_link`` is unknown or ``path`` has not the format's suffix."""
    check_root(root_link)
    if format_ not in FORMATS:
        raise ValueError(f"format is {format_!r}; choose one of: {', '.join(FORMATS)}")
    if path.suffix != SUFFIXES[format_]:
        raise ValueError(f"{path} ends in {path.suffix!r}; name a file that ends in {SUFFIXES[format_]} for {format_}")


def beside_of(path: Path) -> Path:
    """The JSON beside the file ``path``: its name, and ``.json``."""
    return path.with_name(f"{path.name}.json")


def export_machine(
    machine: Machine, format_: str, path: Path, made_by: Mapping[str, Any] | None = None, *, root_link: str = WORLD
) -> tuple[list[Path], tuple[Limitation, ...]]:
    """Write ``machine``, one variant, to ``path`` and what the format lacks to a JSON beside it.

    Args:
        machine: What is written.
        format_: ``mjcf`` or ``urdf``.
        path: Ends in ``.xml`` for MJCF, in ``.urdf`` for URDF.
        made_by: What the machine follows from, for the JSON; its name by default.
        root_link: Of a URDF, see :func:`~aoro_gym.interchange.urdf.urdf`.

    Returns:
        The two files, and what the first one cannot say.

    Raises:
        ValueError: the format, the suffix or the number of variants is wrong; the message names the fix.
    """
    check_target(format_, path, root_link)
    unsaid = limitations(machine, format_)
    text = mjcf(machine, unsaid) if format_ == "mjcf" else urdf(machine, unsaid, root_link)
    beside = beside_of(path)
    content = {
        "format": format_,
        "file": path.name,
        "made_by": {"version": VERSION, **(made_by or {"machine": machine.name})},
    }
    write_text(path, text)
    write_json(beside, content | description(machine) | {"not_said": [asdict(one) for one in unsaid]})
    return [path, beside], unsaid


def description(machine: Machine) -> dict[str, Any]:
    """Figures of ``machine`` for another simulator, SI units: bodies, rest, servos, motors, contact, places of sensors."""
    bodies, angles = machine_bodies(machine), rest_angles(machine)
    mass, centre, inertia = composite(bodies, angles)
    rest = machine.rest
    return {
        "units": "SI: kg, m, s, rad, N, Pa; x forward, y left, z up; positive: joint left, wheel raised, rolling forward",
        "total_at_rest": {"mass": mass, "centre_of_mass": centre.tolist(), "inertia_about_it": inertia.tolist()},
        "bodies": {body.name: {"mass": body.mass, "centre_of_mass": body.centre.tolist()} for body in bodies},
        "rest": {
            "base_height": float(rest.height),
            "angles": angles,
            "wheel_load": _by_wheel(rest.wheel_load_front, rest.wheel_load_rear),
            "tire_deflection": _by_wheel(rest.deflection_front, rest.deflection_rear),
        },
        "servos": {
            servo.hinge: asdict(servo) | {"set_point_ahead_at_rest": servo.set_point} for servo in servos(machine)
        },
        "torque_over_range": _torque_over_range(machine),
        "wheel_motors": {motor.hinge: asdict(motor) for motor in wheel_motors(machine)},
        "gears": gears(machine),
        "tire": _tire(machine),
        "hull": {
            "stiffness_a_corner": float(machine.hull.stiffness),
            "damping_a_corner": float(machine.hull.damping),
            "friction": float(machine.hull.friction),
        },
        "inverse_weight": inverse_weights(bodies)[0],
        "sensors": {name: place.tolist() for name, place in sensor_places().items()},
    }


def _tire(machine: Machine) -> dict[str, float]:
    tire = machine.tire
    names = ("radius", "stiffness", "damping", "friction_coulomb", "friction_static", "rolling_resistance")
    return {name: float(getattr(tire, name)) for name in names} | {"scrub_lever": scrub_lever(machine)}


def _by_wheel(front: Any, rear: Any) -> dict[str, float]:
    return {name: float(front if name[0] == "f" else rear) for name in WHEELS}


def _torque_over_range(machine: Machine) -> dict[str, Any]:
    """Torques [N m] at which the relief valves open, negative and positive, over the angles of joint and arms."""
    found = {}
    for name, limit, displacement, relief in (
        ("articulated_joint", machine.joint.range, steering_displacement, machine.steering.valve.shock_pressure),
        ("arm", machine.arm.swing, arm_displacement, machine.arm.valve.port_relief),
    ):
        angles = np.linspace(-float(limit), float(limit), POINTS)
        torque = float(relief) * np.array([displacement(machine, angle) for angle in angles])
        found[name] = {
            "angle": angles.tolist(),
            "negative": (-torque[:, 0]).tolist(),
            "positive": torque[:, 1].tolist(),
        }
    return found
