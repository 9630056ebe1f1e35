"""The crane's parameters, and its kinematics against rotation matrices."""

import re

import numpy as np
import pytest

from aoro_gym.machine.crane import Crane, crane_parameters, forwarder_crane
from aoro_gym.machine.sections import Frame

JOINTS = np.array([[0.4, 0.3, -0.7, 0.5], [-2.0, 1.2, -2.2, 0.0], [0.0, -0.3, -0.1, 1.6]]).T


@pytest.fixture(scope="module")
def crane() -> Crane:
    return forwarder_crane()


def test_every_parameter_lies_in_its_range_and_says_where_it_comes_from():
    for entry in crane_parameters().values():
        assert re.match(r"(R|E)\b", entry.source), entry.key
        assert entry.range[0] <= entry.value <= entry.range[1], entry.key


def test_its_masses_and_its_reach_are_those_of_the_budget(crane):
    """1,750 kg of crane, rotator and grapple in the budget of the front frame; reach of its class, 7.2 m."""
    assert crane.mass == pytest.approx(1750.0)
    assert crane.reach == pytest.approx(7.2)
    assert not hasattr(Frame, "crane")  # apart from the vehicle yet


def test_the_tip_is_where_rotations_put_it(crane):
    """Frame by frame: about z, then twice about −y, each followed by a way in the turned axes."""

    def about(axis, angle):
        cross = np.cross(np.eye(3), axis)
        return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross

    for slew, lift, fold, out in JOINTS.T:
        turned = about([0.0, 0.0, 1.0], slew)
        place = turned @ [crane.lift.offset, 0.0, crane.lift.height]
        turned = turned @ about([0.0, -1.0, 0.0], lift)
        place += turned @ [crane.boom.length, 0.0, 0.0]
        turned = turned @ about([0.0, -1.0, 0.0], fold)
        place += turned @ [crane.stick.length + out, 0.0, 0.0]
        assert crane.tip([slew, lift, fold, out]) == pytest.approx(place, abs=1e-12)
    assert crane.tip(JOINTS).shape == (3, 3)


def test_joints_bring_the_tip_back(crane):
    np.testing.assert_allclose(crane.joints_at(crane.tip(JOINTS), JOINTS[3]), JOINTS, atol=1e-9)


@pytest.mark.parametrize(
    ("place", "out", "words"),
    [
        ((9.0, 0.0, 1.0), 0.5, r"cannot be 8\.86 m from the lift's pin with the telescope 0\.50 m out: .* 0\.50 to 5\.90 m"),
        ((1.2, 0.0, 1.5), 0.0, r"fold is -173.1 deg, but must be in \[-150, 0\] deg"),
        ((7.5, 0.0, 1.5), 3.0, r"telescope is 3 m, but must be in \[0, 1\.65\] m"),
    ],
)  # fmt: skip
def test_what_it_cannot_reach_is_told(crane, place, out, words):
    with pytest.raises(ValueError, match=words):
        crane.joints_at(place, out)


def test_what_it_holds_is_a_mass(crane):
    assert crane.with_grapple(800.0).mass == pytest.approx(crane.mass + 500.0)
    with pytest.raises(ValueError, match=r"mass is -1 kg, but must be at least 0"):
        crane.with_grapple(np.array([300.0, -1.0]))
