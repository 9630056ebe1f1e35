"""Runs of plants, and what a logger writes of them: of any group of families."""

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import warp as wp

from .group import Group
from .laws.layout import SIGNALS

HOLD = 0.01  # [s] a command stands, and period of the logger
GRID = 1e-3  # [s] of commands inside
STEP = 1e-4  # [s] of integration
ALL = tuple(range(1, len(SIGNALS)))
"""All signals behind the joint angle."""
CHUNK, DEVICE_CHUNK = 2**26, 2**30
"""Bytes of signals that one launch computes on the processor and on a GPU."""
TOGETHER, DEVICE_TOGETHER = 2**29, 2**32
"""Bytes of signals that are held at once: of launches side by side, as one alone leaves a GPU nearly idle."""


@dataclass(frozen=True)
class Run:
    """One log to be made.

    Args:
        family: Name of the family of laws.
        machine: Constants, as :meth:`~.group.Group.machine` draws them.
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
    """A run as the kernel takes it, and times [s]: of the logger's samples, of the joint angle and of all other signals."""

    machine: dict[str, float]
    command: np.ndarray
    drive: np.ndarray
    joint_angle: float
    times: np.ndarray
    angle_times: np.ndarray
    other_times: np.ndarray


Chunk = tuple[str, list[int]]
"""A family, and which runs of it are computed by one launch."""


def prepare(group: Group, run: Run, period: float | None = None) -> Prepared:
    """Constants, commands on the inner grid, and sampling times of a run: every ``period`` [s], or as measuring reads."""
    group.family_of(run.family)
    steering = np.asarray(run.steering, float)
    if steering.ndim != 1 or not len(steering) or not np.all(np.abs(steering) <= 1.0):
        raise ValueError("steering must be an array (K,) within [-1, 1]")
    drive = np.zeros(len(steering)) if run.drive is None else np.asarray(run.drive, float)
    if drive.shape != steering.shape or not np.all(np.abs(drive) <= 1.0):
        raise ValueError("drive must be as long as steering, within [-1, 1]")
    per = round(HOLD / GRID)
    length = len(steering) * HOLD
    every = period or HOLD
    times = np.arange(round((len(steering) - 1) * HOLD / every) + 1) * every
    made = group.apply_all(run.family, run.machine, run.effects)
    command = np.repeat(steering, per)
    if run.outside is not None:
        if run.outside not in group.outside:
            raise ValueError(f"no deviation {run.outside!r}; there are {', '.join(group.outside)}")
        one, rng = group.outside[run.outside], np.random.default_rng([run.seed, 1])
        made |= one.machine(run.outside_size, rng, length) if one.machine else {}
        command = one.command(command, run.outside_size, rng) if one.command else command
        times = one.clock(times, run.outside_size, rng) if one.clock else times
    sampled = group.sampling(made, times, length, period or group.period)
    command = group.command(run.family, command, made)
    return Prepared(made, command, np.repeat(drive, per), run.joint_angle, times, *sampled)


def launch(
    group: Group, family: str, prepared: Sequence[Prepared], device: str, columns: Sequence[int], step: float
) -> tuple[wp.array, list[Any]]:
    """Signals (runs, samples, 1 + columns) of prepared runs of one family and one length, which a GPU may still be
    computing, and what has to be kept until it has.

    Args:
        group: Of the family.
        family: Of all runs.
        prepared: Runs as the kernel takes them.
        device: Warp's name of the device.
        columns: Signals behind the joint angle, by number.
        step: Of integration [s].
    """
    count = len(prepared)
    settle = round(group.settle / step)
    steps = settle + math.ceil(max(one.other_times[-1] for one in prepared) / step) + 4
    dead = max(one.machine.get("dead_time", 0.0) for one in prepared)
    places = math.ceil(dead / step) + 4 if dead > 0.0 else 1

    def array(values: Any) -> wp.array:
        return wp.array(np.ascontiguousarray(values, dtype=float), dtype=wp.float64, device=device)

    samples = len(prepared[0].other_times)
    out = wp.zeros((count, samples, 1 + len(columns)), dtype=wp.float64, device=device)
    machines = group.pack(family, [one.machine for one in prepared])
    inputs = [
        wp.array(machines, dtype=group.structure(family), device=device),
        array([one.command for one in prepared]),
        array([one.drive for one in prepared]),
        array([one.joint_angle for one in prepared]),
        array([one.angle_times for one in prepared]),
        array([one.other_times for one in prepared]),
        wp.array(np.array(columns, dtype=np.int32), dtype=int, device=device),
        step,
        settle,
        steps,
        wp.zeros((count, places), dtype=wp.float64, device=device),
    ]
    wp.launch(group.kernel(family), dim=count, inputs=inputs, outputs=[out], device=device)
    return out, inputs


