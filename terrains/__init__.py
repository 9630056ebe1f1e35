"""Grounds that a twin can stand on: the inclined plane, and terrains of triangles."""

from aoro_gym.terrains.plane import Plane
from aoro_gym.terrains.terrain import Terrain

__all__ = ["Plane", "Terrain"]
