"""The measuring chain against closed forms."""

import math

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.signal import butter, sosfreqz

from aoro_gym.sensors.chain import (
    low_pass,
    low_pass_gain,
    measured_flow,
    port_volume,
    sample,
    sampling_rate,
    turn_flow,
)

VOLUME = math.pi / 4 * (2 * 0.08**2 - 0.04**2) * 0.265  # [m³] of a full turn: bore and annulus times the stroke
RATE = 100.0


def test_gain_is_the_squared_response_of_the_published_filter():
    frequency = np.linspace(0.0, 49.0, 300)
    _, response = sosfreqz(butter(4, 7.0, fs=RATE, output="sos"), frequency, fs=RATE)
    np.testing.assert_allclose(low_pass_gain(frequency), np.abs(response) ** 2, atol=1e-9)
    assert low_pass_gain(7.0) == pytest.approx(0.5)


@pytest.mark.parametrize("frequency", [0.5, 3.0, 6.0, 7.0, 9.0, 15.0])
def test_filter_scales_a_sine_and_does_not_move_it(frequency):
    time = np.arange(0.0, 20.0, 1 / RATE)
    wave = np.sin(2 * np.pi * frequency * time + 0.3)
    # the slowest pole decays by e^(-2π 7 sin(π/8) t): 10^-14 in two seconds
    inside = slice(400, -400)
    np.testing.assert_allclose(low_pass(wave)[inside], (low_pass_gain(frequency) * wave)[inside], atol=1e-9)


def test_filter_keeps_lines_and_columns_apart():
    time = np.arange(0.0, 3.0, 1 / RATE)
    columns = np.stack([np.full_like(time, 0.7), 0.2 - 0.1 * time, np.random.default_rng(0).normal(size=time.size)], 1)
    filtered = low_pass(columns)
    np.testing.assert_allclose(filtered[:, 0], columns[:, 0], atol=1e-12)
    inside = slice(100, -100)  # a second from the ends of the line, the ringing has decayed by e^-17
    np.testing.assert_allclose(filtered[inside, 1], columns[inside, 1], atol=1e-10)
    np.testing.assert_array_equal(filtered[:, 2], low_pass(columns[:, 2]))


def test_cutoff_above_half_the_rate_is_refused():
    with pytest.raises(ValueError, match=r"cutoff is 7 Hz, but must be in \(0, 5\) Hz at 10 samples"):
        low_pass(np.zeros(99), rate=10.0)


@pytest.mark.parametrize("direction", [1, -1])
def test_a_full_turn_takes_both_full_strokes(machine, direction):
    cylinder = machine.steering.cylinder
    stop = direction * cylinder.half_range
    # the linkage closes to the rounding of its solution
    assert port_volume(cylinder, -stop, direction) == pytest.approx(0.0, abs=1e-15)
    assert port_volume(cylinder, stop, direction) == pytest.approx(VOLUME, rel=1e-12)


def test_flow_is_the_rate_of_the_volume(machine):
    cylinder = machine.steering.cylinder
    angle, step = np.linspace(-0.65, 0.65, 41), 1e-5
    for direction in (1, -1):
        change = port_volume(cylinder, angle + step, direction) - port_volume(cylinder, angle - step, direction)
        # central difference: step²/6 of the third derivative, below 1e-9 of the flow; rounding: 1e-16 × 2e-3 / 2e-5
        np.testing.assert_allclose(turn_flow(cylinder, angle, 0.7, direction), change / (2 * step) * 0.7, rtol=1e-8)
    np.testing.assert_allclose(turn_flow(cylinder, angle, 0.7, 1), turn_flow(cylinder, -angle, -0.7, -1), rtol=1e-14)


@pytest.mark.parametrize("direction", [1, -1])
def test_measured_flow_of_a_constant_rate(machine, direction):
    cylinder = machine.steering.cylinder
    duration = 4.0
    rate = direction * 2 * cylinder.half_range / duration
    time = np.arange(-1.0, duration + 1.0, 1 / RATE)
    angle = np.clip(rate * (time - duration / 2), -cylinder.half_range, cylinder.half_range)
    flow = measured_flow(cylinder, angle, direction)
    inside = (time > 0.8) & (time < duration - 0.8)  # 0.8 s from the kinks the filter's ringing is below 1e-6
    exact = turn_flow(cylinder, angle, rate, direction)
    # a central difference misses by h²/6 of the third derivative; the lever over 80° is nearly a parabola of height 0.03 m,
    # so that Q'' = rate² × 2 × 0.03/0.70² × rate × area, against Q = 0.19 × rate × area: a share of 0.65 rate²
    share = (1 / RATE) ** 2 / 6 * 0.65 * rate**2
    np.testing.assert_allclose(flow[inside], exact[inside], rtol=2 * share + 1e-6)
    drawn = cumulative_trapezoid(flow, time, initial=0.0)[-1]
    assert drawn == pytest.approx(VOLUME, rel=1e-6)


def test_measured_flow_of_many_machines_at_once(machine):
    ratios = np.array([0.7, 0.766, 0.9])
    several = machine.set({"steering.cylinder.mount_ratio": ratios})
    angle = np.linspace(-0.6, 0.6, 200)[:, None] * np.array([1.0, -1.0, 0.8])
    direction = np.array([1, -1, 1])
    together = measured_flow(several.steering.cylinder, angle, direction)
    for index in range(3):
        alone = measured_flow(several.variant(index).steering.cylinder, angle[:, index], direction[index])
        np.testing.assert_allclose(together[:, index], alone, rtol=1e-12)


def test_samples_stand_on_the_clock():
    time = np.arange(1, 101) * 1e-3
    ticks, values = sample(time, time)
    np.testing.assert_allclose(ticks, np.arange(1, 11) * 0.01)
    np.testing.assert_allclose(values, ticks, atol=1e-12)
    ticks, values = sample(time, np.stack([time, -time], 1), offset=0.0034)
    np.testing.assert_allclose(ticks, 0.0034 + np.arange(10) * 0.01)
    np.testing.assert_allclose(values[:, 0], ticks - 0.0004, atol=1e-12)  # the last value before the tick
    assert values.shape == (10, 2)


def test_sampler_folds_high_frequencies():
    time = np.arange(0, 2000) * 1e-3
    ticks, values = sample(time, np.sin(2 * np.pi * 106.0 * time))
    np.testing.assert_allclose(values, np.sin(2 * np.pi * 6.0 * ticks), atol=1e-9)


def test_uneven_or_missing_samples_are_named():
    assert sampling_rate(np.arange(50) * 0.01) == pytest.approx(100.0)
    with pytest.raises(ValueError, match=r"samples are 0\.01 to 0\.03 s apart"):
        sampling_rate([0.0, 0.01, 0.02, 0.05, 0.06])
    with pytest.raises(ValueError, match=r"must be \(F,\) with at least two"):
        sampling_rate([0.0])
    with pytest.raises(ValueError, match="hold no sample at 100 Hz"):
        sample([0.001, 0.009], [0.0, 0.0])
