"""The joint-angle sensor: noise of the published kind, delay, gain and low-pass."""

import math

import numpy as np
import pytest
from scipy.stats import kstest

from aoro_gym.sensors import JointAngleNoise, JointAngleSensor, NoiseLine
from aoro_gym.sensors.chain import measured_flow, port_volume
from aoro_gym.validation import published

SILENT = JointAngleNoise()
RATE = 100.0


@pytest.mark.parametrize(("turn_time", "name"), [(1.98, "swing_100"), (6.86, "swing_50")])
def test_noise_swings_the_steady_flow_as_published(machine, turn_time, name):
    """One amplitude for both levels: each published swing within a tenth of the median, and an ordinary outcome."""
    cylinder, runs = machine.steering.cylinder, 1500
    time = np.arange(-0.6, turn_time + 0.7, 1 / RATE)
    angles = np.linspace(-cylinder.half_range, cylinder.half_range, 2001)
    volume = port_volume(cylinder, angles, 1)
    angle = np.interp(np.clip(time / turn_time, 0, 1) * volume[-1], volume, angles)  # constant flow
    _, measured = JointAngleSensor().record(
        np.repeat(angle[:, None], runs, 1), time - time[0], np.random.default_rng(7)
    )
    noise = measured_flow(cylinder, measured, 1) - measured_flow(cylinder, angle, 1)[:, None]
    steady = (time >= 0.48 * turn_time) & (time <= 0.92 * turn_time)
    swing = np.ptp(noise[steady], axis=0) * 6e4
    assert np.median(swing) == pytest.approx(published(name), rel=0.1)
    assert 0.2 < np.mean(swing < published(name)) < 0.8


def test_published_noise_has_its_lines_and_power():
    noise, frames = JointAngleNoise.published(), 4000
    _, measured = JointAngleSensor(noise=noise).record(
        np.zeros((frames, 40)), np.arange(frames) / RATE, np.random.default_rng(3)
    )
    power = 0.5 * sum(line.amplitude**2 for line in noise.lines) + noise.white**2 + noise.resolution**2 / 12
    # each line's power is certain over 40 s; the rest is a small part with 1/√160000
    assert measured.var() == pytest.approx(power, rel=0.02)
    spectrum = np.abs(np.fft.rfft(measured, axis=0)) ** 2
    frequency = np.fft.rfftfreq(frames, 1 / RATE)
    near = np.zeros(frequency.size, dtype=bool)
    for line in noise.lines:
        near |= (frequency > line.low - 0.5) & (frequency < line.high + 0.5)
    # half a hertz beside a line its leakage is below that of the white floor times the width of the bands
    assert spectrum[near].mean() > 20 * spectrum[~near & (frequency > 1.0)].mean()
    for low, high in ((5, 7.5), (13.5, 16.5), (25, 33.6)):
        inside = (frequency > low) & (frequency < high)
        assert spectrum[inside].max() > 100 * np.median(spectrum)


def test_recorded_at_once_is_measured_one_by_one():
    count, frames = 3, 150
    time = np.arange(frames) / RATE
    angle = np.sin(2 * np.pi * time)[:, None] * np.array([0.5, -0.3, 0.1])
    delay = np.array([0.0, 0.013, 0.04])
    sensor = JointAngleSensor(count, delay=delay, gain=np.array([1.0, 1.02, 0.9]), cutoff=12.0)
    ticks, recorded = sensor.record(angle, time, np.random.default_rng(5))
    sensor.reset(np.arange(count), np.random.default_rng(5).spawn(count))
    measured = np.array([sensor.measure(row, now) for row, now in zip(angle, ticks, strict=True)])
    # rounding decides between two steps of the quantiser at most once in a long while
    assert np.mean(np.abs(recorded - measured) < 1e-9) > 0.99
    assert np.abs(recorded - measured).max() < 1.001 * sensor.noise.resolution


def test_the_same_seed_gives_the_same_noise_and_a_reset_touches_its_twins_only():
    def run(sensor, frames):
        return np.array([sensor.measure(np.zeros(2), now / RATE) for now in range(frames)])

    sensor = JointAngleSensor(2)
    sensor.reset([0, 1], np.random.default_rng(1).spawn(2))
    first = run(sensor, 50)
    sensor.reset([1], np.random.default_rng(1).spawn(2)[1:])
    np.testing.assert_array_equal(run(sensor, 50), first)
    sensor.reset([1], [np.random.default_rng(8)])
    again = run(sensor, 50)
    np.testing.assert_array_equal(again[:, 0], first[:, 0])
    assert np.abs(again[:, 1] - first[:, 1]).max() > 0.0
    assert np.abs(first[:, 0] - first[:, 1]).max() > 0.0


