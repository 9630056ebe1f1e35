"""A Kalman filter on dead reckoning and GPS: :mod:`aoro_gym.sensors.pose_filter` for one twin."""

import numpy as np
import warp as wp

from aoro_gym.execution.array_api import Arrays
from aoro_gym.sensors import pose_filter as filters
from aoro_gym.sensors.kernels.attitude import wrapped
from aoro_gym.sensors.kernels.gps import FLOAT, Solution
from aoro_gym.sensors.kernels.noise import constants
from aoro_gym.sensors.pose_filter import PoseFilter

ZERO = wp.constant(wp.float64(0.0))
HALF = wp.constant(wp.float64(0.5))
ONE = wp.constant(wp.float64(1.0))
X, Y, HEADING, BIAS, SLIP, SIDESLIP, DRIFT_X, FLOAT_X, ROLL_ERROR, PITCH_ERROR = (
    wp.constant(place)
    for place in (
        filters.X, filters.Y, filters.HEADING, filters.BIAS, filters.SLIP, filters.SIDESLIP, filters.DRIFT_X,
        filters.FLOAT_X, filters.ROLL_ERROR, filters.PITCH_ERROR,
    )
)  # fmt: skip
LARGEST_SHARE = wp.constant(wp.float64(filters.LARGEST_SHARE))
UNKNOWN_POSITION = wp.constant(wp.float64(filters.UNKNOWN_POSITION))
UNKNOWN_HEADING = wp.constant(wp.float64(filters.UNKNOWN_HEADING))
row_of_state = wp.types.vector(length=filters.SIZE, dtype=wp.float64)


@wp.struct
class PoseFilterMemory:
    """Of N twins."""

    antenna: wp.vec3d  # [m]
    line: wp.vec3d  # [m] from the main antenna to the auxiliary one
    direction: wp.float64  # [rad] of it
    step: wp.float64  # [s]
    longitudinal_creep: wp.float64
    lateral_creep: wp.float64
    friction: wp.float64
    slip_walk: wp.float64  # [√s]
    sideslip_walk: wp.float64  # [rad √s]
    position2: wp.float64  # [m²] variance of a solution
    heading2: wp.vec3d  # [rad²] likewise, by quality
    turn2: wp.float64  # [rad²] of the heading a step
    mean: wp.array(dtype=wp.float64)  # (12,)
    decay: wp.array(dtype=wp.float64)  # (12,) a step
    spread2: wp.array(dtype=wp.float64)  # (12,) variances
    fresh2: wp.array(dtype=wp.float64)  # (12,) what a step adds to them
    history: wp.array3d(dtype=wp.float64)  # (K, N, 5) newest first
    turning: wp.array2d(dtype=wp.float64)  # (N, 3) [rad/s], and its derivatives by roll and pitch
    state: wp.array2d(dtype=wp.float64)  # (N, 12)
    covariance: wp.array3d(dtype=wp.float64)  # (N, 12, 12)
    position: wp.array2d(dtype=wp.float64)  # (N, 2) [m]
    heading: wp.array(dtype=wp.float64)  # (N,) [rad]


@wp.struct
class Levelled:
    """The plan's part of a vector at heading 0, and its derivatives."""

    value: wp.vec2d
    by_roll: wp.vec2d
    by_pitch: wp.vec2d


@wp.struct
class Reckoned:
    """A row of the history."""

    place: wp.vec2d  # [m]
    heading: wp.float64  # [rad]
    roll: wp.float64
    pitch: wp.float64


