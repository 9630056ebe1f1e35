"""Where the scene puts the parts of a machine, against the twin's kinematics and the rigid bodies that are exported."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aoro_gym.machine import Machine
from aoro_gym.machine.kinematics import Kinematics, Pose
from aoro_gym.machine.rigid_bodies import JOINT, machine_bodies, poses
from aoro_gym.machine.solids import machine_solids
from aoro_gym.recording.commands import WHEELS
from aoro_gym.sensors.attitude import in_world, quaternion_of
from aoro_gym.twin import Twin
from aoro_gym.twin.poses import pose_of_state

JOINT_ANGLE, ARMS, TURNED = 0.4, (0.1, -0.2, 0.15, -0.05), (0.3, 2.0, -1.0, 4.0)


@pytest.fixture(scope="module")
def machine():
    return Machine.load("aoro")


@pytest.fixture(scope="module")
def placed(machine):
    return Kinematics(machine).placed(JOINT_ANGLE, ARMS, TURNED)


def matrix(wxyz):
    return Rotation.from_quat(wxyz, scalar_first=True).as_matrix()


def test_bodies_stand_where_the_exported_machine_has_them(machine, placed):
    angles = {JOINT: JOINT_ANGLE, **{f"arm_{w}": a for w, a in zip(WHEELS, ARMS, strict=True)}}
    angles |= {f"wheel_{w}": a for w, a in zip(WHEELS, TURNED, strict=True)}
    for name, (rotation, origin) in poses(machine_bodies(machine), angles).items():
        position, wxyz = placed[name]
        np.testing.assert_allclose(position, origin, atol=1e-12)
        np.testing.assert_allclose(matrix(wxyz), rotation, atol=1e-12)


def test_wheel_centres_and_arm_pins_in_closed_form(machine, placed):
    # as in aoro_gym.twin.physics.bodies.wheel_centre, and the rear half turned by −joint about z
    frame, arm = machine.frame, machine.arm
    for name, angle in zip(WHEELS, ARMS, strict=True):
        half, direction = (frame.front, 1.0) if name[0] == "f" else (frame.rear, -1.0)
        side = 1.0 if name[1] == "l" else -1.0
        pin_x = direction * (float(half.axle_distance) - float(arm.length))
        centre = np.array(
            [
                pin_x + direction * float(arm.length) * math.cos(angle),
                side * 0.5 * float(frame.track),
                float(arm.pivot_height) + float(arm.length) * math.sin(angle),
            ]
        )
        pin = np.array([pin_x, side * float(arm.pivot_lateral), float(arm.pivot_height)])
        turned = Rotation.from_euler("z", -JOINT_ANGLE if direction < 0.0 else 0.0)
        np.testing.assert_allclose(placed[f"wheel_{name}"][0], turned.apply(centre), atol=1e-12)
        np.testing.assert_allclose(placed[f"arm_{name}"][0], turned.apply(pin), atol=1e-12)


def test_cylinders_are_as_long_as_their_linkages_say(machine, placed):
    steering, arm = machine.steering.cylinder.linkage, machine.arm.cylinder.linkage
    lengths = {"steering_right": steering.length(JOINT_ANGLE), "steering_left": steering.length(-JOINT_ANGLE)}
    lengths |= {f"arm_{name}": arm.length(-angle) for name, angle in zip(WHEELS, ARMS, strict=True)}
    for name, length in lengths.items():
        (barrel, turned), (rod, _) = placed[f"barrel_{name}"], placed[f"rod_{name}"]
        along = np.subtract(rod, barrel)
        assert np.linalg.norm(along) == pytest.approx(float(length), rel=1e-12)
        np.testing.assert_allclose(matrix(turned)[:, 0], along / np.linalg.norm(along), atol=1e-12)


def test_a_twin_s_pose_is_that_of_its_state():
    twin = Twin()
    twin.reset(position=(3.0, -2.0), heading=0.7, joint_angle=0.2)
    twin.step({"drive_signal": 0.5, "arm_fl": 1.0}, 1.0)
    pose = pose_of_state(twin.state.numpy()[:, 0])
    outputs = {name: float(twin.output(name)[0]) for name in ("roll", "pitch", "yaw", "joint_angle", "arm_angle_fl")}
    roll, pitch, yaw = (np.array([outputs[name]]) for name in ("roll", "pitch", "yaw"))
    forward = in_world(roll, pitch, yaw, np.array([1.0, 0.0, 0.0]))[0]
    np.testing.assert_allclose(matrix(pose.wxyz)[:, 0], forward, atol=1e-6)  # float32
    assert pose.heading == pytest.approx(outputs["yaw"], abs=1e-6)
    assert pose.joint == pytest.approx(outputs["joint_angle"], abs=1e-7)
    assert pose.arms[0] == pytest.approx(outputs["arm_angle_fl"], abs=1e-7)
    np.testing.assert_allclose(pose.position, [float(twin.output(f"position_{axis}")[0]) for axis in "xyz"], atol=1e-6)
    np.testing.assert_allclose(np.abs(np.roll(quaternion_of(roll, pitch, yaw), 1, axis=-1) @ pose.wxyz), 1.0, atol=1e-7)


def test_wheels_stand_on_the_ground():
    twin = Twin()
    pose = pose_of_state(twin.state.numpy()[:, 0])
    machine = twin.machine
    placed = Kinematics(machine).placed(pose.joint, pose.arms, pose.wheels)
    for name in WHEELS:
        rest = machine.rest
        deflection = rest.deflection_front if name[0] == "f" else rest.deflection_rear
        height = pose.position[2] + placed[f"wheel_{name}"][0][2]  # the frames are level
        assert height == pytest.approx(float(machine.tire.radius - deflection), abs=2e-4)


def test_logs_are_drawn_where_they_lie(machine):
    load = machine.set({"payload.count": 12.0}).payload
    points = machine_solids(machine.set({"payload.count": 12.0}))["rear_frame"].packed()[0]
    ends = points[np.isclose(points[:, 0], -load.distance - 0.5 * load.length)]
    assert len(ends) >= 12 * 10  # a ring of ten points a log
    assert ends[:, 2].min() == pytest.approx(load.bunk_height, abs=0.01)
    assert np.abs(ends[:, 1]).max() == pytest.approx(0.5 * load.bunk_width, abs=0.01)


def test_every_part_has_a_solid_of_the_machine_s_size(machine, placed):
    solids = machine_solids(machine)
    assert set(solids) == set(placed)
    points = solids["wheel_fl"].packed()[0]
    assert np.hypot(points[:, 0], points[:, 2]).max() == pytest.approx(float(machine.tire.radius), rel=0.01)
    x = solids["front_frame"].packed()[0][:, 0]
    assert x.max() >= float(machine.frame.front.cog_x + 0.5 * machine.frame.front.hull_length) - 1e-9


def test_heading_of_a_pose():
    pose = Pose(np.zeros(3), np.roll(quaternion_of(0.1, -0.2, 2.0), 1))
    assert pose.heading == pytest.approx(2.0)
