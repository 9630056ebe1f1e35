"""The component families' measuring: lags of ramps by closed form, and steps that stay steps."""

import numpy as np
import pytest

from aoro_gym.diagnosis_benchmark import component_families as component
from aoro_gym.diagnosis_benchmark.component_families import measuring

MIXTURES = [f"mixed_elm_fir_hazel_{number:04d}" for number in (1, 2, 7)]
"""Machines whose command, angle sensor and chain are not all of one family."""
RAMP = np.arange(2000) * measuring.GRID


@pytest.mark.parametrize(
    ("law", "lag"),
    [
        (measuring.delayed, 0.0123),
        (lambda v, lag: measuring.averaged(v, 2 * lag), 0.0137),
        (measuring.lagged, 0.02),
        (measuring.butterworth, 0.03),
        (measuring.updated, 0.0115),
        (lambda v, lag: measuring.ladder(v, lag / 3), 0.024),
        (measuring.bessel, 0.017),
        (lambda v, lag: measuring.decimated(v, 2 * lag), 0.0143),
        (measuring.queued, 0.0171),
        (measuring.tent, 0.0157),
        (lambda v, lag: measuring.hann(v, 2 * lag), 0.0119),
        (measuring.third, 0.021),
        (lambda v, lag: measuring.middle(v, 2 * lag), 0.0133),
        (measuring.twinned, 0.0108),
    ],
)
def test_a_ramp_comes_late_by_the_lag(law, lag: float) -> None:
    assert law(RAMP, lag)[-500:] == pytest.approx(
        RAMP[-500:] - lag, abs=measuring.GRID**2 / 8 / lag
    )  # of a chord over the grid


def test_a_held_ramp_comes_late_by_half_the_period() -> None:
    late = RAMP - measuring.held(RAMP, 0.02)
    assert late.max() == pytest.approx(0.019)  # of 20 samples of 1 ms, the last
    assert late.min() == pytest.approx(0.0, abs=1e-12)


def test_times_are_rounded_to_the_next_cycle_either_way() -> None:
    late = RAMP - measuring.rounded(RAMP, 0.004)
    assert late[:-4].min() == pytest.approx(-0.002) and late.max() == pytest.approx(0.001)  # halves go up


@pytest.mark.parametrize("law", [measuring.beating, measuring.packed])
def test_waits_spread_evenly_between_a_half_and_one_and_a_half(law) -> None:
    late = (RAMP - law(RAMP, 0.01))[100:1940:10]  # eight beats of the clocks
    assert np.mean(late) == pytest.approx(0.01, abs=0.01 / 45)  # half of what a beat of 23 samples climbs in one
    assert np.std(late) == pytest.approx(0.01 / np.sqrt(12), rel=0.05)
    assert late.min() > 0.0049 and late.max() < 0.0151


@pytest.mark.parametrize(
    "law",
    [
        measuring.delayed,
        measuring.averaged,
        measuring.lagged,
        measuring.butterworth,
        measuring.held,
        measuring.bessel,
        measuring.decimated,
        measuring.rounded,
        measuring.queued,
        measuring.tent,
        measuring.hann,
        measuring.third,
        measuring.middle,
        measuring.pulsed,
        measuring.twinned,
        measuring.beating,
        measuring.packed,
    ],
)
def test_what_stands_still_passes(law) -> None:
    assert law(np.full(300, 3.7), 0.02) == pytest.approx(3.7, rel=1e-12)


@pytest.mark.parametrize("family", [*component.ALL_FAMILIES, *MIXTURES])
def test_a_logged_ramp_is_late_by_the_lags_of_sensor_and_chain(family: str) -> None:
    machine = component.nominal(family)
    machine = component.apply("measuring_chain", family, machine, 0.02)
    machine = component.apply("sensor_filter", family, machine, 0.015)
    fine = np.outer(0.05 * RAMP, np.ones(7))
    times = np.arange(200) * 0.01
    made = component.GROUP.family_of(family).derived(machine)
    log = measuring.measured(
        component.GROUP.family_of(family).parts, fine, times, made, np.random.default_rng(0), False
    )
    chain = component.measure("measuring_chain", family, machine)
    sensor = component.measure("sensor_filter", family, machine) + component.measure("sensor_delay", family, machine)
    assert np.mean(0.05 * times[100:] - log["pressure_a"][100:]) == pytest.approx(0.05 * chain, rel=1e-6)
    late = np.mean(0.05 * times[100:] - log["joint_angle"][100:])
    assert late == pytest.approx(0.05 * (chain + sensor), abs=0.05 * 1.5e-3)  # a hold ends on the grid of 1 ms


@pytest.mark.parametrize("family", component.ALL_FAMILIES)
def test_the_logged_range_of_the_joint_is_what_effects_measure(family: str) -> None:
    nominal = component.nominal(family)
    for machine in (nominal, *(component.apply("sensor_gain", family, nominal, size) for size in (0.08, -0.08))):
        made = component.GROUP.family_of(family).derived(machine)
        ends = []
        for side in (-1.0, 1.0):
            fine = np.zeros((400, 7))
            fine[:, 0] = side * made["stop_angle"]
            parts, times = component.GROUP.family_of(family).parts, np.arange(40) * 0.01
            log = measuring.measured(parts, fine, times, made, np.random.default_rng(0), False)
            ends.append(log["joint_angle"][-1])
        range_ = (ends[1] - ends[0]) / (2 * made["stop_angle"])
        assert range_ == pytest.approx(component.measure("sensor_gain", family, machine), rel=1e-5)


@pytest.mark.parametrize("family", ["fir", "hazel", "maple", "oak", "larch", *component.SEALED, *MIXTURES[:2]])
def test_a_command_is_late_by_bus_or_driver(family: str) -> None:
    machine = component.apply("command_delay", family, component.nominal(family), 0.02)
    made = component.GROUP.family_of(family).derived(machine)
    late = np.mean(RAMP[1000:] - component.GROUP.command(family, RAMP, made)[1000:]) + made["command_delay"]
    assert late == pytest.approx(component.measure("command_delay", family, machine), abs=1.5e-3)
