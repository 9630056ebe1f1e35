"""Rollouts are what the episodes then do: the same task, kernels and state."""

import doctest
from typing import Any

import gymnasium
import numpy as np
import pytest

import aoro_gym.envs.core.rollouts
from aoro_gym.envs import register_envs
from aoro_gym.envs.core.rollouts import DIVERGED, Rollouts
from aoro_gym.envs.path_tracking.config import PathTrackingConfig
from aoro_gym.machine import Machine
from tests.envs.path_tracking.paths import LEVEL

register_envs()


def made(environment: str, **arguments: Any) -> Any:
    options: dict[str, Any] = {} if "Turning" in environment else {"courses": [LEVEL]}
    vector: Any = gymnasium.make_vec(environment, num_envs=2, autoreset_mode="Disabled", **options, **arguments)
    return vector.unwrapped


def test_example():
    tried = doctest.testmod(aoro_gym.envs.core.rollouts)
    assert tried.attempted > 0
    assert tried.failed == 0


@pytest.mark.parametrize(
    ("environment", "arguments"),
    [
        ("AORO/Turning-v0", {}),
        ("AORO/Turning-v0", {"kernels": False}),
        ("AORO/PathTracking-v0", {}),
        ("AORO/PathTracking-v0", {"kernels": False, "gear": "automatic"}),
        ("AORO/PathTracking-v1", {}),
        ("AORO/Levelling-v0", {}),
    ],
)
def test_copies_do_what_the_episodes_then_do(environment, arguments):
    """To the bit: the same operations on the same numbers, those of noise included."""
    env, generator = made(environment, **arguments), np.random.default_rng(0)
    env.reset(seed=3)
    acts = env.single_action_space.shape[0]
    for _ in range(10):
        env.step(generator.uniform(0.0, 1.0, (2, acts)).astype(np.float32))
    tried = Rollouts(env, 2)
    for _ in range(2):  # what was tried before leaves nothing behind
        tried.load(env)
        actions = generator.uniform(-1.0, 1.0, (10, 2, 2, acts)).astype(np.float32)
        found = [tried.step(each.reshape(4, acts)) for each in actions]
        then = [env.step(each[:, 0]) for each in actions]
        for (rewards, ended), (_, reward, terminated, _, _) in zip(found, then, strict=True):
            np.testing.assert_array_equal(rewards.reshape(2, 2)[:, 0], reward)
            np.testing.assert_array_equal(ended.reshape(2, 2)[:, 0], terminated)
        assert np.all(found[-1][0].reshape(2, 2)[:, 1] != then[-1][1])


def test_episodes_of_another_machine_go_on_with_the_machine_of_the_copies():
    heavier = Machine.load("aoro").scale({"frame.front.mass": 1.2})
    light, heavy = made("AORO/PathTracking-v0"), made("AORO/PathTracking-v0", machine=heavier)
    heavy.reset(seed=3)
    tried = Rollouts(light, 2), Rollouts(heavy, 2)
    for each in tried:
        each.load(heavy)
        np.testing.assert_array_equal(each._env.twin.state.numpy()[:, ::2], heavy.twin.state.numpy())
    forward = np.tile(np.array([0.0, 0.8], dtype=np.float32), (4, 1))
    then = np.array([heavy.step(forward[::2])[1] for _ in range(20)])
    by_light, by_heavy = (np.array([each.step(forward)[0][::2] for _ in range(20)]) for each in tried)
    np.testing.assert_array_equal(by_heavy, then)
    assert np.all(by_light[-1] != then[-1])
    with pytest.raises(ValueError, match=r"are not of 2 and 4 sub-environments"):
        tried[0].load(made("AORO/PathTracking-v0", config=PathTrackingConfig(action_memory=3)))


def test_copies_go_on_beyond_the_end_and_divergence_costs_most():
    env = made("AORO/PathTracking-v0")
    env.reset(seed=3, options={"start": LEVEL.paths[0].length - 2.0, "path": 0})
    tried = Rollouts(env, 2)
    tried.load(env)
    forward = np.tile(np.array([0.0, 0.9], dtype=np.float32), (4, 1))
    ended = np.array([tried.step(forward)[1] for _ in range(80)])
    assert np.all(ended.any(axis=0))  # the path's end
    tried._env.twin.state.numpy()[0, 1] = np.nan
    rewards, ended = tried.step(forward)
    assert rewards[1] == DIVERGED and ended[1]
    assert np.all(np.delete(rewards, 1) > DIVERGED)
    with pytest.raises(ValueError, match="copies is 1"):
        Rollouts(env, 1)


@pytest.mark.parametrize("output", ["numpy", "torch"])
def test_returns_are_sums_of_rewards_until_the_end(output):
    """To the bit, whether an episode ends meanwhile, a twin diverges, or neither."""
    env = made("AORO/PathTracking-v0", output=output)
    env.reset(seed=3, options={"start": LEVEL.paths[0].length - 2.0, "path": 0})
    tried = Rollouts(env, 2)
    actions = np.tile(np.array([0.0, 0.9], dtype=np.float32), (4, 80, 1))
    actions[2] = 0.0  # stands
    tried.load(env)
    ended = np.any([tried.step(each)[1] for each in np.moveaxis(actions, 1, 0)], axis=0)
    assert ended.tolist() == [True, True, False, True]
    found = []
    for whole in (True, False):
        tried.load(env)
        tried._env.twin.state.numpy()[0, 1] = np.nan
        found.append(tried.returns(actions) if whole else tried._returns_of_steps(np.moveaxis(actions, 1, 0)))
    np.testing.assert_array_equal(*found)
    assert found[0][1] == DIVERGED
