"""MuJoCo's importer reads the URDF, and the machine is the one of the MJCF and of the twin."""

# MuJoCo takes its names from a compiled module at run time.
# pyright: reportAttributeAccessIssue=false
import math
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from aoro_gym import Twin
from aoro_gym.interchange import mjcf, urdf
from aoro_gym.interchange.sensor_places import sensor_places
from aoro_gym.interchange.servos import servos, wheel_motors
from aoro_gym.machine.rigid_bodies import BASE, JOINT, REAR, machine_bodies
from aoro_gym.units import GRAVITY
from tests.interchange.loading import HINGES, LoadedMachine, step, urdf_on_ground, wheel_forces
from tests.oracles.bodies import BodyModel
from tests.oracles.mujoco_model import WHEELS


@pytest.fixture(scope="module")
def model(calibrated):
    return mujoco.MjModel.from_xml_string(urdf(calibrated))


@pytest.fixture(scope="module")
def root(calibrated):
    return ElementTree.fromstring(urdf(calibrated))


def test_mass_matrix_is_the_oracles(machines):
    rng = np.random.default_rng(5)
    for machine in machines:
        loaded = LoadedMachine(mujoco.MjModel.from_xml_string(urdf(machine)))
        q = np.concatenate([[0.1, -0.2, 0.3, 1.0, 0.0, 0.0, 0.0], rng.uniform(-0.5, 0.5, 9)])
        expected = BodyModel(machine).mass_matrix(q)
        np.testing.assert_allclose(loaded.mass_matrix(q), expected, atol=1e-9 * expected.max())
        assert loaded.model.body_mass.sum() == pytest.approx(machine.mass, rel=1e-12)
        assert (loaded.model.nv, loaded.model.nu) == (15, 0)


def test_wheel_loads_at_rest_are_the_twins(calibrated):
    twin = Twin(machine=calibrated)
    twin.step({}, 3.0)
    expected = [float(twin.output(f"wheel_load_{name}")[0]) for name in WHEELS]
    model, data = urdf_on_ground(calibrated)
    step(model, data, 3.0)
    loads = wheel_forces(model, data)
    np.testing.assert_allclose(loads, expected, rtol=0.01)
    assert loads.sum() == pytest.approx(calibrated.mass * GRAVITY, rel=1e-3)
    assert data.qpos[2] == pytest.approx(calibrated.rest.height, abs=1e-3)


def test_poses_are_those_of_the_mjcf(model, calibrated):
    other = mujoco.MjModel.from_xml_string(mjcf(calibrated))
    first, second = mujoco.MjData(model), mujoco.MjData(other)
    for angles in np.random.default_rng(6).uniform(-0.45, 0.45, (20, len(HINGES))):
        for data in (first, second):
            for hinge, angle in zip(HINGES, angles, strict=True):
                data.joint(hinge).qpos[0] = angle
        mujoco.mj_kinematics(model, first)
        mujoco.mj_kinematics(other, second)
        for body in machine_bodies(calibrated):
            for name in ("xpos", "xmat"):
                found, expected = (getattr(data.body(body.name), name) for data in (first, second))
                np.testing.assert_allclose(found, expected, atol=1e-12)
        for name in sensor_places():
            np.testing.assert_allclose(first.body(name).xpos, second.site(name).xpos, atol=1e-12)


def test_a_positive_joint_angle_turns_left(model):
    data = mujoco.MjData(model)
    data.joint(JOINT).qpos[0] = 0.3
    mujoco.mj_kinematics(model, data)
    heading = [np.arctan2(data.body(name).xmat[3], data.body(name).xmat[0]) for name in (BASE, REAR)]
    assert heading[0] - heading[1] == pytest.approx(0.3, abs=1e-12)


def test_it_is_a_tree_with_one_root(root):
    links = [link.attrib["name"] for link in root.iter("link") if "name" in link.attrib]
    children = [joint.find("child").attrib["link"] for joint in root.findall("joint")]
    parents = [joint.find("parent").attrib["link"] for joint in root.findall("joint")]
    assert len(set(links)) == len(links) and len(set(children)) == len(children)
    assert set(links) - set(children) == {"world"} and set(parents) <= set(links)
    kinds = [joint.attrib["type"] for joint in root.findall("joint")]
    assert {kind: kinds.count(kind) for kind in kinds} == {"floating": 1, "revolute": 5, "continuous": 4, "fixed": 3}


def test_the_base_can_be_the_root(root, calibrated):
    bare = ElementTree.fromstring(urdf(calibrated, root_link="frame"))
    links = [[link.attrib["name"] for link in one.findall("link")] for one in (root, bare)]
    joints = [[joint.attrib["name"] for joint in one.findall("joint")] for one in (root, bare)]
    assert links[0] == ["world", *links[1]] and joints[0] == ["base", *joints[1]]


def test_limits_and_friction_are_the_machines(root, model, calibrated):
    joints = {joint.attrib["name"]: joint for joint in root.findall("joint")}
    for servo in servos(calibrated):
        limit, dynamics = (joints[servo.hinge].find(name).attrib for name in ("limit", "dynamics"))
        half = calibrated.joint.range if servo.hinge == JOINT else calibrated.arm.swing
        assert [float(limit["lower"]), float(limit["upper"])] == [-half, half]
        assert float(limit["effort"]) == min(-servo.held_torque[0], servo.held_torque[1])
        assert float(limit["velocity"]) == max(-servo.rate[0], servo.rate[1])
        assert [float(dynamics["damping"]), float(dynamics["friction"])] == [servo.damping, servo.friction]
        freedom = model.joint(servo.hinge).dofadr[0]
        assert model.dof_frictionloss[freedom] == pytest.approx(servo.friction)
    for motor in wheel_motors(calibrated):
        limit = joints[motor.hinge].find("limit").attrib
        assert (float(limit["effort"]), float(limit["velocity"])) == (motor.torque["gear_1"], motor.speed["gear_3"])


def test_masses_read_back_as_they_were(root, calibrated):
    found = {link.attrib["name"]: link for link in root.findall("link") if link.find("inertial") is not None}
    for body in machine_bodies(calibrated):
        link = found.pop(body.name)
        assert float(link.find("inertial/mass").attrib["value"]) == body.mass
        inertia = {name: float(text) for name, text in link.find("inertial/inertia").attrib.items()}
        assert inertia["ixy"] == body.inertia[0, 1] and inertia["izz"] == body.inertia[2, 2]
    assert not found


def test_beams_reach_from_pivot_to_axle(model, calibrated):
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for name in WHEELS:
        beam = model.body(f"arm_{name}").geomadr[0]
        half = model.geom_size[beam, 1] * data.geom_xmat[beam].reshape(3, 3)[:, 2]
        ends = data.geom_xpos[beam] + half, data.geom_xpos[beam] - half
        expected = data.body(f"arm_{name}").xpos, data.body(f"wheel_{name}").xpos
        assert min(math.dist(ends[i], expected[0]) + math.dist(ends[1 - i], expected[1]) for i in range(2)) < 1e-9


@pytest.mark.parametrize(
    "key", ["frame.front.mass", "arm.swing", "tire.radius", "steering.valve.shock_pressure", "wheel.mass"]
)
def test_another_machine_is_another_file(calibrated, key):
    changed = calibrated.scale({key: 0.99}, check_ranges=False)
    assert urdf(changed) != urdf(calibrated) == urdf(calibrated)
