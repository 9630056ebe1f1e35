"""Where episodes start: on their paths, off them and turned as drawn or asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.envs.core.randomisation import Draws
from aoro_gym.envs.core.task import given
from aoro_gym.envs.path_tracking.courses import HeightMap
from aoro_gym.envs.path_tracking.path_table import PathTable
from aoro_gym.machine import Machine
from aoro_gym.sensors.attitude import wrapped

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class StartingPose:
    """K vehicles at rest."""

    s: Floats
    """Along the path [m] (K,)."""
    heading: Floats
    """Of the front frame [rad] (K,)."""
    joint_angle: Floats
    """[rad] (K,)"""
    axles: Floats
    """Middles of the front and of the rear axle [m] (2, K, 2)."""
    hinge: Floats
    """[m] (K, 2)"""


def starting_poses(
    table: PathTable,
    path: NDArray[np.intp],
    machine: Machine,
    draws: Draws,
    options: Mapping[str, Any],
    *,
    where: NDArray[np.intp],
    num_envs: int,
    start_distance: float,
) -> StartingPose:
    """Poses of the sub-environments ``where`` (K,).

    Args:
        table: All paths.
        path: Its row (K,) in the table.
        machine: With values (K,) or one for all.
        draws: Of the episodes.
        options: Of ``reset``, which come before what is drawn.
        where: Sub-environments.
        num_envs: Number of all of them.
        start_distance: Least distance [m] along an open path: a machine stands behind it.

    Raises:
        ValueError: an option is outside its range.
    """

    def asked(name: str, default: Floats, low: Any, high: Any, unit: str) -> Floats:
        return given(options, name, where, num_envs, default, low, high, unit)

    front, rear = (
        np.broadcast_to(np.asarray(frame.axle_distance, dtype=np.float64), where.shape)
        for frame in (machine.frame.front, machine.frame.rear)
    )
    length = table.lengths[path]
    first = np.array([0.0 if table.paths[row].closed else start_distance for row in path])
    last = np.maximum(length - 2.0, first)
    s = asked("start", first + draws.task["start"] * (last - first), 0.0, np.inf, "m")
    if np.any(s > last):
        bad = int(np.argmax(s > last))
        raise ValueError(
            f"options['start'] is {s[bad]:g} m, but that path is {length[bad]:.2f} m long; start 2 m before its end"
        )
    offset = asked("lateral_offset", draws.task["lateral_offset"], -np.inf, np.inf, "m")
    turned = asked("heading_offset", draws.task["heading_offset"], -np.pi, np.pi, "rad")
    place, along, bend = table.at(path, s)
    heading = wrapped(along + turned)
    # the front axle's middle and, one machine behind, the rear one's
    reference = place + offset[:, None] * np.stack([-np.sin(along), np.cos(along)], axis=1)
    hinge = reference - front[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    limit = np.broadcast_to(np.asarray(machine.joint.range, dtype=np.float64), len(where))
    # a steady turn of curvature κ bends the joint by κ times the wheelbase, at small angles
    angle = bend * (front + rear) + draws.joint_angle * limit
    angle = asked("joint_angle", np.clip(angle, -limit, limit), -limit, limit, "rad")
    behind = hinge - rear[:, None] * np.stack([np.cos(heading - angle), np.sin(heading - angle)], axis=1)
    return StartingPose(s, heading, angle, np.stack([reference, behind]), hinge)


def check_ground(poses: StartingPose, height_map: HeightMap, course: NDArray[np.intp], names: list[str]) -> None:
    """Refuse a start without ground under both axles.

    Args:
        poses: Of K vehicles.
        height_map: Grounds of all courses.
        course: Its number (K,).
        names: Of the K paths, for the message.

    Raises:
        ValueError: there is none.
    """
    there = height_map.known(course, poses.axles).all(axis=0)
    if not there.all():
        bad = int(np.argmin(there))
        x, y = poses.axles[0, bad]
        raise ValueError(
            f"path {names[bad]!r} starts at ({x:.1f}, {y:.1f}) m, where "
            f"terrain {course[bad]} has no ground for both axles; give a path within it"
        )
