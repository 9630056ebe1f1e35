"""Where the arrays beside the twins live: NumPy's on the host, or torch's on the twins' device.

Sensors and tasks are written once, in the names that NumPy 2 and the array API standard
(https://data-apis.org/array-api/2024.12) share, for either. On a device nothing waits for it: no value is looked at, no
boolean selects rows (their number would have to be known), and what the host uploads is small.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import cache, lru_cache
from importlib.util import find_spec
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = Any
"""``numpy.ndarray`` or ``torch.Tensor``; as an argument on the host, also what NumPy makes an array of."""
Index = Any
"""Rows of an array: a slice, or an array of whole numbers where the array lives."""


NEEDED = ("torch", "array_api_compat")
"""Packages that calculate on a device."""


def calculates_on_gpus() -> bool:
    """Whether :data:`NEEDED` are installed, and torch is one that knows this computer's GPUs."""
    if not all(map(find_spec, NEEDED)):
        return False
    import torch  # pyright: ignore[reportMissingImports]

    return bool(torch.cuda.is_available())


class Arrays:
    """An array namespace, and the device that its arrays are made on.

    Floats are float64 unless said otherwise: clocks count ticks of hours, phases and world coordinates have to keep
    their millimetres, and what noise is made of are integers of 52 bits.
    """

    def __init__(self, xp: ModuleType = np, device: Any = "cpu"):
        self.xp: Any = xp
        """The namespace, by the names of the array API standard."""
        self.device = device
        self.on_host = xp is np
        """Whether values can be looked at without waiting for a device."""
        self._waiting: dict[int, tuple[Array, Any, Any]] | None = None  # writes by the array's identity
        self._keeps = False  # whether they are never made

    @classmethod
    def torch(cls, device: str) -> Arrays:
        """Tensors on a Warp device, ``"cpu"`` or ``"cuda:N"``; ValueError that names the extra if torch is missing, or that
        says so if it knows no GPU."""
        try:
            import array_api_compat.torch as xp  # pyright: ignore[reportMissingImports]
            import torch  # pyright: ignore[reportMissingImports]
        except ImportError as error:
            raise ValueError(
                f"output is 'torch', but {error.name} is missing: pip install 'aoro-gym[torch]', or take output='numpy'"
            ) from error
        if device.startswith("cuda") and not torch.cuda.is_available():
            raise ValueError(
                f"output is 'torch', but torch {torch.__version__} here knows no GPU, and the device is {device}: install "
                "a torch that is built for CUDA, or take output='numpy'"
            )
        return cls(xp, torch.device(device))

    def __reduce__(self) -> tuple[Any, ...]:
        return _arrays_on, (None if self.on_host else str(self.device),)  # a module cannot be pickled

    def zeros(self, shape: int | tuple[int, ...], dtype: Any = None) -> Array:
        """Float64, unless ``dtype`` says otherwise."""
        return self.full(shape, 0, dtype)

    def ones(self, shape: int | tuple[int, ...], dtype: Any = None) -> Array:
        """Likewise."""
        return self.full(shape, 1, dtype)

    def full(self, shape: int | tuple[int, ...], value: float, dtype: Any = None) -> Array:
        """Likewise."""
        return self.xp.full(shape, value, dtype=self.xp.float64 if dtype is None else dtype, device=self.device)

    def arange(self, count: int) -> Array:
        """0 … ``count`` − 1, int64."""
        return self.xp.arange(count, dtype=self.xp.int64, device=self.device)

    def asarray(self, values: Array, dtype: Any = None) -> Array:
        """``values`` as an array here, float64 unless ``dtype`` says otherwise; not copied if it is one."""
        dtype = self.xp.float64 if dtype is None else dtype
        if self.on_host:
            return np.asarray(values, dtype=dtype)
        # by NumPy, as torch makes Python's floats float32
        tensor = self.xp.asarray(np.asarray(values), copy=True) if namespace(values) is np else values
        # what is not pinned is read before the call returns, so that the host may go on at once
        return tensor.to(self.device, dtype, non_blocking=True)

    def index(self, rows: NDArray[np.integer]) -> Index:
        """Rows known to the host, as an index of arrays here."""
        if self._keeps:
            return rows  # of what goes nowhere yet
        index = self.asarray(rows, self.xp.int64)
        if not self.on_host:
            index.rows = rows  # so that together() need not ask the device for them
        return index

    def put(self, array: Array, index: Any, values: Array) -> None:
        """``array[index] = values`` for values of the host or from here, of any type."""
        if self._waiting is not None and (isinstance(values, int | float) or namespace(values) is np):
            if id(array) in self._waiting:
                if self._keeps:
                    raise RuntimeError("an array is written twice where writes are kept")
                self._write()
            self._waiting[id(array)] = array, _rows_of(index), values
            return
        if self._keeps:
            raise RuntimeError("values that lie on the device are written where writes are kept")
        array[index] = values if isinstance(values, int | float) else self.asarray(values, array.dtype)

    @contextmanager
    def together(self) -> Iterator[None]:
        """Within it, what :meth:`put` writes to a device is kept, and written by one launch at the end."""
        if self.on_host:
            yield
            return
        self._waiting = {}
        try:
            yield
            self._write()
        finally:
            self._waiting = None

    @contextmanager
    def kept(self) -> Iterator[list[tuple[Array, Any, Any]]]:
        """Within it, what :meth:`put` writes to a device is not written: tensors, indices and values are in the list in the
        end. RuntimeError if an array is written twice, whose order would be lost."""
        assert self._waiting is None and not self.on_host
        self._waiting, self._keeps = {}, True
        out: list[tuple[Array, Any, Any]] = []
        try:
            yield out
            out += self._waiting.values()
        finally:
            self._waiting, self._keeps = None, False

    def _write(self) -> None:
        from aoro_gym.execution.scatter import write

        assert self._waiting is not None
        if self._waiting:
            tensors, indices, values = zip(*self._waiting.values(), strict=True)
            write(tensors, indices, values, str(self.device))
        self._waiting.clear()

    def host(self, array: Array) -> NDArray[Any]:
        """The values on the host, for which it waits; to be read only."""
        return array if self.on_host else array.numpy(force=True)

    def hosts(self, *arrays: Array) -> tuple[NDArray[Any], ...]:
        """The values of several arrays on the host, for which it waits once: from a GPU in one copy, through memory that the
        GPU writes to. They are the caller's, but of arrays that are on the host."""
        if self.on_host:
            return arrays
        if self.device.type == "cpu":
            return tuple(np.array(array.numpy(force=True)) for array in arrays)
        import torch  # pyright: ignore[reportMissingImports]

        there = packed(arrays)
        here = torch.empty(len(there), dtype=torch.uint8, pin_memory=True)  # torch keeps such memory to use it again
        here.copy_(there, non_blocking=True)
        torch.cuda.current_stream(self.device).synchronize()
        return unpacked(here.numpy(), arrays)

    def pinned(self, shape: tuple[int, ...], dtype: Any) -> Array:
        """A tensor in memory of the host that a GPU reads and writes without waiting; torch keeps it until that is done."""
        import torch  # pyright: ignore[reportMissingImports]

        return torch.empty(shape, dtype=dtype, pin_memory=self.device.type != "cpu")

    def uploaded(self, values: NDArray[Any]) -> Array:
        """``values`` of the host as a tensor; a GPU fetches them when it comes to it, so that the host may go on at once."""
        import torch  # pyright: ignore[reportMissingImports]

        here = self.pinned(values.shape, torch.from_numpy(values).dtype)
        here.numpy()[...] = values
        return here.to(self.device, non_blocking=True)

    def alias(self, array: Any) -> Array:
        """The memory of a Warp array, not copied."""
        if self.on_host:
            return array.numpy()  # copies from a GPU
        import warp

        return warp.to_torch(array)

    def shared(self, array: Array) -> Any:
        """The memory of an array from here as a Warp array, not copied: :meth:`alias` the other way round. It holds while
        ``array`` lives."""
        import warp

        return warp.array(array, copy=False, device="cpu") if self.on_host else warp.from_torch(array)

    def copy(self, array: Array) -> Array:
        """A copy."""
        return array.copy() if self.on_host else array.clone()

    def known_all_false(self, mask: Array) -> bool:
        """Whether ``mask`` is known to be false everywhere, so that what it is for can be left out. On a device one would
        have to wait to know: there, never."""
        return self.on_host and not mask.any()

    def ordered(self) -> AbstractContextManager[Any]:
        """Within it, Warp's launches and torch's on the same GPU follow each other as they are called."""
        if self.on_host or self.device.type == "cpu":
            return nullcontext()
        import torch  # pyright: ignore[reportMissingImports]
        import warp

        return warp.ScopedStream(_warp_stream(torch.cuda.current_stream(self.device)))


