"""Kernels for the start of twins on soil: they forget their ruts, and stand sunk in fresh ground."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from functools import cache
from typing import Any

import warp as wp

from aoro_gym.twin.kernels.soil import (
    AGE,
    LEG,
    LEG_ROWS,
    LEG_X,
    LEG_Y,
    PRESSED_EVERY,
    SINKAGE,
    WHEEL_ROWS,
    Standing,
    standing,
)
from aoro_gym.twin.kernels.state import load_state
from aoro_gym.twin.physics.bodies import hinge_rotation, wheel_centre
from aoro_gym.twin.physics.soil import Soil, UniformRut, wheel_reaction
from aoro_gym.twin.physics.tires import Tire
from aoro_gym.twin.records import MachineRecord, State

HALVINGS = wp.constant(30)  # of an interval that holds the sinkage: to a nanometre
FAR = wp.constant(1.0e9)  # [m] away, from where a wheel begins a leg at once


@wp.kernel(enable_backward=False)
def forget(
    keys: wp.array2d(dtype=int),
    count: wp.array(dtype=int),
    full: wp.array(dtype=int),
    wheels: wp.array2d(dtype=float),
    mask: wp.array(dtype=wp.bool),
):
    """Twins of the ``mask`` have no ruts, and their wheels leave a trace at once."""
    t = wp.tid()
    if not mask[t]:
        return
    for slot in range(keys.shape[1]):
        keys[t, slot] = 0
    count[t] = 0
    full[t] = 0
    for row in range(wheels.shape[0]):
        wheels[row, t] = 0.0
    for i in range(4):
        wheels[WHEEL_ROWS * i + AGE, t] = PRESSED_EVERY


@wp.kernel(enable_backward=False)
def begin_legs(legs: wp.array2d(dtype=float), mask: wp.array(dtype=wp.bool)):
    """Wheels of the ``mask``'s twins begin a leg where they first leave a trace."""
    t = wp.tid()
    if not mask[t]:
        return
    for i in range(4):
        legs[LEG_ROWS * i + LEG_X, t] = FAR
        legs[LEG_ROWS * i + LEG_Y, t] = FAR
        legs[LEG_ROWS * i + LEG, t] = 0.0


@wp.func
def static_sinkage(m: Tire, soil: Soil, twin: int, at: Standing):
    """Sinkage [m] in virgin soil of a wheel that stands on the undisturbed ground with its spring as bent as it is."""
    w = at.patch
    bent = w.depth
    low = float(0.0)
    high = m.radius
    halvings = int(HALVINGS)
    for _ in range(halvings):
        w.sinkage = 0.5 * (low + high)
        w.depth = w.sinkage + bent
        r = wheel_reaction(soil, UniformRut(), twin, w)
        if r.load < m.stiffness * bent:
            low = w.sinkage
        else:
            high = w.sinkage
    return 0.5 * (low + high)


def settle(
    machines: wp.array(dtype=MachineRecord),
    terrain: Any,
    mask: wp.array(dtype=wp.bool),
    state: wp.array2d(dtype=float),
):
    """Lower twins of the ``mask``, which stand on hard ground, by what their wheels sink: the plane that fits the four
    sinkages best moves the machine, so that its springs are as bent as before."""
    t = wp.tid()
    if not mask[t]:
        return
    m = machines[t % machines.shape[0]]
    soil = terrain.soils[t % terrain.soils.shape[0]]
    pose, velocity, change, bent, actuators, circuits, engine = load_state(state, t, m.varies_laws)  # noqa: RUF059
    front = wp.quat_to_matrix(pose.orientation)
    spread = wp.mat33()
    sums = wp.vec3()
    for i in range(4):
        rotation = front
        direction = float(1.0)
        pivot_x = m.frame_front.pivot_x
        if i >= 2:
            rotation = front * wp.transpose(hinge_rotation(pose.joint))
            direction = float(-1.0)
            pivot_x = m.frame_rear.pivot_x
        centre = wheel_centre(m.corner, pivot_x, direction, 1.0 - 2.0 * float(i & 1), pose.arms[i])
        at = standing(m.tire, terrain.ground, terrain.ground.twins[t], rotation, pose.position, centre)
        sinkage = float(0.0)
        if at.patch.depth > 0.0:
            sinkage = static_sinkage(m.tire, soil, t, at)
        terrain.ruts.wheels[WHEEL_ROWS * i + SINKAGE, t] = sinkage
        offset = rotation * (centre + at.place)
        one = wp.vec3(1.0, offset[0], offset[1])
        spread += wp.outer(one, one)
        sums += (sinkage / at.under.normal[2]) * one
    plane = wp.inverse(spread) * sums
    state[State.Z, t] = state[State.Z, t] - plane[0]
    q = wp.normalize(wp.quat(-0.5 * plane[2], 0.5 * plane[1], 0.0, 1.0) * pose.orientation)
    for row in range(4):
        state[int(State.QX) + row, t] = q[row]


@cache
def build(kind: Any) -> Any:
    """The kernel ``settle`` for one kind of ground of soil."""
    module = f"{__name__}.{kind.key.lower()}"
    wp.set_module_options({"default_grid_stride": False}, module=module)
    return wp.overload(wp.kernel(settle, enable_backward=False, module=module), {"terrain": kind})
