"""Manifests: what the crew, or a simulation, notes of a log in ``NAME.toml`` beside it.

>>> read_manifest(Path("turn.csv")).oil_temperature_C  # doctest: +SKIP
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from aoro_gym.execution.files import read_toml

LONGEST_ECHO = 60
"""Characters of a value that a message repeats."""

_NUMBERS: Mapping[str, tuple[float, float, str]] = {
    # key: least, most, unit
    "oil_temperature_C": (-40.0, 120.0, "°C"),
    "engine_speed_rpm": (500.0, 3000.0, "rpm"),
    "payload_kg": (0.0, 20_000.0, "kg"),
    "tire_pressure_bar": (0.2, 12.0, "bar"),
    "signal_percent": (-100.0, 100.0, "%"),
    "duration_s": (0.0, 1e6, "s"),
    "start_angle_deg": (-90.0, 90.0, "deg"),
}
GROUND: Mapping[str, tuple[float, float, str]] = {
    "slope_deg": (-45.0, 45.0, "deg"),
    "direction_deg": (-360.0, 360.0, "deg"),
    "friction": (0.01, 2.0, "x asphalt"),
    "rolling_resistance": (0.0, 50.0, "x asphalt"),
}
"""Of the table ``ground``: the fields of an inclined plane, with their bounds."""
_TEXTS = ("manoeuvre", "sensors")
_TABLES = ("ground", "world", "crane", "machine", "simulation")
KEYS = (*_NUMBERS, "gear", "filters", *_TEXTS, *_TABLES)
"""What a manifest may hold."""


@dataclass(frozen=True)
class Manifest:
    """Conditions of a log; None where the manifest is silent, or where there is none."""

    path: Path | None = None
    values: Mapping[str, Any] = field(default_factory=dict)
    """All that it holds, as it stands there."""
    ground: Mapping[str, float] | None = None
    """Fields of the inclined plane that was driven on, by the keys of :data:`GROUND`."""
    oil_temperature_C: float | None = None
    engine_speed_rpm: float | None = None
    gear: int | None = None
    payload_kg: float | None = None
    tire_pressure_bar: float | None = None
    filters: tuple[str, ...] = ()
    """Filters that have been applied to signals, in words."""
    warnings: tuple[str, ...] = ()
    """Keys that are not known, and so not read."""


def read_manifest(log: Path) -> Manifest:
    """The manifest beside ``log``; an empty one if there is none.

    Raises:
        ValueError: it is no TOML, or a value has the wrong type or is out of its bounds; names file, key, value and bound.
    """
    path = log.with_suffix(".toml")
    if not path.is_file():
        return Manifest()
    values = read_toml(path)
    try:
        numbers = {key: _number(key, values[key], _NUMBERS[key]) for key in _NUMBERS if key in values}
        for key in _TEXTS:
            _typed(key, values.get(key, ""), str, "text")
        for key in _TABLES:
            _typed(key, values.get(key, {}), dict, "a table")
        return Manifest(
            path,
            values,
            ground=_ground(values["ground"]) if "ground" in values else None,
            oil_temperature_C=numbers.get("oil_temperature_C"),
            engine_speed_rpm=numbers.get("engine_speed_rpm"),
            gear=_gear(values["gear"]) if "gear" in values else None,
            payload_kg=numbers.get("payload_kg"),
            tire_pressure_bar=numbers.get("tire_pressure_bar"),
            filters=tuple(_filter(one) for one in _typed("filters", values.get("filters", []), list, "a list")),
            warnings=tuple(_unknown(path, values)),
        )
    except ValueError as error:
        raise ValueError(f"manifest {path}: {error}") from None


def _ground(table: Mapping[str, Any]) -> dict[str, float]:
    return {key: _number(f"ground.{key}", value, GROUND[key]) for key, value in table.items() if key in GROUND}


def _number(key: str, value: Any, bounds: tuple[float, float, str]) -> float:
    low, high, unit = bounds
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{key} is {_shown(value)}, but must be a number [{unit}]")
    if not low <= value <= high:  # not a number never is
        raise ValueError(f"{key} is {_shown(value)}, but must be in [{low:g}, {high:g}] {unit}")
    return float(value)


def _gear(value: Any) -> int:
    number = _number("gear", value, (1.0, 3.0, "(1, 2 or 3)"))
    if not math.isclose(number, round(number)):
        raise ValueError(f"gear is {_shown(value)}, but must be one of 1, 2, 3")
    return round(number)


def _filter(value: Any) -> str:
    if not isinstance(value, str | dict):
        raise ValueError(f"filters holds {_shown(value)}, but each must be text or a table")
    return value if isinstance(value, str) else ", ".join(f"{key} {_shown(item)}" for key, item in value.items())


def _typed(key: str, value: Any, kind: Callable[..., Any], name: str) -> Any:
    if not isinstance(value, kind):  # pyright: ignore[reportArgumentType]
        raise ValueError(f"{key} is {_shown(value)}, but must be {name}")
    return value


def _unknown(path: Path, values: Mapping[str, Any]) -> list[str]:
    ground = values.get("ground", {})
    found = [(key, KEYS) for key in values if key not in KEYS]
    found += [(f"ground.{key}", tuple(f"ground.{known}" for known in GROUND)) for key in ground if key not in GROUND]
    sentences = []
    for key, known in found[:5]:
        near = difflib.get_close_matches(key[:LONGEST_ECHO], known, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        sentences.append(f"manifest {path}: unknown key {_shown(key)} was not read{hint}")
    if len(found) > 5:
        sentences.append(f"manifest {path}: {len(found) - 5} more unknown keys were not read")
    return sentences


def _shown(value: Any) -> str:
    """``value`` as it is written, shortened."""
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) >= 10**15:
        return f"an integer of {int(value.bit_length() * math.log10(2.0)) + 1} digits"
    text = repr(value) if not isinstance(value, list | dict) else f"a {'list' if isinstance(value, list) else 'table'}"
    return text if len(text) <= LONGEST_ECHO else f"{text[: LONGEST_ECHO - 1]}…"
