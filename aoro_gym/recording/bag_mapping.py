"""What a log reads of a bag: which field of which topic holds which quantity, in which unit, with which sign.

A mapping is a TOML file beside the bag (``turn.mcap`` and ``turn.map.toml``), which ``aoro-gym log map`` proposes:

    clock = "stamp"                 # or "recorded": when the recorder got a message

    [columns.joint_angle]
    topic = "/joint_states"
    field = "position[articulation]"
    unit = "rad"
    sign = 1                        # -1 where left is negative

Bags that this project wrote need none. Samples of several topics are put on the instants of the joint angle's: commands hold
from one message to the next, what is measured lies on straight lines between two.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.execution.files import read_toml
from aoro_gym.recording.bag_writing import own_column
from aoro_gym.recording.bags import Floats, Series, series_of, topics_of
from aoro_gym.recording.cells import listed, shown
from aoro_gym.recording.commands import ALL_COMMAND_BOUNDS, WHEELS

UNKNOWN = "?"
"""Stands in a proposal for a unit that must be filled in."""
ENDING = ".map.toml"
"""Of a mapping beside its bag."""
CLOCKS = ("stamp", "recorded")
UNITS: Mapping[tuple[str, str], str] = {
    ("sensor_msgs/msg/JointState", "position"): "rad",
    ("sensor_msgs/msg/JointState", "velocity"): "rad/s",
    ("sensor_msgs/msg/FluidPressure", "fluid_pressure"): "Pa",
    ("sensor_msgs/msg/Temperature", "temperature"): "degC",
}
"""Units that a type of message fixes (REP 103), by type and first field."""
SPOKEN: Mapping[str, tuple[str, ...]] = {
    "joint_angle": ("articulation", "articulated_joint", "center_joint", "centre_joint", "steering_joint"),
    **{f"wheel_rate_{wheel}": (f"velocity_wheel_{wheel}", f"velocity_{wheel}_wheel") for wheel in WHEELS},
}
"""Further names of quantities in topics and fields."""
HELD = (*ALL_COMMAND_BOUNDS, "steering_voltage")
"""Quantities that hold from one message to the next."""
LATE = ("gps_",)
"""Columns that hold likewise, and may begin later than a log."""


@dataclass(frozen=True)
class Mapped:
    """A column of a log and where it comes from.

    Attributes:
        column: Quantity, or a column with its unit in the name where ``unit`` is empty.
        topic: Of the bag.
        field: Path of a field in its messages (:func:`~aoro_gym.recording.bags.number_in`).
        unit: Of the field.
        sign: 1, or −1 where the field's sign is the other one.
    """

    column: str
    topic: str
    field: str
    unit: str = ""
    sign: int = 1

    @property
    def title(self) -> str:
        """Column of a table, with its unit."""
        return f"{self.column} [{self.unit}]" if self.unit else self.column

    @property
    def is_late(self) -> bool:
        """Whether a log may begin before it."""
        return self.column.startswith(LATE)

    @property
    def is_held(self) -> bool:
        """Whether it is a command, or a solution that stays until the next one."""
        return self.is_late or any(self.column.startswith(name) for name in HELD)


@dataclass(frozen=True)
class BagMapping:
    """All columns, and which clock tells their time."""

    columns: tuple[Mapped, ...]
    clock: str = "stamp"


def mapping_file(bag: Path) -> Path:
    """Where the mapping of a bag lies."""
    return bag.with_name(bag.stem + ENDING)


def read_mapping(path: Path) -> BagMapping:
    """The mapping in a TOML file.

    Raises:
        ValueError: it is none; names file, key and what is needed.
    """
    content = read_toml(path)
    strange = [key for key in content if key not in ("clock", "columns")]
    if strange:
        raise ValueError(f"{path}: unknown key {shown(strange[0])}; a mapping has clock and [columns.NAME]")
    clock = content.get("clock", "stamp")
    if clock not in CLOCKS:
        raise ValueError(f"{path}: clock is {shown(str(clock))}, but must be one of {', '.join(CLOCKS)}")
    columns = content.get("columns")
    if not isinstance(columns, Mapping) or not columns:
        raise ValueError(f"{path} maps no column; write [columns.joint_angle] with topic and field")
    return BagMapping(tuple(_mapped(path, name, one) for name, one in columns.items()), clock)


def _mapped(path: Path, name: str, given: Any) -> Mapped:
    where = f"{path}: columns.{name}"
    if not isinstance(given, Mapping):
        raise ValueError(f"{where} is no table; write topic and field")
    strange = [key for key in given if key not in ("topic", "field", "unit", "sign")]
    if strange:
        raise ValueError(f"{where} has the unknown key {shown(strange[0])}; there are topic, field, unit, sign")
    for key in ("topic", "field"):
        if not isinstance(given.get(key), str) or not given[key]:
            raise ValueError(f"{where}.{key} is missing or no text")
    unit, sign = given.get("unit", ""), given.get("sign", 1)
    if not isinstance(unit, str) or unit == UNKNOWN:
        raise ValueError(f'{where}.unit is {shown(str(unit))}, but must be the field\'s unit, such as "bar" or "rad"')
    if isinstance(sign, bool) or sign not in (1, -1):
        raise ValueError(f"{where}.sign is {shown(str(sign))}, but must be 1 or -1")
    return Mapped(name, given["topic"], given["field"], unit, int(sign))


def mapping_of(bag: Path) -> BagMapping:
    """The mapping beside a bag, or that of a bag which this project wrote.

    Raises:
        ValueError: there is none; says how to make one.
    """
    beside = mapping_file(bag)
    if beside.exists():
        return read_mapping(beside)
    topics = topics_of(bag)
    own = [
        Mapped(column, topic, field)
        for topic, (_, fields) in topics.items()
        for field in fields
        if (column := own_column(topic, field)) is not None
    ]
    if not any(one.column == "joint_angle_rad" for one in own):
        raise ValueError(
            f"{bag} is not of this project (its topics are {listed(list(topics))}); propose which fields are read by: "
            f"aoro-gym log map {bag}"
        )
    return BagMapping(tuple(own))


def columns_of(bag: Path) -> dict[str, Floats]:
    """Columns of the log that a bag holds, ``time_s`` first, by titles with their units.

    Raises:
        ValueError: the bag cannot be read, or there is no mapping for it.
    """
    mapping = mapping_of(bag)
    fields = [(one.topic, one.field) for one in mapping.columns]
    series = series_of(bag, fields, stamped=mapping.clock == "stamp")
    time = _common(bag, mapping.columns, series)
    found = {"time_s": time}
    for one, samples in zip(mapping.columns, series, strict=True):
        found[one.title] = one.sign * _at(time, samples, held=one.is_held)
    return found


def _common(bag: Path, columns: Sequence[Mapped], series: Sequence[Series]) -> Floats:
    """Instants of the joint angle's topic, else of the busiest one, while all topics run."""
    angle = next((k for k, one in enumerate(columns) if "angle" in one.column), None)
    chosen = max(range(len(series)), key=lambda k: len(series[k].time)) if angle is None else angle
    told = [one.time[0] for one, column in zip(series, columns, strict=True) if not column.is_late]
    begin = max(told, default=min(one.time[0] for one in series))
    measured = [one.time[-1] for one, column in zip(series, columns, strict=True) if not column.is_held]
    end = min(measured, default=max(one.time[-1] for one in series))
    time = series[chosen].time
    time = time[(time >= begin) & (time <= end)]
    if not len(time):
        raise ValueError(f"{bag}: its topics never run at one time; map topics of one clock, or set clock")
    return time


