"""What a lidar on the first machine sees, as points in the scene."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.machine.kinematics import Pose
from aoro_gym.sensors.lidar import Lidar, Motion, Points
from aoro_gym.sensors.raytrace import Scene
from aoro_gym.terrains import Plane, Terrain
from aoro_gym.terrains.world.world import World
from aoro_gym.view.scene import WORLD

EVERY = 0.2
"""Simulated time [s] between two sweeps: one takes 10 to 70 ms of a core."""
POINT_SIZE = 0.05
"""[m] of a drawn point."""
SUBRAYS = 1
"""Rays across a beam: mixed points at edges are left out."""
PLANE_HALF = 2000.0
"""[m] half the edge of what rays meet of a plane, which has no edge: further than anybody drives in the view."""
NEAR, FAR = np.array([250.0, 220.0, 60.0]), np.array([60.0, 40.0, 160.0])
"""Colours of points beside the sensor, and at :data:`COLOUR_RANGE` and beyond."""
COLOUR_RANGE = 40.0
"""[m]"""


class LidarCloud:
    """Points of a lidar, swept anew as the machine moves; it stands still within a sweep.

    Args:
        server: From :func:`aoro_gym.view.server.start`.
        ground: What it sees, and nothing else; of a world its objects, too.
        model: Name among :data:`aoro_gym.sensors.lidar.MODELS`.

    Raises ValueError for an unknown model.
    """

    def __init__(self, server: Any, ground: Terrain | Plane | World, model: str):
        scene = Scene.of_world(ground) if isinstance(ground, World) else Scene.of_terrain(meshed(ground))
        self._lidar = Lidar(scene, model, subrays=SUBRAYS)
        with server.gui.add_folder("Lidar"):
            self._wanted = server.gui.add_checkbox(model, True, hint="on the cab's roof; does not see the machine")
        self._node = server.scene.add_point_cloud(
            f"{WORLD}/lidar", np.zeros((1, 3), np.float32), np.zeros((1, 3), np.uint8), point_size=POINT_SIZE
        )
        self._node.visible = False
        self._swept = -math.inf
        self._number = 0

    def show(self, time: float, pose: Pose) -> None:
        """Sweep, where it is asked for and it is time to, and draw the points.

        Args:
            time: Simulated [s]; where it goes back, or on by :data:`EVERY`, there is another sweep.
            pose: Of the machine that carries it.
        """
        if not self._wanted.value:
            self._node.visible = False
            return
        if self._swept <= time < self._swept + EVERY and self._node.visible:
            return
        self._swept = time
        self._node.visible = True
        points = self.sweep(pose)
        if points is None or not len(points):
            self._node.visible = False
        else:
            self._node.points, self._node.colors = points.world, colours(points.range)

    def sweep(self, pose: Pose) -> Points | None:
        """What the lidar sees of the ground; None where the machine has tipped over so that the sensor lies in it."""
        roll, pitch, yaw = angles(pose)
        self._number += 1
        motion = Motion.still(pose.position, roll=roll, pitch=pitch, yaw=yaw)
        try:
            return self._lidar.sweep(motion, number=self._number)[0]
        except ValueError:
            return None


def angles(pose: Pose) -> tuple[float, float, float]:
    """Roll, pitch (positive: nose down) and yaw [rad] of the front frame, turned about z, then y, then x."""
    w, x, y, z = pose.wxyz
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    return roll, math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x)))), pose.heading


def colours(ranges: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Colours (..., 3) by ranges (...) [m]."""
    share = np.clip(np.asarray(ranges, dtype=np.float64) / COLOUR_RANGE, 0.0, 1.0)[..., None]
    return np.round(NEAR + share * (FAR - NEAR)).astype(np.uint8)


def meshed(ground: Terrain | Plane) -> Terrain:
    """Triangles of the ground; of a plane, of a square piece of it."""
    if isinstance(ground, Terrain):
        return ground
    edge = np.array([-PLANE_HALF, PLANE_HALF])
    x, y = np.meshgrid(edge, edge)
    return Terrain.from_heights(ground.height(x, y), cell=2.0 * PLANE_HALF, corner=(-PLANE_HALF, -PLANE_HALF))
