"""Effects: on every level the magnitude that was asked for is what a bench test finds, zero is none, and it shows."""

import numpy as np
import pytest

from aoro_gym.diagnosis_benchmark.plants.constants import OFF, constants_of
from aoro_gym.diagnosis_benchmark.plants.effects import EFFECTS, OUTSIDE, with_effects
from aoro_gym.diagnosis_benchmark.plants.plant import CHANNELS, LEVELS, Plant, simulate
from aoro_gym.diagnosis_benchmark.plants.sensors import SensorNoise, measured

CATALOGUE = {
    "sensor_delay", "sensor_filter", "sensor_gain", "measuring_chain", "engine_droop", "pump_response", "pump_limit",
    "command_delay", "spool_lag", "spool_rate", "dead_band", "valve_gain", "valve_hysteresis", "compensator_lag",
    "compensator_opening", "back_pressure", "oil_temperature", "oil_bulk_modulus", "entrained_air", "hose_compliance",
    "cylinder_leakage", "cross_port_leakage", "seal_friction", "joint_friction", "joint_backlash", "frame_compliance",
    "payload", "driveline_resistance", "tire_relaxation", "tire_stiffness", "tire_scrub", "soft_ground",
    "ground_slope",
}  # fmt: skip


LATE = {"tire_stiffness"}
"""Effects that show only once the machine has rolled."""


def magnitudes(effect, constants, level):
    """ΔQ of none, of the range's low end and of its high end, (3,) or (2, 3)."""
    own = np.abs(np.ravel(effect.measure(constants, level))[0]) if effect.relative else 1.0
    sizes = own * np.array([0.0, effect.low, effect.high])
    return np.stack([sizes, -0.5 * sizes]) if effect.parts else sizes


@pytest.fixture(scope="module")
def three(machine):
    return constants_of([machine.entries] * 3)


def test_the_catalogue_is_whole():
    assert set(EFFECTS) - set(OUTSIDE) == CATALOGUE
    assert len(OUTSIDE) >= 4 and all(name.startswith("x_") for name in OUTSIDE)


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("name", EFFECTS)
def test_a_bench_test_finds_what_was_asked_for(name, level, three):
    """To rounding, but for bench tests that resolve less: a spectrum's bins (0.1 %), a tire pushed by a micrometre whose
    bristles yield by σ₀ 1e-6 m / g (5e-5 of it), a patch scaled by bisection over a swivel in steps (1e-6)."""
    effect = EFFECTS[name]
    asked = magnitudes(effect, three, level)
    found = effect.measure(with_effects(three, {name: asked}, level), level) - effect.measure(three, level)
    tolerance = {"measuring_chain": 1e-3, "tire_relaxation": 1e-3}.get(name, 1e-6)
    assert np.abs(found - asked).max() <= tolerance * np.abs(asked).max() + 1e-18


def test_a_magnitude_without_meaning_is_refused(three):
    with pytest.raises(ValueError, match=r"spool_rate = -50 .* steering.valve.spool_rate_limit"):
        with_effects(three, {"spool_rate": -50.0}, 0)
    with pytest.raises(ValueError, match="effect is 'rust'"):
        with_effects(three, {"rust": 1.0}, 0)


def test_effects_leave_the_given_constants_alone(three):
    before = {key: value.copy() for key, value in three.items()}
    with_effects(three, {"oil_temperature": 20.0, "payload": 500.0}, 1)
    assert all(np.array_equal(before[key], three[key]) for key in before)
    assert set(OFF) <= set(three)


@pytest.mark.parametrize("level", LEVELS)
def test_zero_is_none_and_full_severity_shows(level, machine):
    """One batch: the plain machine, the machine with every effect at zero, then every effect at the ends of its range.

    A change shows if it is more than three times what the sensors add: 1.3 mrad rms of the angle's noise, or 0.4 bar of
    pressure's with its quantiser. The signal falls to a level between, which alone shows a hysteresis.
    """
    count, ids = 400, list(EFFECTS)
    runs = 2 + 2 * len(ids)
    plain = constants_of([machine.entries] * runs)
    asked = {}
    for index, name in enumerate(ids):
        effect = EFFECTS[name]
        sizes = magnitudes(effect, constants_of([machine.entries] * 3), level)
        each = np.zeros((2, runs)) if effect.parts else np.zeros(runs)
        each[..., 2 + 2 * index : 4 + 2 * index] = sizes[..., 1:]
        asked[name] = each
    constants = with_effects(plain, asked, level)
    # the first run has never heard of effects
    untouched = {key: value[0] for key, value in constants.items()}
    assert all(untouched[key] == plain[key][0] for key in plain)
    signal = np.zeros((count, runs))
    signal[30:] = 1.0
    signal[310:] = 0.4
    channels = (*CHANNELS, "engine_angle")
    outputs = simulate(Plant(constants, level, joint_angle=-0.6), {"steering_signal": signal}, channels=channels)
    every = {name: values if name == "joint_angle" else values[::10] for name, values in outputs.items()}
    shown = measured(every, constants, level, [0] * runs, SensorNoise.none())
    change = {
        name: np.abs(shown[channel] - shown[channel][:, :1]).max(axis=0)
        for name, channel in (
            ("angle", "joint_angle"),
            ("a", "pressure_a"),
            ("b", "pressure_b"),
            ("pump", "pump_pressure"),
        )
    }
    assert change["angle"][1] < 1e-9 and max(change[name][1] for name in ("a", "b", "pump")) < 1.0
    for index, name in enumerate(ids):
        pair = slice(2 + 2 * index, 4 + 2 * index)
        pressure = max(change[channel][pair].max() for channel in ("a", "b", "pump"))
        seen = change["angle"][pair].max() > 4e-3 or pressure > 1.2e5
        assert seen == (EFFECTS[name].standing and name not in LATE), (name, change["angle"][pair], pressure)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(LATE))
def test_what_shows_late_shows(name, three):
    constants = with_effects(three, {name: magnitudes(EFFECTS[name], three, 0)}, 0)
    signal = np.ones((750, 3))
    outputs = simulate(Plant(constants, 0, joint_angle=-constants["joint.range"]), {"steering_signal": signal})
    change = np.abs(outputs["pressure_a"] - outputs["pressure_a"][:, :1]).max(axis=0)
    assert change[1:].max() > 1.2e5
