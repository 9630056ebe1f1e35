"""Logs of a machine, checked, on an even time grid. Faults are named, never silently used.

>>> recording = read_log(Path("turn.csv"), purpose="a calibration")  # doctest: +SKIP

What cannot be used at all is a ``ValueError``; what limits what can be said stands in ``Log.limitations``. Columns
are found by quantity and unit (:data:`QUANTITIES`); those named ``true_*``, the simulator's own state, are never read.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aoro_gym.recording.cells import listed, shown
from aoro_gym.recording.commands import ALL_COMMAND_BOUNDS, COMMAND_BOUNDS, CRANE_COMMAND_BOUNDS, WHEELS
from aoro_gym.recording.manifest import Manifest, read_manifest
from aoro_gym.recording.tables import Table, read_table
from aoro_gym.recording.units import LONGEST_NAME, NamedQuantity, Unit, canonical, find_unit, parse_name, splits
from aoro_gym.units import BAR, DEGREE, RPM

Floats = NDArray[np.float64]

TICK = 0.01
"""Interval [s] of the grid, and of the machine's logger."""
REST = 0.3
"""Standstill [s] that a recording must begin with: it gives the start angle and the noise."""
SHORTEST = 1.5
"""Time [s] below which nothing can be said of a manoeuvre."""
LONGEST = 21600.0
"""Time [s] that a log may cover: six hours."""
COARSEST = 0.051
"""Sampling interval [s] above which peaks are lost."""
LONGEST_GAP = 0.1
"""Gap [s] in the samples that is bridged, and named; across a longer one a log is refused."""
LEFT_OUT = 0.05
"""Share of the rows that may repeat or run backwards in time: they are left out, and named."""
LARGEST_ANGLE = 1.2
"""Joint angle [rad] that no machine of this kind reaches."""
FASTEST = 2.0
"""Joint rate [rad/s] that no machine of this kind reaches, by a factor of two: an angle that changes faster has jumped."""
JUMP_NOISE = 8.0
"""Standard deviations of the differences at rest by which noise does not make an angle jump."""
HELD = 0.1
"""Time [s] for which a slow bus may hold a sample: an angle that is known so seldom moves in steps."""
HELD_STEPS = 4
"""Steps at an even pace that show it."""
LARGEST_PRESSURE = 600 * BAR
"""Pressure [Pa] that bursts hoses of this kind: a higher one was logged in another unit."""
SMALLEST_PRESSURE = 0.2 * BAR
"""Pressure [Pa] that any line exceeds while a pump runs, by its back pressure or charge (E): a signal below it was logged in
another unit, or its sensor is dead."""
LARGEST_ENGINE_SPEED = 6000 * RPM
"""Speed [rad/s] that no diesel engine of this kind reaches."""
MOVED = np.radians(1.0)
"""Travel [rad] beyond noise from which it is judged whether the joint follows its command: no joint recoils so far."""
HARDLY = np.radians(0.5)
"""Travel [rad] below which the joint hardly moves."""
STUCK, STUCK_NOISE = 12, 10
"""Equal samples in a row that make a sensor look saturated, or stuck: so many, and so many times the most of them at rest,
where a quantiser repeats itself, too. Which shows no noise at rest cannot be judged."""
QUANTISED = 2.5
"""Steps of its resolution within which a signal stays at rest where its quantiser hides the noise: it may repeat itself for
any time when it stands between two of them, and cannot be judged either."""
STUCK_TIME = 0.1
"""Least time [s] that they take."""
NOISELESS = 1e-4
"""Change from sample to sample at rest, as a share of a signal's span, below which its sensor shows no noise."""


class Quantity(NamedTuple):
    """What a column may hold."""

    dimensions: tuple[str, ...]
    column: str
    """Its name in the project's own logs, whose unit is the example in messages."""
    bases: frozenset[str]
    """Canonical names that it goes by."""


def _quantity(column: str, dimensions: str, *bases: str) -> Quantity:
    return Quantity(tuple(dimensions.split()), column, frozenset(bases))


