"""Runs of many twins at once against single ones, and the drive against what its brake must take."""

import math

import numpy as np
import pytest

from aoro_gym.validation.turns import REST_AFTER, TURNS, Turn, motor_pressure_at, repeated, run_turns, stacked

KEY = "steering.valve.spool_time_constant"


def test_stacked_machines_are_the_single_ones(machine):
    pair = machine.scale({KEY: np.array([1.2, 1.5])})
    slow = machine.scale({KEY: 2.0, "oil.bulk_modulus": 0.9})
    all_of_them = stacked([machine, pair, slow])
    assert all_of_them.num_variants == 4
    singles = [machine, pair.variant(0), pair.variant(1), slow]
    for key in machine.entries:
        expected = [single.value(key) for single in singles]
        np.testing.assert_allclose(np.broadcast_to(all_of_them.value(key), 4), expected, rtol=1e-15)
    assert stacked([machine]) is machine
    assert stacked([machine, machine]).num_variants == 2
    alike = machine.set({"oil.gas_fraction": [0.01, 0.01]})
    assert stacked([alike, slow]).num_variants == 2 + slow.num_variants
    assert stacked([alike]).num_variants == 2
    assert repeated(machine, 3).num_variants == 1
    np.testing.assert_allclose(repeated(pair, 2).value(KEY), np.tile(pair.value(KEY), 2), rtol=1e-15)


def test_turns_in_one_launch_are_the_single_ones(machine, left_turn, right_turn):
    turns = (Turn("right", 100.0), Turn("left", 100.0))
    both = run_turns(machine.scale({KEY: np.array([1.0, 1.4])}), turns)
    assert both.angle.shape == both.flow.shape == (len(both.time), 2, 2)
    assert both.diverged == ()
    for index, alone in enumerate((right_turn, left_turn)):
        frames = min(len(both.time), len(alone.time))
        np.testing.assert_array_equal(both.angle[:frames, index, 0], alone["joint_angle"][:frames])
        for port, pressure in zip("ab", both.pressures, strict=True):
            np.testing.assert_array_equal(pressure[:frames, index, 0], alone[f"pressure_{port}"][:frames])
        np.testing.assert_allclose(both.time[:frames], alone.time[:frames], atol=1e-12)
        assert np.abs(both.angle[:, index, 1] - both.angle[:, index, 0]).max() > 0.001
    largest = both.flow.max()
    # single precision of the simulated joint rate
    frames = min(len(both.time), len(left_turn.time))
    np.testing.assert_allclose(both.flow[:frames, 1, 0], left_turn["joint_flow"][:frames], atol=1e-5 * largest)
    stop = float(machine.joint.range)
    assert (both.angle[-1, 1] > stop - math.radians(0.1)).all()
    last = np.argmax(both.angle[:, 1, :] > stop - math.radians(0.1), axis=0).max()
    assert both.time[-1] - both.time[last] >= REST_AFTER - 0.11


def test_published_levels_to_both_sides():
    assert [(t.direction, t.signal_percent, t.sign) for t in TURNS] == [
        ("left", 100.0, 1), ("left", 75.0, 1), ("left", 50.0, 1),
        ("right", 100.0, -1), ("right", 75.0, -1), ("right", 50.0, -1),
    ]  # fmt: skip


def test_a_twin_that_never_arrives_is_given_up(machine, monkeypatch):
    monkeypatch.setattr("aoro_gym.validation.turns.LONGEST_TURN", 2.0)
    crept = run_turns(machine, [Turn("left", 5.0)])  # 0.1 V is inside the dead band
    assert crept.time[-1] == pytest.approx(2.1, abs=0.51)
    assert np.ptp(crept.angle) < math.radians(0.1)


def test_the_disc_brake_takes_its_share_of_the_pressure(machine):
    with_brake = motor_pressure_at(0.75, machine)
    without = motor_pressure_at(0.75, machine, brake=False)
    assert with_brake.shape == without.shape == (1,)
    drive = machine.driveline
    share = drive.brake.disc_torque / (drive.motor.displacement * drive.motor.mechanical_efficiency)
    # p = M / (V η) where the motor's losses grow with its pressure alone
    assert with_brake[0] - without[0] == pytest.approx(share, rel=0.02)


def test_a_speed_out_of_reach_has_no_pressure(machine):
    assert np.isnan(motor_pressure_at(9.0, machine)).all()
