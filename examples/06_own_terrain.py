"""Ground of your own, and a path over it that a controller follows.

You learn how heights become a terrain, how a path is made, and how an environment drives there. With a scan instead:
``terrain, report = aoro_gym.terrains.load("scan.laz")``.
"""

import gymnasium as gym
import numpy as np

import aoro_gym  # noqa: F401  registers the environments
from aoro_gym.agents import reference_policy
from aoro_gym.terrains import Path, Terrain

x, y = np.meshgrid(np.arange(-20.0, 20.1, 0.5), np.arange(-20.0, 20.1, 0.5))
terrain = Terrain.from_heights(0.15 * np.sin(0.8 * x) * np.cos(0.6 * y), cell=0.5, corner=(-20.0, -20.0), friction=0.8)
along = np.linspace(-12.0, 12.0, 49)
path = Path(np.column_stack([along, 2.5 * np.sin(0.25 * along)]), name="slalom")

env = gym.make_vec("AORO/PathTracking-v0", num_envs=1, terrain=terrain, path=path)
policy = reference_policy("AORO/PathTracking-v0", "preview", env)
observations, infos = env.reset(seed=3)
errors, ended = [], False
while not ended:
    observations, rewards, terminated, truncated, infos = env.step(policy(observations))
    errors.append(infos["cross_track"][0])  # [m]
    ended = bool(terminated[0] or truncated[0])
rms = float(np.sqrt(np.mean(np.square(errors))))
arrived = bool(infos["is_success"][0])
print(
    f"cross-track error: {rms:.3f} m rms, {'arrived' if arrived else 'did not arrive'} after {0.05 * len(errors):.0f} s"
)
env.close()
