"""What the kernels of levelling know besides those of path tracking: the memory of a task, shared."""

from typing import Any

import warp as wp

from aoro_gym.envs.core.kernel_step import shared
from aoro_gym.envs.levelling.driving import PathDriver
from aoro_gym.execution.array_api import Arrays
from aoro_gym.sensors.kernels.joint_angle import JointAngleMemory, joint_angle_memory
from aoro_gym.sensors.kernels.pressure import PressureMemory, pressure_memory


@wp.struct
class Driver:
    """The law of :class:`aoro_gym.envs.levelling.driving.PathDriver`, field by field."""

    drive_signal: float
    heading_gain: wp.float64
    cross_track_gain: wp.float64  # [1/s]
    look_ahead: wp.float64  # [m]
    gain: wp.float64  # [1/rad]
    lead_time: wp.float64  # [s]
    rest_error: wp.float64  # [rad]
    dead_band_left: wp.float64
    dead_band_right: wp.float64


@wp.struct
class Arms:
    """Sensors at the arms, and what they last read."""

    angle: JointAngleMemory  # of 4 N sensors, those of a machine side by side
    pressure: PressureMemory  # four bores, four rods, the pump
    noise: wp.array(dtype=wp.float64)  # (N,)
    angles: wp.array2d(dtype=wp.float64)  # (4, N) [rad]
    rates: wp.array2d(dtype=wp.float64)  # (4, N) [rad/s]
    pressures: wp.array2d(dtype=wp.float64)  # (9, N) [Pa]


@wp.struct
class Ground:
    """Maps of the ground in both tracks."""

    spread: wp.float64  # [m] of each height
    places: wp.array2d(dtype=wp.float64)  # (2 K, 2) [m] ahead, side
    noise: wp.array(dtype=wp.float64)  # (N,)
    offset: wp.array2d(dtype=wp.float64)  # (N, 2) [m]
    seeds: wp.array2d(dtype=wp.int64)  # (2 K, N)
    heights: wp.array2d(dtype=wp.float64)  # (N, 2 K) [m]


@wp.struct
class Frames:
    """Arms, loads and tilt of the machines, (N,) unless said otherwise; as the fields of the task."""

    signals: wp.array3d(dtype=float)  # (M, N, 4) newest first
    arm_length: wp.array(dtype=wp.float64)
    largest_angle: wp.array(dtype=wp.float64)
    rest_angles: wp.array2d(dtype=wp.float64)  # (4, N)
    rest_share: wp.array2d(dtype=wp.float64)  # (4, N)
    weight: wp.array(dtype=wp.float64)
    loads: wp.array2d(dtype=wp.float64)  # (4, N)
    power: wp.array(dtype=wp.float64)
    unevenness: wp.array(dtype=wp.float64)
    tilt: wp.array(dtype=wp.float64)
    work: wp.array(dtype=wp.float64)
    travel: wp.array(dtype=wp.float64)
    lifted: wp.array(dtype=wp.float64)
    tilt_squares: wp.array(dtype=wp.float64)
    load_squares: wp.array(dtype=wp.float64)


FRAMES = tuple(Frames.vars)
"""Fields of the task that :class:`Frames` shares, by their names less the underscore."""


@wp.struct
class Limits:
    """With what an episode may succeed."""

    tilt: wp.float64  # [rad]
    unevenness: wp.float64


def driver_memory(driver: PathDriver) -> Driver:
    """Of ``driver``."""
    out = Driver()
    for name in Driver.vars:
        setattr(out, name, getattr(driver, name))
    return out


def arms_memory(sensors: Any, arrays: Arrays) -> Arms:
    """Of :class:`aoro_gym.envs.levelling.sensing.ArmSensors`."""
    out = shared(Arms(), sensors, ("angles", "rates"), arrays)
    out.angle = joint_angle_memory(sensors._angle_sensor, arrays)
    out.pressure = pressure_memory(sensors._pressure_sensor, arrays)
    return shared(out, sensors, ("noise", "pressures"), arrays, "_")


def ground_memory(ground: Any, spread: float, arrays: Arrays) -> Ground:
    """Of :class:`aoro_gym.envs.levelling.sensing.GroundMap`, whose heights err by ``spread`` [m]."""
    out = shared(Ground(), ground, ("places", "noise", "offset", "seeds"), arrays, "_")
    out.spread, out.heights = spread, arrays.shared(ground.heights)
    return out
