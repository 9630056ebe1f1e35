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

from aoro_gym.diagnosis_benchmark.plants.records import Array, Constants

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
    value = (1.0 + constants["sensor.gain_error"]) * (
        angle + constants["sensor.wobble"] * np.sin(WOBBLE_PERIODS * angle)
    )
    for run in np.flatnonzero(constants["sensor.lag"] > 0.0):
        # exact for inputs that are straight lines between samples
        constant = constants["sensor.lag"][run]
        decay = np.exp(-step / constant)
        share = constant / step * (1.0 - decay)
        start = value[0, run]
        value[:, run] = start + lfilter([1.0 - share, share - decay], [1.0, -decay], value[:, run] - start)
    late = np.flatnonzero(constants["sensor.delay"] > 0.0)
    place = np.maximum(np.arange(len(time))[:, None] - constants["sensor.delay"][late] / step, 0.0)
    before = place.astype(np.int64)
    after = np.minimum(before + 1, len(time) - 1)
    share = place - before
    value[:, late] = (1.0 - share) * value[before, late] + share * value[after, late]
    return value


def smoothed(series: Array, half_gain: Array, level: int, lengths: Sequence[int] | None = None) -> Array:
    """``series`` (F, R) at :data:`RATE` behind a zero-phase low-pass whose gain is ½ at 1/(2π ``half_gain``) Hz, (R,); of
    runs that have ended earlier their ``lengths`` alone.

    Level 0: Butterworth of fourth order, forward and backward. The others: a Gaussian window.
    """
    result = series.copy()
    for run in np.flatnonzero(half_gain > 1.0 / (2.0 * np.pi * HIGHEST_CORNER)):
        count = len(series) if lengths is None else lengths[int(run)]
        if level == 0:
            sections = butter(4, 1.0 / (2.0 * np.pi * half_gain[run]), fs=RATE, output="sos")
            pad = min(int(RATE), count - 1)
            result[:count, run] = sosfiltfilt(sections, series[:count, run], padtype="constant", padlen=pad)
        else:
            width = np.sqrt(2.0 * np.log(2.0)) * half_gain[run] * RATE
            result[:count, run] = gaussian_filter1d(series[:count, run], width, mode="nearest", truncate=6.0)
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
    outputs: Mapping[str, Array],
    constants: Constants,
    level: int,
    seeds: Sequence[int],
    noise: SensorNoise | None = None,
    lengths: Sequence[int] | None = None,
) -> dict[str, Array]:
    """What the sensors show of ``outputs``, SI, each (K, R), a tick of the logger a row.

    Args:
        outputs: By name, pressures, ``engine_speed``, wheel rates at the ticks (K, R), and ``joint_angle`` a whole number of
            times a tick (F, R). ``engine_angle`` [rad] at the ticks is needed for the angle's orders.
        constants: Of the plants.
        level: Of the plants.
        seeds: One a run: draws all that is random about it.
        noise: What sensors add; the published kind by default.
        lengths: Ticks of each run; what is shown after them means nothing. All by default.
    """
    added = SensorNoise() if noise is None else noise
    turned = outputs["engine_angle"]
    ticks = np.arange(len(turned)) / RATE
    samples = len(outputs["joint_angle"])
    every, apart = divmod(samples - 1, len(turned) - 1)
    if apart:
        raise ValueError(
            f"joint angle has {samples} samples, but must have a whole number of them between {len(turned)} ticks"
        )
    fine = np.arange(samples) / (RATE * every)
    shown: dict[str, Array] = {}
    for name in outputs:
        if name == "engine_angle":
            continue
        value = angle_chain(fine, outputs[name], constants)[::every] if name == "joint_angle" else outputs[name]
        value = value + _noise(name, added, ticks, turned, seeds)
        if "pressure" in name and added.pressure_step:
            value = np.maximum(value, 0.0)
        value = _quantised(value, _resolution(name, added))
        filtered = name == "joint_angle" or "pressure" in name
        shown[name] = smoothed(value, constants["sensor.smoothing"], level, lengths) if filtered else value
    return shown


def _noise(name: str, noise: SensorNoise, ticks: Array, turned: Array, seeds: Sequence[int]) -> Array | float:
    """Noise (K, R) of a channel: draws what holds for a run first, then a number a sample, so that a longer run begins as a
    shorter one; a stream a run and channel, whichever others there are."""
    pressure, angle = "pressure" in name, name == "joint_angle"
    white = noise.pressure_white if pressure else noise.angle_white if angle else 0.0
    if name.startswith("wheel_rate"):
        white = noise.wheel_white
    orders, lines = (noise.angle_orders, noise.angle_lines) if angle else ((), ())
    if not (white or orders or lines or (pressure and noise.pressure_zero)):
        return 0.0
    uniform, offset = np.empty((len(orders) + 2 * len(lines), len(seeds))), np.zeros(len(seeds))
    total = np.empty((len(ticks), len(seeds)))
    for run, seed in enumerate(seeds):
        rng = np.random.default_rng([seed, *name.encode()])
        uniform[:, run] = rng.random(len(uniform))
        if pressure:
            offset[run] = noise.pressure_zero * rng.standard_normal()
        total[:, run] = rng.standard_normal(len(ticks))
    total = offset + white * total
    for (order, amplitude), phase in zip(orders, uniform, strict=False):
        total += amplitude * np.sin(order * turned + 2.0 * np.pi * phase)
    for index, (low, high, amplitude) in enumerate(lines):
        share, phase = uniform[len(orders) + 2 * index : len(orders) + 2 * index + 2]
        total += amplitude * np.sin(2.0 * np.pi * (np.outer(ticks, low + (high - low) * share) + phase))
    return total


def _resolution(name: str, noise: SensorNoise) -> float:
    if name == "joint_angle":
        return 2.0 * np.pi / 2**noise.angle_bits if noise.angle_bits else 0.0
    if "pressure" in name:
        return noise.pressure_step
    return noise.speed_step if name == "engine_speed" else 0.0


def _quantised(value: Array, step: float) -> Array:
    return step * np.round(value / step) if step else value
