"""Recordings: what a machine's logger wrote, checked, on an even time grid. Faults are named, never silently used.

What cannot be used at all is a ``ValueError``; what limits what can be said stands in ``Recording.limitations``.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.log import BAR, MEASURED_COLUMNS, RPM, Table, read_table, signal_from_voltage
from aoro_gym.twin.records import Command

TICK = 0.01
"""Interval [s] of the grid, and of the machine's logger."""

COMMANDS = {"steering_signal": Command.STEERING_SIGNAL, "drive_signal": Command.DRIVE_SIGNAL}
"""Columns that command the machine; zero where a log has none."""

CHANNELS: dict[str, tuple[str, float]] = {
    # column: twin's output, SI value of the column's unit
    "joint_angle_rad": ("joint_angle", 1.0),
    "pressure_a_bar": ("pressure_a", BAR),
    "pressure_b_bar": ("pressure_b", BAR),
    "pump_pressure_bar": ("pump_pressure", BAR),
    "drive_pressure_forward_bar": ("drive_pressure_forward", BAR),
    "drive_pressure_return_bar": ("drive_pressure_return", BAR),
    "engine_speed_rpm": ("engine_speed", RPM),
}
"""Measured columns that a diagnosis compares."""
KNOWN = {"time_s", "steering_signal_V", *COMMANDS}
"""Columns that a log may have beside measured ones."""

REST = 0.3
"""Standstill [s] that a recording must begin with: it gives the start angle and the noise."""
SHORTEST = 1.5
"""Time [s] below which nothing can be said of a manoeuvre."""
COARSEST = 0.051
"""Sampling interval [s] above which peaks are lost."""
LONGEST_GAP = 0.1
"""Gap [s] in the samples that is bridged, and named; across a longer one a log is refused."""
LARGEST_ANGLE = 1.2
"""Joint angle [rad] that no machine of this kind reaches: a larger one was logged in degrees."""
FASTEST = 2.0
"""Joint rate [rad/s] that no machine of this kind reaches, by a factor of two: an angle that changes faster has jumped."""
JUMP_NOISE = 8.0
"""Standard deviations of the differences at rest by which noise does not make an angle jump."""
LARGEST_PRESSURE = 600.0
"""Pressure [bar] that bursts hoses of this kind: a higher one was logged in another unit."""
MOVED = np.radians(1.0)
"""Travel [rad] beyond noise from which it is judged whether the joint follows its command: no joint recoils so far."""
STUCK, STUCK_NOISE = 12, 10
"""Equal samples in a row that make a sensor look saturated, or stuck: so many, and so many times the most of them at rest,
where a quantiser repeats itself, too. Which shows no noise at rest cannot be judged."""
STUCK_TIME = 0.1
"""Least time [s] that they take."""
NOISELESS = 1e-4
"""Change from sample to sample at rest, as a share of a signal's span, below which its sensor shows no noise."""


@dataclass(frozen=True)
class Recording:
    """One manoeuvre on an even grid of :data:`TICK`; F samples, F − 1 ticks between them."""

    name: str
    commands: NDArray[np.float64]  # (F − 1, len(COMMANDS)), each held from one sample to the next
    channels: dict[str, NDArray[np.float64]]  # (F,) SI, by the twin's output names
    rest: int  # samples of standstill at the beginning
    start_angle: float  # [rad] mean over them
    limitations: tuple[str, ...] = ()
    manifest: dict[str, Any] = field(default_factory=dict)

    @property
    def ticks(self) -> int:
        return len(self.commands)

    @property
    def signature(self) -> bytes:
        """Equal for two recordings of the same commands."""
        return np.round(self.commands, 3).tobytes()


def read_recording(path: Path) -> Recording:
    """Read a log (CSV or Parquet) and the manifest beside it.

    Columns named ``true_*`` are never read.

    Raises:
        ValueError: the log cannot be used; names the file, the line or column, the value, and what is needed.
    """
    manifest = _manifest(path)
    limitations: list[str] = []
    table = _whole_rows(path, limitations)
    time, keep = _instants(table, limitations)
    columns = {name: values[keep] for name, values in table.columns.items() if not name.startswith("true_")}
    unread = [name for name in columns if name not in KNOWN and not MEASURED_COLUMNS.fullmatch(name)]
    if unread:
        limitations.append(f"{path.name}: unknown columns were not read: {', '.join(unread)}")
    commands = _commands(path, columns)
    channels = _channels(path, columns, limitations)
    moving = np.flatnonzero(np.any(commands, axis=1))
    still = max(int(moving[0]), 1) if moving.size else len(time)
    _look_over_samples(table, time, keep, channels, still, limitations)

    grid = np.arange(0.0, time[-1] + 1e-9, TICK)
    held = commands[np.searchsorted(time, grid[:-1] + 1e-6, side="right") - 1]
    sampled = {name: np.interp(grid, time, values) for name, values in channels.items()}
    moving = np.flatnonzero(np.any(held, axis=1))
    rest = int(moving[0]) + 1 if moving.size else len(grid)
    if rest * TICK < REST:
        raise ValueError(
            f"{path} begins with {rest * TICK:.2f} s of zero commands; a diagnosis needs {REST} s of standstill, which "
            "gives the start angle and the noise"
        )
    if not moving.size:
        raise ValueError(f"{path} commands no motion: steering_signal is zero throughout")
    angle = sampled["joint_angle"]
    start = float(np.mean(angle[:rest]))
    _look_over(path, held, sampled, rest, limitations)
    return Recording(path.stem, held, sampled, rest, start, tuple(limitations), manifest)


