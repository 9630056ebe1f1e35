"""Ground to level on: the same by its seed, with what is said in its lanes, and held-out lanes that nobody learns on."""

import doctest

import numpy as np
import pytest

import aoro_gym.envs.levelling.courses as levelling_courses
from aoro_gym.envs.levelling.courses import (
    FIRST,
    KINDS,
    LANE_WIDTH,
    SECTION,
    held_out_courses,
    lane_heights,
    learned_courses,
    obstacle_course,
    validation_courses,
)
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.terrains import Terrain

ACROSS = np.arange(-5.0, 5.01, 0.25)
FINE = np.arange(0.0, 40.01, 0.05)


def vertices(course: Course):
    """(V, 3) of its ground."""
    assert isinstance(course.terrain, Terrain)
    return course.terrain.vertices


def test_example():
    tried = doctest.testmod(levelling_courses)
    assert tried.attempted > 0
    assert tried.failed == 0


def test_a_seed_and_a_difficulty_make_one_ground():
    first, again, other, harder = (obstacle_course(*of) for of in ((4, 0.5), (4, 0.5), (5, 0.5), (4, 0.6)))
    np.testing.assert_array_equal(vertices(first), vertices(again))
    np.testing.assert_array_equal(first.paths[2].points, again.paths[2].points)
    for ground in (other, harder):
        assert np.abs(vertices(first)[:, 2] - vertices(ground)[:, 2]).max() > 0.05


def test_machines_start_on_level_ground_and_lanes_keep_apart():
    heights = lane_heights(np.random.default_rng(1), FINE, ACROSS, 1.0)
    # a log that leans reaches out of its section beside the wheels' tracks; of a mound, five widths off, 1e-5 is left
    assert np.all(np.abs(heights[np.ix_(np.abs(ACROSS) <= 1.5, FIRST - 1.0 > FINE)]) < 1e-5)
    assert np.all(heights[np.abs(ACROSS) >= 4.4] == 0.0)
    assert np.abs(heights).max() > 0.2
    paths = obstacle_course(2).paths
    middles = [path.points[:, 1].mean() for path in paths]
    np.testing.assert_allclose(np.diff(middles), LANE_WIDTH, atol=1.0)  # each weaves by up to 0.5 m


@pytest.mark.parametrize(("difficulty", "log", "step", "slope_deg"), [(0.0, 0.10, 0.10, 3.0), (1.0, 0.35, 0.40, 15.0)])
def test_sections_are_as_high_and_as_steep_as_said(difficulty, log, step, slope_deg):
    """The middles of all sections, whatever their order; over many lanes the largest is what is documented."""
    highest, deepest, steepest = 0.0, 0.0, 0.0
    sections = levelling_courses._SECTIONS
    along = np.arange(0.0, SECTION, 0.01)[None]
    for seed in range(8):
        rng = np.random.default_rng(seed)
        ridge = sections["log"](rng, along, np.zeros((1, 1)), difficulty)
        highest = max(highest, float(ridge.max()))
        kerb = sections["step"](rng, along, np.array([[-0.9], [0.9]]), difficulty)
        deepest = max(deepest, float(np.abs(kerb).max()))
        side = sections["side slope"](rng, along, np.array([[-1.0], [1.0]]), difficulty)
        steepest = max(steepest, float(np.abs(side[1] - side[0]).max() / 2.0))
    # a ridge is sampled every 0.01 m of its 0.6 m: (π/2 · 0.01/0.6)² / 4 of its height at most is missed
    assert highest == pytest.approx(log, rel=2e-4)
    assert deepest == pytest.approx(step, rel=1e-12)
    assert np.degrees(np.arctan(steepest)) == pytest.approx(slope_deg, rel=1e-9)
    assert tuple(sections) == KINDS


def test_two_hundred_lanes_are_held_out():
    held_out = held_out_courses()
    assert sum(len(course.paths) for course in held_out) >= 200
    everything = (*learned_courses(), *validation_courses(), *held_out)
    assert len({course.name for course in everything}) == len(everything)
    assert len({vertices(course).tobytes() for course in everything}) == len(everything)


def test_difficulties_and_seeds_are_checked():
    with pytest.raises(ValueError, match=r"difficulty is 1.2, but must be in \[0, 1\]"):
        obstacle_course(1, 1.2)
    with pytest.raises(ValueError, match="seed is -1"):
        obstacle_course(-1)
    with pytest.raises(ValueError, match=r"courses to learn on is 501, but must be in \[1, 500\]"):
        learned_courses(501)
