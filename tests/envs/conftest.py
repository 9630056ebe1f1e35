"""The environments' tests: ids registered, episodes of a known kind."""

import gymnasium
import pytest

from aoro_gym.envs import register_envs

register_envs()
TURNING = "AORO/Turning-v0"


@pytest.fixture
def turning():
    """A single turning environment."""
    env = gymnasium.make(TURNING)
    yield env
    env.close()
