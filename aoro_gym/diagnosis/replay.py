"""Twins that repeat recordings: variants of machines under the commands of recordings, many in one go.

A variant is a machine with effects: parameters, the plane under it, and what the measuring chain does to its signals.
"""

# pyright: reportInvalidTypeForm=false
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from aoro_gym.diagnosis.noise import Floats
from aoro_gym.diagnosis.recording import COMMANDS, TICK, Recording
from aoro_gym.effects.effect import Effect
from aoro_gym.machine import Machine
from aoro_gym.terrains.plane import Plane
from aoro_gym.twin import Twin
from aoro_gym.twin.records import Output, State

FRAMES = 5
"""Samples a tick where the measuring chain is in question: delays and filters act on these."""


class Steps(NamedTuple):
    """How finely twins are simulated."""

    main: float
    """Main step [s]."""
    substeps: int
    """Hydraulic ones within it."""


USUAL = Steps(2e-3, 30)
"""Of twins that are compared with logs, of which many run: pressures are then off by about 0.3 bar, which is of the size of
a sensor's noise and far less than the twin's own error, and what effects do to them by 1 or 2 per cent (at most 9, of worn
pins and of soft ground); by 1.4 bar in a turn of a machine such as ``aoro``, whose command is delayed by half a step more
than by whole ones. On a CPU it takes three tenths less time than main steps of 1 ms, where it is 0.1 bar; a third more
substeps change pressures by less than those do."""
FINE = Steps(1e-3, 20)
"""Of twins whose figures are compared with others'."""
COARSE = Steps(2e-3, 16)
"""Of twins that are compared with one another: what an effect does is then off by 1.3 per cent (median), and a step on such
slopes gains 95 to 99.5 per cent of what it would, in three quarters of the time."""
STILL = round(0.3 / TICK)
"""Ticks that a twin stands before its first command; on level ground it stands still until then."""
BATCH, CPU_BATCH = 32768, 1024
"""Twins a launch, on a GPU and on a CPU: there more gain nothing, and a launch that is cut short is lost."""
STRETCH = 16
"""Ticks a launch: its twins need not wait for each other at every tick."""
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

    @property
    def tilted(self) -> bool:
        """Whether its ground slopes, or an effect says how much."""
        return bool(np.any(self.plane.slope_deg)) or any(type(one).tilt is not Effect.tilt for one, _ in self.chain)

    @classmethod
    def of(cls, machine: Machine, effects: Sequence[tuple[Effect, tuple[Floats | float, ...]]], count: int) -> Variants:
        """``machine`` (one, or ``count`` variants) with ``effects`` at their magnitudes, numbers or shape (count,)."""
        plane = Plane()
        for effect, magnitudes in effects:
            machine = effect.apply(machine, *magnitudes)
            plane = effect.tilt(plane, *magnitudes)
        return cls(machine, count, plane, tuple(effects))


@dataclass(frozen=True)
class Replay:
    """Variants that repeat one recording."""

    variants: Variants
    recording: Recording
    steps: Steps = USUAL

    @property
    def still(self) -> int:
        """Ticks at its beginning that need no twin: on level ground nothing moves before the first command."""
        if self.variants.tilted:
            return 0
        moves = np.flatnonzero(np.any(self.recording.commands, axis=1))
        return max(int(moves[0]) - STILL, 0) if moves.size else 0


Signals = dict[str, NDArray[np.float32]]
"""Samples (F, N) SI a channel. A variant that diverges is NaN."""


@dataclass(frozen=True)
class Request:
    """What is to be simulated for a task: plain data."""

    machine: Machine
    plane: Plane
    start: Floats  # (N,) joint angles [rad]
    commands: NDArray[np.float64]  # (K, len(COMMANDS)), each held for a tick
    channels: tuple[str, ...]
    frames: int  # samples a tick
    steps: Steps

    @property
    def count(self) -> int:
        return len(self.start)

    @property
    def schedule(self) -> bytes:
        """Equal for two that are told to do the same."""
        return self.commands.tobytes()


@wp.kernel(enable_backward=False)
def _hold(
    schedule: wp.array3d(dtype=float),
    which: wp.array(dtype=int),
    rows: wp.array(dtype=int),
    first_tick: int,
    commands: wp.array3d(dtype=float),
):
    """Commands of a stretch: schedule (recordings, ticks, rows) to twins, each by the number of its recording."""
    tick, row, t = wp.tid()  # pyright: ignore
    commands[tick, rows[row], t] = schedule[which[t], first_tick + tick, row]


