"""Agents that drive the twin. So far: reference controllers, how they are tuned, and how well policies do.

>>> import gymnasium
>>> from aoro_gym.agents import ProportionalDerivative
>>> from aoro_gym.envs import register_envs
>>> register_envs()
>>> envs = gymnasium.make_vec("AORO/Turning-v0", num_envs=2)
>>> policy = ProportionalDerivative(envs.unwrapped.observation_layout)
>>> observations, infos = envs.reset(seed=1)
>>> policy(observations).shape
(2, 1)
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from aoro_gym.agents.controllers import BangBang, Policy, ProportionalDerivative
    from aoro_gym.agents.evaluation import Evaluation, evaluate
    from aoro_gym.agents.path_controllers import FullSpeedSteering, PreviewRegulator, PurePursuit, Stanley, Vehicle
    from aoro_gym.agents.reference import REFERENCE_POLICIES, reference_policy
    from aoro_gym.agents.responses import Rollout, responses, rollout

__all__ = [
    "REFERENCE_POLICIES",
    "BangBang",
    "Evaluation",
    "FullSpeedSteering",
    "Policy",
    "PreviewRegulator",
    "ProportionalDerivative",
    "PurePursuit",
    "Rollout",
    "Stanley",
    "Vehicle",
    "evaluate",
    "reference_policy",
    "responses",
    "rollout",
]

_HOME = {
    "REFERENCE_POLICIES": "reference",
    "BangBang": "controllers",
    "Evaluation": "evaluation",
    "FullSpeedSteering": "path_controllers",
    "Policy": "controllers",
    "PreviewRegulator": "path_controllers",
    "ProportionalDerivative": "controllers",
    "PurePursuit": "path_controllers",
    "Rollout": "responses",
    "Stanley": "path_controllers",
    "Vehicle": "path_controllers",
    "evaluate": "evaluation",
    "reference_policy": "reference",
    "responses": "responses",
    "rollout": "responses",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"aoro_gym.agents.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
