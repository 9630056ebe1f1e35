"""A small world for tests of forest runs."""

from functools import cache

import numpy as np

from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.terrains import Path, Terrain
from aoro_gym.terrains.world.objects import Tree, upright
from aoro_gym.terrains.world.world import World

AHEAD, BESIDE = 13.0, 4.0
"""Of stems from the front axle's middle at the start, which stands at 4 m of the first run [m]."""


@cache
def course():
    """Level ground with a stem on the straight way of the first run, and none on that of the second."""
    field = Terrain.from_heights(np.zeros((61, 61)), cell=1.0, corner=(-30.0, -30.0))
    pines = [(4.0 + AHEAD, 0.0), (4.0 + 8.0, BESIDE)]
    objects = [Tree((x, y, 0.0), upright(), "pine", 0.3, 16.0, 9.0, 1.5, 1) for x, y in pines]
    runs = [Path(np.array([[0.0, y], [25.0, y]]), name=name) for y, name in ((0.0, "blocked"), (-8.0, "free"))]
    return Course.over(World(field, tuple(objects)), runs, name="two pines")