@wp.kernel(enable_backward=False)
def _keep(
    outputs: wp.array3d(dtype=float),
    rows: wp.array(dtype=int),
    every: int,
    first_twin: int,
    first: int,
    kept: wp.array3d(dtype=float),
):
    """Each ``every``-th sample of a stretch, of the twins from ``first_twin`` on."""
    frame, row, t = wp.tid()  # pyright: ignore
    kept[row, first + frame, t] = outputs[(frame + 1) * every - 1, rows[row], first_twin + t]


class Simulator:
    """Repeats recordings on a device.

    Args:
        device: ``"cpu"`` or ``"cuda:N"``.
    """

    def __init__(self, device: str = "cpu"):
        self.device = device

    def run(self, tasks: Sequence[Replay]) -> list[Signals]:
        """What the channels of every task's recording would be."""
        groups: dict[tuple[int, int, Steps, int], list[int]] = {}
        for index, task in enumerate(tasks):
            groups.setdefault((id(task.recording), task.variants.frames, task.steps, task.still), []).append(index)
        alike: dict[tuple[int, ...], tuple[Machine, Plane]] = {}
        requests = []
        for (_, frames, steps, still), mine in groups.items():
            variants = [tasks[index].variants for index in mine]
            same = tuple(map(id, variants))
            if same not in alike:
                alike[same] = _stacked(variants), _stacked_planes(variants)
            recording = tasks[mine[0]].recording
            start = np.concatenate([_started(one, recording.start_angle) for one in variants])
            channels = tuple(recording.channels)
            requests.append(Request(*alike[same], start, recording.commands[still:], channels, frames, steps))
        out: list[Signals] = [{} for _ in tasks]
        for ((_, frames, _, still), mine), rows in zip(groups.items(), self.launch(requests), strict=True):
            if still:
                rows = {name: np.pad(values, ((still * frames, 0), (0, 0)), "edge") for name, values in rows.items()}
            ends = np.cumsum([0, *(tasks[index].variants.count for index in mine)])
            for index, begin, end in zip(mine, ends, ends[1:], strict=False):
                own = {name: values[:, begin:end].copy() for name, values in rows.items()}
                out[index] = _measured(tasks[index], own)
        return out

    def launch(self, requests: Sequence[Request]) -> list[Signals]:
        """Samples (K frames + 1, N) of every request, the first of them at rest."""
        out: list[Signals] = [{} for _ in requests]
        for batch in self._batches(requests):
            for index, rows in zip(batch, _launched([requests[i] for i in batch], self.device), strict=True):
                out[index] = rows
        return out

    def _batches(self, requests: Sequence[Request]) -> list[list[int]]:
        """Numbers of the requests that are launched together."""
        # what needs dense samples lies together at the end of a launch, and what runs longest in its middle: the others
        # stand still at the ends
        order = sorted(
            range(len(requests)),
            key=lambda i: (
                requests[i].steps,
                requests[i].frames,
                len(requests[i].commands) * (1 if requests[i].frames == 1 else -1),
            ),
        )
        cpu = wp.get_device(self.device).is_cpu
        most = CPU_BATCH if cpu else BATCH
        batches: list[list[int]] = [[]]
        for index in order:
            new, batch = requests[index], batches[-1]
            if batch:
                first = requests[batch[0]]
                shorter, longer = sorted((len(first.commands), len(new.commands)))
                unlike = new.frames != first.frames or shorter < ALIKE * longer
                apart = new.steps != first.steps
                if sum(requests[i].count for i in batch) + new.count > most or (cpu and unlike) or apart:
                    batches.append([])
            batches[-1].append(index)
        return batches