CHANNELS: dict[str, Quantity] = {
    "joint_angle": _quantity(
        "joint_angle_rad",
        "angle",
        "joint_angle",
        "articulation_angle",
        "angle",
        "knickwinkel",
        "gelenkwinkel",
        "winkel",
        "angle_d_articulation",
    ),
    "pressure_a": _quantity(
        "pressure_a_bar", "pressure", "pressure_a", "port_a_pressure", "pressure_port_a", "druck_a", "pression_a"
    ),
    "pressure_b": _quantity(
        "pressure_b_bar", "pressure", "pressure_b", "port_b_pressure", "pressure_port_b", "druck_b", "pression_b"
    ),
    "pump_pressure": _quantity(
        "pump_pressure_bar", "pressure", "pump_pressure", "pressure_pump", "pumpendruck", "pression_pompe"
    ),
    "drive_pressure_forward": _quantity("drive_pressure_forward_bar", "pressure", "drive_pressure_forward"),
    "drive_pressure_return": _quantity("drive_pressure_return_bar", "pressure", "drive_pressure_return"),
    "engine_speed": _quantity(
        "engine_speed_rpm",
        "rotational_speed",
        "engine_speed",
        "engine",
        "drehzahl",
        "motordrehzahl",
        "régime_moteur",
        "regime_moteur",
    ),
    **{
        f"wheel_rate_{wheel}": _quantity(
            f"wheel_speed_{wheel}_rad_per_s", "rotational_speed", f"wheel_speed_{wheel}", f"wheel_rate_{wheel}"
        )
        for wheel in WHEELS
    },
}
"""Measured quantities, by the twin's output."""

_STEERING = (
    "steering_signal", "steering_command", "steering_cmd", "steer_command", "steer_cmd", "steering", "steer", "lenksignal",
    "lenkbefehl", "lenkung", "commande_de_direction",
)  # fmt: skip
LOOSE = frozenset(("angle", "winkel", "engine", "steering", "steer", "lenkung"))
"""Names that say what is meant with a fitting unit only, and give way to plainer ones; that they were taken is said."""
GERMAN = frozenset(("knickwinkel", "gelenkwinkel", "winkel"))
"""Angles whose unit "Grad" is the degree; elsewhere the word may be the gon, too, and is asked for."""

QUANTITIES: dict[str, Quantity] = {
    "time": _quantity(
        "time_s", "time", "time", "t", "timestamp", "time_stamp", "stamp", "header_stamp", "datetime", "date_time",
        "date_and_time", "utc", "time_utc", "utc_time", "timestamp_utc", "gps_time", "time_local", "local_time", "elapsed",
        "elapsed_time", "sim_time", "clock", "epoch", "epoch_time", "unix_time", "zeit", "uhrzeit", "zeitstempel",
        "datum_zeit", "datum_uhrzeit", "temps", "heure", "horodatage",
    ),
    "steering_voltage": _quantity("steering_signal_V", "voltage", "steering_voltage", "lenkspannung", *_STEERING),
    **{name: _quantity(name, "ratio", name) for name in (*COMMAND_BOUNDS, *CRANE_COMMAND_BOUNDS)},
    "crane_held_mass": _quantity("crane_held_mass_kg", "mass", "crane_held_mass"),
    "crane_held_yaw": _quantity("crane_held_yaw_rad", "angle", "crane_held_yaw"),
    "crane_held_axial": _quantity("crane_held_axial_kg_m2", "moment_of_inertia", "crane_held_axial"),
    "crane_held_transverse": _quantity("crane_held_transverse_kg_m2", "moment_of_inertia", "crane_held_transverse"),
    "steering_signal": _quantity("steering_signal", "ratio", *_STEERING),
    **CHANNELS,
}  # fmt: skip
"""Everything that a log is asked for."""

_FIRST_WORDS = tuple({base.split("_")[0] for one in QUANTITIES.values() for base in one.bases})
_BY_BASE: dict[str, list[str]] = {}
for _name, _one in QUANTITIES.items():
    for _base in _one.bases:
        _BY_BASE.setdefault(_base, []).append(_name)

NOT_ASKED = re.compile(r"true_.*|imu_.*|gps_.*|crane_(joint|rate|pressure|tip_load)_.*", re.IGNORECASE)
"""Columns that a log of this project may have, and nobody asks a recording for."""


