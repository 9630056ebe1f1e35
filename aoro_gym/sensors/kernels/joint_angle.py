"""The joint's rotary sensor: :mod:`aoro_gym.sensors.joint_angle` for one twin, without delay and low-pass."""

import math

import numpy as np
import warp as wp

from aoro_gym.execution.array_api import Arrays
from aoro_gym.sensors.joint_angle import JointAngleSensor
from aoro_gym.sensors.kernels.noise import constants, quantised, tick, white

TAU = wp.constant(wp.float64(2.0 * math.pi))


@wp.struct
class JointAngleMemory:
    """Of N sensors with L lines."""

    amplitude: wp.array(dtype=wp.float64)  # (L,) [rad]
    frequency: wp.array2d(dtype=wp.float64)  # (L, N) [Hz]
    phase: wp.array2d(dtype=wp.float64)  # (L, N) [rad]
    seeds: wp.array(dtype=wp.int64)  # (N,)
    gain: wp.array(dtype=wp.float64)  # (N,)
    white: wp.float64  # [rad]
    resolution: wp.float64  # [rad]


def joint_angle_memory(sensor: JointAngleSensor, arrays: Arrays) -> JointAngleMemory:
    """The memory of ``sensor``, shared; ValueError where it has a delay or a low-pass, which this module lacks."""
    if np.any(sensor.delay) or sensor.cutoff is not None:
        raise ValueError("the sensor has a delay or a low-pass, which kernels don't know; measure with its class")
    out = JointAngleMemory()
    out.amplitude = constants(arrays, [line.amplitude for line in sensor.noise.lines])
    out.frequency, out.phase = arrays.shared(sensor._draw.frequency), arrays.shared(sensor._draw.phase)
    out.seeds, out.gain = arrays.shared(sensor._draw.seeds), arrays.shared(sensor._own_gain)
    out.white, out.resolution = sensor.noise.white, sensor.noise.resolution
    return out


@wp.func
def joint_angle_shown(s: JointAngleMemory, i: int, angle: wp.float64, time: wp.float64):
    """What the sensor of twin ``i`` shows of ``angle`` [rad] at ``time`` [s] since its reset."""
    error = wp.float64(0.0)
    for line in range(s.amplitude.shape[0]):
        error += s.amplitude[line] * wp.sin(TAU * s.frequency[line, i] * time + s.phase[line, i])
    if s.white > wp.float64(0.0):
        error += s.white * white(s.seeds[i], tick(time))
    return quantised(s.gain[i] * angle + error, s.resolution)
