"""Ways that an articulated machine can follow over a map of costs, by A* over poses.

A pose is a place, a heading of a grid of them, and a curvature of a few; a way is a chain of short arcs whose curvature is
bounded and changes by one step at a time, as the joint needs. A* (P. Hart, N. Nilsson, B. Raphael, IEEE Trans. Systems
Science and Cybernetics 4, 1968) expands the pose first that may lie on the cheapest way: what is spent, and what remains at
least. The latter comes from the map without heading and curvature, by Dijkstra's algorithm from the goal. Poses that share
a cell, a heading and a curvature count as one, and the first that comes there is kept (hybrid A*: D. Dolgov et al., Int. J.
Robotics Research 29, 2010), so a way is as cheap as any up to the cells' size.

>>> import numpy as np
>>> open_ground = CostMap(np.ones((60, 60)), (0.0, 0.0), 0.5)
>>> way = steerable_way(open_ground, (5.0, 5.0, 0.0), (25.0, 5.0))
>>> way is not None and float(np.abs(way[:, 1] - 5.0).max()) < 0.01
True
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from aoro_gym.checks import check_range

Array = NDArray[np.float64]

HEADINGS = 96
"""Of poses, evenly spread."""
PIECE = 0.8
"""Length [m] of an arc."""
LEVELS = 2
"""Curvatures to either side: multiples of one heading's step over a piece, so the tightest bend has a radius of 6.1 m."""
TIGHTEST = PIECE * HEADINGS / (2.0 * math.pi * LEVELS)
"""Radius [m] of the tightest bend: the machine's joint turns at 40° on 4.8 m."""
POINTS = 4
"""Of a piece that are looked at."""
SPACING = PIECE / POINTS
"""[m] of the places that a way is given by."""
MERGED = 0.4, 4
"""Side [m] of cells, and headings, in which poses count as one."""
BEND_COST, CHANGE_COST = 0.05, 0.05
"""What a piece costs besides, in units of its length, for each level of curvature, and for a change of it. (E)"""
SHORTER = 0.92
"""Length over that along eight directions at worst, cos(π/8): what remains is at least so much of what the grid says."""
MOST = 30_000
"""Poses that are expanded before a search ends."""


@dataclass(frozen=True, eq=False)
class CostMap:
    """What a metre costs at the nodes of a square grid."""

    cost: Array
    """(rows, columns), above 0; infinite where no way leads; row 0 in the south."""
    corner: tuple[float, float]
    """x, y [m] of the first node."""
    cell: float
    """Distance [m] of neighbouring nodes."""

    def __post_init__(self) -> None:
        check_range("least cost", float(np.min(self.cost)), gt=0.0)
        check_range("cell", self.cell, "m", gt=0.0)

    def node(self, x: float, y: float) -> tuple[int, int]:
        """Row and column of the node nearest to a place [m], which may lie outside of the grid."""
        return round((y - self.corner[1]) / self.cell), round((x - self.corner[0]) / self.cell)

    def cost_to_go(self, goal: tuple[float, float]) -> Array:
        """(rows, columns) cost of the cheapest way along the grid's eight directions to ``goal`` [m]; infinite where none
        leads there. A step costs its length times the mean of its nodes' costs.

        Raises ValueError if the goal lies outside of the grid.
        """
        rows, columns = self.cost.shape
        row, column = self.node(*goal)
        if not (0 <= row < rows and 0 <= column < columns):
            raise ValueError(f"goal is ({goal[0]:g}, {goal[1]:g}) m, but must lie in the map; make the map larger")
        found = dijkstra(self._graph, directed=False, indices=row * columns + column)
        return np.asarray(found, dtype=np.float64).reshape(rows, columns)

    @cached_property
    def _graph(self) -> Any:
        """Sparse matrix of what steps cost between nodes that are neighbours in eight directions."""
        rows, columns = self.cost.shape
        number = np.arange(rows * columns).reshape(rows, columns)
        one, two, price = [], [], []
        for step_row, step_column in ((0, 1), (1, 0), (1, 1), (1, -1)):
            here = (slice(0, rows - step_row), slice(max(-step_column, 0), columns - max(step_column, 0)))
            there = (slice(step_row, rows), slice(max(step_column, 0), columns - max(-step_column, 0)))
            length = self.cell * math.hypot(step_row, step_column)
            value = 0.5 * length * (self.cost[here] + self.cost[there])
            known = np.isfinite(value)
            one.append(number[here][known])
            two.append(number[there][known])
            price.append(value[known])
        edges = np.concatenate(price), (np.concatenate(one), np.concatenate(two))
        return coo_matrix(edges, shape=(rows * columns, rows * columns)).tocsr()


@cache
def _pieces() -> list[list[tuple[list[tuple[float, float]], int]]]:
    """By heading and level of curvature: places along the piece from its beginning, and the heading it ends with."""
    found = []
    for heading in range(HEADINGS):
        first = 2.0 * math.pi * heading / HEADINGS
        arcs = []
        for level in range(-LEVELS, LEVELS + 1):
            bend = 2.0 * math.pi * level / HEADINGS / PIECE
            places = []
            for k in range(1, POINTS + 1):
                s = PIECE * k / POINTS
                chord = s if level == 0 else 2.0 * math.sin(0.5 * bend * s) / bend
                places.append((chord * math.cos(first + 0.5 * bend * s), chord * math.sin(first + 0.5 * bend * s)))
            arcs.append((places, (heading + level) % HEADINGS))
        found.append(arcs)
    return found


