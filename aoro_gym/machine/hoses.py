"""Hoses by length, inner diameter and type: which volume of oil and which stiffness of wall follow.

Volume of ``count`` hoses of length L and inner diameter d side by side: V = count π d² L / 4. The modulus of a wall is
B = V dp/dV, of the volume that it encloses; with the oil's in series, 1/β_eff = 1/β_oil + 1/B, it is the modulus of the
line. It follows from one of

- a type of hose, whose modulus is published (:data:`TYPES`);
- what a catalogue calls volumetric expansion, ΔV' per length at a pressure p: B = p (π d² / 4) / ΔV', a secant, which
  holds from 0 to p. A static figure: moving hoses are stiffer (S26);
- the wall s of a steel tube, by Lamé's thick cylinder without axial strain of its ends:
  1/B = (2/E) ((D² + d²)/(D² - d²) + ν) with D = d + 2 s (Merritt, Hydraulic Control Systems, 1967); B = E s/d where it
  is thin.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from aoro_gym.machine.quantities import UNITS
from aoro_gym.units import BAR

STEEL = (206e9, 0.3)
"""Young's modulus [Pa] and Poisson's ratio of a tube (R)."""


@dataclass(frozen=True)
class HoseType:
    """A kind of hose."""

    modulus: float
    """Of its wall [Pa]."""
    range: tuple[float, float]
    """[Pa]"""
    source: str


TYPES: Mapping[str, HoseType] = {
    "double wire braid": HoseType(1.2e9, (8e8, 1.64e9), "P"),
    "four steel spirals": HoseType(1.64e9, (1.2e9, 1.9e9), "P"),
}
"""Types whose modulus is published; for any other a catalogue has the expansion."""
TUBE = "steel tube"
"""Type of a line that is no hose."""

LINES: Mapping[str, tuple[str, str]] = {
    "arm.hose": ("arm.hose_volume", "arm.hose_bulk_modulus"),
    "steering.hose": ("steering.hose_volume", "steering.hose_bulk_modulus"),
    "steering.pump.hose": ("steering.pump.line_volume", "steering.pump.hose_bulk_modulus"),
    "steering.tank_line.hose": ("steering.tank_line.volume", "steering.tank_line.hose_bulk_modulus"),
    "driveline.hose": ("driveline.main_volume", "driveline.hose_bulk_modulus"),
}
"""Tables that give a line by its hoses, and the keys of the volume and of the modulus that follow."""

VOLUME_SPREAD = 0.2
"""Relative half range of a volume that follows: fittings, blocks, and 5 % of a diameter (E)."""
MODULUS_SPREAD = 0.2
"""Relative half range of a modulus that follows from an expansion (E)."""
TUBE_SPREAD = 0.05
"""The same from a tube's wall (E)."""

BOUNDS: Mapping[str, tuple[float, float, str]] = {
    "length_m": (0.05, 100.0, "m, the length of one hose"),
    "diameter_mm": (2.0, 100.0, "mm, the inner diameter"),
    "count": (1, 8, "hoses side by side"),
    "wall_mm": (0.3, 20.0, "mm, the wall of a steel tube"),
    "expansion_cm3_per_m": (1e-3, 1e3, "cm³ a metre of hose, its volumetric expansion"),
    "expansion_bar": (1.0, 1000.0, "bar, the pressure of that expansion"),
}
"""Least and largest value of each field, and what it is."""


def volume(length: float, diameter: float, count: int = 1) -> float:
    """Oil [m³] in ``count`` hoses of a length and an inner diameter [m]."""
    return count * 0.25 * math.pi * diameter**2 * length


def modulus_of_expansion(diameter: float, expansion: float, pressure: float) -> float:
    """Modulus [Pa] of a wall by its volumetric expansion [m³/m] at a pressure [Pa]; inner diameter [m]."""
    return pressure * 0.25 * math.pi * diameter**2 / expansion


def modulus_of_tube(diameter: float, wall: float) -> float:
    """Modulus [Pa] of a steel tube of an inner diameter and a wall [m]."""
    young, poisson = STEEL
    inner, outer = diameter**2, (diameter + 2.0 * wall) ** 2
    return 0.5 * young / ((outer + inner) / (outer - inner) + poisson)


