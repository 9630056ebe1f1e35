"""Twins that repeat recordings: variants of machines under the commands of recordings, many in one go.

A variant is a machine with effects: parameters, the plane under it, and what the measuring chain does to its signals.
Threads that each diagnose a case share their launches (:class:`Shared`): a GPU takes as long for one twin as for thousands.
"""

# pyright: reportInvalidTypeForm=false
from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
import warp as wp
from numpy.typing import NDArray

from aoro_gym.diagnosis.noise import Floats
from aoro_gym.diagnosis.recording import COMMANDS, TICK, Recording
from aoro_gym.terrains.plane import Plane
from aoro_gym.twin import Machine, Twin
from aoro_gym.twin.effects import Effect
from aoro_gym.twin.records import Output, State

FRAMES = 5
"""Samples a tick where the measuring chain is in question: delays and filters act on these."""
BATCH = 32768
"""Twins a launch."""
START_STEPS = 6
"""Steps to the start angle behind a measuring chain; an error of 5 % leaves 2e-8 of the angle."""
ALIKE = 0.8
"""On a CPU recordings are repeated together if none is shorter than this share of the longest."""

SIGNALS: Mapping[str, tuple[int, int]] = {
    "joint_angle": (int(Output.JOINT_ANGLE), int(State.JOINT)),
    "pressure_a": (int(Output.PRESSURE_A), int(State.PORT_A)),
    "pressure_b": (int(Output.PRESSURE_B), int(State.PORT_B)),
    "pump_pressure": (int(Output.PUMP_PRESSURE), int(State.SUPPLY)),
    "drive_pressure_forward": (int(Output.DRIVE_PRESSURE_FORWARD), int(State.FORWARD)),
    "drive_pressure_return": (int(Output.DRIVE_PRESSURE_RETURN), int(State.BACK)),
    "engine_speed": (int(Output.ENGINE_SPEED), int(State.ENGINE_SPEED)),
}
"""Signals that can be compared: row of the twin's outputs, and of its state, which shows them at the start."""


@dataclass(frozen=True)
class Variants:
    """N machines to be tried: ``machine`` with N variants (or one, N times), its ground and its measuring chain."""

    machine: Machine
    count: int = 1
    plane: Plane = field(default_factory=Plane)
    chain: tuple[tuple[Effect, tuple[Floats | float, ...]], ...] = ()

    @property
    def frames(self) -> int:
        """Samples a tick that its measuring chain needs."""
        return FRAMES if any(type(effect).record is not Effect.record for effect, _ in self.chain) else 1

    @classmethod
    def of(cls, machine: Machine, effects: Sequence[tuple[Effect, tuple[Floats | float, ...]]], count: int) -> Variants:
        """``machine`` (one, or ``count`` variants) with ``effects`` at their magnitudes, numbers or shape (count,)."""
        plane = Plane()
        for effect, magnitudes in effects:
            machine = effect.apply(machine, *magnitudes)
            plane = effect.tilt(plane, *magnitudes)
        return cls(machine, count, plane, tuple(effects))


@dataclass(frozen=True)
class Task:
    """Variants that repeat one recording."""

    variants: Variants
    recording: Recording


Signals = dict[str, NDArray[np.float32]]
"""What a recording's channels would be: (F, N) SI a channel. A variant that the twin loses is NaN."""


@wp.kernel(enable_backward=False)
def _hold(
    schedule: wp.array3d(dtype=float),
    which: wp.array(dtype=int),
    rows: wp.array(dtype=int),
    tick: int,
    commands: wp.array2d(dtype=float),
):
    """Commands of one tick: schedule (recordings, ticks, rows) to twins, each by the number of its recording."""
    row, t = wp.tid()  # pyright: ignore
    commands[rows[row], t] = schedule[which[t], tick, row]


@wp.kernel(enable_backward=False)
def _keep(outputs: wp.array3d(dtype=float), rows: wp.array(dtype=int), first: int, kept: wp.array3d(dtype=float)):
    frame, row, t = wp.tid()  # pyright: ignore
    kept[row, first + frame, t] = outputs[frame, rows[row], t]