class Column(NamedTuple):
    """A column that was read."""

    name: str
    """In the file's header."""
    unit: Unit | None
    reading: str
    """Its unit in words."""


@dataclass(frozen=True)
class Log:
    """One manoeuvre on an even grid of :data:`TICK`; F samples, F − 1 ticks between them."""

    path: Path
    commands: dict[str, Floats]
    """(F − 1,) of every command that the log has, by name, each held from one sample to the next; within COMMAND_BOUNDS."""
    channels: dict[str, Floats]
    """(F,) SI, by the twin's output names."""
    rest: int
    """Samples of standstill at the beginning."""
    start_angle: float
    """Joint angle [rad], mean over them."""
    rate: float
    """Samples a second [Hz] of the file, usually."""
    columns: dict[str, Column]
    """What was read, by quantity."""
    unread: tuple[str, ...]
    """Columns that were not."""
    limitations: tuple[str, ...] = ()
    manifest: Manifest = field(default_factory=Manifest)

    @property
    def name(self) -> str:
        return self.path.stem

    @property
    def duration(self) -> float:
        """Seconds."""
        return TICK * (len(self.channels["joint_angle"]) - 1)


def read_log(
    path: Path,
    *,
    purpose: str = "a recording",
    commands: Collection[str] = tuple(COMMAND_BOUNDS),
    channels: Collection[str] = tuple(CHANNELS),
) -> Log:
    """Read a log (CSV of any dialect, or Parquet) and the manifest beside it.

    Args:
        path: File.
        purpose: What the log is read for, in messages.
        commands: Those that are replayed; what another one commands is a limitation.
        channels: Measured quantities that are wanted; others are not looked at.

    Raises:
        ValueError: the log cannot be used; names the file, the line or column, the value, and what is needed.
    """
    manifest = read_manifest(path)
    notes: list[str] = list(manifest.warnings)
    table = read_table(path)
    if table.is_cut and len(table) > 1:
        notes.append(f"{table.where(-1)}: the file ends within a line; its last row was left out")
        table = table.without_last_row()
    if table.dialect.passed_over:
        notes.append(f"{path.name}: {table.dialect.passed_over} lines before the header were passed over")
    channels = {"joint_angle", *channels}
    reading = _Reading(table, purpose, notes)
    reading.find_columns(commands, channels)
    time, keep = reading.instants()
    given = {name: values[keep] for name, values in reading.commands(commands).items()}
    measured = {name: values[keep] for name, values in reading.channels(channels).items()}
    idle = _idle(given)
    still = max(int(np.argmin(idle)), 1) if not idle.all() else len(time)
    reading.check_samples(time, keep, measured, still)

    grid = np.arange(0.0, time[-1] + 1e-9, TICK)
    before = np.searchsorted(time, grid[:-1] + 1e-6, side="right") - 1
    held = {name: values[before] for name, values in given.items()}
    sampled = {name: np.interp(grid, time, values) for name, values in measured.items()}
    idle = _idle(held)
    rest = int(np.argmin(idle)) + 1 if not idle.all() else len(grid)
    if rest * TICK < REST:
        raise ValueError(
            f"{path} begins with {rest * TICK:.2f} s of zero commands; {purpose} needs {REST} s of standstill, which "
            "gives the start angle and the noise"
        )
    if idle.all():
        raise ValueError(f"{path} commands no motion: {listed(list(held))} stay at zero")
    _check_motion(path, held.get("steering_signal", np.zeros(len(before))), sampled["joint_angle"], rest, notes)
    if not _idle({name: values[-1:] for name, values in held.items()}).all():
        notes.append(f"{path.name} ends under a command: how the machine comes to rest is missing")
    return Log(
        path, held, sampled, rest, float(np.mean(sampled["joint_angle"][:rest])), 1.0 / float(np.median(np.diff(time))),
        dict(reading.columns), table.unread, tuple(notes), manifest,
    )  # fmt: skip


def signal_from_voltage(voltage: Floats) -> Floats:
    """Steering signal in [-1, 1] of a voltage [V]: 0.5 V is full left, 4.5 V full right."""
    return (2.5 - np.asarray(voltage, dtype=np.float64)) / 2.0


