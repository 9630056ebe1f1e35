"""Records of constants, and launches over runs: what all the plants' Warp functions, in float64, are written with.

A law is a Warp function of one run, the same on a CPU and a GPU; :func:`evaluate` asks it for arrays of runs.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

Array = NDArray[np.float64]
Constants = Mapping[str, Array]
"""SI values by dotted key, each (R,)."""

f64 = wp.float64
vec2, vec4, vec7, vec11, vec15, vec29 = (wp.types.vector(n, f64) for n in (2, 4, 7, 11, 15, 29))
mat77 = wp.types.matrix((7, 7), f64)


def record(name: str, scalars: str, **others: Any) -> Any:
    """Warp struct of float64 ``scalars``, named in one text, and of ``others`` by their types."""
    fields = dict.fromkeys(scalars.split(), f64) | others
    return wp.struct(type(name, (), {"__annotations__": fields, "__module__": __name__}))


def packed(kind: Any, values: Mapping[str, Any], runs: int) -> NDArray[Any]:
    """Records (R,) of a ``kind`` from ``values`` by field: (R,), (n, R) of a vector, or again by field of a record.

    Raises:
        KeyError: fields and values are not the same.
    """
    rows = np.zeros(runs, kind.numpy_dtype())
    _fill(rows, values)
    return rows


def _fill(rows: NDArray[Any], values: Mapping[str, Any]) -> None:
    if differing := set(rows.dtype.names or ()) ^ set(values):
        raise KeyError(f"fields without a value, or values without a field: {', '.join(sorted(differing))}")
    for name, value in values.items():
        if isinstance(value, Mapping):
            _fill(rows[name], value)
        else:
            rows[name] = np.transpose(value)


def evaluate(law: Any, records: NDArray[Any], kind: Any, at: Any) -> Array:
    """What a ``law`` of a record and a number gives for ``records`` (R,) of a ``kind`` ``at`` numbers (..., R)."""
    runs = len(records)
    given = np.broadcast_to(np.asarray(at, dtype=np.float64), np.broadcast_shapes(np.shape(at), (runs,)))
    out = wp.zeros(given.size, dtype=f64, device="cpu")
    inputs = [wp.array(records, dtype=kind, device="cpu"), wp.array(given.ravel(), dtype=f64, device="cpu"), out]
    wp.launch(_over_runs(law, kind), dim=given.size, inputs=inputs, device="cpu")
    return np.asarray(out.numpy(), dtype=np.float64).reshape(given.shape)


@cache
def _over_runs(law: Any, kind: Any) -> Any:
    @wp.kernel(module="unique", enable_backward=False)
    def over_runs(records: wp.array(dtype=kind), at: wp.array(dtype=f64), out: wp.array(dtype=f64)):
        i = wp.tid()
        out[i] = law(records[i % records.shape[0]], at[i])

    return over_runs


def cores() -> int:
    """CPU cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def _threads(count: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(count, thread_name_prefix="plants")


def launch(kernel: Any, runs: int, inputs: list[Any], *, device: Any, threads: int | None = None) -> None:
    """Launch a ``kernel``, whose first input is the number of its first run, over ``runs``; on the CPU, whose backend is
    single-threaded, in one slice of runs a thread.

    Args:
        kernel: Of one run a thread.
        runs: Their number.
        inputs: What the kernel gets after the number of its first run.
        device: ``"cpu"`` or ``"cuda:N"``.
        threads: CPU threads; as many as :func:`cores` by default.
    """
    cpu = wp.get_device(device).is_cpu
    kernel.module.load(device, 1 if cpu else BLOCK_DIM)  # once, before threads ask for it
    shares = min(cores() if threads is None else threads, runs) if cpu else 1

    def part(slot: int) -> None:
        first, last = (number * runs // shares for number in (slot, slot + 1))
        wp.launch(kernel, dim=last - first, inputs=[first, *inputs], device=device, block_dim=BLOCK_DIM)

    if shares == 1:
        part(0)
    else:
        list(_threads(shares).map(part, range(shares)))


BLOCK_DIM = 32
"""Threads of a GPU's block: one warp, so that a few thousand runs already reach every multiprocessor."""


# --------------------------------------------------------------------------------------------------------- small functions
@wp.func
def positive(x: f64):
    """``x`` where it is above 0, else 0."""
    return wp.max(x, f64(0.0))


@wp.func
def unit(x: f64):
    """``x`` kept within [0, 1]."""
    return wp.min(wp.max(x, f64(0.0)), f64(1.0))


@wp.func
def clipped(x: f64, limit: f64):
    """``x`` kept within ±``limit``."""
    return wp.min(wp.max(x, -limit), limit)


@wp.func
def square(x: f64):
    return x * x


@wp.func
def mean_decay(x: f64):
    """(1 − exp(−x))/x for x ≥ 0, by its series where the difference would cancel: to 2e-13 of it."""
    if x < f64(0.03):
        return f64(1.0) - x * (
            f64(0.5) - x * (f64(1.0 / 6.0) - x * (f64(1.0 / 24.0) - x * (f64(1.0 / 120.0) - x * f64(1.0 / 720.0))))
        )
    return (f64(1.0) - wp.exp(-x)) / x
