"""The RTK-GPS: its errors, its clock, what roll does to high antennas, and losses of the fix."""

import math
from itertools import pairwise

import numpy as np
import pytest

from aoro_gym.sensors import Antennas, FixLoss, Gps, GpsNoise, Localisation
from aoro_gym.sensors.attitude import in_world, wrapped
from aoro_gym.sensors.gps import FIXED, FLOAT, NONE, RATE

STEP = 0.05
EXACT = GpsNoise()


def at_rest(gps, steps, *, count=1, roll=0.0, pitch=0.0, yaw=0.0):
    """Readings of machines that stand at the origin, one a control step."""
    still = np.zeros(count)
    return [gps.measure(np.zeros((count, 3)), still + roll, still + pitch, still + yaw, k * STEP) for k in range(steps)]


def test_rotation_is_that_of_the_three_angles():
    roll, pitch, yaw = 0.2, -0.3, 1.1
    s, c = np.sin, np.cos
    x = np.array([[1, 0, 0], [0, c(roll), -s(roll)], [0, s(roll), c(roll)]])
    y = np.array([[c(pitch), 0, s(pitch)], [0, 1, 0], [-s(pitch), 0, c(pitch)]])
    z = np.array([[c(yaw), -s(yaw), 0], [s(yaw), c(yaw), 0], [0, 0, 1]])
    vector = np.array([0.3, -0.7, 2.0])
    np.testing.assert_allclose(in_world([roll], [pitch], [yaw], vector)[0], z @ y @ x @ vector, atol=1e-15)
    assert wrapped(np.pi + 0.1) == pytest.approx(0.1 - np.pi)


@pytest.mark.parametrize("yaw", [0.0, 2.5, -3.0])
def test_exact_receiver_shows_antenna_and_heading(yaw):
    roll = 0.1
    reading = at_rest(Gps(noise=EXACT), 1, roll=roll, yaw=yaw)[0]
    expected = in_world([roll], [0.0], [yaw], Antennas().main)
    np.testing.assert_allclose(reading.position, expected, atol=1e-12)
    np.testing.assert_allclose(reading.heading, yaw, atol=1e-12)
    # left side up: the antenna leans to the right by its height times the sine of the roll
    across = (-np.sin(yaw), np.cos(yaw)) @ reading.position[0, :2]
    assert across == pytest.approx(0.6 * math.cos(roll) - 2.2 * math.sin(roll))


def test_errors_are_two_centimetres_and_wander():
    runs, steps = 400, 2401
    noise = GpsNoise.typical()
    gps = Gps(runs, noise)
    readings = at_rest(gps, steps, count=runs)
    error = np.array([r.position for r in readings])[::20] - np.array(Antennas().main)  # one a second
    plan = np.sqrt(np.mean(np.sum(error[..., :2] ** 2, axis=-1)))
    # the drift of 400 runs over two correlation times: about 400 x 3 independent samples of two axes
    assert plan == pytest.approx(0.02, rel=0.1)
    assert error[..., 2].std() == pytest.approx(2 * 0.02 / math.sqrt(2), rel=0.1)
    lag = 60
    correlation = np.mean(error[:-lag, :, 0] * error[lag:, :, 0]) / np.mean(error[..., 0] ** 2)
    # two thirds of the power after one correlation time
    assert correlation == pytest.approx(2 / 3 * math.exp(-1), abs=0.08)
    heading = np.array([r.heading for r in readings])[::20]
    # along and across the baseline; only the error across turns it
    assert heading.std() == pytest.approx(noise.relative / Antennas().baseline, rel=0.02)


def test_solutions_come_ten_times_a_second_and_late():
    latency, speed = 0.07, 2.0
    gps = Gps(noise=EXACT, latency=latency)
    fresh, previous = [], None
    for k in range(200):
        now = k * STEP
        reading = gps.measure([[speed * now, 0.0, 0.0]], [0.0], [0.0], [0.0], now)
        fresh.append(reading.fresh[0])
        if k > 4:
            assert latency - 1e-9 <= reading.age[0] < latency + 1 / RATE + STEP
            # shows where the antenna was at the instant that it states
            assert reading.position[0, 0] == pytest.approx(1.0 + speed * (now - reading.age[0]))
        if previous is not None and not fresh[-1]:
            assert reading.position[0, 0] == previous
        previous = reading.position[0, 0]
    assert sum(fresh) == pytest.approx(200 * STEP * RATE, abs=1.5)


