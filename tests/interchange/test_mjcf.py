"""MuJoCo reads the machine, has its bodies, and lets it stand, turn and hold as the twin does."""

# MuJoCo takes its names from a compiled module at run time; device code's types are Warp's.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false, reportArgumentType=false, reportCallIssue=false
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
import warp as wp

from aoro_gym import Twin
from aoro_gym.interchange import mjcf
from aoro_gym.interchange.mjcf import FRICTION_IMPEDANCE_RATIO, IMPEDANCE, scrub_lever
from aoro_gym.interchange.servos import servos, wheel_motors
from aoro_gym.machine.rigid_bodies import BASE, JOINT, REAR, inverse_weights, machine_bodies
from aoro_gym.twin.physics.bodies import hinge_rotation, wheel_centre
from aoro_gym.twin.records import MachineRecord, pack
from aoro_gym.units import GRAVITY
from tests.interchange.loading import HINGES, LoadedMachine, at_rest, step, wheel_forces
from tests.oracles.bodies import BodyModel
from tests.oracles.mujoco_model import WHEELS

FLOAT32 = 2e-6
"""[m] and [-]: a dozen roundings of lengths of some metres, of 1.2e-7 relative."""
SETTLING = 12.0
"""[s] After a drop of 5 cm: of the bounce, √(4 k/m) = 11.7 1/s damped by 4 c/(2 m) = 0.62 1/s, 6e-4 is left."""


@pytest.fixture(scope="module")
def model(calibrated):
    return mujoco.MjModel.from_xml_string(mjcf(calibrated))


@pytest.fixture(scope="module")
def twin_loads(calibrated):
    """Wheel loads [N] of the twin after 3 s, which change by less than 0.1 N from 1 s on."""
    trace = Twin(machine=calibrated).step({}, 3.0, sample_every=1.0)
    assert trace is not None
    loads = np.array([trace[f"wheel_load_{name}"][:, 0] for name in WHEELS])
    assert np.ptp(loads, axis=1).max() < 0.1
    return loads[:, -1]


def test_mass_matrix_is_the_oracles(machines):
    """Total mass, centre of mass and composite inertia, at random angles."""
    rng = np.random.default_rng(2)
    for machine in machines:
        loaded, oracle = LoadedMachine(mujoco.MjModel.from_xml_string(mjcf(machine))), BodyModel(machine)
        q = np.concatenate([[0.1, -0.2, 0.3, 0.9, 0.1, -0.2, 0.3], rng.uniform(-0.5, 0.5, 9)])
        q[3:7] /= np.linalg.norm(q[3:7])
        expected = oracle.mass_matrix(q)
        np.testing.assert_allclose(loaded.mass_matrix(q), expected, atol=1e-9 * expected.max())
        np.testing.assert_allclose(
            loaded.data.subtree_com[loaded.model.body(BASE).id], oracle.center_of_mass(q), atol=1e-9
        )
        assert loaded.model.body_mass.sum() == pytest.approx(machine.mass, rel=1e-12)


def test_inverse_weights_are_mujocos(machines):
    for machine in machines:
        loaded = mujoco.MjModel.from_xml_string(mjcf(machine))
        by_body, by_hinge = inverse_weights(machine_bodies(machine))
        assert by_body == pytest.approx({name: loaded.body(name).invweight0[0] for name in by_body}, rel=1e-9)
        found = {name: loaded.dof_invweight0[loaded.joint(name).dofadr[0]] for name in by_hinge}
        assert by_hinge == pytest.approx(found, rel=1e-9)


def test_wheel_loads_at_rest_are_the_twins(model, calibrated, twin_loads):
    for drop, seconds, tolerance in ((0.0, 1.0, 1e-4), (0.05, SETTLING, 0.01)):
        data = at_rest(model)
        data.qpos[2] += drop
        step(model, data, seconds)
        loads = wheel_forces(model, data)
        np.testing.assert_allclose(loads, twin_loads, rtol=tolerance)
        np.testing.assert_allclose([data.sensor(f"wheel_load_{name}").data[0] for name in WHEELS], loads, rtol=1e-9)
        assert loads.sum() == pytest.approx(calibrated.mass * GRAVITY, rel=tolerance)
    # and the pose, to what the oil gives way in the twin
    assert data.qpos[2] == pytest.approx(calibrated.rest.height, abs=1e-3)
    assert data.joint("arm_rl").qpos[0] == pytest.approx(calibrated.rest.arm_angle_rear, abs=1e-3)


