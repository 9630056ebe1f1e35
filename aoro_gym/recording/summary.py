"""What was read of a log, in lines: columns and their units, sampling, what is missing, doubtful and not read."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from aoro_gym.recording.cells import listed
from aoro_gym.recording.logs import CHANNELS, QUANTITIES, TICK, Log
from aoro_gym.recording.units import find_unit, parse_name


def describe(recording: Log, *, channels: Collection[str] = tuple(CHANNELS)) -> list[str]:
    """Lines that say what a log gave: the first names it, the others are indented.

    Args:
        recording: As it was read.
        channels: Measured quantities that were wanted: those that it lacks are named.
    """
    lines = [
        f"{recording.path}: {recording.duration:.2f} s at {recording.rate:.4g} Hz, the first "
        f"{recording.rest * TICK:.2f} s at rest"
    ]
    time = recording.columns["time"]
    lines.append(f"  time: {time.name}, in {time.reading}")
    for name, values in recording.commands.items():
        lines.append(f"  command {name}: {_column(recording, name)}, {np.min(values):.3g} to {np.max(values):.3g}")
    for name, values in recording.channels.items():
        lines.append(f"  {name}: {_column(recording, name)}, {_span(name, values)}")
    unused = [name for name in channels if name in recording.columns and name not in recording.channels]
    missing = [name for name in channels if name not in recording.columns]
    state = [name for name in recording.unread if name.lower().startswith("true_")]
    unread = [name for name in recording.unread if not name.lower().startswith("true_")]
    if state:
        unread.append(f"true_* ({len(state)}, of a simulator)")
    for what, names in (
        ("read, but not usable", unused),
        ("missing", missing),
        ("not read", unread),
        ("manifest", list(recording.manifest.values)),
    ):
        if names:
            lines.append(f"  {what}: {listed(names, 300)}")
    return [*lines, *(f"  note: {sentence}" for sentence in recording.limitations)]


def _column(recording: Log, quantity: str) -> str:
    """Column, and unit, that a quantity was read from."""
    key = quantity
    if key == "steering_signal" and key not in recording.columns:
        key = "steering_voltage"
    name, unit, reading = recording.columns[key]
    if unit is None:
        return f"{name}, a share" if quantity in recording.commands and quantity != "gear" else name
    return f"{name}, in {reading}"


def _span(quantity: str, values: np.ndarray) -> str:
    """Least and largest value in the unit of the project's own logs."""
    column = QUANTITIES[quantity].column
    named = parse_name(column, QUANTITIES[quantity].bases, *QUANTITIES[quantity].dimensions)
    unit = find_unit("deg", "angle") if quantity == "joint_angle" else named.unit if named else None
    assert unit is not None
    words = {"rad per s": "rad/s", "deg": "°"}.get(unit.symbol, unit.symbol)
    low, high = np.min(values) / unit.factor, np.max(values) / unit.factor
    least = 1e-6 * max(abs(low), abs(high))  # what is left of a zero in a sum of floats is one
    low, high = (0.0 if abs(one) < least else one for one in (low, high))
    return f"{low:.4g} to {high:.4g} {words}"
