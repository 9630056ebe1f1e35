"""A crane on the twin's front frame: accelerations against MuJoCo, rest, statics, momentum and energy in free flight."""

# Device code and records: their types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportArgumentType=false, reportCallIssue=false, reportGeneralTypeIssues=false
import pickle
from typing import Any

import numpy as np
import pytest
import warp as wp

from aoro_gym import Machine, Twin
from aoro_gym.machine.vehicle_crane import VehicleCrane, bodies
from aoro_gym.terrains import Plane
from aoro_gym.twin.frame_cranes import GRAPPLE_DROP, pack_on_frame
from aoro_gym.twin.kernels.corners import HullLoads
from aoro_gym.twin.kernels.crane_on_frame import DefaultLawsWithCrane, FrameCrane, tree_with_crane
from aoro_gym.twin.kernels.laws import DefaultLaws
from aoro_gym.twin.kernels.state import Velocity
from aoro_gym.twin.physics.bodies import CornerLoad, hinge_rotation
from aoro_gym.twin.records import CHANNELS, CRANE_OUTPUT_UNITS, WHEELS, CraneRow, MachineRecord, State, pack
from tests.oracles.bodies import BodyModel, random_sample
from tests.oracles.mujoco_model import MujocoMachine
from tests.twin.physics.test_bodies import _relative
from tests.twin.test_conservation import HEIGHT, LOSSLESS, generalised, oil_energy

STATES = 60
TORQUES = VehicleCrane(drive="torques")
POSE = np.array([1.2, 0.4, -0.9, 0.5])


@pytest.fixture(scope="module")
def twins() -> Twin:
    """Four twins with cranes."""
    return Twin(4, crane=True)


# bodies


@wp.kernel(enable_backward=False)
def solve(
    machines: wp.array(dtype=MachineRecord), laws: DefaultLawsWithCrane, state: wp.array2d(dtype=float),
    attitude: wp.array(dtype=wp.quat), joint: wp.array(dtype=float), linear: wp.array(dtype=wp.vec3),
    angular: wp.array(dtype=wp.vec3), rates: wp.array(dtype=float), corners: wp.array2d(dtype=CornerLoad),
    torque: wp.array(dtype=float), out: wp.array2d(dtype=float),
):  # fmt: skip
    t = wp.tid()
    weight = wp.quat_rotate_inv(attitude[t], wp.vec3(0.0, 0.0, -9.81))
    middle = Velocity()
    middle.linear = linear[t]
    middle.angular = angular[t]
    middle.joint = rates[t]
    change = tree_with_crane(
        machines[0], laws, state, t, weight, hinge_rotation(joint[t]), middle, torque[t], corners[0, t], corners[1, t],
        corners[2, t], corners[3, t], HullLoads(), HullLoads(), 0.0,
    )  # fmt: skip
    for i in range(3):
        out[i, t] = change.linear[i]
        out[3 + i, t] = change.angular[i]
    out[6, t] = change.joint
    for i in range(4):
        out[7 + i, t] = change.arms[i]
        out[11 + i, t] = change.spins[i]


