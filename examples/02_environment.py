"""Eight vehicles in one learning environment, driven by a reference controller.

You learn how to make a vector environment, what it observes, how a policy is called, and how to read an episode's end.
"""

import gymnasium as gym
import numpy as np

import aoro_gym  # noqa: F401  registers the environments
from aoro_gym.agents import reference_policy

envs = gym.make_vec("AORO/Turning-v0", num_envs=8)  # eight twins, one launch a step
print("observations", envs.single_observation_space.shape, "actions", envs.single_action_space.shape)

policy = reference_policy("AORO/Turning-v0", "proportional-derivative", envs)
observations, infos = envs.reset(seed=1)
returns, running = np.zeros(8), np.ones(8, dtype=bool)
while running.any():
    observations, rewards, terminated, truncated, infos = envs.step(policy(observations))
    returns += np.where(running, rewards, 0.0)
    running &= ~(terminated | truncated)
print("return of each vehicle:", returns.round(2))
envs.close()