def chunked(group: Group, runs: Sequence[Run], device: str, period: float | None, columns: int) -> list[list[Chunk]]:
    """Launches of runs, those of one family and length together, by what a device computes at once: short ones first, as
    launches side by side take as long as the longest.

    Args:
        group: Of all families.
        runs: What is simulated.
        device: Warp's name of the device.
        period: Between samples [s]; as measuring reads them by default.
        columns: Signals behind the joint angle.
    """
    groups: dict[tuple[str, int], list[int]] = {}
    for i, run in enumerate(runs):
        groups.setdefault((run.family, np.size(run.steering)), []).append(i)
    workers, cpu = _workers(device), device == "cpu"
    waves: list[list[Chunk]] = [[]]
    held = 0
    for (family, _), members in sorted(groups.items(), key=lambda one: one[0][1]):
        samples = len(prepare(group, runs[members[0]], period).other_times)
        wp.load_module(group.kernel(family).module, device=device)  # once, before threads ask for it
        each = 8 * (1 + columns) * samples
        most = (CHUNK if cpu else DEVICE_CHUNK) // each
        size = max(1, min(most, math.ceil(len(members) / workers)))
        for first in range(0, len(members), size):
            chunk = members[first : first + size]
            if held + len(chunk) * each > (TOGETHER if cpu else DEVICE_TOGETHER) and waves[-1]:
                waves.append([])
                held = 0
            held += len(chunk) * each
            waves[-1].append((family, chunk))
    return waves


def _workers(device: str) -> int:
    return max(1, len(os.sched_getaffinity(0))) if device == "cpu" else 1


def simulate(
    group: Group, runs: Sequence[Run], device: str, period: float | None, columns: Sequence[int], step: float = STEP
) -> Iterator[tuple[Chunk, list[Prepared], np.ndarray]]:
    """Chunks of runs, as the kernel took them, and their signals (runs, samples, 1 + columns), before noise.

    Args:
        group: Of all families.
        runs: What to simulate.
        device: Warp's name of the device.
        period: Between samples [s]; as measuring reads them by default.
        columns: Signals behind the joint angle, by number.
        step: Of integration [s].
    """

    def begin(chunk: Chunk) -> tuple[list[Prepared], wp.array, list[Any]]:
        family, members = chunk
        prepared = [prepare(group, runs[i], period) for i in members]
        return prepared, *launch(group, family, prepared, device, columns, step)

    def end(chunk: Chunk) -> tuple[list[Prepared], np.ndarray]:
        prepared, out, _ = begin(chunk)
        return prepared, out.numpy()

    for wave in chunked(group, runs, device, period, len(columns)):
        if device == "cpu":
            with ThreadPoolExecutor(_workers(device)) as pool:
                found: Iterator[tuple[list[Prepared], np.ndarray]] = pool.map(end, wave)
        else:
            begun = []
            for chunk in wave:
                stream = wp.Stream(device)
                with wp.ScopedStream(stream):
                    begun.append((*begin(chunk), stream))
            wp.synchronize_device(device)
            found = ((prepared, out.numpy()) for prepared, out, *_ in begun)
        for chunk, (prepared, signals) in zip(wave, found, strict=True):
            yield chunk, prepared, signals


def record(group: Group, runs: Sequence[Run], device: str = "cpu", noise: bool = True) -> list[dict[str, np.ndarray]]:
    """Logs of runs at 100 Hz in SI units: one array (K,) a column, sample k at 10 ms · k.

    Args:
        group: Of all families.
        runs: What to record; all families and lengths mixed.
        device: Warp's name of the device.
        noise: Whether engine orders, noise and quantisation are added; filters, delays, gains and zeros always act.

    Raises:
        ValueError: If a run names no family, effect or deviation that there is, or its command is out of range.
    """
    logs: list[Any] = [None] * len(runs)
    for (family, members), prepared, signals in simulate(group, runs, device, None, group.logged):
        rngs = [np.random.default_rng([runs[i].seed, 2]) for i in members]
        for i, columns in zip(members, group.measured(family, signals, prepared, rngs, noise), strict=True):
            run = runs[i]
            change = group.outside[run.outside].columns if run.outside is not None else None
            if change is not None:
                columns = change(columns, run.outside_size, np.random.default_rng([run.seed, 3]))
            logs[i] = columns
    return logs


def trace(
    group: Group, runs: Sequence[Run], device: str = "cpu", period: float = GRID, step: float = STEP
) -> list[dict[str, np.ndarray]]:
    """Exact signals of runs at a period [s], by name (``laws.layout.SIGNALS``).

    Args:
        group: Of all families.
        runs: What to simulate.
        device: Warp's name of the device.
        period: Between samples [s].
        step: Of integration [s].
    """
    found: list[Any] = [None] * len(runs)
    for (_, members), _, signals in simulate(group, runs, device, period, ALL, step):
        for i, one in zip(members, signals, strict=True):
            found[i] = dict(zip(SIGNALS, one.T, strict=True))
    return found
