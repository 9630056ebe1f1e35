"""Figures of left turns of many machines at once, and how far they are from the published ones.

Rows of a machine are in one order everywhere: seven key figures at 100, 75 and 50 % signal, seven of the shape of the curve
at 100 %, and the single figures :data:`KNOWN`.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aoro_gym.calibration.published import LEVELS, SINGLE_FIGURES
from aoro_gym.calibration.turns import SAMPLING, STANDSTILL, longest
from aoro_gym.machine import Machine
from aoro_gym.simulation.key_figures import FIGURES, key_figures_batch
from aoro_gym.twin import Twin
from aoro_gym.twin.records import Output
from aoro_gym.validation.published import published, published_rows
from aoro_gym.validation.shape import SHAPE, SHAPE_TURN, shape_batch
from aoro_gym.validation.study import TARGETS, TURN_TIME_TARGET
from aoro_gym.validation.turns import Turn

REFERENCES = ("mevea", "physical")
"""Rows that are fitted: those of the published twin, and those of the real machine."""
TRANSIENT = FIGURES[3:]
"""Figures that the predictive score is made of: first peak and its time, lowest undershoot, second peak."""
KNOWN = ("motor_pressure", "motor_pressure_without_brake", "mass")
"""Single figures that every fit has, in closed form."""
CHUNK = 0.2
"""Simulated time [s] of one launch; divides every duration."""
PART = 1024
"""Machines whose figures one thread reads: fewer take longer to part than to read."""

OF_TURNS = len(LEVELS) * len(FIGURES)
ROWS = OF_TURNS + len(SHAPE) + len(KNOWN)

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Found:
    """Figures of N machines; NaN where a turn failed or was not asked for."""

    smooth: Floats
    """Key figures (21, N) between samples: smooth functions of the parameters."""
    sampled: Floats
    """The same, read from samples as published; NaN where that was not asked for."""
    shape: Floats
    """Misses (7, N) of the curve's shape at 100 % in tolerances."""
    single: Floats
    """Misses (3, N) of :data:`KNOWN` in tolerances."""

    def misses(self, reference: str) -> Floats:
        """Misses (:data:`ROWS`, N) in tolerances. The shape is published of the published twin alone, and NaN of another."""
        target, tolerance = zip(*(targets(reference, turn) for turn in LEVELS), strict=True)
        turning = (self.smooth - np.concatenate(target)[:, None]) / np.concatenate(tolerance)[:, None]
        shape = self.shape if reference == "mevea" else np.full_like(self.shape, np.nan)
        return np.vstack([turning, shape, self.single])

    def errors(self, reference: str) -> Floats:
        """Relative errors (21, N) of the figures as published."""
        target = np.concatenate([targets(reference, turn)[0] for turn in LEVELS])
        return self.sampled / target[:, None] - 1.0

    def part(self, which: NDArray[np.intp] | slice) -> Found:
        """Some of the machines."""
        return Found(self.smooth[:, which], self.sampled[:, which], self.shape[:, which], self.single[:, which])


def targets(reference: str, turn: Turn) -> tuple[Floats, Floats]:
    """Figures of a reference at a level (7,), and their tolerances."""
    row = next(
        row
        for row in published_rows()
        if (row["source"], row["direction"], row["signal_percent"]) == (reference, turn.direction, turn.signal_percent)
    )
    target = np.array([row[name] for name in FIGURES], dtype=np.float64)
    tolerance = np.array([bound if kind == "difference" else bound * known
                          for (kind, bound), known in zip(TARGETS.values(), target, strict=True)])  # fmt: skip
    if turn.signal_percent == 100.0:
        tolerance[FIGURES.index("turn_time_s")] = TURN_TIME_TARGET
    return target, tolerance


def single_misses(machine: Machine) -> Floats:
    """Misses (3, N) of the figures :data:`KNOWN` in tolerances."""
    rows = []
    for name in KNOWN:
        measure, bound = SINGLE_FIGURES[name]
        rows.append(
            np.broadcast_to((measure(machine, "cpu", 30) / published(name) - 1.0) / bound, machine.num_variants)
        )
    return np.array(rows)


