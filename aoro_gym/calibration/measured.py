"""What the published procedure reads of a machine's own logs: full turns, slow ramps, straight drives.

A log is what its commands make it. A *full turn* holds one steering signal from one stop to the other; a *ramp* moves the
signal slowly from nothing to one side, at a stop or anywhere else; a *straight drive* has a drive signal alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aoro_gym.machine import Machine
from aoro_gym.recording.logs import TICK, Log, read_log
from aoro_gym.simulation.key_figures import key_figures_batch
from aoro_gym.units import BAR, DEGREE
from aoro_gym.validation.published import published
from aoro_gym.validation.turns import Turn

STEADY_SIGNAL = 0.01
"""Change of the signal that a full turn may have."""
AT_STOP = 1.0 * DEGREE
"""How near [rad] to the machine's stops a full turn begins and ends."""
LAST = 0.5
"""Time [s] at the end of a turn whose mean angle is its stop."""
FASTEST_RAMP = 0.2
"""Steering voltage a second [V/s] of a ramp, at most: spool and command are late by some 30 ms, 6 mV of it."""
RAMP_TRAVEL = (0.3 * DEGREE, 6.0 * DEGREE)
"""Joint travel [rad] that the dead band is read from: beyond noise and friction, before the geometry changes much."""
RAMP_END = 1.0
"""Steering voltage [V] up to which the opening grows in proportion."""
LEAST_SAMPLES = 25
"""Of a ramp, and of a drive's steady end."""
STEADY_DRIVE = 1.0
"""Time [s] at the end of a straight drive whose mean pressure is read."""


@dataclass(frozen=True)
class MeasuredTurn:
    """A full turn of the machine."""

    log: str
    turn: Turn
    time: float
    """[s], from the unfiltered angle."""
    flow: float
    """Mean flow [L/min]."""
    figures: Mapping[str, float]
    """All key figures, NaN where there is none."""
    rest: NDArray[np.float64]
    """Joint angle [rad] at standstill before it (F,), 100 samples a second."""


@dataclass(frozen=True)
class MeasuredRamp:
    """The end of a side's dead band."""

    log: str
    side: str
    volts: float
    """[V] from the middle."""
    std: float
    """Standard deviation [V] by the scatter around the parabola."""


@dataclass(frozen=True)
class MeasuredDrive:
    """A straight drive."""

    log: str
    pressure: float
    """Difference between the drive's lines [bar], mean over the last :data:`STEADY_DRIVE`, less that at rest before it."""


@dataclass(frozen=True)
class Measured:
    """What the logs hold."""

    turns: tuple[MeasuredTurn, ...]
    ramps: tuple[MeasuredRamp, ...]
    drives: tuple[MeasuredDrive, ...]


def read_measured(machine: Machine, paths: Sequence[Path]) -> Measured:
    """Turns, ramps and drives of logs.

    Raises:
        ValueError: a log is none of them, or cannot be read; names file and reason.
    """
    turns, ramps, drives = [], [], []
    for path in paths:
        log = read_log(
            path, purpose="the published procedure", channels=("drive_pressure_forward", "drive_pressure_return")
        )
        steering = log.commands.get("steering_signal", np.zeros(len(log.channels["joint_angle"]) - 1))
        moved = np.flatnonzero(steering)
        if not len(moved):
            drives.append(_drive(log))
        elif np.ptp(steering[moved]) <= STEADY_SIGNAL:
            turns.append(_turn(log, machine, float(steering[moved[0]])))
        else:
            ramps.append(_ramp(log, steering))
    return Measured(tuple(turns), tuple(ramps), tuple(drives))