def find_quantities(names: Collection[str]) -> dict[str, list[tuple[str, NamedQuantity]]]:
    """Columns of each of :data:`QUANTITIES`, those with the project's own name first."""
    found: dict[str, list[tuple[str, NamedQuantity]]] = {}
    for name in names:
        if name.lower().startswith("true_") or not canonical(name[:LONGEST_NAME]).startswith(_FIRST_WORDS):
            continue
        named = _named(name)
        if named is not None:
            found.setdefault(named[0], []).append((name, named[1]))
    for key, columns in found.items():
        fitting = [column for column in columns if not column[1].is_unknown]
        fitting = [column for column in fitting if column[1].base not in LOOSE] or fitting
        found[key] = sorted(fitting or columns, key=lambda column: column[0] != QUANTITIES[key].column)
    if "time" in found and found["time"][0][1].is_unknown and found["time"][0][1].base == "t":
        del found["time"]  # T [°C]
    return found


def _named(name: str) -> tuple[str, NamedQuantity] | None:
    """The quantity that a column's name says; None if it is another one."""
    parted = splits(name)
    asked = dict.fromkeys(key for split in parted for key in _BY_BASE.get(split.base, ()))
    fitting = [(key, parse_name(name, QUANTITIES[key].bases, *QUANTITIES[key].dimensions)) for key in asked]
    found = [(key, _in_german(one)) for key, one in fitting if one is not None]
    found = [(key, one) for key, one in found if one.unit is not None or one.base not in LOOSE]
    # steering_signal is a share unless its unit is a voltage
    known = [(key, one) for key, one in found if one.unit is not None]
    bare = [(key, one) for key, one in found if one.unit is None and key != "steering_voltage"]
    # joint_angle_bar, drive_signal_V: a unit of something else
    misfits = [
        (key, NamedQuantity(split.base, None, split.unit_text))
        for split in parted
        for key in _BY_BASE.get(split.base, ())
        if split.unit_text and key != "steering_voltage" and split.base not in LOOSE
    ]
    return next(iter(known or bare or misfits), None)


def _in_german(one: NamedQuantity) -> NamedQuantity:
    is_degree = one.base in GERMAN and one.unit_text.strip(" .").lower() == "grad"
    return replace(one, unit=find_unit("deg", "angle")) if is_degree else one


def _idle(commands: Mapping[str, Floats]) -> NDArray[np.bool_]:
    """Where nothing commands the machine to move: signals and arms are zero."""
    moving = [values != 0.0 for name, values in commands.items() if ALL_COMMAND_BOUNDS[name][0] < 0.0]
    return ~np.any(moving, axis=0)


