"""What every effect and every nuisance adds to the recordings of full turns to the left and back, by family of laws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aoro_gym import Machine, Twin
from aoro_gym.diagnosis.noise import Floats
from aoro_gym.diagnosis.nuisances import Nuisances
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.sensors import JointAngleNoise, PressureNoise
from aoro_gym.terrains.plane import Plane
from aoro_gym.validation.theory.sensitivities import Change
from aoro_gym.validation.turns import stacked

Holds = Mapping[float, tuple[float, float]]
"""Times [s] for which a signal is given to the left and then to the right, by level."""
HOLD: Holds = {1.0: (2.8, 3.0), 0.75: (3.6, 4.6), 0.5: (9.5, 16.0)}
"""Those in which the slowest machine comes to its stop."""
REST = 0.6
"""Standstill [s] before, between and after both turns."""
AT_STOP = 0.01
"""Angle [rad] from its stop at which a joint has arrived."""
TICK = 0.01
"""Sampling interval [s] of the log."""
DAY = "day"
"""Spread of the nuisances: a commissioned machine on another day."""
STEP = 0.5
"""Finite difference of a nuisance, in prior standard deviations."""
START_JITTER = 1e-3
"""Standard deviation [s] of a recording's clock against its commands."""
ZEROS: Mapping[str, float] = {
    "joint_angle": np.radians(0.03), "pressure_a": 1e5, "pressure_b": 1e5, "pump_pressure": 1e5,
}  # fmt: skip
"""Standard deviation [SI] of a sensor's zero, anew in each recording: a quarter of a per cent of 400 bar."""
ROUNDING = ("frame.front.mass", 1e-6)
"""Parameter and relative change of it that stand for a change of a few roundings."""

_ANGLE, _PRESSURE = JointAngleNoise.published(), PressureNoise.typical()
_LINES = sum(line.amplitude**2 / 2.0 for line in _ANGLE.lines)
_OF_PRESSURE = float(np.hypot(_PRESSURE.white, _PRESSURE.resolution / np.sqrt(12.0)))
NOISE: Mapping[str, float] = {
    "joint_angle": float(np.sqrt(_LINES + _ANGLE.white**2 + _ANGLE.resolution**2 / 12.0)),
    "pressure_a": _OF_PRESSURE,
    "pressure_b": _OF_PRESSURE,
    "pump_pressure": _OF_PRESSURE,
}
"""Standard deviation [SI] of a sample of each channel: lines, white noise and rounding of its sensor."""


@dataclass(frozen=True, eq=False)
class Responses:
    """Differences from the machine as it is, in standard deviations of the noise: (..., channels, frames), the frames of all
    levels one after the other."""

    nominal: Floats  # (C, F), the recording itself
    sizes: Mapping[str, Floats]  # (E, C, F) by name of the size of the changes
    nuisances: Floats  # (K, C, F) a prior standard deviation
    rounding: Floats  # (C, F)
    frames: tuple[int, ...]  # of each level
    turning: NDArray[np.bool_]  # (F,), whether between a command and the first arrival at a stop of any machine


def typical(change: Change) -> Change:
    """The change with its magnitude half way to the farther end of its range, on its scale."""
    effect = EFFECTS[change.effect]
    index = [one.name for one in effect.magnitudes].index(change.magnitude)
    one = effect.magnitudes[index]
    if one.scale == "log":
        size = np.sqrt(one.none * max(one.high, one.low, key=lambda end: abs(np.log(end / one.none))))
    else:
        size = 0.5 * (one.none + max(one.high, one.low, key=lambda end: abs(end - one.none)))
    size = tuple(float(size) if at == index else other.none for at, other in enumerate(effect.magnitudes))
    return Change(change.effect, change.magnitude, (size,), change.unit)


