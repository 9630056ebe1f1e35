"""Drives along which pictures are taken: instants by way, motion between samples, files."""

import numpy as np
import pytest

from aoro_gym.sensors.dataset import Drive
from aoro_gym.sensors.dataset.taking import machine_at
from aoro_gym.sensors.lidar import Motion
from tests.sensors.dataset.scenes import passing


def drive(seconds: float = 10.0) -> Drive:
    """From standstill at a constant acceleration of 0.2 m/s²: the way is 0.1 t²."""
    time = np.arange(0.0, seconds + 1e-9, 0.05)
    position = np.column_stack([0.1 * time**2, 0 * time, 0 * time])
    return Drive(Motion(time, position, 0 * time, 0 * time, 0 * time), position[:, :2], "end of path reached")


def test_pictures_are_at_equal_distances_of_the_way():
    """Between samples the way is a straight line, at most a v² dt² / 8 s = 2e-4 m off the parabola."""
    one, count = drive(), 7
    ways = 0.1 * one.instants(count) ** 2
    first, last = 0.1 * 0.1**2, 0.1 * 9.7**2
    np.testing.assert_allclose(ways, first + (np.arange(count) + 0.5) / count * (last - first), atol=2e-4)


def test_a_drive_that_is_too_short_says_why_it_ended():
    with pytest.raises(ValueError, match=r"after 0.35 s \(end of path reached\), too soon"):
        drive(0.35).instants(1)


def test_the_motion_around_an_instant_is_that_of_the_drive():
    one = drive()
    for instant in (0.1, 3.333, one.last):
        part = one.around(instant)
        assert part.time[0] <= instant - 0.1 + 1e-9 and part.time[-1] >= instant + 0.3 - 1e-9
        np.testing.assert_allclose(machine_at(part, instant), machine_at(one.motion, instant), atol=1e-12)


def test_it_comes_back_from_its_file(tmp_path):
    one = drive()
    posture = np.linspace(0.0, 1.0, 9) + 0.1 * one.motion.time[:, None]
    one = Drive(one.motion, one.path, one.ending, posture)
    one.save(tmp_path / "drive.npz")
    again = Drive.load(tmp_path / "drive.npz")
    assert again.ending == one.ending
    for name in ("time", "position", "roll", "pitch", "yaw"):
        np.testing.assert_array_equal(getattr(again.motion, name), getattr(one.motion, name))
    assert again.posture is not None
    np.testing.assert_allclose(again.posture_at(3.333), np.linspace(0.0, 1.0, 9) + 0.3333, atol=1e-12)
    np.testing.assert_array_equal(again.places[:, 3], posture[:, 0])


def test_poses_between_samples():
    """Places by straight lines; turned by the mean of two rotations, which is the middle one."""
    motion = passing(2.0, 0.4)
    found = machine_at(motion, 0.525)
    np.testing.assert_allclose(found[:3, 3], [0.05, 0.0, 0.0], atol=1e-6)
    assert np.arctan2(found[1, 0], found[0, 0]) == pytest.approx(0.4 * 0.025, abs=1e-6)
