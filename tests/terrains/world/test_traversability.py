"""What it costs to be somewhere: room to what stops, prices of the ground."""

import numpy as np
import pytest

from aoro_gym.terrains import Terrain
from aoro_gym.terrains.world.materials import Surface
from aoro_gym.terrains.world.objects import Boulder, Log, Stump, Tree, along, upright
from aoro_gym.terrains.world.traversability import (
    DRIVEN_OVER,
    EDGE,
    HALF_WIDTH,
    NEAR,
    OVER_OBJECT,
    STEEP,
    WET,
    WIDE,
    traversability,
)
from aoro_gym.terrains.world.world import World

SIDE = 20.0


def field(slope=0.0):
    x = np.arange(-SIDE, SIDE + 0.5, 0.5)
    return Terrain.from_heights(np.tile(slope * x, (len(x), 1)), cell=0.5, corner=(-SIDE, -SIDE))


def at(values, ground, x, y):
    row, column = ground.node(np.array([x, y]))
    return values[row, column]


def test_room_is_the_distance_to_what_stops_a_machine():
    pine = Tree((5.0, 0.0, 0.0), upright(), "pine", 0.3, 16.0, 9.0, 1.5, 1)
    low = Stump((-5.0, 0.0, 0.0), upright(), "pine", 0.2, 0.3)
    high = Boulder((0.0, 8.0, 0.0), upright(), (0.8, 0.8, 0.8), 0.8, 1)
    ground = traversability(World(field(), (pine, low, high)))
    # a stem counts by three quarters of its diameter at breast height, for its butt swell
    assert at(ground.room, ground, 0.0, 0.0) == pytest.approx(5.0 - 0.225)
    assert at(ground.room, ground, 0.0, 5.0) == pytest.approx(3.0 - 0.8)
    assert at(ground.room, ground, 5.0, 0.0) < 0.0
    assert at(ground.room, ground, -5.0, 0.0) > 5.0  # driven over
    assert at(ground.room, ground, SIDE - 4.0, -12.0) == pytest.approx(4.0 - (EDGE - HALF_WIDTH))


def test_room_is_that_of_the_nearest_of_all_objects():
    """To the bit: of 40 stones of 0.2 m to 3 m at random, each compared with each node."""
    rng = np.random.default_rng(5)
    places, sizes = rng.uniform(-18.0, 18.0, (40, 2)), rng.uniform(0.2, 3.0, 40)
    stones = [
        Boulder((x, y, 0.0), upright(), (size, size, size), size, 1) for (x, y), size in zip(places, sizes, strict=True)
    ]
    high = [stone for stone in stones if not stone.drivable(DRIVEN_OVER)]
    ground = traversability(World(field(), tuple(stones)))
    x = y = np.arange(-SIDE, SIDE + 0.25, 0.5)
    room = np.minimum(SIDE - np.abs(x)[None], SIDE - np.abs(y)[:, None]) - (EDGE - HALF_WIDTH)
    for stone in high:
        away = np.hypot((y - stone.position[1])[:, None], (x - stone.position[0])[None]) - stone.half_axes[0]
        room = np.minimum(room, away)
    assert len(high) > 30
    np.testing.assert_array_equal(ground.room, room)


def test_what_is_driven_over_is_wet_or_is_steep_costs():
    log = Log((0.0, -2.0, 0.15), along((0.0, 1.0, 0.0)), "pine", 4.0, 0.15, 0.15, 0.3, 0)
    terrain = field(slope=0.1)
    surfaces = np.full(len(terrain.faces), Surface.FOREST_FLOOR, dtype=np.uint8)
    surfaces[terrain.vertices[terrain.faces].mean(axis=1)[:, 0] < -10.0] = Surface.WET_SOIL
    ground = traversability(World(terrain, (log,), surfaces))
    plain = 1.0 + STEEP * 0.1
    for x, price in ((5.0, plain), (0.0, plain + OVER_OBJECT), (-15.0, plain + WET)):
        assert at(ground.price, ground, x, 0.0) == pytest.approx(price, rel=1e-6)


def test_costs_rise_towards_obstacles_and_end_before_them():
    pine = Tree((0.0, 0.0, 0.0), upright(), "pine", 0.2, 16.0, 9.0, 1.5, 1)
    ground = traversability(World(field(), (pine,)))
    cost = ground.cost(1.5)
    line = [at(cost, ground, x, 0.0) for x in np.arange(1.0, 8.0, 0.5)]
    assert np.isinf(line[0]) and line[-1] == 1.0
    known = np.array(line)[np.isfinite(line)]
    assert np.all(np.diff(known) <= 0.0)
    # the node at 2 m has 0.35 m to spare: 0.15 m of the stem, 1.5 m of the machine
    assert known[0] == pytest.approx(1.0 + NEAR * (1.0 - 0.35 / WIDE) ** 2)
    assert at(cost, ground, 0.0, 1.5 + WIDE + 1.0) == 1.0
    with pytest.raises(ValueError, match="least_room is -1 m, but must be"):
        ground.cost(-1.0)
