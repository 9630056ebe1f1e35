"""Contents of a policy's files, each checked as it is read: a message names what is missing or wrong."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.checks import check_finite

FORMAT, FORMAT_WITH_MEMORY, FORMATS = 2, 3, (1, 2, 3)
"""Of the files that are written, of policies without and with a memory, and those that are read; those of 1 do not say which
numbers they are of."""


def shortened(value: Any) -> str:
    """What a file holds, for a message."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:40]}... ({len(text)} characters)"


def fingerprint(content: bytes) -> str:
    return f"sha256:{hashlib.sha256(content).hexdigest()}"


class NoNumbers(ValueError):
    """A file holds no arrays."""


def read_description(
    content: Mapping[str, Any],
) -> tuple[dict[str, Any], list[int], dict[str, float] | None, list[int] | None]:
    """Fields of a :class:`LearnedPolicy`, its sizes, the numbers of its normalisation and the sizes of its memory, from a
    policy's JSON.

    Raises ValueError that names what is missing or wrong.
    """
    if _entry(content, "format", int) not in FORMATS:
        known = ", ".join(map(str, FORMATS))
        raise ValueError(f"format is {shortened(content['format'])}, but this version reads {known}")
    network = _entry(content, "network", dict)
    sizes = _sizes(network, "sizes", "two whole numbers or more", 2)
    memory = _sizes(network, "memory", "three whole numbers", 3, 3) if "memory" in network else None
    observed = sizes[0] if memory is None else memory[0]
    layout = {}
    for name, span in _entry(content, "observation", dict).items():
        whole = isinstance(span, list) and len(span) == 2 and all(type(end) is int for end in span)
        if not whole or not 0 <= span[0] < span[1] <= observed:
            raise ValueError(
                f"observation {shortened(name)} is {shortened(span)}, but must be [first, end] in [0, {observed}]"
            )
        layout[name] = slice(*span)
    normalised = None
    if "normalisation" not in content:
        raise ValueError("normalisation is missing; null stands for none")
    if content["normalisation"] is not None:
        found = _entry(content, "normalisation", dict)
        normalised = {name: _positive(found, name) for name in ("epsilon", "clip")}
    fields = {
        "activation": _entry(network, "activation", str),
        "squashed": _entry(network, "squashed", bool),
        "environment": _entry(content, "environment", str),
        "layout": layout,
        "training": _entry(content, "training", dict),
    }
    return fields, sizes, normalised, memory


def _sizes(network: Mapping[str, Any], name: str, kind: str, least: int, most: int = 1000) -> list[int]:
    """So many whole numbers, each above 0; ValueError if they are others."""
    sizes = _entry(network, name, list)
    whole = all(isinstance(one, int) and not isinstance(one, bool) and one > 0 for one in sizes)
    if not least <= len(sizes) <= most or not whole:
        raise ValueError(f"{name} is {shortened(sizes)}, but must be {kind}, each above 0")
    return sizes


def _entry(content: Mapping[str, Any], name: str, kind: type) -> Any:
    """An entry of the kind; ValueError if it is missing or another."""
    kinds = {int: "a whole number", dict: "an object", list: "a list", str: "text", bool: "true or false"}
    if name not in content:
        raise ValueError(f"{name} is missing")
    if type(content[name]) is not kind:
        raise ValueError(f"{name} is {shortened(content[name])}, but must be {kinds[kind]}")
    return content[name]


def _positive(content: Mapping[str, Any], name: str) -> float:
    value = content.get(name)
    try:
        number = float(value) if type(value) in (int, float) else math.nan  # pyright: ignore[reportArgumentType]
    except OverflowError:
        number = math.inf
    if not 0.0 < number < math.inf:
        raise ValueError(f"{name} is {shortened(value)}, but must be a finite number above 0")
    return number


def read_numbers(file: Path, content: bytes) -> dict[str, NDArray[Any]]:
    """Arrays by name; an error that names the file if it holds none."""
    from safetensors.numpy import load

    try:
        return load(content)
    except Exception as error:  # of a foreign library, for whatever bytes
        raise NoNumbers(f"{file} is no .safetensors: {shortened(str(error))}") from None


def read_array(arrays: Mapping[str, NDArray[Any]], name: str, dimensions: int, kind: Any = np.float32) -> NDArray[Any]:
    """An array of finite numbers; ValueError if it is missing or another."""
    if name not in arrays:
        raise ValueError(f"{name} is missing")
    found = arrays[name]
    if found.ndim != dimensions or found.dtype.kind != "f":
        raise ValueError(
            f"{name} has shape {found.shape} and type {found.dtype}, but must be {dimensions}-dimensional floats"
        )
    check_finite(name, found)
    return found.astype(kind, copy=False)