def pose_filter_memory(pose_filter: PoseFilter, arrays: Arrays) -> PoseFilterMemory:
    """The memory of ``pose_filter``, shared."""
    out, settings = PoseFilterMemory(), pose_filter.settings
    for name in ("antenna", "line", "heading2"):
        values = np.ravel(arrays.host(getattr(pose_filter, f"_{name}")))
        setattr(out, name, wp.vec3d(*(float(value) for value in values)))
    for name in ("direction", "position2", "turn2"):
        setattr(out, name, getattr(pose_filter, f"_{name}"))
    for name in ("longitudinal_creep", "lateral_creep", "friction", "slip_walk", "sideslip_walk"):
        setattr(out, name, getattr(settings, name))
    for name in ("mean", "decay", "spread2", "fresh2"):
        setattr(out, name, constants(arrays, arrays.host(getattr(pose_filter, f"_{name}"))))
    out.step = pose_filter.step
    for name in ("history", "turning"):
        setattr(out, name, arrays.shared(getattr(pose_filter, f"_{name}")))
    for name in ("state", "covariance", "position", "heading"):
        setattr(out, name, arrays.shared(getattr(pose_filter, name)))
    return out


@wp.func
def plane_turned(angle: wp.float64, vector: wp.vec2d):
    """A plane vector, turned left by an angle."""
    s = wp.sin(angle)
    c = wp.cos(angle)
    return wp.vec2d(c * vector[0] - s * vector[1], s * vector[0] + c * vector[1])


@wp.func
def levelled(roll: wp.float64, pitch: wp.float64, vector: wp.vec3d):
    """The plan's part of a vector of the frame's axes."""
    s = wp.sin(roll)
    c = wp.cos(roll)
    y = c * vector[1] - s * vector[2]
    z = s * vector[1] + c * vector[2]
    s = wp.sin(pitch)
    c = wp.cos(pitch)
    out = Levelled()
    out.value = wp.vec2d(c * vector[0] + s * z, y)
    out.by_roll = wp.vec2d(s * y, -z)
    out.by_pitch = wp.vec2d(c * z - s * vector[0], ZERO)
    return out


@wp.func
def heading_rate(rates: wp.vec3d, roll: wp.float64, pitch: wp.float64):
    """Turning rate [rad/s] of the heading, and its derivatives by roll and pitch."""
    s = wp.sin(roll)
    c = wp.cos(roll)
    flat = wp.cos(pitch)
    rate = (rates[1] * s + rates[2] * c) / flat
    return wp.vec3d(rate, (rates[1] * c - rates[2] * s) / flat, rate * wp.tan(pitch))


@wp.func
def creep(f: PoseFilterMemory, roll: wp.float64, pitch: wp.float64):
    """Slip [-] and sideslip [rad] that a slope makes."""
    along = wp.tan(pitch) / wp.cos(roll)
    across = -wp.tan(roll)
    share = wp.sqrt(along * along + across * across) / f.friction
    more = ONE / (ONE - wp.min(share, LARGEST_SHARE))
    return wp.vec2d(f.longitudinal_creep * along * more, f.lateral_creep * across * more)


