"""Pictures of a forest run: those of path tracking, with the route that is known to exist in place of a path."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aoro_gym.envs.path_tracking.rendering.scene import SIZE, PathTrackingScene
from aoro_gym.envs.path_tracking.task import PathTracking
from aoro_gym.machine import Machine


class ForestRunScene:
    """View from behind, map, readings and strips of the drive.

    Args:
        machine: That is drawn.
        driving: The machine with its sensors, on the routes.
    """

    size = SIZE

    def __init__(self, machine: Machine, driving: PathTracking):
        self._scene = PathTrackingScene(machine, driving, title="Forest run")

    def draw(self, history: NDArray[np.float32]) -> NDArray[np.uint8]:
        """Picture (height, width, 3) of the channels of ``ForestRun.render_channels``, (frames, channels)."""
        return self._scene.draw(history[:, : len(PathTracking.render_channels)])
