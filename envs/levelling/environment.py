"""Environments of levelling, one vehicle or many."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from aoro_gym.envs.core.offered_terms import changed_config
from aoro_gym.envs.core.single import TwinEnv
from aoro_gym.envs.core.terms import ObservationTerm, RewardTerm
from aoro_gym.envs.core.vector import TwinVectorEnv, check_keywords
from aoro_gym.envs.levelling.config import LevellingConfig, LevellingRandomisation
from aoro_gym.envs.levelling.courses import learned_courses
from aoro_gym.envs.levelling.rewards import FURTHER_REWARD_TERMS
from aoro_gym.envs.levelling.task import Levelling
from aoro_gym.envs.path_tracking.courses import Course, as_courses, ground_of
from aoro_gym.execution.array_api import Array
from aoro_gym.terrains import Path, Plane, Terrain
from aoro_gym.terrains.world.world import World


class LevellingVectorEnv(TwinVectorEnv):
    """``gymnasium.make_vec("AORO/Levelling-v0", num_envs=N)``: N vehicles on their lanes, the twins of one launch.

    **Action**: signals of the four arm valves, front left, front right, rear left, rear right; positive extends the
    cylinder: the wheel goes down, the frame up. **Observation**: the terms of ``OBSERVATION_TERMS`` in their order;
    ``observation_layout`` gives the columns. **Reward**: the weighted terms of ``REWARD_TERMS``.

    **Episode**: see :mod:`aoro_gym.envs.levelling.task`. ``info["is_success"]`` tells that the end of the path was reached
    with small tilt and even loads, and ``info["termination"]`` why an episode terminated.

    ``reset(options=...)`` also takes ``path``, ``start``, ``lateral_offset``, ``heading_offset`` and ``joint_angle``, as
    :class:`~aoro_gym.envs.path_tracking.environment.PathTrackingVectorEnv` does.

    Args:
        num_envs: Sub-environments.
        config: The task; see :class:`LevellingConfig`.
        courses: Grounds with their paths to draw from; by default those of
            :data:`~aoro_gym.envs.levelling.courses.SPLITS` to learn on.
        terrain: Instead: one ground, a world with its solid objects, too, with ``path`` or with paths that are generated.
        path: The only path on it.
        reward_terms: Changes to the reward terms by name; see :mod:`aoro_gym.envs.core.terms`.
        observation_terms: Changes to the observation terms by name; ``"lidar": True`` and ``"height_map": True`` add what
            rays show, see :mod:`aoro_gym.envs.core.ray_terms`.
        randomisation: Instead of the configuration's: ``FIXED``, ``MILD`` or an own one.
        arguments: See :class:`TwinVectorEnv`: machine, ground, soil, device, output, own_machines, autoreset_mode,
            max_episode_steps, render_mode.
    """

    task: Levelling

    def __init__(
        self,
        num_envs: int = 1,
        *,
        config: LevellingConfig | None = None,
        courses: Sequence[Course] | None = None,
        terrain: Terrain | Plane | World | None = None,
        path: Path | None = None,
        reward_terms: Mapping[str, RewardTerm | tuple[float, Callable[[Any], Array]] | float | None] | None = None,
        observation_terms: Mapping[str, ObservationTerm | Callable[[Any], Array] | bool | None] | None = None,
        randomisation: LevellingRandomisation | None = None,
        **arguments: Any,
    ):
        check_keywords(type(self), arguments)
        config = LevellingConfig() if config is None else config
        config = changed_config(config, reward_terms, observation_terms, randomisation, FURTHER_REWARD_TERMS)
        if courses is None and terrain is None and path is None:
            courses = learned_courses()
        library = as_courses(courses, terrain, path)
        super().__init__(Levelling(library, config), num_envs, terrain=ground_of(library), **arguments)


class LevellingEnv(TwinEnv):
    """``gymnasium.make("AORO/Levelling-v0")``: one vehicle on its lane; see :class:`LevellingVectorEnv`."""

    vector_type = LevellingVectorEnv
    vector: LevellingVectorEnv
