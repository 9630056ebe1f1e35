"""Pressure sensors: range, steps, zero error and noise."""

import numpy as np
import pytest

from aoro_gym.sensors import PressureNoise, PressureSensor

BAR = 1e5


def test_range_steps_and_statistics():
    noise, count, frames = PressureNoise.typical(), 500, 200
    sensor = PressureSensor(noise=noise)
    true = np.full((frames, count), 100 * BAR)
    ticks, measured = sensor.record(true, np.arange(frames) / 100.0, np.random.default_rng(2))
    assert len(ticks) == frames
    np.testing.assert_allclose(measured / noise.resolution, np.round(measured / noise.resolution), atol=1e-6)
    error = measured - true
    zero = error.mean(axis=0)
    # root mean squares of n normal numbers scatter by 1/√2n, four of them; the quantiser adds a twelfth of its square
    assert zero.std() == pytest.approx(noise.zero_error, rel=4 / np.sqrt(2 * count))
    floor = np.hypot(noise.white, noise.resolution / np.sqrt(12))
    assert (error - zero).std() == pytest.approx(floor, rel=4 / np.sqrt(2 * error.size) + 1 / frames)
    assert sensor.record(np.array([500.0, 500.0]) * BAR, [0.0, 0.01], np.random.default_rng(0))[1].max() == noise.high
    assert sensor.record(np.array([-9.0, -9.0]) * BAR, [0.0, 0.01], np.random.default_rng(0))[1].min() == noise.low


def test_recorded_at_once_is_measured_one_by_one():
    time = np.arange(60) / 100.0
    true = (50 + 40 * np.sin(9 * time))[:, None] * np.array([1.0, 2.0]) * BAR
    sensor = PressureSensor(2)
    _, recorded = sensor.record(true, time, np.random.default_rng(4))
    sensor.reset([0, 1], np.random.default_rng(4).spawn(2))
    measured = [sensor.measure(row, now) for row, now in zip(true, time, strict=True)]
    np.testing.assert_array_equal(recorded, measured)
    _, single = sensor.record(true[:, 0], time, np.random.default_rng(4))
    np.testing.assert_array_equal(single, recorded[:, 0])


def test_a_reset_touches_its_twins_only():
    sensor = PressureSensor(2)
    before = sensor.measure(np.full(2, 50 * BAR), 0.1)
    sensor.reset([1], [np.random.default_rng(9)])
    after = sensor.measure(np.full(2, 50 * BAR), 0.1)
    assert after[0] == before[0]
    assert after[1] != before[1]


def test_what_is_wrong_is_named():
    with pytest.raises(ValueError, match="num_twins is 0"):
        PressureSensor(0)
    with pytest.raises(ValueError, match="low is 1 Pa, but must be below 1 Pa, which is high"):
        PressureNoise(low=1.0, high=1.0)
    with pytest.raises(ValueError, match="at least 0 Pa"):
        PressureNoise(white=-1.0)
    with pytest.raises(ValueError, match=r"pressure has shape \(3,\)"):
        PressureSensor().measure(np.zeros(3), 0.0)
    with pytest.raises(ValueError, match="1 generators for 2 twins"):
        PressureSensor(2).reset([0, 1], [np.random.default_rng(0)])
