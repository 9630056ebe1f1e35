"""Counts where the host would wait for a GPU."""

from typing import Any

from torch.utils._python_dispatch import TorchDispatchMode  # pyright: ignore[reportMissingImports]


class Waits(TorchDispatchMode):
    """Within it, counts values that are looked at, by ``item()`` or ``bool()``, and operators, which are kernels there."""

    def __init__(self) -> None:
        super().__init__()
        self.count = 0
        self.operators = 0

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        self.count += "_local_scalar_dense" in str(func)
        self.operators += not func.is_view
        return func(*args, **(kwargs or {}))
