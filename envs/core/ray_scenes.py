"""What rays meet on the grounds of a task."""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from aoro_gym.sensors.raytrace import Scene
from aoro_gym.sensors.raytrace.standing import scene_with_trees
from aoro_gym.terrains import Plane, Terrain
from aoro_gym.terrains.world.world import World

FARTHEST = 500.0
"""Half the side [m] of the square that stands for a plane."""
Ground = Plane | Terrain | World | tuple[Terrain, NDArray[np.float64]]
"""What rays meet: bare ground, a world with its objects, or a terrain with trees (K, 4), x, y, radius and height [m]."""

_scenes: WeakKeyDictionary[Any, dict[Any, Scene]] = WeakKeyDictionary()


def scene_of(ground: Ground, device: str) -> Scene:
    """What rays meet on a ground; made once a process and device while the ground lives."""
    terrain, trees = ground if isinstance(ground, tuple) else (ground, np.zeros((0, 4)))
    known, key = _scenes.setdefault(terrain, {}), (device, trees.tobytes())
    if key not in known:
        if isinstance(terrain, Plane):
            known[key] = Scene(*_square(terrain), device=device)
        elif isinstance(terrain, World):
            known[key] = Scene.of_world(terrain, device=device)
        else:
            known[key] = scene_with_trees(terrain, trees, device=device)
    return known[key]


def _square(plane: Plane) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Corners and faces of a part of a plane."""
    normal = plane.normal
    if normal.ndim != 1:
        raise ValueError("the plane's slope is an array, but rays meet one ground; give numbers")
    xy = FARTHEST * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    z = -(xy @ normal[:2]) / normal[2]
    return np.column_stack([xy, z]), np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
