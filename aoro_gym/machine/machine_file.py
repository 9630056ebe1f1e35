"""Machine files (TOML): reading, and writing in one canonical form.

A file may be an overlay: ``base = "aoro"``, a bundled machine or a file beside it, and of each parameter only the fields
that differ from the base. A line may be given by its hoses (:mod:`.hoses`).
"""

import json
import math
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.resources import files
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.execution.files import read_toml, write_text
from aoro_gym.machine.hoses import take_hoses
from aoro_gym.machine.laws import Laws, laws_from, to_table
from aoro_gym.machine.quantities import UNITS, Quantity, as_quantity

ROLES = ("fixed", "nuisance", "effect", "both", "law")

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
#   role    fixed     known hardware, or what lies in the bunk
#           nuisance  uncertain: a calibration may move it
#           effect    moved by an effect of the catalogue only
#           both      uncertain, and moved by effects too: within 2 % once the machine is commissioned
#           law       used where the table [laws] chooses the law that it belongs to, and nowhere else
#   note    optional remark
#   published  optional: what the publication gives, in `unit`; kept beside whatever a calibration makes of the value
#
# S5  Danfoss, Series 90 electric displacement control MCV111B, manual
# S7  field notes on closed-loop hydrostatics, unreviewed (low weight)
# S8  John Deere 4045TF250, leaflet                S9  John Deere 4045H generator engine, leaflet
# S11 Project Chrono, HMMWV LuGre tire             S13 Project Chrono, 335/65 R22.5 tire
# S14 Simscape wheel-loader model, parameter scripts
# S16 Hopsan, default hydraulic component library  S17 MathWorks, Hydraulic Fluid and Isothermal Liquid
# S18 MapleSim, constant-volume component          S19 Sharp & Granger, steering torques at parking speeds
# S26 Johnston, Drew & Longmore, dynamic modulus of hoses, J. Vib. Acoust. 132, 2010, 021011
# S27 Hydraulic fluids, lecture text
# S29 Precision Mining, rolling-resistance appendix
# S39 Repola, Heikkinen & Lindblad, green density of pulpwood, Silva Fennica 55(4), 2021, 10539 (abstract)
"""

_OVERLAY_HEADER = """\
# Machine file: what differs from the machine that `base` names, whose file says what the fields mean.

"""

COMMISSIONED_SPREAD = 0.02
"""Relative half range (about 95 %) of a parameter that effects move too, on a machine that was commissioned: healthy logs
have fixed it, and from day to day it wanders by no more. What leaves it is an effect."""

DATA_SHEET = "aoro_datasheet"
"""The bundled machine whose file is complete."""

PAYLOAD = "payload."
"""Beginning of the keys of what lies in the bunk."""

LONGEST_CHAIN = 8
"""Files that may stand on each other as bases."""
DEEPEST = 8
"""Levels of tables that a machine file may have."""
LONGEST_ECHO = 60
"""Characters of a name or a value that a message repeats."""

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
    published: float | None = None
    """What Lehto et al. give, in ``unit``; None where they give nothing."""

    @property
    def deviation(self) -> Quantity | None:
        """Relative deviation of the value from the published one [-]; None where nothing is published."""
        return None if self.published is None else self.value / self.published - 1.0

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


def read_machine(name_or_path: str | PathLike[str]) -> tuple[str, dict[str, Parameter], Laws]:
    """Name, parameters by dotted key, and laws, as written: neither units, bounds nor completeness are checked here.

    A file that says nothing of the parameters of some law (role ``law``), or of the load, has those of the bundled data
    sheet.

    Raises FileNotFoundError, or ValueError that names the file if it is not TOML or a table lacks a field.
    """
    path = _file_of(name_or_path)
    name = path.stem
    with naming(name_or_path):
        tables, laws = _merged(path)
        return name, {key: _parameter(key, table) for key, table in tables.items()}, laws_from(laws)


def read_parameters(path: Path) -> dict[str, Parameter]:
    """Parameters by dotted key of a file of such tables that stands on no other; ValueError as :func:`read_machine`."""
    with naming(path):
        return {key: _parameter(key, table) for key, table in _tables(read_toml(path))}


def _merged(path: Path, overlays: int = 0) -> tuple[dict[str, Mapping[str, Any]], dict[str, Any]]:
    """Tables of a file by dotted key, and its laws, those of its base among them."""
    document = read_toml(path)
    base = document.pop("base", None)
    laws = document.pop("laws", {})
    if not isinstance(laws, Mapping):
        raise ValueError(f"laws = {_echo(laws)}: must be a table [laws] with a family, or an option by law")
    own = dict(_tables(document))
    hoses = take_hoses(own)
    if base is None:
        return _with_hoses({**_usual_parameters(), **own}, hoses), dict(laws)
    if not isinstance(base, str):
        raise ValueError(f"base = {_echo(base)}: must be the name of a machine or a file that ends in .toml, as text")
    if overlays >= LONGEST_CHAIN:
        raise ValueError(f"base = {_echo(base)}: more than {LONGEST_CHAIN} files stand on each other, or in a circle")
    try:
        file = _file_of(_beside(path, base))
    except FileNotFoundError as error:
        raise ValueError(f"base = {_echo(base)}: {error}") from None
    tables, base_laws = _merged(file, overlays + 1)
    for key, changed in own.items():
        tables[key] = {**tables.get(key, {}), **changed}
    return _with_hoses(tables, hoses), {**({} if "family" in laws else base_laws), **laws}


def _with_hoses(
    tables: dict[str, Mapping[str, Any]], hoses: Mapping[str, Mapping[str, Any]]
) -> dict[str, Mapping[str, Any]]:
    """``tables`` with volumes and moduli that follow from hoses; role and what is published stay the data sheet's."""
    for key, fields in hoses.items():
        tables[key] = {**_data_sheet()[key], **tables.get(key, {}), **fields}
    return tables


