"""Point clouds and pictures as messages of ROS, in MCAP files and folders of rosbag2, without ROS.

Arrays in, arrays out, to the last digit: a cloud is sensor_msgs/PointCloud2 with a field an array, a picture
sensor_msgs/Image, and its camera sensor_msgs/CameraInfo.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from aoro_gym.checks import check_choice
from aoro_gym.recording.bag_writing import new_bag
from aoro_gym.recording.bags import SECOND, opened

CLOUD, PICTURE, CAMERA = (f"sensor_msgs/msg/{name}" for name in ("PointCloud2", "Image", "CameraInfo"))
KINDS: Mapping[str, int] = {
    "int8": 1, "uint8": 2, "int16": 3, "uint16": 4, "int32": 5, "uint32": 6, "float32": 7, "float64": 8,
}  # fmt: skip
"""Numbers of sensor_msgs/PointField by the name of an array's type."""
ENCODINGS = {
    "mono8": ("uint8", 1),
    "mono16": ("uint16", 1),
    "rgb8": ("uint8", 3),
    "rgba8": ("uint8", 4),
    "32FC1": ("float32", 1),
}
"""Of pictures: type of a pixel's numbers and how many there are (sensor_msgs/image_encodings)."""


@dataclass(frozen=True)
class Cloud:
    """K points at one instant."""

    time: float
    """[s] since the bag's beginning."""
    columns: Mapping[str, NDArray[Any]]
    """Arrays (K,) by name: x, y and z [m] in the axes of ``frame``, and what else there is."""
    frame: str = "lidar"


@dataclass(frozen=True)
class Picture:
    """Pixels at one instant."""

    time: float
    """[s]"""
    pixels: NDArray[Any]
    """(H, W) or (H, W, channels), of the type that the encoding asks for."""
    encoding: str = "rgb8"
    """One of :data:`ENCODINGS`; 32FC1 is a depth in metres."""
    frame: str = "camera"


@dataclass(frozen=True)
class Camera:
    """What projects on a picture."""

    time: float
    """[s]"""
    size: tuple[int, int]
    """Width and height [pixels]."""
    matrix: NDArray[np.float64]
    """(3, 3) intrinsic matrix [pixels]."""
    distortion: NDArray[np.float64] = field(default_factory=lambda: np.zeros(5))
    """(5,) k1, k2, p1, p2, k3 of the model plumb_bob."""
    frame: str = "camera"


Message = Cloud | Picture | Camera


def write_sensors(path: Path, topics: Mapping[str, Sequence[Message]]) -> None:
    """Write messages by topic as a bag, whole or not at all; ``path`` as :func:`~aoro_gym.recording.bag_writing.new_bag`.

    Raises:
        ValueError: another suffix, rosbags is not installed, or an array is not what its message holds.
    """
    with new_bag(path) as (writer, store):
        for topic, sources in topics.items():
            messages = [_made(store, one) for one in sources]
            kind = messages[0].__msgtype__ if messages else CLOUD
            connection = writer.add_connection(topic, kind, typestore=store)
            for source, message in zip(sources, messages, strict=True):
                writer.write(connection, _tick(source.time), store.serialize_cdr(message, kind))


def read_sensors(path: Path, topic: str) -> Iterator[Message]:
    """Clouds, pictures or cameras of a topic of any bag, in the order in which they were recorded.

    Raises:
        ValueError: the bag cannot be read, has no such topic, or the topic holds something else.
    """
    with opened(path) as reader:
        connections = [one for one in reader.connections if one.topic == topic]
        check_choice(f"topic of {path}", topic, sorted({one.topic for one in reader.connections}))
        for connection, tick, raw in reader.messages(connections=connections):
            message: Any = reader.deserialize(raw, connection.msgtype)
            yield _read(message, connection.msgtype, tick / SECOND)


def _tick(time: float) -> int:
    return round(time * SECOND)


def _made(store: Any, one: Message) -> Any:
    """The message of ROS."""
    types, tick = store.types, _tick(one.time)
    stamp = types["builtin_interfaces/msg/Time"](sec=tick // SECOND, nanosec=tick % SECOND)
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id=one.frame)
    if isinstance(one, Cloud):
        return _cloud(types, header, one)
    if isinstance(one, Picture):
        return _picture(types, header, one)
    return _camera(types, header, one)


