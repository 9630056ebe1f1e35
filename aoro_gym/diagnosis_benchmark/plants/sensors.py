"""What the plants' loggers write: sensors with delay, lag, noise and quantisers, 100 samples a second, drawn by a seed.

The engine's orders are on the angle's wire as they are (no filter against aliases), so orders 3½ and 4 of about 1595 rpm
appear near 6 Hz.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import butter, lfilter, sosfiltfilt

from aoro_gym.diagnosis_benchmark.plants.fluid import Array, Constants

RATE = 100.0
"""Samples a second [Hz] of the logger."""

WOBBLE_PERIODS = 12
"""Periods a turn of the angle's periodic error."""

HIGHEST_CORNER = 0.45 * RATE
"""Frequency of half gain [Hz] from which a logger's low-pass changes nothing that 100 Hz can show."""


@dataclass(frozen=True)
class SensorNoise:
    """What sensors add; rms or amplitude, SI. The angle's figures follow the published swing of the filtered flow, about
    12 to 18 L/min peak to peak; the others are common industrial sensors (estimates)."""

    angle_orders: tuple[tuple[float, float], ...] = (
        (1.0, 2.2e-4), (3.5, 1.1e-3), (3.75, 7e-4), (4.0, 1.1e-3),
    )  # of the engine's speed; amplitude [rad]  # fmt: skip
    angle_lines: tuple[tuple[float, float, float], ...] = ((14.0, 16.0, 4e-4), (28.0, 33.0, 2e-4))  # [Hz], [Hz], [rad]
    angle_white: float = 4e-4  # [rad]
    angle_bits: int = 12  # a turn; 0: none
    pressure_zero: float = 1e5  # [Pa]
    pressure_white: float = 0.2e5
    pressure_step: float = 400e5 / 4096.0
    speed_step: float = 1.0 * np.pi / 30.0  # [rad/s] of the engine
    wheel_white: float = 5e-3  # [rad/s]

    @classmethod
    def none(cls) -> SensorNoise:
        """Exact sensors."""
        return cls((), (), 0.0, 0, 0.0, 0.0, 0.0, 0.0, 0.0)


def angle_chain(time: Array, angle: Array, constants: Constants) -> Array:
    """What the angle sensor shows (F, R), without noise, of the true ``angle`` (F, R) at evenly spaced ``time`` (F,):
    periodic error, gain, first-order lag, delay. Between samples the angle is a straight line; before them it rested."""
    step = time[1] - time[0]
    value = angle + constants["sensor.wobble"] * np.sin(WOBBLE_PERIODS * angle)
    value = (1.0 + constants["sensor.gain_error"]) * value
    for run in np.flatnonzero(constants["sensor.lag"] > 0.0):
        # exact for inputs that are straight lines between samples
        constant = constants["sensor.lag"][run]
        decay = np.exp(-step / constant)
        share = constant / step * (1.0 - decay)
        start = value[0, run]
        value[:, run] = start + lfilter([1.0 - share, share - decay], [1.0, -decay], value[:, run] - start)
    for run in np.flatnonzero(constants["sensor.delay"] > 0.0):
        value[:, run] = np.interp(time - constants["sensor.delay"][run], time, value[:, run])
    return value


def smoothed(series: Array, half_gain: Array, level: int) -> Array:
    """``series`` (F, R) at :data:`RATE` behind a zero-phase low-pass whose gain is ½ at 1/(2π ``half_gain``) Hz, (R,).

    Level 0: Butterworth of fourth order, forward and backward. The others: a Gaussian window.
    """
    result = series.copy()
    for run in np.flatnonzero(half_gain > 1.0 / (2.0 * np.pi * HIGHEST_CORNER)):
        if level == 0:
            sections = butter(4, 1.0 / (2.0 * np.pi * half_gain[run]), fs=RATE, output="sos")
            pad = min(int(RATE), len(series) - 1)
            result[:, run] = sosfiltfilt(sections, series[:, run], padtype="constant", padlen=pad)
        else:
            width = np.sqrt(2.0 * np.log(2.0)) * half_gain[run] * RATE
            result[:, run] = gaussian_filter1d(series[:, run], width, mode="nearest", truncate=6.0)
    return result


