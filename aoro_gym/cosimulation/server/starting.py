"""Where a served twin stands when it begins."""

from __future__ import annotations

import numpy as np

from aoro_gym.machine import Machine
from aoro_gym.terrains import Path
from aoro_gym.twin import Twin

BEHIND = 4.0
"""Distance [m] along an open path at which a machine starts, so that its rear axle stands on the path, too."""


def start_on_path(twin: Twin, machine: Machine, path: Path) -> None:
    """Put the twin at rest with the middle of its front axle on the path, along it, bent as the path is.

    Raises ValueError if an open path is too short.
    """
    s = 0.0 if path.closed else BEHIND
    if path.length < s + 2.0:
        raise ValueError(f"path {path.name!r} is {path.length:.2f} m long, but must be at least {s + 2.0:g} m")
    heading, front, rear = float(path.heading(s)), *_axles(machine)
    place = path.position(s) - front * np.array([np.cos(heading), np.sin(heading)])
    limit = float(np.max(machine.joint.range))
    bend = float(np.clip(path.curvature(s) * (front + rear), -limit, limit))
    twin.reset(position=place, heading=heading, joint_angle=bend)


def _axles(machine: Machine) -> tuple[float, float]:
    """From the hinge to the front and to the rear axle [m]."""
    return float(np.max(machine.frame.front.axle_distance)), float(np.max(machine.frame.rear.axle_distance))
