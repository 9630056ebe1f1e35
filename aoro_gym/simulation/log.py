"""Logs: what a twin did, or what the machine's logger wrote, as CSV, Parquet, MCAP or rosbag2.

Columns carry field units in their names. Measured columns come first, at 100 Hz as the machine logs them; columns named
``true_*`` are the simulator's own state, for plots only. A manifest of the same name in TOML says how the log was made,
and with which sensors.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.execution.files import check_writable, write_text, written_whole
from aoro_gym.recording.bag_writing import WRITTEN, check_bag_path, write_bag
from aoro_gym.recording.bags import NEEDED
from aoro_gym.recording.commands import ALL_COMMAND_BOUNDS
from aoro_gym.recording.logs import QUANTITIES
from aoro_gym.sensors.chain import SAMPLE_RATE, sample
from aoro_gym.sensors.crane import PRESSURES, TURNING, CraneSensors
from aoro_gym.sensors.joint_angle import JointAngleSensor
from aoro_gym.sensors.pressure import PressureSensor
from aoro_gym.units import BAR, DEGREE, LITRE_PER_MINUTE, RPM

RATE = SAMPLE_RATE
"""Samples a second [Hz] of the machine's logger."""

SUFFIXES = (".csv", ".parquet", *WRITTEN)
"""Of logs that can be written."""

_CORNER = "_(fl|fr|rl|rr)"
_TURNING = "_(slew|lift|fold)"
_UNITS: list[tuple[str, str, float]] = [
    # channel pattern, unit in the column's name, SI value of that unit
    (r".*pressure.*", "bar", BAR),
    (r".*flow.*", "L_per_min", LITRE_PER_MINUTE),
    (r"engine_speed", "rpm", RPM),
    (r"engine_torque", "N_m", 1.0),
    (r"wheel_rate" + _CORNER, "rad_per_s", 1.0),
    (r"(joint|yaw|pitch|roll)_rate|crane_rate" + _TURNING, "deg_per_s", DEGREE),
    (r"joint_angle|arm_angle" + _CORNER + "|roll|pitch|yaw|crane_joint" + _TURNING, "deg", DEGREE),
    (r"position_[xyz]|(sinkage|rut_depth)" + _CORNER + "|crane_joint_telescope", "m", 1.0),
    (r"speed|crane_rate_telescope", "m_per_s", 1.0),
    (
        r"wheel_load"
        + _CORNER
        + "|hull_force|object_force_[xyz]_.*|soil_resistance"
        + _CORNER
        + "|crane_(tip_load|ground_force)",
        "kN",
        1e3,
    ),
]

_MEASURED: list[tuple[str, str, float]] = [
    # column, channel, SI value of the column's unit
    ("joint_angle_rad", "joint_angle", 1.0),
    ("pressure_a_bar", "pressure_a", BAR),
    ("pressure_b_bar", "pressure_b", BAR),
    ("pump_pressure_bar", "pump_pressure", BAR),
    ("drive_pressure_forward_bar", "drive_pressure_forward", BAR),
    ("drive_pressure_return_bar", "drive_pressure_return", BAR),
    ("engine_speed_rpm", "engine_speed", RPM),
    *((f"wheel_speed_{corner}_rad_per_s", f"wheel_rate_{corner}", 1.0) for corner in ("fl", "fr", "rl", "rr")),
]

_OF_CRANE: list[tuple[str, str, float]] = [
    # the same of a crane: what its sensors measure
    *((f"crane_joint_{joint}_rad", f"crane_joint_{joint}", 1.0) for joint in TURNING),
    ("crane_joint_telescope_m", "crane_joint_telescope", 1.0),
    *((f"crane_rate_{joint}_rad_per_s", f"crane_rate_{joint}", 1.0) for joint in TURNING),
    ("crane_rate_telescope_m_per_s", "crane_rate_telescope", 1.0),
    *((f"{channel}_bar", channel, BAR) for channel in PRESSURES),
    ("crane_tip_load_kN", "crane_tip_load", 1e3),
]

IDEAL = "ideal"
NOISY = "joint angle: published kind of noise; pressures: typical transmitters; the others: ideal"
"""What a manifest says of the sensors."""


CRANE_NOISY = "angles: 12 bits; telescope: 3 mm; pressures: typical transmitters; load cell: 40 kN, 0.5 % zero error"
"""The same of those of a crane."""


def field_unit(channel: str) -> tuple[str, float]:
    """Unit of a channel at the edge, as it stands in a column's name, and that unit's SI value; '' for pure numbers."""
    for pattern, unit, size in _UNITS:
        if re.fullmatch(pattern, channel):
            return unit, size
    return "", 1.0


def voltage_from_signal(signal: ArrayLike) -> NDArray[np.float64]:
    """Steering voltage [V] of a signal in [-1, 1]: 0.5 V is full left, 4.5 V full right."""
    return 2.5 - 2.0 * np.asarray(signal, dtype=np.float64)