@cache
def _data_sheet() -> dict[str, Mapping[str, Any]]:
    """Tables of the bundled data sheet by dotted key."""
    return dict(_tables(read_toml(_file_of(DATA_SHEET))))


@cache
def _usual_parameters() -> dict[str, Mapping[str, Any]]:
    """Tables of the data sheet's parameters of the role ``law``, and of its load: an empty bunk."""
    tables = _data_sheet().items()
    return {key: table for key, table in tables if table["role"] == "law" or key.startswith(PAYLOAD)}


def _beside(path: Path, base: str) -> str | Path:
    """The machine that the file ``path`` names as its base: a bundled one, or a file beside it."""
    return path.parent / base if base.endswith(".toml") else base


def _file_of(name_or_path: str | PathLike[str]) -> Path:
    path = Path(name_or_path)
    if path.suffix == ".toml":
        if not path.is_file():
            raise FileNotFoundError(f"no machine file {path}")
        return path
    if str(name_or_path) not in bundled_machines():
        raise FileNotFoundError(
            f"no bundled machine {str(name_or_path)!r}: use one of {', '.join(bundled_machines())}, or a path that ends in "
            ".toml"
        )
    return Path(str(files("aoro_gym").joinpath("machines", f"{name_or_path}.toml")))


@contextmanager
def naming(name_or_path: str | PathLike[str]) -> Iterator[None]:
    """Put the name of a machine, or its file, before the message of a ``ValueError``."""
    try:
        yield
    except ValueError as error:
        what = "machine file" if str(name_or_path).endswith(".toml") else "machine"
        raise ValueError(f"{what} {name_or_path}: {error}") from None


def write_machine(
    path: str | PathLike[str], entries: Mapping[str, Parameter], laws: Laws, base: str | None = None
) -> None:
    """Write ``entries`` (single values) in their order, and ``laws``; with a ``base``, only what differs."""
    lines, known, base_laws = [_HEADER], {}, Laws()
    if base is not None:
        lines = [_OVERLAY_HEADER + f"base = {json.dumps(base, ensure_ascii=False)}\n"]
        known, base_laws = read_machine(_beside(Path(path), base))[1:]
    if to_table(laws) != to_table(base_laws):
        chosen = {"family": "default", **to_table(laws)}
        lines += ["[laws]", *(f"{law} = {json.dumps(option)}" for law, option in chosen.items()), ""]
    for key, entry in entries.items():
        was = _fields(known[key]) if key in known else {"note": '""'}
        changed = [f"{name} = {text}" for name, text in _fields(entry).items() if was.get(name) != text]
        if changed:
            lines += [f"[{key}]", *changed, ""]
    write_text(Path(path), "\n".join(lines))


