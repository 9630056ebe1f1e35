"""Learning environments over the twin.

>>> import gymnasium
>>> from aoro_gym.envs import register_envs
>>> register_envs()
>>> env = gymnasium.make("AORO/Turning-v0")
>>> observation, info = env.reset(seed=1)
>>> observation, reward, terminated, truncated, info = env.step(env.action_space.sample())

A task stands in one file: its configuration, its reward and observation terms, and how it is judged. What tasks share
is in ``vector`` (twins of one launch, autoreset, seeds, logging), ``single`` (one of them as an ``Env``), ``terms``,
``randomisation`` and ``rendering``. Names load on first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from aoro_gym.envs.registration import ENVIRONMENTS, register_envs

if TYPE_CHECKING:
    from aoro_gym.envs.randomisation import Randomisation
    from aoro_gym.envs.terms import ObservationTerm, RewardTerm
    from aoro_gym.envs.turning import Turning, TurningConfig, TurningEnv, TurningVectorEnv, TurningView

__all__ = [
    "ENVIRONMENTS",
    "ObservationTerm",
    "Randomisation",
    "RewardTerm",
    "Turning",
    "TurningConfig",
    "TurningEnv",
    "TurningVectorEnv",
    "TurningView",
    "register_envs",
]

_HOME = {
    "ObservationTerm": "terms",
    "Randomisation": "randomisation",
    "RewardTerm": "terms",
    "Turning": "turning",
    "TurningConfig": "turning",
    "TurningEnv": "turning",
    "TurningVectorEnv": "turning",
    "TurningView": "turning",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"aoro_gym.envs.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
