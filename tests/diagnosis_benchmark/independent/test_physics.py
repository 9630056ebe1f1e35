"""Closed forms and conservation laws that the independent plants must hold."""

import itertools
import math

import numpy as np
import pytest

from aoro_gym.diagnosis_benchmark.independent import FAMILIES, Run, machine, nominal, trace
from aoro_gym.diagnosis_benchmark.independent.families import GROUP
from tests.diagnosis_benchmark.independent.plants import FRICTIONLESS, back_and_forth, turn


@pytest.mark.parametrize("family", FAMILIES)
def test_oil_of_each_side_is_conserved(family):
    run = back_and_forth(family)
    (log,) = trace([run], step=5e-5, period=2.5e-4)
    made = GROUP.family_of(family).derived(run.machine)
    for side in "ab":
        pressure, volume = log[f"exact_{side}"], log[f"volume_{side}"]
        gain = log[f"flow_{side}"] - log[f"volume_rate_{side}"]
        through = np.concatenate([[0.0], np.cumsum(0.5 * (gain[1:] + gain[:-1]) * 2.5e-4)])
        capacity = GROUP.family_of(family).capacity(made, volume, pressure)
        stored = np.concatenate([[0.0], np.cumsum(0.5 * (capacity[1:] + capacity[:-1]) * np.diff(pressure))])
        assert np.max(np.abs(stored)) > 5e-6  # 5 mL are pressed in
        assert np.allclose(through, stored, rtol=0.0, atol=0.01 * np.max(np.abs(stored)))


@pytest.mark.parametrize("family", FAMILIES)
def test_strokes_take_in_what_the_cylinders_hold(family):
    run = turn(family, 1.0, 2.8)
    (log,) = trace([run], period=0.01)
    made = GROUP.family_of(family).derived(run.machine)
    swept = np.ptp(log["volume_a"])
    assert swept == pytest.approx((made["bore_area"] + made["annulus_area"]) * made["stroke"], rel=0.02)
    assert np.ptp(log["volume_a"] + log["volume_b"]) < 0.35 * swept  # bores and annuli differ


@pytest.mark.parametrize("family", FAMILIES)
def test_motion_dies_out_once_the_valve_is_closed(family):
    command = np.zeros(300)
    command[20:60] = 1.0
    (log,) = trace([Run(family, nominal(family), command, joint_angle=-0.3)])
    energy = log["kinetic_energy"]
    peaks = [energy[start : start + 400].max() for start in range(800, len(energy) - 400, 400)]
    assert peaks[0] > 20.0
    assert all(later < 1.02 * earlier + 0.5 for earlier, later in itertools.pairwise(peaks))
    assert peaks[-1] < 0.05 * peaks[0]


@pytest.mark.parametrize("family", FAMILIES)
def test_nothing_moves_by_itself(family):
    (log,) = trace([Run(family, nominal(family), np.zeros(200), joint_angle=0.2)])
    assert np.ptp(log["angle"]) < 2e-4
    assert log["kinetic_energy"].max() < 0.05


@pytest.mark.parametrize("family", FAMILIES)
def test_mirrored_machine_makes_the_mirrored_turn(family):
    even = nominal(family)
    for name in even:
        if "_left" in name:
            even[name.replace("_left", "_right")] = even[name]
    even |= GROUP.family_of(family).EVEN
    left, right = trace([turn(family, 0.8, 1.2, machine=even), turn(family, -0.8, 1.2, machine=even)], period=0.01)
    assert np.allclose(left["angle"], -right["angle"], atol=2e-5)  # switches of friction differ in the last digit
    assert np.allclose(left["exact_a"], right["exact_b"], atol=1e4)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("late", [0.02, 0.01237])
def test_command_delay_is_exact(family, late):
    healthy = nominal(family)
    slow = healthy | {"command_delay": healthy["command_delay"] + late}
    runs = [turn(family, 0.7, 1.0, rest=0.5, joint_angle=-0.3, machine=one) for one in (healthy, slow)]
    soon, later = trace(runs, period=1e-3)
    times = np.arange(len(soon["angle"])) * 1e-3
    shifted = np.interp(times - late, times, soon["angle"])
    assert np.ptp(soon["angle"]) > 0.1
    assert np.max(np.abs(later["angle"] - shifted)[50:]) < 6e-5  # 0.06 ms at 1 rad/s; pressures settle meanwhile


@pytest.mark.parametrize("family", FAMILIES)
def test_joint_on_its_oil_columns_has_the_linear_natural_frequency(family):
    m = nominal(family) | FRICTIONLESS | {"rest_pressure": 60e5, "rest_difference": 5e5} | GROUP.family_of(family).TIGHT
    m |= {name: 1e-3**exponent for name, exponent in GROUP.family_of(family).SOFT.items()} | {"carcass_damping": 0.0}
    (log,) = trace([Run(family, m, np.zeros(60))])
    made = GROUP.family_of(family).derived(m)
    reduced = made["mass_front"] * made["mass_rear"] / (made["mass_front"] + made["mass_rear"])
    a = made["yaw_inertia_rear"] + reduced * made["centre_rear"] ** 2
    e = made["yaw_inertia_front"] + reduced * made["centre_front"] ** 2
    b = reduced * made["centre_rear"] * made["centre_front"]
    inertia = (a * e - b * b) / (a + e + 2 * b) + made["rod_inertia"]
    stiffness = 0.0
    length = math.sqrt(made["mount_squares"] - 2.0 * made["mount_across"])  # of a cylinder, joint straight
    lever = (made["bore_area"] + made["annulus_area"]) * made["mount_along"] / length
    for side in "ab":
        stiffness += lever**2 / GROUP.family_of(family).capacity_of_side(made, log[f"volume_{side}"][0], 60e5)
    stiffness = 1.0 / (1.0 / stiffness + 1.0 / made["joint_stiffness"])
    rate = log["rate"] - np.mean(log["rate"])
    crossings = np.flatnonzero((rate[:-1] < 0.0) & (rate[1:] >= 0.0))
    moments = crossings + rate[crossings] / (rate[crossings] - rate[crossings + 1])
    period = np.median(np.diff(moments)) * 1e-3
    assert 2.0 * math.pi / period == pytest.approx(math.sqrt(stiffness / inertia), rel=0.03)


def errors(runs, step):
    """Root mean square differences of pressures [Pa] and angle [rad] between a step and its half."""
    whole, half = trace(runs, period=0.01, step=step), trace(runs, period=0.01, step=0.5 * step)
    names = ("exact_a", "exact_b", "exact_pump", "angle")
    rms = [
        [np.sqrt(np.mean((one[name] - two[name]) ** 2)) for name in names] for one, two in zip(whole, half, strict=True)
    ]
    return np.array(rms)


@pytest.mark.parametrize("family", FAMILIES)
def test_half_the_step_changes_nothing(family):
    rms = errors(
        [turn(family, 1.0, 1.2), back_and_forth(family, machine=machine(family, np.random.default_rng(1)))], 1e-4
    )
    assert rms[:, :3].max() < 0.05e5
    assert rms[:, 3].max() < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_half_the_step_changes_nothing_on_many_machines(family):
    rng = np.random.default_rng(2)
    shares = rng.uniform(0.4, 1.0, 24) * rng.choice((-1.0, 1.0), 24)
    rms = errors([turn(family, share, 3.0, machine=machine(family, rng)) for share in shares], 1e-4)
    assert np.quantile(rms[:, :3].max(axis=1), 0.95) < 0.05e5
    assert np.quantile(rms[:, 3], 0.95) < 1e-5
