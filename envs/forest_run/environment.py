"""Environments of forest runs, one vehicle or many."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from aoro_gym.envs.core.offered_terms import changed_config
from aoro_gym.envs.core.single import TwinEnv
from aoro_gym.envs.core.terms import ObservationTerm, RewardTerm
from aoro_gym.envs.core.vector import TwinVectorEnv, check_keywords
from aoro_gym.envs.forest_run.config import ForestRunConfig, ForestRunRandomisation
from aoro_gym.envs.forest_run.courses import learned_courses
from aoro_gym.envs.forest_run.rewards import FURTHER_REWARD_TERMS
from aoro_gym.envs.forest_run.task import ForestRun
from aoro_gym.envs.path_tracking.courses import Course, as_courses, ground_of
from aoro_gym.execution.array_api import Array
from aoro_gym.terrains import Path, Plane, Terrain
from aoro_gym.terrains.world.world import World


def _obstacle_map() -> ObservationTerm:
    from aoro_gym.envs.forest_run.obstacle_map import obstacle_map  # its kernels are loaded when it is asked for

    return obstacle_map()


OFFERED: Mapping[str, Callable[[], ObservationTerm]] = {"obstacle_map": _obstacle_map}
"""Observation terms of forest runs alone that are asked for by True."""


class ForestRunVectorEnv(TwinVectorEnv):
    """``gymnasium.make_vec("AORO/ForestRun-v0", num_envs=N)``: N vehicles in their forests, the twins of one launch.

    **Action**: steering signal (positive left) and drive signal (positive forward). **Observation**: the terms of
    ``OBSERVATION_TERMS`` in their order, then ``obstacles``; ``observation_layout`` gives the columns. **Reward**: the
    weighted terms of ``REWARD_TERMS``.

    **Episode**: see :mod:`aoro_gym.envs.forest_run.task`. ``info["is_success"]`` tells that the goal was reached, and
    ``info["termination"]`` why an episode terminated.

    ``reset(options=...)`` also takes ``path``, which of the world's runs, a whole number or (num_envs,) of them, or a
    :class:`~aoro_gym.terrains.Path` whose end is the goal; ``lateral_offset`` [m] and ``heading_offset`` [rad] from where it
    starts, and ``joint_angle`` [rad], each a number or (num_envs,).

    Args:
        num_envs: Sub-environments.
        config: The task; see :class:`ForestRunConfig`.
        courses: Worlds with their runs to draw from; by default those of
            :data:`~aoro_gym.envs.forest_run.courses.SPLITS` to learn on.
        terrain: Instead: one world, with ``path`` or with paths that are generated, each a run to its end.
        path: The only path in it.
        reward_terms: Changes to the reward terms by name; see :mod:`aoro_gym.envs.core.terms`.
        observation_terms: Changes to the observation terms by name; ``"lidar": True`` and ``"height_map": True`` add what
            rays show, see :mod:`aoro_gym.envs.core.ray_terms`, ``"obstacle_map": True`` what past sweeps have shown, see
            :mod:`aoro_gym.envs.forest_run.obstacle_map`, and ``"obstacles": obstacles(...)`` changes what the lidar does,
            see :mod:`aoro_gym.envs.forest_run.obstacles`.
        randomisation: Instead of the configuration's: ``FIXED``, ``MILD`` or an own one.
        arguments: See :class:`TwinVectorEnv`: machine, ground, device, output, own_machines, autoreset_mode,
            max_episode_steps, render_mode.
    """

    task: ForestRun

    def __init__(
        self,
        num_envs: int = 1,
        *,
        config: ForestRunConfig | None = None,
        courses: Sequence[Course] | None = None,
        terrain: Terrain | Plane | World | None = None,
        path: Path | None = None,
        reward_terms: Mapping[str, RewardTerm | tuple[float, Callable[[Any], Array]] | float | None] | None = None,
        observation_terms: Mapping[str, ObservationTerm | Callable[[Any], Array] | bool | None] | None = None,
        randomisation: ForestRunRandomisation | None = None,
        **arguments: Any,
    ):
        check_keywords(type(self), arguments)
        config = ForestRunConfig() if config is None else config
        config = changed_config(config, reward_terms, observation_terms, randomisation, FURTHER_REWARD_TERMS, OFFERED)
        if courses is None and terrain is None and path is None:
            courses = learned_courses()
        library = as_courses(courses, terrain, path)
        super().__init__(ForestRun(library, config), num_envs, terrain=ground_of(library), **arguments)


class ForestRunEnv(TwinEnv):
    """``gymnasium.make("AORO/ForestRun-v0")``: one vehicle in its forest; see :class:`ForestRunVectorEnv`."""

    vector_type = ForestRunVectorEnv
    vector: ForestRunVectorEnv
