"""Observation terms that environments know by name, beside their own; what they need is loaded when one is asked for."""

from __future__ import annotations

from collections.abc import Callable

from aoro_gym.envs.core.terms import ObservationTerm


def _lidar() -> ObservationTerm:
    from aoro_gym.envs.core.ray_terms import lidar

    return lidar()


def _height_map() -> ObservationTerm:
    from aoro_gym.envs.core.ray_terms import height_map

    return height_map()


def _depth() -> ObservationTerm:
    from aoro_gym.envs.core.camera_terms import depth

    return depth()


def _camera() -> ObservationTerm:
    from aoro_gym.envs.core.camera_terms import camera

    return camera()


OFFERED: dict[str, Callable[[], ObservationTerm]] = {
    "lidar": _lidar,
    "height_map": _height_map,
    "depth": _depth,
    "camera": _camera,
}
"""By name, with their defaults; see :mod:`aoro_gym.envs.core.ray_terms` and :mod:`aoro_gym.envs.core.camera_terms`."""