def take_hoses(tables: dict[str, Mapping[str, Any]]) -> dict[str, Mapping[str, Any]]:
    """Remove the tables of :data:`LINES` from those of one file by key, and give what they say of volume and modulus.

    Raises:
        ValueError: names the table, its field, the value, the bound and what to give instead.
    """
    found: dict[str, Mapping[str, Any]] = {}
    for key, keys in LINES.items():
        if key in tables:
            table = tables.pop(key)
            twice = [one for one in keys if "value" in tables.get(one, {})]
            if twice:
                raise ValueError(f"{key} and {twice[0]} give the same; give the hose or {' and '.join(keys)}")
            found |= zip(keys, _fields(key, table), strict=True)
    return found


def _fields(key: str, table: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Fields of the volume's and of the modulus' table, in L and Pa."""
    _check(key, table)
    length, diameter, count = float(table["length_m"]), 1e-3 * float(table["diameter_mm"]), int(table.get("count", 1))
    litres = volume(length, diameter, count) / UNITS["L"][1]
    what = f"{count} hoses of {length:g} m" if count > 1 else f"a hose of {length:g} m"
    source = f"D: {what}, {1e3 * diameter:g} mm"
    own = table.get("source", "")
    low, high = 1.0 - VOLUME_SPREAD, 1.0 + VOLUME_SPREAD
    oil = {"value": litres, "unit": "L", "range": [low * litres, high * litres], "source": source}
    modulus, limits, origin = _wall(table, diameter)
    wall = {"value": modulus, "unit": "Pa", "range": list(limits), "source": origin}
    for one in (oil, wall):
        one["source"] += f"; {own}" if own else ""
    return oil, wall


def _wall(table: Mapping[str, Any], diameter: float) -> tuple[float, tuple[float, float], str]:
    """Modulus [Pa] of a wall, its range and where it comes from."""
    kind = str(table.get("type", ""))
    if kind in TYPES:
        known = TYPES[kind]
        return known.modulus, known.range, f"{known.source}: {kind}"
    if kind == TUBE:
        wall = float(table["wall_mm"])
        modulus, spread = modulus_of_tube(diameter, 1e-3 * wall), TUBE_SPREAD
        origin = f"D: {TUBE}, {1e3 * diameter:g} mm inside, wall {wall:g} mm"
    else:
        expansion, pressure = float(table["expansion_cm3_per_m"]), float(table["expansion_bar"])
        modulus, spread = modulus_of_expansion(diameter, 1e-6 * expansion, pressure * BAR), MODULUS_SPREAD
        origin = f"D: expands by {expansion:g} cm³/m at {pressure:g} bar"
    return modulus, ((1.0 - spread) * modulus, (1.0 + spread) * modulus), origin


def _check(key: str, table: Mapping[str, Any]) -> None:
    """ValueError unless a table says all of a hose, once."""
    known = (*BOUNDS, "type", "source")
    for name in table:
        if name not in known:
            raise ValueError(f"{key}: unknown field {name[:40]!r}; a hose has {', '.join(known)}")
    for name in ("length_m", "diameter_mm"):
        if name not in table:
            raise ValueError(f"{key}: lacks {name}, in {BOUNDS[name][2]}")
    for name, (low, high, what) in BOUNDS.items():
        value = table.get(name, low)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not (is_number and low <= value <= high and (name != "count" or value == int(value))):
            raise ValueError(f"{key}: {name} = {str(value)[:40]}: must be from {low:g} to {high:g} {what}")
    if not isinstance(table.get("source", ""), str):
        raise ValueError(f"{key}: source = {str(table['source'])[:40]}: must be text")
    kind, types = table.get("type"), (*TYPES, TUBE)
    expands = [name for name in ("expansion_cm3_per_m", "expansion_bar") if name in table]
    if kind is not None and kind not in types:
        raise ValueError(
            f"{key}: type = {str(kind)[:40]!r}: must be one of {', '.join(types)}; of any other hose give"
            " expansion_cm3_per_m at expansion_bar, from its catalogue"
        )
    if (kind is None) != (len(expands) == 2) or (kind is not None and expands):
        raise ValueError(f"{key}: give either type or both expansion_cm3_per_m and expansion_bar")
    if (kind == TUBE) != ("wall_mm" in table):
        raise ValueError(f"{key}: wall_mm belongs to type = {TUBE!r}, which needs it; nothing else has it")