def logs_in(folder: Path) -> list[Path]:
    """All logs in a folder, by their names; none if there is no such folder."""
    return sorted([*folder.glob("*.csv"), *folder.glob("*.parquet")])


def _manifest(path: Path) -> dict[str, Any]:
    beside = path.with_suffix(".toml")
    if not beside.is_file():
        return {}
    try:
        return tomllib.loads(beside.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"manifest {beside} is not TOML: {error}") from None


def _whole_rows(path: Path, limitations: list[str]) -> Table:
    """The log's table, less a last row in which its file may have been cut."""
    table = read_table(path)
    if path.suffix == ".parquet" or path.read_bytes().endswith(b"\n") or len(table.lines) == 1:
        return table
    limitations.append(f"{table.where(-1)}: the file ends within a line; its last row was left out")
    return Table(path, {name: values[:-1] for name, values in table.columns.items()}, table.lines[:-1])


def _instants(table: Table, limitations: list[str]) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Rising instants from zero [s], and the rows that they belong to."""
    time = table["time_s"]
    # a repeated or reversed stamp belongs to a row that is left out
    latest = np.maximum.accumulate(time)
    keep = np.flatnonzero(np.r_[True, time[1:] > latest[:-1]])
    if len(keep) < len(time):
        bad = int(np.setdiff1d(np.arange(len(time)), keep)[0])
        share = 1.0 - len(keep) / len(time)
        if share > 0.05:
            raise ValueError(
                f"{table.where(bad)}: time_s repeats or runs backwards, here and in {share:.0%} of the rows; sort them"
            )
        limitations.append(
            f"{table.where(bad)}: time_s repeats or runs backwards; {len(time) - len(keep)} rows left out"
        )
    time = time[keep] - time[keep[0]]
    if time[-1] < SHORTEST:
        raise ValueError(
            f"{table.path} covers {time[-1]:.2f} s with {len(time)} samples; a diagnosis needs {SHORTEST} s at least"
        )
    steps = np.diff(time)
    usual = float(np.median(steps))
    if usual > COARSEST:
        raise ValueError(
            f"{table.path} has {1.0 / usual:.3g} samples a second; a diagnosis needs {1.0 / COARSEST:.0f} at least: the "
            "first peak of a turn lasts a tenth of a second"
        )
    widest = int(np.argmax(steps))
    if steps[widest] > LONGEST_GAP:
        raise ValueError(
            f"{table.where(int(keep[widest]))}: a gap of {steps[widest]:.2f} s; split the log there, or log without gaps"
        )
    if steps[widest] > 2.5 * usual:
        limitations.append(
            f"{table.where(int(keep[widest]))}: a gap of {steps[widest]:.3f} s, bridged by a straight line"
        )
    return time, keep


def _commands(path: Path, columns: dict[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Commands (K, len(COMMANDS)) of the rows."""
    if "steering_signal" not in columns and "steering_signal_V" not in columns:
        raise ValueError(f"{path} has neither a column steering_signal nor steering_signal_V")
    steering = columns.get("steering_signal")
    if "steering_signal_V" in columns:
        by_voltage = signal_from_voltage(columns["steering_signal_V"])
        if steering is None:
            steering = by_voltage
        elif np.max(np.abs(by_voltage - steering)) > 0.02:
            row = int(np.argmax(np.abs(by_voltage - steering)))
            raise ValueError(
                f"{path}: steering_signal is {steering[row]:.3g} where steering_signal_V says {by_voltage[row]:.3g} "
                f"(row {row + 1}); positive is left, 0.5 V is full left"
            )
    assert steering is not None
    drive = columns.get("drive_signal", np.zeros_like(steering))
    for name, values in (("steering_signal", steering), ("drive_signal", drive)):
        row = int(np.argmax(np.abs(values)))
        if abs(values[row]) > 1.0 + 1e-6:
            raise ValueError(f"{path}: {name} is {values[row]:.4g} in row {row + 1}, but must be in [-1, 1]")
    return np.clip(np.stack([steering, drive], axis=1), -1.0, 1.0)


