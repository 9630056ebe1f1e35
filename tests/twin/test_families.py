"""Twins by every family of laws: they turn alike, keep the pump's margin in steady flow, and come to rest."""

import numpy as np
import pytest

from aoro_gym.machine.laws import FAMILIES
from aoro_gym.twin.twin import Twin
from tests.twin.rig import drive

SIGNALS = np.array([1.0, 0.5, -1.0, -0.5])
PRESSURES = ("pump_pressure", "pressure_a", "pressure_b", "return_pressure", "ls_pressure")


def swing(log, channel, last):
    """Largest distance [unit of the channel] of its ``last`` samples from their straight line, of each twin."""
    values = log[channel][-last:]
    time = np.linspace(-1.0, 1.0, last)[:, None]
    slope = np.sum(time * values, axis=0) / np.sum(time**2)
    return np.max(np.abs(values - np.mean(values, axis=0) - slope * time), axis=0)


@pytest.fixture(scope="module", params=FAMILIES)
def logs(request, machine):
    """Steady turn and rest of one family, at four signals."""
    chosen = machine.with_laws(request.param)
    twin = Twin(len(SIGNALS), machine=chosen)
    twin.reset(joint_angle=-np.sign(SIGNALS) * machine.joint.range)
    turning = drive(twin, (0.3, {}), (1.7, {"steering_signal": SIGNALS}), sample_every=1e-3)
    resting = drive(twin, (5.0, {"steering_signal": 0.0}), sample_every=1e-3)
    assert not twin.diverged
    return chosen, turning, resting


def test_supply_keeps_the_margin_over_the_load_in_a_steady_turn(logs):
    """The last 0.3 s: a loop that rings on its own opens the compensator and takes the mean away from the margin. What the
    joint's swing leaves is a tenth of it at most."""
    machine, turning, _ = logs
    over = turning["pump_pressure"][-300:] - turning["ls_pressure"][-300:]
    np.testing.assert_allclose(np.mean(over, axis=0), machine.steering.pump.margin, rtol=0.1)
    assert np.all(swing(turning, "compensator", 300) < 0.1)


def test_circuit_comes_to_rest(logs):
    """Within five seconds of rest all pressures are straight lines within 0.1 bar: the machine's own swing has died away."""
    _, _, resting = logs
    for name in PRESSURES:
        assert np.all(swing(resting, name, 300) < 0.1e5), name


def test_families_turn_as_fast(logs, machine):
    """Steady flow is the valve's, by whatever law: the flow force takes 5 % of the stroke at most, of a curve that is no
    steeper than 1.3 at full and 2.5 times the flow at half signal."""
    _, turning, _ = logs
    reference = Twin(len(SIGNALS), machine=machine)
    reference.reset(joint_angle=-np.sign(SIGNALS) * machine.joint.range)
    usual = drive(reference, (0.3, {}), (1.7, {"steering_signal": SIGNALS}), sample_every=1e-3)
    swept = [np.abs(log["joint_angle"][-1] - log["joint_angle"][-500]) for log in (turning, usual)]
    np.testing.assert_allclose(swept[0], swept[1], rtol=0.13)