def _launched(requests: Sequence[Request], device: str) -> list[Signals]:
    """Samples (K frames + 1, N) of requests with the same steps, in one launch; those with dense samples come last."""
    counts = [request.count for request in requests]
    starts = np.cumsum([0, *counts])
    total, ticks = int(starts[-1]), max(len(request.commands) for request in requests)
    machine = _stacked(requests)
    main, substeps = requests[0].steps
    of = {"device": device, "main_step": main, "substeps": substeps}
    twin = Twin(total, machine=machine, terrain=_stacked_planes(requests), check_step=False, **of)
    limit = np.broadcast_to(np.asarray(machine.joint.range), total)
    twin.reset(joint_angle=np.clip(np.concatenate([request.start for request in requests]), -limit, limit))

    begins = range(0, ticks, STRETCH)
    schedules: dict[bytes, int] = {}
    which = [schedules.setdefault(request.schedule, len(schedules)) for request in requests]
    held = np.zeros((len(schedules), len(begins) * STRETCH, len(COMMANDS)), dtype=np.float32)
    for number, request in zip(which, requests, strict=True):
        held[number, : len(request.commands)] = request.commands
        held[number, len(request.commands) :] = request.commands[-1]
    names = [name for name in SIGNALS if any(name in request.channels for request in requests)]
    schedule = wp.array(held, dtype=float, device=twin.device)
    numbered = wp.array(np.repeat(which, counts).astype(np.int32), dtype=int, device=twin.device)
    command_rows = wp.array([int(row) for row in COMMANDS.values()], dtype=int, device=twin.device)
    output_rows = wp.array([SIGNALS[name][0] for name in names], dtype=int, device=twin.device)

    frames = requests[-1].frames
    sparse = int(sum(request.count for request in requests if request.frames == 1))
    groups = [(1, 0, sparse), (frames, sparse, total - sparse)]  # samples a tick, first twin, twins
    kept = {
        first: wp.zeros((len(names), held.shape[1] * density + 1, count), dtype=float, device=twin.device)
        for density, first, count in groups
        if count
    }
    at_rest = wp.clone(twin.state)
    told = wp.empty((STRETCH, *twin.commands.shape), dtype=float, device=twin.device)
    for tick in range(STRETCH):  # what recordings do not command stays as it is
        part: Any = told[tick]
        wp.copy(part, twin.commands)
    # recorded launches: on a GPU, packing their arguments anew takes longer than a tick of the twins
    arguments = [schedule, numbered, command_rows, 0, told]
    dim = (STRETCH, len(COMMANDS), total)
    hold: Any = wp.launch(_hold, dim, arguments, device=twin.device, record_cmd=True)
    advance = twin.advancing(STRETCH * TICK, sample_every=TICK / frames, commands=told)
    keeps = []
    for density, first, count in groups:
        if count:
            arguments = [twin.outputs, output_rows, frames // density, first, 0, kept[first]]
            dim = (STRETCH * density, len(names), count)
            keeps.append((density, wp.launch(_keep, dim, arguments, device=twin.device, record_cmd=True)))
    for tick, (begin, end) in zip(begins, _running(requests, begins), strict=True):
        hold.set_param_at_index(3, tick)
        hold.launch()
        advance(begin, end)
        for density, keep in keeps:
            keep.set_param_at_index(4, 1 + tick * density)
            keep.launch()
    diverged = twin.status_codes.numpy() != 0
    start = at_rest.numpy()[[SIGNALS[name][1] for name in names]]
    values: dict[int, Any] = {first: part.numpy() for first, part in kept.items()}
    for first, part in values.items():
        mine = slice(first, first + part.shape[2])
        part[:, 0] = start[:, mine]
        part[:, :, diverged[mine]] = np.nan
    out: list[Signals] = []
    for request, begin, end in zip(requests, starts, starts[1:], strict=False):
        first, samples = (0 if request.frames == 1 else sparse), len(request.commands) * request.frames + 1
        own: Signals = {
            name: values[first][names.index(name), :samples, begin - first : end - first] for name in request.channels
        }
        out.append(own)
    return out


def _running(requests: Sequence[Request], begins: Sequence[int]) -> list[tuple[int, int]]:
    """At each of some ticks: the first twin whose recording has not ended, and what comes after the last such."""
    ends = np.cumsum([request.count for request in requests])
    lengths = np.array([len(request.commands) for request in requests])
    runs = lengths > np.array(begins)[:, None]
    first, last = runs.argmax(axis=1), len(requests) - 1 - runs[:, ::-1].argmax(axis=1)
    starts = ends - [request.count for request in requests]
    return list(zip(starts[first].tolist(), ends[last].tolist(), strict=True))


def _measured(task: Replay, rows: Signals) -> Signals:
    """A task's channels from its samples, through the variants' measuring chain."""
    dense = task.variants.frames
    if dense == 1:
        return rows
    signals: Mapping[str, NDArray[Any]] = rows
    for effect, magnitudes in task.variants.chain:
        signals = effect.record(signals, FRAMES / TICK, *magnitudes)
    return {name: np.array(signals[name][::dense], dtype=np.float32) for name in rows}


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


def _stacked(parts: Sequence[Variants | Request]) -> Machine:
    """One machine whose variants are those of all ``parts`` one after the other."""
    first = parts[0].machine
    if len(parts) == 1:
        return first
    return Machine.stacked([part.machine for part in parts], [part.count for part in parts])


_PLANE = ("slope_deg", "direction_deg", "friction", "rolling_resistance")


def _stacked_planes(parts: Sequence[Variants | Request]) -> Plane:
    def whole(name: str) -> Floats | float:
        values = np.concatenate([np.broadcast_to(getattr(part.plane, name), part.count) for part in parts])
        return values if np.ptp(values) > 0.0 else float(values[0])

    return Plane(**{name: whole(name) for name in _PLANE})
