"""Many runs of many plants: stepped in chunks, logged by their sensors."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from aoro_gym.diagnosis_benchmark.plants.constants import constants_of
from aoro_gym.diagnosis_benchmark.plants.effects import with_effects
from aoro_gym.diagnosis_benchmark.plants.plant import CHANNELS, EVERY_ANGLE, MAIN_STEP, Plant, simulate
from aoro_gym.diagnosis_benchmark.plants.records import Array
from aoro_gym.diagnosis_benchmark.plants.sensors import RATE, SensorNoise, measured
from aoro_gym.machine.machine_file import Parameter

TICK = 0.01
"""Interval [s] over which commands are held."""

HELD = round(TICK / MAIN_STEP)
"""Main steps a tick."""

CHUNK = 1000
"""Runs stepped together on a CPU, which bounds memory."""
DEVICE_CHUNK = 30_000
"""The same on a GPU."""


@dataclass(frozen=True, eq=False)
class Run:
    """One log to be made.

    Attributes:
        machine: Entries by key, as a machine file holds them.
        steering: Signal at every tick of 10 ms (K,), positive left, held until the next; at rest in the first.
        level: Which laws.
        effects: ΔQ by effect.
        drive: Drive signal, as ``steering``; None stands still.
        joint_angle: [rad] at rest.
        seed: Of the sensors' noise.
        noise: What the sensors add.
    """

    machine: Mapping[str, Parameter]
    steering: Array
    level: int = 0
    effects: Mapping[str, ArrayLike] = field(default_factory=dict)
    drive: Array | None = None
    joint_angle: float = 0.0
    seed: int = 0
    noise: SensorNoise | None = None

    def __post_init__(self) -> None:
        for name, signal in (("steering", self.steering), ("drive", self.drive)):
            if signal is None:
                continue
            if np.ndim(signal) != 1 or len(signal) != len(self.steering) or len(signal) < 2:
                raise ValueError(f"{name} has shape {np.shape(signal)}, but must be (K,) with the same K ≥ 2 for all")
            if not np.all(np.abs(signal) <= 1.0):
                raise ValueError(f"{name} reaches {np.max(np.abs(signal)):g}, but must be in [-1, 1]")


@dataclass(frozen=True, eq=False)
class Recorded:
    """What a run's logger wrote, SI, at ticks of 10 ms: each (K + 1,)."""

    time: Array
    steering: Array
    drive: Array
    channels: dict[str, Array]


def record(
    runs: Sequence[Run],
    *,
    chunk: int | None = None,
    device: str = "cpu",
    threads: int | None = None,
    progress: Callable[[int], Any] | None = None,
) -> list[Recorded]:
    """Simulate and log ``runs``, in their order.

    Args:
        runs: What to do.
        chunk: Runs stepped together, which bounds memory; :data:`CHUNK` or :data:`DEVICE_CHUNK` by default.
        device: ``"cpu"`` or ``"cuda:N"``.
        threads: CPU threads that share the stepping; as many as there are cores by default.
        progress: Called with the number of ticks of runs that have been done since the last call.
    """
    if chunk is None:
        chunk = CHUNK if device == "cpu" else DEVICE_CHUNK
    if chunk < 1:
        raise ValueError(f"chunk is {chunk}, but must be a positive integer")
    # alike and nearly as long side by side: a GPU's neighbours wait for each other
    order = sorted(range(len(runs)), key=lambda i: (runs[i].level, sorted(runs[i].effects), len(runs[i].steering)))
    result: dict[int, Recorded] = {}
    for first in range(0, len(order), chunk):
        members = order[first : first + chunk]
        logs = _record([runs[i] for i in members], device, threads, progress)
        result |= zip(members, logs, strict=True)
    return [result[index] for index in range(len(runs))]


def _record(
    runs: Sequence[Run], device: str, threads: int | None, progress: Callable[[int], Any] | None
) -> Iterator[Recorded]:
    """Logs of ``runs``, which are sorted by level."""
    levels = [(level, list(group)) for level, group in groupby(runs, key=lambda run: run.level)]
    constants = [_constants(group, level) for level, group in levels]
    plants = [
        Plant(values, level, joint_angle=np.array([run.joint_angle for run in group]))
        for values, (level, group) in zip(constants, levels, strict=True)
    ]
    lengths = np.array([len(run.steering) for run in runs])
    commands = {"steering_signal": np.zeros((lengths.max(), len(runs)))}
    commands["drive_signal"] = np.zeros_like(commands["steering_signal"])
    for index, run in enumerate(runs):
        commands["steering_signal"][: len(run.steering), index] = run.steering
        if run.drive is not None:
            commands["drive_signal"][: len(run.steering), index] = run.drive
    done = 0

    def tell(steps: int) -> None:
        nonlocal done
        if progress is not None:
            before, done = done, steps // HELD
            progress(int(np.sum(np.minimum(lengths, done) - np.minimum(lengths, before))))

    outputs = simulate(
        Plant.joined(plants),
        commands,
        steps=HELD * lengths,
        hold=HELD,
        keep_every=HELD,
        channels=(*CHANNELS, "engine_angle"),
        device=device,
        threads=threads,
        progress=tell,
    )
    outputs["joint_angle"] = outputs.pop(EVERY_ANGLE)
    first = 0
    for values, (level, group) in zip(constants, levels, strict=True):
        yield from _logs(group, level, values, {name: o[:, first : first + len(group)] for name, o in outputs.items()})
        first += len(group)


def _constants(runs: Sequence[Run], level: int) -> dict[str, Array]:
    """Constants (R,) of the plants of ``runs``, with their effects."""
    magnitudes: dict[str, Array] = {}
    for name in sorted({name for run in runs for name in run.effects}):
        none = next(
            np.zeros_like(np.asarray(run.effects[name], dtype=np.float64)) for run in runs if name in run.effects
        )
        each = [np.asarray(run.effects.get(name, none), dtype=np.float64) for run in runs]
        magnitudes[name] = np.stack(each, axis=-1)
    return with_effects(constants_of([run.machine for run in runs]), magnitudes, level)


def _logs(
    runs: Sequence[Run], level: int, constants: Mapping[str, Array], outputs: Mapping[str, Array]
) -> list[Recorded]:
    """What the sensors of ``runs`` of one level log of the ``outputs`` (F, R)."""
    logs: dict[int, Recorded] = {}
    for noise in {id(run.noise): run.noise for run in runs}.values():
        members = [i for i, run in enumerate(runs) if run.noise is noise]
        channels = measured(
            {name: values[:, members] for name, values in outputs.items()},
            {key: value[members] for key, value in constants.items()},
            level,
            [runs[i].seed for i in members],
            noise,
            [len(runs[i].steering) + 1 for i in members],
        )
        for place, index in enumerate(members):
            run = runs[index]
            length = len(run.steering) + 1
            steering, drive = (
                np.zeros(length) if s is None else np.append(s, s[-1]) for s in (run.steering, run.drive)
            )
            shown = {name: values[:length, place].copy() for name, values in channels.items()}
            logs[index] = Recorded(np.arange(length) / RATE, steering, drive, shown)
    return [logs[index] for index in range(len(runs))]
