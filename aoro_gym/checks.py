"""Checks of arguments: a message names the argument, its value and what it must be."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike


def check_range(
    name: str,
    value: ArrayLike,
    unit: str = "",
    *,
    ge: float = -math.inf,
    le: float = math.inf,
    gt: float | None = None,
    lt: float | None = None,
    note: str = "",
    error: type[ValueError] = ValueError,
) -> None:
    """Raise an error unless every number of ``value`` is in its range; NaN never is.

    Args:
        name: Of the argument; of an array, the index of the first wrong number follows it.
        value: A number or an array of them.
        unit: Of the value and its bounds, for the message.
        ge: The least that it may be ...
        le: ... and the most.
        gt: In place of ``ge``: what it must be above.
        lt: In place of ``le``: what it must be below; infinity: it must be finite.
        note: End of the message: why, or what to do.
        error: Kind of error.
    """
    numbers = np.asarray(value)
    within = (numbers >= ge if gt is None else numbers > gt) & (numbers <= le if lt is None else numbers < lt)
    if np.all(within):
        return
    index = np.unravel_index(np.argmin(within), within.shape)
    where = f"[{', '.join(map(str, index))}]" if index else ""
    unit = f" {unit}" if unit else ""
    raise error(f"{name}{where} is {_digits(numbers[index])}{unit}, but must be {_range(ge, le, gt, lt, unit)}{note}")


def check_finite(name: str, value: ArrayLike, unit: str = "") -> None:
    """Raise ValueError unless every number of ``value`` is finite."""
    check_range(name, value, unit, gt=-math.inf, lt=math.inf)


def _range(ge: float, le: float, gt: float | None, lt: float | None, unit: str) -> str:
    low, high = ge if gt is None else gt, le if lt is None else lt
    if math.isfinite(low) and math.isfinite(high):
        return f"in {'[' if gt is None else '('}{low:g}, {high:g}{']' if lt is None else ')'}{unit}"
    finite = "finite and " if lt == math.inf or gt == -math.inf else ""
    if math.isfinite(low):
        return f"{finite}{'at least' if gt is None else 'above'} {low:g}{unit}"
    if math.isfinite(high):
        return f"{finite}{'at most' if lt is None else 'below'} {high:g}{unit}"
    return "finite"


def check_integer(name: str, value: Any, *, ge: int = 1, le: int | None = None, note: str = "") -> None:
    """Raise ValueError unless ``value`` is an integer of its range.

    Args:
        name: Of the argument.
        value: What was given.
        ge: The least that it may be ...
        le: ... and the most; None: any.
        note: End of the message: why, or what else may be.
    """
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not (whole and ge <= value and (le is None or value <= le)):
        least = "a positive integer" if ge == 1 else f"an integer of at least {ge}"
        raise ValueError(
            f"{name} is {shortened(value)}, but must be {least if le is None else f'an integer in [{ge}, {le}]'}{note}"
        )


def check_choice(name: str, value: Any, known: Iterable[Any], error: type[ValueError] = ValueError) -> None:
    """Raise an error that lists what is ``known`` unless ``value`` is among it."""
    if value not in known:
        raise error(f"{name} is {shortened(value)}; choose one of: {', '.join(map(str, known))}")


def shortened(value: Any) -> str:
    """``repr(value)``, at most 60 characters of it."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def printable(text: str) -> str:
    """``text`` with a mark in place of every character that a terminal would obey, or not show."""
    return "".join(c if c.isprintable() else "\ufffd" for c in text)


def _digits(value: Any) -> str:
    """A number in as many digits as its type holds, without those that rounding made."""
    return f"{float(str(value)):.10g}" if isinstance(value, float | np.floating) else str(value)
