"""Constants of machines: each with its unit, range and source, and how a machine is drawn around them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Constant:
    """One constant of a machine, in SI units.

    Args:
        unit: Of all numbers.
        low, nominal, high: Range of healthy machines, about 98 % of them, and its middle.
        source: P the published vehicle, D follows from it, R catalogue, E estimate with its reason, or literature.
        day: Standard deviation between days, of the logarithm; of the value where the nominal is nought.
    """

    unit: str
    low: float
    nominal: float
    high: float
    source: str
    day: float = 0.0


Table = Mapping[str, Constant]


def nominal(table: Table) -> dict[str, float]:
    """The machine in the middle of every range."""
    return {name: one.nominal for name, one in table.items()}


def draw(table: Table, rng: np.random.Generator) -> dict[str, float]:
    """A machine: each constant normal around its middle; a range is ±2.33 standard deviations, and its bound."""
    machine = {}
    for name, one in table.items():
        z = float(np.clip(rng.standard_normal() / 2.33, -1.0, 1.0))
        machine[name] = one.nominal + z * (one.high - one.nominal if z > 0.0 else one.nominal - one.low)
    return machine


def vary(table: Table, machine: Mapping[str, float], rng: np.random.Generator) -> dict[str, float]:
    """The same machine on another day: what has a daily spread moves by it, at most by two standard deviations."""
    other = dict(machine)
    for name, one in table.items():
        z = float(np.clip(rng.standard_normal(), -2.0, 2.0))
        if one.day > 0.0:
            other[name] = other[name] * float(np.exp(z * one.day)) if one.nominal else other[name] + z * one.day
    return other
