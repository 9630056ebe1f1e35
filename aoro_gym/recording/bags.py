"""Bags of ROS, read and written without ROS: MCAP files and folders of rosbag2, bags of ROS 1.

A log that this project writes has one message a topic and sample:

- ``/joint_states`` (sensor_msgs/JointState): angle of the joint; ``/wheel_states``: rates of the wheels;
- ``/commands``, ``/pressures``, ``/engine``, ``/true_state``: one float64 a column, called as the column is in small letters
  (types of ``aoro_msgs``, whose definitions lie in the file);
- ``/tf`` (tf2_msgs/TFMessage): the front frame in its world, where the pose is in the log.

What is read of other bags says a mapping (:mod:`.bag_mapping`).
"""

from __future__ import annotations

import re
import struct
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.execution.files import written_whole
from aoro_gym.recording.cells import listed

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

Floats = NDArray[np.float64]

SUFFIXES = (".mcap", ".db3", ".bag")
"""Of files that are bags; a folder of rosbag2 holds a ``metadata.yaml``."""
NEEDED = "pip install 'aoro-gym[bags]'"
JOINT = "articulation"
"""Name of the articulated joint in ``/joint_states``."""
LARGEST_ARRAY = 64
"""Numbers of an array that may be columns."""
SECOND = 1_000_000_000
"""Nanoseconds."""
SINCE_START = 31_536_000
"""Time [s], a year, up to which a clock counts from its own start, and not from 1970."""
CAPITALS = (("_l_per_min", "_L_per_min"), ("_n_m", "_N_m"), ("_kn", "_kN"), ("_v", "_V"))
"""Ends of columns that have capital letters, which fields of messages have not."""
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


# ---- the project's own bags ----


def own_place(column: str) -> tuple[str, str]:
    """Topic and field of a column of this project's logs."""
    if column == "joint_angle_rad":
        return "/joint_states", f"position[{JOINT}]"
    wheel = re.fullmatch(r"wheel_speed_(\w+)_rad_per_s", column)
    if wheel:
        return "/wheel_states", f"velocity[wheel_{wheel[1]}]"
    if column.startswith("true_"):
        return "/true_state", column.lower()
    if column == "engine_speed_rpm":
        return "/engine", column
    return "/pressures" if "pressure" in column else "/commands", column.lower()


def own_column(topic: str, field: str) -> str | None:
    """Column that a topic's field holds in this project's bags; None for what is no column."""
    joint, wheel = re.fullmatch(r"position\[" + JOINT + r"\]", field), re.fullmatch(r"velocity\[wheel_(\w+)\]", field)
    if topic == "/joint_states":
        return "joint_angle_rad" if joint else None
    if topic == "/wheel_states":
        return f"wheel_speed_{wheel[1]}_rad_per_s" if wheel else None
    if topic not in ("/commands", "/pressures", "/engine", "/true_state"):
        return None
    for small, capital in CAPITALS:
        if field.endswith(small):
            return field.removesuffix(small) + capital
    return field


def write_bag(path: Path, columns: Mapping[str, ArrayLike]) -> None:
    """Write a log's columns, ``time_s`` among them, as an MCAP file.

    Raises:
        ValueError: rosbags is not installed, or there is no column ``time_s``.
    """
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise NoBagReader(f"log {path} needs rosbags: {NEEDED}") from None
    if "time_s" not in columns:
        raise ValueError(f"log {path} has no column time_s")
    arrays = {name: np.asarray(values, dtype=np.float64) for name, values in columns.items()}
    ticks = np.rint(arrays.pop("time_s") * SECOND).astype(np.int64).tolist()
    topics: dict[str, dict[str, Floats]] = {}
    for name, values in arrays.items():
        topic, field = own_place(name)
        topics.setdefault(topic, {})[field] = values
    store = get_typestore(Stores.ROS2_HUMBLE)
    for topic, fields in topics.items():
        if not topic.endswith("_states"):
            lines = "\n".join(["std_msgs/Header header", *(f"float64 {field}" for field in fields)])
            store.register(get_types_from_msg(lines, _own_type(topic)))
    with written_whole(path) as temporary, tempfile.TemporaryDirectory(dir=temporary.parent) as folder:
        bag = Path(folder) / "bag"
        with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            for topic, fields in topics.items():
                kind = "sensor_msgs/msg/JointState" if topic.endswith("_states") else _own_type(topic)
                _write_topic(writer, store, topic, kind, fields, ticks)
            pose = _pose(arrays)
            if pose is not None:
                _write_frames(writer, store, pose, ticks)
        next(bag.glob("*.mcap")).replace(temporary)