@wp.func
def spread_on(f: PoseFilterMemory, i: int, heading: wp.float64, moved: wp.vec2d, way: wp.float64, rate: wp.vec3d):
    """Move the covariance on by a step of ``way`` [m] at a mean ``heading`` and turning ``rate`` with its derivatives."""
    size = f.mean.shape[0]  # loops of a constant number would be unrolled
    c = wp.cos(heading)
    s = wp.sin(heading)
    # rows, then columns, of the flow: position by heading, what turns it wrongly, and slips; heading by that
    for k in range(size):
        wrong = rate[1] * f.covariance[i, ROLL_ERROR, k] + rate[2] * f.covariance[i, PITCH_ERROR, k]
        wrong = f.step * (f.covariance[i, BIAS, k] + wrong)
        h = f.covariance[i, HEADING, k] - HALF * wrong
        a = way * f.covariance[i, SLIP, k]
        b = way * f.covariance[i, SIDESLIP, k]
        f.covariance[i, X, k] = f.decay[X] * f.covariance[i, X, k] - moved[1] * h + a * c - b * s
        f.covariance[i, Y, k] = f.decay[Y] * f.covariance[i, Y, k] + moved[0] * h + a * s + b * c
        f.covariance[i, HEADING, k] = f.covariance[i, HEADING, k] - wrong
        for row in range(BIAS, size):
            f.covariance[i, row, k] = f.decay[row] * f.covariance[i, row, k]
    for k in range(size):
        wrong = rate[1] * f.covariance[i, k, ROLL_ERROR] + rate[2] * f.covariance[i, k, PITCH_ERROR]
        wrong = f.step * (f.covariance[i, k, BIAS] + wrong)
        h = f.covariance[i, k, HEADING] - HALF * wrong
        a = way * f.covariance[i, k, SLIP]
        b = way * f.covariance[i, k, SIDESLIP]
        f.covariance[i, k, X] = f.covariance[i, k, X] - moved[1] * h + a * c - b * s
        f.covariance[i, k, Y] = f.covariance[i, k, Y] + moved[0] * h + a * s + b * c
        f.covariance[i, k, HEADING] = f.covariance[i, k, HEADING] - wrong
        for column in range(BIAS, size):
            f.covariance[i, k, column] = f.decay[column] * f.covariance[i, k, column]
    for k in range(size):
        f.covariance[i, k, k] = f.covariance[i, k, k] + f.fresh2[k]
    along = way * f.slip_walk
    across = way * f.sideslip_walk
    along = along * along / f.step
    across = across * across / f.step
    f.covariance[i, X, X] = f.covariance[i, X, X] + along * c * c + across * s * s
    f.covariance[i, Y, Y] = f.covariance[i, Y, Y] + along * s * s + across * c * c
    f.covariance[i, X, Y] = f.covariance[i, X, Y] + (along - across) * c * s
    f.covariance[i, Y, X] = f.covariance[i, Y, X] + (along - across) * c * s
    f.covariance[i, HEADING, HEADING] = f.covariance[i, HEADING, HEADING] + f.turn2


@wp.func
def remember_reckoned(f: PoseFilterMemory, i: int, row: Reckoned):
    """Put ``row`` before the history."""
    kept = f.history.shape[0]
    for k in range(kept - 1):
        for column in range(5):
            f.history[kept - 1 - k, i, column] = f.history[kept - 2 - k, i, column]
    write_reckoned(f, 0, i, row)


@wp.func
def write_reckoned(f: PoseFilterMemory, k: int, i: int, row: Reckoned):
    """Put ``row`` at ``k`` of the history."""
    f.history[k, i, 0] = row.place[0]
    f.history[k, i, 1] = row.place[1]
    f.history[k, i, 2] = row.heading
    f.history[k, i, 3] = row.roll
    f.history[k, i, 4] = row.pitch


@wp.func
def remember_turning(f: PoseFilterMemory, i: int, rate: wp.vec3d):
    """Keep what :func:`heading_rate` gave."""
    for column in range(3):
        f.turning[i, column] = rate[column]


@wp.func
def reckoned_before(f: PoseFilterMemory, i: int, ago: wp.float64):
    """The history ``ago`` steps, on the straight line between two updates."""
    late = int(wp.floor(ago))
    share = ago - wp.float64(late)
    rest = ONE - share
    out = Reckoned()
    out.place = wp.vec2d(
        rest * f.history[late, i, 0] + share * f.history[late + 1, i, 0],
        rest * f.history[late, i, 1] + share * f.history[late + 1, i, 1],
    )
    out.heading = rest * f.history[late, i, 2] + share * f.history[late + 1, i, 2]
    out.roll = rest * f.history[late, i, 3] + share * f.history[late + 1, i, 3]
    out.pitch = rest * f.history[late, i, 4] + share * f.history[late + 1, i, 4]
    return out


