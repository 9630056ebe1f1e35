"""Reference controllers for ``AORO/ForestRun-v0``: straight ahead, and along planned ways, with what a lidar shows or with
the truth.

All of them steer by pure pursuit (:mod:`aoro_gym.agents.controllers.path_tracking`): the joint turns to where a steady turn
would lead through a place ``look_ahead`` in front. They back out where they are stopped. They see nothing but the
observation; only :class:`MapPlanner` knows the world, too, which no machine does: what it does is what planning can come
to.

Ways are cheapest ones over a map of costs, by A* over poses (:mod:`aoro_gym.terrains.paths.pose_search`). Places are those
of a frame with the goal at its origin, and the axes of the world: the goal in the machine's axes and the heading say where
it is.

Gains are numbers, or arrays (N,) that give every sub-environment its own.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import distance_transform_edt

from aoro_gym.agents.controllers.path_tracking import turn_angle
from aoro_gym.agents.controllers.turning import dead_band_compensated, require_terms
from aoro_gym.agents.policies.policy import Actions, Observations
from aoro_gym.terrains.paths.pose_search import SPACING, CostMap, steerable_way
from aoro_gym.terrains.world.traversability import CELL, Traversability, nearness, traversability

Floats = NDArray[np.float64]

NEEDED = ("goal", "heading", "speed", "joint_angle", "joint_rate")
"""Observation terms that the controllers read; those that plan by the lidar read ``obstacles``, too."""
SLOW, STOPPED_TIME, BACKING_TIME = 0.08, 2.0, 4.0
"""A machine is stopped that is slower than this [m/s] for this time [s]; it then drives back for so long [s]."""
STRAYED = 1.5
"""Distance [m] from its way beyond which a new one is planned."""


@dataclass(frozen=True)
class ForestDriver:
    """What a controller knows beside the observation: its columns, the machine's measures, where its lidar looks.

    Raises ValueError if the observation lacks a term that the controllers need.
    """

    layout: Mapping[str, slice]
    """``env.unwrapped.observation_layout``"""
    azimuths: Floats = field(default_factory=lambda: np.zeros(0))
    """Directions [rad] of the sectors of ``obstacles``, positive left."""
    reach: float = 15.0
    """What a sector shows in which nothing stands [m]."""
    lidar_ahead: float = 0.7
    """Of the front axle's middle [m]."""
    front: float = 1.7
    """Hinge to front axle [m]."""
    rear: float = 1.7
    """Hinge to rear axle [m]."""
    largest_angle: float = math.radians(40.0)
    """Joint angle at its stops [rad]."""
    control_step: float = 0.1
    """[s]"""

    def __post_init__(self) -> None:
        require_terms(self.layout, *NEEDED)

    @classmethod
    def of(cls, env: Any) -> ForestDriver:
        """That of an environment, wrapped or not, single or vector; where its machines differ, their mean."""
        env = environment_of(env)
        frame, task = env.twin.machine.frame, env.task
        front = float(np.mean(frame.front.axle_distance))
        known: dict[str, Any] = {}
        if "obstacles" in task.observation_terms:
            term = task.observation_terms["obstacles"].function
            known = {
                "azimuths": term.azimuths,
                "reach": term.lidar.model.max_range,
                "lidar_ahead": term.lidar.mounting.position[0] - front,
            }
        return cls(
            env.observation_layout,
            front=front,
            rear=float(np.mean(frame.rear.axle_distance)),
            largest_angle=float(np.mean(env.twin.machine.joint.range)),
            control_step=task.control_step,
            **known,
        )

    def see(self, observations: Observations) -> Seen:
        """The observation by name."""
        rows = np.asarray(observations, dtype=np.float64)
        return Seen({name: rows[:, where] for name, where in self.layout.items()})


def environment_of(env: Any) -> Any:
    env = env.unwrapped
    return getattr(env, "vector", env)