def turned(
    machine: Machine, plane: Plane, level: float, hold: tuple[float, float], device: str
) -> tuple[dict[str, Floats], NDArray[np.bool_]]:
    """Channels (F, L) [SI] of L machines that turn left at a signal and back again, and whether they are turning (F,).

    Args:
        machine: L variants.
        plane: Under each of them.
        level: Steering signal.
        hold: Times [s] that it is given for, to the left and to the right.
        device: ``"cpu"`` or ``"cuda:N"``.
    """
    reach = np.broadcast_to(machine.joint.range, machine.num_variants)
    twin = Twin(machine.num_variants, machine=machine, terrain=plane, device=device, check_step=False)
    twin.reset(joint_angle=-reach)
    parts, turning = [], []
    for side, duration in ((0, REST), (1, hold[0]), (0, REST), (-1, hold[1]), (0, REST)):
        trace = twin.step({"steering_signal": side * level}, duration, sample_every=TICK)
        assert trace is not None
        parts.append({name: trace[name].astype(np.float64) for name in NOISE})
        arrived = np.any(reach - side * parts[-1]["joint_angle"] < AT_STOP, axis=1)
        turning.append((side != 0) & ~np.logical_or.accumulate(arrived))
    if twin.diverged:
        raise RuntimeError(f"twins diverged: {twin.diverged}")
    return {name: np.concatenate([part[name] for part in parts]) for name in NOISE}, np.concatenate(turning)


def responses(
    machine: Machine,
    changes: Mapping[str, Sequence[Change]],
    holds: Holds = HOLD,
    *,
    device: str = "cpu",
) -> Responses:
    """Responses of one machine, each level's lanes side by side in one twin.

    Args:
        machine: One variant.
        changes: By the name of their size; a change with two sides counts with half of their difference.
        holds: Times [s] that a signal is given for, by level.
        device: ``"cpu"`` or ``"cuda:N"``.
    """
    lanes = [(one.effect, size) for some in changes.values() for one in some for size in one.sizes]
    known = Nuisances(machine, DAY)
    steps = STEP * np.diag(np.where(known.place + STEP * known.std <= 1.0, 1.0, -1.0))
    key, share = ROUNDING
    machines = [machine, machine.set({key: machine.value(key) * (1.0 + share)}, si=True, check_ranges=False)]
    machines += [EFFECTS[name].apply(machine, *size) for name, size in lanes]
    batch = stacked([*machines, known.machines(steps)])
    slopes = [EFFECTS[name].tilt(Plane(), *size) for name, size in lanes]
    slope, direction = np.zeros((2, batch.num_variants))
    slope[2 : len(machines)] = [float(np.asarray(one.slope_deg)) for one in slopes]
    direction[2 : len(machines)] = [float(np.asarray(one.direction_deg)) for one in slopes]
    levels, turning = [], []
    for level, hold in holds.items():
        signals, moving = turned(batch, Plane(slope_deg=slope, direction_deg=direction), level, hold, device)
        turning.append(moving)
        for lane, (name, size) in enumerate(lanes, 2):
            logged = EFFECTS[name].record({k: v[:, lane : lane + 1] for k, v in signals.items()}, 1.0 / TICK, *size)
            for channel in signals:
                signals[channel][:, lane] = logged[channel][:, 0]
        levels.append(np.stack([(signals[name] / NOISE[name]).T for name in NOISE], axis=1))
    shown = np.concatenate(levels, axis=2)  # (L, C, F)
    moved = shown - shown[0]
    sizes, lane = {}, 2
    for name, some in changes.items():
        rows = []
        for one in some:
            rows.append(moved[lane] if len(one.sizes) == 1 else 0.5 * (moved[lane] - moved[lane + 1]))
            lane += len(one.sizes)
        sizes[name] = np.stack(rows)
    frames = tuple(level.shape[2] for level in levels)
    of_machine = moved[lane:] / np.diag(steps)[:, None, None]
    nuisances = np.concatenate([of_machine, recorder(shown[0], frames)])
    return Responses(shown[0], sizes, nuisances, moved[1], frames, np.concatenate(turning))


def recorder(nominal: Floats, frames: Sequence[int]) -> Floats:
    """What the clock and the sensors' zeros, anew in each recording, add to it a prior standard deviation: (K, C, F)."""
    rows, begin = [], 0
    for count in frames:
        part = np.s_[begin : begin + count]
        late = np.zeros_like(nominal)
        late[:, part] = START_JITTER / TICK * np.gradient(nominal[:, part], axis=1)
        rows.append(late)
        for at, (name, noise) in enumerate(NOISE.items()):
            zero = np.zeros_like(nominal)
            zero[at, part] = ZEROS[name] / noise
            rows.append(zero)
        begin += count
    return np.stack(rows)