def _channels(
    path: Path, columns: dict[str, NDArray[np.float64]], limitations: list[str]
) -> dict[str, NDArray[np.float64]]:
    """Measured channels in SI."""
    if "joint_angle_rad" not in columns and "joint_angle_deg" in columns:
        columns["joint_angle_rad"] = np.radians(columns["joint_angle_deg"])
    if "joint_angle_rad" not in columns:
        raise ValueError(f"{path} has no column joint_angle_rad or joint_angle_deg")
    largest = float(np.max(np.abs(columns["joint_angle_rad"])))
    if largest > LARGEST_ANGLE:
        raise ValueError(f"{path}: joint_angle_rad reaches {largest:.3g}; that is degrees: name it joint_angle_deg")
    channels = {}
    for column, (name, unit) in CHANNELS.items():
        if column not in columns:
            continue
        values = columns[column]
        if np.ptp(values) == 0.0:
            if name == "joint_angle":
                raise ValueError(
                    f"{path}: {column} is {values[0]:.6g} throughout: the sensor or its logger stands still"
                )
            limitations.append(f"{path.name}: {column} is {values[0]:.6g} throughout and was not used")
            continue
        if column.endswith("_bar") and np.max(np.abs(values)) > LARGEST_PRESSURE:
            raise ValueError(
                f"{path}: {column} reaches {np.max(np.abs(values)):.3g}, but hoses burst at {LARGEST_PRESSURE:g} bar; was "
                "it logged in Pa, kPa or psi?"
            )
        channels[name] = values * unit
    return channels


def _look_over_samples(
    table: Table,
    time: NDArray[np.float64],
    keep: NDArray[np.intp],
    channels: dict[str, NDArray[np.float64]],
    still: int,
    limitations: list[str],
) -> None:
    """What samples (F,) say by themselves, of which ``still`` are at rest; takes sensors out that cannot be used."""
    angle = channels["joint_angle"]
    steps, intervals = np.diff(angle), np.diff(time)
    noise = JUMP_NOISE * np.std(steps[: still - 1]) if still > 1 else np.inf
    jumps = np.flatnonzero(np.abs(steps) > FASTEST * intervals + noise)
    if jumps.size:
        row = int(jumps[0])
        raise ValueError(
            f"{table.where(int(keep[row + 1]))}: the joint angle jumps by {np.degrees(abs(steps[row])):.3g}° in "
            f"{intervals[row]:.3g} s, which no joint does; leave such rows out, or mend the sensor"
        )
    for column, (name, unit) in CHANNELS.items():
        values = channels.get(name)
        if values is None:
            continue
        usual = _longest_run(values[:still])[0] if still > 1 else STUCK
        length, first = _longest_run(values)
        duration = time[first + length - 1] - time[first]
        noisy = usual < STUCK and np.std(np.diff(values[:still])) > NOISELESS * np.ptp(values)
        if not noisy or length < max(STUCK, STUCK_NOISE * usual) or duration < STUCK_TIME:
            continue
        said = (
            f"{table.where(int(keep[first]))}: {column} stays at exactly {values[first] / unit:.6g} for {duration:.2f} s: "
            "its sensor is saturated, or hangs"
        )
        if name == "joint_angle":
            raise ValueError(f"{said}; cut the log there, or leave it out")
        limitations.append(f"{said}; it was not used")
        del channels[name]


def _look_over(
    path: Path,
    commands: NDArray[np.float64],
    channels: dict[str, NDArray[np.float64]],
    rest: int,
    limitations: list[str],
) -> None:
    """What commands and channels say of each other."""
    angle = channels["joint_angle"]
    travel = angle - np.mean(angle[:rest])
    third = rest // 3
    moved = abs(np.mean(angle[rest - third : rest]) - np.mean(angle[:third]))
    if moved > MOVED:
        raise ValueError(
            f"{path}: the joint turns by {np.degrees(moved):.3g}° before the first command; it must stand still, and "
            "commands and angle must be of one clock"
        )
    if np.any(commands[:, 0]) and np.max(np.abs(travel)) < np.radians(0.5):
        limitations.append(f"{path.name}: the joint hardly moves under its commands")
    side, stretch = _first_turn(commands[:, 0])
    beyond = np.flatnonzero(np.abs(travel[stretch]) > MOVED + 3.0 * np.std(angle[:rest]))
    if beyond.size and side * travel[stretch][beyond[0]] < 0.0:
        raise ValueError(
            f"{path}: the joint turns against its command: positive signals and angles are to the left; swap one sign"
        )
    if np.any(commands[-1]):
        limitations.append(f"{path.name} ends under a command: how the machine comes to rest is missing")


def _first_turn(steering: NDArray[np.float64]) -> tuple[float, slice]:
    """Sign of the first signal that is not zero, and the samples for as long as it keeps that sign."""
    signs = np.sign(steering)
    commanded = np.flatnonzero(signs)
    if not commanded.size:
        return 0.0, slice(0, 0)
    first = int(commanded[0])
    last = first + int(np.argmax(np.append(signs[first:], 0.0) != signs[first]))
    return float(signs[first]), slice(first, last + 1)


def _longest_run(values: NDArray[np.float64]) -> tuple[int, int]:
    """Length of the longest run of equal values, and where it begins."""
    edges = np.flatnonzero(np.diff(values, prepend=np.nan, append=np.nan))
    lengths = np.diff(edges)
    longest = int(np.argmax(lengths))
    return int(lengths[longest]), int(edges[longest])
