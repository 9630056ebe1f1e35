"""What sensors make of exact signals, against closed forms; the exact signals where sensors add nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aoro_gym.diagnosis.simulation import outsiders
from aoro_gym.diagnosis.simulation.logs import UNITS
from aoro_gym.diagnosis.simulation.manoeuvres import SAMPLES, TICK
from aoro_gym.diagnosis.simulation.prior import SensorPrior

torch = pytest.importorskip("torch")

from aoro_gym.diagnosis.network.sensing import DEVIATIONS, Draw, sensed  # noqa: E402

TINY = 1e-9
EXACT = replace(
    SensorPrior(),
    line_scale=(TINY, 2 * TINY), angle_white=(TINY, 2 * TINY), angle_step=(TINY, 2 * TINY), angle_zero=0.0,
    pressure_white=(TINY, 2 * TINY), pressure_step=(TINY, 2 * TINY), pressure_zero=0.0, pressure_gain=0.0, delay=0.0,
    lag=0.0, smooth=0.0, clock=0.0, law_error=(TINY, 2 * TINY), change_error=(TINY, 2 * TINY),
)  # fmt: skip
"""Sensors that add nothing."""
BEGIN, RATE = 100, 0.3
SINGLE_PRECISION = 2e-5
"""Of angles [rad] whose differences are transformed in single precision: 512 steps of 6e-8 of 0.5 rad."""


def turning() -> np.ndarray:
    """A joint that begins to turn at a constant rate, and pressures that step: (1, 1, 1, channels, T)."""
    index = np.arange(SAMPLES)
    angle = RATE * TICK * np.clip(index - BEGIN, 0, 200)
    pressure = np.where(index > BEGIN, 60e5, 20e5)
    values = np.stack([angle, pressure, 0.5 * pressure, pressure]) / np.array(UNITS)[:, None]
    return np.round(values).astype(np.int16)[None, None, None]


def shown(chain=(0.0, 0.0, 0.0, 0.0), outsider=-1, prior=EXACT, seed=0):
    values = torch.as_tensor(turning())
    draw = Draw(torch.Generator().manual_seed(seed))
    got = sensed(values, torch.tensor([[chain]], dtype=torch.float32), torch.tensor([[outsider]]), prior, draw)
    return got.double().numpy()[0, 0, 0]


EXACTLY = turning()[0, 0, 0] * np.array(UNITS)[:, None]


def test_sensors_that_add_nothing_show_what_is() -> None:
    np.testing.assert_allclose(shown()[0], EXACTLY[0], rtol=0.0, atol=SINGLE_PRECISION)
    np.testing.assert_allclose(shown()[1:], EXACTLY[1:], rtol=1e-4)


def test_a_delay_shifts_the_angle_alone() -> None:
    late = shown((0.03, 0.0, 0.0, 0.0))
    np.testing.assert_allclose(late[0, 3:], EXACTLY[0, :-3], rtol=0.0, atol=SINGLE_PRECISION)
    np.testing.assert_allclose(late[1:], shown()[1:], rtol=1e-6)


def test_a_lag_trails_a_ramp_by_its_time_constant() -> None:
    lagging = shown((0.0, 0.04, 0.0, 0.0))
    steady = slice(BEGIN + 40, BEGIN + 200)
    np.testing.assert_allclose(EXACTLY[0, steady] - lagging[0, steady], RATE * 0.04, rtol=0.02)


def test_a_gain_error_multiplies_the_angle() -> None:
    np.testing.assert_allclose(shown((0.0, 0.0, 0.04, 0.0))[0], 1.04 * EXACTLY[0], rtol=0.0, atol=2 * SINGLE_PRECISION)


def test_smoothing_halves_its_own_frequency_and_delays_nothing() -> None:
    """A step stays where it was and keeps its height: half of it is there at the step itself."""
    smooth = shown((0.0, 0.0, 0.0, 0.03), prior=replace(EXACT, chain_forms=(1.0, 0.0, 0.0)))[1]
    middle = 0.5 * (smooth[BEGIN] + smooth[BEGIN + 1])
    assert middle == pytest.approx(40e5, rel=1e-3)
    assert smooth[BEGIN - 1] > 20e5 and smooth[-1] == pytest.approx(60e5, rel=1e-3)


def test_a_chain_that_lags_or_delays_does_so_to_every_signal() -> None:
    """Of first order a step has come to 1 − 1/e of its height after its time constant; a delay shifts it."""
    lag = shown((0.0, 0.0, 0.0, 0.05), prior=replace(EXACT, chain_forms=(0.0, 1.0, 0.0)))
    steady = slice(BEGIN + 60, BEGIN + 200)
    np.testing.assert_allclose(EXACTLY[0, steady] - lag[0, steady], RATE * 0.05, rtol=0.02)
    share = (lag[1, BEGIN + 6] - 20e5) / 40e5  # 5 ticks after the first sample of the step, which began a tick before
    assert 1.0 - np.exp(-1.0) <= share <= 1.0 - np.exp(-1.2)
    late = shown((0.0, 0.0, 0.0, 0.03), prior=replace(EXACT, chain_forms=(0.0, 0.0, 1.0)))
    np.testing.assert_allclose(late[0, 3:], EXACTLY[0, :-3], rtol=0.0, atol=SINGLE_PRECISION)
    np.testing.assert_allclose(late[1:, 3:], EXACTLY[1:, :-3], rtol=1e-3)


def test_noise_is_as_large_as_drawn() -> None:
    prior = replace(EXACT, pressure_white=(5e4, 5.0001e4))
    noise = shown(prior=prior)[1:] - shown()[1:]
    # the standard deviation of n samples is off by 1/√(2n), here 1.8 %
    assert np.std(noise) == pytest.approx(5e4, rel=4 * 0.018)


def test_what_no_law_has_is_the_same_on_all_days() -> None:
    """It distorts each day alike, so that two equal days stay equal."""
    values = torch.as_tensor(np.repeat(turning(), 2, axis=1))
    prior = replace(EXACT, law_error=(0.02, 0.03))
    got = sensed(values, torch.zeros(1, 2, 4), torch.full((1, 2), -1), prior, Draw(torch.Generator().manual_seed(1)))
    days = got.numpy()[0, :, 0]
    np.testing.assert_allclose(days[0], days[1], rtol=1e-4, atol=1e-4)
    assert np.abs(days[0, 0] - EXACTLY[0]).max() > 1e-3


@pytest.mark.parametrize("name", outsiders.SIGNAL)
def test_every_deviation_shows_and_stays_finite(name: str) -> None:
    assert set(DEVIATIONS) == set(outsiders.SIGNAL)
    got = shown(outsider=outsiders.ALL.index(name), seed=3)
    assert np.isfinite(got).all()
    scale = np.array([1e-3, 1e4, 1e4, 1e4])[:, None]
    assert (np.abs(got - shown(seed=3)) / scale).max() > 1.0
