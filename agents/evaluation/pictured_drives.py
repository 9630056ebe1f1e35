"""Drives along which a data set's pictures are taken: the twin, steered by pure pursuit along a path."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from aoro_gym.agents.controllers.path_tracking import PurePursuit, Vehicle
from aoro_gym.agents.evaluation.drives import drive_to_ends
from aoro_gym.envs.path_tracking.courses import Course, generated_paths
from aoro_gym.envs.path_tracking.environment import PathTrackingVectorEnv
from aoro_gym.recording.commands import WHEELS
from aoro_gym.sensors.dataset.drives import Drive
from aoro_gym.sensors.lidar import Motion
from aoro_gym.terrains import Path
from aoro_gym.terrains.world.world import World

POSTURE = ("joint_angle", *(f"{part}_{wheel}" for part in ("arm", "wheel") for wheel in WHEELS))
"""Of a drive that the machine's posture is made of."""
CHANNELS = ("time", "x", "y", "z", "roll", "pitch", "yaw", *POSTURE)
"""Of a drive that a sensor's motion is made of, and that."""
LENGTHS = (40.0, 25.0, 15.0)
"""[m] of a path that is planned where none is given: the longest one that there is room for."""


def drive_along(world: World, path: Path | None, seed: int, tell: Callable[[float], Any] = lambda share: None) -> Drive:
    """Drive once along a path through a world, to its end or to where the drive ends.

    Args:
        world: Its ground, and what is solid on it.
        path: To follow; None: one is planned that keeps clear of what is solid.
        seed: Of the path that is planned, and of the sensors by which the controller steers.
        tell: Called with the share that is done.

    Raises ``ValueError`` where there is no room for a path, or the given one is too short.
    """
    ground = world if world.objects else world.terrain
    course = Course.over(ground, (planned(world, seed) if path is None else path,))
    env = PathTrackingVectorEnv(1, courses=(course,), autoreset_mode="Disabled")
    try:
        drives = drive_to_ends(
            env, PurePursuit(Vehicle.of(env)), {"seed": [seed]}, tell, channels=CHANNELS, last=("is_success",)
        )
    finally:
        env.close()
    rows = {name: values[0, : 1 + int(drives.steps[0])] for name, values in drives.data.items()}
    position = np.column_stack([rows[axis] for axis in "xyz"])
    motion = Motion(rows["time"] - rows["time"][0], position, rows["roll"], rows["pitch"], rows["yaw"])
    posture = np.column_stack([rows[name] for name in POSTURE])
    return Drive(motion, course.paths[0].points, drives.endings[0], posture)


def planned(world: World, seed: int) -> Path:
    """A drivable path through a world, always the same."""
    ground = world if world.objects else world.terrain
    for length in LENGTHS:
        try:
            return generated_paths(ground, 1, length, seed)[0]
        except ValueError:
            if length == LENGTHS[-1]:
                raise
    raise AssertionError
