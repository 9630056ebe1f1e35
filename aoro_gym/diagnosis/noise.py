"""What may part a recording from a perfect twin without a cause: noise of the sensors, and the twin's own error.

Residuals are whitened with the covariance of both. Noise is an autoregressive process, fitted to the standstill that
every recording begins with (Burg 1975: short stretches, sharp lines), and a zero that wanders as slowly as only the residual
of a whole recording shows. The twin's own error is taken as relative: of the joint's rate, which the angle then integrates
and which shifts the pressures in time, and of each pressure's excursion, both wandering as Ornstein–Uhlenbeck processes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular, toeplitz
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from aoro_gym.diagnosis.recording import TICK, Recording
from aoro_gym.units import BAR

Floats = NDArray[np.floating[Any]]
"""Arrays of float64."""

ORDER = 12
"""Of the autoregressive noise: holds a line at 6 Hz and its neighbours at 100 samples a second."""

LEAST: Mapping[str, float] = {
    "joint_angle": np.radians(0.01),
    "pressure_a": 0.1 * BAR,
    "pressure_b": 0.1 * BAR,
    "pump_pressure": 0.1 * BAR,
    "drive_pressure_forward": 0.1 * BAR,
    "drive_pressure_return": 0.1 * BAR,
    "engine_speed": 0.2,
}
"""Least white noise [SI]: rounding of logs and of the twin's single precision."""

RATE_MEMORY = 0.15
"""Time [s] over which the twin's error of the joint's rate wanders."""
PRESSURE_MEMORY = 0.04
"""The same of its pressures."""
MERGED = 2
"""Samples that are averaged before anything is compared: fifty a second show all that a joint of ten tonnes does."""
SWING = 21
"""Samples over which a pressure's swing is taken."""
NOISY_SWING = 5.0
"""Standard deviations of noise that a swing may have of noise alone; 3.8 are expected of :data:`SWING` normal samples."""
ENVELOPE = 15
"""Samples over which the size of a residual is taken."""
WANDERING = 1.2
"""Memory [s] of a sensor's zero that wanders: an order of the engine's speed close to the sampling rate appears as a beat of
some seconds, which no standstill of a second shows."""


@dataclass(frozen=True)
class ModelError:
    """Relative standard deviations of the twin's own error: of the joint's rate, of each pressure's excursion, of its swing
    within a fifth of a second, of what the recording shows beyond the prediction, as no twin has a deviation exactly as
    the machine has it, and of the time since the last event, as a twin that sways a little faster is soon out of phase."""

    rate: float
    pressure: float
    swing: float = 0.0
    change: float = 0.0
    phase: float = 0.0
    rough: bool = False  # stays as large as it is, however well the twin does
    sways: float = 0.0  # least factor on swing and phase, however well the twin does

    def scaled(self, factor: float) -> ModelError:
        """All but what is seen beyond the prediction times ``factor``."""
        sizes = {name: factor * getattr(self, name) for name in ("rate", "pressure", "swing", "phase")}
        return replace(self, **sizes)

    def found(self, factor: float) -> ModelError:
        """As it is where the twin turned out to err by ``factor`` of what was assumed, but no less than :attr:`sways` of it
        in how far and how fast pressures sway."""
        found = self.scaled(max(factor, 1.0) if self.rough else factor)
        kept = self.scaled(self.sways)
        return replace(found, swing=max(found.swing, kept.swing), phase=max(found.phase, kept.phase))


EXACT = ModelError(rate=0.0, pressure=0.0)
"""Of who knows the machine's laws: there is noise alone."""


@dataclass(frozen=True)
class Noise:
    """Autocovariance [SI²] of one channel's noise, from lag 0 on."""

    covariance: Floats

    @property
    def std(self) -> float:
        return float(np.sqrt(self.covariance[0]))

    def inflated(self, factor: float) -> Noise:
        """Noise of ``factor`` times the power."""
        return Noise(factor * self.covariance)

    def merged(self, count: int) -> Floats:
        """Covariance (count, count) of averaged samples."""
        within = np.arange(MERGED)
        lags = MERGED * np.arange(count)[:, None, None] + within[:, None] - within
        return toeplitz(self.covariance[np.abs(lags)].mean(axis=(1, 2)))

    def wandering(self, std: float) -> Noise:
        """The same with a zero that wanders [SI] as an Ornstein–Uhlenbeck process."""
        return Noise(self.covariance + std**2 * np.exp(-TICK / WANDERING * np.arange(len(self.covariance))))


