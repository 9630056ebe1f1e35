"""Machine files (TOML): reading, and writing in one canonical form."""

import json
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.execution.files import write_text
from aoro_gym.twin.quantities import UNITS, Quantity, as_quantity

ROLES = ("fixed", "nuisance", "effect", "both")

_HEADER = """\
# Machine file: one table a parameter, [section.key], in this order.
#
#   value   in `unit`; pressures are gauge, angles positive left and up
#   unit    one of the units that the loader knows
#   range   [low, high], same unit: a soft prior (about 95 %), not a bound of validity
#   source  tag and note
#             P   published: Lehto et al., Machines 2026, 14, 128
#             A   the laboratory's public hardware page
#             S#  another public source, listed below
#             D   derived by arithmetic from published figures
#             1D  inferred with a reduced model of the joint alone; neither measured nor published
#             R   recalled from catalogues or textbooks, not verified
#             E   engineering estimate
#             C   calibrated: found by fitting the twin
#   role    fixed     known hardware
#           nuisance  uncertain: a calibration may move it
#           effect    moved by an effect of the catalogue only
#           both      uncertain, and moved by effects too: within 2 % once the machine is commissioned
#   note    optional remark
#
# S5  Danfoss, Series 90 electric displacement control MCV111B, manual
# S7  field notes on closed-loop hydrostatics, unreviewed (low weight)
# S8  John Deere 4045TF250, leaflet                S9  John Deere 4045H generator engine, leaflet
# S11 Project Chrono, HMMWV LuGre tire             S14 Simscape wheel-loader model, parameter scripts
# S16 Hopsan, default hydraulic component library  S17 MathWorks, Hydraulic Fluid and Isothermal Liquid
# S18 MapleSim, constant-volume component          S27 Hydraulic fluids, lecture text
# S29 Precision Mining, rolling-resistance appendix
"""

COMMISSIONED_SPREAD = 0.02
"""Relative half range (about 95 %) of a parameter that effects move too, on a machine that was commissioned: healthy logs
have fixed it, and from day to day it wanders by no more. What leaves it is an effect."""

_FIELDS = ("value", "unit", "range", "source", "role")


@dataclass(frozen=True, eq=False)
class Parameter:
    """One parameter as the machine file has it."""

    key: str
    value: Quantity  # in ``unit``; float or shape (N,)
    unit: str
    range: tuple[float, float]  # in ``unit``
    source: str
    role: str
    note: str = ""

    @cached_property
    def si(self) -> Quantity:
        """Value in SI; arrays are read-only."""
        return as_quantity(self.value * UNITS[self.unit][1])

    @property
    def commissioned(self) -> tuple[Quantity, Quantity]:
        """Soft range, in ``unit``, in which the parameter stays while nothing is wrong with a commissioned machine."""
        if self.role == "nuisance":
            return self.range
        spread = COMMISSIONED_SPREAD * np.abs(self.value) if self.role == "both" else 0.0
        return self.value - spread, self.value + spread


def bundled_machines() -> list[str]:
    """Names of the machines that come with the package."""
    return sorted(
        entry.name.removesuffix(".toml")
        for entry in files("aoro_gym").joinpath("machines").iterdir()
        if entry.name.endswith(".toml")
    )


def read_machine(name_or_path: str | PathLike[str]) -> tuple[str, dict[str, Parameter]]:
    """Name and parameters by dotted key, as written: neither units, bounds nor completeness are checked here.

    Raises FileNotFoundError, or ValueError if the file is not TOML or a table lacks a field.
    """
    path = Path(name_or_path)
    if path.suffix == ".toml":
        if not path.is_file():
            raise FileNotFoundError(f"no machine file {path}")
        name, text = path.stem, path.read_text(encoding="utf-8")
    else:
        name = str(name_or_path)
        if name not in bundled_machines():
            raise FileNotFoundError(
                f"no bundled machine {name!r}: use one of {', '.join(bundled_machines())}, or a path that ends in .toml"
            )
        text = files("aoro_gym").joinpath("machines", f"{name}.toml").read_text(encoding="utf-8")
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{name_or_path}: {error}") from error
    return name, {key: _parameter(key, table) for key, table in _tables(document)}


def write_machine(path: str | PathLike[str], entries: Mapping[str, Parameter]) -> None:
    """Write ``entries`` (single values) in their order."""
    lines = [_HEADER]
    for entry in entries.values():
        low, high = entry.range
        lines += [
            f"[{entry.key}]",
            f"value = {_toml_number(float(entry.value))}",
            f"unit = {json.dumps(entry.unit, ensure_ascii=False)}",
            f"range = [{_toml_number(low)}, {_toml_number(high)}]",
            f"source = {json.dumps(entry.source, ensure_ascii=False)}",
            f"role = {json.dumps(entry.role, ensure_ascii=False)}",
            *([f"note = {json.dumps(entry.note, ensure_ascii=False)}"] if entry.note else []),
            "",
        ]
    write_text(Path(path), "\n".join(lines))


def _tables(document: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Dotted key and table of every parameter; a table that holds a ``value`` is one."""
    for name, content in document.items():
        key = prefix + name
        if not isinstance(content, Mapping):
            raise ValueError(f"{key}: not a table; give [{key}] with {', '.join(_FIELDS)}")
        if "value" in content or not any(isinstance(inner, Mapping) for inner in content.values()):
            yield key, content
        else:
            yield from _tables(content, f"{key}.")


def _parameter(key: str, table: Mapping[str, Any]) -> Parameter:
    missing = [name for name in _FIELDS if name not in table]
    if missing:
        raise ValueError(f"{key}: lacks {', '.join(missing)}")
    surplus = [name for name in table if name not in (*_FIELDS, "note")]
    if surplus:
        raise ValueError(f"{key}: unknown field {', '.join(surplus)}; a table has {', '.join(_FIELDS)} and note")
    value, limits = table["value"], table["range"]
    if not _is_number(value):
        raise ValueError(f"{key} = {value!r}: must be a number")
    if not (isinstance(limits, list) and len(limits) == 2 and all(map(_is_number, limits)) and limits[0] <= limits[1]):
        raise ValueError(f"{key}: range = {limits!r}: must be [low, high] with low ≤ high")
    for name in ("unit", "source", "role", "note"):
        if not isinstance(table.get(name, ""), str):
            raise ValueError(f"{key}: {name} = {table[name]!r}: must be text")
    if not table["source"]:
        raise ValueError(f"{key}: source is empty; say where the value comes from")
    if table["role"] not in ROLES:
        raise ValueError(f"{key}: role = {table['role']!r}: must be one of {', '.join(ROLES)}")
    return Parameter(
        key=key,
        value=float(value),
        unit=table["unit"],
        range=(float(limits[0]), float(limits[1])),
        source=table["source"],
        role=table["role"],
        note=table.get("note", ""),
    )


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _toml_number(value: float) -> str:
    """Shortest text that reads back as the same float."""
    if value.is_integer() and abs(value) < 1e6:
        return str(int(value))
    mantissa, _, exponent = repr(value).partition("e")
    if not exponent and abs(value) >= 1e6:
        mantissa, _, exponent = np.format_float_scientific(value, trim="-").partition("e")
    return f"{mantissa}e{int(exponent)}" if exponent else mantissa