@dataclass
class _Reading:
    """A table on its way to a recording."""

    table: Table
    purpose: str
    notes: list[str]
    columns: dict[str, Column] = field(default_factory=dict)

    @property
    def path(self) -> Path:
        return self.table.path

    def note(self, text: str) -> None:
        self.notes.append(f"{self.path.name}: {text}")

    def find_columns(self, commands: Collection[str], channels: Collection[str]) -> None:
        """Which column is read for what; says what is missing, doubtful, or not read."""
        found = find_quantities(self.table.names)
        self._require(found)
        known = {name for columns in found.values() for name, _ in columns}
        strangers = [name for name in self.table.names if name and name not in known]
        unknown = [name for name in strangers if not NOT_ASKED.fullmatch(name)]
        unused = [name for name in strangers if NOT_ASKED.fullmatch(name) and not name.lower().startswith("true_")]
        if unknown:
            self.note(f"unknown columns were not read: {listed(unknown)}")
        if unused:
            self.note(f"not read, as {self.purpose} has no use for it: {listed(unused)}")
        for key, ((name, quantity), *others) in found.items():
            wanted = key in ("time", "joint_angle", "steering_voltage") or key in commands or key in channels
            if not wanted and key in CHANNELS:
                continue
            if others:
                self.note(f"{listed([other for other, _ in others])} not read, as {name} is the same quantity")
            if quantity.unit is None and key not in ("time", "joint_angle") and key not in ALL_COMMAND_BOUNDS:
                said = f"the unit {shown(quantity.unit_text)} is unknown" if quantity.is_unknown else "no unit is named"
                self.note(f"{name} was not read, as {said}; name it {QUANTITIES[key].column}, for instance")
                continue
            if quantity.is_unknown:
                said = f"column {shown(name)} is in {shown(quantity.unit_text)}, which is no unit of this quantity"
                if wanted:
                    doubt = " (degrees or gon?)" if quantity.unit_text.lower() == "grad" else ""
                    raise ValueError(f"{self.path}: {said}{doubt}; name it {QUANTITIES[key].column}, for instance")
                self.note(f"{said}; it was not read")
                continue
            if quantity.base in LOOSE:
                self.note(f"{name} was taken for {QUANTITIES[key].column}")
            self.columns[key] = Column(name, quantity.unit, "" if quantity.unit is None else quantity.unit.symbol)
        wanted = {*channels, *commands, "steering_voltage"}
        self.table.load(*(column.name for key, column in self.columns.items() if key in wanted))

    def _require(self, found: Mapping[str, Any]) -> None:
        names = listed(self.table.names)
        if "time" not in found:
            raise ValueError(f"{self.path}: the header has no column time_s, only {names}")
        if "steering_signal" not in found and "steering_voltage" not in found:
            raise ValueError(f"{self.path} has neither a column steering_signal nor steering_signal_V, only {names}")
        if "joint_angle" not in found:
            raise ValueError(f"{self.path} has no column joint_angle_rad or joint_angle_deg, only {names}")

    def numbers(self, key: str) -> Floats:
        """Values of a column in its SI unit,."""
        column = self.columns[key]
        values = self.table.numbers(column.name)
        return values if column.unit is None else column.unit.to_si(values)

    # ------------------------------------------------------------------------------------------------------------ time

    def instants(self) -> tuple[Floats, NDArray[np.intp]]:
        """Rising instants from zero [s], and the rows that they belong to."""
        column = self.columns["time"]
        time, said = self.table.elapsed(column.name, column.unit)
        self.columns["time"] = column = Column(column.name, column.unit, said)
        if "by its values" in said:
            self.note(f"{column.name} names no unit and was read in {said}")
        latest = np.maximum.accumulate(time)
        rising = np.flatnonzero(np.r_[True, time[1:] >= latest[:-1]])
        # of rows at one instant the last holds from there on, as an event's does
        keep = rising[np.r_[np.diff(time[rising]) > 0.0, True]]
        if len(keep) < len(time):
            self._check_left_out(time, keep)
        time = time[keep] - time[keep[0]]
        self._check_sampling(time, keep, column)
        return time, keep

    def _check_left_out(self, time: Floats, keep: NDArray[np.intp]) -> None:
        name = self.columns["time"].name
        left_out = np.setdiff1d(np.arange(len(time)), keep)
        where, share = self.table.where(int(left_out[0])), len(left_out) / len(time)
        is_sorted = bool(np.all(np.diff(time) >= 0.0))
        if self._repeats(time, keep, left_out):
            self.note(f"{len(left_out)} rows repeat another one in time and value, and were left out")
            return
        if share <= LEFT_OUT:
            self.notes.append(f"{where}: {name} repeats or runs backwards; {len(left_out)} rows left out")
        elif is_sorted:
            raise ValueError(
                f"{where}: {name} repeats, with other values, here and in {share:.0%} of the rows; log the time with more "
                "digits"
            )
        else:
            raise ValueError(
                f"{where}: {name} repeats or runs backwards, here and in {share:.0%} of the rows; sort them"
            )

    def _repeats(self, time: Floats, keep: NDArray[np.intp], left_out: NDArray[np.intp]) -> bool:
        """Whether every row that is left out says the same as the one kept at its instant."""
        kept = keep[np.minimum(np.searchsorted(time[keep], time[left_out]), len(keep) - 1)]
        if not np.array_equal(time[kept], time[left_out]):
            return False
        values = (self.numbers(key) for key in self.columns if key != "time" and self._is_loaded(key))
        return all(np.array_equal(one[left_out], one[kept]) for one in values)

    def _is_loaded(self, key: str) -> bool:
        return self.columns[key].name not in self.table.unread

    def _check_sampling(self, time: Floats, keep: NDArray[np.intp], column: Column) -> None:
        hint = f"{column.name} was read in {column.reading}"
        if not SHORTEST <= time[-1] <= LONGEST:
            needs = f"{SHORTEST} s at least" if time[-1] < SHORTEST else "six hours at most"
            raise ValueError(
                f"{self.path} covers {time[-1]:.2f} s with {len(time)} samples; {self.purpose} needs {needs} ({hint})"
            )
        steps = np.diff(time)
        usual = float(np.median(steps))
        if usual > COARSEST:
            raise ValueError(
                f"{self.path} has {1.0 / usual:.3g} samples a second; {self.purpose} needs {1.0 / COARSEST:.0f} at least: "
                f"the first peak of a turn lasts a tenth of a second ({hint})"
            )
        widest = int(np.argmax(steps))
        where = self.table.where(int(keep[widest]))
        if steps[widest] > LONGEST_GAP:
            raise ValueError(f"{where}: a gap of {steps[widest]:.2f} s; split the log there, or log without gaps")
        if steps[widest] > 2.5 * usual:
            self.notes.append(f"{where}: a gap of {steps[widest]:.3f} s, bridged by a straight line")

    # -------------------------------------------------------------------------------------------------------- commands

    def commands(self, wanted: Collection[str]) -> dict[str, Floats]:
        """Commands, by name."""
        given: dict[str, Floats] = {}
        for name in ALL_COMMAND_BOUNDS:
            if name not in self.columns and not (name == "steering_signal" and "steering_voltage" in self.columns):
                continue
            if name not in wanted:
                self._look_at_unwanted(name)
                continue
            given[name] = self._steering() if name == "steering_signal" else self._command(name)
        return given

    def _look_at_unwanted(self, name: str) -> None:
        column = self.columns.pop(name)
        try:
            values = self.table.numbers(column.name)
        except ValueError as error:
            self.notes.append(f"{error} ({column.name} was not read)")
            return
        if np.any(values != ALL_COMMAND_BOUNDS[name][2]):
            self.note(f"{column.name} commands the machine, too; {self.purpose} does not replay it")

    def _command(self, name: str) -> Floats:
        values, (low, high, _) = self.numbers(name), ALL_COMMAND_BOUNDS[name]
        beyond = np.maximum(low - values, values - high)
        row = int(np.argmax(beyond))
        if beyond[row] > 1e-6:
            column = self.columns[name]
            hint = ""
            if column.unit is None and high == 1.0 and abs(values[row]) <= 100.0:
                hint = f"; is it percent? Name it {name}_percent"
            raise ValueError(
                f"{self.path}: {column.name} is {values[row]:.4g} in row {row + 1}, but must be in [{low:g}, {high:g}]"
                f"{hint}"
            )
        if name == "gear" and np.any(values != np.rint(values)):
            row = int(np.argmax(values != np.rint(values)))
            raise ValueError(f"{self.table.where(row)}: gear is {values[row]:g}, but must be one of 1, 2, 3")
        return np.clip(values, low, high)

    def _steering(self) -> Floats:
        if "steering_voltage" not in self.columns:
            return self._command("steering_signal")
        by_voltage = signal_from_voltage(self.numbers("steering_voltage"))
        column = self.columns["steering_voltage"].name
        if "steering_signal" not in self.columns:
            row = int(np.argmax(np.abs(by_voltage)))
            if abs(by_voltage[row]) > 1.0 + 1e-6:
                raise ValueError(
                    f"{self.path}: {column} is {2.5 - 2.0 * by_voltage[row]:.4g} V in row {row + 1}, which makes a "
                    f"steering_signal of {by_voltage[row]:.4g}, but it must be in [-1, 1]"
                )
            return np.clip(by_voltage, -1.0, 1.0)
        steering = self._command("steering_signal")
        if np.max(np.abs(by_voltage - steering)) > 0.02:
            row = int(np.argmax(np.abs(by_voltage - steering)))
            raise ValueError(
                f"{self.path}: steering_signal is {steering[row]:.3g} where {column} says {by_voltage[row]:.3g} "
                f"(row {row + 1}); positive is left, 0.5 V is full left"
            )
        return steering

    # -------------------------------------------------------------------------------------------------------- channels

    def channels(self, wanted: Collection[str]) -> dict[str, Floats]:
        """Measured channels in SI."""
        if self.columns["joint_angle"].unit is None:
            self._ask_for_the_unit_of_the_angle()
        angle = self.numbers("joint_angle")
        column = self.columns["joint_angle"]
        largest = float(np.max(np.abs(angle)))
        if largest > LARGEST_ANGLE:
            value = float(np.max(np.abs(self.table.numbers(column.name))))
            if column.unit is not None and column.unit.symbol == "rad":
                raise ValueError(
                    f"{self.path}: {column.name} reaches {value:.3g}; that is degrees: name it joint_angle_deg"
                )
            raise ValueError(
                f"{self.path}: {column.name} reaches {value:.3g}, which is {np.degrees(largest):.3g}°; no joint of this "
                f"kind turns by more than {np.degrees(LARGEST_ANGLE):.0f}°: was it logged in another unit?"
            )
        found = {}
        for key in CHANNELS:
            if key in wanted and key in self.columns:
                values = self._channel(key)
                if values is not None:
                    found[key] = values
        return found

    def _channel(self, key: str) -> Floats | None:
        """A channel in SI; None if its sensor is dead."""
        column, values = self.columns[key], self.numbers(key)
        if np.ptp(values) == 0.0:
            value = self.table.numbers(column.name)[0]
            if key == "joint_angle":
                raise ValueError(
                    f"{self.path}: {column.name} is {value:.6g} throughout: the sensor or its logger stands still"
                )
            self.note(f"{column.name} is {value:.6g} throughout and was not used")
            return None
        largest = float(np.max(np.abs(values)))
        if "pressure" in key and largest > LARGEST_PRESSURE:
            raise ValueError(
                f"{self.path}: {column.name} reaches {largest / BAR:.3g} bar, but hoses burst at "
                f"{LARGEST_PRESSURE / BAR:g} bar; was it logged in Pa, kPa or psi?"
            )
        if "pressure" in key and largest < SMALLEST_PRESSURE:
            self.note(
                f"{column.name} reaches {largest / BAR:.2g} bar at most, less than any line has while a pump runs, and "
                "was not used; was it logged in bar, kPa or MPa?"
            )
            return None
        if key == "engine_speed" and largest > LARGEST_ENGINE_SPEED:
            raise ValueError(
                f"{self.path}: {column.name} reaches {largest / RPM:.4g} rpm, but no engine of this kind "
                "turns faster than 6000 rpm; was it logged in another unit?"
            )
        return values

    def _ask_for_the_unit_of_the_angle(self) -> None:
        """Radians are taken where the motion would be none in any other unit; else the reader is asked."""
        column = self.columns["joint_angle"]
        values = self.table.numbers(column.name)
        largest, travel = float(np.max(np.abs(values))), float(np.ptp(values))
        sizes = {"rad": 1.0, "deg": DEGREE, "gon": math.pi / 200}
        fitting = [unit for unit, size in sizes.items() if largest * size <= LARGEST_ANGLE and travel * size >= HARDLY]
        if fitting == ["rad"]:
            self.note(f"{column.name} names no unit and was read in rad: in degrees the joint would hardly move")
            return
        names = " or ".join(f"joint_angle_{unit}" for unit in fitting or sizes)
        raise ValueError(f"{self.path}: {column.name} names no unit and reaches {largest:.3g}; name it {names}")

    def check_samples(self, time: Floats, keep: NDArray[np.intp], channels: dict[str, Floats], still: int) -> None:
        """What samples (F,) say by themselves, of which ``still`` are at rest; takes sensors out that cannot be used."""
        angle = channels["joint_angle"]
        steps, intervals = np.diff(angle), np.diff(time)
        noise = JUMP_NOISE * float(np.std(steps[: still - 1])) if still > 1 else np.inf
        jumps = np.flatnonzero(np.abs(steps) > FASTEST * intervals + noise)
        jumps = jumps[~_held(time, steps, jumps, noise)]
        if jumps.size:
            row = int(jumps[0])
            raise ValueError(
                f"{self.table.where(int(keep[row + 1]))}: the joint angle jumps by {np.degrees(abs(steps[row])):.3g}° in "
                f"{intervals[row]:.3g} s, which no joint does; leave such rows out, or mend the sensor"
            )
        for key in list(channels):
            values = channels[key]
            usual = _longest_run(values[:still])[0] if still > 1 else STUCK
            length, first = _longest_run(values)
            duration = time[first + length - 1] - time[first]
            noisy = usual < STUCK and np.std(np.diff(values[:still])) > NOISELESS * np.ptp(values)
            noisy = noisy and not _quantised(values[:still])
            if not noisy or length < max(STUCK, STUCK_NOISE * usual) or duration < STUCK_TIME:
                continue
            column = self.columns[key]
            said = (
                f"{self.table.where(int(keep[first]))}: {column.name} stays at exactly "
                f"{self.table.numbers(column.name)[keep[first]]:.6g} for {duration:.2f} s: its sensor is saturated, or hangs"
            )
            if key == "joint_angle":
                raise ValueError(f"{said}; cut the log there, or leave it out")
            self.notes.append(f"{said}; it was not used")
            del channels[key]


