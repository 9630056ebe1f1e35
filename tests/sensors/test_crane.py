"""Sensors of a crane: noise of each, delay, sample by sample and as a whole log, and bad input."""

import math

import numpy as np
import pytest

from aoro_gym.recording.commands import JOINTS
from aoro_gym.sensors import CraneNoise, CraneSensors, JointAngleNoise, PressureNoise
from aoro_gym.sensors.crane import PRESSURES, RATE_SAMPLES, slopes

EXACT = CraneNoise(JointAngleNoise(), 0.0, PressureNoise(), PressureNoise(low=0.0, high=4e4))
TIME = np.arange(0, 4001) * 1e-3


def channels(rate: float = 0.0) -> dict[str, np.ndarray]:
    """Outputs of a crane whose joints rest for a second, and then all move at ``rate``."""
    way = rate * np.maximum(TIME - 1.0, 0.0)
    return {
        **{f"crane_joint_{joint}": 0.1 * (k + 1) + way for k, joint in enumerate(JOINTS)},
        **{name: np.full(len(TIME), 1e6 * (k + 1)) for k, name in enumerate(PRESSURES)},
        "crane_tip_load": np.full(len(TIME), 5000.0),
    }


def test_a_log_of_exact_sensors_is_what_the_twin_says_and_rates_are_late():
    """A rate comes up over the samples of its line, and is exact from then on."""
    ticks, found = CraneSensors(noise=EXACT).record(channels(0.2), TIME, np.random.default_rng(1))
    assert set(found) == {*channels(), *(f"crane_rate_{joint}" for joint in JOINTS)}
    steady = ticks > 1.0 + 0.01 * RATE_SAMPLES
    for name, true in channels(0.2).items():
        np.testing.assert_allclose(found[name], true[np.rint(1e3 * ticks).astype(int)], atol=1e-12)
    for joint in JOINTS:
        rate = found[f"crane_rate_{joint}"]
        np.testing.assert_allclose(rate[steady], 0.2, rtol=1e-9)
        assert np.abs(rate[ticks < 1.0]).max() < 1e-12
        assert 0.0 < rate[np.argmin(np.abs(ticks - 1.02))] < 0.2


def test_noise_is_of_the_size_that_it_says_and_differs_by_sensor():
    """White noise with the quantiser's: standard deviations over 400 samples, exact to 1/√800 = 3.5 %, five times of it."""
    ticks, found = CraneSensors().record(channels(), TIME, np.random.default_rng(2))
    noise = CraneNoise()
    step = noise.angle.resolution
    angle = math.sqrt(noise.angle.white**2 + step**2 / 12.0)
    for joint in JOINTS[:3]:
        values = found[f"crane_joint_{joint}"]
        assert np.std(values) < 2.0 * angle and np.unique(np.rint(values / step)).size <= 4
        assert np.abs(values / step - np.rint(values / step)).max() < 1e-9
    assert np.std(found["crane_joint_telescope"]) == pytest.approx(noise.telescope, rel=0.18)
    for name in PRESSURES:
        measured = found[name]
        size = math.sqrt(noise.pressure.white**2 + noise.pressure.resolution**2 / 12.0)
        assert np.std(measured) == pytest.approx(size, rel=0.18)
    zeros = [found[name].mean() - channels()[name][0] for name in PRESSURES]
    assert len(np.unique(np.round(zeros))) == len(PRESSURES) and np.std(zeros) < 3.0 * noise.pressure.zero_error
    assert abs(found["crane_tip_load"].mean() - 5000.0) < 5.0 * noise.load.zero_error
    again = CraneSensors().record(channels(), TIME, np.random.default_rng(2))[1]
    assert all(np.array_equal(again[name], values) for name, values in found.items())
    assert len(ticks) == 401


def test_a_delay_shows_older_joints():
    late = CraneNoise(JointAngleNoise(), 0.0, PressureNoise(), PressureNoise(high=4e4), delay=0.03)
    found = CraneSensors(noise=late).record(channels(0.2), TIME, np.random.default_rng(1))[1]
    exact = CraneSensors(noise=EXACT).record(channels(0.2), TIME, np.random.default_rng(1))[1]
    np.testing.assert_allclose(found["crane_joint_lift"][3:], exact["crane_joint_lift"][:-3], atol=1e-9)


def test_many_cranes_are_measured_sample_by_sample_and_reset_alone():
    sensors = CraneSensors(3)
    sensors.reset(np.arange(3), np.random.default_rng(4).spawn(3))
    joints, pressures, load = np.full((4, 3), 0.2), np.full((len(PRESSURES), 3), 5e6), np.full(3, 3000.0)
    shown = [sensors.measure(joints, pressures, load, np.full(3, 0.01 * k)) for k in range(4)]
    assert shown[0][0].shape == (4, 3) and shown[0][1].shape == (8, 3) and shown[0][2].shape == (3,)
    assert np.ptp([one[0][3, 0] for one in shown]) > 0.0
    sensors.reset(np.array([1]), np.random.default_rng(4).spawn(3)[1:2])
    one = sensors.measure(joints[:, 1:2], pressures[:, 1:2], load[1:2], np.zeros(1), np.array([1]))
    for part, whole in zip(one, shown[0], strict=True):
        np.testing.assert_array_equal(part[..., 0], whole[..., 1])


def test_slopes_are_those_of_least_squares():
    values = np.random.default_rng(0).normal(size=40)
    line = [
        np.polyfit(0.01 * np.arange(RATE_SAMPLES), values[k - RATE_SAMPLES + 1 : k + 1], 1)[0] for k in range(10, 40)
    ]
    np.testing.assert_allclose(slopes(values)[10:], line, rtol=1e-9)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: CraneNoise(telescope=-0.1), "telescope is -0.1 m"),
        (lambda: CraneNoise(delay=-1.0), "delay is -1 s"),
        (lambda: CraneSensors(0), "num_twins is 0"),
        (
            lambda: CraneSensors(2).measure(np.zeros((3, 2)), np.zeros((8, 2)), np.zeros(2), np.zeros(2)),
            r"joints has shape \(3, 2\), but must be \(4, 2\)",
        ),
    ],
)
def test_what_is_wrong_is_told(call, words):
    with pytest.raises(ValueError, match=words):
        call()