@pytest.mark.parametrize("held", [0.0, 600.0])
def test_accelerations_of_vehicle_and_crane_equal_mujoco(held):
    """Joint, arms, wheels, frame and crane at once, in random states under random torques, with an empty grapple and with
    a point of 600 kg at the tip.

    MuJoCo takes no body whose moments of inertia break A + B ≥ C, as the estimates of frame and crane together do, so the
    front frame's are larger here. Rounding as in tests/twin/physics/test_crane.py, twice the unknowns: 1e-4 of a state's
    largest acceleration.
    """
    wide = {"frame.front.inertia_xx": 4000.0, "frame.front.inertia_yy": 5000.0, "frame.front.inertia_zz": 5000.0}
    machine = Machine.load("aoro").set(wide, check_ranges=False)
    rng = np.random.default_rng(11)
    sample = random_sample(rng, STATES)
    q = rng.uniform((-3.0, -0.5, -2.6, 0.0), (3.0, 1.4, 0.0, 1.6), (STATES, 4))
    rates = rng.normal(0.0, (0.6, 0.5, 0.7, 0.5), (STATES, 4))
    torque = rng.normal(0.0, (2e4, 6e4, 3e4, 1e4), (STATES, 4))
    state = np.zeros((int(max(CraneRow)) + 1, STATES), dtype=np.float32)
    for row, value in ((CraneRow.JOINT_SLEW, q), (CraneRow.RATE_SLEW, rates), (CraneRow.TORQUE_SLEW, torque)):
        state[int(row) : int(row) + 4] = value.T
    state[CraneRow.HELD_MASS] = held
    records = pack_on_frame(TORQUES)
    records["chain"]["held_drop"] = 0.0  # a point at the tip
    laws: Any = DefaultLawsWithCrane()
    laws.laws, laws.cranes = DefaultLaws(), wp.array(records, dtype=FrameCrane, device="cpu")
    kin = BodyModel(machine).kinematics(sample.q, sample.v)
    corners = np.zeros((4, STATES), dtype=CornerLoad.numpy_dtype())
    corners["angle"], corners["rate"], corners["spin"] = sample.q[8:12], sample.v[7:11], kin.spin
    corners["arm_torque"], corners["wheel_torque"] = sample.tau_phi, sample.tau_wheel

    def on_device(values, kind):
        return wp.array(np.ascontiguousarray(values, np.float32), dtype=kind, device="cpu")

    rows, out = on_device(state, float), wp.zeros((15, STATES), dtype=float, device="cpu")
    wp.launch(
        solve, STATES,
        [
            wp.array(pack(machine), dtype=MachineRecord, device="cpu"), laws, rows,
            on_device(sample.q[[4, 5, 6, 3]].T, wp.quat), on_device(sample.q[7], float),
            on_device(sample.v[:3].T, wp.vec3), on_device(sample.v[3:6].T, wp.vec3), on_device(sample.v[6], float),
            wp.array(corners, dtype=CornerLoad, device="cpu"), on_device(sample.tau_theta, float), out,
        ],
        device="cpu",
    )  # fmt: skip
    found = np.concatenate(
        [_relative(out.numpy().astype(float), sample), rows.numpy()[CraneRow.ACCELERATION_SLEW :][:4]]
    )
    other = MujocoMachine(machine, crane=TORQUES, held=held)
    expected = np.empty_like(found)
    for k in range(STATES):
        s = sample.one(k)
        other.crane = (q[k], rates[k], torque[k])
        expected[:15, k] = other.accelerations(s.q, s.v, s.tau_theta, s.tau_phi, s.tau_wheel)
        expected[15:, k] = other.crane_accelerations()
    size = np.abs(expected).max(axis=0)
    assert (np.abs(found - expected) / size).max() < 1e-4
    specific = rows.numpy()[CraneRow.TIP_LOAD]
    assert np.all(specific > 0.0)


def test_the_resting_machine_is_the_published_one():
    """Folded crane against the mass on the frame: wheel loads and pose after a second, to float32's rounding of 10 t."""
    plain, with_crane = Twin(), Twin(crane=True)
    for twin in (plain, with_crane):
        twin.step({}, 1.0)
    for name in (*(f"wheel_load_{wheel}" for wheel in WHEELS), *(f"arm_angle_{wheel}" for wheel in WHEELS)):
        assert with_crane.output(name) == pytest.approx(plain.output(name), rel=2e-6), name
    for name in ("position_x", "position_z", "pitch", "roll"):
        assert with_crane.output(name) == pytest.approx(plain.output(name), abs=2e-6), name
    assert with_crane.channels == (*CHANNELS, *CRANE_OUTPUT_UNITS)
    assert with_crane.output("crane_tip_load") == pytest.approx(300.0 * 9.81, rel=1e-4)


def test_a_locked_crane_drives_and_turns_as_the_published_machine(twins):
    """But for the slew, which swings on its shut oil: about 18 rad/s folded, within 5 % of a second's turn."""
    plain = Twin()
    twins.reset()
    for twin in (plain, twins):
        twin.step({"steering_signal": 0.8, "drive_signal": 0.5}, 1.0)
    for name in ("joint_angle", "position_x", "yaw"):
        assert twins.output(name)[0] == pytest.approx(plain.output(name)[0], rel=0.05), name


def stretched(count: int = 4) -> np.ndarray:
    """Joints (4, count) of cranes stretched out ahead, to the left, behind, and to the right."""
    slews = 2.0 * np.pi / count * np.arange(count)
    slews[slews > np.pi] -= 2.0 * np.pi
    return np.stack([slews, np.full(count, 0.1), np.full(count, -0.2), np.full(count, 1.0)])


THIN = {"tire.disc_drop_inner": 0.30, "tire.disc_drop_outer": 0.31}
"""Of tires that stand on one line, so that what they stand on does not wander as they lean."""