def recorded(machine: Machine, turn: Turn, device: str, outputs: Sequence[int]) -> tuple[NDArray, NDArray[np.bool_]]:
    """Outputs (K, frames, N) of a left turn from the opposite stop, 100 frames a second; and whether each twin runs."""
    twin = Twin(machine.num_variants, machine=machine, device=device, check_step=False)
    twin.reset(joint_angle=-turn.sign * np.broadcast_to(machine.joint.range, machine.num_variants))
    parts = []
    for signal, duration in ((0.0, STANDSTILL), (turn.sign * turn.signal_percent / 100.0, longest(turn) + STANDSTILL)):
        twin.set_commands({"steering_signal": signal})
        left = round(duration / SAMPLING)
        while left > 0:
            frames = min(left, round(CHUNK / SAMPLING))
            twin.advance(round(frames * SAMPLING, 2), sample_every=SAMPLING)
            parts.append(np.stack([twin.outputs[:, int(row)].contiguous().numpy() for row in outputs]))
            left -= frames
    return np.concatenate(parts, axis=1), twin.status == 0


def read(
    machine: Machine, turn: Turn, channels: NDArray, running: NDArray[np.bool_], *, sampled: bool = True
) -> tuple[Floats, Floats, Floats]:
    """Key figures (7, N) between samples, the same from samples, and misses of the shape (7 or 0, N).

    Args:
        machine: N variants, or one for all.
        turn: What they do.
        channels: Joint angle and the ports' pressures (3, frames, N).
        running: Twins (N,) that run; the figures of others are NaN.
        sampled: Whether the second ones are asked for, which are NaN otherwise.
    """
    angle, *ports = channels.astype(np.float64)
    clock = SAMPLING * np.arange(len(angle))
    with np.errstate(all="ignore"):
        smooth = key_figures_batch(clock, angle, machine, interpolate=True)
        rough: dict[str, Floats] = dict.fromkeys(FIGURES, np.nan * angle[0])
        rough = key_figures_batch(clock, angle, machine) if sampled else rough
        shape = shape_batch(clock, angle, machine, ports, interpolate=True)[1] if turn == SHAPE_TURN else {}
    found = [
        np.array([figures[name] for name in names]).reshape(len(names), angle.shape[1])
        for figures, names in ((smooth, FIGURES), (rough, FIGURES), (shape, tuple(shape)))
    ]
    for rows in found:
        rows[:, ~running] = np.nan
    return found[0], found[1], found[2]


def turned(
    machine: Machine, turn: Turn, device: str, *, threads: int = 1, sampled: bool = True
) -> tuple[Floats, Floats, Floats]:
    """What :func:`read` gives of a left turn of the N variants of ``machine``, some machines a thread.

    Args:
        machine: N variants.
        turn: What they do.
        device: Where the twins run.
        threads: Threads that read figures.
        sampled: Whether figures from samples are asked for.
    """
    outputs = (Output.JOINT_ANGLE, Output.PRESSURE_A, Output.PRESSURE_B)
    channels, running = recorded(machine, turn, device, outputs)
    count = machine.num_variants
    if count == 1:
        return read(machine, turn, channels, running, sampled=sampled)
    parts = np.array_split(np.arange(count), -(-count // PART))
    with ThreadPoolExecutor(threads) as pool:
        found = list(pool.map(
            lambda part: read(machine.variants(part), turn, channels[:, :, part], running[part], sampled=sampled), parts
        ))  # fmt: skip
    return tuple(np.hstack(rows) for rows in zip(*found, strict=True))  # type: ignore[return-value]


def found_of(
    machine: Machine, levels: NDArray[np.bool_], device: str, *, batch: int, threads: int = 1, sampled: bool = True
) -> Found:
    """Figures of the N variants of ``machine``.

    Args:
        machine: N variants.
        levels: Which of :data:`LEVELS` each of them turns at, (3, N).
        device: Where the twins run.
        batch: Twins of one launch, at most.
        threads: Threads that read figures.
        sampled: Whether figures from samples are asked for.
    """
    count = machine.num_variants
    smooth, rough = np.full((2, OF_TURNS, count), np.nan)
    shape = np.full((len(SHAPE), count), np.nan)
    for i, turn in enumerate(LEVELS):
        asked = np.flatnonzero(levels[i])
        for part in np.array_split(asked, -(-len(asked) // batch)) if len(asked) else ():
            some = machine if count == 1 else machine.variants(part)
            one = turned(some, turn, device, threads=threads, sampled=sampled)
            rows = slice(i * len(FIGURES), (i + 1) * len(FIGURES))
            smooth[rows, part], rough[rows, part] = one[0], one[1]
            if turn == SHAPE_TURN:
                shape[:, part] = one[2]
    return Found(smooth, rough, shape, single_misses(machine))
