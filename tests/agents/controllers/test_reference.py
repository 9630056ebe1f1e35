"""Every environment has reference controllers, by name."""

import doctest
from typing import Any

import gymnasium
import numpy as np
import pytest

import aoro_gym.agents.controllers.reference
from aoro_gym.agents.controllers.reference import REFERENCE_POLICIES, reference_policy
from aoro_gym.agents.training.tuning import STUDIES
from aoro_gym.envs import ENVIRONMENTS, register_envs
from tests.envs.path_tracking.paths import LEVEL

register_envs()


def test_example():
    tried = doctest.testmod(aoro_gym.agents.controllers.reference)
    assert tried.attempted > 0
    assert tried.failed == 0


def test_every_environment_has_controllers_that_were_tuned():
    assert list(REFERENCE_POLICIES) == list(ENVIRONMENTS) == list(STUDIES)
    for environment, policies in REFERENCE_POLICIES.items():
        assert set(policies) == set(STUDIES[environment].controllers)


@pytest.mark.parametrize("environment", REFERENCE_POLICIES)
def test_controllers_act_on_single_and_vector_environments(environment):
    options: dict[str, Any] = {"courses": [LEVEL]} if "Path" in environment else {}
    single: Any = gymnasium.make(environment, **options)
    vector: Any = gymnasium.make_vec(environment, num_envs=2, **options)
    one, many = single.reset(seed=3)[0], vector.reset(seed=3)[0]
    for name in REFERENCE_POLICIES[environment]:
        actions = reference_policy(environment, name, vector)(many)
        assert actions.shape == vector.action_space.shape
        assert vector.action_space.contains(actions)
        np.testing.assert_array_equal(reference_policy(environment, name, single)(one[None])[0], actions[0])


def test_unknown_names_are_named():
    with pytest.raises(ValueError, match="'AORO/Flying-v0' is no environment with reference controllers; choose"):
        reference_policy("AORO/Flying-v0", "stanley", None)
    with pytest.raises(
        ValueError, match="'pid' is no reference controller of AORO/Turning-v0; choose one of: 'bang-ba"
    ):
        reference_policy("AORO/Turning-v0", "pid", None)
