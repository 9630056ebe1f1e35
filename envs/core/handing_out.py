"""NumPy's arrays of environments whose own arrays are on a device.

The step of a task in kernels is a graph or two on a GPU (:mod:`aoro_gym.envs.core.kernel_step`) and leaves tensors there.
Where NumPy's arrays are asked for, these are brought to the host in one copy at the end of a step, and in a second one where
the host begins episodes after it. What is handed out is made of them on the host, as if all had been calculated there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from numpy.typing import NDArray

from aoro_gym.execution.array_api import Array, Arrays, calculates_on_gpus


def calculates_there(task: Any, twin: Any) -> bool:
    """Whether an environment of NumPy's arrays has its own on the device of its twins: on a GPU that torch knows, for a task
    in kernels that know all of its terms, as a user's own are functions of NumPy's arrays."""
    if not twin.device.is_cuda or not getattr(task, "has_kernels", False) or not calculates_on_gpus():
        return False
    terms = [*task.reward_terms.values(), *task.observation_terms.values()]
    return all(term.function in getattr(task, "kernel_terms", ()) for term in terms)


def brought(
    arrays: Arrays, results: Sequence[Array], infos: Mapping[str, Array]
) -> tuple[list[NDArray[Any]], dict[str, NDArray[Any]]]:
    """``results`` and ``infos`` on the host, as parts of one block of memory, in one copy from a GPU.

    Args:
        arrays: Where they live.
        results: Tensors.
        infos: Tensors by name.
    """
    tensors = {id(each): each for each in (*results, *infos.values())}
    found = dict(zip(tensors, arrays.hosts(*tensors.values()), strict=True))
    return [found[id(each)] for each in results], {name: found[id(each)] for name, each in infos.items()}
