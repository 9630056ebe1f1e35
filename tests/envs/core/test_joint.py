"""The joint as a controller knows it: angle and rate of the samples, and how the noise is scaled."""

import numpy as np
import pytest

from aoro_gym.envs.core.joint import MeasuredJoint
from aoro_gym.sensors import JointAngleNoise, JointAngleSensor

STEP, FRAMES = 0.01, 3


def joint(num_envs: int, noise: JointAngleNoise, kept: int = 5) -> MeasuredJoint:
    return MeasuredJoint(num_envs, noise, interval=STEP, frames=FRAMES, kept=kept)


def test_a_ramp_has_its_slope():
    measured, slopes = joint(2, JointAngleNoise()), np.array([0.4, -0.1])
    measured.begin(np.zeros(2), np.arange(2))
    np.testing.assert_array_equal(measured.rate, 0.0)
    for step in range(1, 3):
        instants = STEP * np.arange(FRAMES * (step - 1) + 1, FRAMES * step + 1)
        measured.update(slopes * instants[:, None], np.full(2, instants[-1]))
    np.testing.assert_allclose(measured.angle, slopes * 2 * FRAMES * STEP, rtol=1e-15)
    # six samples have been taken, five are kept: all on the line, so its slope is exact to rounding
    np.testing.assert_allclose(measured.rate, slopes, rtol=1e-13)


def test_rate_is_the_least_squares_slope():
    measured, angles = joint(1, JointAngleNoise(), kept=FRAMES), np.array([[0.1], [0.4], [0.2]])
    measured.update(angles, np.array([0.03]))
    assert measured.rate[0] == pytest.approx(np.polyfit(STEP * np.arange(FRAMES), angles[:, 0], 1)[0])


def test_noise_is_that_of_the_sensor_times_its_scale():
    noise, time = JointAngleNoise.published(), np.full(3, 0.03)
    measured, sensor = joint(3, noise), JointAngleSensor(3, noise, interval=STEP)
    for each in (measured, sensor):
        each.reset(np.arange(3), np.random.default_rng(1).spawn(3))
    measured.scale[:] = [0.0, 1.0, 2.0]
    angles = np.full((FRAMES, 3), 0.2)
    measured.update(angles, time)
    error = sensor.measure(angles, time - STEP * np.arange(FRAMES)[::-1, None])[-1] - 0.2
    assert np.all(error != 0.0)
    np.testing.assert_allclose(measured.angle - 0.2, error * [0.0, 1.0, 2.0], atol=1e-16)


def test_only_those_that_begin_are_at_rest():
    measured = joint(2, JointAngleNoise())
    measured.update(np.array([[0.1, 0.1], [0.2, 0.2], [0.3, 0.3]]), np.full(2, 0.03))
    before = measured.rate[0]
    measured.begin(np.array([-0.5]), np.array([1]))
    np.testing.assert_array_equal(measured.angle, [0.3, -0.5])
    np.testing.assert_allclose(measured.rate, [before, 0.0], atol=1e-13)