def repeat(tasks: Sequence[Task], *, device: str = "cpu") -> list[Signals]:
    """What the channels of every task's recording would be."""
    pieces = [
        (number, Task(piece, task.recording))
        for number, task in enumerate(tasks)
        for piece in _split(task.variants, BATCH)
    ]
    pieces.sort(key=lambda piece: (piece[1].variants.frames, -piece[1].recording.ticks))
    cpu = wp.get_device(device).is_cpu
    launches: list[list[tuple[int, Task]]] = [[]]
    for number, task in pieces:
        launch = launches[-1]
        if launch:
            first = launch[0][1]
            together = (
                sum(other.variants.count for _, other in launch) + task.variants.count <= BATCH
                and task.variants.frames == first.variants.frames
                and not (cpu and task.recording.ticks < ALIKE * first.recording.ticks)
            )
            if not together:
                launches.append([])
        launches[-1].append((number, task))
    parts: list[list[Signals]] = [[] for _ in tasks]
    for launch in launches:
        for (number, _), found in zip(launch, _launch([task for _, task in launch], device), strict=True):
            parts[number].append(found)
    return [
        {name: np.concatenate([piece[name] for piece in part], axis=1) for name in task.recording.channels}
        for task, part in zip(tasks, parts, strict=True)
    ]


def _launch(tasks: Sequence[Task], device: str) -> list[Signals]:
    """Tasks alike in the samples that they need, all at once."""
    counts = [task.variants.count for task in tasks]
    total, ticks = sum(counts), max(task.recording.ticks for task in tasks)
    dense = tasks[0].variants.frames
    machine = _stacked([task.variants.machine for task in tasks], counts)
    twin = Twin(total, machine=machine, terrain=_stacked_planes(tasks, counts), device=device)
    start = np.concatenate([_started(task.variants, task.recording.start_angle) for task in tasks])
    limit = np.broadcast_to(np.asarray(machine.joint.range), total)
    twin.reset(joint_angle=np.clip(start, -limit, limit))

    recordings = list({id(task.recording): task.recording for task in tasks}.values())
    numbers = {id(recording): number for number, recording in enumerate(recordings)}
    held = np.zeros((len(recordings), ticks, len(COMMANDS)), dtype=np.float32)
    for row, recording in zip(held, recordings, strict=True):
        row[: recording.ticks] = recording.commands
        row[recording.ticks :] = recording.commands[-1]
    names = [name for name in SIGNALS if any(name in recording.channels for recording in recordings)]
    schedule = wp.array(held, dtype=float, device=twin.device)
    which = np.repeat([numbers[id(task.recording)] for task in tasks], counts).astype(np.int32)
    numbered = wp.array(which, dtype=int, device=twin.device)
    command_rows = wp.array([int(row) for row in COMMANDS.values()], dtype=int, device=twin.device)
    output_rows = wp.array([SIGNALS[name][0] for name in names], dtype=int, device=twin.device)
    kept = wp.zeros((len(names), ticks * dense + 1, total), dtype=float, device=twin.device)
    at_rest = twin.state.numpy()[[SIGNALS[name][1] for name in names]]
    for tick in range(ticks):
        arguments = [schedule, numbered, command_rows, tick, twin.commands]
        wp.launch(_hold, (len(COMMANDS), total), arguments, device=twin.device)
        twin.advance(TICK, sample_every=TICK / dense)
        wp.launch(_keep, (dense, len(names), total), [twin.outputs, output_rows, 1 + tick * dense, kept], device=twin.device)
    values: NDArray[np.float32] = np.array(kept.numpy(), dtype=np.float32)
    values[:, 0] = at_rest
    values[:, :, twin.status != 0] = np.nan
    rows = dict(zip(names, values, strict=True))
    starts = np.cumsum([0, *counts])
    return [
        _measured(task, {name: rows[name][:, first : first + count] for name in task.recording.channels}, dense)
        for task, first, count in zip(tasks, starts, counts, strict=False)
    ]


def _measured(task: Task, rows: Signals, dense: int) -> Signals:
    """A task's channels from its samples (F, N), through the variants' measuring chain."""
    rows = {name: row[: task.recording.ticks * dense + 1] for name, row in rows.items()}
    signals: Mapping[str, NDArray[np.float32]] = rows
    if dense > 1:
        for effect, magnitudes in task.variants.chain:
            signals = effect.record(signals, FRAMES / TICK, *magnitudes)
    return {name: np.array(signals[name][::dense], dtype=np.float32) for name in rows}


