"""More noise of the kind that a sensor at rest has shown."""

import numpy as np
import pytest
from scipy.signal import lfilter

from aoro_gym.sensors.standstill import noise_like


def test_noise_has_the_autocovariance_of_the_standstill_that_it_is_drawn_from():
    """x_k = 1.5 x_{k−1} − 0.9 x_{k−2} + w, a line near 11 Hz at 100 samples a second, of 40 stretches of 2 s."""
    rng = np.random.default_rng(1)
    rest = np.asarray(lfilter([1.0], [1.0, -1.5, 0.9], 1e-2 * rng.standard_normal((40, 700))))[:, 500:]
    drawn = noise_like(list(0.3 + rest), 300, 2000, rng)
    a1, a2 = 1.5, -0.9
    exact = [(1.0 - a2) / ((1.0 + a2) * ((1.0 - a2) ** 2 - a1**2)) * 1e-4]
    exact.append(a1 / (1.0 - a2) * exact[0])
    for _ in range(2, 30):
        exact.append(a1 * exact[-1] + a2 * exact[-2])
    assert abs(np.mean(drawn)) < 1e-3
    for begin in (0, 200):  # no run-in
        found = [np.mean(drawn[begin] * drawn[begin + lag]) for lag in range(30)]
        # what is fitted to has 400 independent samples, as in tests/diagnosis/test_noise.py; 2000 draws add a third of that
        np.testing.assert_allclose(found, exact, atol=0.25 * exact[0])


def test_a_sinusoid_goes_on():
    """A line of 6 Hz alone, whose process is not driven at all once it swings."""
    time = np.arange(120) / 100.0
    rest = [np.sin(2.0 * np.pi * 6.0 * time + phase) for phase in (0.0, 1.0, 2.0)]
    drawn = noise_like(rest, 400, 500, np.random.default_rng(0))
    assert np.mean(drawn[-100:] ** 2) == pytest.approx(0.5, rel=0.3)
    spectrum = np.mean(np.abs(np.fft.rfft(drawn[-200:], axis=0)) ** 2, axis=1)
    assert np.argmax(spectrum) == 12


@pytest.mark.parametrize("rest", [[], [np.zeros(60)], [np.full(2, 0.1)]])
def test_without_noise_or_standstill_there_is_none(rest):
    assert not np.any(noise_like(rest, 50, 3, np.random.default_rng(0)))
