"""The bodies' float32 law against MuJoCo, in one launch over random machines, states and loads."""

import numpy as np
import pytest
import warp as wp

from aoro_gym.twin.laws.bodies import (
    CornerLoad,
    add,
    arm_acceleration,
    corner_inertia,
    frame_inertia,
    hinge_rotation,
    join,
)
from aoro_gym.twin.parameters import Machine
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
    w = omega[t]
    to_rear = hinge_rotation(joint_angle[t])
    w_rear = to_rear * w - wp.vec3(0.0, 0.0, joint_rate[t])
    x_front = m.frame_front.pivot_x
    x_rear = m.frame_rear.pivot_x
    fl, arm_fl = corner_inertia(m.corner, x_front, 1.0, 1.0, w, corners[0, t])
    fr, arm_fr = corner_inertia(m.corner, x_front, 1.0, -1.0, w, corners[1, t])
    rl, arm_rl = corner_inertia(m.corner, x_rear, -1.0, 1.0, w_rear, corners[2, t])
    rr, arm_rr = corner_inertia(m.corner, x_rear, -1.0, -1.0, w_rear, corners[3, t])
    front = add(frame_inertia(m.frame_front, w, frame_force[0, t], frame_moment[0, t]), add(fl, fr))
    rear = add(frame_inertia(m.frame_rear, w_rear, frame_force[1, t], frame_moment[1, t]), add(rl, rr))
    d_omega, linear, d_joint, d_omega_rear, linear_rear = join(front, rear, to_rear, w, joint_rate[t], joint_torque[t])
    weight = wp.quat_rotate_inv(attitude[t], wp.vec3(0.0, 0.0, gravity))
    d_velocity = linear - wp.cross(w, velocity[t]) - weight
    for i in range(3):
        out[i, t] = d_velocity[i]
        out[3 + i, t] = d_omega[i]
    out[6, t] = d_joint
    out[7, t] = arm_acceleration(arm_fl, d_omega, linear)
    out[8, t] = arm_acceleration(arm_fr, d_omega, linear)
    out[9, t] = arm_acceleration(arm_rl, d_omega_rear, linear_rear)
    out[10, t] = arm_acceleration(arm_rr, d_omega_rear, linear_rear)
    for i in range(4):
        out[11 + i, t] = (corners[i, t].wheel_torque + corners[i, t].moment[1]) / m.corner.spin_inertia


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
    return uneven_machines(Machine.load("aoro"), rng, NUM_MACHINES)


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
