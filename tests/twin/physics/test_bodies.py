"""The bodies' float32 law against MuJoCo, in one launch over random machines, states and loads."""

# Device code and records: their types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportArgumentType=false, reportCallIssue=false
import numpy as np
import pytest
import warp as wp

from aoro_gym.machine.parameters import Machine
from aoro_gym.twin.physics.bodies import CornerLoad, add, halves, hinge_rotation, hull_corner
from aoro_gym.twin.physics.bodies import accelerate as tree_accelerations
from aoro_gym.twin.physics.load import LoadSolution, LoadState, load_inertia, moved_load
from aoro_gym.twin.records import WHEELS, MachineRecord, pack
from tests.oracles.bodies import (
    DIRECTION_OF_WHEEL,
    HALF_OF_WHEEL,
    BodyModel,
    random_sample,
    relative_error,
    uneven_machines,
)
from tests.oracles.mujoco_model import MujocoMachine

GRAVITY = 9.81
NUM_MACHINES = 8
NUM_STATES = 50  # of each machine

# Rounding alone: a backward-stable elimination of n = 15 unknowns is good to n · ε · κ in the mass norm at the very
# worst, with float32's ε = 6e-8 and the condition number κ < 70 of the mass matrix scaled to a unit diagonal. That is
# 6e-5; errors of independent sign add up to √n · ε · κ = 1.6e-5.
ROUNDING = 2e-5

NAMES = (
    *("base x", "base y", "base z", "base roll", "base pitch", "base yaw", "joint"),
    *(f"arm {w}" for w in WHEELS),
    *(f"wheel {w}" for w in WHEELS),
)


@wp.kernel(enable_backward=False)
def accelerate(
    # parameters
    machines: wp.array(dtype=MachineRecord),
    gravity: float,
    # state
    attitude: wp.array(dtype=wp.quat),
    joint_angle: wp.array(dtype=float),
    velocity: wp.array(dtype=wp.vec3),
    omega: wp.array(dtype=wp.vec3),
    joint_rate: wp.array(dtype=float),
    # loads: corners, frames (in the axes of their halves), joint
    corners: wp.array2d(dtype=CornerLoad),
    frame_force: wp.array2d(dtype=wp.vec3),
    frame_moment: wp.array2d(dtype=wp.vec3),
    joint_torque: wp.array(dtype=float),
    lying: wp.array(dtype=LoadState),
    # accelerations out: base velocity, base angular velocity, joint, arms, absolute wheel spins, load
    out: wp.array2d(dtype=float),
):
    t = wp.tid()
    m = machines[t % machines.shape[0]]
    weight = wp.quat_rotate_inv(attitude[t], wp.vec3(0.0, 0.0, -gravity))
    to_rear = hinge_rotation(joint_angle[t])
    omega_rear = to_rear * omega[t] - wp.vec3(0.0, 0.0, joint_rate[t])
    both = halves(
        m.frame_front, m.frame_rear, m.corner, omega[t], omega_rear, corners[0, t], corners[1, t], corners[2, t],
        corners[3, t], frame_force[0, t], frame_moment[0, t], frame_force[1, t], frame_moment[1, t],
    )  # fmt: skip
    solution = LoadSolution()
    if m.payload.mass > 0.0:
        body, solution = load_inertia(m.payload, lying[t], omega_rear, 0.0)
        both.rear = add(both.rear, body)
    change, angular, linear = tree_accelerations(
        m.corner, both, weight, to_rear, velocity[t], omega[t], joint_rate[t], joint_torque[t], corners[0, t],
        corners[1, t], corners[2, t], corners[3, t],
    )  # fmt: skip
    if m.payload.mass > 0.0:
        out[15, t] = moved_load(m.payload, lying[t], solution, angular, linear, 0.0).acceleration
    for i in range(3):
        out[i, t] = change.linear[i]
        out[3 + i, t] = change.angular[i]
    out[6, t] = change.joint
    for i in range(4):
        out[7 + i, t] = change.arms[i]
        out[11 + i, t] = change.spins[i]


