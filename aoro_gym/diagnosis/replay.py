"""Twins that repeat recordings: every variant of the machine under the commands of every recording, in one go.

A variant is a machine with effects: parameters, the plane under it, and what the measuring chain does to its signals.
"""

# pyright: reportInvalidTypeForm=false
from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
"""Samples a tick: delays and filters of the measuring chain act on these."""
BATCH = 4096
"""Twins a launch."""

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

    @classmethod
    def of(cls, machine: Machine, effects: Sequence[tuple[Effect, tuple[Floats | float, ...]]], count: int) -> Variants:
        """``machine`` (one, or ``count`` variants) with ``effects`` at their magnitudes, numbers or shape (count,)."""
        plane = Plane()
        for effect, magnitudes in effects:
            machine = effect.apply(machine, *magnitudes)
            plane = effect.tilt(plane, *magnitudes)
        return cls(machine, count, plane, tuple(effects))


@wp.kernel(enable_backward=False)
def _hold(schedule: wp.array3d(dtype=float), rows: wp.array(dtype=int), tick: int, commands: wp.array2d(dtype=float)):
    """Commands of one tick: schedule (recordings, ticks, rows) to twins, whose recordings take turns."""
    row, t = wp.tid()  # pyright: ignore
    commands[rows[row], t] = schedule[t % schedule.shape[0], tick, row]


@wp.kernel(enable_backward=False)
def _keep(outputs: wp.array3d(dtype=float), rows: wp.array(dtype=int), first: int, kept: wp.array3d(dtype=float)):
    frame, row, t = wp.tid()  # pyright: ignore
    kept[first + frame, row, t] = outputs[frame, rows[row], t]


class Replay:
    """Repeats ``recordings`` with any variants of a machine.

    Args:
        recordings: At least one.
        device: ``"cpu"`` or ``"cuda:N"``.
    """

    def __init__(self, recordings: Sequence[Recording], *, device: str = "cpu"):
        self.recordings = tuple(recordings)
        self.device = device
        self.signals = tuple(name for name in SIGNALS if any(name in r.channels for r in self.recordings))
        self.ticks = max(r.ticks for r in self.recordings)
        schedule = np.zeros((len(self.recordings), self.ticks, len(COMMANDS)), dtype=np.float32)
        for held, recording in zip(schedule, self.recordings, strict=True):
            held[: recording.ticks] = recording.commands
            held[recording.ticks :] = recording.commands[-1]
        self._schedule = schedule

    def run(
        self, variants: Sequence[Variants], progress: Callable[[float], None] = lambda share: None
    ) -> list[dict[str, NDArray[np.float32]]]:
        """What each recording's channels would be: for every recording, (F, N) SI a channel, N over all ``variants`` in
        their order. A variant that the twin loses is NaN."""
        whole = [dict.fromkeys(r.channels, None) for r in self.recordings]
        parts: list[list[dict[str, NDArray[np.float32]]]] = [[] for _ in self.recordings]
        per_batch = max(1, BATCH // len(self.recordings))
        pieces = [piece for one in variants for piece in _split(one, per_batch)]
        batches: list[list[Variants]] = [[]]
        for piece in pieces:
            if sum(p.count for p in batches[-1]) + piece.count > per_batch:
                batches.append([])
            batches[-1].append(piece)
        for done, batch in enumerate(batches):
            for found, part in zip(self._batch(batch), parts, strict=True):
                part.append(found)
            progress((done + 1) / len(batches))
        return [
            {name: np.concatenate([piece[name] for piece in part], axis=1) for name in names}
            for names, part in zip(whole, parts, strict=True)
        ]

    def _batch(self, batch: Sequence[Variants]) -> list[dict[str, NDArray[np.float32]]]:
        logs = len(self.recordings)
        count = sum(one.count for one in batch)
        machine = _stacked([one.machine for one in batch], [one.count for one in batch], logs)
        plane = _stacked_planes(batch, logs)
        twin = Twin(count * logs, machine=machine, terrain=plane, device=self.device)
        start = np.array([r.start_angle for r in self.recordings])
        limit = np.broadcast_to(np.asarray(machine.joint.range), count * logs)
        twin.reset(joint_angle=np.clip(np.tile(start, count), -limit, limit))

        device = twin.device
        schedule = wp.array(self._schedule, dtype=float, device=device)
        command_rows = wp.array([int(row) for row in COMMANDS.values()], dtype=int, device=device)
        output_rows = wp.array([SIGNALS[name][0] for name in self.signals], dtype=int, device=device)
        kept = wp.zeros((self.ticks * FRAMES + 1, len(self.signals), count * logs), dtype=float, device=device)
        at_rest = twin.state.numpy()[[SIGNALS[name][1] for name in self.signals]]
        frames = (FRAMES, len(self.signals), count * logs)
        for tick in range(self.ticks):
            wp.launch(
                _hold, (len(COMMANDS), count * logs), [schedule, command_rows, tick, twin.commands], device=device
            )
            twin.advance(TICK, sample_every=TICK / FRAMES)
            wp.launch(_keep, frames, [twin.outputs, output_rows, 1 + tick * FRAMES, kept], device=device)
        values: NDArray[np.float32] = np.asarray(kept.numpy(), dtype=np.float32)
        values[0] = at_rest
        values[:, :, twin.status != 0] = np.nan
        return [self._measured(batch, index, values[:, :, index::logs]) for index in range(logs)]

    def _measured(
        self, batch: Sequence[Variants], index: int, dense: NDArray[np.float32]
    ) -> dict[str, NDArray[np.float32]]:
        """A recording's channels from dense samples (F, S, N), through every variant's measuring chain."""
        recording = self.recordings[index]
        dense = dense[: recording.ticks * FRAMES + 1]
        out = {name: [] for name in recording.channels}
        first = 0
        for one in batch:
            signals = {
                name: dense[:, self.signals.index(name), first : first + one.count] for name in recording.channels
            }
            first += one.count
            for effect, magnitudes in one.chain:
                signals = effect.record(signals, FRAMES / TICK, *magnitudes)
            for name, part in out.items():
                part.append(np.asarray(signals[name], dtype=np.float32)[::FRAMES])
        return {name: np.concatenate(part, axis=1) for name, part in out.items()}


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


def _stacked(machines: Sequence[Machine], counts: Sequence[int], repeats: int) -> Machine:
    """One machine whose variants are those of all ``machines`` one after the other, each ``repeats`` times in a row."""
    first = machines[0]
    values = {}
    for key, entry in first.entries.items():
        column = [machine.entries[key].value for machine in machines]
        if any(np.ndim(value) for value in column) or any(value != entry.value for value in column):
            whole = np.concatenate([np.broadcast_to(v, n) for v, n in zip(column, counts, strict=True)])
            values[key] = np.repeat(whole, repeats)
    return first.set(values) if sum(counts) * repeats > 1 else first


_PLANE = ("slope_deg", "direction_deg", "friction", "rolling_resistance")


def _stacked_planes(batch: Sequence[Variants], repeats: int) -> Plane:
    def whole(name: str) -> Floats | float:
        parts = [np.broadcast_to(getattr(one.plane, name), one.count) for one in batch]
        values = np.repeat(np.concatenate(parts), repeats)
        return values if np.ptp(values) > 0.0 else float(values[0])

    return Plane(**{name: whole(name) for name in _PLANE})
