"""Grounds that a twin can stand on. So far: the inclined plane."""

from aoro_gym.terrains.plane import Plane

__all__ = ["Plane"]
