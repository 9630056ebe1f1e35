"""Serpentines over hills: the same by their seed, as steep and as tight as said; those that are held out are others."""

import doctest
import math

import numpy as np
import pytest

import aoro_gym.envs.limit_tracking.courses as limit_courses
from aoro_gym.agents.controllers.path_tracking import turn_curvature
from aoro_gym.envs.core.splits import HELD_OUT
from aoro_gym.envs.limit_tracking.courses import (
    RAMP,
    SPLITS,
    STEEPEST,
    TIGHTEST,
    hilly_course,
    learned_courses,
    serpentine,
    validation_courses,
)
from aoro_gym.envs.path_tracking.courses import HeightMap
from aoro_gym.terrains import Terrain


def test_example():
    tried = doctest.testmod(limit_courses)
    assert tried.attempted > 0
    assert tried.failed == 0


def test_a_seed_and_a_difficulty_make_one_course():
    first, again, other = (hilly_course(*of) for of in ((4, 0.5), (4, 0.5), (5, 0.5)))
    assert isinstance(first.terrain, Terrain) and isinstance(again.terrain, Terrain)
    np.testing.assert_array_equal(first.terrain.vertices, again.terrain.vertices)
    np.testing.assert_array_equal(first.paths[2].points, again.paths[2].points)
    assert np.abs(first.paths[2].points - other.paths[2].points).max() > 1.0
    with pytest.raises(ValueError, match=r"difficulty is 1\.1"):
        hilly_course(1, 1.1)


@pytest.mark.parametrize("difficulty", [0.0, 1.0])
def test_ground_is_as_steep_and_paths_as_tight_as_said(difficulty):
    end = int(difficulty)
    course = hilly_course(7, difficulty)
    heights = HeightMap([course.terrain])
    # over 4 m the roughness, waves of at most 4 m, is 1.2 cm rms: less than 2° in a difference of four deviations
    apart = np.arange(-30.0, 30.0, 1.0)
    x, y = (axis.ravel() for axis in np.meshgrid(apart, apart))
    places, ahead = np.stack([x, y], axis=1), 2.0 * np.eye(2)
    rise = [heights.height(0, places + way) - heights.height(0, places - way) for way in ahead]
    steepest = math.degrees(math.atan(np.hypot(*rise).max() / 4.0))
    assert STEEPEST[end] - 4.0 < steepest < STEEPEST[end] + 2.0
    for path in course.paths:
        corners = np.diff(np.unwrap(np.arctan2(*np.diff(path.points, axis=0).T[::-1]))) / 0.25
        assert np.abs(corners).max() == pytest.approx(TIGHTEST[end], rel=0.02)
        assert np.all(heights.known(np.zeros(len(path.points), dtype=int), path.points))


def test_bends_begin_over_the_ramp_and_the_machine_can_turn_tighter():
    curvature = serpentine(np.random.default_rng(3), 1.0)
    change = np.abs(np.diff(curvature)) / 0.25
    assert change.max() == pytest.approx(TIGHTEST[1] / RAMP[1], rel=1e-9)
    assert turn_curvature(math.radians(40.0), 1.7, 1.7) > 1.1 * TIGHTEST[1]
    assert not curvature[: int(4.5 / 0.25)].any()  # where machines start


def test_nobody_learns_on_what_is_held_out():
    seeds = (0, SPLITS.validation_seed)
    learned, validated = learned_courses(2), validation_courses()
    assert [course.name.split(",")[0] for course in (learned[0], validated[0])] == [f"hills {seed}" for seed in seeds]
    assert HELD_OUT * limit_courses.PATHS == 200