def test_wheels_bear_what_statics_say_with_the_crane_stretched_out():
    """Moments of the wheels' loads about the machine's middle are those of the crane, moved from where it lies folded, and
    of all masses, 1.3 m high (E), on frames that lean as the twin says.

    Means over 4 s, as the machine rocks a while. The mean height is good to 0.2 m, with 0.04 rad of lean 0.8 kN m of 50.
    """
    vehicle, machine = VehicleCrane(), Machine.load("aoro").set(THIN, check_ranges=False)
    twin = Twin(4, machine=machine, crane=True)
    twin.crane.place(stretched())
    twin.step({"parking_brake": 1.0}, 10.0)
    trace = twin.step({}, 4.0, sample_every=0.02)
    load = np.stack([trace[f"wheel_load_{wheel}"] for wheel in WHEELS]).mean(axis=1)
    assert load.sum(axis=0) == pytest.approx(9.81 * machine.mass, rel=3e-3)
    masses, places, _ = bodies(vehicle.crane, twin.crane.joints)
    moment = np.einsum("bv,bvi->vi", masses, places)
    moment += masses.sum(0)[:, None] * [vehicle.mount.foot.distance, 0.0, vehicle.mount.foot.height]
    shift = (moment - vehicle.folded()[1])[:, :2]  # that moving the crane adds [kg m]
    lean = np.stack([trace["pitch"], -trace["roll"]], axis=-1).mean(axis=0)
    expected = 9.81 * (shift + 1.3 * machine.mass * lean)
    front, rear = machine.frame.front.axle_distance, machine.frame.rear.axle_distance
    left = 0.5 * machine.frame.track * (load[0] + load[2] - load[1] - load[3])
    at_rest = 2.0 * (front * machine.rest.wheel_load_front - rear * machine.rest.wheel_load_rear)
    ahead = front * (load[0] + load[1]) - rear * (load[2] + load[3]) - at_rest
    assert np.abs(expected[[1, 3], 1]).min() > 5e4 and np.abs(expected[[0, 2], 0]).min() > 3e4
    assert left[[1, 3]] == pytest.approx(expected[[1, 3], 1], rel=0.03)
    assert ahead[[0, 2]] == pytest.approx(expected[[0, 2], 0], rel=0.03)
    assert np.abs(left[[0, 2]]).max() < 0.01 * left[1]


def centre(machine, vehicle, joints) -> np.ndarray:
    """Centre (3, N) [m] of the mass of frames, crane and wheels: ahead of the hinge, left, over the design ground plane."""
    masses, places, _ = bodies(vehicle.crane, joints)
    foot = [vehicle.mount.foot.distance, 0.0, vehicle.mount.foot.height]
    moment = np.einsum("bv,bvi->vi", masses, places) + masses.sum(0)[:, None] * foot - vehicle.folded()[1]
    frame, corner, arm, rest = machine.frame, machine.corner, machine.arm, machine.rest
    for half in (frame.front, frame.rear):
        moment = moment + half.mass * np.array([half.cog_x, 0.0, half.cog_height])
    for angle in (rest.arm_angle_front, rest.arm_angle_rear):
        moment = moment + 2.0 * corner.mass * np.array([0.0, 0.0, arm.pivot_height + corner.rho * np.sin(angle)])
    return moment.T / machine.mass


def test_it_tips_over_where_statics_say():
    """On a plane that tilts by half a degree a second: crane stretched out downhill, folded, and uphill.

    The last upper wheel lifts for good, half a second, when the weight points at the line where the lower tires' forces
    act, their lowest points: tan ψ = (w/2 − c)/h in the axes of the frames, whose roll ψ the twin says. The oil of the arms
    gives by 2 cm of h (E: a twelfth of the tires), the machine rocks by half a degree, and follows the tilt by 0.1 s: 1° in
    all.
    """
    vehicle, machine = VehicleCrane(), Machine.load("aoro").set(THIN, check_ranges=False)
    joints = np.stack([stretched()[:, 1], vehicle.mount.transport.joints, stretched()[:, 3]], axis=-1)
    middle, arm = centre(machine, vehicle, joints), machine.arm
    axle = arm.pivot_height + arm.length * np.sin(machine.rest.arm_angle_front)
    expected = np.arctan((0.5 * machine.frame.track - middle[1]) / (middle[2] - axle + machine.tire.radius))
    assert np.all(np.diff(np.degrees(expected)) > 5.0)
    slopes = np.degrees(expected) - 13.0
    twin = Twin(3, machine=machine, crane=True, terrain=Plane(slope_deg=slopes, direction_deg=-90.0, friction=2.0))
    twin.crane.place(joints)
    twin.step({"parking_brake": 1.0}, 5.0)
    found, first, lasts = np.full(3, np.nan), np.zeros(3), np.zeros(3, dtype=int)
    for more in np.arange(0.0, 14.0, 0.05):
        rows = twin.ground.twins.numpy().copy()
        tilt = np.radians(slopes + more)
        rows["normal"] = np.stack([0.0 * tilt, np.sin(tilt), np.cos(tilt)], axis=-1)
        twin.ground.twins.assign(rows)
        twin.step({}, 0.1)
        lifted = (twin.output("wheel_load_fr") == 0.0) & (twin.output("wheel_load_rr") == 0.0)
        first = np.where(lifted & (lasts == 0), np.abs(twin.output("roll")), first)
        lasts = np.where(lifted, lasts + 1, 0)
        found = np.where((lasts == 5) & np.isnan(found), first, found)
    assert np.degrees(found) == pytest.approx(np.degrees(expected), abs=1.0)


