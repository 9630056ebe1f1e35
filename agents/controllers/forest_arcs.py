"""A planner for ``AORO/ForestRun-v0`` that knows the world and has an answer at every pose: the teacher of learned policies.

At each control step it compares all ways of three arcs that the machine can drive from where it is, by what they cost over a
map of the world's truth and by what remains from where they end: the cost of the cheapest way from there to the goal along
the map's grid, which is found once a goal. It drives along the first arc of the cheapest one. Where every arc ahead leads
into what stops a machine, it compares those that begin with an arc back, too.

:class:`~aoro_gym.agents.controllers.forest_run.MapPlanner` keeps to a way that was planned once, which a network would have
to guess. What this one does follows from pose, joint and direction of travel alone, and many machines are planned for at
once by array operations, on a GPU, too. It looks 4.5 m ahead, so it drives into traps that a planned way keeps out of.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.agents.controllers.forest_run import BLOCKED, Floats, Pursuit, Seen, environment_of, own_gain
from aoro_gym.agents.policies.policy import Actions, Observations
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.execution.array_api import Arrays
from aoro_gym.terrains.paths.pose_search import TIGHTEST, CostMap
from aoro_gym.terrains.world.traversability import nearness, traversability

Singles = NDArray[np.float32]

ARC = 1.5
"""Length [m] of an arc."""
AHEAD = (7, 5, 5)
"""Curvatures that are compared for the first arc, and for those that follow: from the tightest bend to the right to that to
the left."""
BACK = (3, 5, 5)
"""The same where the first arc leads back."""
POINTS = 3
"""Of an arc that are looked at, the last one at its end."""
REAR = (-4.2, -4.9)
"""Way [m] along an arc back to the places of the rear axle that are looked at: it leads."""
BEND, CHANGE = 0.08, 0.1
"""What an arc costs besides, in units of its length, in the tightest bend, and for a change of curvature by as much. (E)"""
BACKWARDS, TURN_BACK = 2.0, 4.0
"""What a metre back costs besides, and beginning with it [m]. (E)"""
HINDERED = 8.0
"""What the cheapest way ahead costs more than what remains by the map alone where arcs back are looked at, too [m]. (E)"""
NEAR_GOAL = 1.0
"""Distance [m] from the goal within which a way ends."""


class Maps:
    """What a metre costs in the worlds of a task, and what remains to the goals that were met so far, as float32.

    Places are columns and rows of the grids, which all worlds share.

    Args:
        courses: The task's, all of one size.
        inflation: Least distance [m] to what stops a machine.
        arrays: Where they lie.
        progress: Called with the share of the worlds that are drawn.

    Raises ValueError where a course is no world.
    """

    def __init__(
        self,
        courses: Sequence[Course],
        inflation: float,
        arrays: Arrays,
        progress: Callable[[float], Any] = lambda share: None,
    ):
        self.arrays = arrays
        self._costs: list[CostMap] = []
        for number, course in enumerate(courses):
            progress(number / len(courses))
            if course.world is None:
                raise ValueError(f"course {number} is no world: there is no map to plan on; take another controller")
            ground = traversability(course.world)
            # never infinite: who has come too near to something needs a way out
            cost = ground.price + nearness(ground.room - inflation) + BLOCKED * (ground.room < inflation)
            self._costs.append(CostMap(cost, ground.corner, ground.cell))
        self.shape, self.cell = self._costs[0].cost.shape, self._costs[0].cell
        self._known: dict[tuple[int, float, float], int] = {}
        self._of_goals: list[Singles] = []  # what a metre costs, then what remains
        self._here: Any = None

    def of(self, courses: NDArray[Any], goals: Floats) -> NDArray[np.intp]:
        """Which of the goals that were met those of so many machines are (N,)."""
        keys = [(int(course), float(x), float(y)) for course, (x, y) in zip(courses, goals, strict=True)]
        for key in keys:
            if key not in self._known:
                ground = self._costs[key[0]]
                self._known[key] = len(self._of_goals)
                self._of_goals.append(np.stack([ground.cost, ground.cost_to_go(key[1:])]).astype(np.float32))
                self._here = None
        return np.array([self._known[key] for key in keys])

    def nodes(self, places: Floats) -> Floats:
        """Columns and rows (N, 2) of places [m]."""
        return (places - np.asarray(self._costs[0].corner)) / self.cell

    def values(self) -> Any:
        """(2 G rows columns,) of G goals: what a metre costs, then what remains, of one after the other."""
        if self._here is None:
            self._here = self.arrays.asarray(np.stack(self._of_goals).ravel(), self.arrays.xp.float32)
        return self._here

    def cost(self, numbers: Any, x: Any, y: Any) -> Any:
        """What a metre costs (N, K) at the nodes nearest to columns ``x`` and rows ``y`` (N, K) of the goals' grids (N,)."""
        xp, (rows, columns) = self.arrays.xp, self.shape
        column, row = xp.clip(xp.round(x), 0.0, columns - 1.0), xp.clip(xp.round(y), 0.0, rows - 1.0)
        first = 2 * rows * columns * numbers[:, None]
        index = first + xp.astype(row, xp.int64) * columns + xp.astype(column, xp.int64)
        return xp.reshape(xp.take(self.values(), xp.reshape(index, (-1,)), axis=0), index.shape)

    def to_go(self, numbers: Any, x: Any, y: Any) -> Any:
        """What remains to the goals (N, K), bilinear, likewise."""
        xp, (rows, columns) = self.arrays.xp, self.shape
        x, y = xp.clip(x, 0.0, columns - 1.001), xp.clip(y, 0.0, rows - 1.001)
        column, row = xp.floor(x), xp.floor(y)
        u, v = x - column, y - row
        first = (2 * numbers[:, None] + 1) * (rows * columns)
        index = xp.reshape(first + xp.astype(row, xp.int64) * columns + xp.astype(column, xp.int64), (-1,))
        corners = (
            xp.reshape(xp.take(self.values(), index + step, axis=0), x.shape) for step in (0, 1, columns, columns + 1)
        )
        south_west, south_east, north_west, north_east = corners
        south, north = south_west * (1.0 - u) + south_east * u, north_west * (1.0 - u) + north_east * u
        return south * (1.0 - v) + north * v

    def remaining(self, numbers: NDArray[np.intp], nodes: Floats) -> Floats:
        """What remains (N,) from columns and rows (N, 2)."""
        arrays, single = self.arrays, self.arrays.xp.float32
        x, y = (arrays.asarray(nodes[:, axis : axis + 1], single) for axis in (0, 1))
        return arrays.host(self.to_go(arrays.asarray(numbers, arrays.xp.int64), x, y))[:, 0]


