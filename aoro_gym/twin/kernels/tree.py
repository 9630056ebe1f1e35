"""Accelerations of a machine in the middle of a main step: of the tree alone, and with a load in its bunk.

Machines that carry a load are advanced by kernels of their own, in which :func:`tree_with_load` stands in place of
:func:`tree` (:mod:`aoro_gym.twin.kernels.build`); the others know nothing of it.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from typing import Any

import warp as wp

from aoro_gym.twin.kernels.corners import Half, HullLoads
from aoro_gym.twin.kernels.state import Velocity
from aoro_gym.twin.physics.bodies import CornerLoad, Halves, accelerate, add, halves
from aoro_gym.twin.physics.load import LoadSolution, LoadState, drifted, load_inertia, moved_load
from aoro_gym.twin.records import LoadRow, MachineRecord


@wp.func
def tree(
    m: MachineRecord, laws: Any, state: wp.array2d(dtype=float), t: int, weight: wp.vec3, to_rear: wp.mat33,
    middle: Velocity, joint_torque: float, fl: CornerLoad, fr: CornerLoad, rl: CornerLoad, rr: CornerLoad,
    front_hull: HullLoads, rear_hull: HullLoads, h: float,
):  # fmt: skip
    """Accelerations of twin ``t`` without a load; ``middle``: its motion in the middle of the step of ``h`` [s]."""
    omega_rear = to_rear * middle.angular - wp.vec3(0.0, 0.0, middle.joint)
    both = halves(
        m.frame_front, m.frame_rear, m.corner, middle.angular, omega_rear, fl, fr, rl, rr, front_hull.force,
        front_hull.moment, rear_hull.force, rear_hull.moment,
    )  # fmt: skip
    change, _angular_rear, _linear_rear = accelerate(
        m.corner, both, weight, to_rear, middle.linear, middle.angular, middle.joint, joint_torque, fl, fr, rl, rr
    )
    return change


@wp.func
def further_contact(
    laws: Any, state: wp.array2d(dtype=float), t: int, terrain: Any, ground: Any, front: Half, h: float
):  # fmt: skip
    """What the ground does to what only some machines have: a log in a crane; of this one nothing."""
    return


@wp.func
def load_load_state(state: wp.array2d(dtype=float), t: int):
    """How the load of twin ``t`` lies."""
    return LoadState(
        state[LoadRow.LOAD_SLIDE, t], state[LoadRow.LOAD_RATE, t], state[LoadRow.LOAD_FRICTION, t],
        state[LoadRow.LOAD_ACCELERATION, t], state[LoadRow.LOAD_PRESSING, t],
    )  # fmt: skip


@wp.func
def store_load_state(state: wp.array2d(dtype=float), t: int, value: LoadState):
    """Inverse of :func:`load_load_state`."""
    state[LoadRow.LOAD_SLIDE, t] = value.slide
    state[LoadRow.LOAD_RATE, t] = value.rate
    state[LoadRow.LOAD_FRICTION, t] = value.friction
    state[LoadRow.LOAD_ACCELERATION, t] = value.acceleration
    state[LoadRow.LOAD_PRESSING, t] = value.pressing


@wp.func
def accelerate_with_load(
    m: MachineRecord, state: wp.array2d(dtype=float), t: int, both: Halves, weight: wp.vec3, to_rear: wp.mat33,
    omega_rear: wp.vec3, middle: Velocity, joint_torque: float, fl: CornerLoad, fr: CornerLoad, rl: CornerLoad,
    rr: CornerLoad, h: float,
):  # fmt: skip
    """Accelerations of ``both`` halves with the load of twin ``t``, if it has one, which a step of ``h`` [s] moves."""
    lies = LoadState()
    solution = LoadSolution()
    if m.payload.mass > 0.0:
        lies = drifted(m.payload, load_load_state(state, t), h)
        body, solution = load_inertia(m.payload, lies, omega_rear, h)
        both.rear = add(both.rear, body)
    change, angular_rear, linear_rear = accelerate(
        m.corner, both, weight, to_rear, middle.linear, middle.angular, middle.joint, joint_torque, fl, fr, rl, rr
    )
    if m.payload.mass > 0.0:
        store_load_state(state, t, moved_load(m.payload, lies, solution, angular_rear, linear_rear, h))
    return change


@wp.func
def tree_with_load(
    m: MachineRecord, laws: Any, state: wp.array2d(dtype=float), t: int, weight: wp.vec3, to_rear: wp.mat33,
    middle: Velocity, joint_torque: float, fl: CornerLoad, fr: CornerLoad, rl: CornerLoad, rr: CornerLoad,
    front_hull: HullLoads, rear_hull: HullLoads, h: float,
):  # fmt: skip
    """As :func:`tree`, with the load on the rear frame, which a step of ``h`` [s] moves; its state is kept between steps."""
    omega_rear = to_rear * middle.angular - wp.vec3(0.0, 0.0, middle.joint)
    both = halves(
        m.frame_front, m.frame_rear, m.corner, middle.angular, omega_rear, fl, fr, rl, rr, front_hull.force,
        front_hull.moment, rear_hull.force, rear_hull.moment,
    )  # fmt: skip
    return accelerate_with_load(
        m, state, t, both, weight, to_rear, omega_rear, middle, joint_torque, fl, fr, rl, rr, h
    )
