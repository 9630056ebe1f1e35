"""The inertial unit: rms of its errors, and the specific force in closed form."""

import math
from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from aoro_gym.sensors import Imu, ImuNoise
from aoro_gym.sensors.imu import specific_force


def test_errors_have_their_rms():
    runs, noise = 4000, ImuNoise.typical()
    imu = Imu(runs, noise)
    reading = imu.measure(np.zeros((runs, 3)), np.zeros((runs, 3)), np.zeros(runs), np.zeros(runs), 1.0)
    rel = 4 / math.sqrt(2 * runs)  # of a standard deviation, four of its own
    assert reading.force is not None
    assert reading.rates.std() == pytest.approx(math.hypot(noise.rate_white, noise.rate_bias), rel=rel)
    assert reading.force.std() == pytest.approx(math.hypot(noise.force_white, noise.force_bias), rel=rel)
    for angle in (reading.roll, reading.pitch):
        assert angle.std() == pytest.approx(math.hypot(noise.attitude_white, noise.attitude_drift), rel=rel)
    assert abs(np.corrcoef(reading.roll, reading.pitch)[0, 1]) < 5 / math.sqrt(runs)


def test_biases_wander_slowly_and_white_noise_does_not():
    imu = Imu(500, ImuNoise(rate_bias=1.0, bias_time=100.0, attitude_white=1.0))
    zero = np.zeros(500)
    first, second = (imu.measure(np.zeros((500, 3)), np.zeros((500, 3)), zero, zero, t) for t in (0.0, 1.0))
    change = second.rates - first.rates
    assert change.std() == pytest.approx(math.sqrt(2 * (1 - math.exp(-0.01))), rel=0.1)
    assert abs(np.corrcoef(first.roll, second.roll)[0, 1]) < 5 / math.sqrt(500)


def test_specific_force_of_rest_circle_and_lever():
    zero = np.zeros((1, 3))
    roll, pitch = np.array([0.1]), np.array([-0.2])
    rest = specific_force(zero, zero, zero, zero, roll, pitch)[0]
    assert np.linalg.norm(rest) == pytest.approx(9.81)
    # nose up: the accelerometer's x feels a push forward; left side up: a push to the left
    np.testing.assert_allclose(
        rest / 9.81, [math.sin(0.2), math.sin(0.1) * math.cos(0.2), math.cos(0.1) * math.cos(0.2)], rtol=1e-12
    )
    level = np.zeros(1)
    speed, rate = np.array([[2.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 0.5]])
    circle = specific_force(speed, zero, rate, zero, level, level, place=(1.0, 0.0, 0.0))[0]
    np.testing.assert_allclose(circle, [-0.25, 1.0, 9.81], atol=1e-12)
    spin = specific_force(zero, zero, zero, np.array([[0.0, 0.0, 3.0]]), level, level, place=(2.0, 0.0, 0.0))[0]
    np.testing.assert_allclose(spin, [0.0, 6.0, 9.81], atol=1e-12)


def test_wrong_values_are_named():
    with pytest.raises(ValueError, match="rate_white is -1"):
        ImuNoise(rate_white=-1)
    with pytest.raises(ValueError, match="bias_time is 0"):
        ImuNoise(bias_time=0)
    with pytest.raises(ValueError, match=r"rates has shape \(1, 2\)"):
        Imu().measure(np.zeros((1, 2)), np.zeros((1, 3)), [0.0], [0.0], 0.0)


def test_typical_errors_are_those_of_the_data_sheets():
    noise = ImuNoise.typical()
    # densities of the MTi-1 over 50 Hz; roll and pitch of the MTi-30 between rest and motion
    assert math.degrees(noise.rate_white) == pytest.approx(0.007 * math.sqrt(50.0))
    assert noise.force_white == pytest.approx(120e-6 * 9.81 * math.sqrt(50.0))
    assert 0.2 <= math.degrees(math.hypot(noise.attitude_white, noise.attitude_drift)) <= 0.5


def test_a_reading_does_not_change():
    reading = Imu().measure(np.zeros((1, 3)), np.zeros((1, 3)), [0.0], [0.0], 0.0)
    with pytest.raises(FrozenInstanceError):
        reading.roll = np.ones(1)  # pyright: ignore[reportAttributeAccessIssue]
