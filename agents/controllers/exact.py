"""Controllers that are told the truth: exact values in the place of what is measured with errors that last."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.agents.policies.policy import Actions, Observations, Policy
from aoro_gym.envs.levelling import observations as levelling
from aoro_gym.envs.path_tracking import observations as path_tracking
from aoro_gym.envs.turning import observations as turning
from aoro_gym.execution.array_api import Array

EXACT: Mapping[str, Mapping[str, Callable[[Any], Array]]] = {
    "AORO/Turning-v0": turning.EXACT_TERMS,
    "AORO/PathTracking-v0": path_tracking.EXACT_TERMS,
    "AORO/PathTracking-v1": path_tracking.EXACT_TERMS,
    "AORO/Levelling-v0": levelling.EXACT_TERMS,
    "AORO/ForestRun-v0": {},
    "AORO/Loading-v0": {},
}
"""True values of measured observation terms, by the environment's id, then by the term's name."""


def exact_observations(
    envs: Any, observations: Observations, exact: Mapping[str, Callable[[Any], Array]]
) -> Observations:
    """The ``observations`` (N, O) of a vector environment with true values in the place of measured ones, where there are
    any."""
    view, told = envs.task.view(), observations.copy()
    for name, value in exact.items():
        if name in envs.observation_layout:
            told[:, envs.observation_layout[name]] = envs.arrays.host(value(view))[:, None]
    return told


@dataclass
class Informed:
    """A controller that is told the truth of an environment, wrapped or not, single or vector."""

    controller: Policy
    env: Any
    exact: Mapping[str, Callable[[Any], Array]]
    """See :data:`EXACT`."""

    def __post_init__(self) -> None:
        self.watching(self.env)

    def watching(self, env: Any) -> Informed:
        """This controller, in another environment of the same task."""
        env = env.unwrapped
        self.env = getattr(env, "vector", env)
        return self

    def __call__(self, observations: Observations) -> Actions:
        return self.controller(exact_observations(self.env, np.asarray(observations), self.exact))

    def reset(self, mask: NDArray[np.bool_] | None = None) -> None:
        """Forget the controller's past."""
        self.controller.reset(mask)
