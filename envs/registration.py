"""The environments' ids, made known to Gymnasium. Only strings: nothing of the twin is imported here."""

from __future__ import annotations

import warnings
from dataclasses import dataclass


@dataclass(frozen=True)
class Registration:
    """Where an environment stands, and how long its episodes are."""

    entry_point: str
    vector_entry_point: str
    max_episode_steps: int | None
    """None: the task itself says when the time is up."""


ENVIRONMENTS = {
    "AORO/Turning-v0": Registration(
        entry_point="aoro_gym.envs.turning.environment:TurningEnv",
        vector_entry_point="aoro_gym.envs.turning.environment:TurningVectorEnv",
        max_episode_steps=500,
    ),
    "AORO/PathTracking-v0": Registration(
        entry_point="aoro_gym.envs.path_tracking.environment:PathTrackingEnv",
        vector_entry_point="aoro_gym.envs.path_tracking.environment:PathTrackingVectorEnv",
        max_episode_steps=None,
    ),
    "AORO/PathTracking-v1": Registration(
        entry_point="aoro_gym.envs.limit_tracking.environment:LimitTrackingEnv",
        vector_entry_point="aoro_gym.envs.limit_tracking.environment:LimitTrackingVectorEnv",
        max_episode_steps=None,
    ),
    "AORO/Levelling-v0": Registration(
        entry_point="aoro_gym.envs.levelling.environment:LevellingEnv",
        vector_entry_point="aoro_gym.envs.levelling.environment:LevellingVectorEnv",
        max_episode_steps=None,
    ),
    "AORO/ForestRun-v0": Registration(
        entry_point="aoro_gym.envs.forest_run.environment:ForestRunEnv",
        vector_entry_point="aoro_gym.envs.forest_run.environment:ForestRunVectorEnv",
        max_episode_steps=None,
    ),
    "AORO/Loading-v0": Registration(
        entry_point="aoro_gym.envs.loading.environment:LoadingEnv",
        vector_entry_point="aoro_gym.envs.loading.environment:LoadingVectorEnv",
        max_episode_steps=None,
    ),
}
"""Every environment by id."""


NOT_SUPERSEDED = r".*AORO/PathTracking-v0 is out of date"
"""What Gymnasium says of every environment of which there is a higher version: here that is another, harder task."""


def register_envs() -> None:
    """Register every environment with Gymnasium; those that are registered already are left alone."""
    import gymnasium

    warnings.filterwarnings("ignore", message=NOT_SUPERSEDED, category=DeprecationWarning)
    for name, environment in ENVIRONMENTS.items():
        if name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point=environment.entry_point,
                vector_entry_point=environment.vector_entry_point,
                max_episode_steps=environment.max_episode_steps,
            )
