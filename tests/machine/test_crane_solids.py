"""The drawn crane: its parts hang together as its kinematics say, with the log that it holds."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aoro_gym.machine import Machine
from aoro_gym.machine.crane_solids import CRANE_NODES, HELD_LOG, crane_placed, crane_solids, in_world, parts_of
from aoro_gym.machine.kinematics import CranePose, Pose
from aoro_gym.machine.vehicle_crane import GRAPPLE_DROP, VehicleCrane, moments_of_log, size_of_log
from aoro_gym.twin import Twin
from aoro_gym.twin.poses import pose_of_state

JOINTS = (0.7, 0.5, -1.4, 0.6)
VEHICLE = VehicleCrane()
HELD = CranePose(VEHICLE, JOINTS, yaw=-0.4, log=(4.0, 0.26))


def end_of(placed, along):
    """Where a point ``along`` [m] a part's x axis is in the front frame."""
    return Rotation.from_quat(placed[1], scalar_first=True).apply([along, 0.0, 0.0]) + placed[0]


def test_parts_hang_together_and_end_at_the_tip():
    placed = crane_placed(HELD)
    crane, tip = VEHICLE.crane, VEHICLE.tip(np.array(JOINTS))
    np.testing.assert_allclose(end_of(placed["crane_boom"], float(crane.boom.length)), placed["crane_stick"][0])
    reach = float(crane.stick.length) + JOINTS[3]
    np.testing.assert_allclose(end_of(placed["crane_stick"], reach), tip)
    for name in ("crane_extension", "crane_grapple"):
        np.testing.assert_allclose(placed[name][0], tip)
    np.testing.assert_allclose(placed[HELD_LOG][0], tip - [0.0, 0.0, GRAPPLE_DROP])
    # the log lies level, at its angle to the pillar
    along = end_of(placed[HELD_LOG], 1.0) - placed[HELD_LOG][0]
    np.testing.assert_allclose(along, [math.cos(0.3), math.sin(0.3), 0.0], atol=1e-12)
    pillar_top = Rotation.from_euler("z", JOINTS[0]).apply([float(crane.lift.offset), 0.0, float(crane.lift.height)])
    np.testing.assert_allclose(placed["crane_boom"][0], placed["crane_pillar"][0] + pillar_top)


def test_a_log_is_as_large_as_its_moments_say():
    axial, across = moments_of_log(180.0, 4.0, 0.26)
    assert size_of_log(180.0, float(axial), float(across)) == pytest.approx((4.0, 0.26))
    assert size_of_log(0.0, 0.0, 0.0) is None
    assert size_of_log(100.0, 0.0, 0.0) is None  # a point


def test_a_machine_with_a_crane_that_moves_has_no_folded_one():
    machine = Machine.load("aoro")
    rest, moved = (
        Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])),
        Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), crane=HELD),
    )
    plain, parts = parts_of(machine, rest), parts_of(machine, moved)
    assert parts.keys() - plain.keys() == {*CRANE_NODES, HELD_LOG}
    assert len(parts["front_frame"][0].packed()[0]) < len(plain["front_frame"][0].packed()[0])
    assert {name: len(solid.triangles()[1]) > 0 for name, solid in crane_solids(VEHICLE).items()} == dict.fromkeys(
        CRANE_NODES, True
    )


def test_a_twin_says_how_its_crane_stands_and_what_it_holds():
    twin = Twin(crane=True)
    twin.reset(position=(3.0, -2.0), heading=0.5)
    twin.crane.grasp(mass=180.0, length=4.0, diameter=0.26, yaw=-0.4)
    twin.crane.place(JOINTS)
    pose = pose_of_state(twin.state.numpy()[:, 0], twin.crane.vehicle)
    assert pose.crane is not None and pose.crane.log is not None
    np.testing.assert_allclose(pose.crane.joints, JOINTS, atol=1e-6)
    assert pose.crane.yaw == pytest.approx(-0.4) and pose.crane.log == pytest.approx((4.0, 0.26), rel=1e-5)
    tip = in_world(pose, crane_placed(pose.crane)["crane_grapple"])[0]
    x, y, z = VEHICLE.tip(np.array(JOINTS))
    c, s = math.cos(0.5), math.sin(0.5)
    # the frame leans by less than a milliradian at 6 m
    np.testing.assert_allclose(tip[:2], [3.0 + c * x - s * y, -2.0 + s * x + c * y], atol=0.01)
    assert tip[2] == pytest.approx(z, abs=0.05)
    assert pose_of_state(twin.state.numpy()[:, 0]).crane is None
