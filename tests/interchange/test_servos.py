"""Springs, limits and rates of the hinges, against volumes and against the twin's own oil."""

# Device code and records: their types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportArgumentType=false, reportCallIssue=false
import numpy as np
import pytest
import warp as wp

from aoro_gym.interchange.servos import arm_displacement, servos, steering_displacement, wheel_motors
from aoro_gym.machine.rigid_bodies import rest_angles
from aoro_gym.twin.physics.arms import ArmState, arm_displace, arm_geometry, arm_oil_torque, arm_seal_capacity
from aoro_gym.twin.physics.joint import cylinder_drag, joint_capacity
from aoro_gym.twin.physics.steering import steering_displace, steering_geometry, steering_torque
from aoro_gym.twin.physics.steering_circuit import SteeringState
from aoro_gym.twin.records import MachineRecord, pack

SLIDING = wp.constant(10.0)
"""[rad/s] At which nothing of static friction is left."""
TURN = 1e-4
"""[rad] By which oil is pressed: some bar, 1 % and less of the moduli; and far above float32's rounding of the torques."""


@wp.kernel(enable_backward=False)
def pressed(
    machines: wp.array(dtype=MachineRecord),
    rest: wp.array(dtype=float),
    turn: float,
    out: wp.array2d(dtype=float),
    friction: wp.array2d(dtype=float),
):
    """Oil torques of joint, front arm and rear arm with shut valves, before and after ``turn``, and their friction
    and damping as they slide; ``rest`` has the return line's pressure, angle and pressures of the front arm, and of the rear
    one."""
    m = machines[0]
    ports = SteeringState()
    ports.port_a = rest[0]
    ports.port_b = rest[0]
    g = steering_geometry(m.steering, 0.0)
    out[0, 0] = steering_torque(m.oil, g, ports)
    out[0, 1] = steering_torque(m.oil, g, steering_displace(m.steering, m.oil, g, turn, ports))
    friction[0, 0] = joint_capacity(m.joint, m.steering, m.oil, g, ports, SLIDING)
    friction[0, 1] = cylinder_drag(m.steering, g)
    for i in range(2):
        arm = arm_geometry(m.arm, rest[1 + 3 * i], 0.0)
        chambers = ArmState(rest[2 + 3 * i], rest[3 + 3 * i], 0.0)
        out[1 + i, 0] = arm_oil_torque(m.oil, arm, chambers)
        out[1 + i, 1] = arm_oil_torque(m.oil, arm, arm_displace(m.arm, m.oil, arm, turn, chambers))
        friction[1 + i, 0] = arm_seal_capacity(m.arm, m.oil, arm, chambers, SLIDING)
        friction[1 + i, 1] = m.arm.cylinder_seal_viscous * arm.lever * arm.lever


@pytest.fixture(scope="module")
def of_the_twin(calibrated):
    """Oil torques [N m] (3, 2), and friction [N m] with damping [N m s/rad] (3, 2), of joint, front arm and rear arm."""
    rest, rod = calibrated.rest, calibrated.arm.rod_rest_pressure
    given = [calibrated.steering.tank_line.back_pressure, rest.arm_angle_front, rest.bore_pressure_front, rod]
    given += [rest.arm_angle_rear, rest.bore_pressure_rear, rod]
    out, friction = (wp.zeros((3, 2), dtype=float, device="cpu") for _ in range(2))
    records = wp.array(pack(calibrated), dtype=MachineRecord, device="cpu")
    wp.launch(
        pressed,
        dim=1,
        inputs=[records, wp.array(given, dtype=float, device="cpu"), TURN],
        outputs=[out, friction],
        device="cpu",
    )
    return out.numpy().astype(float), friction.numpy().astype(float)


def test_springs_are_as_stiff_as_the_twins_shut_in_oil(calibrated, of_the_twin):
    oil_torques = of_the_twin[0]
    stiffness = (oil_torques[:, 0] - oil_torques[:, 1]) / TURN
    by_hinge = {servo.hinge: servo for servo in servos(calibrated)}
    found = [by_hinge[hinge].stiffness for hinge in ("articulated_joint", "arm_fl", "arm_rl")]
    np.testing.assert_allclose(found, stiffness, rtol=0.01)


def test_oil_bears_the_arms_at_rest(calibrated, of_the_twin):
    oil_torques = of_the_twin[0]
    by_hinge = {servo.hinge: servo for servo in servos(calibrated)}
    np.testing.assert_allclose([by_hinge[hinge].load for hinge in ("arm_fr", "arm_rr")], oil_torques[1:, 0], rtol=1e-5)


