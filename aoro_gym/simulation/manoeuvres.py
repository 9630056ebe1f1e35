"""Manoeuvres: what a machine is told to do, and the recording of what its twin then does.

A manoeuvre is a starting angle and a list of commands, each held for a while: the standing turns and the straight
drive that every validation uses, or any sequence read from a file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.checks import check_range
from aoro_gym.machine.vehicle_crane import moments_of_log
from aoro_gym.recording.command_files import read_commands
from aoro_gym.recording.commands import ALL_COMMAND_BOUNDS, CRANE_COMMAND_BOUNDS
from aoro_gym.simulation.log import RATE
from aoro_gym.twin.records import CHANNELS, RUTS_FULL

if TYPE_CHECKING:
    from aoro_gym.twin import Twin

STANDSTILL = 0.6
"""Rest [s] before a signal step: filtering the angle needs at least 0.5 s of it on both sides of a turn."""
SETTLE = 0.7
"""Rest [s] kept after a turn has reached its stop."""
SHORTEST, LONGEST = 1.0 / RATE, 3600.0
"""Shortest and longest manoeuvre [s]: one sample of a log, and an hour."""
TURN_LIMIT = 60.0
"""Longest wait [s] for a turn to reach its stop, where no duration is asked for."""
CHUNK = 0.1
"""Simulated time [s] between two reports of progress."""


@dataclass(frozen=True)
class Segment:
    """Commands that hold from one main step to another; a command that is not named keeps its last value."""

    steps: int
    commands: Mapping[str, float]


@dataclass(frozen=True)
class Manoeuvre:
    """A starting angle and the commands that follow."""

    name: str
    title: str
    start_angle: float
    """Joint angle [rad] at rest."""
    segments: tuple[Segment, ...]
    main_step: float = 1e-3
    turn: int = 0
    """+1: a full turn to the left stop, -1: to the right one, 0: neither."""
    step_time: float = 0.0
    """Time [s] of the signal's step."""
    stop_angle: float | None = None
    """Joint angle [rad] at which the manoeuvre may end early, after a rest of :data:`SETTLE`."""
    signal_percent: float | None = None
    crane_pose: tuple[float, float, float, float] | None = None
    """Joints [rad, rad, rad, m] from which a crane begins; None: its transport pose."""
    unread: tuple[str, ...] = ()
    """Columns of the file that the commands came from which were not read."""

    @property
    def moves_crane(self) -> bool:
        """Whether it commands what only machines with a crane have."""
        return any(not CRANE_COMMAND_BOUNDS.keys().isdisjoint(segment.commands) for segment in self.segments)

    @property
    def duration(self) -> float:
        """Longest simulated time [s]."""
        return sum(segment.steps for segment in self.segments) * self.main_step


@dataclass
class Trajectory(Mapping[str, NDArray[np.float64]]):
    """What one twin did: ``time`` (F,) [s] and, by name, its outputs (F,) in SI units and the manoeuvre's commands."""

    manoeuvre: Manoeuvre
    time: NDArray[np.float64]
    channels: dict[str, NDArray[np.float64]] = field(default_factory=dict)

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        return self.channels[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.channels)

    def __len__(self) -> int:
        return len(self.channels)


class SimulationDiverged(RuntimeError):
    """The state of a twin is no longer finite, or it lacks room for its ruts."""


def standing_turn(
    direction: int, signal: float, joint_range: float, *, duration: float | None = None, main_step: float = 1e-3
) -> Manoeuvre:
    """Full turn from the opposite stop at standstill.

    Args:
        direction: +1 left, -1 right.
        signal: Share (0, 1] of the full steering signal.
        joint_range: Joint angle [rad] of the stops.
        duration: Simulated time [s] with the rest before the step; by default until :data:`SETTLE` after the stop.
        main_step: Main time step [s].
    """
    name = "left" if direction > 0 else "right"
    check_range("--signal", 100 * signal, "%", gt=0.0, le=100.0)
    total = TURN_LIMIT if duration is None else _checked_duration(duration, longer_than=STANDSTILL)
    return Manoeuvre(
        name=name,
        title=f"Full turn {name}, {100 * signal:g} % signal",
        start_angle=-direction * joint_range,
        segments=_step("steering_signal", direction * signal, total, main_step),
        main_step=main_step,
        turn=direction,
        step_time=STANDSTILL,
        stop_angle=direction * joint_range if duration is None else None,
        signal_percent=100 * signal,
    )


