"""Courses of forest runs: routes that a machine can drive, the same again, held-out ones apart."""

import doctest

import numpy as np
import pytest

from aoro_gym.envs.forest_run import courses, growing
from aoro_gym.envs.forest_run.courses import forest_run_course, held_out_courses
from aoro_gym.envs.forest_run.growing import ROOM, RUNS, STAND, routes
from aoro_gym.terrains.paths.pose_search import TIGHTEST
from aoro_gym.terrains.world.objects import is_solid
from aoro_gym.terrains.world.places import circles, stands_free
from aoro_gym.terrains.world.traversability import CELL, DRIVEN_OVER
from aoro_gym.terrains.world.world import World

EASY = 0.2


def stopping(world):
    """Circles of what stops a machine."""
    objects = tuple(one for one in world.objects if is_solid(one) and not one.drivable(DRIVEN_OVER))
    return circles(World(world.terrain, objects))


def check(course):
    solid = stopping(course.world)
    low, high = course.world.terrain.extent
    assert len(course.paths) == RUNS
    for path in course.paths:
        at = np.arange(STAND, path.length, 0.1)
        places = path.position(at)
        apart = np.hypot(*(places[:, None] - solid[:, :2]).transpose(2, 0, 1)) - solid[:, 2]
        # room is known at nodes, up to half a cell's diagonal from a place
        assert apart.min() > ROOM - 0.71 * CELL
        heading = np.unwrap(path.heading(at))
        assert np.abs(heading[10:] - heading[:-10]).max() < 1.2 / TIGHTEST  # over a metre
        assert np.all((places > low[:2]) & (places < high[:2]))
        start = float(path.heading(STAND))
        hinge = path.position(STAND) - 1.7 * np.array([np.cos(start), np.sin(start)])
        assert stands_free(circles(course.world), hinge[None], np.array([start]), np.zeros(1))[0]


def test_example():
    tried = doctest.testmod(courses)
    assert tried.attempted > 0 and tried.failed == 0


def test_routes_can_be_driven():
    check(forest_run_course(0, EASY))


def test_the_same_seed_makes_the_same_course(monkeypatch):
    kept = forest_run_course(0, EASY)
    monkeypatch.setenv("AORO_GYM_CACHE", "off")
    made = forest_run_course(0, EASY)
    assert made.world is not None and kept.world is not None
    assert made.name == kept.name and made.world.name == kept.world.name
    assert made.world.objects == kept.world.objects
    np.testing.assert_array_equal(made.world.ground, kept.world.ground)
    np.testing.assert_array_equal(made.world.terrain.vertices, kept.world.terrain.vertices)
    np.testing.assert_array_equal(made.world.terrain.friction, kept.world.terrain.friction)
    for one, other in zip(made.paths, kept.paths, strict=True):
        np.testing.assert_array_equal(one.points, other.points)


def test_difficult_worlds_are_denser_and_goals_farther():
    counts = [growing.grown_world(3, share).counts["tree"] for share in (0.0, 1.0)]
    # 0.41 ha, of which a tree's place may be taken
    assert 0.8 * 41 <= counts[0] <= 42 and 0.8 * 123 <= counts[1] <= 124


def test_worlds_without_room_are_named():
    crowded = growing.world(1, ground=growing.GROUND, size=growing.SIZE, stand="pine", stems=2500.0, strip_roads=0.0)
    with pytest.raises(
        ValueError, match="world 1 of difficulty 1 has 0 routes, but 5 are asked for; take another seed"
    ):
        routes(crowded, 1, 1.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [((-1, 0.5), "seed is -1, but must be"), ((1, 1.5), r"difficulty is 1\.5, but must be")],
)
def test_what_is_wrong_is_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        forest_run_course(*arguments)


@pytest.mark.slow
def test_all_held_out_courses_can_be_driven():
    made = held_out_courses()
    assert sum(len(course.paths) for course in made) == 200
    for course in made:
        check(course)
