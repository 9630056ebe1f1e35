"""Noise of sensors, as the standstill that every recording begins with shows it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.diagnosis.recording import Recording
from aoro_gym.sensors.standstill import ORDER, autoregression
from aoro_gym.units import BAR

Floats = NDArray[np.floating[Any]]
"""Arrays of float64."""

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
    measured, weights = autoregression(segments, order)
    covariance = np.concatenate([measured, np.zeros(max(lags - order, 0))])
    for k in range(order + 1, len(covariance)):
        covariance[k] = weights @ covariance[k - order : k][::-1]
    covariance[0] += least
    return Noise(covariance)