@dataclass(frozen=True, eq=False)
class ArcTree:
    """All ways of a few arcs, in the axes of the pose that they begin at; by stage."""

    places: tuple[Singles, ...]
    """(ways so far, POINTS, 2) [m]"""
    before: tuple[NDArray[np.intp], ...]
    """(ways so far,) which way of the stage before each goes on from."""
    price: tuple[Singles, ...]
    """(ways so far,) what bends, their changes and going back cost."""
    curvatures: Floats
    """Of the first arcs [1/m]."""

    @classmethod
    def grown(cls, counts: tuple[int, ...], *, back: bool = False) -> ArcTree:
        """The tree with so many curvatures by stage.

        Args:
            counts: At least 2 each.
            back: Whether the first arcs lead back.
        """
        ends, bends = np.zeros((1, 3)), np.zeros(1)  # x, y, heading; curvature
        places, before, price = [], [], []
        for stage, count in enumerate(counts):
            origin = np.repeat(np.arange(len(ends)), count)
            bend = np.tile(np.linspace(-1.0, 1.0, count) / TIGHTEST, len(ends))
            ways = ARC * np.arange(1, POINTS + 1) / POINTS
            backwards = back and stage == 0
            if backwards:
                ways = np.array([*REAR, -ARC])
            x, y, heading = ends[origin].T
            dx, dy = arc(bend[:, None], ways)
            c, s = np.cos(heading)[:, None], np.sin(heading)[:, None]
            places.append(np.stack([x[:, None] + c * dx - s * dy, y[:, None] + s * dx + c * dy], axis=-1))
            change = np.abs(bend - bends[origin]) * (stage > 0)
            price.append(ARC * (TIGHTEST * (BEND * np.abs(bend) + CHANGE * change) + BACKWARDS * backwards))
            before.append(origin)
            ends, bends = np.column_stack([places[-1][:, -1], heading + bend * ways[-1]]), bend
        single = [tuple(each.astype(np.float32) for each in group) for group in (places, price)]
        return cls(single[0], tuple(before), single[1], np.linspace(-1.0, 1.0, counts[0]) / TIGHTEST)

    def compared(
        self, maps: Maps, numbers: NDArray[np.intp], places: Floats, goals: Floats, bend: Floats
    ) -> NDArray[np.float32]:
        """What the cheapest way by each first arc costs (N, first arcs).

        Args:
            maps: To drive over.
            numbers: Of the goals (N,).
            places: Column, row and heading [rad] (N, 3).
            goals: Columns and rows (N, 2).
            bend: Curvature [1/m] at which the joint stands (N,).
        """
        arrays, count = maps.arrays, len(places)
        xp = arrays.xp
        number = arrays.asarray(numbers, xp.int64)
        x0, y0, heading, goal_x, goal_y, now = (
            arrays.asarray(column[:, None], xp.float32) for column in (*places.T, *goals.T, bend)
        )
        c, s = xp.cos(heading) / maps.cell, xp.sin(heading) / maps.cell
        spent = CHANGE * ARC * TIGHTEST * xp.abs(arrays.asarray(self.curvatures[None], xp.float32) - now)
        arrived, x, y = spent < 0.0, spent, spent
        for stage, (points, before, price) in enumerate(zip(self.places, self.before, self.price, strict=True)):
            ahead, left = (arrays.asarray(points.reshape(-1, 2)[None, :, axis], xp.float32) for axis in (0, 1))
            x, y = x0 + c * ahead - s * left, y0 + s * ahead + c * left
            shape = (count, len(before), POINTS)
            extra = arrays.asarray(price, xp.float32) + ARC * xp.mean(
                xp.reshape(maps.cost(number, x, y), shape), axis=-1
            )
            if stage:
                origin = arrays.asarray(before, xp.int64)
                spent, arrived = xp.take(spent, origin, axis=1), xp.take(arrived, origin, axis=1)
            spent = spent + xp.where(arrived, xp.zeros_like(extra), extra)
            away = xp.reshape((x - goal_x) ** 2 + (y - goal_y) ** 2, shape)
            arrived = arrived | (xp.min(away, axis=-1) < (NEAR_GOAL / maps.cell) ** 2)
        end_x, end_y = (xp.reshape(each, shape)[..., -1] for each in (x, y))
        left = maps.to_go(number, end_x, end_y)
        total = spent + xp.where(arrived, xp.zeros_like(left), left)
        return arrays.host(xp.min(xp.reshape(total, (count, len(self.curvatures), -1)), axis=-1))


