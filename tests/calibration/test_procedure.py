"""The published procedure on the twin: measured curve, turn times, driving pressure."""

import numpy as np
import pytest

from aoro_gym.calibration.procedure import (
    measured_curve,
    motor_pressure,
    published_procedure,
    rolling_pressure,
    solve,
    turn_time,
)
from aoro_gym.machine import Machine
from aoro_gym.validation.published import published, valve_flow


@pytest.fixture(scope="module")
def calibrated():
    return published_procedure(Machine.load("aoro_datasheet"))


def test_the_measured_flows_are_the_curve():
    machine = measured_curve(Machine.load("aoro_datasheet"))
    table = valve_flow()
    for side in ("left", "right"):
        flows = dict(zip(table["signal_V"], table[f"{side}_L_per_min"], strict=True))
        full = machine.entries[f"steering.valve.nominal_flow_{side}"].value
        assert full == flows[2.0]
        for volts, name in ((1.0, "1V0"), (1.5, "1V5")):
            assert machine.entries[f"steering.valve.opening_{side}_{name}"].value * full == pytest.approx(flows[volts])


@pytest.mark.slow
def test_full_turns_take_the_measured_times(calibrated):
    # the last of three brackets of a quarter each is an 8³th of the range, in which a straight line is left
    assert turn_time("left")(calibrated)[0] == pytest.approx(1.98, abs=0.002)
    assert turn_time("right")(calibrated)[0] == pytest.approx(published("turn_time_right"), abs=0.002)


@pytest.mark.slow
def test_driving_needs_the_measured_pressure(calibrated):
    assert motor_pressure(calibrated)[0] == pytest.approx(published("motor_pressure"), rel=2e-3)


def test_what_cannot_be_reached_names_key_and_range():
    def measure(machine):
        return np.asarray(machine.value("steering.pump.margin")) / 1e5

    with pytest.raises(ValueError, match=r"no steering\.pump\.margin within its range .* reaches 99"):
        solve(Machine.load("aoro_datasheet"), "steering.pump.margin", 99.0, measure)


@pytest.mark.slow
def test_driving_pressure_has_a_closed_form(calibrated):
    """The simulated drive against torque balance; tanh at 1.25 rad/s over 0.05 rad/s leaves rolling resistance whole."""
    assert rolling_pressure(calibrated)[0] == pytest.approx(motor_pressure(calibrated)[0], rel=2e-3)
    bare = calibrated.set({"driveline.brake.disc_torque": 0.0})
    assert rolling_pressure(calibrated, brake=False)[0] == pytest.approx(motor_pressure(bare)[0], rel=2e-3)
