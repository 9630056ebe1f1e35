"""Grounds that a twin can stand on: the inclined plane, and terrains of triangles; paths over them."""

from aoro_gym.terrains.path import Path
from aoro_gym.terrains.plane import Plane
from aoro_gym.terrains.planning import drivable_path
from aoro_gym.terrains.terrain import Terrain

__all__ = ["Path", "Plane", "Terrain", "drivable_path"]
