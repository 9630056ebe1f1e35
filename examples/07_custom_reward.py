"""A reward of your own, beside those that there are.

You learn what a reward term is, how its weight is set, how others are changed or left out, and that each is logged by name.
"""

import gymnasium as gym
import numpy as np

import aoro_gym  # noqa: F401  registers the environments


def haste(view):
    """Share of the largest joint rate seen, squared: a term gets what the task sees, and gives a number a vehicle."""
    return -((view.measured_rate / 0.8) ** 2)


envs = gym.make_vec("AORO/Turning-v0", num_envs=4, reward_terms={"haste": (0.5, haste), "overshoot": -5.0})
envs.reset(seed=1)
sums: dict[str, float] = {}
for _ in range(100):
    *_, infos = envs.step(np.ones((4, 1), dtype=np.float32))
    for name, value in infos.items():
        if name.startswith("reward/"):
            sums[name] = sums.get(name, 0.0) + float(np.mean(value))
for name, value in sums.items():
    print(f"{name:24} {value:8.3f}")
envs.close()
