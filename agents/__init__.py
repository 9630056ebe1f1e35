"""Agents that drive the twin: reference controllers and how they are tuned, training, and how well policies do.

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

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from aoro_gym.agents.controllers.levelling import Assistance, ModalPid, ModalRegulator, PreviewPid, Stance
    from aoro_gym.agents.controllers.mppi import Mppi, PathIntegral
    from aoro_gym.agents.controllers.path_tracking import (
        FullSpeedSteering,
        PreviewDriver,
        PreviewRegulator,
        PurePursuit,
        Stanley,
        Vehicle,
    )
    from aoro_gym.agents.controllers.privileged import PRIVILEGED_POLICIES
    from aoro_gym.agents.controllers.reference import REFERENCE_POLICIES, reference_policy
    from aoro_gym.agents.controllers.turning import BangBang, ProportionalDerivative
    from aoro_gym.agents.evaluation.evaluate import evaluate
    from aoro_gym.agents.evaluation.responses import Rollout, responses, rollout
    from aoro_gym.agents.evaluation.result import Evaluation
    from aoro_gym.agents.policies.files import load_policy, shipped_policies
    from aoro_gym.agents.policies.policy import LearnedPolicy, Policy
    from aoro_gym.agents.training.vec_env import TwinVecEnv, make_vec_env

__all__ = [
    "PRIVILEGED_POLICIES",
    "REFERENCE_POLICIES",
    "Assistance",
    "BangBang",
    "Evaluation",
    "FullSpeedSteering",
    "LearnedPolicy",
    "ModalPid",
    "ModalRegulator",
    "Mppi",
    "PathIntegral",
    "Policy",
    "PreviewDriver",
    "PreviewPid",
    "PreviewRegulator",
    "ProportionalDerivative",
    "PurePursuit",
    "Rollout",
    "Stance",
    "Stanley",
    "TwinVecEnv",
    "Vehicle",
    "evaluate",
    "load_policy",
    "make_vec_env",
    "reference_policy",
    "responses",
    "rollout",
    "shipped_policies",
]

__getattr__, _, _ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "controllers.levelling": ("Assistance", "ModalPid", "ModalRegulator", "PreviewPid", "Stance"),
        "controllers.mppi": ("Mppi", "PathIntegral"),
        "controllers.privileged": ("PRIVILEGED_POLICIES",),
        "controllers.turning": ("BangBang", "ProportionalDerivative"),
        "evaluation.evaluate": ("Evaluation", "evaluate"),
        "policies.files": ("load_policy", "shipped_policies"),
        "policies.policy": ("LearnedPolicy", "Policy"),
        "controllers.path_tracking": (
            "FullSpeedSteering",
            "PreviewDriver",
            "PreviewRegulator",
            "PurePursuit",
            "Stanley",
            "Vehicle",
        ),
        "controllers.reference": ("REFERENCE_POLICIES", "reference_policy"),
        "evaluation.responses": ("Rollout", "responses", "rollout"),
        "training.vec_env": ("TwinVecEnv", "make_vec_env"),
    },
)


def __dir__() -> list[str]:
    return list(__all__)
