"""What the tests share: the twin's recordings of two short manoeuvres, run once."""

import pytest
import warp

from aoro_gym import Machine, Twin
from aoro_gym.calibration.procedure import measured_curve
from aoro_gym.manoeuvres import Recording, run, standing_turn, straight_drive

warp.config.log_level = warp.LOG_ERROR


@pytest.fixture(scope="session")
def machine() -> Machine:
    """The nominal machine: data sheets, derived figures and estimates, with the measured valve curve.

    Tests of laws mean its round numbers; the calibrated machine that is the default has tests of its own in
    ``validation/test_shipped_machine.py``.
    """
    return measured_curve(Machine.load("aoro_datasheet"))


@pytest.fixture(scope="session")
def left_turn(machine: Machine) -> Recording:
    """A full turn to the left at full signal."""
    return run(Twin(machine=machine), standing_turn(1, 1.0, float(machine.joint.range)))


@pytest.fixture(scope="session")
def right_turn(machine: Machine) -> Recording:
    """A full turn to the right at full signal."""
    return run(Twin(machine=machine), standing_turn(-1, 1.0, float(machine.joint.range)))


@pytest.fixture(scope="session")
def drive(machine: Machine) -> Recording:
    """Three seconds straight on at half the drive signal."""
    return run(Twin(machine=machine), straight_drive(0.5, duration=3.0))
