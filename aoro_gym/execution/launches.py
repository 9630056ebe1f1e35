"""Launches of kernels that are told once and repeated."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from typing import Any

import warp as wp


class RecordedLaunch:
    """A kernel with its arguments, to be launched many times by :attr:`launch`.

    On CUDA that is Warp's recorded command. On the CPU Warp puts the arguments of such a command together anew each time,
    which takes as long as a millisecond of one twin; here that is done once, and the compiled function is called with them.
    A capture on the CPU does not see such a call.

    Of arrays it holds addresses: what is changed is written in place. It lives as long as what it was made of.

    Args:
        kernel: What to launch.
        dim: Threads.
        inputs: Arguments of the kernel.
        device: Where.
        block_dim: Threads a block.
        function: What is called on the CPU instead of the function that Warp has compiled, with the same arguments.
    """

    def __init__(
        self, kernel: Any, dim: int, inputs: Sequence[Any], *, device: Any, block_dim: int, function: Any = None
    ):
        self._function = function
        self._recorded: Any = wp.launch(kernel, dim, inputs, device=device, block_dim=block_dim, record_cmd=True)
        self.launch: Callable[[], Any] = self._called()
        """Launches it."""

    def set(self, dim: int, arguments: Mapping[int, Any], function: Any = None) -> None:
        """Launch ``dim`` threads from now on, with other ``arguments`` by their index, and another ``function``."""
        self._function = function
        self._recorded.set_dim(dim)
        for index, value in arguments.items():
            self._recorded.set_param_at_index(index, value)
        self.launch = self._called()

    def _called(self) -> Callable[[], Any]:
        recorded = self._recorded
        if not recorded.device.is_cpu or recorded.block_dim != 1:
            return recorded.launch
        bounds, *parameters = recorded.params
        kind = _structure(tuple((a.label, type(p)) for a, p in zip(recorded.kernel.adj.args, parameters, strict=True)))
        function = self._function or recorded.hooks.forward
        return partial(function, ctypes.byref(bounds), ctypes.byref(kind(*parameters)))


@cache
def _structure(fields: tuple[tuple[str, Any], ...]) -> Any:
    """What a kernel that is compiled for the CPU takes its arguments as."""
    return type("Arguments", (ctypes.Structure,), {"_fields_": fields})