def test_tires_are_springs_and_dampers(model, calibrated):
    tire = calibrated.tire
    for sinking in (0.0, 0.1, 0.3):
        data = at_rest(model)
        data.qvel[2] = -sinking
        mujoco.mj_forward(model, data)
        depth = np.array([contact.includemargin - contact.dist for contact in data.contact[: data.ncon]])[[2, 3, 0, 1]]
        rest = calibrated.rest
        np.testing.assert_allclose(depth, [rest.deflection_front] * 2 + [rest.deflection_rear] * 2, atol=1e-9)
        expected = tire.stiffness * depth + tire.damping * sinking
        # beyond spring and damper: the mass that the impedance adds, times the contact's acceleration, on levers below 2 m
        added = IMPEDANCE / (1.0 - IMPEDANCE) / model.body("wheel_fl").invweight0[0]
        slack = added * 2.0 * np.abs(data.qacc).sum() + 1e-3
        np.testing.assert_allclose(wheel_forces(model, data), expected, atol=slack)
        assert slack < 0.01 * expected.min()


@wp.kernel(enable_backward=False)
def places(machines: wp.array(dtype=MachineRecord), angles: wp.array2d(dtype=float), out: wp.array2d(dtype=wp.vec3)):
    """Wheel centres and the rear frame's forward axis in the front frame's axes, by the twin's own laws."""
    k = wp.tid()
    m = machines[0]
    to_front = wp.transpose(hinge_rotation(angles[k, 0]))
    for i in range(4):
        side = 1.0 - 2.0 * float(i & 1)
        if i < 2:
            out[k, i] = wheel_centre(m.corner, m.frame_front.pivot_x, 1.0, side, angles[k, 1 + i])
        else:
            out[k, i] = to_front * wheel_centre(m.corner, m.frame_rear.pivot_x, -1.0, side, angles[k, 1 + i])
    out[k, 4] = to_front * wp.vec3(1.0, 0.0, 0.0)


def test_turning_geometry_is_the_twins_over_all_ranges(model, calibrated):
    ends = np.array([calibrated.joint.range, *[calibrated.arm.swing] * 4])
    angles = np.concatenate([[-ends, ends], np.random.default_rng(3).uniform(-ends, ends, (48, 5))])
    records = wp.array(pack(calibrated), dtype=MachineRecord, device="cpu")
    out = wp.zeros((len(angles), 5), dtype=wp.vec3, device="cpu")
    asked = wp.array(angles, dtype=float, device="cpu")
    wp.launch(places, dim=len(angles), inputs=[records, asked], outputs=[out], device="cpu")
    data, found = mujoco.MjData(model), []
    for row in angles:
        for hinge, angle in zip(HINGES[:5], row, strict=True):
            data.joint(hinge).qpos[0] = angle
        mujoco.mj_kinematics(model, data)
        wheels = [data.body(f"wheel_{name}").xpos - data.body(BASE).xpos for name in WHEELS]
        found.append(
            [*wheels, data.body(REAR).xmat.reshape(3, 3)[:, 0].copy()]
        )  # the others are differences, not views
    np.testing.assert_allclose(found, out.numpy(), atol=FLOAT32)


def test_ranges_are_the_machines(model, calibrated):
    for hinge, limit in (
        (JOINT, calibrated.joint.range),
        ("arm_fl", calibrated.arm.swing),
        ("arm_rr", calibrated.arm.swing),
    ):
        assert model.joint(hinge).range == pytest.approx([-limit, limit], rel=1e-15)