def _turn(log: Log, machine: Machine, signal: float) -> MeasuredTurn:
    """Time and mean flow of a full turn; its stop is the mean angle of its end."""
    angle = log.channels["joint_angle"]
    sign, stop = np.sign(signal), float(machine.joint.range)
    end = float(np.mean(angle[-round(LAST / TICK) :]))
    for what, value, wanted in (("begins", log.start_angle, -sign * stop), ("ends", end, sign * stop)):
        if abs(value - wanted) > AT_STOP:
            raise ValueError(
                f"{log.path} {what} at {value / DEGREE:.1f}°, but a full turn at {100 * signal:+.3g} % signal {what} at the "
                f"stop, {wanted / DEGREE:.1f}° ± {AT_STOP / DEGREE:g}°; record it from stop to stop, with half a second "
                "of rest before and after, or leave it out; where the joint's stops are elsewhere, say so by "
                "--set joint.range=DEG"
            )
    found = key_figures_batch(TICK * np.arange(len(angle)), angle, machine, stop=end)
    figures = {name: float(values[0]) for name, values in found.items()}
    time, flow = figures["turn_time_s"], figures["mean_flow_L_per_min"]
    if not np.isfinite(time):
        raise ValueError(f"{log.path} does not rest for half a second before its turn; record it again")
    turn = Turn("left" if sign > 0 else "right", 100.0 * abs(signal))
    return MeasuredTurn(log.path.name, turn, time, flow, figures, angle[: log.rest])


def _ramp(log: Log, steering: NDArray[np.float64]) -> MeasuredRamp:
    """End of the dead band: the flow grows in proportion to the voltage beyond it, so the travel grows with its square, and
    the parabola's vertex is the end. What compliance takes at first shifts the parabola upwards alone."""
    sides = np.unique(np.sign(steering[steering != 0.0]))
    volts = published("full_signal") * np.abs(steering)
    if len(sides) != 1:
        raise ValueError(
            f"{log.path} steers to both sides; the published procedure reads full turns, whose signal holds, slow ramps to "
            "one side and straight drives; leave it out"
        )
    travel = sides[0] * (log.channels["joint_angle"][1:] - log.start_angle)
    top = int(np.argmax(volts)) + 1  # a ramp may come down again
    used = np.flatnonzero((travel[:top] > RAMP_TRAVEL[0]) & (travel[:top] < RAMP_TRAVEL[1]) & (volts[:top] < RAMP_END))
    if len(used) < LEAST_SAMPLES:
        raise ValueError(
            f"{log.path} has {len(used)} samples between {RAMP_TRAVEL[0] / DEGREE:.2g} and {RAMP_TRAVEL[1] / DEGREE:.2g}° "
            f"of travel below {RAMP_END:g} V, but the dead band needs {LEAST_SAMPLES}; ramp more slowly, away from the stop"
        )
    rate = float(volts[used[-1]] - volts[used[0]]) / (TICK * float(used[-1] - used[0]))
    if not 0.0 < rate <= FASTEST_RAMP:
        raise ValueError(
            f"{log.path}: the signal changes by {rate:.3g} V/s where the joint begins to move, but a ramp by "
            f"{FASTEST_RAMP:g} V/s at most; ramp more slowly, or leave it out"
        )
    (square, slope, _), covariance = np.polyfit(volts[used], travel[used], 2, cov=True)
    if square <= 0.0:
        raise ValueError(f"{log.path}: the joint does not move faster as the signal grows; ramp further")
    gradient = np.array([slope / (2.0 * square**2), -0.5 / square, 0.0])
    std = float(np.sqrt(gradient @ covariance @ gradient))
    return MeasuredRamp(log.path.name, "left" if sides[0] > 0 else "right", float(-0.5 * slope / square), std)


def _drive(log: Log) -> MeasuredDrive:
    """Pressure that a straight drive takes. Both lines hold the charge's pressure at rest, so what their sensors differ by
    there is a zero error."""
    missing = [n for n in ("drive_pressure_forward", "drive_pressure_return") if n not in log.channels]
    if missing or not np.any(log.commands.get("drive_signal", 0.0)):
        raise ValueError(
            f"{log.path} steers nowhere, so it is read as a straight drive, but "
            + (f"{missing[0]} is missing" if missing else "drive_signal stays at zero")
        )
    last = max(round(STEADY_DRIVE / TICK), LEAST_SAMPLES)
    driving = np.flatnonzero(log.commands["drive_signal"])
    end = int(driving[-1]) + 2
    difference = log.channels["drive_pressure_forward"] - log.channels["drive_pressure_return"]
    needed = np.mean(difference[max(end - last, 0) : end]) - np.mean(difference[: log.rest])
    return MeasuredDrive(log.path.name, abs(float(needed)) / BAR)