def _cloud(types: Any, header: Any, one: Cloud) -> Any:
    arrays = {name: np.asarray(values) for name, values in one.columns.items()}
    sizes = {name: values.shape for name, values in arrays.items()}
    if len(set(sizes.values())) != 1 or any(len(shape) != 1 for shape in sizes.values()):
        raise ValueError(f"columns of a cloud are of the shapes {sizes}, but must all be (K,)")
    for name, values in arrays.items():
        check_choice(f"type of the column {name}", values.dtype.name, KINDS)
    record = np.empty(
        len(next(iter(arrays.values()))),
        dtype=[(name, values.dtype.newbyteorder("<")) for name, values in arrays.items()],
    )
    for name, values in arrays.items():
        record[name] = values
    places: Any = record.dtype.fields
    told = [
        types["sensor_msgs/msg/PointField"](
            name=name, offset=places[name][1], datatype=KINDS[values.dtype.name], count=1
        )
        for name, values in arrays.items()
    ]
    return types[CLOUD](
        header=header, height=1, width=len(record), fields=told, is_bigendian=False, point_step=record.itemsize,
        row_step=record.nbytes, data=np.frombuffer(record.tobytes(), dtype=np.uint8), is_dense=True,
    )  # fmt: skip


def _picture(types: Any, header: Any, one: Picture) -> Any:
    check_choice("encoding", one.encoding, ENCODINGS)
    kind, channels = ENCODINGS[one.encoding]
    shape = one.pixels.shape
    if one.pixels.dtype.name != kind or shape[2:] not in ((channels,), () if channels == 1 else (channels,)):
        raise ValueError(
            f"pixels are {one.pixels.dtype.name} of the shape {shape}, but {one.encoding} is {kind} of (H, W"
            f"{f', {channels}' if channels > 1 else ''})"
        )
    pixels = np.ascontiguousarray(one.pixels.astype(one.pixels.dtype.newbyteorder("<")))
    return types[PICTURE](
        header=header, height=shape[0], width=shape[1], encoding=one.encoding, is_bigendian=0,
        step=pixels.nbytes // shape[0], data=np.frombuffer(pixels.tobytes(), dtype=np.uint8),
    )  # fmt: skip


def _camera(types: Any, header: Any, one: Camera) -> Any:
    matrix = np.asarray(one.matrix, dtype=np.float64)
    if matrix.shape != (3, 3):
        raise ValueError(f"the matrix of a camera is of the shape {matrix.shape}, but must be (3, 3)")
    whole = types["sensor_msgs/msg/RegionOfInterest"](x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    return types[CAMERA](
        header=header, height=one.size[1], width=one.size[0], distortion_model="plumb_bob",
        d=np.asarray(one.distortion, dtype=np.float64), k=matrix.ravel(), r=np.eye(3).ravel(),
        p=np.column_stack([matrix, np.zeros(3)]).ravel(), binning_x=0, binning_y=0, roi=whole,
    )  # fmt: skip


def _read(message: Any, kind: str, time: float) -> Message:
    frame = message.header.frame_id
    if kind == CLOUD:
        order: Literal["<", ">"] = ">" if message.is_bigendian else "<"
        names = {number: name for name, number in KINDS.items()}
        layout = np.dtype(
            {
                "names": [one.name for one in message.fields],
                "formats": [_dtype(names[one.datatype], order) for one in message.fields],
                "offsets": [one.offset for one in message.fields],
                "itemsize": message.point_step,
            }
        )
        record = np.frombuffer(message.data.tobytes(), dtype=layout)
        return Cloud(time, {name: _native(record[name]) for name in layout.names or ()}, frame)
    if kind == PICTURE and message.encoding in ENCODINGS:
        name, channels = ENCODINGS[message.encoding]
        order = ">" if message.is_bigendian else "<"
        rows = message.data.reshape(message.height, message.step)
        pixels = np.ascontiguousarray(rows[:, : message.width * channels * np.dtype(name).itemsize])
        shape = (message.height, message.width, *((channels,) if channels > 1 else ()))
        return Picture(time, _native(pixels.view(_dtype(name, order)).reshape(shape)), message.encoding, frame)
    if kind == CAMERA:
        return Camera(time, (message.width, message.height), message.k.reshape(3, 3), message.d, frame)
    raise ValueError(
        f"a message of {kind} is no cloud, no camera, and no picture of an encoding among {', '.join(ENCODINGS)}"
    )


def _dtype(name: str, order: Literal["<", ">"]) -> np.dtype[Any]:
    """Of numbers with their bytes in an order, ``<`` or ``>``."""
    return np.dtype(name).newbyteorder(order)


def _native(values: NDArray[Any]) -> NDArray[Any]:
    """A copy in this computer's order of bytes."""
    kind: Any = values.dtype.newbyteorder("=")
    return values.astype(kind)
