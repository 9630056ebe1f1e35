"""Noise of sensors: an autoregressive process, fitted to the standstill that every recording begins with (Burg 1975: short
stretches, sharp lines)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.diagnosis.recording import Recording
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


@dataclass(frozen=True)
class Noise:
    """Autocovariance [SI²] of one channel's noise, from lag 0 on."""

    covariance: Floats

    @property
    def std(self) -> float:
        return float(np.sqrt(self.covariance[0]))


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
