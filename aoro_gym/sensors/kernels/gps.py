"""RTK-GPS with two antennas: :mod:`aoro_gym.sensors.gps` for one twin."""

import numpy as np
import warp as wp

from aoro_gym.execution.array_api import Arrays
from aoro_gym.sensors import gps as sensors
from aoro_gym.sensors.gps import Gps
from aoro_gym.sensors.kernels.attitude import in_world, wrapped
from aoro_gym.sensors.kernels.noise import DriftMemory, drift_memory, drifted, uniform, white

NONE = wp.constant(wp.int64(sensors.NONE))
FLOAT = wp.constant(wp.int64(sensors.FLOAT))
FIXED = wp.constant(wp.int64(sensors.FIXED))
RATE = wp.constant(wp.float64(sensors.RATE))
ZERO = wp.constant(wp.float64(0.0))
ONE = wp.constant(wp.float64(1.0))


@wp.struct
class GpsMemory:
    """Of N receivers."""

    main: wp.vec3d  # [m]
    auxiliary: wp.vec3d  # [m]
    direction: wp.float64  # [rad]
    latency: wp.float64  # [s]
    white: wp.vec3d  # [m]
    relative: wp.vec3d  # [m] by quality
    durations: wp.vec3d  # [s] by quality
    loses: int
    none_share: wp.float64
    drift: DriftMemory
    float_drift: DriftMemory
    scale: wp.array(dtype=wp.float64)
    past: wp.array4d(dtype=wp.float64)  # (kept, N, 2, 3) [m] newest first
    instants: wp.array2d(dtype=wp.float64)  # (kept, N) [s]
    seeds: wp.array2d(dtype=wp.int64)  # (7, N)
    phase: wp.array(dtype=wp.float64)
    number: wp.array(dtype=wp.int64)
    fresh: wp.array(dtype=wp.bool)
    state: wp.array(dtype=wp.int64)
    position: wp.array2d(dtype=wp.float64)  # (N, 3)
    heading: wp.array(dtype=wp.float64)
    instant: wp.array(dtype=wp.float64)


@wp.struct
class Solution:
    """The newest one of a receiver."""

    position: wp.vec3d  # [m]
    heading: wp.float64  # [rad]
    quality: wp.int64
    age: wp.float64  # [s]
    fresh: bool


def gps_memory(gps: Gps, arrays: Arrays) -> GpsMemory:
    """The memory of ``gps``, shared."""
    out = GpsMemory()
    out.main, out.auxiliary = wp.vec3d(*gps.antennas.main), wp.vec3d(*gps.antennas.auxiliary)
    out.direction, out.latency = gps.antennas.direction, gps.latency
    for name in ("white", "relative", "durations"):
        values = np.ravel(arrays.host(getattr(gps, f"_{name}")))
        setattr(out, name, wp.vec3d(*(float(value) for value in values)))
    out.loses, out.none_share = int(gps._loses), gps.noise.loss.none_share
    out.drift, out.float_drift = drift_memory(gps._drift, arrays), drift_memory(gps._float_drift, arrays)
    out.scale = arrays.shared(gps.scale)
    for name in (
        "past", "instants", "seeds", "phase", "number", "fresh", "state", "position", "heading", "instant",
    ):  # fmt: skip
        setattr(out, name, arrays.shared(getattr(gps, f"_{name}")))
    return out


@wp.func
def remember(
    g: GpsMemory, i: int, origin: wp.vec3d, roll: wp.float64, pitch: wp.float64, yaw: wp.float64, now: wp.float64
):
    """Where the antennas are; after a reset they were there until now."""
    main = origin + in_world(roll, pitch, yaw, g.main)
    auxiliary = origin + in_world(roll, pitch, yaw, g.auxiliary)
    kept = g.instants.shape[0]
    fresh = g.fresh[i]
    for k in range(kept):
        row = kept - 1 - k
        if row == 0 or fresh:
            for axis in range(3):
                g.past[row, i, 0, axis] = main[axis]
                g.past[row, i, 1, axis] = auxiliary[axis]
            g.instants[row, i] = now
        else:
            for axis in range(3):
                g.past[row, i, 0, axis] = g.past[row - 1, i, 0, axis]
                g.past[row, i, 1, axis] = g.past[row - 1, i, 1, axis]
            g.instants[row, i] = g.instants[row - 1, i]
    g.fresh[i] = False


