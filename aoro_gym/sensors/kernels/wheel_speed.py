"""Speed sensors in the wheel motors: :mod:`aoro_gym.sensors.wheel_speed` for one wheel."""

import math

import warp as wp

from aoro_gym.execution.array_api import Arrays
from aoro_gym.sensors.kernels.noise import quantised, white
from aoro_gym.sensors.wheel_speed import WheelSpeedSensor

ZERO = wp.constant(wp.float64(0.0))
HALF = wp.constant(wp.float64(0.5))
ONE = wp.constant(wp.float64(1.0))
SHORTEST = wp.constant(wp.float64(1e-9))
"""[s] that two pulses are apart at least."""
TAU = wp.constant(wp.float64(2.0 * math.pi))


@wp.struct
class WheelSpeedMemory:
    """Of four sensors on each of N twins, arrays (N, 4) unless said otherwise."""

    pulses: int
    tooth_error: wp.float64
    timer: wp.float64  # [s]
    standstill: wp.float64  # [s]
    seeds: wp.array2d(dtype=wp.int64)
    turned: wp.array2d(dtype=wp.float64)  # [pitches]
    rate: wp.array2d(dtype=wp.float64)  # [rad/s]
    time: wp.array(dtype=wp.float64)  # (N,) [s]
    edge: wp.array2d(dtype=wp.float64)  # [pitches]
    edge_time: wp.array2d(dtype=wp.float64)  # [s]
    shown: wp.array2d(dtype=wp.float64)  # [rad/s]


def wheel_speed_memory(sensor: WheelSpeedSensor, arrays: Arrays) -> WheelSpeedMemory:
    """The memory of ``sensor``, shared."""
    out = WheelSpeedMemory()
    for name in ("pulses", "tooth_error", "timer", "standstill"):
        setattr(out, name, getattr(sensor.noise, name))
    for name in ("seeds", "turned", "rate", "time", "edge", "edge_time", "shown"):
        setattr(out, name, arrays.shared(getattr(sensor, f"_{name}")))
    return out


@wp.func
def wheel_speed_shown(s: WheelSpeedMemory, i: int, wheel: int, rate: wp.float64, now: wp.float64):
    """What the sensor of a wheel of twin ``i`` shows of ``rate`` [rad/s] at ``now`` [s]; ``s.time`` is moved on after all
    four."""
    if s.pulses == 0:
        return rate
    began = s.time[i]
    step = now - began
    pitch = TAU / wp.float64(s.pulses)
    before = s.turned[i, wheel]
    after = before + HALF * (s.rate[i, wheel] + rate) * step / pitch
    moved = after - before
    forward = moved > ZERO
    tooth = wp.where(forward, wp.floor(after), wp.ceil(after))
    passed = wp.where(forward, tooth > before, tooth < before)
    edge = s.edge[i, wheel]
    edge_time = s.edge_time[i, wheel]
    shown = s.shown[i, wheel]
    if passed:
        instant = quantised(began + (tooth - before) / moved * step, s.timer)
        number = wp.int64(tooth) % wp.int64(s.pulses)
        if number < wp.int64(0):
            number += wp.int64(s.pulses)
        place = tooth + s.tooth_error * white(s.seeds[i, wheel], number)
        if wp.isfinite(edge):
            shown = (place - edge) * pitch / wp.max(instant - edge_time, wp.max(s.timer, SHORTEST))
        edge_time = instant
        s.edge[i, wheel] = place
        s.edge_time[i, wheel] = edge_time
    waited = now - edge_time
    fastest = wp.where(waited < s.standstill, pitch / wp.max(waited, SHORTEST), ZERO)
    shown = wp.clamp(shown, -fastest, fastest)
    s.turned[i, wheel] = after
    s.rate[i, wheel] = rate
    s.shown[i, wheel] = shown
    return shown


@wp.func
def ground_speed(a: wp.float64, b: wp.float64, c: wp.float64, d: wp.float64, radius: wp.float64):
    """Speed over ground [m/s]: the mean of the two middle ones of four wheels [rad/s], times the rolling radius [m]."""
    low = wp.max(wp.min(a, b), wp.min(c, d))
    high = wp.min(wp.max(a, b), wp.max(c, d))
    return radius * HALF * (wp.min(low, high) + wp.max(low, high))
