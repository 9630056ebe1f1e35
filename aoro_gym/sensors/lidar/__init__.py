"""Lidars by their makers' figures: patterns, echoes by the range equation, beams as wide as they are, motion, weather.

>>> from aoro_gym.sensors.raytrace import Scene
>>> scene = Scene([[-99, -99, 0], [99, -99, 0], [99, 99, 0], [-99, 99, 0]], [[0, 1, 2], [0, 2, 3]])
>>> [points] = Lidar(scene, "vlp-16", ideal=True, subrays=1).sweep(Motion.still([0.0, 0.0, 0.0]))
>>> int(points.ring[0]), round(float(points.range[0]), 2)  # 2.6 m up, 15 degrees down
(0, 10.05)
"""

from aoro_gym.sensors.lidar.lidar import Lidar, Motion, Mounting
from aoro_gym.sensors.lidar.models import MODELS, Firings, LidarModel
from aoro_gym.sensors.lidar.points import Points
from aoro_gym.sensors.lidar.weather import CLEAR, Weather

__all__ = ["CLEAR", "MODELS", "Firings", "Lidar", "LidarModel", "Motion", "Mounting", "Points", "Weather"]
