"""The inertial unit: :mod:`aoro_gym.sensors.imu` for one twin."""

import warp as wp

from aoro_gym.execution.array_api import Arrays
from aoro_gym.sensors.imu import Imu
from aoro_gym.sensors.kernels.noise import DriftMemory, constants, drift_memory, drifted, tick, white


@wp.struct
class ImuMemory:
    """Of N units; channels C: three rates, three forces where they are shown, roll and pitch."""

    drift: DriftMemory
    white: wp.array(dtype=wp.float64)  # (C,)
    seeds: wp.array2d(dtype=wp.int64)  # (C, N)
    scale: wp.array(dtype=wp.float64)  # (N,)


def imu_memory(imu: Imu, arrays: Arrays) -> ImuMemory:
    """The memory of ``imu``, shared."""
    out = ImuMemory()
    out.drift = drift_memory(imu._drift, arrays)
    out.white = constants(arrays, arrays.host(imu._white))
    out.seeds, out.scale = arrays.shared(imu._seeds), arrays.shared(imu.scale)
    return out


@wp.func
def imu_moved_on(u: ImuMemory, i: int, time: wp.float64):
    """Move the errors of unit ``i`` on to ``time`` [s]; gives the number of its sample."""
    number = tick(time)
    drifted(u.drift, i, number)
    return number


@wp.func
def imu_error(u: ImuMemory, i: int, channel: int, number: wp.int64):
    """Error of a channel in the sample ``number``."""
    return u.scale[i] * (u.drift.value[channel, i] + u.white[channel] * white(u.seeds[channel, i], number))


@wp.func
def specific_force(
    velocity: wp.vec3d,
    acceleration: wp.vec3d,
    rates: wp.vec3d,
    roll: wp.float64,
    pitch: wp.float64,
    gravity: wp.float64,
):
    """Specific force [m/s²] at the front frame's origin, in its axes."""
    vertical = wp.vec3d(-wp.sin(pitch), wp.sin(roll) * wp.cos(pitch), wp.cos(roll) * wp.cos(pitch))
    return acceleration + wp.cross(rates, velocity) + gravity * vertical