@pytest.mark.parametrize("delay", [0.002, 0.01, 0.023])
def test_delay_of_a_ramp(delay):
    time = np.arange(100) / RATE
    angle = 0.4 * time
    _, recorded = JointAngleSensor(noise=SILENT, delay=delay).record(angle, time, np.random.default_rng(0))
    late = time > delay
    np.testing.assert_allclose(recorded[late], 0.4 * (time[late] - delay), atol=1e-12)
    np.testing.assert_allclose(recorded[~late], 0.0, atol=1e-12)
    sensor = JointAngleSensor(noise=SILENT, delay=delay)
    measured = np.array([sensor.measure(np.array([a]), t)[0] for a, t in zip(angle, time, strict=True)])
    np.testing.assert_allclose(measured, recorded, atol=1e-12)


def test_low_pass_lags_a_ramp_by_its_time_constant_and_damps_a_sine():
    cutoff = 5.0
    time = np.arange(0, 4000) * 1e-3
    sensor = JointAngleSensor(noise=SILENT, cutoff=cutoff)
    ticks, ramp = sensor.record(0.4 * time, time, np.random.default_rng(0))
    settled = ticks > 1.0  # e^(-2π 5)
    np.testing.assert_allclose(ramp[settled], 0.4 * (ticks[settled] - 1 / (2 * np.pi * cutoff)), atol=1e-12)
    for frequency in (1.0, 5.0, 20.0):
        ticks, wave = sensor.record(np.sin(2 * np.pi * frequency * time), time, np.random.default_rng(0))
        gain = 1 / (1 + 1j * frequency / cutoff)
        expected = np.abs(gain) * np.sin(2 * np.pi * frequency * ticks + np.angle(gain))
        # straight lines between samples a millisecond apart: (π f h)²/3
        np.testing.assert_allclose(wave[settled], expected[settled], atol=(np.pi * frequency * 1e-3) ** 2 / 3 + 1e-9)


def test_gain_and_quantiser():
    noise = JointAngleNoise(resolution=0.01)
    sensor = JointAngleSensor(2, noise, gain=[1.0, 1.1])
    np.testing.assert_allclose(sensor.measure([0.102, 0.1], 0.0), [0.10, 0.11])
    _, recorded = sensor.record(np.full((20, 2), 0.1), np.arange(20) / RATE, np.random.default_rng(0))
    np.testing.assert_allclose(recorded, np.tile([0.10, 0.11], (20, 1)))


def test_a_reset_forgets_the_past():
    sensor = JointAngleSensor(noise=SILENT, delay=0.03, cutoff=3.0)
    for k in range(10):
        sensor.measure(np.array([0.1 * k]), k / RATE)
    sensor.reset([0], [np.random.default_rng(0)])
    for k in range(5):
        assert sensor.measure(np.array([-0.5]), k / RATE)[0] == pytest.approx(-0.5)


def test_what_is_wrong_is_named():
    with pytest.raises(ValueError, match="num_twins is 0"):
        JointAngleSensor(0)
    with pytest.raises(ValueError, match=r"delay\[0\] is -0\.1 s"):
        JointAngleSensor(delay=-0.1)
    with pytest.raises(ValueError, match=r"gain has shape \(2,\)"):
        JointAngleSensor(3, gain=[1.0, 2.0])
    with pytest.raises(ValueError, match="cutoff is 0"):
        JointAngleSensor(cutoff=0.0)
    with pytest.raises(ValueError, match="2 generators for 1 twins"):
        JointAngleSensor().reset([0], np.random.default_rng(0).spawn(2))
    with pytest.raises(ValueError, match=r"angle has shape \(2,\)"):
        JointAngleSensor().measure(np.zeros(2), 0.0)
    with pytest.raises(ValueError, match=r"low is .* Hz, but must be in \[0, "):
        NoiseLine(5.0, 4.0, math.radians(0.1))
    with pytest.raises(ValueError, match="at least 0 rad"):
        JointAngleNoise(white=-1.0)
    with pytest.raises(ValueError, match="2 columns, but there are 3 sensors"):
        JointAngleSensor(3).record(np.zeros((9, 2)), np.arange(9) / RATE, np.random.default_rng(0))


def test_lines_near_15_hz_lie_evenly_around_it():
    frequency = JointAngleNoise.published().draw(np.random.default_rng(2).spawn(200)).frequency
    near = frequency[(frequency > 10.0) & (frequency < 20.0)]
    # Kolmogorov-Smirnov at the 0.1 % level; 1.95/√n is its bound
    assert kstest(near, "uniform", (14.0, 2.0)).statistic < 1.95 / np.sqrt(near.size)
