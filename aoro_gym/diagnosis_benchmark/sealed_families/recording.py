"""Runs of the sealed families, and what a logger writes of them."""

import math
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import warp as wp

from aoro_gym.diagnosis_benchmark.independent.laws.layout import SIGNALS

from . import families, measuring
from .effects import apply_all
from .measuring import GRID
from .outside import OUTSIDE

HOLD = 0.01
"""Time [s] that a command stands, and period of the logger."""
STEP = 1e-4
"""Step [s] of integration."""
SETTLE = 0.2
"""Rest [s] before a log."""
LOGGED = [SIGNALS.index(name) for name in ("angle", "exact_a", "exact_b", "exact_pump")] + [4, 5, 6]
CHUNK, DEVICE_CHUNK = 64, 2048
"""Runs stepped together on the processor and on a GPU, which bounds memory."""


@dataclass(frozen=True)
class Run:
    """One log to be made.

    Args:
        family: Name of the family of laws.
        machine: Constants, as :func:`aoro_gym.diagnosis_benchmark.sealed_families.families.machine` draws them.
        steering: Command (K,) in [−1, 1], positive to the left, each value held for 10 ms.
        effects: Signed sizes of effects by id, in the unit of each effect's magnitude.
        drive: Share (K,) of the drive pump's flow in [−1, 1], or nothing.
        joint_angle: At the start [rad].
        seed: Of the measuring noise.
        outside: Name of a deviation outside of the catalogue, or nothing.
        outside_size: Its size, 0 weak to 1 strong.
    """

    family: str
    machine: Mapping[str, float]
    steering: Any
    effects: Mapping[str, float] = field(default_factory=dict)
    drive: Any = None
    joint_angle: float = 0.0
    seed: int = 0
    outside: str | None = None
    outside_size: float = 0.5


@dataclass
class Prepared:
    """A run as the kernel takes it; ``times``: of the logger's samples."""

    machine: dict[str, float]
    command: np.ndarray
    drive: np.ndarray
    times: np.ndarray


def prepare(run: Run) -> Prepared:
    """Constants, commands on the fine grid, and sampling times of a run."""
    families.family_of(run.family)
    steering = np.asarray(run.steering, float)
    if steering.ndim != 1 or not len(steering) or not np.all(np.abs(steering) <= 1.0):
        raise ValueError("steering must be an array (K,) within [-1, 1]")
    drive = np.zeros(len(steering)) if run.drive is None else np.asarray(run.drive, float)
    if drive.shape != steering.shape or not np.all(np.abs(drive) <= 1.0):
        raise ValueError("drive must be as long as steering, within [-1, 1]")
    per = round(HOLD / GRID)
    times = np.arange(len(steering)) * HOLD
    made = apply_all(run.family, run.machine, run.effects)
    command = np.repeat(steering, per)
    if run.outside is not None:
        if run.outside not in OUTSIDE:
            raise ValueError(f"no deviation {run.outside!r}; there are {', '.join(OUTSIDE)}")
        one, rng = OUTSIDE[run.outside], np.random.default_rng([run.seed, 1])
        length = len(steering) * HOLD
        made |= one.machine(run.outside_size, rng, length) if one.machine else {}
        command = one.command(command, run.outside_size, rng) if one.command else command
        times = one.clock(times, run.outside_size, rng) if one.clock else times
    return Prepared(made, measuring.command(run.family, command, made), np.repeat(drive, per), times)


