"""Calls device laws from tests.

A test file wraps every law in a one-line kernel, inputs first, outputs last, and runs it with :func:`launch`.
Parameters and states are structured float32 arrays made by :func:`record`; the oracles read the very same rounded
numbers back in float64 through :func:`columns`, so that a difference is the law's and not the input's.
"""

from __future__ import annotations

import inspect
from types import SimpleNamespace
from typing import Any

import numpy as np
import warp as wp

ROUNDOFF = 2.0**-24
"""Largest relative error of one float32 operation."""


def rounded(value: Any) -> np.ndarray:
    """``value`` rounded to float32, as float64."""
    return np.asarray(value, np.float32).astype(np.float64)


def record(struct: Any, **values: Any) -> np.ndarray:
    """Structured array of a device ``struct``; every field by name, the shapes of the values broadcast.

    Vector fields have their own trailing dimension; nested structs take a record. Numbers of laws, and
    states that only some laws have, are by default 0.
    """
    dtype = np.dtype(struct.numpy_dtype())
    names = set(dtype.names or ())
    laws = {name for name in names if name.endswith("_law") or name == "law"}
    if not names - laws <= set(values) <= names:
        raise TypeError(f"missing {sorted(names - laws - set(values))}, unknown {sorted(set(values) - names)}")
    names = set(values)
    inner = {name: len(dtype[name].shape) for name in names}
    shape = np.broadcast_shapes(*(np.shape(v)[: np.ndim(v) - inner[n]] for n, v in values.items()))
    out = np.zeros(shape, dtype)
    for name, value in values.items():
        out[name] = value
    return out


def changed(base: np.ndarray, **values: Any) -> np.ndarray:
    """Copy of a record with some fields replaced (and broadcast against them)."""
    inner = {name: len(base.dtype[name].shape) for name in values}
    shape = np.broadcast_shapes(base.shape, *(np.shape(v)[: np.ndim(v) - inner[n]] for n, v in values.items()))
    out = np.array(np.broadcast_to(base, shape))
    for name, value in values.items():
        out[name] = value
    return out


def columns(array: np.ndarray) -> SimpleNamespace:
    """Fields of a record as float64 attributes, nested records as nested namespaces."""
    names = array.dtype.names or ()
    return SimpleNamespace(
        **{n: columns(array[n]) if array.dtype[n].names else array[n].astype(np.float64) for n in names}
    )


def launch(kernel: Any, *inputs: Any, length: int | None = None) -> Any:
    """Run ``kernel`` over broadcast ``inputs`` and return its outputs: the parameters that no input was given for.

    One-dimensional arrays hold one entry a thread and broadcast; scalars and two-dimensional arrays (thread, step) are
    passed as they are. ``length`` is the second dimension of two-dimensional outputs. Structs come back as
    :func:`columns`, numbers as float64; a single output without a tuple.
    """
    parameters = list(inspect.signature(kernel.func).parameters.values())
    given = [(p.annotation, value) for p, value in zip(parameters, inputs, strict=False)]
    shape = np.broadcast_shapes(
        *(
            np.shape(value)[:1] if kind.ndim == 2 else np.shape(value)[: np.ndim(value) - len(_inner(kind.dtype))]
            for kind, value in given
            if isinstance(kind, wp.array)
        )
    )
    count = int(np.prod(shape))
    arguments: list[Any] = []
    for kind, value in given:
        if not isinstance(kind, wp.array):
            arguments.append(value)
            continue
        value = np.asarray(value) if _fields(kind.dtype) else np.asarray(value, wp.dtype_to_numpy(_scalar(kind.dtype)))
        if kind.ndim == 1:
            inner = _inner(kind.dtype)
            value = np.broadcast_to(value, shape + inner).reshape((count, *inner))
        arguments.append(wp.array(np.ascontiguousarray(value), dtype=kind.dtype, device="cpu"))
    results = []
    for parameter in parameters[len(inputs) :]:
        kind = parameter.annotation
        results.append(wp.zeros(count if kind.ndim == 1 else (count, length), dtype=kind.dtype, device="cpu"))
    wp.launch(kernel, dim=count, inputs=arguments, outputs=results, device="cpu")
    back = [_host(result, shape) for result in results]
    return back[0] if len(back) == 1 else tuple(back)


def _fields(dtype: Any) -> bool:
    return hasattr(dtype, "numpy_dtype") and isinstance(dtype.numpy_dtype(), dict)


def _inner(dtype: Any) -> tuple[int, ...]:
    return tuple(getattr(dtype, "_shape_", ()))


def _scalar(dtype: Any) -> Any:
    return getattr(dtype, "_wp_scalar_type_", dtype)


def _host(array: Any, shape: tuple[int, ...]) -> Any:
    out = array.numpy()
    if out.dtype.names:
        return columns(out.reshape(shape))
    out = out.reshape(shape + out.shape[1:])
    return out.astype(np.float64) if out.dtype == np.float32 else out
