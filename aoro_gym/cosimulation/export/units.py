"""Units as FMI defines them: exponents of the SI base units, and a factor."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable

from aoro_gym.machine.quantities import UNITS

_BASE: dict[str, dict[str, int]] = {
    "1": {},
    "kg": {"kg": 1},
    "m": {"m": 1},
    "s": {"s": 1},
    "rad": {"rad": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
}
"""Exponents of the base units by the SI units that the machine file is made of."""


def base_units(unit: str) -> tuple[dict[str, int], float]:
    """Exponents by base unit of ``unit``, and its size in them: ``"bar"`` is ({kg: 1, m: -1, s: -2}, 1e5)."""
    si, factor = UNITS.get(unit, (unit, 1.0))
    total: Counter[str] = Counter()
    for sign, symbol, power in re.findall(r"(^|[*/])([A-Za-z1]+)(?:\^(\d+))?", si):
        for base, exponent in _BASE[symbol].items():
            total[base] += (-1 if sign == "/" else 1) * exponent * int(power or 1)
    return {base: exponent for base, exponent in total.items() if exponent}, factor


def definitions(units: Iterable[str]) -> dict[str, dict[str, str]]:
    """Attributes of FMI's ``BaseUnit`` by unit, sorted; a factor of 1 is left out."""
    out = {}
    for unit in sorted(set(units)):
        exponents, factor = base_units(unit)
        out[unit] = {base: str(exponent) for base, exponent in exponents.items()}
        if factor != 1.0:
            out[unit]["factor"] = repr(factor)
    return out
