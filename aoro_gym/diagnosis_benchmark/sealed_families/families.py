"""The sealed families by name, their kernels, and machines drawn from them."""

import importlib
from collections.abc import Mapping
from functools import cache
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import warp as wp

from aoro_gym.diagnosis_benchmark.independent import constants

FAMILIES = ("elm", "fir", "hazel")


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
    """The same machine on another day: oil, air, seals, ground, tires and zeros are a little different."""
    for family in FAMILIES:
        table = family_of(family).TABLE
        if set(table) <= set(healthy):
            return constants.vary(table, healthy, rng)
    raise ValueError("a machine must have all constants of a family")


@cache
def structure(family: str) -> Any:
    """Warp struct of a family's constants."""
    fields = sorted(family_of(family).derived(nominal(family)))
    body = {
        "__annotations__": dict.fromkeys(fields, wp.float64),
        "__module__": __name__,
        "__qualname__": family.title(),
    }
    return wp.struct(type(family.title(), (), body))


@cache
def kernel(family: str) -> Any:
    """Kernel of a family: its laws in the vehicle, in the integrator of the independent plants."""
    from aoro_gym.diagnosis_benchmark.independent.laws.advance import build

    from .laws import assembly, places

    laws = importlib.import_module(f"{__package__}.laws.{family}")
    kind = structure(family)
    parts = SimpleNamespace(
        State=places.State,
        derivative=assembly.assemble(laws, kind),
        limit=laws.limit,
        start=laws.start,
        remembered=assembly.nothing_remembered,
        hydraulic_signals=laws.hydraulic_signals,
    )
    return build(parts, kind)


def pack(family: str, machines: list[Mapping[str, float]]) -> np.ndarray:
    """Structured array of machines for the kernel."""
    made = [family_of(family).derived(one) for one in machines]
    packed: Any = np.zeros(len(made), dtype=structure(family).numpy_dtype())
    for name in packed.dtype.names or ():
        packed[name] = [one[name] for one in made]
    return packed
