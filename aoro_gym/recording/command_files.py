"""Files of commands: a column of time, and one for each command that is not at rest."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aoro_gym.checks import check_range
from aoro_gym.recording.cells import listed, shown
from aoro_gym.recording.commands import ALL_COMMAND_BOUNDS
from aoro_gym.recording.logs import NOT_ASKED, QUANTITIES, find_quantities, signal_from_voltage
from aoro_gym.recording.tables import Table, read_table
from aoro_gym.recording.units import NamedQuantity, canonical

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class CommandFile:
    """Rows of commands."""

    table: Table
    clock: str
    """Name of the column of time."""
    time: Floats
    """(K,) seconds; from the first row on if the clock counts since 1970 or holds stamps."""
    commands: dict[str, Floats]
    """(K,) by name, within ALL_COMMAND_BOUNDS."""
    unread: tuple[str, ...]
    """Columns that are neither commands nor measured, nor the simulator's state."""


def read_commands(path: Path) -> CommandFile:
    """Read a file of commands; columns are found by quantity and unit, as those of a log.

    Raises:
        ValueError: names file, line, column and value of the first fault, or a column that is nearly a command.
    """
    table = read_table(path)
    found = find_quantities(table.names)
    if "time" not in found:
        raise ValueError(f"{path}: the header has no column time_s, only {listed(table.names)}")
    unread = _unknown(table, found)
    clock, quantity = _only(table, "time", found["time"])
    time, _ = table.elapsed(clock, quantity.unit)
    start = table.starts_at(clock, quantity.unit)
    columns = {name: _command(table, name, found[name]) for name in ALL_COMMAND_BOUNDS if name in found}
    if "steering_signal" not in columns and "steering_voltage" in found:
        columns["steering_signal"] = _steering_by_voltage(table, found["steering_voltage"])
    if not columns:
        raise ValueError(f"{path} has no command column; known: {', '.join(ALL_COMMAND_BOUNDS)}")
    return CommandFile(table, clock, time + start, columns, unread)


def _unknown(table: Table, found: dict[str, list[tuple[str, NamedQuantity]]]) -> tuple[str, ...]:
    """Columns that nobody knows; ``ValueError`` for one whose name is nearly that of a command."""
    known = {name for columns in found.values() for name, _ in columns}
    commands = [*ALL_COMMAND_BOUNDS, "steering_signal_V"]
    unknown = []
    for name in table.names:
        bare = canonical(name[:60])
        if name in known or not bare or NOT_ASKED.fullmatch(bare):
            continue
        near = difflib.get_close_matches(bare, commands, n=1, cutoff=0.75)
        if near:
            raise ValueError(
                f"{table.path}: unknown column {shown(name)}; did you mean {near[0]!r}? If it is no command, leave it out"
            )
        unknown.append(name)
    return tuple(unknown)


def _only(table: Table, key: str, columns: list[tuple[str, NamedQuantity]]) -> tuple[str, NamedQuantity]:
    """The column of a quantity; the project's own name goes before others."""
    (name, quantity), *others = columns
    if others and name != QUANTITIES[key].column:
        names = listed([name, *(other for other, _ in others)])
        raise ValueError(f"{table.path}: {names} name the same quantity; leave one")
    if quantity.is_unknown:
        raise ValueError(
            f"{table.path}: column {shown(name)} is in {shown(quantity.unit_text)}, which is no unit of this quantity; "
            f"name it {QUANTITIES[key].column}, for instance"
        )
    return name, quantity


def _command(table: Table, key: str, columns: list[tuple[str, NamedQuantity]]) -> Floats:
    name, quantity = _only(table, key, columns)
    values = table.numbers(name)
    values = values if quantity.unit is None else quantity.unit.to_si(values)
    low, high, _ = ALL_COMMAND_BOUNDS[key]
    for index in np.flatnonzero(~((values >= low - 1e-12) & (values <= high + 1e-12))):
        check_range(f"{table.where(int(index))}: {name}", values[index], ge=low, le=high)
    if key == "gear" and (values != np.rint(values)).any():
        index = int(np.argmax(values != np.rint(values)))
        raise ValueError(f"{table.where(index)}: {name} is {values[index]:g}, but must be one of 1, 2, 3")
    return np.clip(values, low, high)


def _steering_by_voltage(table: Table, columns: list[tuple[str, NamedQuantity]]) -> Floats:
    name, quantity = _only(table, "steering_voltage", columns)
    assert quantity.unit is not None
    voltage = quantity.unit.to_si(table.numbers(name))
    for index in np.flatnonzero(~((voltage >= 0.5 - 1e-12) & (voltage <= 4.5 + 1e-12))):
        check_range(f"{table.where(int(index))}: {name}", voltage[index], "V", ge=0.5, le=4.5)
    return np.clip(signal_from_voltage(voltage), -1.0, 1.0)
