"""What it costs a machine to be at each place of a world: how far away is what stops it, what it drives over, where it is
wet and steep.

A map from the world's truth: it knows every object. Limits and prices are estimated (E).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from aoro_gym.checks import check_range
from aoro_gym.terrains.heights import sample_triangles
from aoro_gym.terrains.world.materials import Surface
from aoro_gym.terrains.world.objects import is_solid
from aoro_gym.terrains.world.places import circles
from aoro_gym.terrains.world.world import World

Array = NDArray[np.float64]
CELL = 0.5
"""Distance [m] of the nodes."""
DRIVEN_OVER = 0.35
"""Height [m] of objects that tires of 0.6 m radius still roll over at a walk; higher ones count as stopping the machine.
(E)"""
HALF_WIDTH = 1.25
"""Of the machine over its tires [m]."""
EDGE = 4.0
"""Distance [m] from the end of the ground within which no machine's middle should be."""
OVER_OBJECT, WET, STEEP = 1.5, 1.5, 4.0
"""What a metre costs besides its length: over what is low enough, over wet ground, and a unit of slope. (E)"""
NEAR = 1.5
"""What a metre costs besides, at the least room to an obstacle; it falls to nothing at :data:`WIDE` more."""
WIDE = 1.5
"""[m]"""


@dataclass(frozen=True, eq=False)
class Traversability:
    """A grid over a world; row 0 in the south, column 0 in the west."""

    corner: tuple[float, float]
    """x, y [m] of the first node."""
    room: Array
    """(rows, columns) distance [m] to the nearest edge of what stops a machine, the end of the ground included; below 0
    inside of it."""
    price: Array
    """(rows, columns) what a metre costs there for its ground alone, from 1."""
    cell: float = CELL
    """Distance [m] of neighbouring nodes."""

    def node(self, xy: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows and columns of the nodes nearest to places (..., 2) [m], at most those at the edge."""
        place = np.rint((np.asarray(xy) - self.corner) / self.cell).astype(np.intp)
        rows, columns = self.room.shape
        return np.clip(place[..., 1], 0, rows - 1), np.clip(place[..., 0], 0, columns - 1)

    def places(self, nodes: NDArray[np.intp]) -> Array:
        """x, y [m] (K, 2) of nodes, rows and columns (K, 2)."""
        return np.asarray(self.corner, dtype=np.float64) + self.cell * nodes[:, ::-1].astype(np.float64)

    def cost(self, least_room: float) -> Array:
        """(rows, columns) what a metre costs a machine whose middle keeps ``least_room`` [m] from all that stops it;
        infinite where it does not."""
        check_range("least_room", least_room, "m", ge=0.0)
        spare = self.room - least_room
        return np.asarray(self.price + np.where(spare >= 0.0, nearness(spare), np.inf), dtype=np.float64)


def nearness(spare: Array) -> Array:
    """What a metre costs for being near to an obstacle, with so much room to ``spare`` [m] (...)."""
    return NEAR * np.clip(1.0 - spare / WIDE, 0.0, 1.0) ** 2


def traversability(world: World) -> Traversability:
    """That of a world."""
    terrain = world.terrain
    heights = sample_triangles(terrain.vertices, terrain.faces, CELL)[0]
    rows, columns = heights.z.shape
    x = heights.corner[0] + CELL * np.arange(columns)
    y = heights.corner[1] + CELL * np.arange(rows)
    solid = [one for one in world.objects if is_solid(one)]
    low = [one for one in solid if one.drivable(DRIVEN_OVER)]
    high = [one for one in solid if not one.drivable(DRIVEN_OVER)]
    ends = np.minimum(
        np.minimum(x - x[0], x[-1] - x)[None],
        np.minimum(y - y[0], y[-1] - y)[:, None],
    )
    room = np.minimum(_apart(replace(world, objects=tuple(high)), x, y), ends - (EDGE - HALF_WIDTH))
    room = np.where(heights.known, room, -1.0)
    over = _apart(replace(world, objects=tuple(low)), x, y) <= HALF_WIDTH
    slope = np.hypot(*np.gradient(np.where(heights.known, heights.z, 0.0), CELL))
    wet = np.zeros((rows, columns), dtype=bool)
    if world.ground is not None:
        middles = terrain.vertices[terrain.faces[world.ground == Surface.WET_SOIL]].mean(axis=1)
        at = np.rint((middles[:, :2] - heights.corner) / CELL).astype(np.intp)
        wet[np.clip(at[:, 1], 0, rows - 1), np.clip(at[:, 0], 0, columns - 1)] = True
    price = 1.0 + OVER_OBJECT * over + WET * wet + STEEP * slope
    return Traversability(heights.corner, room, np.asarray(price, dtype=np.float64))


BLOCK = 12
"""Nodes along the side of a block whose nearest objects are looked for together."""


def _apart(world: World, x: Array, y: Array) -> Array:
    """Distance [m] (rows, columns) of nodes to the nearest edge of a solid object; below 0 inside of it."""
    found = np.full((len(y), len(x)), np.inf)
    solid = circles(world)
    if not len(solid):
        return found
    for row in range(0, len(y), BLOCK):
        for column in range(0, len(x), BLOCK):
            here = x[column : column + BLOCK], y[row : row + BLOCK]
            middle_x, middle_y, radius = _nearest(solid, *here).T
            away = np.hypot(here[1][:, None, None] - middle_y, here[0][None, :, None] - middle_x) - radius
            found[row : row + BLOCK, column : column + BLOCK] = away.min(axis=-1)
    return found


def _nearest(solid: Array, x: Array, y: Array) -> Array:
    """Of circles (K, 3), those that may be the nearest one to a node of a block: by more than the block's diagonal no node's
    distance to a circle differs from its middle's."""
    away = np.hypot(0.5 * (x[0] + x[-1]) - solid[:, 0], 0.5 * (y[0] + y[-1]) - solid[:, 1]) - solid[:, 2]
    return solid[away <= away.min() + np.hypot(x[-1] - x[0], y[-1] - y[0]) + 1e-6]