class Shared:
    """Launches that several threads share: each waits in :meth:`run` until all that take part have asked for theirs."""

    def __init__(self, device: str):
        self.device = device
        self._condition = threading.Condition()
        self._waiting: list[_Asked] = []
        self._members = 0

    @contextmanager
    def member(self) -> Iterator[None]:
        """Take part: others wait for what this thread asks for, until it leaves."""
        with self._condition:
            self._members += 1
        try:
            yield
        finally:
            with self._condition:
                self._members -= 1
                self._launch_if_all_wait()

    def run(self, tasks: Sequence[Task]) -> list[Signals]:
        """See :func:`repeat`."""
        asked = _Asked(tasks)
        with self._condition:
            self._waiting.append(asked)
            self._launch_if_all_wait()
            self._condition.wait_for(lambda: asked.done)
        if asked.error is not None:
            raise asked.error
        return asked.found

    def _launch_if_all_wait(self) -> None:
        if not self._waiting or len(self._waiting) < self._members:
            return
        waiting, self._waiting = self._waiting, []
        try:
            found = repeat([task for asked in waiting for task in asked.tasks], device=self.device)
            for asked in waiting:
                asked.found, found = found[: len(asked.tasks)], found[len(asked.tasks) :]
        except Exception as error:
            for asked in waiting:
                asked.error = error
        for asked in waiting:
            asked.done = True
        self._condition.notify_all()


@dataclass(eq=False)
class _Asked:
    tasks: Sequence[Task]
    found: list[Signals] = field(default_factory=list)
    error: Exception | None = None
    done: bool = False


def _started(variants: Variants, measured: float) -> Floats:
    """Joint angles (N,) that the measuring chain shows as ``measured`` at rest: the fixed point of an error that is small
    beside the angle."""
    angle = np.full(variants.count, measured)
    for _ in range(START_STEPS if variants.frames > 1 else 0):
        signals = {"joint_angle": np.stack([angle, angle])}
        for effect, magnitudes in variants.chain:
            signals = effect.record(signals, FRAMES / TICK, *magnitudes)
        angle = angle + measured - np.asarray(signals["joint_angle"])[0]
    return angle


def _split(one: Variants, most: int) -> list[Variants]:
    """``one`` in pieces of at most ``most`` variants."""
    if one.count <= most:
        return [one]
    pieces = []
    for first in range(0, one.count, most):
        rows = np.arange(first, min(first + most, one.count))

        def chosen(value, rows=rows):
            return value if np.ndim(value) == 0 else np.asarray(value)[rows]

        batched = {key: e.value for key, e in one.machine.entries.items() if np.ndim(e.value)}
        machine = one.machine.set({key: chosen(value) for key, value in batched.items()}) if batched else one.machine
        plane = Plane(**{name: chosen(getattr(one.plane, name)) for name in _PLANE})
        chain = tuple((effect, tuple(chosen(m) for m in magnitudes)) for effect, magnitudes in one.chain)
        pieces.append(Variants(machine, len(rows), plane, chain))
    return pieces


def _stacked(machines: Sequence[Machine], counts: Sequence[int]) -> Machine:
    """One machine whose variants are those of all ``machines`` one after the other."""
    first = machines[0]
    if sum(counts) == 1:
        return first
    values = {}
    for key, entry in first.entries.items():
        column = [machine.entries[key].value for machine in machines]
        if any(np.ndim(value) for value in column) or any(value != entry.value for value in column):
            values[key] = np.concatenate([np.broadcast_to(v, n) for v, n in zip(column, counts, strict=True)])
    return first.set(values)


_PLANE = ("slope_deg", "direction_deg", "friction", "rolling_resistance")


def _stacked_planes(tasks: Sequence[Task], counts: Sequence[int]) -> Plane:
    def whole(name: str) -> Floats | float:
        parts = [np.broadcast_to(getattr(task.variants.plane, name), n) for task, n in zip(tasks, counts, strict=True)]
        values = np.concatenate(parts)
        return values if np.ptp(values) > 0.0 else float(values[0])

    return Plane(**{name: whole(name) for name in _PLANE})
