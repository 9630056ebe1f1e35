"""NumPy's arrays of environments whose own arrays are on a device.

The step of a task in kernels is one graph on a GPU (:mod:`aoro_gym.envs.core.kernel_step`) and leaves tensors there. Where
NumPy's arrays are asked for, these are brought to the host in one copy at the end of a step, and are what the environment
would have handed out if it had calculated with NumPy.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.execution.array_api import Array, Arrays

Infos = dict[str, Any]
NEEDED = ("torch", "array_api_compat")
"""Packages that calculate on a device."""


def calculates_there(task: Any, twin: Any) -> bool:
    """Whether an environment of NumPy's arrays has its own on the device of its twins: on a GPU, for a task in kernels that
    know all of its terms, as a user's own are functions of NumPy's arrays."""
    if not twin.device.is_cuda or not getattr(task, "has_kernels", False) or not all(map(find_spec, NEEDED)):
        return False
    terms = [*task.reward_terms.values(), *task.observation_terms.values()]
    return all(term.function in task.kernel_terms for term in terms)


def on_host(
    results: Sequence[Array], infos: Mapping[str, Any], arrays: Arrays, reasons: Sequence[str]
) -> tuple[list[NDArray[Any]], Infos]:
    """What a reset or a step gives, on the host, as parts of one block of memory.

    Args:
        results: Tensors.
        infos: Tensors by name, some in a dictionary of their own.
        arrays: Where they live.
        reasons: Why episodes terminate, in words, by the numbers in ``infos["termination"]``.
    """
    inner = infos.get("final_info", {})
    tensors = {id(each): each for each in (*results, *infos.values(), *inner.values()) if not isinstance(each, Mapping)}
    found = dict(zip(tensors, arrays.hosts(*tensors.values()), strict=True))

    def told(given: Mapping[str, Any]) -> Infos:
        out: Infos = {}
        for name, value in given.items():
            here: Any = told(value) if isinstance(value, Mapping) else found[id(value)]
            out[name] = _words(here, reasons) if name == "termination" else here
        return out

    out = told(infos)
    if "final_obs" in out:
        out["final_obs"] = _rows(out["final_obs"], out["_final_obs"])
    return [found[id(each)] for each in results], out


def _words(numbers: NDArray[np.integer], reasons: Sequence[str]) -> NDArray[np.object_]:
    """Reasons (N,), None for 0."""
    out = np.full(len(numbers), None, dtype=object)
    for i in np.flatnonzero(numbers):
        out[i] = reasons[numbers[i]]
    return out


def _rows(observations: NDArray[np.float32], ended: NDArray[np.bool_]) -> NDArray[np.object_]:
    """Observations of those that ``ended`` (N,), None for the others."""
    out = np.full(len(ended), None, dtype=object)
    for i in np.flatnonzero(ended):
        out[i] = observations[i].copy()
    return out
