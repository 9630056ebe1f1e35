"""Runs of plants, and what a logger writes of them."""

import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import warp as wp

from . import families
from .effects import apply_all
from .laws.layout import SIGNALS
from .measuring import measured
from .outside import OUTSIDE

HOLD = 0.01  # [s] a command stands, and period of the logger
GRID = 1e-3  # [s] of commands inside
STEP = 1e-4  # [s] of integration
SETTLE = 0.15  # [s] at rest before a log
LOGGED = SIGNALS[:7]
CHUNK, DEVICE_CHUNK = 256, 16384  # runs stepped together, which bounds memory


@dataclass(frozen=True)
class Run:
    """One log to be made.

    Args:
        family: Name of the family of laws.
        machine: Constants, as :func:`machine` draws them.
        effects: Signed sizes of effects by id, in the unit of each effect's magnitude.
        steering: Command (K,) in [−1, 1], positive to the left, each value held for 10 ms.
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


@dataclass(frozen=True)
class Recorded:
    """A log at 100 Hz in SI units: one array (K,) a column, sample k at 10 ms · k."""

    columns: dict[str, np.ndarray]

    def __getitem__(self, name: str) -> np.ndarray:
        return self.columns[name]


@dataclass
class Prepared:
    """A run as the kernel takes it, and what the measuring chain does to its signals."""

    machine: dict[str, float]
    command: np.ndarray
    drive: np.ndarray
    angle_times: np.ndarray
    other_times: np.ndarray


def prepare(run: Run, period: float) -> Prepared:
    """Constants, commands on the inner grid, and sampling times of a run."""
    families.family_of(run.family)
    steering = np.asarray(run.steering, float)
    if steering.ndim != 1 or not len(steering) or not np.all(np.abs(steering) <= 1.0):
        raise ValueError("steering must be an array (K,) within [-1, 1]")
    drive = np.zeros(len(steering)) if run.drive is None else np.asarray(run.drive, float)
    if drive.shape != steering.shape or not np.all(np.abs(drive) <= 1.0):
        raise ValueError("drive must be as long as steering, within [-1, 1]")
    per = round(HOLD / GRID)
    count = round((len(steering) - 1) * HOLD / period) + 1
    times = np.arange(count) * period
    made = apply_all(run.family, run.machine, run.effects)
    command = np.repeat(steering, per)
    if run.outside is not None:
        if run.outside not in OUTSIDE:
            raise ValueError(f"no deviation {run.outside!r}; there are {', '.join(OUTSIDE)}")
        one, rng = OUTSIDE[run.outside], np.random.default_rng([run.seed, 1])
        made |= one.machine(run.outside_size, rng) if one.machine else {}
        command = one.command(command, run.outside_size, rng) if one.command else command
        times = one.clock(times, run.outside_size, rng) if one.clock else times
    others = times - made["chain_delay"]
    return Prepared(made, command, np.repeat(drive, per), others - made["angle_delay"], others)


def launch(
    family: str, prepared: Sequence[Prepared], angles: Sequence[float], device: str, step: float
) -> tuple[wp.array, list[Any]]:
    """Signals (runs, samples, signals) of prepared runs of one family and one length, which a GPU may still be computing,
    and what has to be kept until it has.

    Args:
        family: Of all runs.
        prepared: Runs as the kernel takes them.
        angles: Joint angles at the start [rad].
        device: Warp's name of the device.
        step: Of integration [s].
    """
    kind, kernel = families.structure(family), families.kernel(family)
    count = len(prepared)
    settle = round(SETTLE / step)
    steps = settle + math.ceil(max(one.other_times[-1] for one in prepared) / step) + 4
    dead = max(one.machine.get("dead_time", 0.0) for one in prepared)
    places = math.ceil(dead / step) + 4 if dead > 0.0 else 1

    def array(values: Any) -> wp.array:
        return wp.array(np.ascontiguousarray(values, dtype=float), dtype=wp.float64, device=device)

    samples = len(prepared[0].other_times)
    out = wp.zeros((count, samples, len(SIGNALS)), dtype=wp.float64, device=device)
    inputs = [
        wp.array(families.pack(family, [one.machine for one in prepared]), dtype=kind, device=device),
        array([one.command for one in prepared]),
        array([one.drive for one in prepared]),
        array(angles),
        array([one.angle_times for one in prepared]),
        array([one.other_times for one in prepared]),
        step,
        settle,
        steps,
        wp.zeros((count, places), dtype=wp.float64, device=device),
    ]
    wp.launch(kernel, dim=count, inputs=inputs, outputs=[out], device=device)
    return out, inputs


def simulate(
    runs: Sequence[Run], device: str = "cpu", period: float = HOLD, step: float = STEP
) -> tuple[list[Prepared], list[np.ndarray]]:
    """Prepared runs and their signals (samples, signals), before noise; runs of one family and length go together."""
    prepared = [prepare(run, period) for run in runs]
    signals: list[Any] = [None] * len(runs)
    groups: dict[tuple[str, int], list[int]] = {}
    for i, run in enumerate(runs):
        groups.setdefault((run.family, len(prepared[i].command)), []).append(i)
    most = CHUNK if device == "cpu" else DEVICE_CHUNK
    workers = max(1, len(os.sched_getaffinity(0))) if device == "cpu" else 1
    chunks = []
    for (family, _), members in groups.items():
        wp.load_module(families.kernel(family).module, device=device)  # once, before threads ask for it
        size = max(1, min(most, math.ceil(len(members) / workers)))
        chunks += [(family, members[i : i + size]) for i in range(0, len(members), size)]

    def begin(chunk: tuple[str, list[int]]) -> tuple[wp.array, list[Any]]:
        family, members = chunk
        return launch(family, [prepared[i] for i in members], [runs[i].joint_angle for i in members], device, step)

    if device == "cpu":
        with ThreadPoolExecutor(workers) as pool:
            found = list(pool.map(lambda chunk: begin(chunk)[0].numpy(), chunks))
    else:
        found = _side_by_side(begin, chunks, device)
    for (_, members), values in zip(chunks, found, strict=True):
        for i, value in zip(members, values, strict=True):
            signals[i] = value
    return prepared, signals


def _side_by_side(begin: Callable[[Any], tuple[wp.array, Any]], chunks: Sequence[Any], device: str) -> list[np.ndarray]:
    """Signals of chunks of runs, each on a stream of its own: one alone leaves a GPU nearly idle."""
    begun = []
    for chunk in chunks:
        stream = wp.Stream(device)
        with wp.ScopedStream(stream):
            begun.append((*begin(chunk), stream))
    wp.synchronize_device(device)
    return [out.numpy() for out, *_ in begun]


def record(runs: Sequence[Run], device: str = "cpu", noise: bool = True) -> list[Recorded]:
    """Logs of runs.

    Args:
        runs: What to record; all families and lengths mixed.
        device: Warp's name of the device.
        noise: Whether engine orders, noise and quantisation are added; filters, delays, gains and zeros always act.

    Raises:
        ValueError: If a run names no family, effect or deviation that there is, or its command is out of range.
    """
    prepared, signals = simulate(runs, device)
    logs = []
    for run, one, exact in zip(runs, prepared, signals, strict=True):
        rng = np.random.default_rng([run.seed, 2])
        columns = measured(exact[:, : len(LOGGED)], one.other_times, one.machine, rng, noise)
        change = OUTSIDE[run.outside].columns if run.outside is not None else None
        if change is not None:
            columns = change(columns, run.outside_size, np.random.default_rng([run.seed, 3]))
        logs.append(Recorded(columns))
    return logs


def trace(
    runs: Sequence[Run], device: str = "cpu", period: float = GRID, step: float = STEP
) -> list[dict[str, np.ndarray]]:
    """Exact signals of runs at a period [s], by name (``laws.layout.SIGNALS``)."""
    _, signals = simulate(runs, device, period, step)
    return [dict(zip(SIGNALS, one.T, strict=True)) for one in signals]
