"""Learning environments over the twin.

>>> import gymnasium
>>> from aoro_gym.envs import register_envs
>>> register_envs()
>>> env = gymnasium.make("AORO/Turning-v0")
>>> observation, info = env.reset(seed=1)
>>> observation, reward, terminated, truncated, info = env.step(env.action_space.sample())

A task stands in one file, ``turning`` or ``path_tracking``: its configuration, its reward and observation terms, and how
it is judged. What tasks share is in ``vector`` (twins of one launch, autoreset, seeds, logging), ``single`` (one of them
as an ``Env``), ``terms``, ``randomisation`` and ``rendering``. Path tracking also has ``courses`` (terrains with their
paths), ``path_table`` (projections), ``assistance`` (gear, traction, arms) and ``chase`` (its pictures). Names load on
first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from aoro_gym.envs.registration import ENVIRONMENTS, register_envs

if TYPE_CHECKING:
    from aoro_gym.envs.assistance import ArmControl
    from aoro_gym.envs.courses import Course, forest_course
    from aoro_gym.envs.path_tracking import (
        PathTracking,
        PathTrackingConfig,
        PathTrackingEnv,
        PathTrackingRandomisation,
        PathTrackingVectorEnv,
        PathTrackingView,
    )
    from aoro_gym.envs.randomisation import Randomisation
    from aoro_gym.envs.terms import ObservationTerm, RewardTerm
    from aoro_gym.envs.turning import Turning, TurningConfig, TurningEnv, TurningVectorEnv, TurningView

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

_HOME = {
    "ArmControl": "assistance",
    "Course": "courses",
    "ObservationTerm": "terms",
    "PathTracking": "path_tracking",
    "PathTrackingConfig": "path_tracking",
    "PathTrackingEnv": "path_tracking",
    "PathTrackingRandomisation": "path_tracking",
    "PathTrackingVectorEnv": "path_tracking",
    "PathTrackingView": "path_tracking",
    "Randomisation": "randomisation",
    "RewardTerm": "terms",
    "Turning": "turning",
    "TurningConfig": "turning",
    "TurningEnv": "turning",
    "TurningVectorEnv": "turning",
    "TurningView": "turning",
    "forest_course": "courses",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"aoro_gym.envs.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
