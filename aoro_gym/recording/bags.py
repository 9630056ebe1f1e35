"""Bags of ROS, read without ROS: MCAP files and folders of rosbag2, bags of ROS 1.

What this project writes itself says :mod:`.bag_writing`, what is read of other bags a mapping (:mod:`.bag_mapping`).
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.recording.cells import listed

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

Floats = NDArray[np.float64]

SUFFIXES = (".mcap", ".db3", ".bag")
"""Of files that are bags; a folder of rosbag2 holds a ``metadata.yaml``."""
NEEDED = "pip install 'aoro-gym[bags]'"
LARGEST_ARRAY = 64
"""Numbers of an array that may be columns."""
SECOND = 1_000_000_000
"""Nanoseconds."""
SINCE_START = 31_536_000
"""Time [s], a year, up to which a clock counts from its own start, and not from 1970."""
_DAMAGED = (UnicodeDecodeError, OverflowError, LookupError, struct.error)
"""What the reader raises besides where bytes are wrong."""
_STAMPED = ("header", "stamp")
_PART = re.compile(r"([A-Za-z_]\w*)(?:\[([^\]]+)\])?")


class NoBagReader(ValueError):
    """The package that reads bags is not installed."""


def is_bag(path: Path) -> bool:
    """Whether ``path`` is a bag, by its name or by what a folder holds."""
    return path.suffix in SUFFIXES or (path / "metadata.yaml").is_file()


@contextmanager
def opened(path: Path) -> Iterator[AnyReader]:
    """The reader of a bag; ValueError where it cannot be read."""
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.rosbag1 import ReaderError as Reader1Error
        from rosbags.rosbag2 import ReaderError as Reader2Error
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise NoBagReader(f"bag {path} needs rosbags: {NEEDED}") from None
    if not path.exists():
        raise ValueError(f"bag {path} does not exist")
    try:
        # bags of old recorders name types only
        with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
            yield reader
    except (AnyReaderError, Reader1Error, Reader2Error, OSError, AssertionError, *_DAMAGED) as error:
        said = str(error).splitlines()
        raise ValueError(f"{path} is not a whole bag: {said[0] if said else type(error).__name__}") from None


# ---- fields of messages ----


def number_in(message: Any, path: str) -> float:
    """Value of a field such as ``point.x``, ``data[2]`` or ``position[articulation]``, the last one by the message's names.

    Raises:
        ValueError: the message has no such field, or it is no number.
    """
    value = message
    for part in path.split("."):
        match = _PART.fullmatch(part)
        if match is None:
            raise ValueError(f"field {path!r} cannot be read; write a.b, data[2] or position[joint]")
        name, index = match.groups()
        if not hasattr(value, name):
            raise ValueError(f"there is no field {name!r}, only {listed(_names(value))}")
        owner, value = value, getattr(value, name)
        if index is not None:
            value = _item(owner, value, name, index)
    if isinstance(value, bool | np.bool_ | int | float | np.integer | np.floating):
        return float(value)
    raise ValueError(f"field {path!r} is no number")


def _item(owner: Any, values: Any, name: str, index: str) -> Any:
    """An item of an array by its number, or by the ``name`` list of the message that owns it."""
    if index.isdigit():
        place = int(index)
    else:
        named = list(getattr(owner, "name", ()))
        if index not in named:
            raise ValueError(f"{name}[{index}]: the message names {listed(named) if named else 'nothing'}")
        place = named.index(index)
    if place >= len(values):
        raise ValueError(f"{name}[{index}]: there are only {len(values)} values")
    return values[place]


def _names(message: Any) -> list[str]:
    return [name for name in getattr(message, "__dataclass_fields__", {}) if not name.startswith("__")]


def numbers_of(message: Any, before: str = "") -> list[str]:
    """Paths of all fields of a message that hold numbers."""
    found = []
    named = list(getattr(message, "name", ())) if not isinstance(getattr(message, "name", ""), str) else []
    for name in _names(message):
        value, path = getattr(message, name), before + name
        if isinstance(value, bool | int | float | np.integer | np.floating):
            found.append(path)
        elif isinstance(value, np.ndarray) and value.dtype != object:
            if 0 < len(value) <= LARGEST_ARRAY:
                labels = named if len(named) == len(value) else range(len(value))
                found += [f"{path}[{label}]" for label in labels]
        elif _names(value) and name not in _STAMPED:
            found += numbers_of(value, f"{path}.")
    return found


# ---- reading ----


@dataclass(frozen=True)
class Series:
    """A field of a topic over time: instants [s] (F,), since the bag's first message where clocks count from 1970, and
    values (F,)."""

    time: Floats
    values: Floats


def series_of(path: Path, fields: Sequence[tuple[str, str]], *, stamped: bool = True) -> list[Series]:
    """Series of ``fields`` (topic and path of each).

    Args:
        path: Of the bag.
        fields: What is read.
        stamped: Whether a message's own stamp tells its time, where it has one; else when it was recorded does.

    Raises:
        ValueError: the bag cannot be read, or lacks a topic or a field.
    """
    wanted: dict[str, list[int]] = {}
    for number, (topic, _) in enumerate(fields):
        wanted.setdefault(topic, []).append(number)
    instants: dict[str, list[int]] = {topic: [] for topic in wanted}
    values: list[list[float]] = [[] for _ in fields]
    with opened(path) as reader:
        there = {one.topic for one in reader.connections}
        missing = [topic for topic in wanted if topic not in there]
        if missing:
            raise ValueError(f"{path} has no topic {missing[0]}, only {listed(sorted(there))}")
        for connection, recorded, raw in reader.messages([c for c in reader.connections if c.topic in wanted]):
            message = reader.deserialize(raw, connection.msgtype)
            instants[connection.topic].append(_instant(message, recorded) if stamped else recorded)
            for number in wanted[connection.topic]:
                try:
                    values[number].append(number_in(message, fields[number][1]))
                except ValueError as error:
                    raise ValueError(f"{path}, topic {connection.topic}: {error}") from None
    first = min((min(times) for times in instants.values() if times), default=0)
    first = first if first > SINCE_START * SECOND else 0
    clocks = {topic: np.array([t - first for t in times], dtype=np.int64) / SECOND for topic, times in instants.items()}
    empty = [topic for topic, clock in clocks.items() if not len(clock)]
    if empty:
        raise ValueError(f"{path}: topic {empty[0]} has no message")
    return [Series(clocks[topic], np.array(values[k])) for k, (topic, _) in enumerate(fields)]


def _instant(message: Any, recorded: int) -> int:
    """Time of a message [ns]: its stamp, or when it was recorded where it has none or a zero one."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None:
        return recorded
    return int(stamp.sec) * SECOND + int(stamp.nanosec) or recorded


def topics_of(path: Path) -> dict[str, tuple[str, list[str]]]:
    """Type and fields that hold numbers, by the first message, of every topic that has one."""
    found: dict[str, tuple[str, list[str]]] = {}
    with opened(path) as reader:
        for connection in reader.connections:
            first = next(reader.messages([connection]), None)
            if first is not None:
                found[connection.topic] = (
                    connection.msgtype,
                    numbers_of(reader.deserialize(first[2], connection.msgtype)),
                )
    return dict(sorted(found.items()))
