"""Logs as bags: this project's own MCAP files and folders of rosbag2, and which field of which topic holds which column.

A log has one message a topic and sample:

- ``/joint_states`` (sensor_msgs/JointState): angle of the joint; ``/wheel_states``: rates of the wheels;
- ``/imu`` (sensor_msgs/Imu): angular velocity and specific force, where the log has all six numbers; the orientation is not
  given, and marked so as REP 145 has it;
- ``/gps/fix`` (sensor_msgs/NavSatFix): one message a solution of the receiver, where the log has place and status;
- ``/commands``, ``/pressures``, ``/engine``, ``/crane``, ``/navigation``, ``/true_state``: one float64 a column, called as
  the column is in small letters (types of ``aoro_msgs``, whose definitions lie in the file);
- ``/tf`` (tf2_msgs/TFMessage): the front frame in its world, where the pose is in the log.
"""

from __future__ import annotations

import re
import sqlite3
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from aoro_gym.checks import check_choice
from aoro_gym.execution.files import check_writable, folder_written_whole, written_whole
from aoro_gym.recording.bags import NEEDED, SECOND, Floats, NoBagReader

FOLDER = ".rosbag2"
"""Suffix of a bag that is written as a folder of rosbag2."""
WRITTEN = (".mcap", FOLDER)
"""Suffixes of bags that can be written."""
JOINT = "articulation"
"""Name of the articulated joint in ``/joint_states``."""
IMU = {
    **{f"imu_rate_{axis}_rad_per_s": f"angular_velocity.{axis}" for axis in "xyz"},
    **{f"imu_force_{axis}_m_per_s2": f"linear_acceleration.{axis}" for axis in "xyz"},
}
"""Fields of ``/imu`` by column."""
GPS = {
    "gps_latitude_deg": "latitude",
    "gps_longitude_deg": "longitude",
    "gps_altitude_m": "altitude",
    "gps_status": "status.status",
}
"""Fields of ``/gps/fix`` by column; the status is sensor_msgs/NavSatStatus's."""
NO_FIX, FLOAT_FIX, RTK_FIX = -1, 0, 2
"""Status of a receiver without a solution, with one whose ambiguities float, and with one that has them resolved."""
STANDARD = {
    "/joint_states": "sensor_msgs/msg/JointState",
    "/wheel_states": "sensor_msgs/msg/JointState",
    "/imu": "sensor_msgs/msg/Imu",
    "/gps/fix": "sensor_msgs/msg/NavSatFix",
}
"""Types of topics that have one of ROS's own."""
OWN_TOPICS = ("/commands", "/pressures", "/engine", "/crane", "/navigation", "/true_state")
CAPITALS = (("_l_per_min", "_L_per_min"), ("_n_m", "_N_m"), ("_kn", "_kN"), ("_v", "_V"))
"""Ends of columns that have capital letters, which fields of messages have not."""
GPS_SERVICE = 1
"""Of sensor_msgs/NavSatStatus: GPS."""
LOWEST_STATUS, HIGHEST_STATUS = -128, 127
"""Of a field of eight bits."""


def own_place(column: str, standard: Collection[str] = (*IMU, *GPS)) -> tuple[str, str]:
    """Topic and field of a column of this project's logs; ``standard``: those of :data:`IMU` and :data:`GPS` that stand in
    ROS's own messages."""
    if column == "joint_angle_rad":
        return "/joint_states", f"position[{JOINT}]"
    if column in standard:
        return ("/imu", IMU[column]) if column in IMU else ("/gps/fix", GPS[column])
    wheel = re.fullmatch(r"wheel_speed_(\w+)_rad_per_s", column)
    if wheel:
        return "/wheel_states", f"velocity[wheel_{wheel[1]}]"
    if column.startswith("true_"):
        return "/true_state", column.lower()
    if column == "engine_speed_rpm":
        return "/engine", column
    if column.startswith(("imu_", "gps_")):
        return "/navigation", column.lower()
    if column.startswith(("crane_joint_", "crane_rate_", "crane_tip_")):
        return "/crane", column.lower()
    return "/pressures" if "pressure" in column else "/commands", column.lower()