@pytest.mark.parametrize("hinge", [JOINT, "arm_fl", "arm_rr"])
def test_stops_are_springs_and_dampers(model, calibrated, hinge):
    servo = next(servo for servo in servos(calibrated) if servo.hinge == hinge)
    data = at_rest(model)
    data.qpos[2] += 5.0
    beyond, rate = 1e-3, 0.2
    data.joint(hinge).qpos[0] = model.joint(hinge).range[1] + beyond
    data.joint(hinge).qvel[0] = rate
    mujoco.mj_forward(model, data)
    limits = data.efc_force[data.efc_type == mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT]
    added = IMPEDANCE / (1.0 - IMPEDANCE) / model.dof_invweight0[model.joint(hinge).dofadr[0]]
    slack = added * np.abs(data.joint(hinge).qacc[0]) + 1e-6
    assert limits == pytest.approx([servo.stop_stiffness * beyond + servo.stop_damping * rate], abs=slack)
    assert slack < 0.5 * servo.stop_damping * rate


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_joint_turns_to_the_side_of_its_control_up_to_its_end(model, calibrated, side):
    servo, data = servos(calibrated)[0], at_rest(model)
    data.actuator(JOINT).ctrl[0] = side * 10.0  # held to the range of the controls
    step(model, data, 0.5)
    rate = servo.rate[1] if side > 0.0 else -servo.rate[0]
    assert side * data.joint(JOINT).qpos[0] == pytest.approx(0.5 * rate, rel=0.05)
    heading = [np.arctan2(data.body(name).xmat[3], data.body(name).xmat[0]) for name in (BASE, REAR)]
    assert side * heading[0] > 0.0 > side * heading[1]
    step(model, data, 4.0)
    # it has rung about its end, as the twin's does, on oil and tires
    assert side * data.joint(JOINT).qpos[0] == pytest.approx(calibrated.joint.range, abs=1e-3)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_full_turn_at_standstill_is_the_twins(model, calibrated, side):
    """Time, yaw of the front frame and way of the hinge from stop to stop.

    Rate and range alone make the time; in the twin valve, pump and the levers' change make it up to 3 % shorter or longer.
    How the frames share the turn follows from their inertia and from friction that holds the tires until they slide.
    """
    data = at_rest(model)
    data.actuator(JOINT).ctrl[0] = -side
    step(model, data, 3.0)
    start, place, yaw = data.time, data.qpos[:2].copy(), data.qpos[[3, 6]].copy()
    data.actuator(JOINT).ctrl[0] = side
    while side * data.joint(JOINT).qpos[0] < calibrated.joint.range - 1e-3 and data.time < start + 5.0:
        mujoco.mj_step(model, data)
    turned = 2.0 * (np.arctan2(data.qpos[6], data.qpos[3]) - np.arctan2(yaw[1], yaw[0]))
    found = [data.time - start, turned, np.hypot(*(data.qpos[:2] - place))]

    twin = Twin(machine=calibrated)
    twin.reset(joint_angle=-side * calibrated.joint.range)
    trace = twin.step({"steering_signal": side}, 3.0, sample_every=0.01)
    assert trace is not None
    end = np.argmax(side * trace["joint_angle"][:, 0] > calibrated.joint.range - 1e-3)
    way = np.hypot(trace["position_x"][end, 0], trace["position_y"][end, 0])
    assert found == pytest.approx([trace.time[end], trace["yaw"][end, 0], way], rel=0.05)


def test_steps_of_5_ms_are_stable(calibrated):
    loaded = mujoco.MjModel.from_xml_string(mjcf(calibrated))
    loaded.opt.timestep = 5e-3
    data = at_rest(loaded)
    data.qpos[2] += 0.02
    data.actuator(JOINT).ctrl[0] = 0.5
    step(loaded, data, 5.0)
    assert np.abs(data.qvel).max() < 0.1 and abs(data.qpos[2] - calibrated.rest.height) < 0.02


