"""The plants' sensors: delay, lag and smoothing by themselves, noise by its figures, seeds."""

import numpy as np
import pytest

from aoro_gym.diagnosis_benchmark.plants.constants import constants_of
from aoro_gym.diagnosis_benchmark.plants.sensors import (
    RATE,
    SensorNoise,
    angle_chain,
    half_gain_time,
    measured,
    smoothed,
)

TIME = 1e-3 * np.arange(4001, dtype=np.float64)


@pytest.fixture(scope="module")
def two(machine):
    return constants_of([machine.entries] * 2)


def test_a_ramp_comes_late_by_delay_and_lag(two):
    p = {**two, "sensor.delay": np.array([0.013, 0.0]), "sensor.lag": np.array([0.0, 0.021])}
    ramp = np.repeat(TIME[:, None], 2, axis=1)
    late = ramp - angle_chain(TIME, ramp, p)
    assert late[-1] == pytest.approx([0.013, 0.021], rel=1e-9)


@pytest.mark.parametrize("level", [0, 1])
def test_smoothing_halves_the_amplitude_at_its_frequency_without_delay(level):
    frequency = 5.0
    tick = np.arange(2000) / RATE
    wave = np.sin(2.0 * np.pi * frequency * tick)[:, None]
    calm = smoothed(wave, np.array([1.0 / (2.0 * np.pi * frequency)]), level)
    inner = slice(400, 1600)
    assert calm[inner] == pytest.approx(0.5 * wave[inner], abs=2e-3)
    assert half_gain_time(np.array([0.02, 0.0]), level) == pytest.approx([0.02, 0.0], rel=1e-3)


def test_noise_is_what_it_says_and_repeats_by_its_seed(two):
    still = {
        "joint_angle": np.full((4001, 2), 0.2),
        "engine_speed": np.full((4001, 2), 167.0),
        "pressure_a": np.full((4001, 2), 50e5),
    }
    ticks, first = measured(TIME, still, two, 0, [1, 2])
    _, again = measured(TIME, still, two, 0, [1, 3])
    assert ticks == pytest.approx(np.arange(401) / RATE)
    assert np.array_equal(first["joint_angle"][:, 0], again["joint_angle"][:, 0])
    assert not np.array_equal(first["joint_angle"][:, 1], again["joint_angle"][:, 1])
    noise = SensorNoise()
    bit = 2.0 * np.pi / 2**noise.angle_bits
    amplitudes = [a for _, a in noise.angle_orders] + [a for *_, a in noise.angle_lines]
    expected = np.sqrt(noise.angle_white**2 + 0.5 * np.sum(np.square(amplitudes)) + bit**2 / 12.0)
    assert np.std(first["joint_angle"][:, 0]) == pytest.approx(expected, rel=0.15)  # beats over 4 s
    turns = first["joint_angle"][:, 0] / bit
    assert turns == pytest.approx(np.round(turns))
    spectrum = np.abs(np.fft.rfft(first["joint_angle"][:400, 0] - 0.2))
    peak = np.fft.rfftfreq(400, 1.0 / RATE)[1 + np.argmax(spectrum[1:])]
    alias = abs(3.5 * 167.0 / (2.0 * np.pi) - RATE), abs(4.0 * 167.0 / (2.0 * np.pi) - RATE)
    assert min(abs(peak - a) for a in alias) < 0.5  # orders 3½ and 4 show near 6 and 7 Hz


def test_exact_sensors_are_exact(two):
    angle = np.repeat(np.sin(TIME)[:, None], 2, axis=1)
    _, shown = measured(TIME, {"joint_angle": angle, "engine_speed": angle + 160.0}, two, 0, [0, 0], SensorNoise.none())
    assert np.array_equal(shown["joint_angle"], angle[::10])


def test_too_sparse_outputs_are_refused(two):
    with pytest.raises(ValueError, match="100 Hz"):
        measured(TIME * 7.0, {"engine_speed": np.zeros((4001, 2))}, two, 0, [0, 0])