def straight_drive(signal: float, *, duration: float | None = None, main_step: float = 1e-3) -> Manoeuvre:
    """Drive straight on from standstill: a step of the drive signal to ``signal`` in [-1, 1], for ``duration`` [s]."""
    check_range("--signal", 100 * signal, "%", ge=-100.0, le=100.0)
    total = 6.0 if duration is None else _checked_duration(duration, longer_than=STANDSTILL)
    return Manoeuvre(
        name="drive",
        title=f"Straight drive, {100 * signal:g} % signal",
        start_angle=0.0,
        segments=_step("drive_signal", signal, total, main_step),
        main_step=main_step,
        step_time=STANDSTILL,
        signal_percent=100 * signal,
    )


CRANE_STEPS: tuple[tuple[float, dict[str, float]], ...] = (
    # time [s], and sections as shares of the signal
    (1.0, {"crane_lift": 1.0}),
    (2.0, {"crane_lift": 0.0, "crane_fold": 1.0}),
    (2.0, {"crane_fold": 0.0, "crane_slew": 1.0}),
    (2.0, {"crane_slew": 0.0, "crane_telescope": 1.0}),
    (2.0, {"crane_lift": 0.5, "crane_fold": 1.0, "crane_slew": 1.0, "crane_telescope": -1.0}),
    (2.0, dict.fromkeys(("crane_lift", "crane_fold", "crane_slew", "crane_telescope"), 0.0)),
)
"""Of :func:`crane_work`: a section after the other, then all at once, which ask for more than the pump has, then rest."""
CRANE_POSE = (0.0, math.radians(35.0), math.radians(-100.0), 0.0)
"""Joints [rad, rad, rad, m] from which it begins, the grapple a metre over the ground ahead of the machine."""


def crane_work(signal: float, *, main_step: float = 1e-3) -> Manoeuvre:
    """Move the crane of the standing machine, its sections at the share ``signal`` in (0, 1]; see :data:`CRANE_STEPS`."""
    check_range("--signal", 100 * signal, "%", gt=0.0, le=100.0)
    rest = {"parking_brake": 1.0, **{name: 0.0 for _, shares in CRANE_STEPS for name in shares}}
    segments = [Segment(round(STANDSTILL / main_step), rest)]
    for seconds, shares in CRANE_STEPS:
        told = {name: signal * share for name, share in shares.items()}
        segments.append(Segment(round(seconds / main_step), told))
    return Manoeuvre(
        name="crane",
        title=f"Work of the crane, {100 * signal:g} % signal",
        start_angle=0.0,
        segments=tuple(segments),
        main_step=main_step,
        step_time=STANDSTILL,
        signal_percent=100 * signal,
        crane_pose=CRANE_POSE,
    )


def holding(manoeuvre: Manoeuvre, mass: float, length: float, diameter: float) -> Manoeuvre:
    """The ``manoeuvre`` with a log in the crane's grapple from the start on, along the machine, until it is told otherwise.

    Args:
        manoeuvre: What to do.
        mass: [kg]
        length: [m]
        diameter: [m]

    Raises ValueError where a number is out of its bounds, or the manoeuvre says what the grapple holds itself.
    """
    for name, value, unit in (("MASS", mass, "kg"), ("LENGTH", length, "m"), ("DIAMETER", diameter, "m")):
        check_range(f"--held {name}", value, unit, gt=0.0)
    high = CRANE_COMMAND_BOUNDS["crane_held_mass"][1]
    check_range("--held MASS", mass, "kg", le=high)
    axial, across = (float(moment) for moment in moments_of_log(mass, length, diameter))
    held = {"crane_held_mass": mass, "crane_held_axial": axial, "crane_held_transverse": across}
    first = manoeuvre.segments[0]
    if told := [name for name in held if name in first.commands]:
        raise ValueError(
            f"--held says what the grapple holds, but so does {told[0]} of {manoeuvre.name}; drop one of them (a table has "
            "the size of its log by the columns crane_held_axial_kg_m2 and crane_held_transverse_kg_m2)"
        )
    return replace(manoeuvre, segments=(replace(first, commands={**held, **first.commands}), *manoeuvre.segments[1:]))