def arc(curvature: Floats, way: Any) -> tuple[Floats, Floats]:
    """Places x, y [m] after so much ``way`` [m] along arcs of a ``curvature`` [1/m] that begin along x."""
    turned = 0.5 * curvature * way
    chord = way * np.sinc(turned / np.pi)
    return chord * np.cos(turned), chord * np.sin(turned)


@dataclass
class ArcPlanner(Pursuit):
    """Along the first arc of the cheapest way of a few arcs over the world's truth. It learns from the environment in which
    world each machine is."""

    env: Any
    """Which is driven in, wrapped or not, single or vector."""
    inflation: ArrayLike = field(default=1.6, kw_only=True)
    """Least distance [m] to what stops a machine."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._ahead, self._back = ArcTree.grown(AHEAD), ArcTree.grown(BACK, back=True)
        self._reversing = np.zeros(0, dtype=bool)
        self._maps: Maps | None = None

    def watching(self, env: Any) -> ArcPlanner:
        """The same in the worlds of another environment."""
        return replace(self, env=env)

    def prepare(self, progress: Callable[[float], Any] = lambda share: None) -> None:
        """Draw the maps of all worlds, as the first step does otherwise; ``progress`` is called with the share done."""
        if self._maps is None:
            vector = environment_of(self.env)
            self._maps = Maps(vector.task.courses, own_gain(self.inflation, 0), vector.arrays, progress)

    def __call__(self, observations: Observations) -> Actions:
        actions = super().__call__(observations)
        actions[:, 1] = np.where(self._reversing, -np.abs(actions[:, 1]), actions[:, 1])
        return actions

    def target(self, seen: Seen) -> Floats:
        self.prepare()
        maps = self._maps
        assert maps is not None
        courses, goals = environment_of(self.env).task.runs()
        numbers = maps.of(courses, goals)
        places = np.column_stack([maps.nodes(seen.place + goals), seen.heading])
        goals = maps.nodes(goals)
        bend = np.tan(0.5 * seen["joint_angle"]) / self.driver.front
        total = self._ahead.compared(maps, numbers, places, goals, bend)
        curvature = _refined(total, self._ahead.curvatures)
        left = maps.remaining(numbers, places[:, :2])
        was_back = seen.terms["actions"][:, 1] < 0.0 if "actions" in seen.terms else np.zeros(len(places), dtype=bool)
        rows = np.flatnonzero(was_back | (total.min(axis=1) > left + HINDERED))
        self._reversing = np.zeros(len(places), dtype=bool)
        if len(rows):
            back = self._back.compared(maps, numbers[rows], places[rows], goals[rows], bend[rows])
            best = np.argmin(back, axis=1)
            cost = back[np.arange(len(rows)), best] + TURN_BACK * ~was_back[rows]
            better = cost < total[rows].min(axis=1) + TURN_BACK * was_back[rows]
            self._reversing[rows] = better
            curvature[rows] = np.where(better, self._back.curvatures[best], curvature[rows])
        return np.stack(arc(curvature, ARC), axis=1)


def _refined(total: NDArray[Any], curvatures: Floats) -> Floats:
    """Curvature (N,) of the least cost (N, K): the parabola's through it and its neighbours."""
    best = np.clip(np.argmin(total, axis=1), 1, len(curvatures) - 2)
    rows = np.arange(len(total))
    low, mid, high = (total[rows, best + k] for k in (-1, 0, 1))
    bend = np.maximum(low - 2.0 * mid + high, 1e-6)
    shift = np.clip(0.5 * (low - high) / bend, -1.0, 1.0)
    return curvatures[best] + shift * (curvatures[1] - curvatures[0])