def test_arms_move_frames_and_yield_at_the_relief_pressure(model, calibrated):
    data = at_rest(model)
    for name in WHEELS:
        data.actuator(f"arm_{name}").ctrl[0] = -0.1
    step(model, data, 1.0)
    lift = calibrated.arm.length * (np.sin(0.1745) - np.sin(0.1745 + 0.1))
    assert data.qpos[2] - calibrated.rest.height == pytest.approx(-lift, rel=0.1)
    for servo in servos(calibrated):
        assert model.actuator(servo.hinge).forcerange == pytest.approx(servo.held_torque)
        assert model.actuator(servo.hinge).ctrlrange == pytest.approx(servo.rate)


def test_wheels_drive_against_brakes_and_rolling_resistance(model, calibrated):
    """Steady speed: torque of the wheels less the disc and the rolling resistance is what accelerates mass and wheels."""
    torque, data = 1500.0, at_rest(model)
    for name in WHEELS:
        data.actuator(f"wheel_{name}").ctrl[0] = torque
    step(model, data, 1.0)
    speed = data.qvel[0]
    step(model, data, 1.0)
    radius = calibrated.tire.radius - 0.5 * (calibrated.rest.deflection_front + calibrated.rest.deflection_rear)
    rolling = calibrated.tire.rolling_resistance * calibrated.mass * GRAVITY
    inertia = calibrated.mass + 4.0 * calibrated.wheel.inertia_spin / radius**2
    expected = (4.0 * (torque - calibrated.driveline.brake.disc_torque) / radius - rolling) / inertia
    assert data.qvel[0] - speed == pytest.approx(expected, rel=0.02)
    assert data.sensor("wheel_rate_fl").data[0] == pytest.approx(data.qvel[0] / radius, rel=0.02)


def test_hinges_rub_as_the_servos_and_brakes_say(model, calibrated):
    for servo in servos(calibrated):
        freedom = model.joint(servo.hinge).dofadr[0]
        assert (model.dof_damping[freedom], model.dof_frictionloss[freedom]) == (servo.damping, servo.friction)
        assert model.actuator(servo.hinge).gainprm[0] == servo.stiffness
    for motor in wheel_motors(calibrated):
        assert model.dof_frictionloss[model.joint(motor.hinge).dofadr[0]] == motor.brake


def test_gears_are_named(model, calibrated):
    for gear in ("gear_1", "gear_2", "gear_3"):
        motors = wheel_motors(calibrated)
        assert model.numeric(f"wheel_torque_{gear}").data == pytest.approx([motor.torque[gear] for motor in motors])
        assert model.numeric(f"wheel_speed_{gear}").data == pytest.approx([motor.speed[gear] for motor in motors])
    assert model.actuator("wheel_rr").ctrlrange[1] == pytest.approx(wheel_motors(calibrated)[3].torque["gear_1"])


@pytest.mark.parametrize("slope_axis", [0, 1])
def test_a_parked_machine_stays_on_a_slope(calibrated, slope_axis):
    """Creep of F/(1000 c) a wheel along and across, which is below 1 mm/s."""
    model = mujoco.MjModel.from_xml_string(mjcf(calibrated))
    model.opt.gravity[:] = 0.0, 0.0, -GRAVITY * np.cos(np.radians(5.0))
    model.opt.gravity[slope_axis] = GRAVITY * np.sin(np.radians(5.0))
    for name in WHEELS:
        model.dof_frictionloss[model.joint(f"wheel_{name}").dofadr] = calibrated.driveline.brake.parking_torque
    data = step(model, at_rest(model), 2.0)
    start = data.qpos[slope_axis]
    step(model, data, 4.0)
    force = 0.25 * calibrated.mass * GRAVITY * np.sin(np.radians(5.0))
    creep = force / (FRICTION_IMPEDANCE_RATIO * calibrated.tire.damping)
    assert creep < 1e-3
    assert (data.qpos[slope_axis] - start) / 4.0 == pytest.approx(creep, rel=0.1)


