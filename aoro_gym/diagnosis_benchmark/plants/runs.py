"""Many runs of many plants: grouped by the laws that they need, stepped in chunks, logged by their sensors."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from aoro_gym.diagnosis_benchmark.plants.constants import constants_of
from aoro_gym.diagnosis_benchmark.plants.effects import with_effects
from aoro_gym.diagnosis_benchmark.plants.fluid import Array
from aoro_gym.diagnosis_benchmark.plants.plant import MAIN_STEP, Plant, simulate
from aoro_gym.diagnosis_benchmark.plants.sensors import SensorNoise, measured
from aoro_gym.machine.machine_file import Parameter

TICK = 0.01
"""Interval [s] over which commands are held."""

CHUNK = 500
"""Runs stepped together: 130 MB of outputs for 3 s, and arrays that stay in a core's cache."""


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


def record(runs: Sequence[Run], *, chunk: int = CHUNK, progress: Callable[[int], Any] | None = None) -> list[Recorded]:
    """Simulate and log ``runs``, in their order.

    Args:
        runs: What to do.
        chunk: Runs stepped together, which bounds memory.
        progress: Called with the number of ticks of runs that have been done since the last call.
    """
    result: list[Recorded | None] = [None] * len(runs)
    for members in _groups(runs, chunk):
        for index, log in zip(members, _record([runs[i] for i in members], progress), strict=True):
            result[index] = log
    return [log for log in result if log is not None]


def _groups(runs: Sequence[Run], chunk: int) -> Iterator[list[int]]:
    """Indices of runs that are stepped together: of one level, alike in what laws they need and nearly as long.

    Air and an elastic joint cost time: runs that have neither should not pay for those that do.
    """
    if chunk < 1:
        raise ValueError(f"chunk is {chunk}, but must be a positive integer")
    kinds: dict[tuple[int, bool, bool], list[int]] = {}
    for index, run in enumerate(runs):
        air = "entrained_air" in run.effects or float(run.machine["oil.gas_fraction"].value) > 0.0
        elastic = "joint_backlash" in run.effects or "frame_compliance" in run.effects
        kinds.setdefault((run.level, air, elastic), []).append(index)
    for kind in sorted(kinds):
        members = sorted(kinds[kind], key=lambda i: len(runs[i].steering))
        for first in range(0, len(members), chunk):
            yield members[first : first + chunk]


def _record(runs: Sequence[Run], progress: Callable[[int], Any] | None) -> list[Recorded]:
    level, count = runs[0].level, len(runs)
    ids = sorted({name for run in runs for name in run.effects})
    magnitudes: dict[str, Array] = {}
    for name in ids:
        none = next(
            np.zeros_like(np.asarray(run.effects[name], dtype=np.float64)) for run in runs if name in run.effects
        )
        each = [np.asarray(run.effects.get(name, none), dtype=np.float64) for run in runs]
        magnitudes[name] = np.stack(each, axis=-1)
    constants = with_effects(constants_of([run.machine for run in runs]), magnitudes, level)
    longest = max(len(run.steering) for run in runs)
    steering, drive = np.zeros((longest, count)), np.zeros((longest, count))
    for index, run in enumerate(runs):
        length = len(run.steering)
        steering[:length, index], steering[length:, index] = run.steering, run.steering[-1]
        if run.drive is not None:
            drive[:length, index], drive[length:, index] = run.drive, run.drive[-1]
    held = round(TICK / MAIN_STEP)
    plant = Plant(constants, level, joint_angle=np.array([run.joint_angle for run in runs]))

    def tell(steps: int) -> None:
        if progress is not None and steps % held == 0:
            progress(sum(len(run.steering) >= steps // held for run in runs))

    outputs = simulate(
        plant,
        {"steering_signal": np.repeat(steering, held, axis=0), "drive_signal": np.repeat(drive, held, axis=0)},
        progress=tell,
    )
    time = MAIN_STEP * np.arange(longest * held + 1, dtype=np.float64)
    noises = {id(run.noise): run.noise for run in runs}
    shown: list[Recorded | None] = [None] * count
    for noise in noises.values():
        members = [i for i, run in enumerate(runs) if run.noise is noise]
        ticks, channels = measured(
            time,
            {name: values[:, members] for name, values in outputs.items()},
            {key: value[members] for key, value in constants.items()},
            level,
            [runs[i].seed for i in members],
            noise,
        )
        for place, index in enumerate(members):
            run = runs[index]
            length = len(run.steering) + 1
            commands = [np.append(s, s[-1]) for s in (run.steering, np.zeros(1) if run.drive is None else run.drive)]
            shown[index] = Recorded(
                ticks[:length],
                commands[0],
                commands[1] if run.drive is not None else np.zeros(length),
                {name: values[:length, place].copy() for name, values in channels.items()},
            )
    return [log for log in shown if log is not None]
