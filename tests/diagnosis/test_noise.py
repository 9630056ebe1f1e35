"""Noise of sensors, fitted to standstill."""

from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from aoro_gym.diagnosis.noise import LEAST, noise_of
from aoro_gym.diagnosis.recording import Recording


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


def test_without_standstill_the_least_noise_is_left():
    noise = noise_of([recording(np.zeros(100), 4)], "joint_angle", 50)
    assert noise.covariance[0] == LEAST["joint_angle"] ** 2
    assert not np.any(noise.covariance[1:])
