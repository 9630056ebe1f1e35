"""Kernels of cranes on a foot that stands still: moving them, and what holds and bears them."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

from aoro_gym.twin.physics.crane import CraneRecord, carried_by_frame, crane_motion, joint_acceleration


@wp.func
def load_joints(array: wp.array2d(dtype=float), t: int):
    """Four rows of crane ``t``."""
    return wp.vec4(array[0, t], array[1, t], array[2, t], array[3, t])


@wp.func
def store_joints(array: wp.array2d(dtype=float), t: int, value: wp.vec4):
    """Inverse of :func:`load_joints`."""
    for i in range(4):
        array[i, t] = value[i]


@wp.kernel(enable_backward=False)
def swing(
    cranes: wp.array(dtype=CraneRecord),
    gravity: wp.array(dtype=wp.vec3),
    torques: wp.array2d(dtype=float),
    # state in and out: joints, rates, accelerations over the last step
    joints: wp.array2d(dtype=float),
    rates: wp.array2d(dtype=float),
    accelerations: wp.array2d(dtype=float),
    steps: int,
    h: float,
):
    """Move each crane by ``steps`` of ``h`` [s] under constant torques: drift, kick, drift, with rates extrapolated to the
    middle of the step, as ``advance`` moves the vehicle."""
    t = wp.tid()
    m = cranes[t % cranes.shape[0]]
    weight = gravity[t % gravity.shape[0]]
    torque = load_joints(torques, t)
    q = load_joints(joints, t)
    rate = load_joints(rates, t)
    change = load_joints(accelerations, t)
    still = wp.vec3()
    for step in range(steps):
        q += 0.5 * h * rate
        at = crane_motion(m, q, rate + 0.5 * h * change, still)
        change = joint_acceleration(at, torque, still, -weight)
        rate += h * change
        q += 0.5 * h * rate
    store_joints(joints, t, q)
    store_joints(rates, t, rate)
    store_joints(accelerations, t, change)


@wp.kernel(enable_backward=False)
def weigh(
    cranes: wp.array(dtype=CraneRecord),
    gravity: wp.array(dtype=wp.vec3),
    torques: wp.array2d(dtype=float),
    joints: wp.array2d(dtype=float),
    rates: wp.array2d(dtype=float),
    # out: tip [m]; force [N] and moment [N m] on the foot; what holds the joints at rest; kinetic and potential energy [J]
    tips: wp.array(dtype=wp.vec3),
    forces: wp.array(dtype=wp.vec3),
    moments: wp.array(dtype=wp.vec3),
    holding: wp.array2d(dtype=float),
    energies: wp.array2d(dtype=float),
):
    """What each crane does to its foot, and what it takes to hold it."""
    t = wp.tid()
    m = cranes[t % cranes.shape[0]]
    weight = gravity[t % gravity.shape[0]]
    still = wp.vec3()
    at = crane_motion(m, load_joints(joints, t), load_joints(rates, t), still)
    felt = carried_by_frame(at, load_joints(torques, t))
    tips[t] = at.tip
    forces[t] = felt.c * weight - felt.f
    moments[t] = felt.b * weight - felt.n
    store_joints(holding, t, -(wp.transpose(at.u_linear) * weight))
    energies[0, t] = at.kinetic
    energies[1, t] = -wp.dot(weight, at.moment)
