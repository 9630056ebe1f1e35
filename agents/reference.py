"""The reference controllers of every environment, by name.

>>> import gymnasium
>>> from aoro_gym.agents.reference import reference_policy
>>> from aoro_gym.envs import register_envs
>>> register_envs()
>>> envs = gymnasium.make_vec("AORO/Turning-v0", num_envs=2)
>>> policy = reference_policy("AORO/Turning-v0", "bang-bang", envs)
>>> policy(envs.reset(seed=1)[0]).shape
(2, 1)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from aoro_gym.agents.controllers import BangBang, Policy, ProportionalDerivative
from aoro_gym.agents.path_controllers import FullSpeedSteering, PreviewRegulator, PurePursuit, Stanley, Vehicle

Factory = Callable[[Any], Policy]
"""Makes the policy for an environment, wrapped or not; its observations come with a leading axis of sub-environments."""

REFERENCE_POLICIES: Mapping[str, Mapping[str, Factory]] = {
    "AORO/Turning-v0": {
        "bang-bang": lambda env: BangBang(env.unwrapped.observation_layout),
        "proportional-derivative": lambda env: ProportionalDerivative(env.unwrapped.observation_layout),
    },
    "AORO/PathTracking-v0": {
        "pure-pursuit": lambda env: PurePursuit(Vehicle.of(env)),
        "stanley": lambda env: Stanley(Vehicle.of(env)),
        "preview": lambda env: PreviewRegulator(Vehicle.of(env)),
        "bang-bang": lambda env: FullSpeedSteering(Vehicle.of(env)),
    },
}
"""By the environment's id, then by the controller's name."""


def reference_policy(environment: str, name: str, env: Any) -> Policy:
    """The reference controller ``name`` of ``environment`` for its instance ``env``.

    Raises ValueError if there is none of this name, naming those that there are.
    """
    for key, known, what in (
        (environment, REFERENCE_POLICIES, "environment with reference controllers"),
        (name, REFERENCE_POLICIES.get(environment, {}), f"reference controller of {environment}"),
    ):
        if key not in known:
            raise ValueError(f"{key!r} is no {what}; choose one of: {', '.join(map(repr, known))}")
    return REFERENCE_POLICIES[environment][name](env)