def test_losses_take_their_share_of_the_time():
    runs, steps = 200, 2400
    loss = FixLoss(interval=20.0, float_duration=5.0, none_duration=2.0, none_share=0.5)
    readings = at_rest(Gps(runs, GpsNoise.typical(loss)), steps, count=runs)
    quality = np.array([r.quality for r in readings])[steps // 2 :]
    total = 20.0 + 0.5 * 5.0 + 0.5 * 2.0
    # 200 runs of 60 s hold some 500 losses
    for state, share in ((FIXED, 20.0 / total), (FLOAT, 2.5 / total), (NONE, 1.0 / total)):
        assert np.mean(quality == state) == pytest.approx(share, rel=0.2)
    error = np.array([r.position[:, :2] for r in readings]) - np.array(Antennas().main[:2])
    state = np.array([r.quality for r in readings])
    assert np.abs(error[state == FLOAT]).mean() > 5 * np.abs(error[state == FIXED]).mean()
    for before, after in pairwise(readings):
        lost = after.quality == NONE
        np.testing.assert_array_equal(after.position[lost], before.position[lost])
        assert not after.fresh[lost].any()


def test_without_losses_the_fix_stays():
    for reading in at_rest(Gps(3), 50, count=3):
        np.testing.assert_array_equal(reading.quality, FIXED)


def test_localisation_brings_the_antenna_down_and_moves_on():
    """Exact sensors on a circle: the pose is exact but for the chords that the receiver's clock cuts."""
    place = np.array([1.7, 0.0, 0.0])
    gps, here = Gps(noise=EXACT, latency=0.05), Localisation()
    speed, rate, roll = 1.5, 0.2, 0.15
    worst = 0.0
    for k in range(100):
        now = k * STEP
        yaw = rate * now
        point = speed / rate * np.array([math.sin(yaw), 1.0 - math.cos(yaw), 0.0])  # the point moves along the heading
        hinge = point - in_world([roll], [0.0], [yaw], place)[0]
        reading = gps.measure([hinge], [roll], [0.0], [yaw], now)
        if k == 0:
            here.begin(reading, [roll], [0.0], place, [0])
        else:
            here.update(reading, [roll], [0.0], place, speed=[speed], yaw_rate=[rate], step=STEP)
        worst = max(worst, float(np.hypot(*(here.position[0] - point[:2]))))
        assert abs(here.heading[0] - yaw) < 1e-3
    sagitta = (rate * STEP) ** 2 / 8 * (speed / rate + 3.0)
    assert worst < 10 * sagitta


def test_dead_reckoning_carries_through_a_loss():
    noise = GpsNoise(loss=FixLoss(interval=1e-3, none_duration=1e6, none_share=1.0))
    gps, here = Gps(noise=noise), Localisation()
    for k in range(60):
        reading = gps.measure([[k * STEP, 0.0, 0.0]], [0.0], [0.0], [0.0], k * STEP)
        if k == 0:
            here.begin(reading, [0.0], [0.0], [1.7, 0.0, 0.0], [0])
        else:
            here.update(reading, [0.0], [0.0], [1.7, 0.0, 0.0], speed=[1.0], yaw_rate=[0.0], step=STEP)
    assert reading.quality[0] == NONE
    np.testing.assert_allclose(here.position, [[1.7 + 59 * STEP, 0.0]], atol=1e-9)


def test_wrong_values_are_named():
    with pytest.raises(ValueError, match="latency is -1"):
        Gps(latency=-1)
    with pytest.raises(ValueError, match=r"interval is 0\.2 s"):
        Gps(interval=0.2)
    with pytest.raises(ValueError, match=r"baseline is 0 m, but must be at least 0\.1 m"):
        Antennas(main=(0.0, 0.0, 2.0), auxiliary=(0.0, 0.0, 1.0))
    with pytest.raises(ValueError, match="white is -1"):
        GpsNoise(white=-1)
    with pytest.raises(ValueError, match="none_share is 2"):
        FixLoss(none_share=2)
    with pytest.raises(ValueError, match=r"position has shape \(2, 3\)"):
        Gps().measure(np.zeros((2, 3)), [0.0], [0.0], [0.0], 0.0)
