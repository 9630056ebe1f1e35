"""Logs: what a twin did, or what the machine's logger wrote, as CSV or Parquet.

Columns carry field units in their names. Measured columns come first, at 100 Hz as the machine logs them; columns named
``true_*`` are the simulator's own state, for plots only. A manifest of the same name in TOML says how the log was made,
and with which sensors.
"""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.execution.files import check_writable, read_json, write_json, write_text, written_whole  # noqa: F401
from aoro_gym.sensors.chain import SAMPLE_RATE, sample
from aoro_gym.sensors.joint_angle import JointAngleSensor
from aoro_gym.sensors.pressure import PressureSensor
from aoro_gym.twin.records import COMMAND_BOUNDS

RATE = SAMPLE_RATE
"""Samples a second [Hz] of the machine's logger."""

BAR = 1e5
LITRE_PER_MINUTE = 1e-3 / 60.0
RPM = 2.0 * math.pi / 60.0
DEGREE = math.pi / 180.0

_CORNER = "_(fl|fr|rl|rr)"
_UNITS: list[tuple[str, str, float]] = [
    # channel pattern, unit in the column's name, SI value of that unit
    (r".*pressure.*", "bar", BAR),
    (r".*flow.*", "L_per_min", LITRE_PER_MINUTE),
    (r"engine_speed", "rpm", RPM),
    (r"engine_torque", "N_m", 1.0),
    (r"wheel_rate" + _CORNER, "rad_per_s", 1.0),
    (r"(joint|yaw|pitch|roll)_rate", "deg_per_s", DEGREE),
    (r"joint_angle|arm_angle" + _CORNER + "|roll|pitch|yaw", "deg", DEGREE),
    (r"position_[xyz]", "m", 1.0),
    (r"speed", "m_per_s", 1.0),
    (r"wheel_load" + _CORNER + "|hull_force", "kN", 1e3),
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

IDEAL = "ideal"
NOISY = "joint angle: published kind of noise; pressures: typical transmitters; the others: ideal"
"""What a manifest says of the sensors."""

MEASURED_COLUMNS = re.compile(
    "|".join([*(re.escape(column) for column, *_ in _MEASURED), "joint_angle_deg", "imu_.*", "gps_.*", "true_.*"])
)
"""Names of the columns of a log that are no commands."""


def field_unit(channel: str) -> tuple[str, float]:
    """Unit of a channel at the edge, as it stands in a column's name, and that unit's SI value; '' for pure numbers."""
    for pattern, unit, size in _UNITS:
        if re.fullmatch(pattern, channel):
            return unit, size
    return "", 1.0


def voltage_from_signal(signal: ArrayLike) -> NDArray[np.float64]:
    """Steering voltage [V] of a signal in [-1, 1]: 0.5 V is full left, 4.5 V full right."""
    return 2.5 - 2.0 * np.asarray(signal, dtype=np.float64)


def signal_from_voltage(voltage: ArrayLike) -> NDArray[np.float64]:
    """Steering signal in [-1, 1] of a voltage [V]; inverse of :func:`voltage_from_signal`."""
    return (2.5 - np.asarray(voltage, dtype=np.float64)) / 2.0


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
    for name in COMMAND_BOUNDS:
        if name in channels:
            columns[name] = np.asarray(channels[name], dtype=np.float64)[begins]
            if name == "steering_signal":
                columns["steering_signal_V"] = voltage_from_signal(columns[name])
    streams = [None] * len(_MEASURED) if rng is None else rng.spawn(len(_MEASURED))  # one a column, whichever there are
    for (column, channel, size), stream in zip(_MEASURED, streams, strict=True):
        if channel in si:
            measured = si[channel] if stream is None else _measured(channel, instants, channels[channel], stream)
            columns[column] = measured / size
    for channel, values in si.items():
        if channel != "time" and channel not in COMMAND_BOUNDS:
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
    """Write ``columns`` to ``path`` (.csv or .parquet) and ``manifest`` beside it (.toml); returns what was written."""
    check_log_path(path)
    arrays = {name: np.asarray(values, dtype=np.float64) for name, values in columns.items()}
    with written_whole(path) as temporary:
        if path.suffix == ".parquet":
            import pyarrow
            import pyarrow.parquet

            pyarrow.parquet.write_table(pyarrow.table(arrays), temporary)
        else:
            rows = np.column_stack(list(arrays.values()))
            np.savetxt(temporary, rows, fmt="%.9g", delimiter=",", header=",".join(arrays), comments="")
    written = [path]
    if manifest is not None:
        written.append(path.with_suffix(".toml"))
        write_text(written[-1], _toml(manifest))
    return written


def write_whole(path: Path, text: str) -> None:
    """Write ``text`` and a line's end, whole or not at all."""
    write_text(path, text + "\n")


def check_log_path(path: Path) -> None:
    """``ValueError`` unless a log can be written to ``path``."""
    if path.suffix not in (".csv", ".parquet"):
        raise ValueError(f"log {path} must end in .csv or .parquet")
    check_writable(path)
    if path.suffix == ".parquet":
        try:
            import pyarrow  # noqa: F401
        except ImportError:
            raise ValueError(f"log {path} needs pyarrow: pip install 'aoro-gym[parquet]', or end it in .csv") from None


@dataclass(frozen=True)
class Table:
    """Columns of numbers read from a file."""

    path: Path
    columns: dict[str, NDArray[np.float64]]
    lines: NDArray[np.int64]
    """Line of the file that each row stands on, from 1."""

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        return self.columns[name]

    def where(self, row: int) -> str:
        """File and line of a row, for messages."""
        return f"{self.path}, line {self.lines[row]}"


def read_table(path: Path) -> Table:
    """Read a log or a command file: a header with ``time_s``, then rows of finite numbers; ``#`` starts a comment line.

    Raises:
        ValueError: names the file, the line and the column of the first fault.
    """
    if not path.is_file():
        raise ValueError(f"{path} is not a file" if path.exists() else f"file {path} does not exist")
    if path.suffix == ".parquet":
        return _read_parquet(path)
    header: list[str] = []
    rows: list[list[float]] = []
    lines: list[int] = []
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            reader = csv.reader(stream)
            for cells in reader:
                if not any(cell.strip() for cell in cells) or cells[0].lstrip().startswith("#"):
                    continue
                if header:
                    rows.append(_numbers(path, reader.line_num, header, cells))
                    lines.append(reader.line_num)
                else:
                    header = _header(path, [cell.strip() for cell in cells])
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"{path} is not a CSV text file: {error}") from None
    if not rows:
        raise ValueError(f"{path} holds no rows; it needs a header such as time_s,steering_signal and rows of numbers")
    values = np.array(rows, dtype=np.float64)
    return Table(path, {name: values[:, index] for index, name in enumerate(header)}, np.array(lines))


