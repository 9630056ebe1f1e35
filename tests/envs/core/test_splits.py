"""Parts of an environment's courses: none shares a seed with another, and a course is made once."""

import doctest

import pytest

import aoro_gym.envs.core.splits as module
from aoro_gym.envs.core.splits import HELD_OUT, LEARNED, VALIDATED, Splits
from aoro_gym.envs.forest_run import courses as forest_run
from aoro_gym.envs.levelling import courses as levelling
from aoro_gym.envs.limit_tracking import courses as limit_tracking


def test_example():
    tried = doctest.testmod(module)
    assert tried.attempted > 0
    assert tried.failed == 0


@pytest.mark.parametrize("environment", [forest_run, levelling, limit_tracking])
def test_parts_share_no_seed(environment):
    splits = environment.SPLITS
    most = splits.validation_seed  # courses to learn on
    assert most >= LEARNED
    assert splits.validation_seed + VALIDATED <= splits.held_out_seed


def test_a_course_is_made_once_and_parts_have_their_sizes():
    made = []
    splits = Splits(lambda seed, difficulty: made.append(seed) or (seed, difficulty), 0.3, 10, 20)
    for _ in range(2):
        assert [len(part) for part in (splits.learned(), splits.validation(), splits.held_out())] == [
            LEARNED, VALIDATED, HELD_OUT,
        ]  # fmt: skip
    assert sorted(made) == [*range(LEARNED), *range(10, 10 + VALIDATED), *range(20, 20 + HELD_OUT)]
    assert [difficulty for _, difficulty in splits.validation()] == [0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]
    with pytest.raises(ValueError, match=r"courses to learn on is 11, but must be in \[1, 10\]"):
        splits.learned(11)