def test_friction_and_damping_are_the_twins_sliding_seals(calibrated, of_the_twin):
    by_hinge = {servo.hinge: servo for servo in servos(calibrated)}
    found = [(by_hinge[hinge].friction, by_hinge[hinge].damping) for hinge in ("articulated_joint", "arm_fl", "arm_rl")]
    np.testing.assert_allclose(found, of_the_twin[1], rtol=1e-5)  # float32's rounding


def test_stops_are_the_twins(calibrated):
    record: np.ndarray = pack(calibrated)[0]
    joint, arm = servos(calibrated)[:2]
    for servo, section in ((joint, "joint"), (arm, "arm")):
        found = servo.stop_stiffness, servo.stop_damping
        expected = [record[section][f"stop_torsional_{name}"] for name in ("stiffness", "damping")]
        assert found == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("angle", [-0.4, -0.1, 0.0, 0.3, 0.45])
def test_torques_do_the_work_that_the_volumes_take(calibrated, angle):
    """p dV = T dθ, by differences of the chambers' volumes."""
    steering, arm = calibrated.steering.cylinder, calibrated.arm.cylinder

    def volumes(turned):
        right, left = steering.linkage.extension(turned), steering.linkage.extension(-turned)
        raised = arm.linkage.extension(-turned)
        port_b = steering.bore_area * left + steering.annulus_area * (steering.stroke - right)
        port_a = steering.bore_area * right + steering.annulus_area * (steering.stroke - left)
        return np.array([-port_b, port_a, -arm.bore_area * raised, arm.annulus_area * (arm.stroke - raised)])

    step = 1e-5
    expected = (volumes(angle + step) - volumes(angle - step)) / (2.0 * step)
    found = [*steering_displacement(calibrated, angle), *arm_displacement(calibrated, angle)]
    np.testing.assert_allclose(found, expected, rtol=1e-8)


def test_limits_follow_from_relief_pressures_and_flows(calibrated):
    joint, arm = servos(calibrated)[:2]
    to_right, to_left = steering_displacement(calibrated, 0.0)
    valve = calibrated.steering.valve
    assert joint.held_torque == pytest.approx((-valve.shock_pressure * to_right, valve.shock_pressure * to_left))
    assert joint.rate == pytest.approx((-valve.nominal_flow_right / to_right, valve.nominal_flow_left / to_left))
    bore, rod = arm_displacement(calibrated, rest_angles(calibrated)["arm_fl"])
    assert arm.held_torque == pytest.approx((-350e5 * bore, 350e5 * rod))
    assert arm.driven_torque == pytest.approx((-210e5 * bore, 210e5 * rod))


def test_a_soft_mount_is_in_series_with_the_oil(calibrated):
    rigid = servos(calibrated)[0].stiffness
    soft = servos(calibrated.set({"joint.compliance": 2e-7}))[0].stiffness
    assert 1.0 / soft == pytest.approx(1.0 / rigid + 2e-7)


def test_gears_share_flow_and_displacement(calibrated):
    motors = {motor.hinge[-2:]: motor for motor in wheel_motors(calibrated)}
    drive = calibrated.driveline
    full = drive.motor.displacement * drive.relief.pressure * drive.motor.mechanical_efficiency
    shares = {
        gear: {name: motors[name].torque[gear] / full for name in motors} for gear in ("gear_1", "gear_2", "gear_3")
    }
    assert shares["gear_1"] == pytest.approx({"fl": 1.0, "fr": 1.0, "rl": 1.0, "rr": 1.0})
    assert shares["gear_2"] == pytest.approx({"fl": 1.0, "fr": 1.0, "rl": 0.5, "rr": 0.5})
    assert shares["gear_3"] == pytest.approx({"fl": 0.5, "fr": 0.5, "rl": 0.5, "rr": 0.5})
    other = {motor.hinge[-2:]: motor for motor in wheel_motors(calibrated.with_laws(second_gear="front"))}
    for wheel, opposite in (("fl", "rl"), ("rr", "fr")):
        assert other[wheel].torque["gear_2"] == motors[opposite].torque["gear_2"]
    for gear, of_wheel in shares.items():
        taken = sum(drive.motor.displacement * share * motors[name].speed[gear] for name, share in of_wheel.items())
        assert taken == pytest.approx(drive.pump.displacement * calibrated.engine.set_speed)
