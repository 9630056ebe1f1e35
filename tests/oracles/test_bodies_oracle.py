"""The float64 reference of the bodies: against MuJoCo, against closed forms, and against the laws of conservation."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from aoro_gym.machine.parameters import Machine
from tests.oracles.bodies import (
    DIRECTION_OF_WHEEL,
    HALF_OF_WHEEL,
    SIDE_OF_WHEEL,
    Body,
    BodyModel,
    Tree,
    random_sample,
    relative_error,
    uneven_machines,
)
from tests.oracles.mujoco_model import MujocoMachine

GRAVITY = 9.81
NUM_MACHINES = 8
NUM_STATES = 50  # of each machine

# Both sides solve M a = f in float64. The mass matrix, scaled to a unit diagonal, has a condition number below 70 in
# these samples, so a backward-stable solution of 15 unknowns is good to about 15 · 2.2e-16 · 70 = 2e-13 in the mass
# norm; a factor of 5 is for loads in f that cancel.
ROUNDING = 1e-12


@pytest.fixture(scope="module")
def machine():
    return Machine.load("aoro_datasheet")


@pytest.fixture(scope="module")
def model(machine):
    return BodyModel(machine)


@pytest.fixture
def rng():
    return np.random.default_rng(20080523)


def test_accelerations_equal_mujoco(machine, rng):
    machines = uneven_machines(machine, rng, NUM_MACHINES)
    worst, where = 0.0, None
    for i in range(NUM_MACHINES):
        one = machines.variant(i)
        model, other = BodyModel(one), MujocoMachine(one)
        sample = random_sample(rng, NUM_STATES)
        found = model.accelerations(sample.q, sample.v, *sample.loads)
        states = [sample.one(k) for k in range(NUM_STATES)]
        expected = np.stack([other.accelerations(s.q, s.v, *s.loads) for s in states], -1)
        error = relative_error(model.mass_matrix(sample.q), found, expected)
        if error.max() > worst:
            worst, where = error.max(), (i, int(error.argmax()))
    assert worst <= ROUNDING, f"machine and state {where}: relative error {worst:.2e} in the mass norm"


def test_mass_matrix_equals_mujoco(machine, model, rng):
    other = MujocoMachine(machine)
    q = random_sample(rng, 20).q
    expected = np.stack([other.mass_matrix(q[:, k]) for k in range(20)], -1)
    np.testing.assert_allclose(model.mass_matrix(q), expected, rtol=0.0, atol=ROUNDING * np.abs(expected).max())


def test_kinematics_equal_mujoco(machine, model, rng):
    other = MujocoMachine(machine)
    sample = random_sample(rng, 20)
    kin = model.kinematics(sample.q, sample.v)
    for k in range(20):
        rotation, center, velocity, angular = other.kinematics(sample.q[:, k], sample.v[:, k])
        # lengths of up to 20 m, speeds of up to 40 m/s, spins of up to 40 rad/s
        np.testing.assert_allclose(kin.rotation[..., k], rotation, atol=1e-13)
        np.testing.assert_allclose(kin.wheel_center[..., k], center, atol=1e-13)
        np.testing.assert_allclose(kin.wheel_velocity[..., k], velocity, atol=1e-12)
        np.testing.assert_allclose(kin.wheel_angular[..., k], angular, atol=1e-12)


def test_states_translate_to_mujoco_and_back(machine, rng):
    other = MujocoMachine(machine)
    sample = random_sample(rng, 1).one(0)
    q, v = other.from_mujoco(*other.to_mujoco(sample.q, sample.v))
    np.testing.assert_allclose(q, sample.q, atol=1e-14)
    np.testing.assert_allclose(v, sample.v, atol=1e-13)


def test_kinematics_follow_the_machine_conventions(machine, model, rng):
    """Wheel centres and absolute spins from the definitions of the angles, in the axes of the half-frames."""
    sample = random_sample(rng, 10)
    kin = model.kinematics(sample.q, sample.v)
    arm, frame = machine.arm, machine.frame
    phi, phi_rate, wheel_rate = sample.q[8:12], sample.v[7:11], sample.v[11:15]
    s = DIRECTION_OF_WHEEL[:, None]
    axle = np.array([frame.front.axle_distance, frame.rear.axle_distance])[HALF_OF_WHEEL, None]
    center = np.stack(
        [
            s * (axle - arm.length + arm.length * np.cos(phi)),
            np.broadcast_to(SIDE_OF_WHEEL[:, None] * 0.5 * frame.track, phi.shape),
            arm.pivot_height + arm.length * np.sin(phi),
        ]
    )
    from_hinge = kin.to_half(kin.wheel_center - kin.hinge[:, None], HALF_OF_WHEEL)
    np.testing.assert_allclose(from_hinge, center, atol=1e-13)
    frame_angular = kin.to_half(kin.frame_angular, np.array([0, 1]))
    np.testing.assert_allclose(kin.spin, frame_angular[1, HALF_OF_WHEEL] - s * phi_rate + wheel_rate, atol=1e-13)
    # θ is the heading of the front frame relative to the rear one
    heading = [
        np.arctan2(r[1, 0], r[0, 0]) for r in np.moveaxis(model.kinematics(_upright(0.3), np.zeros(15)).rotation, 2, 0)
    ]
    assert heading[0] - heading[1] == pytest.approx(0.3, abs=1e-15)


def _upright(theta):
    q = np.zeros(16)
    q[3], q[7] = 1.0, theta
    return q


def test_batch_equals_loop(model, rng):
    sample = random_sample(rng, 24)
    batched = model.accelerations(sample.q, sample.v, *sample.loads)
    states = [sample.one(k) for k in range(24)]
    looped = np.stack([model.accelerations(s.q, s.v, *s.loads) for s in states], -1)
    mass_matrix = model.mass_matrix(sample.q)
    assert relative_error(mass_matrix, batched, looped).max() <= ROUNDING

    # two batch axes, loads without batch axes, and a shared forward pass
    q, v = sample.q.reshape(16, 4, 6), sample.v.reshape(15, 4, 6)
    shared = [load[..., 0] for load in sample.loads]
    grid = model.accelerations(q, v, *shared, kinematics=model.kinematics(q, v))
    one = model.accelerations(q[:, 2, 3], v[:, 2, 3], *shared)
    assert grid.shape == (15, 4, 6)
    assert relative_error(model.mass_matrix(q[:, 2, 3]), grid[:, 2, 3], one) <= ROUNDING


def test_wrong_shapes_are_refused(model):
    with pytest.raises(ValueError, match=r"must be \(16, \.\.\.\) and \(15, \.\.\.\)"):
        model.kinematics(np.zeros(15), np.zeros(16))


def test_free_fall(model, rng):
    """Without spin or loads, every body falls alike: no relative acceleration, in whatever attitude and pose."""
    q = random_sample(rng, 20).q
    a = model.accelerations(q, np.zeros((15, 20)))
    expected = np.zeros((15, 20))
    expected[:3] = -GRAVITY * model.kinematics(q, np.zeros((15, 20))).rotation[2, :, 0]
    assert relative_error(model.mass_matrix(q), a, expected).max() <= ROUNDING


def test_power_of_the_loads_is_the_rate_of_energy(model, rng):
    """Signs and points of attack of every load: dE/dt = Σ torque · rate + Σ force · velocity."""
    sample = random_sample(rng, 50)
    q, v = sample.q, sample.v
    kin = model.kinematics(q, v)
    powers = [
        sample.tau_theta * v[6],
        np.sum(sample.tau_phi * v[7:11], 0),
        np.sum(sample.tau_wheel * v[11:15], 0),
        np.sum(sample.wheel_force * kin.wheel_velocity, (0, 1)),
        np.sum(sample.wheel_moment * kin.wheel_angular, (0, 1)),
        np.sum(sample.frame_force * kin.hinge_velocity[:, None], (0, 1)),
        np.sum(sample.frame_moment * kin.frame_angular, (0, 1)),
    ]
    q_rate, v_rate = model.pose_rate(q, v), model.accelerations(q, v, *sample.loads)
    h = 1e-5
    rate = (model.energy(q + h * q_rate, v + h * v_rate) - model.energy(q - h * q_rate, v - h * v_rate)) / (2.0 * h)
    # central difference: h²/6 · d³E/dt³, with rates of up to 300 1/s (accelerations over rates) 1.5e-6 of the power
    error = np.abs(rate - np.sum(powers, 0)) / np.sum(np.abs(powers), 0)
    assert error.max() <= 2e-6, f"state {error.argmax()}: {error.max():.2e}"


def _integrate(model, q, v, duration):
    """End state of free motion, batched."""
    split, shape = q.shape[0], (q.shape[0] + v.shape[0], *q.shape[1:])

    def rate(_, y):
        y = y.reshape(shape)
        a = model.forward_dynamics(model.snapshot(y[:split], y[split:]))
        return np.concatenate([model.pose_rate(y[:split], y[split:]), a]).ravel()

    start = np.concatenate([q, v]).ravel()
    end = solve_ivp(rate, (0.0, duration), start, "DOP853", rtol=1e-11, atol=1e-11).y[:, -1].reshape(shape)
    return end[:split], end[split:]


def test_free_tumbling_conserves_energy_and_momentum(model, rng):
    """Three machines tumble in free fall for 1 s with swinging arms, turning joint and spinning wheels."""
    sample = random_sample(rng, 3)
    start, end = (sample.q, sample.v), _integrate(model, sample.q, sample.v, 1.0)
    mass = model.mass.sum()
    # DOP853 keeps the local error at 1e-11 of each state; over some 100 steps, 1e-9 of the quantity itself is left
    np.testing.assert_allclose(model.energy(*end), model.energy(*start), rtol=1e-9)
    fallen = model.linear_momentum(*start) - mass * GRAVITY * np.array([[0.0], [0.0], [1.0]])
    np.testing.assert_allclose(model.linear_momentum(*end), fallen, atol=1e-9 * mass * GRAVITY)
    before, after = (model.angular_momentum(q, v, about=model.center_of_mass(q)) for q, v in (start, end))
    np.testing.assert_allclose(after, before, atol=1e-9 * np.abs(before).max())
    # the centre of mass flies its parabola
    ballistic = model.center_of_mass(start[0]) + model.linear_momentum(*start) / mass
    ballistic[2] -= 0.5 * GRAVITY
    np.testing.assert_allclose(model.center_of_mass(end[0]), ballistic, atol=1e-8)


def test_symmetric_top_precesses_as_euler_found():
    """Free symmetric top, closed form: ω_z stays and (ω_x, ω_y) turns at (I_z − I_x)/I_x · ω_z (Landau and Lifshitz,
    *Mechanics*, § 36); its centre of mass is off the origin of its coordinates, which changes nothing."""
    transverse, axial, duration = 3.0, 5.0, 2.0
    inertia = np.diag([transverse, transverse, axial])
    top = Tree([Body("top", -1, np.zeros(3), np.zeros(3), 7.0, np.array([0.2, -0.1, 0.4]), inertia)])
    q = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    v = np.array([0.0, 0.0, 0.0, 1.2, -0.7, 4.0])
    angle = (axial - transverse) / transverse * v[5] * duration
    turned = (v[3] + 1j * v[4]) * np.exp(1j * angle)
    _, end = _integrate(top, q, v, duration)
    np.testing.assert_allclose(end[3:], [turned.real, turned.imag, v[5]], atol=1e-9)


def test_machine_at_rest_is_in_equilibrium(machine, rng):
    """The derived rest pose of several machines: with its wheel loads and its cylinder pressures nothing accelerates,
    and the wheels stand on the ground with the deflection that carries the load."""
    machines = uneven_machines(machine, rng, NUM_MACHINES)
    for i in range(NUM_MACHINES):
        one = machines.variant(i)
        rest, arm = one.rest, one.arm
        q = _upright(0.0)
        q[2] = rest.height
        q[8:12] = np.array([rest.arm_angle_front, rest.arm_angle_rear])[HALF_OF_WHEEL]
        model = BodyModel(one)
        force = np.zeros((3, 4))
        force[2] = np.array([rest.wheel_load_front, rest.wheel_load_rear])[HALF_OF_WHEEL]
        bore = np.array([rest.bore_pressure_front, rest.bore_pressure_rear])[HALF_OF_WHEEL]
        # the cylinder grows as the wheel sinks, so its thrust lowers the wheel
        thrust = bore * arm.cylinder.bore_area - arm.rod_rest_pressure * arm.cylinder.annulus_area
        step = 1e-6
        lever = (arm.cylinder.linkage.length(-q[8:12] + step) - arm.cylinder.linkage.length(-q[8:12] - step)) / (
            2.0 * step
        )
        a = model.accelerations(q, np.zeros(15), 0.0, -thrust * lever, 0.0, force)
        # the numerical lever is good to 1e-10 of some 40 kN m, which moves an arm of 170 kg m²
        np.testing.assert_allclose(a, 0.0, atol=1e-7)
        height = model.kinematics(q, np.zeros(15)).wheel_center[2]
        np.testing.assert_allclose(height, one.tire.radius - force[2] / one.tire.stiffness, atol=1e-12)
