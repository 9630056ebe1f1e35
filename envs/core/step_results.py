"""What a step hands out in whose launches episodes end and others begin.

All of it is asked for before the host knows whether any episode has ended: a device that is still at the step comes to it
without being waited for.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from aoro_gym.envs.core.kernel_step import KernelStep, Logged
from aoro_gym.execution.array_api import Array, Arrays


class StepResults(NamedTuple):
    """Arrays of shape (N,), observations (N, …), which are the caller's."""

    observation: Array
    """Where episodes have begun, theirs."""
    rewards: Array
    terminated: Array
    truncated: Array
    done: Array
    ending: Array
    """Reasons of those that terminate."""
    contributions: dict[str, Any]
    """Infos of the reward terms, with masks; where episodes have begun, there are none."""
    told: dict[str, Any]
    """Infos of the task, with masks; where episodes have begun, theirs."""
    final_observation: Array
    final_infos: dict[str, Any]
    """Of those that have ended, with masks."""
    nobody: Array
    """A mask that holds nowhere."""


def step_results(kernels: KernelStep, arrays: Arrays, *, on_host: bool) -> StepResults:
    """Of the last step of ``kernels``, whose arrays are ``arrays``: ``on_host`` NumPy's, else tensors."""
    results, logged = kernels.results()
    if on_host:
        kept = iter(arrays.hosts(*results, *(array for each in logged for array in each[1:])))
        results = [next(kept) for _ in results]
        logged = [Logged(each.names, next(kept), next(kept), next(kept)) for each in logged]
        where: Any = np.where
    else:
        results, where = [arrays.copy(each) for each in results], arrays.xp.where
    observation, final_observation, rewards, ending, (terminated, truncated, done, running) = results
    contributions: dict[str, Any] = {}
    told: dict[str, Any] = {}
    final: dict[str, Any] = {}
    goes_on = ~done
    for names, ended, begun, nothing in logged:
        infos, mask = (told, running) if begun.ndim else (contributions, goes_on)
        for name, value, last in zip(names, where(done, begun, ended), where(done, ended, nothing), strict=True):
            infos[name], infos[f"_{name}"] = value, mask
            final[name], final[f"_{name}"] = last, done
    nobody = terminated & goes_on
    return StepResults(
        observation, rewards, terminated, truncated, done, ending, contributions, told, final_observation, final, nobody
    )  # fmt: skip
