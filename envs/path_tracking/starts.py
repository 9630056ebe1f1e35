"""Where episodes start: on their paths, off them and turned as drawn or asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.envs.core.randomisation import Draws
from aoro_gym.envs.core.task import given
from aoro_gym.envs.path_tracking.courses import HeightMap
from aoro_gym.envs.path_tracking.path_table import PathTable
from aoro_gym.machine import Machine
from aoro_gym.sensors.attitude import wrapped
from aoro_gym.terrains.world.places import stands_free

Floats = NDArray[np.float64]
STEP = 0.5
"""Distance [m] along a path of the places where a start is looked for."""
AT_ONCE = 8
"""Such places that are looked at together."""


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
    solid: Sequence[Floats | None] | None = None,
) -> StartingPose:
    """Poses of the sub-environments ``where`` (K,).

    One that is drawn and would stand in an object stands at the nearest place along its path where it stands free, as much
    off the path and turned as drawn, if there is such a place; nothing more is drawn for it.

    Args:
        table: All paths.
        path: Its row (K,) in the table.
        machine: With values (K,) or one for all.
        draws: Of the episodes.
        options: Of ``reset``, which come before what is drawn.
        where: Sub-environments.
        num_envs: Number of all of them.
        start_distance: Least distance [m] along an open path: a machine stands behind it.
        solid: Of each of them the circles of what is solid on its course (:func:`aoro_gym.terrains.world.places.circles`),
            None on bare ground.

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
    first = np.where(table.closed[path], 0.0, start_distance)
    last = np.maximum(length - 2.0, first)
    s = asked("start", first + draws.task["start"] * (last - first), 0.0, np.inf, "m")
    if np.any(s > last):
        bad = int(np.argmax(s > last))
        raise ValueError(
            f"options['start'] is {s[bad]:g} m, but that path is {length[bad]:.2f} m long; start 2 m before its end"
        )
    offset = asked("lateral_offset", draws.task["lateral_offset"], -np.inf, np.inf, "m")
    turned = asked("heading_offset", draws.task["heading_offset"], -np.pi, np.pi, "rad")
    limit = np.broadcast_to(np.asarray(machine.joint.range, dtype=np.float64), len(where))
    joint_angle = asked("joint_angle", np.full(len(where), np.nan), -limit, limit, "rad")
    off = _OffPath(front, rear, offset, turned, draws.joint_angle * limit, limit, joint_angle)
    if solid is not None and options.get("start") is None:
        s = np.array([
            s[k] if circles is None else _free(table, path[k], s[k], (first[k], last[k]), off.of(k), circles)
            for k, circles in enumerate(solid)
        ])  # fmt: skip
    return off.poses(table, path, s)


@dataclass(frozen=True)
class _OffPath:
    """How K vehicles stand beside their paths, each (K,)."""

    front: Floats
    """Hinge to front axle [m]."""
    rear: Floats
    """Hinge to rear axle [m]."""
    offset: Floats
    """Cross-track error [m]."""
    turned: Floats
    """Heading error [rad]."""
    bent: Floats
    """Joint angle [rad] beyond what the path's bend asks for."""
    limit: Floats
    """Largest joint angle [rad]."""
    joint_angle: Floats
    """Joint angle [rad] that is asked for instead; NaN: none."""

    def of(self, k: int) -> _OffPath:
        """The vehicle ``k``, (1,)."""
        return _OffPath(*(getattr(self, each.name)[k : k + 1] for each in fields(self)))

    def poses(self, table: PathTable, path: NDArray[np.intp], s: Floats) -> StartingPose:
        """They at ``s`` [m] along the paths in the rows ``path`` of the table."""
        place, along, bend = table.at(path, s)
        heading = wrapped(along + self.turned)
        # the front axle's middle and, one machine behind, the rear one's
        reference = place + self.offset[:, None] * np.stack([-np.sin(along), np.cos(along)], axis=1)
        hinge = reference - self.front[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
        # a steady turn of curvature κ bends the joint by κ times the wheelbase, at small angles
        angle = np.clip(bend * (self.front + self.rear) + self.bent, -self.limit, self.limit)
        angle = np.where(np.isnan(self.joint_angle), angle, self.joint_angle)
        behind = hinge - self.rear[:, None] * np.stack([np.cos(heading - angle), np.sin(heading - angle)], axis=1)
        return StartingPose(s, heading, angle, np.stack([reference, behind]), hinge)


def _free(table: PathTable, path: np.intp, s: float, ends: tuple[float, float], off: _OffPath, solid: Floats) -> float:
    """Place along a path [m] nearest to ``s`` where a vehicle stands in no object; ``s`` where there is none.

    Args:
        table: All paths.
        path: Row of the path.
        s: Where it is to stand [m].
        ends: Least and largest place [m].
        off: How it stands beside the path.
        solid: Circles (K, 3) of what is solid.
    """
    apart = STEP * np.arange(np.ceil((ends[1] - ends[0]) / STEP) + 1.0)
    tried = s + np.stack([apart, -apart], axis=1).reshape(-1)[1:]  # s, s + 0.5 m, s - 0.5 m, ...
    tried = tried[(tried >= ends[0]) & (tried <= ends[1])]
    # most stand free where they are
    for some in (tried[:1], *np.split(tried[1:], range(AT_ONCE, len(tried) - 1, AT_ONCE))):
        poses = off.poses(table, np.full(len(some), path), some)
        free = stands_free(solid, poses.hinge, poses.heading, poses.joint_angle)
        if free.any():
            return float(some[np.argmax(free)])
    return s


def check_ground(
    poses: StartingPose, height_map: HeightMap, course: NDArray[np.intp], table: PathTable, path: NDArray[np.intp]
) -> None:
    """Refuse a start without ground under both axles.

    Args:
        poses: Of K vehicles.
        height_map: Grounds of all courses.
        course: Its number (K,).
        table: All paths.
        path: Its row (K,) in the table.

    Raises:
        ValueError: there is none.
    """
    there = height_map.known(course, poses.axles).all(axis=0)
    if not there.all():
        bad = int(np.argmin(there))
        x, y = poses.axles[0, bad]
        raise ValueError(
            f"path {table.paths[path[bad]].name!r} starts at ({x:.1f}, {y:.1f}) m, where "
            f"terrain {course[bad]} has no ground for both axles; give a path within it"
        )
