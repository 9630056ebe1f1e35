"""Noise and the twin's own error: fitted to standstill, and whitened away."""

from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from aoro_gym.diagnosis.noise import (
    LEAST,
    PRESSURE_MEMORY,
    RATE_MEMORY,
    ModelError,
    Noise,
    noise_of,
    whitener,
)
from aoro_gym.diagnosis.recording import TICK, Recording
from aoro_gym.sensors.joint_angle import JointAngleSensor

NONE = ModelError(0.0, 0.0)


def recording(angle: np.ndarray, rest: int) -> Recording:
    return Recording("log", np.zeros((len(angle) - 1, 2)), {"joint_angle": angle}, rest, float(angle[0]))


def autoregressive(rng: np.random.Generator, count: int, runs: int) -> Any:
    """x_k = 1.5 x_{k−1} − 0.9 x_{k−2} + w: a line near 11 Hz at 100 samples a second."""
    return lfilter([1.0], [1.0, -1.5, 0.9], 1e-2 * rng.standard_normal((count + 500, runs)), axis=0)[500:]


def test_autocovariance_of_a_known_process_is_found_and_continued():
    rng = np.random.default_rng(1)
    samples = autoregressive(rng, 400, 40)
    noise = noise_of([recording(x, 200) for x in samples.T], "joint_angle", 120)
    # γ₀ = (1 + a₂) σ² / ((1 − a₂)((1 + a₂)² − a₁²)) of x_k = a₁ x_{k−1} + a₂ x_{k−2} + w
    a1, a2 = 1.5, -0.9
    exact = [(1.0 - a2) / ((1.0 + a2) * ((1.0 - a2) ** 2 - a1**2)) * 1e-4]
    exact.append(a1 / (1.0 - a2) * exact[0])
    for _ in range(2, 121):
        exact.append(a1 * exact[-1] + a2 * exact[-2])
    # 8000 samples of a process with a memory of about 20: 400 independent ones, so 5 % is one standard deviation or so
    np.testing.assert_allclose(noise.covariance[:30], exact[:30], atol=0.2 * exact[0])
    assert noise.std == pytest.approx(np.sqrt(exact[0]), rel=0.1)


def test_whitened_noise_is_white():
    """Of fresh noise: unit variance and no correlation between neighbours, within four standard errors."""
    rng = np.random.default_rng(2)
    noise = noise_of([recording(x, 300) for x in autoregressive(rng, 300, 40).T], "joint_angle", 300)
    fresh = autoregressive(rng, 300, 50)
    white = whitener(noise, "joint_angle", np.zeros(300), NONE)(fresh)
    assert np.mean(white**2) == pytest.approx(1.0, abs=4 * np.sqrt(2.0 / white.size) + 0.05)
    assert abs(np.mean(white[1:] * white[:-1])) < 4 / np.sqrt(white.size) + 0.05


def test_published_sensor_noise_is_whitened_from_short_standstills():
    """Half a second of rest in each of eight logs, with lines near 6 Hz and a 12-bit quantiser: the whitened residual of
    a standing joint keeps its size within a third, neither blown up nor hidden."""
    rng = np.random.default_rng(3)
    time = np.arange(400) * TICK
    logs = [JointAngleSensor().record(np.full(400, 0.1 * k), time, rng)[1] for k in range(8)]
    noise = noise_of([recording(x, 60) for x in logs], "joint_angle", 400)
    white = np.concatenate([whitener(noise, "joint_angle", np.zeros(400), NONE)(x - np.mean(x[:60])) for x in logs])
    assert 0.67 < np.std(white) < 1.5


def test_without_standstill_the_least_noise_is_left():
    noise = noise_of([recording(np.zeros(100), 4)], "joint_angle", 50)
    assert noise.covariance[0] == LEAST["joint_angle"] ** 2
    assert not np.any(noise.covariance[1:])


def test_relative_error_of_the_rate_wanders_the_angle():
    """Angle error of a steady turn with rate ω and relative error e of memory T after a time t ≪ T: e ω t; after t ≫ T:
    e ω √(2 T t − 2 T² (1 − exp(−t/T)))."""
    omega, e, count = 0.4, 0.01, 401
    predicted = np.asarray(omega * TICK * np.arange(count), dtype=np.float64)
    quiet = Noise(np.r_[1e-16, np.zeros(count - 1)])
    factor = whitener(quiet, "joint_angle", predicted, ModelError(e, 0.0)).factor
    std = np.linalg.norm(factor, axis=1)
    t = TICK * np.arange(1, count + 1)
    exact = e * omega * np.sqrt(2 * RATE_MEMORY * t - 2 * RATE_MEMORY**2 * (1 - np.exp(-t / RATE_MEMORY)))
    # the sum over ticks exceeds the integral by about half a tick
    np.testing.assert_allclose(std, exact, rtol=0.03, atol=e * omega * TICK)


def test_relative_error_of_a_pressure_is_a_share_of_its_excursion():
    predicted = np.r_[np.zeros(50), np.full(100, 60e5)]
    quiet = Noise(np.r_[1.0, np.zeros(149)])
    factor = whitener(quiet, "pressure_a", predicted, ModelError(0.0, 0.02)).factor
    covariance = factor @ factor.T
    assert covariance[100, 100] == pytest.approx((0.02 * 60e5) ** 2 + 1.0)
    lag = 4
    assert covariance[100, 100 + lag] / covariance[100, 100] == pytest.approx(np.exp(-lag * TICK / PRESSURE_MEMORY))
    assert covariance[10, 10] == pytest.approx(1.0)