@lru_cache(maxsize=8)
def _warp_stream(stream: Any) -> Any:
    """Warp's name of a stream of torch's."""
    import warp

    return warp.stream_from_torch(stream)


def packed(tensors: Sequence[Array]) -> Array:
    """Bytes of all ``tensors`` in one, for :func:`unpacked`: those of larger elements first, so that all are aligned."""
    import torch  # pyright: ignore[reportMissingImports]

    ordered = (tensors[number] for number in _by_size(tensors))
    return torch.cat([each.contiguous().reshape(-1).view(torch.uint8) for each in ordered])


def unpacked(values: NDArray[np.uint8], tensors: Sequence[Array]) -> tuple[NDArray[Any], ...]:
    """The arrays of ``tensors`` whose bytes :func:`packed` put together, as parts of ``values``."""
    out: dict[int, NDArray[Any]] = {}
    begin = 0
    for number in _by_size(tensors):
        tensor = tensors[number]
        end = begin + tensor.element_size() * tensor.numel()
        dtype = _numpy_type(tensor.dtype)
        out[number], begin = values[begin:end].view(dtype).reshape(tuple(tensor.shape)), end
    return tuple(out[number] for number in range(len(tensors)))


@cache
def _numpy_type(dtype: Any) -> np.dtype[Any]:
    """NumPy's type of torch's."""
    return np.dtype(str(dtype).removeprefix("torch."))


