"""Key figures of full turns on simulated days: what a table says of a machine of which no log exists.

Every turn goes from one stop to the other at standstill. Its angle passes the measuring chain of its day; half of the
tables are of noisy sensors, the others exact, as those of a simulation are. The figures are read as a user reads them, with
the geometry of the machine's kind, the stop being where the measured angle comes to rest.

Deviations that the catalogue lacks (:mod:`.outsiders`) come with the machine and the command; those of sampled signals need
signals, and no day of that kind is simulated here.
"""

# pyright: reportInvalidTypeForm=false
from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from aoro_gym.calibration.turns import SAMPLING, STANDSTILL, longest
from aoro_gym.diagnosis.simulation.days import Days, planes
from aoro_gym.diagnosis.simulation.logs import BATCH, CPU_BATCH, follow, schedules
from aoro_gym.diagnosis.simulation.prior import SensorPrior
from aoro_gym.effects.signals import lagged, smoothed
from aoro_gym.machine import Machine
from aoro_gym.machine.sections import SteeringCylinder
from aoro_gym.simulation.key_figures import FIGURES, key_figures_batch
from aoro_gym.validation.turns import Turn

Floats = NDArray[np.float64]

READ = tuple(name for name in FIGURES if name != "mean_flow_L_per_min")
"""Figures that are told apart: the mean flow is the oil of a turn over its time, and so is the time once more."""
LEVELS = (1.0, 0.75, 0.5)
"""Signals that tables usually have."""
SLOWEST = 0.45
"""Least signal of a turn."""
USUAL = 0.8
"""Share of the tables that have :data:`LEVELS`; signals of the others are drawn evenly."""
ONE_SIDED = 0.5
"""Share of the tables that have left turns only."""
NOISY = 0.5
"""Share of the tables whose figures were read from noisy signals."""
FULL = 0.9
"""Share of the way from stop to stop that a turn must make to have figures."""
LINES = ((5.3, 6.9, 1.0),) * 4 + ((14.0, 16.0, 0.4), (26.0, 33.5, 0.2))
"""Bands [Hz] of the angle's spectral lines, and their heights in units of :data:`LINE`."""
LINE = 1e-3
"""[rad] of the published lines near 6 Hz."""
TOGETHER = 64
"""Turns of a machine, each on all of its days, whose figures are read together."""