def launch(
    family: str, prepared: Sequence[Prepared], angles: Sequence[float], device: str, period: float, step: float
) -> np.ndarray:
    """Signals (runs, samples, signals) of prepared runs of one family and one length.

    Args:
        family: Of all runs.
        prepared: Runs as the kernel takes them.
        angles: Joint angles at the start [rad].
        device: Warp's name of the device.
        period: Between samples [s].
        step: Of integration [s].
    """
    count, length = len(prepared), len(prepared[0].command) * GRID
    times = np.arange(math.ceil(length / period - 1e-9)) * period
    settle = round(SETTLE / step)

    def array(values: Any) -> wp.array:
        return wp.array(np.ascontiguousarray(values, dtype=float), dtype=wp.float64, device=device)

    out = wp.zeros((count, len(times), len(SIGNALS)), dtype=wp.float64, device=device)
    sampled = array(np.tile(times, (count, 1)))
    inputs = [
        wp.array(
            families.pack(family, [one.machine for one in prepared]), dtype=families.structure(family), device=device
        ),
        array([one.command for one in prepared]),
        array([one.drive for one in prepared]),
        array(angles),
        sampled,
        sampled,
        step,
        settle,
        settle + math.ceil(times[-1] / step) + 4,
        wp.zeros((count, 1), dtype=wp.float64, device=device),
    ]
    wp.launch(families.kernel(family), dim=count, inputs=inputs, outputs=[out], device=device)
    return out.numpy()


def simulate(
    runs: Sequence[Run], device: str = "cpu", period: float = GRID, step: float = STEP
) -> tuple[list[Prepared], list[np.ndarray]]:
    """Prepared runs and their signals (samples, signals), before measuring; runs of one family and length go together."""
    prepared = [prepare(run) for run in runs]
    signals: list[Any] = [None] * len(runs)
    groups: dict[tuple[str, int], list[int]] = {}
    for i, run in enumerate(runs):
        groups.setdefault((run.family, len(prepared[i].command)), []).append(i)
    workers = max(1, len(os.sched_getaffinity(0))) if device == "cpu" else 1
    chunks = []
    for (family, _), members in groups.items():
        wp.load_module(families.kernel(family).module, device=device)  # once, before threads ask for it
        size = max(1, min(CHUNK if device == "cpu" else DEVICE_CHUNK, math.ceil(len(members) / workers)))
        chunks += [(family, members[i : i + size]) for i in range(0, len(members), size)]

    def made(chunk: tuple[str, list[int]]) -> np.ndarray:
        family, members = chunk
        angles = [runs[i].joint_angle for i in members]
        return launch(family, [prepared[i] for i in members], angles, device, period, step)

    with ThreadPoolExecutor(workers) as pool:
        for (_, members), values in zip(chunks, pool.map(made, chunks), strict=True):
            for i, value in zip(members, values, strict=True):
                signals[i] = value
    return prepared, signals


def record(runs: Sequence[Run], device: str = "cpu", noise: bool = True) -> list[dict[str, np.ndarray]]:
    """Logs of runs at 100 Hz in SI units: one array (K,) a column, sample k at 10 ms · k.

    Args:
        runs: What to record; all families and lengths mixed.
        device: Warp's name of the device.
        noise: Whether engine orders, noise and quantisation are added; filters, delays, gains and zeros always act.

    Raises:
        ValueError: If a run names no family, effect or deviation that there is, or its command is out of range.
    """
    logs = []
    for first in range(0, len(runs), DEVICE_CHUNK):
        some = runs[first : first + DEVICE_CHUNK]
        prepared, signals = simulate(some, device)
        for run, one, exact in zip(some, prepared, signals, strict=True):
            rng = np.random.default_rng([run.seed, 2])
            columns = measuring.measured(run.family, exact[:, LOGGED], one.times, one.machine, rng, noise)
            change = OUTSIDE[run.outside].columns if run.outside is not None else None
            if change is not None:
                columns = change(columns, run.outside_size, np.random.default_rng([run.seed, 3]))
            logs.append(columns)
    return logs


def trace(
    runs: Sequence[Run], device: str = "cpu", period: float = GRID, step: float = STEP
) -> list[dict[str, np.ndarray]]:
    """Exact signals of runs at a period [s], by name (``aoro_gym.diagnosis_benchmark.independent.laws.layout.SIGNALS``)."""
    _, signals = simulate(runs, device, period, step)
    return [dict(zip(SIGNALS, one.T, strict=True)) for one in signals]
