"""A lidar's odometry on a drive through a made forest, beside the true path.

You learn how a world gets a way that is kept free, how a drive becomes sweeps of a lidar, and how well KISS-ICP (Vizzo and
others 2023, IEEE Robotics and Automation Letters 8), which sees nothing but the points, finds the way back from them. It
needs ``pip install 'aoro-gym[odometry]'`` and a few minutes. One turn in eight of a lidar that turns 20 times a second is
read: one every 0.3 m.
"""

from dataclasses import replace
from typing import Any

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np

import aoro_gym  # noqa: F401  registers the environments
from aoro_gym.agents import reference_policy
from aoro_gym.sensors.attitude import in_world
from aoro_gym.sensors.lidar import MODELS, Lidar, Motion
from aoro_gym.sensors.raytrace import Scene
from aoro_gym.terrains.generate.forest import forest
from aoro_gym.terrains.generate.world import populate
from aoro_gym.terrains.paths.planning import drivable_ground

try:
    from kiss_icp.config.parser import KISSConfig  # pyright: ignore[reportMissingImports]
    from kiss_icp.kiss_icp import KissICP  # pyright: ignore[reportMissingImports]
except ImportError:
    raise SystemExit("this example needs kiss-icp: pip install 'aoro-gym[odometry]'") from None

LENGTH, PERIOD, STEP = 105.0, 0.4, 0.05  # of the path [m], between sweeps and of a control step [s]

ground = forest(4, size=(120.0, 60.0), boulders=0.0, stumps=0.0, trees=0.0)
path = drivable_ground(ground.terrain).path(1, length=LENGTH)
world = populate(ground.terrain, 4, clear=[(path, 3.0)])

env = gym.make_vec("AORO/PathTracking-v0", num_envs=1, terrain=world.terrain, path=path)
policy = reference_policy("AORO/PathTracking-v0", "preview", env)
vehicle: Any = env.unwrapped
observations, _ = env.reset(seed=0)
names = ("position_x", "position_y", "position_z", "roll", "pitch", "yaw")
poses, ended = [], False
while not ended:
    observations, _, terminated, truncated, _ = env.step(policy(observations))
    poses.append([vehicle.output(name)[0] for name in names])
    ended = bool(terminated[0] or truncated[0])
poses = np.array(poses, dtype=np.float64)
motion = Motion(np.arange(len(poses), dtype=np.float64) * STEP, poses[:, :3], *poses[:, 3:].T)

model = replace(MODELS["vlp-16"], rate=20.0, columns=904)
lidar = Lidar(Scene.of_world(world), model, subrays=1)
config = KISSConfig()
config.data.max_range, config.data.min_range = 80.0, 2.0
config.data.deskew = False  # it takes turns to follow each other without a break
config.mapping.voxel_size = 0.8  # [m] a hundredth of the range, as its authors take it
odometry, found = KissICP(config), []
starts = PERIOD * np.arange(int((motion.time[-1] - 1.0 / model.rate) / PERIOD))
for number, start in enumerate(starts):
    [seen] = lidar.sweep(motion, start=start, number=number)
    odometry.register_frame(seen.points.astype(np.float64), seen.time * model.rate)
    found.append(odometry.last_pose[:3, 3].copy())
found = np.array(found)

# the sensor's true places at the ends of sweeps, in the axes of the sensor at the first one's
at = starts + 1.0 / model.rate
x, y, z, roll, pitch, yaw = (np.interp(at, motion.time, column) for column in poses.T)
sensor = np.column_stack([x, y, z]) + in_world(roll, pitch, yaw, np.array(lidar.mounting.position))
axes = in_world(roll[0], pitch[0], yaw[0], np.eye(3))  # rows: x, y and z of the first front frame
true = (sensor - sensor[0]) @ axes.T
driven = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(true, axis=0), axis=1))])
error = np.linalg.norm(found - true, axis=1)
print(f"{len(found)} sweeps over {driven[-1]:.0f} m: off by at most {error.max():.2f} m, {error[-1]:.2f} m at the end")

figure, (plan, drift) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
plan.plot(*true[:, :2].T, color="0.6", linewidth=4)  # grey: true
plan.plot(*found[:, :2].T, color="tab:red", linewidth=1)
plan.set(aspect="equal", xlabel="x of the first sensor [m]", ylabel="y [m]")
drift.plot(driven, 100.0 * error, color="tab:red")
drift.set(xlabel="way driven [m]", ylabel="error [cm]", ylim=(0, None))
figure.savefig("odometry.png", dpi=110)