@wp.func
def reckon(f: PoseFilterMemory, i: int, speed: wp.float64, rates: wp.vec3d, roll: wp.float64, pitch: wp.float64):
    """Reckon a step on; gives the way [m] in the plan by the wheels."""
    now = heading_rate(rates, roll, pitch)
    rate = HALF * (wp.vec3d(f.turning[i, 0], f.turning[i, 1], f.turning[i, 2]) + now)
    remember_turning(f, i, now)
    wrong = f.state[i, BIAS] + rate[1] * f.state[i, ROLL_ERROR] + rate[2] * f.state[i, PITCH_ERROR]
    turn = f.step * (rate[0] - wrong)
    before = reckoned_before(f, i, ZERO)
    mean_roll = HALF * (before.roll + roll)
    mean_pitch = HALF * (before.pitch + pitch)
    way = f.step * speed * wp.cos(mean_pitch)
    slips = creep(f, mean_roll, mean_pitch)
    move = wp.vec2d(way * (ONE + f.state[i, SLIP] + slips[0]), way * (f.state[i, SIDESLIP] + slips[1]))
    heading = f.state[i, HEADING] + HALF * turn
    moved = plane_turned(heading, move)
    row = Reckoned()
    row.place = before.place + plane_turned(before.heading + HALF * turn, move)
    row.heading = before.heading + turn
    row.roll = roll
    row.pitch = pitch
    remember_reckoned(f, i, row)
    spread_on(f, i, heading, moved, way, rate)
    size = f.mean.shape[0]
    for k in range(BIAS, size):
        f.state[i, k] = f.mean[k] + f.decay[k] * (f.state[i, k] - f.mean[k])
    f.state[i, X] = f.state[i, X] + moved[0]
    f.state[i, Y] = f.state[i, Y] + moved[1]
    f.state[i, HEADING] = f.state[i, HEADING] + turn
    return way


@wp.func
def take_in(
    f: PoseFilterMemory,
    i: int,
    change: row_of_state,
    slope: row_of_state,
    axis: row_of_state,
    off: wp.float64,
    walk: wp.float64,
    variance: wp.float64,
):
    """Correct the covariance by a measurement that is ``off``, since when ``axis`` walked by a variance ``walk``; gives the
    ``change`` of the state with it."""
    size = f.mean.shape[0]
    shared = -walk * axis
    for r in range(size):
        for k in range(size):
            shared[r] += f.covariance[i, r, k] * slope[k]
    spread = wp.dot(slope, shared - walk * axis) + variance + walk
    for r in range(size):
        for k in range(size):
            f.covariance[i, r, k] = f.covariance[i, r, k] - shared[r] * shared[k] / spread
    return change + ((off - wp.dot(slope, change)) / spread) * shared


@wp.func
def correct(f: PoseFilterMemory, i: int, gps: Solution, place: wp.vec3d, then: Reckoned, way: wp.float64):
    """Correct the estimate by a solution of ``then``, ``way`` [m] before."""
    turn = f.history[0, i, 2] - then.heading
    since = plane_turned(
        -f.history[0, i, 2], wp.vec2d(f.history[0, i, 0] - then.place[0], f.history[0, i, 1] - then.place[1])
    )
    lever = levelled(then.roll, then.pitch, place - f.antenna)
    line = levelled(then.roll, then.pitch, f.line)
    roll_error = f.state[i, ROLL_ERROR]
    pitch_error = f.state[i, PITCH_ERROR]
    arm = lever.value - roll_error * lever.by_roll - pitch_error * lever.by_pitch
    across = line.value - roll_error * line.by_roll - pitch_error * line.by_pitch
    now = f.state[i, HEADING]
    heading = now - turn
    apart = plane_turned(now, since) + plane_turned(heading, arm)
    middle = plane_turned(now - HALF * turn, wp.vec2d(way, ZERO))
    by_roll = plane_turned(heading, lever.by_roll)
    by_pitch = plane_turned(heading, lever.by_pitch)
    drift = int(DRIFT_X)
    if gps.quality == FLOAT:
        drift = int(FLOAT_X)
    since2 = way * way / wp.max(gps.age, f.step)
    middle_heading = now - HALF * turn
    c = wp.cos(middle_heading)
    s = wp.sin(middle_heading)
    off_x = gps.position[0] - (f.state[i, X] - apart[0] + f.state[i, drift])
    off_y = gps.position[1] - (f.state[i, Y] - apart[1] + f.state[i, drift + 1])
    change = row_of_state()
    axis = row_of_state()
    axis[HEADING] = ONE
    slope = row_of_state()
    slope[HEADING] = ONE
    slope[BIAS] = gps.age
    square = wp.dot(across, across)
    slope[ROLL_ERROR] = (across[1] * line.by_roll[0] - across[0] * line.by_roll[1]) / square
    slope[PITCH_ERROR] = (across[1] * line.by_pitch[0] - across[0] * line.by_pitch[1]) / square
    shown = heading + wp.atan2(across[1], across[0]) - f.direction
    off = wrapped(gps.heading - shown)
    change = take_in(f, i, change, slope, axis, off, f.turn2 / f.step * gps.age, f.heading2[int(gps.quality)])
    for side in range(2):  # along, then across
        walk = since2 * f.slip_walk * f.slip_walk
        ux = c
        uy = s
        if side == 1:
            walk = since2 * f.sideslip_walk * f.sideslip_walk
            ux = -s
            uy = c
        axis = row_of_state()
        axis[X] = ux
        axis[Y] = uy
        slope = row_of_state()
        slope[X] = ux
        slope[Y] = uy
        slope[HEADING] = ux * apart[1] - uy * apart[0]
        slope[SLIP] = -(ux * middle[0] + uy * middle[1])
        slope[SIDESLIP] = ux * middle[1] - uy * middle[0]
        slope[drift] = ux
        slope[drift + 1] = uy
        slope[ROLL_ERROR] = ux * by_roll[0] + uy * by_roll[1]
        slope[PITCH_ERROR] = ux * by_pitch[0] + uy * by_pitch[1]
        change = take_in(f, i, change, slope, axis, ux * off_x + uy * off_y, walk, f.position2)
    for k in range(f.mean.shape[0]):
        f.state[i, k] = f.state[i, k] + change[k]