def _law(machines, sample, kin, lying=None):
    """The law's accelerations (16, N) in N states of the ``machines`` in turn; wheels: relative to their arms; the last is
    that of a load that lies as ``lying`` (N,) says."""
    frames, count = np.array([0, 1]), sample.q.shape[1]
    corners = np.zeros((4, count), dtype=CornerLoad.numpy_dtype())
    corners["angle"], corners["rate"], corners["spin"] = sample.q[8:12], sample.v[7:11], kin.spin
    corners["arm_torque"], corners["wheel_torque"] = sample.tau_phi, sample.tau_wheel
    corners["force"] = np.moveaxis(kin.to_half(sample.wheel_force, HALF_OF_WHEEL), 0, -1)
    corners["moment"] = np.moveaxis(kin.to_half(sample.wheel_moment, HALF_OF_WHEEL), 0, -1)

    def vectors(x):
        return wp.array(np.ascontiguousarray(np.moveaxis(x, 0, -1), np.float32), dtype=wp.vec3, device="cpu")

    def scalars(x):
        return wp.array(x.astype(np.float32), dtype=float, device="cpu")

    lying = np.zeros(count, dtype=LoadState.numpy_dtype()) if lying is None else lying
    out = wp.zeros((16, count), dtype=float, device="cpu")
    wp.launch(
        accelerate,
        dim=count,
        inputs=[
            wp.array(pack(machines), dtype=MachineRecord, device="cpu"),
            GRAVITY,
            wp.array(np.ascontiguousarray(sample.q[[4, 5, 6, 3]].T, np.float32), dtype=wp.quat, device="cpu"),
            scalars(sample.q[7]),
            vectors(sample.v[0:3]),
            vectors(sample.v[3:6]),
            scalars(sample.v[6]),
            wp.array(corners, dtype=CornerLoad, device="cpu"),
            vectors(kin.to_half(sample.frame_force, frames)),
            vectors(kin.to_half(sample.frame_moment, frames)),
            scalars(sample.tau_theta),
            wp.array(lying, dtype=LoadState, device="cpu"),
        ],
        outputs=[out],
        device="cpu",
    )
    return _relative(out.numpy().astype(float), sample)


def _relative(a, sample):
    """Accelerations with absolute wheel spins as ones with rates relative to the arms: w' = Ω' − ω_y' + s φ''."""
    theta, theta_rate, omega = sample.q[7], sample.v[6], sample.v[3:6]
    # y part of the rear frame's ω = R_z(θ) ω_front − θ' z
    rear = (
        np.sin(theta) * a[3] + np.cos(theta) * a[4] + theta_rate * (np.cos(theta) * omega[0] - np.sin(theta) * omega[1])
    )
    a = a.copy()
    a[11:15] += DIRECTION_OF_WHEEL[:, None] * a[7:11] - np.stack([a[4], rear])[HALF_OF_WHEEL]
    return a


@pytest.fixture(scope="module")
def machines():
    rng = np.random.default_rng(2008)
    return uneven_machines(Machine.load("aoro_datasheet"), rng, NUM_MACHINES)


def test_accelerations_equal_mujoco(machines):
    rng = np.random.default_rng(15)
    which = np.arange(NUM_MACHINES * NUM_STATES) % NUM_MACHINES
    sample = random_sample(rng, which.size)
    # rotations and spins, all that is used of it, are the same for all machines
    kin = BodyModel(machines.variant(0)).kinematics(sample.q, sample.v)
    found = _law(machines, sample, kin)[:15]

    expected, error = np.empty_like(found), np.empty(which.size)
    for i in range(NUM_MACHINES):
        here = which == i
        one = machines.variant(i)
        other = MujocoMachine(one)
        for k in np.flatnonzero(here):
            s = sample.one(k)
            expected[:, k] = other.accelerations(s.q, s.v, *s.loads)
        error[here] = relative_error(BodyModel(one).mass_matrix(sample.q[:, here]), found[:, here], expected[:, here])
    k = int(np.argmax(error))
    table = "\n".join(
        f"  {name:10} {x:12.5g} law {y:12.5g} MuJoCo"
        for name, x, y in zip(NAMES, found[:, k], expected[:, k], strict=True)
    )
    assert error[k] <= ROUNDING, (
        f"{np.sum(error > ROUNDING)} of {error.size} states are off; the worst is state {k} of machine {which[k]}, by "
        f"{error[k]:.2e} in the mass norm:\n{table}"
    )


