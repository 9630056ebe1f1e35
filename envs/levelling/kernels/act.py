"""From the arms' signals to commands: :meth:`aoro_gym.envs.levelling.task.Levelling.commands` for one vehicle."""

import warp as wp

from aoro_gym.envs.core.kernels.joint import joint_rate
from aoro_gym.envs.core.kernels.step import StepMemory, taken_action
from aoro_gym.envs.levelling import driving
from aoro_gym.envs.levelling.kernels.memory import Driver, Frames
from aoro_gym.envs.path_tracking.kernels.act import command, make_room
from aoro_gym.envs.path_tracking.kernels.geometry import place_at
from aoro_gym.envs.path_tracking.kernels.memory import Control, Courses, Driving, Rules, Sensing, Vehicle

ZERO = wp.constant(wp.float64(0.0))
ONE = wp.constant(wp.float64(1.0))
SLOWEST = wp.constant(wp.float64(driving.SLOWEST))


@wp.func
def bend_ahead(c: Courses, d: Driving, r: Rules, p: Driver, i: int):
    """Curvature of the path [1/m] where the driver looks."""
    share = wp.min(p.look_ahead / r.preview[0], ONE)
    here = place_at(c, d.path[i], d.measured_s[i]).curvature
    ahead = place_at(c, d.path[i], d.measured_s[i] + r.preview[0]).curvature
    return (ONE - share) * here + share * ahead


@wp.func
def steering(p: Driver, left: wp.float64):
    """Signal [-] that turns the joint by ``left`` [rad]."""
    demand = wp.clamp(p.gain * left, -ONE, ONE)
    if wp.abs(left) <= p.rest_error or demand == ZERO:
        return ZERO
    skipped = wp.where(demand > ZERO, p.dead_band_left, p.dead_band_right)
    return wp.sign(demand) * (skipped + (ONE - skipped) * wp.abs(demand))


@wp.func
def steer(c: Courses, s: Sensing, v: Vehicle, d: Driving, r: Rules, p: Driver, limit: wp.float64, i: int):
    """Steering signal of Stanley's law; see :meth:`aoro_gym.envs.levelling.driving.PathDriver.signals`."""
    curvature = bend_ahead(c, d, r, p, i)
    lean = wp.atan(curvature * v.front[i])
    bend = lean + wp.asin(wp.clamp(curvature * v.rear[i] * wp.cos(lean), -ONE, ONE))
    closing = wp.atan(p.cross_track_gain * d.measured_cross_track[i] / wp.max(s.speed[i], SLOWEST))
    wanted = wp.clamp(bend - p.heading_gain * (d.measured_heading_error[i] + closing), -limit, limit)
    return steering(p, wanted - s.joint.angles[0, i] - p.lead_time * joint_rate(s.joint, i))


@wp.kernel(enable_backward=False, module="aoro_gym.envs.levelling.kernels")
def act(m: StepMemory, c: Courses, k: Control, s: Sensing, v: Vehicle, d: Driving, r: Rules, p: Driver, f: Frames):
    """Steer and drive, command the arms, and remember both."""
    i = wp.tid()
    memory = f.signals.shape[0]
    make_room(d, i)
    d.actions[0, i, 0] = float(steer(c, s, v, d, r, p, f.largest_angle[i], i))
    d.actions[0, i, 1] = p.drive_signal
    for wheel in range(4):
        for age in range(memory - 1):
            f.signals[memory - 1 - age, i, wheel] = f.signals[memory - 2 - age, i, wheel]
        signal = taken_action(m, i, wheel)
        f.signals[0, i, wheel] = signal
        d.actions[0, i, k.arms_column + wheel] = signal
    command(m, k, s, v, d, i)