def noise_of(recordings: Sequence[Recording], channel: str, lags: int) -> Noise:
    """Noise of a channel from the standstill of all ``recordings`` together, for at least ``lags`` lags."""
    segments = [r.channels[channel][: r.rest] for r in recordings if channel in r.channels]
    segments = [segment - np.mean(segment) for segment in segments if len(segment) >= 8]
    least = LEAST[channel] ** 2
    order = min(ORDER, min((len(segment) for segment in segments), default=0) // 3)
    if order < 1:
        return Noise(np.r_[least, np.zeros(lags)])
    measured, weights = _burg(segments, order)
    covariance = np.concatenate([measured, np.zeros(max(lags - order, 0))])
    for k in range(order + 1, len(covariance)):
        covariance[k] = weights @ covariance[k - order : k][::-1]
    covariance[0] += least
    return Noise(covariance)


def _burg(segments: Sequence[Floats], order: int) -> tuple[Floats, Floats]:
    """Autocovariance (order + 1,) and weights (order,) of the autoregressive process of several segments."""
    forward, backward = list(segments), list(segments)
    power = sum(float(s @ s) for s in segments) / sum(len(s) for s in segments)
    covariance, left = [power], power
    polynomial = np.ones(1)
    for m in range(1, order + 1):
        ahead, behind = [f[1:] for f in forward], [b[:-1] for b in backward]
        both = sum(float(f @ f + b @ b) for f, b in zip(ahead, behind, strict=True))
        reflection = -2.0 * sum(float(f @ b) for f, b in zip(ahead, behind, strict=True)) / both if both > 0.0 else 0.0
        covariance.append(-reflection * left - float(polynomial[1:] @ np.array(covariance[m - 1 : 0 : -1])))
        padded = np.append(polynomial, 0.0)
        polynomial = padded + reflection * padded[::-1]
        left *= 1.0 - reflection**2
        forward = [f + reflection * b for f, b in zip(ahead, behind, strict=True)]
        backward = [b + reflection * f for f, b in zip(ahead, behind, strict=True)]
    return np.array(covariance), -polynomial[1:]


@dataclass(frozen=True)
class Whitener:
    """Makes the residual (F,) or (F, N) of one channel of one recording white with unit variance, after it has averaged
    every :data:`MERGED` samples."""

    factor: Floats  # lower Cholesky factor of the covariance (n, n) of what counts
    counts: NDArray[np.bool_]  # (F // MERGED,)

    def __call__(self, residual: Floats) -> Floats:
        return solve_triangular(self.factor, merged(residual)[self.counts], lower=True, check_finite=False)


def merged(values: Floats) -> Floats:
    """Means over :data:`MERGED` samples along the first axis; what is left over is dropped."""
    count = len(values) // MERGED
    return values[: count * MERGED].reshape(count, MERGED, *values.shape[1:]).mean(axis=1)


def whitener(
    noise: Noise,
    channel: str,
    predicted: Floats,
    error: ModelError,
    *,
    seen: Floats | None = None,
    repeats: float = np.inf,
    since: Floats | None = None,
    counts: NDArray[np.bool_] | None = None,
    healthy: Floats | None = None,
) -> Whitener:
    """Whitener of a channel whose twin shows ``predicted`` (F,) SI.

    Args:
        noise: Of the channel.
        channel: Its name.
        predicted: SI.
        error: The twin's own.
        seen: Residual (F,) SI: what there is beyond the prediction, with noise.
        repeats: Recordings whose mean residual was subtracted; its noise adds to this one's.
        since: Time (F,) [s] since the last event, by default that since the first sample.
        counts: Samples (F,) that are compared; all by default.
        healthy: What the healthy machine showed (F,) SI: where it sways more than the twin, that much is as uncertain.
    """
    count = len(predicted)
    wander, delay, memory = (known[:count, :count] for known in _correlations(1 << (count - 1).bit_length()))
    change = np.gradient(predicted)  # a tick
    covariance = (1.0 + 1.0 / repeats) * noise.merged(count // MERGED)
    if channel == "joint_angle":
        rates = np.outer(error.rate * change, error.rate * change) * wander
        covariance += merged(np.cumsum(merged(np.cumsum(rates, axis=0)), axis=1).T)
        spread, memory = np.zeros(count), wander
    else:
        # a motion that runs late shows its pressures late, by the integral of the rate's error
        covariance += _varying(error.rate * change[None], delay)
        spread = error.pressure * maximum_filter1d(np.abs(predicted - predicted[0]), 9)
        swing, pace = _swing(predicted), _pace(predicted)
        if healthy is not None:
            swing = np.maximum(swing, _swing(healthy) - NOISY_SWING * noise.std)
            pace = np.maximum(pace, _pace(healthy))
        time = TICK * np.arange(count) if since is None else since
        late = error.phase * time / TICK * pace
        spread += error.swing * swing + np.minimum(late, 0.5 * swing)
    wandering = [spread]
    if seen is not None and error.change > 0.0:
        envelope = error.change * _envelope(seen, np.sqrt(1.0 + 1.0 / repeats) * noise.std)
        signed = merged(np.clip(error.change * uniform_filter1d(seen, ENVELOPE), -envelope, envelope))
        # half of the error wanders, half is a size that is wrong throughout
        wandering.append(np.sqrt(0.5) * envelope)
        covariance += 0.5 * np.outer(signed, signed)
    covariance += _varying(np.stack(wandering), memory)
    if counts is None:
        kept = np.ones(count // MERGED, dtype=bool)
    else:
        kept = counts[: count // MERGED * MERGED : MERGED]
        covariance = covariance[np.ix_(kept, kept)]
    return Whitener(cholesky(covariance, lower=True, overwrite_a=True, check_finite=False), kept)


@lru_cache(maxsize=4)
def _correlations(count: int) -> tuple[Floats, Floats, Floats]:
    """Between samples, each (count, count): of the rate's error, of its integral [tick²] and of a pressure's error."""
    lag = TICK * np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    wander = np.exp(-lag / RATE_MEMORY)
    return wander, np.cumsum(np.cumsum(wander, axis=0), axis=1), np.exp(-lag / PRESSURE_MEMORY)


def _varying(sizes: Floats, correlation: Floats) -> Floats:
    """Covariance (n, n) of merged samples of the sum of independent errors that have these ``sizes`` (k, F), standard
    deviations, and one ``correlation`` (F, F)."""
    count = len(correlation) // MERGED
    total = np.zeros((count, count))
    for a in range(MERGED):
        for b in range(a + 1):
            one, other = (sizes[:, first : count * MERGED : MERGED] for first in (a, b))
            part = one.T @ other
            part *= correlation[a : count * MERGED : MERGED, b : count * MERGED : MERGED]
            total += part
            if a != b:
                total += part.T
    return total / MERGED**2


def _swing(values: Floats) -> Floats:
    """Largest less least value (F,) within :data:`SWING` samples."""
    return maximum_filter1d(values, SWING) - minimum_filter1d(values, SWING)


def _pace(values: Floats) -> Floats:
    """Largest change a tick (F,) within :data:`SWING` samples."""
    return maximum_filter1d(np.abs(np.gradient(values)), SWING)


def _envelope(seen: Floats, noise: float) -> Floats:
    """Size (F,) of what a residual shows beyond its noise: root of the mean square over :data:`ENVELOPE` samples."""
    power = np.maximum(uniform_filter1d(np.square(seen), ENVELOPE) - noise**2, 0.0)
    # a mean of ENVELOPE squares scatters; what noise alone gives once in a thousand times does not count
    doubtful = 3.0 * np.sqrt(2.0 / ENVELOPE) * noise**2
    return maximum_filter1d(np.sqrt(np.maximum(power - doubtful, 0.0)), ENVELOPE)
