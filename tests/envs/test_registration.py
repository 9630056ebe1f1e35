"""Ids are known to Gymnasium, and both of its checkers find nothing."""

import doctest
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import pytest
from gymnasium.utils.env_checker import check_env

import aoro_gym.envs
from aoro_gym.envs import (
    ENVIRONMENTS,
    PathTrackingEnv,
    PathTrackingVectorEnv,
    TurningEnv,
    TurningVectorEnv,
    register_envs,
)

register_envs()
ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("name", list(ENVIRONMENTS))
def test_environment_passes_gymnasiums_checker(name):
    check_env(gymnasium.make(name).unwrapped)


@pytest.mark.parametrize("name", list(ENVIRONMENTS))
def test_environment_passes_the_checker_of_stable_baselines3(name):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(gymnasium.make(name))


def test_both_entry_points_make_the_task():
    assert isinstance(gymnasium.make("AORO/Turning-v0").unwrapped, TurningEnv)
    vector: Any = gymnasium.make_vec("AORO/Turning-v0", num_envs=3)
    assert isinstance(vector, TurningVectorEnv)
    assert vector.num_envs == 3
    assert vector.max_episode_steps == 500
    assert vector.twin.num_twins == 3


def test_path_tracking_says_itself_when_time_is_up():
    vector: Any = gymnasium.make_vec("AORO/PathTracking-v0", num_envs=3)
    assert isinstance(vector, PathTrackingVectorEnv)
    assert vector.max_episode_steps is None
    single: Any = gymnasium.make("AORO/PathTracking-v0")
    assert isinstance(single.unwrapped, PathTrackingEnv)
    assert not any(isinstance(layer, gymnasium.wrappers.TimeLimit) for layer in layers(single))


def layers(env):
    """The environment's wrappers."""
    while isinstance(env, gymnasium.Wrapper):
        yield env
        env = env.env


def test_example_of_the_package():
    tried = doctest.testmod(aoro_gym.envs)
    assert tried.attempted > 0
    assert tried.failed == 0


def test_registering_twice_is_silent():
    register_envs()
    assert gymnasium.spec("AORO/Turning-v0").max_episode_steps == 500


def test_registration_imports_nothing_of_the_twin():
    code = "import sys; from aoro_gym.envs import register_envs; register_envs(); print('warp' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


@pytest.mark.parametrize("name", [name for name in ENVIRONMENTS if "Forest" not in name])  # its lidar needs rays
def test_the_first_step_imports_nothing_that_it_does_not_need(name):
    """What takes long to import stays out of a process that only steps; courses come from the disk."""
    gymnasium.make(name).close()  # so that they are there
    code = f"""
import sys, gymnasium, aoro_gym
env = gymnasium.make({name!r})
env.reset(seed=0)
env.step(env.action_space.sample())
slow = ["torch", "scipy", "trimesh", "matplotlib", "pandas", "PIL", "jinja2", "typer", "aoro_gym.sensors.raytrace"]
print([one for one in slow if one in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_spec_makes_the_environment_again():
    env: Any = gymnasium.make("AORO/Turning-v0", reward_terms={"overshoot": -1.0}, observe_pressures=True)
    assert env.spec is not None
    again: Any = gymnasium.make(env.spec)
    assert again.observation_space == env.observation_space
    assert again.unwrapped.vector.task.reward_terms["overshoot"].weight == -1.0


def test_gymnasiums_own_vectorisation_works_too():
    envs: Any = gymnasium.make_vec("AORO/Turning-v0", num_envs=2, vectorization_mode="sync")
    envs.reset(seed=3)
    observations, *_ = envs.step(envs.action_space.sample())
    assert observations.shape == envs.observation_space.shape