@dataclass(frozen=True)
class Seen:
    """What N controllers see, SI."""

    terms: Mapping[str, Floats]

    def __getitem__(self, name: str) -> Floats:
        """A term of one column (N,)."""
        return self.terms[name][:, 0]

    @property
    def place(self) -> Floats:
        """x, y [m] (N, 2) of the front axle's middle from the goal, in the world's axes."""
        (c, s), (x, y) = self.terms["heading"].T, self.terms["goal"].T
        return -np.stack([c * x - s * y, s * x + c * y], axis=1)

    @property
    def heading(self) -> Floats:
        """[rad] (N,)"""
        return np.arctan2(self.terms["heading"][:, 1], self.terms["heading"][:, 0])


@dataclass
class Pursuit(ABC):
    """Steers through places that :meth:`target` gives, at a constant drive signal, and backs out where it is stopped."""

    driver: ForestDriver
    look_ahead: ArrayLike = field(default=2.0, kw_only=True)
    """[m]"""
    gain: ArrayLike = field(default=2.0, kw_only=True)
    """Signal per error of the joint angle [1/rad]."""
    lead_time: ArrayLike = field(default=0.1, kw_only=True)
    """Time [s] at the present rate after which the joint's error counts."""
    rest_error: ArrayLike = field(default=0.03, kw_only=True)
    """Error of the joint angle [rad] that is left alone."""
    drive_signal: ArrayLike = field(default=0.66, kw_only=True)
    """[-]"""
    dead_band_left: ArrayLike = field(default=0.135, kw_only=True)
    """Signal [-] that moves nothing to the left."""
    dead_band_right: ArrayLike = field(default=0.175, kw_only=True)
    """The same to the right."""

    def __post_init__(self) -> None:
        self._slow = self._backing = np.zeros(0)  # [s]

    @abstractmethod
    def target(self, seen: Seen) -> Floats:
        """Places (N, 2) [m] in the machines' axes to steer through."""

    def __call__(self, observations: Observations) -> Actions:
        seen = self.driver.see(observations)
        count, step = len(observations), self.driver.control_step
        if len(self._slow) != count:
            self._slow, self._backing = np.zeros(count), np.zeros(count)
        x, y = self.target(seen).T
        curvature = 2.0 * y / np.maximum(x * x + y * y, 0.25)
        # what lies behind is reached in the tightest turn
        curvature = np.where(x > 0.0, curvature, np.copysign(1.0, y))
        back = self._backing > 0.0
        limit = self.driver.largest_angle
        angle = turn_angle(curvature, self.driver.front, self.driver.rear)
        wanted = np.clip(np.where(back, 0.0, angle), -limit, limit)
        left = wanted - seen["joint_angle"] - np.asarray(self.lead_time) * seen["joint_rate"]
        signal = dead_band_compensated(np.asarray(self.gain) * left, self.dead_band_left, self.dead_band_right)
        steering = np.where(np.abs(left) > self.rest_error, signal, 0.0)
        drive = np.where(back, -np.asarray(self.drive_signal), self.drive_signal)
        slow = (np.abs(seen["speed"]) < SLOW) & ~back
        self._slow = np.where(slow, self._slow + step, 0.0)
        stopped = self._slow > STOPPED_TIME
        self._backing = np.where(stopped, BACKING_TIME, np.maximum(self._backing - step, 0.0))
        self._slow = np.where(stopped, 0.0, self._slow)
        return np.stack(np.broadcast_arrays(steering, drive), axis=1).astype(np.float32)

    def reset(self, mask: NDArray[np.bool_] | None = None) -> None:
        """Forget the past of all sub-environments, or of those of the mask (N,)."""
        if mask is None:
            self._slow = self._backing = np.zeros(0)
        elif len(self._slow):
            self._slow, self._backing = np.where(mask, 0.0, self._slow), np.where(mask, 0.0, self._backing)


@dataclass
class StraightAhead(Pursuit):
    """Towards the goal, whatever stands in between."""

    def target(self, seen: Seen) -> Floats:
        away = seen.terms["goal"]
        distance = np.maximum(np.hypot(*away.T), 1e-3)
        return away * (np.minimum(self.look_ahead, distance) / distance)[:, None]


