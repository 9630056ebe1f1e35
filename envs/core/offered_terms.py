"""Observation terms that environments know by name, beside their own; what they need is loaded when one is asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeVar, cast

from aoro_gym.envs.core.terms import ObservationTerm, changed_observations, changed_rewards
from aoro_gym.execution.array_api import Array

Config = TypeVar("Config")


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

FURTHER = (*OFFERED, "obstacle_map")
"""Names of all terms that an environment observes only where it is asked to; the last one is of forest runs."""


def changed_config(
    config: Config,
    reward_terms: Mapping[str, Any] | None,
    observation_terms: Mapping[str, Any] | None,
    randomisation: Any,
    further: Mapping[str, Callable[[Any], Array]],
    offered: Mapping[str, Callable[[], ObservationTerm]] | None = None,
) -> Config:
    """A task's configuration with what its environment is asked for besides.

    Args:
        config: A dataclass with the fields ``reward_terms``, ``observation_terms`` and ``randomisation``.
        reward_terms: Changes by name; see :mod:`aoro_gym.envs.core.terms`.
        observation_terms: Likewise.
        randomisation: Instead of the configuration's; None keeps it.
        further: Reward terms that can be asked for by name.
        offered: Likewise observation terms, beside :data:`OFFERED`.

    Raises ValueError that names the term and the fix.
    """
    known, terms = cast(Any, config), OFFERED | dict(offered or {})
    return replace(
        known,
        reward_terms=changed_rewards(known.reward_terms, reward_terms, further),
        observation_terms=changed_observations(known.observation_terms, observation_terms, terms),
        randomisation=known.randomisation if randomisation is None else randomisation,
    )
