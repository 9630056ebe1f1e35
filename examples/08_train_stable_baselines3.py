"""Train with Stable-Baselines3 yourself: twins of one launch as its vector environment.

You learn how the environments are handed to SB3, and how a learned policy is run. ``aoro-gym train`` does the same with
tuned hyper-parameters, evaluations, checkpoints that go on after a kill, and seeds. Needs the part ``agents``. A training
takes 200,000 steps and more; ``STEPS`` is what shows that it runs.
"""

import numpy as np
from stable_baselines3 import PPO

from aoro_gym.agents import make_vec_env

STEPS = 1_024

envs = make_vec_env("AORO/Turning-v0", 8)
model = PPO("MlpPolicy", envs, n_steps=64, batch_size=256, seed=1, device="cpu")
model.learn(STEPS)
model.save("turning.zip")

observations = np.asarray(envs.reset())
rewards = []
for _ in range(200):
    actions, _ = model.predict(observations, deterministic=True)
    observed, reward, done, infos = envs.step(actions)
    observations = np.asarray(observed)
    rewards.append(reward)
print(f"mean reward of a step after {STEPS} steps of learning: {np.mean(rewards):.4f}")
envs.close()