@dataclass
class Planner(Pursuit):
    """Along ways that :meth:`plan` gives, each sub-environment's own."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._ways: dict[int, Floats] = {}

    @abstractmethod
    def plan(self, number: int, place: Floats, heading: float) -> Floats | None:
        """Way (P, 2) [m] of the sub-environment ``number`` from a pose, in the frame of its goal; None: none is found."""

    def is_due(self, number: int, place: Floats) -> bool:
        """Whether a new way is to be planned for a machine that is at ``place`` [m] and has one."""
        return bool(np.hypot(*(self._ways[number] - place).T).min() > STRAYED)

    def target(self, seen: Seen) -> Floats:
        here, headings = seen.place, seen.heading
        ahead = np.broadcast_to(self.look_ahead, len(here))
        found = np.zeros((len(here), 2))
        for number, (place, heading) in enumerate(zip(here, headings, strict=True)):
            if number not in self._ways or self.is_due(number, place):
                way = self.plan(number, place, float(heading))
                self._ways[number] = np.zeros((1, 2)) if way is None else way
            way = self._ways[number]
            nearest = int(np.argmin(np.hypot(*(way - place).T)))
            # beyond its end a way goes on to the goal
            beyond = nearest + round(float(ahead[number]) / SPACING)
            found[number] = way[beyond] if beyond < len(way) else 0.0
        away = found - here
        c, s = np.cos(headings), np.sin(headings)
        return np.stack([c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]], axis=1)

    def reset(self, mask: NDArray[np.bool_] | None = None) -> None:
        super().reset(mask)
        for number in list(self._ways):
            if mask is None or mask[number]:
                del self._ways[number]


@dataclass
class MapPlanner(Planner):
    """Along the cheapest way over the world's truth, planned at the start and where the machine has strayed: it knows every
    object, and wet and steep ground. It learns from the environment in which world each machine is."""

    env: Any
    """Which is driven in, wrapped or not, single or vector."""
    inflation: ArrayLike = field(default=1.6, kw_only=True)
    """Least distance [m] to what stops a machine."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._grounds: dict[int, Traversability] = {}

    def watching(self, env: Any) -> MapPlanner:
        """The same in the worlds of another environment."""
        return replace(self, env=env)

    def plan(self, number: int, place: Floats, heading: float) -> Floats | None:
        task = environment_of(self.env).task
        courses, goals = task.runs()
        course, goal = int(courses[number]), goals[number]
        if course not in self._grounds:
            world = task.courses[course].world
            if world is None:
                raise ValueError(f"course {course} is no world: there is no map to plan on; take another controller")
            self._grounds[course] = traversability(world)
        ground, least = self._grounds[course], own_gain(self.inflation, number)
        # never infinite: who has come too near to something needs a way out
        cost = ground.price + nearness(ground.room - least) + BLOCKED * (ground.room < least)
        corner = (ground.corner[0] - goal[0], ground.corner[1] - goal[1])
        return steerable_way(CostMap(cost, corner, ground.cell), (*place, heading), (0.0, 0.0), partial=True)


def own_gain(gain: ArrayLike, number: int) -> float:
    """The gain of a sub-environment."""
    values = np.asarray(gain, dtype=np.float64)
    return float(values[number] if values.ndim else values)


BLOCKED = 40.0
"""What a metre costs besides, too near to an obstacle."""
MARGIN = 14.0
"""[m] by which the map of a lidar reaches beyond start and goal."""
MAPPED = 10.0
"""[m] up to which echoes are put into the map: farther ones are too uncertain in place."""
LOOKED_AT = 3
"""Control steps between two looks at whether the way is free."""