def _read_parquet(path: Path) -> Table:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise ValueError(f"{path} needs pyarrow: pip install 'aoro-gym[parquet]'") from None
    try:
        table = pyarrow.parquet.read_table(path)
    except pyarrow.ArrowException as error:
        raise ValueError(f"{path} is not a Parquet file: {error}") from None
    names = _header(path, table.column_names)
    lines = np.arange(1, table.num_rows + 1)
    if not table.num_rows:
        raise ValueError(f"{path} holds no rows")
    columns = {}
    for name in names:
        try:
            columns[name] = table[name].to_numpy().astype(np.float64)
        except (TypeError, ValueError):
            raise ValueError(f"{path}: column {name!r} does not hold numbers") from None
        for index in np.flatnonzero(~np.isfinite(columns[name])):
            raise ValueError(
                f"{path}, line {lines[index]}: {name} = {columns[name][index]} is not a finite number; leave such rows out"
            )
    return Table(path, columns, lines)


def _header(path: Path, names: list[str]) -> list[str]:
    if "time_s" not in names:
        raise ValueError(f"{path}: the header has no column time_s, only {', '.join(names)}")
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"{path}: the header names the column {name!r} twice")
    return names


def _numbers(path: Path, line: int, header: list[str], cells: list[str]) -> list[float]:
    if len(cells) != len(header):
        raise ValueError(f"{path}, line {line}: {len(cells)} values where the header names {len(header)} columns")
    row = []
    for name, cell in zip(header, cells, strict=True):
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise ValueError(
                f"{path}, line {line}: {name} = {cell.strip()!r} is not a finite number; leave such rows out"
            )
        row.append(value)
    return row


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