def _fields(entry: Parameter) -> dict[str, str]:
    """Fields of a parameter's table as TOML writes them."""
    low, high = entry.range
    return {
        "value": _toml_number(float(entry.value)),
        "unit": json.dumps(entry.unit, ensure_ascii=False),
        "range": f"[{_toml_number(low)}, {_toml_number(high)}]",
        "source": json.dumps(entry.source, ensure_ascii=False),
        "role": json.dumps(entry.role, ensure_ascii=False),
        "note": json.dumps(entry.note, ensure_ascii=False),
        **({} if entry.published is None else {"published": _toml_number(entry.published)}),
    }


def _tables(document: Mapping[str, Any], prefix: str = "", depth: int = 0) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Dotted key and table of every parameter; a table that holds a ``value`` is one."""
    for name, content in document.items():
        key = prefix + name
        if not isinstance(content, Mapping):
            raise ValueError(f"{_short(key)}: not a table; give [{_short(key)}] with {', '.join(_FIELDS)}")
        if "value" in content or not any(isinstance(inner, Mapping) for inner in content.values()):
            yield key, content
        elif depth >= DEEPEST:
            raise ValueError(f"{_short(key)}: tables are nested more than {DEEPEST} deep; no parameter is")
        else:
            yield from _tables(content, f"{key}.", depth + 1)


def _parameter(key: str, table: Mapping[str, Any]) -> Parameter:
    shown = _short(key)
    missing = [name for name in _FIELDS if name not in table]
    if missing:
        raise ValueError(f"{shown}: lacks {', '.join(missing)}")
    surplus = [_short(name) for name in table if name not in (*_FIELDS, "note", "published")]
    if surplus:
        raise ValueError(
            f"{shown}: unknown field {', '.join(surplus[:5])}; a table has {', '.join(_FIELDS)}, note and published"
        )
    value, limits = table["value"], table["range"]
    if not _is_number(value):
        raise ValueError(f"{shown} = {_echo(value)}: must be a finite number")
    if not (isinstance(limits, list) and len(limits) == 2 and all(map(_is_number, limits)) and limits[0] <= limits[1]):
        raise ValueError(f"{shown}: range = {_echo(limits)}: must be [low, high] with finite low ≤ high")
    published = table.get("published")
    if published is not None and not (_is_number(published) and published != 0.0):
        raise ValueError(f"{shown}: published = {_echo(published)}: must be a finite number other than 0")
    for name in ("unit", "source", "role", "note"):
        if not isinstance(table.get(name, ""), str):
            raise ValueError(f"{shown}: {name} = {_echo(table[name])}: must be text")
    if not table["source"]:
        raise ValueError(f"{shown}: source is empty; say where the value comes from")
    if table["role"] not in ROLES:
        raise ValueError(f"{shown}: role = {_echo(table['role'])}: must be one of {', '.join(ROLES)}")
    return Parameter(
        key=key,
        value=float(value),
        unit=table["unit"],
        range=(float(limits[0]), float(limits[1])),
        source=table["source"],
        role=table["role"],
        note=table.get("note", ""),
        published=None if published is None else float(published),
    )


def _is_number(value: Any) -> bool:
    """Whether ``value`` is a finite number that a float can hold."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) <= sys.float_info.max  # false for NaN; exact for integers of any length


def _echo(value: Any) -> str:
    """``value`` as a message repeats it."""
    if isinstance(value, int) and not isinstance(value, bool) and value.bit_length() > 64:
        return f"an integer of {int(value.bit_length() * math.log10(2.0)) + 1} digits"
    if isinstance(value, list):
        return f"[{', '.join(map(_echo, value[:2]))}{', …' if len(value) > 2 else ''}]"
    return "a table" if isinstance(value, Mapping) else _short(repr(value))


def _short(text: str) -> str:
    """``text`` in one line of at most :data:`LONGEST_ECHO` characters."""
    line = " ".join(text.split())
    return line if len(line) <= LONGEST_ECHO else f"{line[: LONGEST_ECHO - 1]}…"


def _toml_number(value: float) -> str:
    """Shortest text that reads back as the same float."""
    if value.is_integer() and abs(value) < 1e6:
        return str(int(value))
    mantissa, _, exponent = repr(value).partition("e")
    if not exponent and abs(value) >= 1e6:
        mantissa, _, exponent = np.format_float_scientific(value, trim="-").partition("e")
    return f"{mantissa}e{int(exponent)}" if exponent else mantissa
