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
        "engine_angle": np.repeat(167.0 * np.arange(401)[:, None] / RATE, 2, axis=1),
        "pressure_a": np.full((401, 2), 50e5),
    }
    first, again = (measured(still, two, 0, seeds) for seeds in ([1, 2], [1, 3]))
    assert set(first) == {"joint_angle", "pressure_a"}
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
    outputs = {"joint_angle": angle, "engine_angle": angle[::10], "engine_speed": angle[::10] + 160.0}
    shown = measured(outputs, two, 0, [0, 0], SensorNoise.none())
    assert np.array_equal(shown["joint_angle"], angle[::10])
    assert np.array_equal(shown["engine_speed"], outputs["engine_speed"])


def test_a_run_that_ended_is_smoothed_by_itself(two):
    p = {**two, "sensor.smoothing": np.array([0.02, 0.02])}
    rng = np.random.default_rng(0)
    outputs = {name: rng.standard_normal((101, 2)) for name in ("joint_angle", "engine_angle")}
    whole = measured(outputs, p, 1, [1, 2], lengths=[61, 101])
    alone = measured(
        {name: values[:61, :1] for name, values in outputs.items()}, {k: v[:1] for k, v in p.items()}, 1, [1]
    )
    assert whole["joint_angle"][:61, :1] == pytest.approx(alone["joint_angle"], rel=1e-12)


def test_angles_that_do_not_fit_the_ticks_are_refused(two):
    with pytest.raises(ValueError, match=r"joint angle has 4001 samples, .* 300 ticks"):
        measured({"joint_angle": np.zeros((4001, 2)), "engine_angle": np.zeros((300, 2))}, two, 0, [0, 0])