def steerable_way(
    ground: CostMap,
    start: tuple[float, float, float],
    goal: tuple[float, float],
    *,
    reach: float = 1.0,
    to_go: Array | None = None,
    partial: bool = False,
    most: int = MOST,
) -> Array | None:
    """Places (P, 2) [m] of a cheapest way from a pose to a goal, :data:`SPACING` apart, the start included.

    Args:
        ground: What a metre costs.
        start: x, y [m] and heading [rad], taken at the nearest one of :data:`HEADINGS`; the joint is taken to be straight.
        goal: x, y [m].
        reach: Distance [m] from the goal that is near enough.
        to_go: What :meth:`CostMap.cost_to_go` gives for the goal, where it is known already.
        partial: Whether to give the way that comes nearest to the goal where none reaches it.
        most: Poses that are expanded before the search ends.

    Returns None where no way is found. Raises ValueError if the goal lies outside of the map.
    """
    to_go = ground.cost_to_go(goal) if to_go is None else to_go
    search = _Search(ground, to_go, goal, reach)
    end = search.run(start, most, partial)
    return None if end is None else search.way(end)


class _Search:
    """Poses that were reached: number, place, heading, level of curvature, the pose before.

    Args:
        ground: What a metre costs.
        to_go: At its nodes.
        goal: x, y [m].
        reach: Distance [m] from it that is near enough.
    """

    def __init__(self, ground: CostMap, to_go: Array, goal: tuple[float, float], reach: float):
        # a border that no way crosses, and plain lists, which are faster to look up one by one
        padded = np.pad(ground.cost, 1, constant_values=np.inf)
        self._cost, self._to_go = padded.tolist(), np.pad(SHORTER * to_go, 1, constant_values=np.inf).tolist()
        self._rows, self._columns = padded.shape
        self._corner, self._cell, self._goal, self._reach = ground.corner, ground.cell, goal, reach
        self._poses: list[tuple[float, float, int, int, int]] = []

    def _node(self, x: float, y: float) -> tuple[int, int]:
        row = int((y - self._corner[1]) / self._cell + 1.5)
        column = int((x - self._corner[0]) / self._cell + 1.5)
        return min(max(row, 0), self._rows - 1), min(max(column, 0), self._columns - 1)

    def run(self, start: tuple[float, float, float], most: int, partial: bool) -> int | None:
        """Number of the pose that reaches the goal."""
        x, y, heading = start
        first = round(heading * HEADINGS / (2.0 * math.pi)) % HEADINGS
        self._poses.append((x, y, first, 0, -1))
        row, column = self._node(x, y)
        waiting = [(self._to_go[row][column], 0.0, 0)]
        done: set[tuple[int, int, int, int]] = set()
        nearest, least = (0, math.inf)
        while waiting and len(done) < most:
            _, spent, number = heapq.heappop(waiting)
            x, y, heading, level, _ = self._poses[number]
            if math.hypot(x - self._goal[0], y - self._goal[1]) <= self._reach:
                return number
            key = (math.floor(x / MERGED[0]), math.floor(y / MERGED[0]), heading // MERGED[1], level)
            if key in done:
                continue
            done.add(key)
            row, column = self._node(x, y)
            if self._to_go[row][column] < least:
                nearest, least = number, self._to_go[row][column]
            self._expand(number, spent, waiting)
        return nearest if partial and nearest else None

    def _expand(self, number: int, spent: float, waiting: list[tuple[float, float, int]]) -> None:
        """Add the poses that follow one, of cost ``spent``, to those that are ``waiting``."""
        x, y, heading, level, _ = self._poses[number]
        arcs, cost = _pieces()[heading], self._cost
        for following in range(max(level - 1, -LEVELS), min(level + 1, LEVELS) + 1):
            places, ends = arcs[following + LEVELS]
            total = 0.0
            for dx, dy in places:
                row, column = self._node(x + dx, y + dy)
                total += cost[row][column]
            if total == math.inf:
                continue
            price = total / POINTS + BEND_COST * abs(following) + CHANGE_COST * (following != level)
            dx, dy = places[-1]
            row, column = self._node(x + dx, y + dy)
            self._poses.append((x + dx, y + dy, ends, following, number))
            here = spent + PIECE * price
            heapq.heappush(waiting, (here + self._to_go[row][column], here, len(self._poses) - 1))

    def way(self, end: int) -> Array:
        """Places (P, 2) [m] of the way to the pose of a number."""
        points: list[tuple[float, float]] = []
        number = end
        while True:
            _, _, _, level, before = self._poses[number]
            if before < 0:
                points.append(self._poses[number][:2])
                return np.array(points[::-1])
            x, y, heading, _, _ = self._poses[before]
            places = _pieces()[heading][level + LEVELS][0]
            points += [(x + dx, y + dy) for dx, dy in reversed(places)]
            number = before
