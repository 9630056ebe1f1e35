"""Delay, lag and smoothing of sampled signals against closed forms and the published chain's own filter."""

import numpy as np
import pytest

from aoro_gym.effects.signals import delayed, lagged, smoothed
from aoro_gym.sensors.chain import low_pass

RATE = 1000.0
TIME = np.arange(2000) / RATE
PARAMETERS = np.array([0.0, 0.0137, 0.03])
"""One a run [s]; the second falls between samples."""


def ramp() -> np.ndarray:
    """At rest until 0.2 s, then 3 a second; the same in every run."""
    return np.repeat(3.0 * np.maximum(TIME - 0.2, 0.0)[:, None], len(PARAMETERS), axis=1)


def test_delay_shifts_a_ramp():
    # straight lines are met exactly; within one sample of the kink the line between its neighbours is 3 · 1e-3/4 off
    exact = 3.0 * np.maximum(TIME[:, None] - PARAMETERS - 0.2, 0.0)
    np.testing.assert_allclose(delayed(ramp(), RATE, PARAMETERS), exact, atol=3e-3 / 4 + 1e-12)
    far = TIME > 0.3
    np.testing.assert_allclose(delayed(ramp(), RATE, PARAMETERS)[far], exact[far], atol=1e-12)


def test_lag_of_a_ramp_is_its_closed_form():
    """y = 3 (t − τ + τ e^(−t/τ)): exact, as the samples lie on straight lines."""
    since = np.maximum(TIME[:, None] - 0.2, 0.0)
    tau = np.where(PARAMETERS > 0.0, PARAMETERS, 1.0)
    exact = np.where(PARAMETERS > 0.0, 3.0 * (since - tau + tau * np.exp(-since / tau)), 3.0 * since)
    np.testing.assert_allclose(lagged(ramp(), RATE, PARAMETERS), exact, atol=1e-12)


@pytest.mark.parametrize("corner", [3.5, 7.0, 20.0])
def test_smoothing_is_the_published_filter_at_its_corner(corner):
    """Recursive filter forward and backward, and the same gain in the frequency domain: apart but for the ends."""
    values = np.where(TIME < 0.7, 0.0, np.minimum(2.0 * (TIME - 0.7), 1.0))[:, None] * np.ones(2)
    smoothing = np.array([1.0 / (2.0 * np.pi * corner), 0.0])
    out = smoothed(values, RATE, smoothing)
    recursive = low_pass(values, rate=RATE, cutoff=corner)
    # a 4th-order Butterworth's slowest pole decays with 0.38 · 2π f: e^(−0.38 · 2π · 3.5 · 0.6 s) = 7e-3 of a kink there is
    # left at the ends, where both continue the signal in their own way
    inner = (TIME > 0.5) & (TIME < 1.5)
    np.testing.assert_allclose(out[inner, 0], recursive[inner, 0], atol=2e-4)
    assert np.abs(out[:, 0] - recursive[:, 0]).max() < 7e-3
    assert np.array_equal(out[:, 1], values[:, 1])


def test_smoothing_halves_a_sine_at_its_corner_without_phase():
    corner, frequency = 5.0, 5.0
    values = np.sin(2.0 * np.pi * frequency * (TIME - TIME.mean()))[:, None]
    out = smoothed(values, RATE, 1.0 / (2.0 * np.pi * corner))
    middle = (TIME > 0.8) & (TIME < 1.2)
    np.testing.assert_allclose(out[middle], 0.5 * values[middle], atol=2e-3)


@pytest.mark.parametrize("chain", [delayed, lagged, smoothed])
def test_zero_changes_no_bit_and_runs_are_apart(chain):
    rng = np.random.default_rng(0)
    values = rng.normal(size=(300, 3)).cumsum(axis=0)
    together = chain(values, RATE, PARAMETERS)
    assert np.array_equal(together[:, 0], values[:, 0])
    assert np.array_equal(chain(values, RATE, 0.0), values)
    for run, parameter in enumerate(PARAMETERS):
        # sums of the Fourier transform round by their length
        np.testing.assert_allclose(
            together[:, run : run + 1], chain(values[:, run : run + 1], RATE, parameter), atol=1e-12
        )


def test_smoothing_keeps_single_precision_to_its_rounding():
    """A fast transform of 6000 samples rounds once a stage, of which there are thirteen."""
    values = 1e7 + 1e6 * np.random.default_rng(0).normal(size=(len(TIME), 3)).cumsum(axis=0)
    single = values.astype(np.float32)
    out = smoothed(single, RATE, PARAMETERS)
    assert out.dtype == np.float32
    scale = np.abs(values).max()
    np.testing.assert_allclose(out, smoothed(single.astype(np.float64), RATE, PARAMETERS), atol=16.0 * 6e-8 * scale)


def test_a_corner_beyond_the_samples_reach_changes_nothing():
    values = ramp()[:, :1]
    assert np.array_equal(smoothed(values, 100.0, 1.0 / (2.0 * np.pi * 50.0)), values)