def _check_motion(path: Path, steering: Floats, angle: Floats, rest: int, notes: list[str]) -> None:
    """What commands and the joint angle say of each other."""
    travel = angle - np.mean(angle[:rest])
    third = rest // 3
    moved = abs(np.mean(angle[rest - third : rest]) - np.mean(angle[:third]))
    if moved > MOVED:
        raise ValueError(
            f"{path}: the joint turns by {np.degrees(moved):.3g}° before the first command; it must stand still, and "
            "commands and angle must be of one clock"
        )
    if np.any(steering) and np.max(np.abs(travel)) < HARDLY:
        notes.append(f"{path.name}: the joint hardly moves under its commands; if it did, its angle has another unit")
    side, stretch = _first_turn(steering)
    beyond = np.flatnonzero(np.abs(travel[stretch]) > MOVED + 3.0 * np.std(angle[:rest]))
    if beyond.size and side * travel[stretch][beyond[0]] < 0.0:
        raise ValueError(
            f"{path}: the joint turns against its command: positive signals and angles are to the left; swap one sign"
        )


def _first_turn(steering: Floats) -> tuple[float, slice]:
    """Sign of the first signal that is not zero, and the samples for as long as it keeps that sign."""
    signs = np.sign(steering)
    commanded = np.flatnonzero(signs)
    if not commanded.size:
        return 0.0, slice(0, 0)
    first = int(commanded[0])
    last = first + int(np.argmax(np.append(signs[first:], 0.0) != signs[first]))
    return float(signs[first]), slice(first, last + 1)