@dataclass
class LidarPlanner(Planner):
    """Along the cheapest way over a map of what the lidar has shown so far, planned anew where that stands in the way."""

    inflation: ArrayLike = field(default=1.6, kw_only=True)
    """Least distance [m] to what stands up."""
    hits: ArrayLike = field(default=2.0, kw_only=True)
    """Sweeps in which something stood in a cell of the map, from which on it counts."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_terms(self.driver.layout, "obstacles")
        self._maps: dict[int, LidarMap] = {}
        self._step = 0

    def target(self, seen: Seen) -> Floats:
        ranges, places, headings = seen.terms["obstacles"], seen.place, seen.heading
        if not self._maps:
            self._maps = {number: LidarMap(place) for number, place in enumerate(places)}
        shown = ranges < min(self.driver.reach - 0.01, MAPPED)
        x = self.driver.lidar_ahead + ranges * np.cos(self.driver.azimuths)
        y = ranges * np.sin(self.driver.azimuths)
        c, s = np.cos(headings)[:, None], np.sin(headings)[:, None]
        points = places[:, None] + np.stack([c * x - s * y, s * x + c * y], axis=-1)
        for number, place in enumerate(places):
            if number not in self._maps:
                self._maps[number] = LidarMap(place)
            self._maps[number].add(points[number][shown[number]])
        self._step += 1
        return super().target(seen)

    def is_due(self, number: int, place: Floats) -> bool:
        if (self._step + number) % LOOKED_AT:
            return False
        way = self._ways[number]
        nearest = int(np.argmin(np.hypot(*(way - place).T)))
        ahead = way[nearest : nearest + round(MAPPED / SPACING)]
        room = self._room(number)
        blocked = room.min_along(ahead) < own_gain(self.inflation, number) - 0.5 * CELL
        return blocked or super().is_due(number, place)

    def _room(self, number: int) -> LidarMap:
        return self._maps[number].measured(own_gain(self.hits, number))

    def plan(self, number: int, place: Floats, heading: float) -> Floats | None:
        known, least = self._room(number), own_gain(self.inflation, number)
        cost = 1.0 + nearness(known.room - least) + BLOCKED * (known.room < least)
        ground = CostMap(cost, known.corner, CELL)
        return steerable_way(ground, (*place, heading), (0.0, 0.0), partial=True, most=MOST_POSES)

    def reset(self, mask: NDArray[np.bool_] | None = None) -> None:
        super().reset(mask)
        for number in list(self._maps):
            if mask is None or mask[number]:
                del self._maps[number]


MOST_POSES = 3000
"""Of a plan on the map of a lidar."""


class LidarMap:
    """How often something stood where, around a start and the goal at the origin.

    Args:
        start: x, y [m].
    """

    def __init__(self, start: Floats):
        low, high = np.minimum(start, 0.0) - MARGIN, np.maximum(start, 0.0) + MARGIN
        self.corner = (float(low[0]), float(low[1]))
        """x, y [m] of the first node."""
        columns, rows = np.ceil((high - low) / CELL).astype(int) + 1
        self._count = np.zeros((rows, columns))
        self.room = np.full((rows, columns), np.inf)
        """(rows, columns) distance [m] to the nearest node that counts as an obstacle, as of :meth:`measured`."""
        self._standing = 0

    def add(self, points: Floats) -> None:
        """Something stands at ``points`` (K, 2) [m]."""
        column, row = np.rint((points - self.corner) / CELL).astype(np.intp).T
        rows, columns = self._count.shape
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        self._count[row[inside], column[inside]] += 1.0

    def measured(self, hits: float) -> LidarMap:
        """Itself, with the distances to nodes where something stood at least ``hits`` times."""
        standing = self._count >= hits
        number = int(standing.sum())
        if number != self._standing:
            self._standing = number
            self.room = CELL * np.asarray(distance_transform_edt(~standing), dtype=np.float64)
        return self

    def min_along(self, points: Floats) -> float:
        """Least distance [m] to an obstacle of places (K, 2) [m] in the map; infinite for none."""
        column, row = np.rint((points - self.corner) / CELL).astype(np.intp).T
        rows, columns = self._count.shape
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        return float(self.room[row[inside], column[inside]].min(initial=np.inf))
