"""What the kernels of path tracking know: the memory of a task, shared."""

from typing import Any

import numpy as np
import warp as wp

from aoro_gym.envs.core.kernel_step import shared
from aoro_gym.envs.core.kernels.joint import JointMemory, joint_memory
from aoro_gym.execution.array_api import Arrays
from aoro_gym.sensors.kernels.gps import GpsMemory, gps_memory
from aoro_gym.sensors.kernels.imu import ImuMemory, imu_memory
from aoro_gym.sensors.kernels.localisation import LocalisationMemory, localisation_memory
from aoro_gym.sensors.kernels.pose_filter import PoseFilterMemory, pose_filter_memory
from aoro_gym.sensors.kernels.pressure import PressureMemory, pressure_memory
from aoro_gym.sensors.kernels.wheel_speed import WheelSpeedMemory, wheel_speed_memory
from aoro_gym.sensors.pose_filter import PoseFilter
from aoro_gym.terrains.raster import CELL
from aoro_gym.twin.records import Output


@wp.struct
class Courses:
    """Paths and grounds."""

    spacing: wp.float64  # [m] of the points
    beyond: wp.int64  # points before a path's start
    count: wp.int64  # points a path
    points: wp.array2d(dtype=wp.float64)  # (5, paths x count)
    level: int
    slope: wp.vec2d
    cell: wp.float64  # [m]
    extents: wp.array2d(dtype=wp.float64)  # (grounds, 8)
    shapes: wp.array2d(dtype=wp.int64)  # (grounds, 2)
    heights: wp.array(dtype=wp.float64)  # of the nodes [m]
    known: wp.array(dtype=wp.float64)


@wp.struct
class Vehicle:
    """Measures of the machines, (N,) unless said otherwise."""

    front: wp.array(dtype=wp.float64)
    rear: wp.array(dtype=wp.float64)
    half_track: wp.array(dtype=wp.float64)
    rolling_radius: wp.array(dtype=wp.float64)
    top_speed: wp.array(dtype=wp.float64)
    rod_share: wp.array(dtype=wp.float64)
    arm_length: wp.array(dtype=wp.float64)
    arm_dead_band: wp.array(dtype=wp.float64)
    arm_rest: wp.array2d(dtype=wp.float64)  # (4, N)


@wp.struct
class Sensing:
    """Sensors, and what they last read."""

    joint: JointMemory
    imu: ImuMemory
    wheels: WheelSpeedMemory
    gps: GpsMemory
    localisation: LocalisationMemory  # only the pose is used where it is filtered
    filter: PoseFilterMemory  # where it is
    pressure: PressureMemory
    inertial: int  # whether the specific force is observed
    noise: wp.array(dtype=wp.float64)  # (N,) of wheels and pressures
    channels: wp.array(dtype=int)  # of the pressures
    roll: wp.array(dtype=wp.float64)
    pitch: wp.array(dtype=wp.float64)
    rates: wp.array2d(dtype=wp.float64)  # (N, 3)
    force: wp.array2d(dtype=wp.float64)  # (N, 3)
    wheel_rates: wp.array2d(dtype=wp.float64)  # (N, 4)
    speed: wp.array(dtype=wp.float64)
    pressures: wp.array2d(dtype=wp.float64)  # (P, N)


@wp.struct
class Driving:
    """Where the vehicles are in their episodes, (N,) unless said otherwise; as the fields of the task."""

    course: wp.array(dtype=wp.int64)
    path: wp.array(dtype=wp.int64)
    path_number: wp.array(dtype=wp.int64)
    length: wp.array(dtype=wp.float64)
    steps_allowed: wp.array(dtype=wp.int64)
    step: wp.array(dtype=wp.int64)
    s: wp.array(dtype=wp.float64)
    start_s: wp.array(dtype=wp.float64)
    progress: wp.array(dtype=wp.float64)
    reference: wp.array2d(dtype=wp.float64)  # (N, 2)
    rear_axle: wp.array2d(dtype=wp.float64)  # (N, 2)
    cross_track: wp.array(dtype=wp.float64)
    heading_error: wp.array(dtype=wp.float64)
    tipping_margin: wp.array(dtype=wp.float64)
    power: wp.array(dtype=wp.float64)
    work: wp.array(dtype=wp.float64)
    squares: wp.array(dtype=wp.float64)
    mark_s: wp.array(dtype=wp.float64)
    mark_step: wp.array(dtype=wp.int64)
    ending: wp.array(dtype=wp.int64)
    measured_s: wp.array(dtype=wp.float64)
    measured_cross_track: wp.array(dtype=wp.float64)
    measured_heading_error: wp.array(dtype=wp.float64)
    actions: wp.array3d(dtype=float)  # (M, N, A) newest first