@pytest.mark.parametrize("slide_range", [0.3, 0.0], ids=["sliding", "fixed"])
def test_accelerations_with_a_load_equal_mujoco(machines, slide_range):
    """Logs that slide without friction against the spring of a stop, or lie fast; their mass is up to that of the rear
    frame, so that the condition number stays what :data:`ROUNDING` takes it to be within a factor of two."""
    laden = machines.set({"payload.count": np.linspace(5.0, 45.0, NUM_MACHINES), "payload.slide_range": slide_range})
    laden = laden.set({"payload.friction": 0.0, "payload.stop_damping": 0.0}, check_ranges=False)
    rng = np.random.default_rng(16)
    which = np.arange(NUM_MACHINES * NUM_STATES) % NUM_MACHINES
    sample = random_sample(rng, which.size)
    kin = BodyModel(machines.variant(0)).kinematics(sample.q, sample.v)
    lying = np.zeros(which.size, dtype=LoadState.numpy_dtype())
    if slide_range:
        lying["slide"], lying["rate"] = rng.uniform(-0.32, 0.32, which.size), rng.normal(0.0, 1.0, which.size)
    found = _law(laden, sample, kin, lying)
    others = [MujocoMachine(laden.variant(i)) for i in range(NUM_MACHINES)]
    error, slides = np.empty(which.size), np.empty(which.size)
    for k, i in enumerate(which):
        other, s, slide = others[i], sample.one(k), float(lying["slide"][k])
        beyond = np.sign(slide) * max(abs(slide) - slide_range, 0.0)
        other.slide = (slide, float(lying["rate"][k]), -float(laden.payload.stop_stiffness) * beyond)
        expected = other.accelerations(s.q, s.v, *s.loads)
        matrix = BodyModel(machines.variant(int(i))).mass_matrix(s.q)
        error[k] = relative_error(matrix, found[:15, k], expected)
        if slide_range:
            freedom = other.model.joint("load").dofadr[0]
            slides[k] = abs(found[15, k] - other.data.qacc[freedom]) / np.abs(other.data.qacc).max()
    assert error.max() <= 2.0 * ROUNDING
    assert not slide_range or slides.max() <= 2.0 * ROUNDING


@wp.kernel(enable_backward=False)
def hull_corners(machines: wp.array(dtype=MachineRecord), out: wp.array2d(dtype=wp.vec3)):
    i = wp.tid()
    m = machines[0]
    out[0, i] = hull_corner(m.frame_front, m.frame_ground_clearance, i)
    out[1, i] = hull_corner(m.frame_rear, m.frame_ground_clearance, i)


def test_hulls_are_boxes_about_their_centres_of_gravity():
    machine = Machine.load("aoro")
    records = wp.array(pack(machine), dtype=MachineRecord, device="cpu")
    out = wp.zeros((2, 8), dtype=wp.vec3, device="cpu")
    wp.launch(hull_corners, dim=8, inputs=[records], outputs=[out], device="cpu")
    for half, corners in zip((machine.frame.front, machine.frame.rear), out.numpy(), strict=True):
        low, high = corners.min(axis=0), corners.max(axis=0)
        assert (low + high)[:2] / 2.0 == pytest.approx([half.cog_x, 0.0], abs=1e-6)
        assert low[2] == pytest.approx(machine.frame.ground_clearance)
        assert len({tuple(np.isclose(corner, high)) for corner in corners}) == 8  # each corner once
