"""Words for differences."""

import math

import pytest

from aoro_gym.agents.evaluation.metrics import verdict
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
