"""The bodies' float32 law against MuJoCo, in one launch over random machines, states and loads."""

# Device code and records: their types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportArgumentType=false, reportCallIssue=false
import numpy as np
import pytest
import warp as wp

from aoro_gym.machine.parameters import Machine
from aoro_gym.twin.physics.bodies import CornerLoad, hinge_rotation, hull_corner
from aoro_gym.twin.physics.bodies import accelerate as tree_accelerations
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
    # accelerations out: base velocity, base angular velocity, joint, arms, absolute wheel spins
    out: wp.array2d(dtype=float),
):
    t = wp.tid()
    m = machines[t % machines.shape[0]]
    weight = wp.quat_rotate_inv(attitude[t], wp.vec3(0.0, 0.0, -gravity))
    change = tree_accelerations(
        m.frame_front, m.frame_rear, m.corner, weight, hinge_rotation(joint_angle[t]), velocity[t], omega[t],
        joint_rate[t], joint_torque[t], corners[0, t], corners[1, t], corners[2, t], corners[3, t],
        frame_force[0, t], frame_moment[0, t], frame_force[1, t], frame_moment[1, t],
    )  # fmt: skip
    for i in range(3):
        out[i, t] = change.linear[i]
        out[3 + i, t] = change.angular[i]
    out[6, t] = change.joint
    for i in range(4):
        out[7 + i, t] = change.arms[i]
        out[11 + i, t] = change.spins[i]


def _law(machines, sample, kin):
    """The law's accelerations (15, N) in N states of the ``machines`` in turn; wheels: relative to their arms."""
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

    out = wp.zeros((15, count), dtype=float, device="cpu")
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
    found = _law(machines, sample, kin)

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