@wp.func
def show_pose(f: PoseFilterMemory, i: int):
    """Give out the pose."""
    f.position[i, 0] = f.state[i, X]
    f.position[i, 1] = f.state[i, Y]
    f.heading[i] = wrapped(f.state[i, HEADING])


@wp.func
def begin_filter(
    f: PoseFilterMemory,
    i: int,
    gps: Solution,
    roll: wp.float64,
    pitch: wp.float64,
    rates: wp.vec3d,
    place: wp.vec3d,
):
    """Begin twin ``i`` anew with its first solution."""
    line = levelled(roll, pitch, f.line)
    lever = levelled(roll, pitch, place - f.antenna)
    heading = gps.heading + f.direction - wp.atan2(line.value[1], line.value[0])
    arm = plane_turned(heading, lever.value)
    size = f.mean.shape[0]
    for r in range(size):
        f.state[i, r] = f.mean[r]
        for k in range(size):
            f.covariance[i, r, k] = ZERO
        f.covariance[i, r, r] = f.spread2[r]
    f.state[i, X] = gps.position[0] + arm[0]
    f.state[i, Y] = gps.position[1] + arm[1]
    f.state[i, HEADING] = heading
    f.covariance[i, X, X] = UNKNOWN_POSITION * UNKNOWN_POSITION
    f.covariance[i, Y, Y] = UNKNOWN_POSITION * UNKNOWN_POSITION
    f.covariance[i, HEADING, HEADING] = UNKNOWN_HEADING * UNKNOWN_HEADING
    here = Reckoned()
    here.roll = roll
    here.pitch = pitch
    for k in range(f.history.shape[0]):
        write_reckoned(f, k, i, here)
    remember_turning(f, i, heading_rate(rates, roll, pitch))
    correct(f, i, gps, place, here, ZERO)
    show_pose(f, i)


@wp.func
def filter_pose(
    f: PoseFilterMemory,
    i: int,
    gps: Solution,
    roll: wp.float64,
    pitch: wp.float64,
    rates: wp.vec3d,
    place: wp.vec3d,
    speed: wp.float64,
):
    """Move the pose of twin ``i`` on by a step, and correct it by a fresh solution."""
    way = reckon(f, i, speed, rates, roll, pitch)
    if gps.fresh:
        last = wp.float64(f.history.shape[0]) - wp.float64(1.001)
        then = reckoned_before(f, i, wp.clamp(gps.age / f.step, ZERO, last))
        correct(f, i, gps, place, then, way / f.step * gps.age)
    show_pose(f, i)