def _held(time: Floats, steps: Floats, jumps: NDArray[np.intp], noise: float) -> NDArray[np.bool_]:
    """Which ``jumps`` (M,), numbers of ``steps``, are those of an angle that a slow bus holds: there are steps at an even
    pace, and a jump is as large as a joint that is not too fast makes it, and no spike, which is soon undone."""
    large = np.flatnonzero(np.abs(steps) > noise)
    pace = np.diff(time[large])
    alike = steps[large[1:]] * steps[large[:-1]] > 0.0
    even = pace[(pace > 1.5 * np.median(np.diff(time))) & (pace <= HELD) & alike]
    if len(even) < HELD_STEPS:
        return np.zeros(len(jumps), dtype=bool)
    period = float(np.median(even))
    turned = np.where(alike, np.inf, pace)  # time until, and since, a step goes the other way
    apart = np.minimum(np.append(turned, np.inf), np.append(np.inf, turned))[np.searchsorted(large, jumps)]
    return (apart > 0.7 * period) & (np.abs(steps[jumps]) <= FASTEST * 1.5 * period + noise)


def _quantised(values: Floats) -> bool:
    """Whether what changes at rest is hardly more than the steps of the signal's resolution."""
    levels = np.unique(values)
    return len(levels) < 2 or float(np.ptp(levels)) <= QUANTISED * float(np.min(np.diff(levels)))


def _longest_run(values: Floats) -> tuple[int, int]:
    """Length of the longest run of equal values, and where it begins."""
    edges = np.flatnonzero(np.diff(values, prepend=np.nan, append=np.nan))
    lengths = np.diff(edges)
    longest = int(np.argmax(lengths))
    return int(lengths[longest]), int(edges[longest])
