"""Words for differences and for the marks of a table."""

import math

import pytest

from aoro_gym.agents.evaluation.metrics import FEWER_EPISODES, LOWER_BOUND, explained, shown, verdict
from aoro_gym.agents.evaluation.statistics import Interval


@pytest.mark.parametrize(
    ("name", "low", "high", "said"),
    [
        ("settling_time_s", -0.2, -0.1, "better"),  # sooner
        ("settling_time_s", 0.1, 0.2, "worse"),
        ("settling_time_s", -0.1, 0.2, ""),
        ("success_rate", 0.1, 0.2, "better"),  # more often
        ("success_rate", -0.2, -0.1, "worse"),
        ("success_rate", 0.0, 0.2, ""),
        ("success_rate", math.nan, math.nan, ""),  # one episode
    ],
)
def test_a_difference_beyond_chance_says_which_way(name, low, high, said):
    assert verdict(name, Interval(0.5 * (low + high), low, high)) == said


@pytest.mark.parametrize(
    ("value", "notes"),
    [
        (Interval(1.0, 0.9, 1.1, 10), []),
        (Interval(1.0, 0.9, 1.1, 10, 2), [LOWER_BOUND]),
        (Interval(1.0, 0.9, 1.1, 7), [FEWER_EPISODES]),
        (Interval(1.0, 0.9, 1.1, 7, 2), [LOWER_BOUND, FEWER_EPISODES]),
    ],
)
def test_a_table_explains_the_marks_that_it_has(value, notes):
    assert explained([["metric (2)", shown(value, "s", total=10)]]) == " ".join(notes)