def flown(vehicle: VehicleCrane, machine, duration: float, samples: int, start: Any = None) -> np.ndarray:
    """States (rows, samples + 1) of one tumbling twin whose crane holds a log, without gravity."""
    twin = Twin(1, machine=machine, gravity=0.0, crane=vehicle)
    twin.crane.place(POSE)
    twin.crane.grasp(mass=300.0, length=4.0, diameter=0.33, yaw=0.6)
    state = twin.state.numpy()
    state[State.Z] = HEIGHT
    for row, value in zip(("VX", "VY", "VZ", "WX", "WY", "WZ"), (0.3, -0.2, 0.4, 0.3, 0.2, 0.4), strict=True):
        state[State[row]] = value
    state[State.JOINT_RATE : State.ARM_RATE_RR + 1] = 0.1
    state[State.PORT_A : State.PORT_B + 1] = 60e5
    bore, annulus = machine.arm.cylinder.bore_area, machine.arm.cylinder.annulus_area
    state[State.ARM_ROD_FL : State.ARM_ROD_RR + 1] = 120e5
    state[State.ARM_BORE_FL : State.ARM_BORE_RR + 1] = 120e5 * annulus / bore
    state[CraneRow.RATE_SLEW : CraneRow.RATE_TELESCOPE + 1, 0] = (0.3, 0.2, -0.2, -0.1)
    state[CraneRow.TORQUE_SLEW : CraneRow.TORQUE_TELESCOPE + 1] = 0.0
    if start is not None:
        start(state)
    twin.state.assign(state)
    states = [twin.state.numpy()[:, 0].copy()]
    for _ in range(samples):
        twin.step({}, duration / samples)
        states.append(twin.state.numpy()[:, 0].copy())
    assert twin.diverged == []
    return np.array(states, dtype=np.float64).T


def chain_motion(vehicle: VehicleCrane, joints, rates):
    """Masses (6, K), places (6, K, 3), velocities and turning rates of the crane's bodies and the log in the front frame,
    for joints (4, K) that move at ``rates``; tensors (6, K, 3, 3). Velocities are central differences over ±1e-6 s."""

    def bodies_at(q):
        masses, places, tensors = bodies(vehicle.crane, q)
        log = vehicle.crane.tip(q).T - [0.0, 0.0, GRAPPLE_DROP]
        along = np.stack([np.cos(q[0] + 0.6), np.sin(q[0] + 0.6), 0.0 * q[0]], axis=-1)
        square = 0.25 * 0.33**2
        axial, across = 0.5 * 300.0 * square, 300.0 * (0.25 * square + 16.0 / 12.0)
        tensor = across * np.eye(3) + (axial - across) * np.einsum("vi,vj->vij", along, along)
        masses = np.concatenate([masses, np.full((1, masses.shape[1]), 300.0)])
        foot = [vehicle.mount.foot.distance, 0.0, vehicle.mount.foot.height]
        return masses, np.concatenate([places, log[None]]) + foot, np.concatenate([tensors, tensor[None]])

    masses, places, tensors = bodies_at(joints)
    ways = [bodies_at(joints + step * rates)[1] for step in (1e-6, -1e-6)]
    up = np.array([0.0, 0.0, 1.0]) * rates[0][:, None]
    across = np.stack([np.sin(joints[0]), -np.cos(joints[0]), 0.0 * joints[0]], axis=-1)
    boom, stick = up + across * rates[1][:, None], up + across * (rates[1] + rates[2])[:, None]
    return masses, places, (ways[0] - ways[1]) / 2e-6, np.stack([up, boom, stick, stick, stick, up]), tensors


