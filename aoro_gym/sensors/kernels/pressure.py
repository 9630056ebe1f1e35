"""Pressure sensors: :mod:`aoro_gym.sensors.pressure` for one twin."""

import warp as wp

from aoro_gym.execution.array_api import Arrays
from aoro_gym.sensors.kernels.noise import quantised, tick, white
from aoro_gym.sensors.pressure import PressureSensor


@wp.struct
class PressureMemory:
    """Of C sensors on each of N twins."""

    zero: wp.array2d(dtype=wp.float64)  # (C, N) [Pa]
    seeds: wp.array2d(dtype=wp.int64)  # (C, N)
    white: wp.float64  # [Pa]
    resolution: wp.float64  # [Pa]
    low: wp.float64  # [Pa]
    high: wp.float64  # [Pa]


def pressure_memory(sensor: PressureSensor, arrays: Arrays) -> PressureMemory:
    """The memory of ``sensor``, shared."""
    out, noise = PressureMemory(), sensor.noise
    out.zero, out.seeds = arrays.shared(sensor._zero), arrays.shared(sensor._seeds)
    out.white, out.resolution, out.low, out.high = noise.white, noise.resolution, noise.low, noise.high
    return out


@wp.func
def pressure_shown(s: PressureMemory, c: int, i: int, pressure: wp.float64, time: wp.float64):
    """What sensor ``c`` of twin ``i`` shows of ``pressure`` [Pa] at ``time`` [s]."""
    noisy = pressure + s.zero[c, i] + s.white * white(s.seeds[c, i], tick(time))
    return wp.clamp(quantised(noisy, s.resolution), s.low, s.high)