def log_columns(
    time: ArrayLike, channels: Mapping[str, ArrayLike], *, rng: np.random.Generator | None = None
) -> dict[str, NDArray]:
    """The columns of a log, 100 samples a second, from channels in SI units over ``time`` [s].

    A sample is the last state at or before its time, as a logger without an anti-alias filter takes it. A command's is the
    one that holds from that time on, as everything that reads logs takes it.

    Args:
        time: Instants [s] (F,).
        channels: Exact values (F,) by name.
        rng: Draws what is random about the sensors of joint angle and pressures; without it the measured columns are
            exact, too.
    """
    instants = np.asarray(time, dtype=np.float64)
    ticks, _ = sample(instants, instants)
    si = {name: sample(instants, np.asarray(values, dtype=np.float64))[1] for name, values in channels.items()}

    columns: dict[str, NDArray] = {"time_s": ticks}
    # between two instants acts the command that stands at the later one
    begins = np.searchsorted(instants, ticks + 1e-6 / RATE, side="right").clip(max=len(instants) - 1)
    for name in ALL_COMMAND_BOUNDS:
        if name in channels:
            columns[QUANTITIES[name].column] = np.asarray(channels[name], dtype=np.float64)[begins]
            if name == "steering_signal":
                columns["steering_signal_V"] = voltage_from_signal(columns[name])
    streams = [None] * len(_MEASURED) if rng is None else rng.spawn(len(_MEASURED))  # one a column, whichever there are
    for (column, channel, size), stream in zip(_MEASURED, streams, strict=True):
        if channel in si:
            measured = si[channel] if stream is None else _measured(channel, instants, channels[channel], stream)
            columns[column] = measured / size
    if "crane_tip_load" in channels:
        shown = si if rng is None else CraneSensors().record(channels, instants, rng.spawn(1)[0])[1]
        columns |= {column: shown[channel] / size for column, channel, size in _OF_CRANE}
    for channel, values in si.items():
        if channel != "time" and channel not in ALL_COMMAND_BOUNDS:
            unit, size = field_unit(channel)
            columns[f"true_{channel}_{unit}" if unit else f"true_{channel}"] = values / size
    return columns


def _measured(
    channel: str, time: NDArray[np.float64], values: ArrayLike, rng: np.random.Generator
) -> NDArray[np.float64]:
    """What the sensor of ``channel`` shows, SI; exact where the channel has no sensor model."""
    if channel == "joint_angle":
        return JointAngleSensor().record(values, time, rng)[1]
    if "pressure" in channel:
        return PressureSensor().record(values, time, rng)[1]
    return sample(time, np.asarray(values, dtype=np.float64))[1]


def write_log(path: Path, columns: Mapping[str, ArrayLike], manifest: Mapping[str, Any] | None = None) -> list[Path]:
    """Write ``columns`` to ``path``, one of :data:`SUFFIXES`, and ``manifest`` beside it (.toml); returns the files."""
    check_log_path(path)
    arrays = {name: np.asarray(values, dtype=np.float64) for name, values in columns.items()}
    if path.suffix in WRITTEN:
        write_bag(path, arrays)
        return [path, *_with_manifest(path, manifest)]
    with written_whole(path) as temporary:
        if path.suffix == ".parquet":
            import pyarrow
            import pyarrow.parquet

            pyarrow.parquet.write_table(pyarrow.table(arrays), temporary)
        else:
            rows = np.column_stack(list(arrays.values()))
            np.savetxt(temporary, rows, fmt="%.9g", delimiter=",", header=",".join(arrays), comments="")
    return [path, *_with_manifest(path, manifest)]


def _with_manifest(path: Path, manifest: Mapping[str, Any] | None) -> list[Path]:
    """Write the manifest beside a log, if there is one."""
    if manifest is None:
        return []
    beside = path.with_suffix(".toml")
    write_text(beside, _toml(manifest))
    return [beside]


def check_log_path(path: Path) -> None:
    """``ValueError`` unless a log can be written to ``path``."""
    if path.suffix not in SUFFIXES:
        raise ValueError(f"log {path} must end in {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}")
    if path.suffix in WRITTEN:
        check_bag_path(path)
        if find_spec("rosbags") is None:
            raise ValueError(f"log {path} needs rosbags: {NEEDED}, or end it in .csv")
        return
    check_writable(path)
    if path.suffix == ".parquet":
        try:
            import pyarrow  # noqa: F401
        except ImportError:
            raise ValueError(f"log {path} needs pyarrow: pip install 'aoro-gym[parquet]', or end it in .csv") from None


def _toml(values: Mapping[str, Any]) -> str:
    """``values`` as TOML: scalars and lists of scalars, then tables."""
    tables = {key: value for key, value in values.items() if isinstance(value, Mapping)}
    text = "".join(f"{key} = {_toml_value(value)}\n" for key, value in values.items() if key not in tables)
    for name, table in tables.items():
        rows = (f"{_toml_value(key) if '.' in key else key} = {_toml_value(value)}\n" for key, value in table.items())
        text += f"\n[{name}]\n{''.join(rows)}"
    return text


def _toml_value(value: Any) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(_toml_value(item) for item in value)}]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(float(value)) if isinstance(value, float) else str(value)
