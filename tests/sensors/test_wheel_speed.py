"""Wheel speeds from pulses: exact at constant speed, limited while no pulse comes, zero at rest, signed."""

import math

import numpy as np
import pytest

from aoro_gym.sensors import WheelSpeedNoise, WheelSpeedSensor
from aoro_gym.sensors.wheel_speed import ground_speed

STEP, TEETH = 0.05, 60
CLEAN = WheelSpeedNoise(pulses=TEETH)
PITCH = 2 * math.pi / TEETH


def drive(sensor, rates, start=0.0):
    return np.array([sensor.measure(np.full((1, 4), rate), start + k * STEP)[0] for k, rate in enumerate(rates)])


@pytest.mark.parametrize("rate", [1.25, 8.0, -2.0])
def test_constant_speed_is_measured_exactly_between_pulses(rate):
    sensor = WheelSpeedSensor(noise=CLEAN)
    shown = drive(sensor, [rate] * 60)
    np.testing.assert_allclose(shown[20:], rate, rtol=1e-9)
    assert (np.abs(shown) < abs(rate) * (1 + 1e-9)).all()


def test_teeth_and_clock_spread_the_speed():
    noise = WheelSpeedNoise(pulses=TEETH, tooth_error=0.01)
    shown = drive(WheelSpeedSensor(noise=noise), [PITCH / STEP] * 400)[10:]  # a tooth a step
    # two teeth make a period, each off by 1 % of the pitch; 60 of them a wheel
    assert (shown / (PITCH / STEP) - 1).std() == pytest.approx(0.01 * math.sqrt(2), rel=0.35)
    coarse = WheelSpeedNoise(pulses=TEETH, timer=0.02)
    shown = drive(WheelSpeedSensor(noise=coarse), [1.3] * 200)[10:]
    periods = PITCH / shown / 0.02  # one tooth in a whole number of the clock's steps
    # but where the last pulse's rounded time lies so far back that the next one is overdue
    assert np.mean(np.abs(periods - np.round(periods)) < 1e-6) > 0.8
    assert len(np.unique(np.round(periods))) > 1


def test_a_stopping_wheel_fades_and_is_then_said_to_stand():
    sensor = WheelSpeedSensor(noise=CLEAN)
    drive(sensor, [3.0] * 20)
    shown = drive(sensor, [0.0] * 20, start=20 * STEP)[:, 0]
    assert (np.diff(shown) <= 1e-12).all()
    waited = STEP * np.arange(20)
    assert (shown <= PITCH / np.maximum(waited - STEP, 1e-9) + 1e-9).all()
    assert shown[-1] == 0.0


def test_exact_sensor_and_ground_speed():
    sensor = WheelSpeedSensor(2, WheelSpeedNoise())
    rates = np.array([[1.0, 2.0, 3.0, 9.0], [0.0, 1.0, 1.0, 1.0]])
    np.testing.assert_array_equal(sensor.measure(rates, 0.0), rates)
    np.testing.assert_allclose(ground_speed(rates, 0.5), [1.25, 0.5])


def test_wrong_values_are_named():
    with pytest.raises(ValueError, match="pulses is -1"):
        WheelSpeedNoise(pulses=-1)
    with pytest.raises(ValueError, match=r"tooth_error is .*, but must be in \[0, 0\.2\]"):
        WheelSpeedNoise(tooth_error=0.5)
    with pytest.raises(ValueError, match=r"rate has shape \(1, 3\)"):
        WheelSpeedSensor().measure(np.zeros((1, 3)), 0.0)