def own_column(topic: str, field: str) -> str | None:
    """Column that a topic's field holds in this project's bags; None for what is no column."""
    joint, wheel = re.fullmatch(r"position\[" + JOINT + r"\]", field), re.fullmatch(r"velocity\[wheel_(\w+)\]", field)
    if topic == "/joint_states":
        return "joint_angle_rad" if joint else None
    if topic == "/wheel_states":
        return f"wheel_speed_{wheel[1]}_rad_per_s" if wheel else None
    if topic in ("/imu", "/gps/fix"):
        names = IMU if topic == "/imu" else GPS
        return next((column for column, own in names.items() if own == field), None)
    if topic not in OWN_TOPICS:
        return None
    for small, capital in CAPITALS:
        if field.endswith(small):
            return field.removesuffix(small) + capital
    return field


def check_bag_path(path: Path) -> None:
    """``ValueError`` unless a bag can be written to ``path``; a folder that is there must be a bag, which is replaced."""
    if path.suffix != FOLDER or not path.exists():
        check_writable(path)
        return
    if not (path / "metadata.yaml").is_file():
        raise ValueError(f"{path} exists and is no folder of rosbag2; remove it, or choose another name")
    check_writable(path / "metadata.yaml")


@contextmanager
def new_bag(path: Path) -> Iterator[tuple[Any, Any]]:
    """Yield the writer and the types (of Humble) of a bag that is there at the end, whole or not at all.

    ``.mcap`` is one file; ``.rosbag2`` a folder with ``metadata.yaml`` and the storage that every ROS 2 has, SQLite's. Its
    format is version 8, where a topic's quality of service is text: readers of older releases refuse the list of version 9.

    Raises:
        ValueError: another suffix, or rosbags is not installed.
    """
    check_choice(f"suffix of {path.name}", path.suffix, WRITTEN)
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise NoBagReader(f"{path} needs rosbags: {NEEDED}") from None
    store = get_typestore(Stores.ROS2_HUMBLE)
    if path.suffix == FOLDER:
        with folder_written_whole(path) as temporary:
            bag = temporary / path.stem  # the writer calls its file as the folder is called
            try:
                with Writer(bag, version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
                    yield writer, store
            except sqlite3.Error as error:  # a full disk, too
                raise OSError(f"{path} cannot be written: {error}") from None
            for file in bag.iterdir():
                file.replace(temporary / file.name)
            bag.rmdir()
        return
    with written_whole(path) as temporary, tempfile.TemporaryDirectory(dir=temporary.parent) as folder:
        bag = Path(folder) / "bag"
        with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            yield writer, store
        next(bag.glob("*.mcap")).replace(temporary)


def write_bag(path: Path, columns: Mapping[str, ArrayLike]) -> None:
    """Write a log's columns, ``time_s`` among them, as a bag; ``path`` as :func:`new_bag`.

    Raises:
        ValueError: another suffix, rosbags is not installed, or there is no column ``time_s``.
    """
    if "time_s" not in columns:
        raise ValueError(f"log {path} has no column time_s")
    arrays = {name: np.asarray(values, dtype=np.float64) for name, values in columns.items()}
    ticks = np.rint(arrays.pop("time_s") * SECOND).astype(np.int64)
    topics, standard = dict[str, dict[str, Floats]](), _standard(arrays)
    for name, values in arrays.items():
        topic, field = own_place(name, standard)
        topics.setdefault(topic, {})[field] = values
    with new_bag(path) as (writer, store):
        for topic, fields in topics.items():
            if topic not in STANDARD:
                _register(store, topic, list(fields))
            rows = np.column_stack(list(fields.values()))
            told = _solutions(rows) if topic == "/gps/fix" else slice(None)
            messages = _messages(store, topic, list(fields), rows[told], ticks[told].tolist())
            _write_topic(writer, store, topic, messages)
        pose = _pose(arrays)
        if pose is not None:
            _write_topic(writer, store, "/tf", _frames(store, pose, ticks.tolist()))


def _register(store: Any, topic: str, fields: Sequence[str]) -> None:
    """Make the type of one of :data:`OWN_TOPICS` known: a number a field."""
    from rosbags.typesys import get_types_from_msg

    lines = "\n".join(["std_msgs/Header header", *(f"float64 {field}" for field in fields)])
    store.register(get_types_from_msg(lines, _own_type(topic)))


def _standard(columns: Mapping[str, Floats]) -> set[str]:
    """Columns of the inertial unit and of the receiver that ROS's own messages can hold without loss."""
    found: set[str] = set()
    if all(name in columns for name in IMU):
        found |= set(IMU)
    if all(name in columns for name in GPS):
        rows = np.column_stack([columns[name] for name in GPS])
        known, status = np.isfinite(rows), rows[:, list(GPS).index("gps_status")]
        begin = int(np.argmax(known.all(axis=1)))
        status = status[begin:]
        whole = np.all((status == np.rint(status)) & (status >= LOWEST_STATUS) & (status <= HIGHEST_STATUS))
        if known[begin:].all() and not known[:begin].any() and whole:
            found |= set(GPS)
    return found


def _solutions(rows: Floats) -> Any:
    """Which rows (F,) show another solution than the one before; those before the first show none."""
    before = np.vstack([np.full((1, rows.shape[1]), np.nan), rows[:-1]])
    return np.isfinite(rows).all(axis=1) & np.any(rows != before, axis=1)


def _own_type(topic: str) -> str:
    return "aoro_msgs/msg/" + "".join(word.capitalize() for word in topic.strip("/").split("_"))


def _header(store: Any, tick: int, frame: str = "") -> Any:
    stamp = store.types["builtin_interfaces/msg/Time"](sec=tick // SECOND, nanosec=tick % SECOND)
    return store.types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


Messages = Iterator[tuple[int, Any]]
"""Instants [ns] and messages."""


def _write_topic(writer: Any, store: Any, topic: str, messages: Messages) -> None:
    """Messages of one topic."""
    kind = "tf2_msgs/msg/TFMessage" if topic == "/tf" else STANDARD.get(topic, _own_type(topic))
    connection = writer.add_connection(topic, kind, typestore=store)
    for tick, message in messages:
        writer.write(connection, tick, store.serialize_cdr(message, kind))


def _messages(store: Any, topic: str, names: Sequence[str], rows: Floats, ticks: Sequence[int]) -> Messages:
    """One message a sample.

    Args:
        store: Types of messages.
        topic: Where to.
        names: Of its fields.
        rows: Values (F, fields).
        ticks: Time of each sample [ns] (F,).
    """
    make = _maker(store, topic, names)
    for tick, row in zip(ticks, rows.tolist(), strict=True):
        yield tick, make(tick, row)


def _maker(store: Any, topic: str, names: Sequence[str]) -> Callable[[int, Sequence[float]], Any]:
    """What makes a message of a topic from its instant [ns] and its values, by the order of ``names``."""
    kind = store.types[STANDARD.get(topic, _own_type(topic))]
    if topic == "/imu":
        return lambda tick, row: _inertial(store, kind, tick, dict(zip(names, row, strict=True)))
    if topic == "/gps/fix":
        return lambda tick, row: _fix(store, kind, tick, dict(zip(names, row, strict=True)))
    if topic in STANDARD:
        what = names[0].partition("[")[0]
        joints = [name.partition("[")[2].rstrip("]") for name in names]
        none = {"position": np.empty(0), "velocity": np.empty(0), "effort": np.empty(0)}
        return lambda tick, row: kind(header=_header(store, tick), name=joints, **none | {what: np.array(row)})
    return lambda tick, row: kind(header=_header(store, tick), **dict(zip(names, row, strict=True)))


def _inertial(store: Any, kind: Any, tick: int, values: Mapping[str, float]) -> Any:
    """A sensor_msgs/Imu; what is not known has covariances of zero, and what is not given begins with −1 (REP 145)."""
    vector, quaternion = store.types["geometry_msgs/msg/Vector3"], store.types["geometry_msgs/msg/Quaternion"]
    unknown, absent = np.zeros(9), np.array([-1.0, *np.zeros(8)])
    rates, force = (
        vector(**{axis: values[f"{name}.{axis}"] for axis in "xyz"})
        for name in ("angular_velocity", "linear_acceleration")
    )
    return kind(
        header=_header(store, tick, "imu"), orientation=quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
        orientation_covariance=absent, angular_velocity=rates, angular_velocity_covariance=unknown,
        linear_acceleration=force, linear_acceleration_covariance=unknown,
    )  # fmt: skip


def _fix(store: Any, kind: Any, tick: int, values: Mapping[str, float]) -> Any:
    """A sensor_msgs/NavSatFix, of unknown covariance."""
    status = store.types["sensor_msgs/msg/NavSatStatus"](status=int(values["status.status"]), service=GPS_SERVICE)
    place = {name: values[name] for name in ("latitude", "longitude", "altitude")}
    return kind(
        header=_header(store, tick, "gps_main"), status=status, **place,
        position_covariance=np.zeros(9), position_covariance_type=0,
    )  # fmt: skip


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


def _frames(store: Any, pose: Floats, ticks: Sequence[int]) -> Messages:
    """Transforms from the world to the front frame: rotations about z, then y, then x."""
    types = store.types
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
        yield tick, types["tf2_msgs/msg/TFMessage"](transforms=[one])
