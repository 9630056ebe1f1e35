"""Noise and the twin's own error: fitted to standstill, and whitened away."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import chi2

from aoro_gym.diagnosis.noise import (
    ENVELOPE,
    LEAST,
    MERGED,
    NOISY_SWING,
    PRESSURE_MEMORY,
    RATE_MEMORY,
    SWING,
    Floats,
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
    """Of fresh noise, pairs of samples averaged: unit variance and no correlation between neighbours, within four standard
    errors and what the fit of the process leaves."""
    rng = np.random.default_rng(2)
    noise = noise_of([recording(x, 300) for x in autoregressive(rng, 300, 40).T], "joint_angle", 300)
    fresh = autoregressive(rng, 301, 50)
    white = whitener(noise, "joint_angle", np.zeros(301), NONE)(fresh)
    assert white.shape == (301 // MERGED, 50)
    assert np.mean(white**2) == pytest.approx(1.0, abs=4 * np.sqrt(2.0 / white.size) + 0.05)
    for lag in (1, 2, 3):
        assert abs(np.mean(white[lag:] * white[:-lag])) < 4 / np.sqrt(white.size) + 0.05


def test_whitened_noise_of_a_known_process_is_exactly_white():
    """Factor F of merged samples m = M x: F⁻¹ M Γ Mᵀ F⁻ᵀ = 1 with Γ itself, here of x with γ_k = 0.8^k."""
    covariance = 4.0 * 0.8 ** np.abs(np.subtract.outer(np.arange(40), np.arange(40)))
    white = whitener(Noise(covariance[0]), "joint_angle", np.zeros(40), NONE)
    half = white(np.linalg.cholesky(covariance))
    np.testing.assert_allclose(half @ half.T, np.eye(40 // MERGED), atol=1e-12)


@pytest.mark.parametrize("repeats", [1, 4])
def test_a_subtracted_mean_brings_its_own_noise(repeats):
    quiet = Noise(np.r_[9.0, np.zeros(39)])
    factor = whitener(quiet, "joint_angle", np.zeros(40), NONE, repeats=repeats).factor
    np.testing.assert_allclose(np.diag(factor) ** 2, 9.0 * (1.0 + 1.0 / repeats) / MERGED)


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


QUIET = 1e-16
"""Variance of noise that does not count."""


def covariance_of(channel: str, predicted: Floats, error: ModelError, seen: Floats | None = None, noise: float = QUIET):
    """Of merged samples, where white noise has the variance ``noise``."""
    quiet = Noise(np.r_[noise, np.zeros(len(predicted) - 1)])
    factor = whitener(quiet, channel, predicted, error, seen=seen).factor
    return factor @ factor.T


def merged(covariance: Floats) -> Floats:
    """Covariance of means over MERGED samples."""
    count = len(covariance) // MERGED
    mean = np.kron(np.eye(count), np.full((1, MERGED), 1.0 / MERGED))
    return mean @ covariance[: count * MERGED, : count * MERGED] @ mean.T


def wandering(size: Floats, memory: float) -> Floats:
    """Covariance of an Ornstein–Uhlenbeck process of standard deviation ``size`` (F,)."""
    lag = TICK * np.abs(np.subtract.outer(np.arange(len(size)), np.arange(len(size))))
    return np.outer(size, size) * np.exp(-lag / memory)


def test_relative_error_of_the_rate_wanders_the_angle():
    """Angle error of a steady turn with rate ω and relative error e of memory T after a time t ≪ T: e ω t; after t ≫ T:
    e ω √(2 T t − 2 T² (1 − exp(−t/T)))."""
    omega, e, count = 0.4, 0.01, 402
    predicted = np.asarray(omega * TICK * np.arange(count), dtype=np.float64)
    std = np.sqrt(np.diag(covariance_of("joint_angle", predicted, ModelError(e, 0.0))))
    t = TICK * (0.5 * (MERGED + 1) + MERGED * np.arange(count // MERGED))  # mean of the merged ones
    exact = e * omega * np.sqrt(2 * RATE_MEMORY * t - 2 * RATE_MEMORY**2 * (1 - np.exp(-t / RATE_MEMORY)))
    # the sum over ticks exceeds the integral by about half a tick
    np.testing.assert_allclose(std, exact, rtol=0.03, atol=e * omega * TICK)


def test_what_was_found_never_makes_sways_more_certain_than_is_asked():
    """Rate and pressure by the factor that was found, sways by the larger of it and of what they keep; eased as all is."""
    error = ModelError(1.0, 2.0, swing=3.0, change=4.0, phase=5.0)
    kept = replace(error, sways=0.5)
    assert kept.found(0.1) == ModelError(0.1, 0.2, swing=1.5, change=4.0, phase=2.5, sways=0.5)
    assert kept.found(2.0) == kept.scaled(2.0)
    assert kept.scaled(10.0).found(0.1) == kept.found(0.1).scaled(10.0)
    assert error.found(0.1) == error.scaled(0.1)


def test_a_late_motion_shows_its_pressures_late():
    """While the rate's error is small beside its memory, at t ≪ T, a lateness of e t times the pressure's rise."""
    rise, e, count = 20e5, 0.01, 12
    predicted = rise * TICK * np.arange(count, dtype=np.float64)
    std = np.sqrt(np.diag(covariance_of("pressure_a", predicted, ModelError(e, 0.0))))
    t = TICK * (0.5 * (MERGED + 1) + MERGED * np.arange(count // MERGED))
    # at t the integral of a wandering error is short of e t by t / 6 T of it; and see above
    np.testing.assert_allclose(std, e * rise * t, rtol=t[-1] / RATE_MEMORY / 6.0 + 0.01)


def test_relative_error_of_a_pressure_is_a_share_of_its_excursion():
    predicted = np.r_[np.zeros(50), np.full(100, 60e5)]
    found = covariance_of("pressure_a", predicted, ModelError(0.0, 0.02), noise=1.0)
    exact = merged(wandering(np.where(np.arange(150) >= 50 - 4, 0.02 * 60e5, 0.0), PRESSURE_MEMORY) + np.eye(150))
    np.testing.assert_allclose(found, exact, rtol=1e-9)
    assert found[10, 10] == pytest.approx(1.0 / MERGED)


def test_error_of_a_swing_stays_with_the_swing():
    """A step of 60 bar: its share within half a window to either side, nothing elsewhere."""
    predicted = np.r_[np.zeros(100), np.full(100, 60e5)]
    found = covariance_of("pressure_a", predicted, ModelError(0.0, 0.0, swing=0.1), noise=1.0)
    near = np.abs(np.arange(200) - 99.5) < SWING // 2
    exact = merged(wandering(np.where(near, 0.1 * 60e5, 0.0), PRESSURE_MEMORY) + np.eye(200))
    np.testing.assert_allclose(found, exact, rtol=1e-9)
    assert not np.any(covariance_of("joint_angle", predicted, ModelError(0.0, 0.0, swing=0.1)) > QUIET)


def test_a_twin_that_sways_otherwise_is_soon_out_of_phase():
    """A rise r with a relative error e of the time t since the last event: e t r, up to half of what it swings by."""
    rise, e, count = 10e5, 0.05, 300
    predicted = rise * TICK * np.arange(count, dtype=np.float64)
    time = TICK * np.arange(count) % 1.5
    quiet = Noise(np.r_[QUIET, np.zeros(count - 1)])
    factor = whitener(quiet, "pressure_a", predicted, ModelError(0.0, 0.0, phase=e), since=time).factor
    swing = rise * TICK * (SWING - 1)
    size = np.minimum(e * time * rise, 0.5 * swing)
    inner = slice(SWING // MERGED, -SWING // MERGED)  # where windows are whole
    exact = merged(wandering(size, PRESSURE_MEMORY) + QUIET * np.eye(count))
    np.testing.assert_allclose((factor @ factor.T)[inner, inner], exact[inner, inner], rtol=1e-9)


def test_what_the_healthy_machine_sways_beyond_its_twin_counts():
    """A flat prediction and a healthy sine of amplitude A, in noise σ: swing·(2A − 5σ), and phase·t of its steepest
    slope, up to half of the first bracket."""
    count, amplitude, period, sigma = 300, 8e5, 16, 0.2e5
    turn = 2.0 * np.pi / period  # a tick; a window of SWING samples holds a whole period
    healthy = 60e5 + amplitude * np.sin(turn * np.arange(count, dtype=np.float64))
    swing = 2.0 * amplitude - NOISY_SWING * sigma
    pace = amplitude * np.sin(turn)  # central difference where the sine is steepest
    time = TICK * np.arange(count) % 1.5
    late = np.minimum(0.02 * time / TICK * pace, 0.5 * swing)
    assert late[20] < 0.5 * swing == late[140]
    exact = merged(wandering(0.1 * swing + late, PRESSURE_MEMORY) + sigma**2 * np.eye(count))
    found = swayed(np.full(count, 60e5), healthy, sigma, time)
    inner = slice(SWING // MERGED, -SWING // MERGED)  # where windows are whole
    np.testing.assert_allclose(found[inner, inner], exact[inner, inner], rtol=1e-6)


def test_noise_of_the_healthy_machine_is_no_sway_nor_is_less_sway_than_the_twin_s():
    rng = np.random.default_rng(5)
    sigma, time = 0.2e5, np.zeros(300)
    alone = 60e5 + sigma * rng.standard_normal(300)
    # five standard deviations lie between the least and the largest of 21 normal samples in one window of fifty
    quiet = np.diag(swayed(np.full(300, 60e5), alone, sigma, time)) * MERGED - sigma**2
    assert np.mean(quiet > 1e-9 * sigma**2) < 0.15
    assert np.max(quiet) < (0.1 * sigma) ** 2 * MERGED
    predicted = 60e5 + 8e5 * np.sin(0.4 * np.arange(300))
    less = 60e5 + 4e5 * np.sin(0.4 * np.arange(300))
    np.testing.assert_array_equal(swayed(predicted, less, sigma, time), swayed(predicted, None, sigma, time))


def swayed(predicted: Floats, healthy: Floats | None, sigma: float, since: Floats) -> Floats:
    """Covariance of merged samples of a pressure, with errors of a swing and of the phase."""
    noise = Noise(np.r_[sigma**2, np.zeros(len(predicted) - 1)])
    error = ModelError(0.0, 0.0, swing=0.1, phase=0.02)
    factor = whitener(noise, "pressure_a", predicted, error, since=since, healthy=healthy).factor
    return factor @ factor.T


def test_what_does_not_count_is_not_there():
    """The factor of the rest is that of its part of the covariance."""
    predicted = 60e5 * np.sin(np.linspace(0.0, 6.0, 60))
    error, quiet = ModelError(0.01, 0.02, 0.1), Noise(np.r_[QUIET, np.zeros(59)])
    counts = np.ones(60, dtype=bool)
    counts[20:30] = False
    whole, part = (whitener(quiet, "pressure_a", predicted, error, counts=c) for c in (None, counts))
    kept = np.flatnonzero(part.counts)
    assert len(kept) == 25
    np.testing.assert_allclose(part.factor @ part.factor.T, (whole.factor @ whole.factor.T)[np.ix_(kept, kept)])
    assert len(part(predicted)) == 25


def test_error_of_a_change_is_a_share_of_what_is_seen():
    """A residual d throughout, in noise of variance v: half of (c d)² is a size that is wrong throughout, half of
    c² (d² − v (1 + 3 √(2/15))) wanders; the first is no larger than the second."""
    d, v, c = 5e5, 1e10, 0.2
    found = covariance_of("pressure_a", np.zeros(100), ModelError(0.0, 0.0, change=c), np.full(100, d), v)
    beyond = c**2 * (d**2 - v * (1.0 + 3.0 * np.sqrt(2.0 / ENVELOPE)))
    exact = merged(wandering(np.full(100, np.sqrt(0.5 * beyond)), PRESSURE_MEMORY) + 0.5 * beyond + v * np.eye(100))
    np.testing.assert_allclose(found, exact, rtol=1e-9)


def test_a_change_of_the_angle_wanders_as_its_rate_does():
    found = covariance_of("joint_angle", np.zeros(40), ModelError(0.0, 0.0, change=0.2), np.full(40, 0.1))
    exact = 0.5 * (merged(wandering(np.full(40, 0.2 * 0.1), RATE_MEMORY)) + (0.2 * 0.1) ** 2)
    np.testing.assert_allclose(found, exact, rtol=1e-6)


def test_a_change_that_turns_its_sign_is_no_size_that_is_wrong_throughout():
    """A residual ± d, sample by sample, has a mean of d / 15 or −d / 15 over 15 of them: so does the common part."""
    d, c = 1.0, 0.2
    seen = d * (-1.0) ** np.arange(100)
    found = covariance_of("pressure_a", np.zeros(100), ModelError(0.0, 0.0, change=c), seen)
    far = found[20, 40]  # 0.4 s apart: ten memories
    assert abs(far) < 0.5 * c**2 * d**2 * ((1.0 / ENVELOPE) ** 2 + np.exp(-10.0))


def test_noise_alone_is_rarely_taken_for_a_change():
    """A mean of 15 squares of white noise exceeds 1 + 3 √(2/15) in 0.8 % of the cases, and counts in 15 samples: between
    that share of the samples and 15 times as many show an error of a change."""
    rng = np.random.default_rng(8)
    single = float(chi2.sf(ENVELOPE + 3.0 * np.sqrt(2.0 * ENVELOPE), ENVELOPE))
    assert single == pytest.approx(0.008, abs=0.0005)
    flagged = [
        np.mean(
            np.diag(covariance_of("pressure_a", np.zeros(400), ModelError(0.0, 0.0, change=1.0), x, 1.0)) > 0.5 + 1e-9
        )
        for x in rng.standard_normal((40, 400))
    ]
    assert single < np.mean(flagged) < ENVELOPE * single