DRIVING = tuple(Driving.vars)
"""Fields of the task that :class:`Driving` shares, by their names less the underscore."""


@wp.struct
class Rules:
    """How episodes end, and what is seen of them."""

    reach: wp.int64  # points around the last projection
    working_speed: wp.float64  # [m/s]
    end_tolerance: wp.float64  # [m]
    path_limit: wp.float64  # [m]
    upright: float  # cosine of the largest tilt
    chassis_force_limit: float  # [N]
    stuck_distance: wp.float64  # [m]
    stuck_time: wp.float64  # [s]
    preview: wp.array(dtype=wp.float64)  # (K,) [m]
    scan: wp.array2d(dtype=wp.float64)  # (G, 2) [m]


@wp.struct
class Told:
    """What is logged beside the reward."""

    floats: wp.array2d(dtype=wp.float64)  # (7, N)
    integers: wp.array2d(dtype=wp.int64)  # (4, N)
    success: wp.array(dtype=wp.bool)  # (N,)


@wp.struct
class Control:
    """Controllers between the action and the machine."""

    arms_column: int  # of the action; -1: not in it
    traction_column: int
    gear_column: int
    automatic: int
    gear: wp.array(dtype=wp.float64)
    held: wp.array(dtype=wp.float64)  # [s]
    share: wp.vec3d  # displacement by gear
    drop: wp.vec2i  # rows of the loop's two pressures
    up_speed: wp.float64
    up_signal: float
    up_pressure: wp.float64
    down_speed: wp.float64
    down_pressure: wp.float64
    hold: wp.float64
    controls_arms: int
    bores: int  # first row of their pressures
    rods: int
    twist: wp.array(dtype=wp.float64)  # [Pa]
    share_gain: wp.float64
    share_band: wp.float64
    share_time: wp.float64
    level_gain: wp.float64
    level_band: wp.float64
    height_gain: wp.float64
    largest: wp.float64
    controls_traction: int
    openings: wp.array2d(dtype=wp.float64)  # (N, 4)
    excess: wp.float64
    slack: wp.float64
    close: wp.float64
    open: wp.float64
    least: wp.float64


def courses_memory(table: Any, height_map: Any, arrays: Arrays) -> Courses:
    """Of the paths in ``table`` and the grounds in ``height_map``."""
    grounds = () if height_map._level else ("extents", "shapes", "heights", "known")
    out = shared(Courses(), height_map, grounds, arrays, "_")
    out.spacing, out.beyond, out.count = table.spacing, table._beyond, table._count
    out.points = arrays.shared(table._points)
    out.level, out.cell = int(height_map._level), CELL
    out.slope = wp.vec2d(*(float(value) for value in arrays.host(height_map._slope)))
    return out


def vehicle_memory(measures: Any, arrays: Arrays) -> Vehicle:
    """Of the machines' ``measures``."""
    public = ("front", "rear", "half_track", "rolling_radius", "top_speed", "rod_share")
    out = shared(Vehicle(), measures, public, arrays)
    return shared(out, measures, ("arm_length", "arm_dead_band", "arm_rest"), arrays, "_")


def sensing_memory(sensors: Any, arrays: Arrays) -> Sensing:
    """Of :class:`aoro_gym.envs.path_tracking.sensing.VehicleSensors`."""
    read = ("roll", "pitch", "rates", "force", "wheel_rates", "speed")
    out = shared(Sensing(), sensors, read, arrays)
    out.joint, out.imu = joint_memory(sensors.joint, arrays), imu_memory(sensors._imu, arrays)
    out.wheels = wheel_speed_memory(sensors._wheel_sensor, arrays)
    out.gps, here = gps_memory(sensors.gps, arrays), sensors.localisation
    if isinstance(here, PoseFilter):
        out.filter = pose_filter_memory(here, arrays)
        out.localisation.position, out.localisation.heading = out.filter.position, out.filter.heading
    else:
        out.localisation = localisation_memory(here, arrays)
    out.pressure = pressure_memory(sensors._pressure_sensor, arrays)
    out.inertial = int(sensors._config.observe_inertial)
    out.noise, out.pressures = arrays.shared(sensors._noise), arrays.shared(sensors._pressures)
    rows = [int(Output[channel.upper()]) for channel in sensors._pressure_rows]
    out.channels = wp.array(np.array(rows, dtype=np.int32), dtype=int, device=str(arrays.device))
    return out
