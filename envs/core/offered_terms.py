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


OFFERED: dict[str, Callable[[], ObservationTerm]] = {"lidar": _lidar, "height_map": _height_map}
"""By name, with their defaults; see :mod:`aoro_gym.envs.core.ray_terms`."""
