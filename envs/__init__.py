"""Learning environments over the twin.

>>> import gymnasium
>>> from aoro_gym.envs import register_envs
>>> register_envs()
>>> env = gymnasium.make("AORO/Turning-v0")
>>> observation, info = env.reset(seed=1)
>>> observation, reward, terminated, truncated, info = env.step(env.action_space.sample())

A task is a folder: ``config``, ``rewards``, ``observations`` (terms of the ``view``), ``task`` (goals, measurements,
judgement), ``environment`` (what Gymnasium makes) and ``rendering``. ``core`` is what tasks share; its ``task`` documents
the interface that a further task fulfils. Names load on first use.
"""

from typing import TYPE_CHECKING

import lazy_loader

from aoro_gym.envs.registration import ENVIRONMENTS, register_envs

if TYPE_CHECKING:
    from aoro_gym.envs.core.randomisation import Randomisation
    from aoro_gym.envs.core.terms import ObservationTerm, RewardTerm
    from aoro_gym.envs.forest_run.config import ForestRunConfig, ForestRunRandomisation
    from aoro_gym.envs.forest_run.environment import ForestRunEnv, ForestRunVectorEnv
    from aoro_gym.envs.forest_run.task import ForestRun
    from aoro_gym.envs.forest_run.view import ForestRunView
    from aoro_gym.envs.levelling.config import LevellingConfig, LevellingRandomisation
    from aoro_gym.envs.levelling.environment import LevellingEnv, LevellingVectorEnv
    from aoro_gym.envs.levelling.task import Levelling
    from aoro_gym.envs.levelling.view import LevellingView
    from aoro_gym.envs.limit_tracking.config import LimitRandomisation, limit_config
    from aoro_gym.envs.limit_tracking.environment import LimitTrackingEnv, LimitTrackingVectorEnv
    from aoro_gym.envs.limit_tracking.task import LimitTracking
    from aoro_gym.envs.loading.config import LoadingConfig, LoadingRandomisation
    from aoro_gym.envs.loading.environment import LoadingEnv, LoadingVectorEnv
    from aoro_gym.envs.loading.task import Loading
    from aoro_gym.envs.loading.view import LoadingView
    from aoro_gym.envs.path_tracking.assistance import ArmControl
    from aoro_gym.envs.path_tracking.config import PathTrackingConfig, PathTrackingRandomisation
    from aoro_gym.envs.path_tracking.courses import Course, forest_course
    from aoro_gym.envs.path_tracking.environment import PathTrackingEnv, PathTrackingVectorEnv
    from aoro_gym.envs.path_tracking.task import PathTracking
    from aoro_gym.envs.path_tracking.view import PathTrackingView
    from aoro_gym.envs.turning.config import TurningConfig
    from aoro_gym.envs.turning.environment import TurningEnv, TurningVectorEnv
    from aoro_gym.envs.turning.task import Turning
    from aoro_gym.envs.turning.view import TurningView

__all__ = [
    "ENVIRONMENTS",
    "ArmControl",
    "Course",
    "ForestRun",
    "ForestRunConfig",
    "ForestRunEnv",
    "ForestRunRandomisation",
    "ForestRunVectorEnv",
    "ForestRunView",
    "Levelling",
    "LevellingConfig",
    "LevellingEnv",
    "LevellingRandomisation",
    "LevellingVectorEnv",
    "LevellingView",
    "LimitRandomisation",
    "LimitTracking",
    "LimitTrackingEnv",
    "LimitTrackingVectorEnv",
    "Loading",
    "LoadingConfig",
    "LoadingEnv",
    "LoadingRandomisation",
    "LoadingVectorEnv",
    "LoadingView",
    "ObservationTerm",
    "PathTracking",
    "PathTrackingConfig",
    "PathTrackingEnv",
    "PathTrackingRandomisation",
    "PathTrackingVectorEnv",
    "PathTrackingView",
    "Randomisation",
    "RewardTerm",
    "Turning",
    "TurningConfig",
    "TurningEnv",
    "TurningVectorEnv",
    "TurningView",
    "forest_course",
    "limit_config",
    "register_envs",
]

__getattr__, _, _ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "path_tracking.assistance": ("ArmControl",),
        "path_tracking.courses": ("Course", "forest_course"),
        "path_tracking.config": ("PathTrackingConfig", "PathTrackingRandomisation"),
        "path_tracking.environment": ("PathTrackingEnv", "PathTrackingVectorEnv"),
        "path_tracking.task": ("PathTracking",),
        "path_tracking.view": ("PathTrackingView",),
        "forest_run.config": ("ForestRunConfig", "ForestRunRandomisation"),
        "forest_run.environment": ("ForestRunEnv", "ForestRunVectorEnv"),
        "forest_run.task": ("ForestRun",),
        "forest_run.view": ("ForestRunView",),
        "levelling.config": ("LevellingConfig", "LevellingRandomisation"),
        "levelling.environment": ("LevellingEnv", "LevellingVectorEnv"),
        "levelling.task": ("Levelling",),
        "levelling.view": ("LevellingView",),
        "limit_tracking.config": ("LimitRandomisation", "limit_config"),
        "limit_tracking.environment": ("LimitTrackingEnv", "LimitTrackingVectorEnv"),
        "limit_tracking.task": ("LimitTracking",),
        "loading.config": ("LoadingConfig", "LoadingRandomisation"),
        "loading.environment": ("LoadingEnv", "LoadingVectorEnv"),
        "loading.task": ("Loading",),
        "loading.view": ("LoadingView",),
        "core.randomisation": ("Randomisation",),
        "core.terms": ("ObservationTerm", "RewardTerm"),
        "turning.config": ("TurningConfig",),
        "turning.environment": ("TurningEnv", "TurningVectorEnv"),
        "turning.task": ("Turning",),
        "turning.view": ("TurningView",),
    },
)


def __dir__() -> list[str]:
    return list(__all__)