def _own_type(topic: str) -> str:
    return "aoro_msgs/msg/" + "".join(word.capitalize() for word in topic.strip("/").split("_"))


def _header(store: Any, tick: int, frame: str = "") -> Any:
    stamp = store.types["builtin_interfaces/msg/Time"](sec=tick // SECOND, nanosec=tick % SECOND)
    return store.types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def _write_topic(
    writer: Any, store: Any, topic: str, kind: str, fields: Mapping[str, Floats], ticks: Sequence[int]
) -> None:
    """One message a sample.

    Args:
        writer: Of the bag.
        store: Types of messages.
        topic: Where to.
        kind: Type of its messages.
        fields: Values (F,) by field.
        ticks: Time of each sample [ns] (F,).
    """
    connection, make = writer.add_connection(topic, kind, typestore=store), store.types[kind]
    rows = np.column_stack(list(fields.values()))
    names = list(fields)
    if topic.endswith("_states"):
        what = names[0].partition("[")[0]
        joints = [name.partition("[")[2].rstrip("]") for name in names]
        none = {"position": np.empty(0), "velocity": np.empty(0), "effort": np.empty(0)}
    for tick, row in zip(ticks, rows, strict=True):
        header = _header(store, tick)
        if topic.endswith("_states"):
            message = make(header=header, name=joints, **none | {what: row})
        else:
            message = make(header=header, **dict(zip(names, row.tolist(), strict=True)))
        writer.write(connection, tick, store.serialize_cdr(message, kind))


def _pose(columns: Mapping[str, Floats]) -> Floats | None:
    """Position [m], roll, pitch and yaw [rad] of the front frame (F, 6), if the log has them."""
    names = [
        *(f"true_position_{axis}_m" for axis in "xyz"),
        *(f"true_{angle}_deg" for angle in ("roll", "pitch", "yaw")),
    ]
    if any(name not in columns for name in names):
        return None
    pose = np.column_stack([columns[name] for name in names])
    pose[:, 3:] = np.radians(pose[:, 3:])
    return pose


def _write_frames(writer: Any, store: Any, pose: Floats, ticks: Sequence[int]) -> None:
    """Transforms from the world to the front frame: rotations about z, then y, then x."""
    kind, types = "tf2_msgs/msg/TFMessage", store.types
    connection = writer.add_connection("/tf", kind, typestore=store)
    for tick, row in zip(ticks, pose, strict=True):
        (cr, cp, cy), (sr, sp, sy) = np.cos(0.5 * row[3:]), np.sin(0.5 * row[3:])
        rotation = types["geometry_msgs/msg/Quaternion"](
            x=sr * cp * cy - cr * sp * sy, y=cr * sp * cy + sr * cp * sy,
            z=cr * cp * sy - sr * sp * cy, w=cr * cp * cy + sr * sp * sy,
        )  # fmt: skip
        place = types["geometry_msgs/msg/Vector3"](x=row[0], y=row[1], z=row[2])
        moved = types["geometry_msgs/msg/Transform"](translation=place, rotation=rotation)
        one = types["geometry_msgs/msg/TransformStamped"](
            header=_header(store, tick, "world"), child_frame_id="front_frame", transform=moved
        )
        writer.write(connection, tick, store.serialize_cdr(types[kind](transforms=[one]), kind))