def half_gain_time(smoothing: Array, level: int) -> Array:
    """1/(2π f) [s] of the frequency of half gain that :func:`smoothed` shows on an impulse; 0 where it changes nothing."""
    count = 4096
    impulse = np.zeros((count, len(smoothing)))
    impulse[count // 2] = 1.0
    gain = np.abs(np.fft.rfft(smoothed(impulse, smoothing, level), axis=0))
    frequency = np.fft.rfftfreq(count, 1.0 / RATE)
    found = np.zeros(len(smoothing))
    for run in np.flatnonzero(gain[-1] < 0.5):
        after = int(np.argmax(gain[:, run] < 0.5))
        share = (gain[after - 1, run] - 0.5) / (gain[after - 1, run] - gain[after, run])
        found[run] = 1.0 / (2.0 * np.pi * (frequency[after - 1] + share * (frequency[1] - frequency[0])))
    return found


def measured(
    time: Array,
    outputs: Mapping[str, Array],
    constants: Constants,
    level: int,
    seeds: Sequence[int],
    noise: SensorNoise | None = None,
) -> tuple[Array, dict[str, Array]]:
    """Ticks [s] (K,) and what the sensors show of ``outputs`` (F, R), SI, each (K, R).

    Args:
        time: Instants [s] (F,), evenly spaced, a whole number of them a tick.
        outputs: By name, ``joint_angle``, pressures, ``engine_speed`` (needed for its orders), wheel rates.
        constants: Of the plants.
        level: Of the plants.
        seeds: One a run: draws all that is random about it.
        noise: What sensors add; the published kind by default.
    """
    added = SensorNoise() if noise is None else noise
    step = time[1] - time[0]
    every = round(1.0 / RATE / step)
    if abs(every * step * RATE - 1.0) > 1e-6:
        raise ValueError(f"outputs every {step:g} s do not hold the logger's {RATE:g} Hz; keep one a millisecond")
    ticks = time[::every]
    runs = len(seeds)
    turned = np.concatenate([np.zeros((1, runs)), np.cumsum(outputs["engine_speed"][:-1] * step, axis=0)])[::every]
    shown: dict[str, Array] = {}
    for name in outputs:
        value = angle_chain(time, outputs[name], constants) if name == "joint_angle" else outputs[name].copy()
        value = value[::every]
        for run, seed in enumerate(seeds):
            rng = np.random.default_rng([seed, *name.encode()])  # a stream a channel, whichever others there are
            value[:, run] += _noise(name, added, ticks, turned[:, run], rng)
        if name == "joint_angle" or "pressure" in name:
            if "pressure" in name and added.pressure_step:
                value = np.maximum(value, 0.0)
            value = smoothed(_quantised(value, _resolution(name, added)), constants["sensor.smoothing"], level)
        else:
            value = _quantised(value, _resolution(name, added))
        shown[name] = value
    return ticks, shown


def _noise(name: str, noise: SensorNoise, ticks: Array, turned: Array, rng: np.random.Generator) -> Array:
    """Draws what holds for a run first, then a number a sample, so that a longer run begins as a shorter one."""
    if name == "joint_angle":
        total = np.zeros(len(ticks))
        for order, amplitude in noise.angle_orders:
            total += amplitude * np.sin(order * turned + rng.uniform(0.0, 2.0 * np.pi))
        for low, high, amplitude in noise.angle_lines:
            frequency, phase = rng.uniform(low, high), rng.uniform(0.0, 2.0 * np.pi)
            total += amplitude * np.sin(2.0 * np.pi * frequency * ticks + phase)
        return total + noise.angle_white * rng.standard_normal(len(ticks))
    if "pressure" in name:
        zero = noise.pressure_zero * rng.standard_normal()
        return zero + noise.pressure_white * rng.standard_normal(len(ticks))
    return (noise.wheel_white if name.startswith("wheel_rate") else 0.0) * rng.standard_normal(len(ticks))


def _resolution(name: str, noise: SensorNoise) -> float:
    if name == "joint_angle":
        return 2.0 * np.pi / 2**noise.angle_bits if noise.angle_bits else 0.0
    if "pressure" in name:
        return noise.pressure_step
    return noise.speed_step if name == "engine_speed" else 0.0


def _quantised(value: Array, step: float) -> Array:
    return step * np.round(value / step) if step else value