def _by_size(tensors: Sequence[Array]) -> list[int]:
    return sorted(range(len(tensors)), key=lambda number: -tensors[number].element_size())


HOST = Arrays()
"""NumPy."""


def _rows_of(index: Any) -> Any:
    """``index`` with rows as the host knows them."""
    if isinstance(index, tuple):
        return tuple(_rows_of(part) for part in index)
    return getattr(index, "rows", index)


def _arrays_on(device: str | None) -> Arrays:
    return HOST if device is None else Arrays.torch(device)


def namespace(*values: Any) -> Any:
    """The namespace of the first tensor among ``values``; NumPy for its arrays, numbers and sequences."""
    for value in values:
        known = _NAMESPACES.get(type(value))
        if known is None and not isinstance(value, np.ndarray | np.generic | int | float | Sequence):
            from array_api_compat import array_namespace  # pyright: ignore[reportMissingImports]

            known = _NAMESPACES[type(value)] = array_namespace(value)
        if known is not None:
            return known
    return np


_NAMESPACES: dict[type, Any] = {}
"""Of tensors, by their type."""


def floats(value: Array) -> Array:
    """``value`` as float64, where it lives."""
    xp = namespace(value)
    return np.asarray(value, dtype=np.float64) if xp is np else xp.astype(value, xp.float64, copy=False)
