"""The task of the module's docstring, run by the vector environment."""

import textwrap
from typing import Any, NamedTuple

import numpy as np

from aoro_gym.envs.core import task
from aoro_gym.envs.core.vector import TwinVectorEnv


def test_the_task_of_the_docstring_runs():
    assert task.__doc__ is not None
    example = textwrap.dedent(task.__doc__.split("::\n", 1)[1])
    names: dict[str, Any] = {**vars(task), "NamedTuple": NamedTuple, "TwinVectorEnv": TwinVectorEnv}
    exec(example, names)
    envs = names["envs"]
    first, _ = envs.reset(seed=3)
    rewards = np.zeros(2)
    for step in range(50):
        observation, rewards, terminated, truncated, infos = envs.step(np.array([[1.0], [-1.0]]))
        assert not terminated.any()
        assert truncated.all() == truncated.any() == (step == 49)  # 1 s
    assert observation[0, 0] > first[0, 0] and observation[1, 0] < first[1, 0]  # left and right
    np.testing.assert_array_equal(rewards, -np.abs(observation[:, 0]))
    np.testing.assert_array_equal(infos["is_success"], np.abs(observation[:, 0]) < 0.02)