@wp.func
def next_state(g: GpsMemory, i: int, number: wp.int64):
    """Quality of the solution ``number``; of one that was there before, as it was."""
    state = g.state[i]
    if g.loses == 0:
        return state
    change = uniform(g.seeds[5, i], number)
    kind = uniform(g.seeds[6, i], number)
    passed = number - wp.max(g.number[i], wp.int64(0))
    share = ONE - wp.exp(-wp.float64(passed) / (RATE * g.durations[int(state)]))
    if change < share:
        if state != FIXED:
            return FIXED
        if kind < g.none_share:
            return NONE
        return FLOAT
    return state


@wp.func
def antennas_at(g: GpsMemory, i: int, antenna: int, instant: wp.float64):
    """Place [m] of an antenna at ``instant`` [s], on the straight line between the two calls around it."""
    kept = g.instants.shape[0]
    later = int(0)
    for k in range(kept):
        if g.instants[k, i] > instant:
            later += 1
    after = wp.clamp(later - 1, 0, kept - 2)
    late = g.instants[after, i]
    early = g.instants[after + 1, i]
    share = wp.clamp((late - instant) / wp.where(late > early, late - early, ONE), ZERO, ONE)
    place = wp.vec3d(g.past[after, i, antenna, 0], g.past[after, i, antenna, 1], g.past[after, i, antenna, 2])
    before = wp.vec3d(
        g.past[after + 1, i, antenna, 0], g.past[after + 1, i, antenna, 1], g.past[after + 1, i, antenna, 2]
    )
    return place + share * (before - place)


@wp.func
def solve(g: GpsMemory, i: int, number: wp.int64, instant: wp.float64, state: wp.int64):
    """A new solution of quality ``state``, into the memory."""
    main = antennas_at(g, i, 0, instant)
    auxiliary = antennas_at(g, i, 1, instant)
    scale = g.scale[i]
    for axis in range(3):
        drift = g.drift.value[axis, i]
        if g.loses != 0 and state != FIXED:
            drift = g.float_drift.value[axis, i]
        error = drift + g.white[axis] * white(g.seeds[axis, i], number)
        g.position[i, axis] = main[axis] + scale * error
    relative = scale * g.relative[int(state)]
    x = auxiliary[0] - main[0] + relative * white(g.seeds[3, i], number)
    y = auxiliary[1] - main[1] + relative * white(g.seeds[4, i], number)
    g.heading[i] = wrapped(wp.atan2(y, x) - g.direction)
    g.instant[i] = wp.max(instant, ZERO)


@wp.func
def gps_shown(
    g: GpsMemory, i: int, origin: wp.vec3d, roll: wp.float64, pitch: wp.float64, yaw: wp.float64, now: wp.float64
):
    """What receiver ``i`` shows ``now`` [s] of its true pose."""
    remember(g, i, origin, roll, pitch, yaw, now)
    number = wp.int64(wp.floor((now - g.latency) * RATE - g.phase[i] + wp.float64(1e-9))) + wp.int64(1)
    number = wp.max(number, wp.int64(0))
    state = next_state(g, i, number)
    fresh = number > g.number[i] and state != NONE
    drifted(g.drift, i, number)
    if g.loses != 0:
        drifted(g.float_drift, i, number)
    g.number[i] = number
    g.state[i] = state
    if fresh:
        solve(g, i, number, (wp.float64(number - wp.int64(1)) + g.phase[i]) / RATE, state)
    out = Solution()
    out.position = wp.vec3d(g.position[i, 0], g.position[i, 1], g.position[i, 2])
    out.heading = g.heading[i]
    out.quality = state
    out.age = now - g.instant[i]
    out.fresh = fresh
    return out
