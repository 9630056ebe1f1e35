"""Environments of path tracking at the limits, one vehicle or many."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from aoro_gym.envs.limit_tracking.config import limit_config
from aoro_gym.envs.limit_tracking.courses import learned_courses
from aoro_gym.envs.limit_tracking.task import LimitTracking
from aoro_gym.envs.path_tracking.config import PathTrackingConfig
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.envs.path_tracking.environment import PathTrackingEnv, PathTrackingVectorEnv
from aoro_gym.terrains import Path, Plane, Terrain
from aoro_gym.terrains.world.world import World


class LimitTrackingVectorEnv(PathTrackingVectorEnv):
    """``gymnasium.make_vec("AORO/PathTracking-v1", num_envs=N)``: N vehicles on hillsides, the twins of one launch.

    Actions, observations, rewards and ends are those of
    :class:`~aoro_gym.envs.path_tracking.environment.PathTrackingVectorEnv`, whose arguments it takes.

    Args:
        num_envs: Sub-environments.
        config: The task; by default :func:`~aoro_gym.envs.limit_tracking.config.limit_config`.
        courses: Grounds with their paths to draw from, from easy to difficult; by default those of
            :data:`~aoro_gym.envs.limit_tracking.courses.SPLITS` to learn on.
        terrain: Instead: one ground, with ``path`` or with paths that are generated.
        path: The only path on it.
        arguments: See :class:`~aoro_gym.envs.path_tracking.environment.PathTrackingVectorEnv`.
    """

    task_type = LimitTracking

    def __init__(
        self,
        num_envs: int = 1,
        *,
        config: PathTrackingConfig | None = None,
        courses: Sequence[Course] | None = None,
        terrain: Terrain | Plane | World | None = None,
        path: Path | None = None,
        **arguments: Any,
    ):
        if courses is None and terrain is None and path is None:
            courses = learned_courses()
        config = limit_config() if config is None else config
        super().__init__(num_envs, config=config, courses=courses, terrain=terrain, path=path, **arguments)


class LimitTrackingEnv(PathTrackingEnv):
    """``gymnasium.make("AORO/PathTracking-v1")``: one vehicle on its path; see :class:`LimitTrackingVectorEnv`."""

    vector_type = LimitTrackingVectorEnv
    vector: LimitTrackingVectorEnv