def test_a_sliding_tire_pulls_by_its_friction(model, calibrated):
    data = at_rest(model)
    for name in WHEELS:
        data.joint(f"wheel_{name}").qvel[0] = 5.0
    mujoco.mj_forward(model, data)
    force = np.zeros(6)
    for i, contact in enumerate(data.contact[: data.ncon]):
        mujoco.mj_contactForce(model, data, i, force)
        assert np.hypot(*force[1:3]) == pytest.approx(calibrated.tire.friction_coulomb * force[0], rel=1e-3)
        assert contact.friction[:3] == pytest.approx([calibrated.tire.friction_coulomb] * 2 + [contact.friction[2]])
    assert data.qacc[0] > 0.0


def test_scrub_follows_the_law_of_swivelling(calibrated):
    tire = calibrated.tire
    assert scrub_lever(calibrated) == tire.scrub_radius
    assert scrub_lever(calibrated.with_laws(swivel="bore_torque")) == tire.bore_radius
    discs = (2.0 * tire.disc_offset_inner + 2.0 * tire.disc_offset_outer) / 5.0
    assert scrub_lever(calibrated.with_laws(swivel="five_discs")) == pytest.approx(discs + tire.scrub_radius)


def test_sensors_read_where_the_antennas_are(model):
    data = at_rest(model)
    data.qpos[3:7] = np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)  # heading north
    mujoco.mj_forward(model, data)
    assert data.sensor("gps_main").data == pytest.approx([-0.6, 1.0, 2.2 + data.qpos[2]])
    assert data.sensor("gps_auxiliary").data == pytest.approx([0.6, 1.0, 2.2 + data.qpos[2]])
    step(model, data, 0.5)
    assert data.sensor("imu_force").data == pytest.approx([0.0, 0.0, GRAVITY], abs=1e-3)
    assert data.sensor("joint_angle").data[0] == pytest.approx(data.joint(JOINT).qpos[0], abs=1e-9)


def test_hulls_rest_on_their_corners(calibrated):
    """A machine whose wheels hang stands on hulls that give way as the twin's do."""
    text = mjcf(calibrated)
    model = mujoco.MjModel.from_xml_string(text)
    data = at_rest(model)
    for name in WHEELS:
        model.geom(f"wheel_{name}_tread").conaffinity[:] = 0
    data.qpos[2] -= calibrated.frame.ground_clearance
    step(model, data, 4.0)
    depth = np.array([-contact.dist for contact in data.contact[: data.ncon]])
    assert len(depth) == 8
    assert calibrated.hull.stiffness * depth.sum() == pytest.approx(calibrated.mass * GRAVITY, rel=0.01)


def test_masses_read_back_as_they_were(calibrated):
    root = ElementTree.fromstring(mjcf(calibrated))
    found = {body.attrib["name"]: body.find("inertial") for body in root.iter("body")}
    for body in machine_bodies(calibrated):
        inertial = found.pop(body.name)
        assert inertial is not None and float(inertial.attrib["mass"]) == body.mass
        assert [float(x) for x in inertial.attrib["pos"].split()] == list(body.centre)
    assert not found


@pytest.mark.parametrize(
    "key",
    [
        "frame.front.mass", "frame.rear.inertia_zz", "frame.track", "frame.rear.hull_width", "arm.length", "arm.swing",
        "arm.valve.port_relief", "arm.valve.nominal_flow", "arm.cylinder.seal_viscous", "wheel.inertia_spin", "tire.radius",
        "tire.stiffness", "tire.damping", "tire.friction_coulomb", "tire.rolling_resistance", "hull.stiffness",
        "joint.range", "joint.friction_torque", "joint.stop_stiffness", "oil.bulk_modulus",
        "steering.hose_bulk_modulus", "steering.valve.shock_pressure", "steering.valve.nominal_flow_left",
        "driveline.relief.pressure", "driveline.motor.displacement", "driveline.brake.disc_torque", "engine.set_speed",
    ],
)  # fmt: skip
def test_another_machine_is_another_file(calibrated, key):
    changed = calibrated.scale({key: 0.99}, check_ranges=False)
    assert mjcf(changed) != mjcf(calibrated) == mjcf(calibrated)
    mujoco.MjModel.from_xml_string(mjcf(changed))
