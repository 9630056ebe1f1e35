"""The families by name, their kernels, and machines drawn from them."""

import importlib
from collections.abc import Mapping
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np
import warp as wp

from . import constants

FAMILIES = ("alder", "birch", "cedar")


def family_of(name: str) -> ModuleType:
    """Module of a family."""
    if name not in FAMILIES:
        raise ValueError(f"family must be one of {', '.join(FAMILIES)}, not {name!r}")
    return importlib.import_module(f"{__package__}.{name}")


def nominal(family: str) -> dict[str, float]:
    """Machine in the middle of every range of a family."""
    return constants.nominal(family_of(family).TABLE)


def machine(family: str, rng: np.random.Generator) -> dict[str, float]:
    """Constants of a healthy machine of a family, drawn around the published vehicle."""
    return constants.draw(family_of(family).TABLE, rng)


def another_day(healthy: Mapping[str, float], rng: np.random.Generator) -> dict[str, float]:
    """The same machine on another day: oil, seals, ground, air and zeros are a little different."""
    names = set(healthy)
    for family in FAMILIES:
        table = family_of(family).TABLE
        if set(table) <= names:
            return constants.vary(table, healthy, rng)
    raise ValueError("a machine must have all constants of a family")


@cache
def structure(family: str) -> Any:
    """Warp struct of a family's constants."""
    module = family_of(family)
    fields = sorted(module.derived(nominal(family)))
    body = {
        "__annotations__": dict.fromkeys(fields, wp.float64),
        "__module__": __name__,
        "__qualname__": family.title(),
    }
    return wp.struct(type(family.title(), (), body))


@cache
def kernel(family: str) -> Any:
    """Kernel of a family."""
    from .laws.advance import build

    return build(importlib.import_module(f"{__package__}.laws.{family}"), structure(family))


def pack(family: str, machines: list[Mapping[str, float]]) -> np.ndarray:
    """Structured array of machines for the kernel."""
    made = [family_of(family).derived(one) for one in machines]
    kind = structure(family)
    packed: Any = np.zeros(len(made), dtype=kind.numpy_dtype())
    for name in packed.dtype.names or ():
        packed[name] = [one[name] for one in made]
    return packed
