"""What a vehicle's controller sees: observation terms by name, for one vehicle."""

import warp as wp

from aoro_gym.envs.core.kernels.joint import joint_rate
from aoro_gym.envs.core.kernels.step import OWN, StepMemory, observe_value
from aoro_gym.envs.path_tracking import observations
from aoro_gym.envs.path_tracking.kernels.geometry import height_at, place_at
from aoro_gym.envs.path_tracking.kernels.memory import Control, Courses, Driving, Rules, Sensing
from aoro_gym.twin.records import Output
from aoro_gym.units import GRAVITY

WEIGHT = wp.constant(wp.float64(GRAVITY))

OBSERVED = (
    observations.cross_track, observations.heading_error, observations.remaining, observations.speed,
    observations.joint_angle, observations.joint_rate, observations.roll, observations.pitch, observations.yaw_rate,
    observations.gear, observations.gps_quality,
    observations.EXACT_TERMS["cross_track"], observations.EXACT_TERMS["heading_error"],
    observations.preview, observations.curvature, observations.wheel_speeds, observations.actions,
    observations.inertial, observations.heights,
)  # fmt: skip
"""Functions of observation terms that :func:`observe` knows, by their kinds; those of one column first."""

(
    CROSS_TRACK, HEADING_ERROR, REMAINING, SPEED, JOINT_ANGLE, JOINT_RATE, ROLL, PITCH, YAW_RATE, GEAR, GPS_QUALITY,
    EXACT_CROSS_TRACK, EXACT_HEADING_ERROR, PREVIEW, CURVATURE, WHEEL_SPEEDS, ACTIONS, INERTIAL, HEIGHTS,
) = (wp.constant(kind) for kind in range(len(OBSERVED)))  # fmt: skip


@wp.func
def observed(kind: int, k: Control, s: Sensing, d: Driving, i: int):
    """An observation term of one column; see :mod:`aoro_gym.envs.path_tracking.observations`."""
    if kind == CROSS_TRACK:
        return d.measured_cross_track[i]
    if kind == HEADING_ERROR:
        return d.measured_heading_error[i]
    if kind == REMAINING:
        return d.length[i] - d.measured_s[i]
    if kind == SPEED:
        return s.speed[i]
    if kind == JOINT_ANGLE:
        return s.joint.angles[0, i]
    if kind == JOINT_RATE:
        return joint_rate(s.joint, i)
    if kind == ROLL:
        return s.roll[i]
    if kind == PITCH:
        return s.pitch[i]
    if kind == YAW_RATE:
        return s.rates[i, 2]
    if kind == GEAR:
        return k.gear[i]
    if kind == GPS_QUALITY:
        return wp.float64(s.gps.state[i])
    if kind == EXACT_CROSS_TRACK:
        return d.cross_track[i]
    return d.heading_error[i]


@wp.func
def observe_preview(m: StepMemory, c: Courses, s: Sensing, d: Driving, r: Rules, i: int, column: int):
    """Path ahead in the vehicle's axes as measured."""
    sine = wp.sin(s.localisation.heading[i])
    cosine = wp.cos(s.localisation.heading[i])
    for n in range(r.preview.shape[0]):
        place = place_at(c, d.path[i], d.measured_s[i] + r.preview[n])
        x = place.x - s.localisation.position[i, 0]
        y = place.y - s.localisation.position[i, 1]
        observe_value(m, i, column + 2 * n, cosine * x + sine * y)
        observe_value(m, i, column + 2 * n + 1, cosine * y - sine * x)


@wp.func
def observe_curvature(m: StepMemory, c: Courses, d: Driving, r: Rules, i: int, column: int):
    """Curvature beside the vehicle and ahead."""
    observe_value(m, i, column, place_at(c, d.path[i], d.measured_s[i]).curvature)
    for n in range(r.preview.shape[0]):
        place = place_at(c, d.path[i], d.measured_s[i] + r.preview[n])
        observe_value(m, i, column + 1 + n, place.curvature)


@wp.func
def observe_heights(m: StepMemory, c: Courses, d: Driving, r: Rules, i: int, column: int):
    """Ground at the scan's places over that at the reference point."""
    yaw = wp.float64(m.outputs[m.outputs.shape[0] - 1, Output.YAW, i])
    sine = wp.sin(yaw)
    cosine = wp.cos(yaw)
    x = d.reference[i, 0]
    y = d.reference[i, 1]
    base = height_at(c, d.course[i], x, y)
    for g in range(r.scan.shape[0]):
        ahead = r.scan[g, 0]
        left = r.scan[g, 1]
        height = height_at(c, d.course[i], x + cosine * ahead - sine * left, y + sine * ahead + cosine * left)
        observe_value(m, i, column + g, height - base)


@wp.func
def observe_many(kind: int, m: StepMemory, c: Courses, s: Sensing, d: Driving, r: Rules, i: int, column: int):
    """An observation term of several columns, from ``column`` on."""
    if kind == PREVIEW:
        observe_preview(m, c, s, d, r, i, column)
    elif kind == CURVATURE:
        observe_curvature(m, c, d, r, i, column)
    elif kind == WHEEL_SPEEDS:
        for wheel in range(4):
            observe_value(m, i, column + wheel, s.wheel_rates[i, wheel])
    elif kind == ACTIONS:
        signals = d.actions.shape[2]
        for age in range(d.actions.shape[0]):
            for signal in range(signals):
                observe_value(m, i, column + age * signals + signal, wp.float64(d.actions[age, i, signal]))
    elif kind == INERTIAL:
        observe_value(m, i, column, s.rates[i, 0])
        observe_value(m, i, column + 1, s.rates[i, 1])
        for axis in range(3):
            observe_value(m, i, column + 2 + axis, s.force[i, axis] / WEIGHT)
    elif kind == HEIGHTS:
        observe_heights(m, c, d, r, i, column)


@wp.kernel(enable_backward=False, module="aoro_gym.envs.path_tracking.kernels")
def observe(m: StepMemory, c: Courses, k: Control, s: Sensing, d: Driving, r: Rules):
    """Write the observation, unless it stays as it was."""
    i = wp.tid()
    if m.keeps[i]:
        return
    for term in range(m.observation_kinds.shape[0]):
        kind = m.observation_kinds[term]
        if kind != OWN:
            if kind < PREVIEW:
                observe_value(m, i, m.columns[term], observed(kind, k, s, d, i))
            else:
                observe_many(kind, m, c, s, d, r, i, m.columns[term])