def from_file(
    path: Path, *, start_angle: float = 0.0, duration: float | None = None, main_step: float = 1e-3
) -> Manoeuvre:
    """Commands from a table (CSV of any dialect, or Parquet) with a column of time and one a command, each row held until
    the next.

    Columns are found by quantity and unit (``steering_signal [%]``, ``time_ms``). A log can be driven again: its measured
    and ``true_*`` columns are passed over, unknown ones named (:attr:`Manoeuvre.unread`), and ``steering_signal_V``
    serves where ``steering_signal`` is missing. Before the first row every command is at rest. The manoeuvre ends with the
    last row, or after ``duration`` [s]. A clock that counts since 1970 begins with the first row.
    """
    file = read_commands(path)
    steps = np.rint(file.time / main_step).astype(np.int64)
    for index, seconds in enumerate(file.time):
        where = f"{file.table.where(index)}: {file.clock}"
        check_range(where, seconds, "s", ge=0.0, le=LONGEST, note="; let the file start at 0")
        if index and steps[index] <= steps[index - 1]:
            before = file.time[index - 1]
            raise ValueError(f"{where} is {seconds:g} s, but must follow {before:g} s by at least {main_step:g} s")
    columns = file.commands
    last = int(steps[-1]) if duration is None else round(_checked_duration(duration) / main_step)
    if last * main_step < SHORTEST:
        raise ValueError(f"{path} ends at {last * main_step:g} s, before {SHORTEST:g} s; add a row, or give --duration")
    knots = np.append(np.minimum(steps, last), last)
    segments = [Segment(int(knots[0]), {})] if knots[0] else []
    for index in range(len(steps)):
        commands = {name: float(values[index]) for name, values in columns.items()}
        length = int(knots[index + 1] - knots[index])
        if segments and segments[-1].commands == commands:
            segments[-1] = Segment(segments[-1].steps + length, commands)
        elif length:
            segments.append(Segment(length, commands))
    return Manoeuvre(
        name=path.stem,
        title=f"Commands of {path.name}",
        start_angle=start_angle,
        segments=tuple(segments),
        main_step=main_step,
        unread=file.unread,
    )


def run(
    twin: Twin,
    manoeuvre: Manoeuvre,
    *,
    start: tuple[float, float, float] = (0.0, 0.0, 0.0),
    keep_every: float = 1e-3,
    progress: Callable[[float], Any] | None = None,
) -> Trajectory:
    """Drive the first twin of ``twin`` through ``manoeuvre`` from rest.

    Args:
        twin: The twins; all receive the same commands, the first is recorded.
        manoeuvre: What to do.
        start: x, y [m] of the hinge and heading [rad] at rest.
        keep_every: Time [s] between two kept samples, a multiple of the main step.
        progress: Called with the simulated time [s] so far.

    Raises:
        SimulationDiverged: the state is no longer finite.
        ValueError: it would start in an object of its world.
    """
    main_step = manoeuvre.main_step
    chunk = max(1, round(CHUNK / main_step))
    stride = max(1, round(keep_every / main_step))
    times: list[NDArray[np.float64]] = []
    rows: dict[str, list[NDArray[np.float64]]] = {}
    rest_steps, done = 0, 0

    twin.reset(position=start[:2], heading=start[2], joint_angle=manoeuvre.start_angle)
    held = {name: initial for name, (_, _, initial) in ALL_COMMAND_BOUNDS.items()}
    told = {name for segment in manoeuvre.segments for name in segment.commands} - set(CHANNELS)
    for segment in manoeuvre.segments:
        held |= segment.commands
        left = segment.steps
        while left and rest_steps * main_step < SETTLE:
            steps = min(chunk, left)
            trace = twin.step(dict(segment.commands), duration=steps * main_step, sample_every=main_step)
            if twin.diverged:
                (index, reason), time = twin.diverged[0], (done + steps) * main_step
                if twin.status[index] == RUTS_FULL:
                    raise SimulationDiverged(f"twin {index}: simulation stopped at t = {time:.3f} s: {reason}")
                raise SimulationDiverged(f"twin {index}: simulation diverged ({reason} at t = {time:.3f} s)")
            assert trace is not None
            kept = slice((-done - 1) % stride, None, stride)
            times.append(trace.time[kept])
            for name in trace.channels:
                rows.setdefault(name, []).append(trace[name][kept, 0].astype(np.float64))
            for name in told:
                rows.setdefault(name, []).append(np.full(len(trace.time[kept]), held[name]))
            left -= steps
            done += steps
            if manoeuvre.stop_angle is not None:
                to_go = manoeuvre.turn * (manoeuvre.stop_angle - trace["joint_angle"][:, 0])
                rest_steps += int(np.count_nonzero(to_go <= math.radians(0.1)))
            if progress is not None:
                progress(done * main_step)
    channels = {name: np.concatenate(parts) for name, parts in rows.items()}
    return Trajectory(manoeuvre, np.concatenate(times), channels)


def _step(command: str, value: float, total: float, main_step: float) -> tuple[Segment, Segment]:
    rest = round(STANDSTILL / main_step)
    return Segment(rest, {command: 0.0}), Segment(round(total / main_step) - rest, {command: value})


def _checked_duration(duration: float, *, longer_than: float = 0.0) -> float:
    check_range("--duration", duration, "s", ge=longer_than + SHORTEST, le=LONGEST)
    return duration
