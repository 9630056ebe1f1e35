"""Learning environments over the twin.

>>> import gymnasium
>>> from aoro_gym.envs import register_envs
>>> register_envs()
>>> env = gymnasium.make("AORO/Turning-v0")
>>> observation, info = env.reset(seed=1)
>>> observation, reward, terminated, truncated, info = env.step(env.action_space.sample())

A task stands in one file, ``turning`` or ``path_tracking``: its configuration, its reward and observation terms, and how
it is judged. What tasks share is in ``vector`` (twins of one launch, autoreset, seeds, logging), ``single`` (one of them
as an ``Env``), ``terms``, ``randomisation``, ``joint`` (its measured angle and rate) and ``rendering``. Path tracking also
has ``courses`` (terrains with their paths), ``path_table`` (projections), ``assistance`` (gear, traction, arms) and
``chase`` (its pictures). Names load on first use.
"""

from typing import TYPE_CHECKING

import lazy_loader

from aoro_gym.envs.registration import ENVIRONMENTS, register_envs

if TYPE_CHECKING:
    from aoro_gym.envs.core.randomisation import Randomisation
    from aoro_gym.envs.core.terms import ObservationTerm, RewardTerm
    from aoro_gym.envs.path_tracking.assistance import ArmControl
    from aoro_gym.envs.path_tracking.courses import Course, forest_course
    from aoro_gym.envs.path_tracking.task import (
        PathTracking,
        PathTrackingConfig,
        PathTrackingEnv,
        PathTrackingRandomisation,
        PathTrackingVectorEnv,
        PathTrackingView,
    )
    from aoro_gym.envs.turning.task import Turning, TurningConfig, TurningEnv, TurningVectorEnv, TurningView

__all__ = [
    "ENVIRONMENTS",
    "ArmControl",
    "Course",
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
    "register_envs",
]

__getattr__, _, _ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "path_tracking.assistance": ("ArmControl",),
        "path_tracking.courses": ("Course", "forest_course"),
        "path_tracking.task": (
            "PathTracking",
            "PathTrackingConfig",
            "PathTrackingEnv",
            "PathTrackingRandomisation",
            "PathTrackingVectorEnv",
            "PathTrackingView",
        ),
        "core.randomisation": ("Randomisation",),
        "core.terms": ("ObservationTerm", "RewardTerm"),
        "turning.task": ("Turning", "TurningConfig", "TurningEnv", "TurningVectorEnv", "TurningView"),
    },
)


def __dir__() -> list[str]:
    return list(__all__)