def energy_and_momentum(vehicle: VehicleCrane, machine, states) -> tuple[np.ndarray, np.ndarray]:
    """Kinetic energy [J] (K,) and linear momentum [kg m/s] (3, K) of machine, crane and log."""
    q, v = generalised(states)
    body = BodyModel(machine, gravity=0.0)
    kin = body.kinematics(q, v)
    rotation, omega = kin.rotation[:, :, 0], v[3:6].T
    masses, places, speeds, turns, tensors = chain_motion(
        vehicle, states[CraneRow.JOINT_SLEW :][:4], states[CraneRow.RATE_SLEW :][:4]
    )
    linear = v[:3].T + np.cross(omega, places) + speeds
    turning = omega + turns
    kinetic = 0.5 * np.einsum("bv,bvi,bvi->v", masses, linear, linear)
    kinetic += 0.5 * np.einsum("bvi,bvij,bvj->v", turning, tensors, turning)
    mass, moment, tensor = (one[0] for one in vehicle.folded())
    fast = v[:3].T
    folded = 0.5 * mass * np.sum(fast**2, axis=1) + np.sum(fast * np.cross(omega, moment), axis=1)
    folded += 0.5 * np.einsum("vi,ij,vj->v", omega, tensor, omega)
    local = np.einsum("bv,bvi->vi", masses, linear) - mass * fast - np.cross(omega, moment)
    return body.energy(q, v) + kinetic - folded, body.linear_momentum(q, v) + np.einsum("ijv,vj->iv", rotation, local)


def lossless():
    machine = Machine.load("aoro_datasheet").set(LOSSLESS, si=True)
    return machine.set({"driveline.motor.displacement": 1e-9}, check_ranges=False)


def test_energy_and_momentum_are_conserved_while_the_crane_swings_free():
    """Two seconds of tumbling without gravity, with a log; bounds as in tests/twin/test_conservation.py."""
    machine = lossless()
    states = flown(TORQUES, machine, 2.0, 20)
    kinetic, momentum = energy_and_momentum(TORQUES, machine, states)
    energy = kinetic + oil_energy(machine, states)
    assert np.ptp(states[CraneRow.JOINT_SLEW]) > 0.2 and np.ptp(states[CraneRow.JOINT_LIFT]) > 0.1
    assert np.abs(energy - energy[0]).max() < 2e-4 * kinetic[0]
    assert np.linalg.norm(momentum - momentum[:, :1], axis=0).max() < 1e-4 * np.linalg.norm(momentum[:, 0])


def test_a_copy_goes_on_to_the_bit():
    twin = Twin(2, crane=True)
    twin.step({"crane_slew": 0.8, "crane_lift": 0.5}, 0.4)
    copy = pickle.loads(pickle.dumps(twin))
    for one in (twin, copy):
        one.step({"crane_fold": 0.5}, 0.3)
    assert twin.state.numpy().tobytes() == copy.state.numpy().tobytes()
    assert twin.crane.joints[0, 0] > 0.05
    twin.crane.grasp(mass=200.0, length=3.0, diameter=0.3)
    twin.reset([True, False])
    assert twin.crane.held_mass.tolist() == [0.0, 200.0]
    np.testing.assert_allclose(twin.crane.joints[:, 0], VehicleCrane().mount.transport.joints, atol=1e-6)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: Twin().crane, "these twins have no crane; construct them with crane=True"),
        (lambda: Twin(crane=True, device="cpu:simd"), "crane is given, but device is 'cpu:simd'"),
        (lambda: Twin().set_commands({"crane_lift": 0.1}), "there is no command 'crane_lift'"),
        (lambda: Twin(crane=True).step({"crane_lift": 1.5}), r"crane_lift is 1.5, but must be in \[-1, 1\]"),
        (lambda: Twin(crane=True).crane.place([0.0, 2.0, 0.0, 0.0]), "lift is 114.6 deg"),
        (lambda: Twin(2, crane=True).crane.set_torques(np.zeros((4, 3))), r"torques have shape \(4, 3\)"),
        (lambda: Twin(crane=True).crane.grasp(-1.0, 3.0, 0.3), "mass is -1, but must be at least 0"),
    ],
)
def test_what_is_wrong_is_told(call, words):
    with pytest.raises(ValueError, match=words):
        call()