def _at(time: Floats, series: Series, *, held: bool) -> Floats:
    """A series at other instants; of several values at one instant the last holds, and NaN before the first."""
    order = np.argsort(series.time, kind="stable")
    own, values = series.time[order], series.values[order]
    if len(own) == len(time) and np.array_equal(own, time):
        return values
    if held:
        last = np.searchsorted(own, time, side="right") - 1
        return np.where(last < 0, np.nan, values[last])
    return np.interp(time, own, values)


# ---- proposals ----


def proposed(bag: Path, wanted: Mapping[str, Sequence[str]]) -> tuple[list[Mapped], list[str]]:
    """Columns that fields of a bag look like, and fields that look like none.

    Args:
        bag: Any.
        wanted: By quantity, names that it goes by.

    Raises:
        ValueError: the bag cannot be read.
    """
    found: dict[str, Mapped] = {}
    left = []
    for topic, (kind, fields) in topics_of(bag).items():
        for field in fields:
            quantity = _looks_like(topic, field, wanted)
            if quantity is None or quantity in found or field.startswith("true_"):
                left.append(f"{topic} {field}")
                continue
            unit = UNITS.get((kind, re.split(r"[.\[]", field)[0])) or _unit_of(field)
            found[quantity] = Mapped(
                quantity, topic, field, unit or ("" if quantity in ALL_COMMAND_BOUNDS else UNKNOWN)
            )
    return list(found.values()), left


def _looks_like(topic: str, field: str, wanted: Mapping[str, Sequence[str]]) -> str | None:
    """The quantity whose name the words of a topic and a field hold, the longest name first."""
    words = "_".join(re.findall(r"[a-z0-9]+", f"{topic}_{field}".lower()))
    several = [(name, quantity) for quantity, own in wanted.items() for name in (*own, *SPOKEN.get(quantity, ()))]
    names = sorted(several, key=lambda one: -len(one[0]))
    return next((quantity for name, quantity in names if f"_{name}_" in f"_{words}_"), None)


def _unit_of(field: str) -> str | None:
    """The unit that a field's name ends in."""
    ends = {"_bar": "bar", "_pa": "Pa", "_rad": "rad", "_deg": "deg", "_rpm": "rpm", "_v": "V", "_rad_per_s": "rad/s"}
    longest = sorted(ends, key=len, reverse=True)
    return next((ends[end] for end in longest if field.lower().endswith(end)), None)


def as_toml(bag: Path, columns: Sequence[Mapped], left: Sequence[str]) -> str:
    """A mapping to be read, completed and saved."""
    lines = [f"# What a log reads of {bag.name}. Signs: left is positive.", 'clock = "stamp"  # or "recorded"']
    for one in columns:
        lines += ["", f"[columns.{one.column}]", f'topic = "{one.topic}"', f'field = "{one.field}"']
        if one.unit:
            note = "  # unknown: fill it in" if one.unit == UNKNOWN else ""
            lines.append(f'unit = "{one.unit}"{note}')
        lines.append("sign = 1")
    lines += ["", *(f"# not read: {one}" for one in left)]
    return "\n".join(lines).rstrip() + "\n"