def draw_signals(rng: np.random.Generator, machines: int, each: int) -> Floats:
    """Signals of ``each`` turns of every machine (machines, each), left positive; no two of a machine are alike."""
    levels = rng.uniform(SLOWEST, 1.0, (machines, each))
    usual = rng.random(machines) < USUAL
    for first in range(0, each, len(LEVELS)):
        count = min(len(LEVELS), each - first)
        some = np.array([rng.permutation(LEVELS)[:count] for _ in range(machines)])
        levels[usual, first : first + count] = some[usual]
    sign = np.where(rng.random((machines, each)) < 0.5, 1.0, -1.0)
    # the second three are the other side's, so that no turn comes twice
    side = np.where(np.arange(each) // len(LEVELS) % 2, -1.0, 1.0)
    sign = np.where(
        (rng.random(machines) < ONE_SIDED)[:, None], side, np.where(usual[:, None], sign[:, :1] * side, sign)
    )
    return sign * levels


@dataclass(frozen=True)
class _Chains:
    """What lies between joint and figures, of N turns: magnitudes of effects of the measuring chain (N, 4), factor on
    spectral lines, white noise [rad] and smoothing [s] of the machine (N,)."""

    of_day: Floats
    lines: Floats
    white: Floats
    smoothing: Floats

    def of(self, rows: NDArray[np.intp]) -> _Chains:
        return _Chains(self.of_day[rows], self.lines[rows], self.white[rows], self.smoothing[rows])


def simulate_figures(
    days: Days,
    signals: Floats,
    *,
    prior: SensorPrior | None = None,
    seed: int = 0,
    device: str = "cpu",
    threads: int = 1,
    progress: Callable[[int, int], Any] = lambda done, total: None,
) -> NDArray[np.float32]:
    """Figures :data:`READ` (M, D, J, figures) of ``days``; NaN of a turn that does not end.

    Args:
        days: (M · D,) machine by machine.
        signals: Of the J turns of each of the M machines, in [-1, 1], left positive.
        prior: What sensors add.
        seed: Of what they add, and of what outsiders do to commands.
        device: Of the twins.
        threads: That read figures, while twins run on.
        progress: Called with the number of turns that are simulated, and of all.
    """
    machines, each = signals.shape
    number = len(days.kind) // machines
    chains = _draw_chains(days, machines, prior or SensorPrior(), np.random.default_rng([seed, 2]))
    states = np.random.default_rng([seed, 3]).integers(2**63, size=(machines, number))
    lasts = np.array([longest(Turn("left" if one > 0.0 else "right", 100.0 * abs(one))) for one in signals.ravel()])
    order = np.argsort(lasts, kind="stable")  # turns of one length run together
    found = np.full((machines * each, number, len(READ)), np.nan, dtype=np.float32)
    together = max((BATCH if wp.get_device(device).is_cuda else CPU_BATCH) // number // TOGETHER, 1) * TOGETHER

    def read(turns: NDArray[np.intp], rows: NDArray[np.intp], angle: NDArray[np.float32], first: int) -> None:
        rng = np.random.default_rng([seed, 4, first])
        measured = _measured(angle.astype(np.float64), chains.of(rows), rng)
        signal = np.repeat(signals.ravel()[turns], number)
        found[turns] = _read(measured, signal, days.joint_range[rows]).reshape(-1, number, len(READ))

    reading: list[Future[None]] = []
    with ThreadPoolExecutor(threads) as pool:
        for first in range(0, len(order), together):
            turns = order[first : first + together]
            rows = (turns[:, None] // each * number + np.arange(number)).ravel()
            angle = _angles(
                days.of(rows), signals.ravel()[turns], float(lasts[turns[-1]]), states[turns // each], device
            )
            for begin in range(0, len(turns), TOGETHER):
                part = slice(begin * number, (begin + TOGETHER) * number)
                reading.append(
                    pool.submit(read, turns[begin : begin + TOGETHER], rows[part], angle[:, part].copy(), first + begin)
                )
            progress(min(first + together, len(order)) * number, len(order) * number)
        for one in reading:
            one.result()
    return found.reshape(machines, each, number, len(READ)).transpose(0, 2, 1, 3)


def _draw_chains(days: Days, machines: int, prior: SensorPrior, rng: np.random.Generator) -> _Chains:
    """Of all days: what its machine's sensor adds on every one of them."""
    noise = np.where(rng.random(machines) < NOISY, 1.0, 0.0)
    lines, white = (
        np.exp(rng.uniform(np.log(low), np.log(high), machines)) * noise
        for low, high in (prior.line_scale, prior.angle_white)
    )
    smoothing = rng.uniform(0.0, prior.smoothing, machines) * (rng.random(machines) < prior.smooth) * noise
    each = len(days.kind) // machines
    return _Chains(days.chain, *(np.repeat(one, each) for one in (lines, white, smoothing)))


@wp.kernel(enable_backward=False)
def _keep_angle(values: wp.array3d(dtype=float), rows: wp.array(dtype=int), first: int, kept: wp.array2d(dtype=float)):
    """Angles (frames, rows, N) of a stretch into (F, N)."""
    frame, t = wp.tid()  # pyright: ignore
    if first + frame < kept.shape[0]:
        kept[first + frame, t] = values[frame, rows[0], t]


def _angles(days: Days, signal: Floats, lasts: float, states: NDArray[np.int64], device: str) -> NDArray[np.float32]:
    """Exact joint angles (F, N · D) [rad] of turns at ``signal`` (N,) on D days each.

    Args:
        days: (N · D,) turn by turn.
        signal: Of the turns, left positive.
        lasts: Time [s] that they are given.
        states: Seeds of what outsiders do to commands (N, D).
        device: Of the twins.
    """
    number = states.shape[1]
    rest = round(STANDSTILL / SAMPLING)
    commands = np.zeros((len(signal), 1, 2, 2 * rest + round(lasts / SAMPLING)), dtype=np.float32)
    commands[:, 0, 0, rest:] = signal[:, None]
    schedule, which = schedules(commands, days.outsider.reshape(-1, number), lambda turn, day: int(states[turn, day]))
    kept = wp.zeros((commands.shape[-1] + 1, len(days.kind)), dtype=float, device=device)

    def keep(values: wp.array, rows: wp.array, first: int) -> None:
        wp.launch(_keep_angle, (len(values), kept.shape[1]), [values, rows, first, kept], device=device)

    start = -np.sign(np.repeat(signal, number)) * days.joint_range
    status = follow(days.records, planes(days.slope), start, schedule, which, keep, device=device)
    angle = np.array(kept.numpy(), dtype=np.float32)
    angle[:, status != 0] = np.nan
    return angle


def _measured(angle: Floats, chains: _Chains, rng: np.random.Generator) -> Floats:
    """Angles (F, N) behind lag, gain, noise and smoothing; a delay moves no figure."""
    rate = 1.0 / SAMPLING
    values = (1.0 + chains.of_day[:, 2]) * angle
    late = np.flatnonzero(chains.of_day[:, 1])
    if len(late):
        values[:, late] = lagged(values[:, late], rate, chains.of_day[late, 1])
    noisy = np.flatnonzero(chains.white)
    if len(noisy):
        values[:, noisy] += _noise(len(angle), chains.lines[noisy], chains.white[noisy], rng)
    smoothing = np.maximum(chains.of_day[:, 3], chains.smoothing)
    smooth = np.flatnonzero(smoothing)
    if len(smooth):
        values[:, smooth] = smoothed(values[:, smooth], rate, smoothing[smooth])
    return values


def _noise(frames: int, lines: Floats, white: Floats, rng: np.random.Generator) -> Floats:
    """Spectral lines and white noise (F, N) of an angle; in single precision, whose sines are several times faster."""
    time = (2.0 * math.pi * SAMPLING * np.arange(frames, dtype=np.float32))[:, None]
    noise = white.astype(np.float32) * rng.standard_normal((frames, len(white)), dtype=np.float32)
    for low, high, height in LINES:
        frequency, phase = (
            rng.uniform(*ends, len(lines)).astype(np.float32) for ends in ((low, high), (0.0, 2.0 * math.pi))
        )
        noise += (LINE * height * lines).astype(np.float32) * np.sin(frequency * time + phase)
    return noise.astype(np.float64)


def _read(angle: Floats, signal: Floats, joint_range: Floats) -> Floats:
    """Figures (N, figures) of measured angles (F, N)."""
    rest = round(STANDSTILL / SAMPLING)
    start, stop = np.mean(angle[: rest // 2], axis=0), np.mean(angle[-rest:], axis=0)
    with np.errstate(invalid="ignore"):
        whole = np.sign(signal) * (stop - start) > 2.0 * FULL * joint_range
    whole &= np.all(np.isfinite(angle), axis=0)
    found = np.full((len(signal), len(READ)), np.nan)
    if np.any(whole):
        clock = SAMPLING * np.arange(len(angle))
        shown = key_figures_batch(clock, angle[:, whole], _cylinder(), stop=stop[whole], interpolate=True)
        found[whole] = np.stack([shown[name] for name in READ], axis=1)
    return found


@cache
def _cylinder() -> SteeringCylinder:
    """Whose geometry turns an angle into oil: what a user knows of the machine's kind."""
    return Machine.load("aoro").steering.cylinder
