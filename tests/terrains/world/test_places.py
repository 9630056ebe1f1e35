"""Free places: against every solid object's distance from the machine's outline, and where there is none."""

import numpy as np
import pytest

from aoro_gym.terrains.generate.world import world
from aoro_gym.terrains.terrain import Terrain
from aoro_gym.terrains.world.objects import Branch, Log, Tree, along, upright
from aoro_gym.terrains.world.places import HALF_LENGTH, HALF_WIDTH, free_place
from aoro_gym.terrains.world.world import World

FIELD = Terrain.from_heights(np.zeros((31, 31)), cell=1.0, corner=(-15.0, -15.0))


def tree(x, y):
    return Tree((x, y, 0.0), upright(), "pine", 0.3, 15.0, 8.0, 1.5, 1)


def test_an_empty_field_is_free_in_its_middle():
    branch = Branch((0.0, 0.0, 0.0), along((1, 0, 0)), "pine", 2.0, 0.03)
    assert free_place(World(FIELD, (branch,)))[:2] == pytest.approx((0.0, 0.0), abs=0.5)


def test_no_tree_stands_in_the_outline_of_a_place_in_a_forest():
    made = world(4, size=(40.0, 40.0))
    for near in ((-10.0, 5.0), (8.0, 8.0), None):
        place = free_place(made, near, ahead=1.0)
        turn = np.array([np.cos(place.heading), np.sin(place.heading)])
        for one in made.objects:
            if isinstance(one, Tree) and not one.drivable():
                apart = np.array(one.position[:2]) - (place.x, place.y)
                along_, across = apart @ turn, abs(apart @ np.array([-turn[1], turn[0]]))
                radius = 0.5 * one.diameter
                beside = across > HALF_WIDTH + radius
                assert beside or along_ < -HALF_LENGTH - radius or along_ > HALF_LENGTH + 1.0 + radius


def test_logs_count_over_their_length():
    """A field barred by two logs: the machine stands between them, or along them."""
    bars = tuple(Log((x, -14.0, 0.2), along((0.0, 1.0, 0.0)), "pine", 28.0, 0.2, 0.2, 0.4, 0) for x in (-1.0, 3.0))
    place = free_place(World(FIELD, bars), (0.0, 0.0))
    half = HALF_LENGTH * abs(np.cos(place.heading)) + HALF_WIDTH * abs(np.sin(place.heading))
    assert all(abs(place.x - x) > half + 0.2 for x in (-1.0, 3.0))


def test_a_field_without_room_is_refused():
    everywhere = tuple(tree(x, y) for x in range(-15, 16, 2) for y in range(-15, 16, 2))
    with pytest.raises(ValueError, match=r"full has no place of 5 m x 2\.6 m without objects and 0 m ahead of it"):
        free_place(World(FIELD, everywhere, name="full"))
    with pytest.raises(ValueError, match="and 50 m ahead of it; take a sparser world, or less ahead"):
        free_place(World(FIELD, (tree(0.0, 0.0),)), ahead=50.0)
    assert free_place(World(FIELD, (tree(3.0, 0.0),)), ahead=10.0).heading not in (0.0, np.pi / 8.0)
