"""What a vehicle measures, and where it is on its path: the task's sensing and geometry for one vehicle.

Its pose is estimated by constant gains here, and by a Kalman filter in :mod:`aoro_gym.envs.path_tracking.kernels.filtered`.
"""

import warp as wp

from aoro_gym.envs.core.kernels.joint import rest_joint, sense_joint
from aoro_gym.envs.core.kernels.step import StepMemory, begin_step, beginning
from aoro_gym.envs.path_tracking.kernels.geometry import place_at, project
from aoro_gym.envs.path_tracking.kernels.judge import tell
from aoro_gym.envs.path_tracking.kernels.memory import Control, Courses, Driving, Rules, Sensing, Told, Vehicle
from aoro_gym.sensors.kernels.attitude import in_world, wrapped
from aoro_gym.sensors.kernels.gps import gps_shown
from aoro_gym.sensors.kernels.imu import imu_error, imu_moved_on, specific_force
from aoro_gym.sensors.kernels.localisation import begin_at, locate
from aoro_gym.sensors.kernels.pressure import pressure_shown
from aoro_gym.sensors.kernels.wheel_speed import ground_speed, wheel_speed_shown
from aoro_gym.twin.records import Output, State
from aoro_gym.units import GRAVITY

WEIGHT = wp.constant(wp.float64(GRAVITY))
ZERO = wp.constant(wp.float64(0.0))
REGISTERS = 128
"""Registers of a thread that senses, at most: with more a GPU has no room for all of some 65,000 vehicles at once."""


@wp.func
def last(m: StepMemory, channel: int, i: int):
    """An output of a twin at the end of the step."""
    return wp.float64(m.outputs[m.outputs.shape[0] - 1, channel, i])


@wp.func
def three(m: StepMemory, row: int, i: int):
    """Three rows of the state from ``row`` on."""
    return wp.vec3d(wp.float64(m.state[row, i]), wp.float64(m.state[row + 1, i]), wp.float64(m.state[row + 2, i]))


@wp.func
def sense_inertia(m: StepMemory, s: Sensing, i: int, roll: wp.float64, pitch: wp.float64, time: wp.float64):
    """Rates, attitude, and specific force where it is observed."""
    number = imu_moved_on(s.imu, i, time)
    rates = three(m, State.WX, i)
    for axis in range(3):
        s.rates[i, axis] = rates[axis] + imu_error(s.imu, i, axis, number)
    channel = int(3)
    if s.inertial != 0:
        force = specific_force(three(m, State.VX, i), three(m, State.AVX, i), rates, roll, pitch, WEIGHT)
        for axis in range(3):
            s.force[i, axis] = force[axis] + imu_error(s.imu, i, 3 + axis, number)
        channel = 6
    s.roll[i] = roll + imu_error(s.imu, i, channel, number)
    s.pitch[i] = pitch + imu_error(s.imu, i, channel + 1, number)


@wp.func
def sense_wheels(m: StepMemory, s: Sensing, i: int, radius: wp.float64, time: wp.float64):
    """Wheel speeds, and the speed over ground that they tell."""
    for wheel in range(4):
        true = last(m, Output.WHEEL_RATE_FL + wheel, i)
        shown = wheel_speed_shown(s.wheels, i, wheel, true, time)
        s.wheel_rates[i, wheel] = true + s.noise[i] * (shown - true)
    if s.wheels.pulses != 0:
        s.wheels.time[i] = time
    s.speed[i] = ground_speed(
        s.wheel_rates[i, 0], s.wheel_rates[i, 1], s.wheel_rates[i, 2], s.wheel_rates[i, 3], radius
    )


@wp.func
def sense_pressures(m: StepMemory, s: Sensing, i: int, time: wp.float64):
    """Those that a controller reads."""
    for c in range(s.channels.shape[0]):
        true = last(m, s.channels[c], i)
        shown = pressure_shown(s.pressure, c, i, true, time)
        s.pressures[c, i] = true + s.noise[i] * (shown - true)


@wp.func
def hinge_of(m: StepMemory, i: int):
    """Position of the hinge [m]."""
    return wp.vec3d(last(m, Output.POSITION_X, i), last(m, Output.POSITION_Y, i), last(m, Output.POSITION_Z, i))


@wp.func
def sense_all(m: StepMemory, v: Vehicle, s: Sensing, i: int, time: wp.float64):
    """Read every sensor but that of the joint; gives the solution of the GPS."""
    roll = last(m, Output.ROLL, i)
    pitch = last(m, Output.PITCH, i)
    sense_inertia(m, s, i, roll, pitch, time)
    sense_wheels(m, s, i, v.rolling_radius[i], time)
    sense_pressures(m, s, i, time)
    return gps_shown(s.gps, i, hinge_of(m, i), roll, pitch, last(m, Output.YAW, i), time)


@wp.func
def front_axle(v: Vehicle, i: int):
    """Middle of the front axle from the hinge [m]."""
    return wp.vec3d(v.front[i], ZERO, ZERO)


@wp.func
def follow(m: StepMemory, c: Courses, v: Vehicle, s: Sensing, d: Driving, r: Rules, i: int):
    """Where the vehicle is, and where on its path it is and believes to be."""
    hinge = hinge_of(m, i)
    roll = last(m, Output.ROLL, i)
    pitch = last(m, Output.PITCH, i)
    yaw = last(m, Output.YAW, i)
    reference = hinge + in_world(roll, pitch, yaw, front_axle(v, i))
    rear = yaw - last(m, Output.JOINT_ANGLE, i)
    d.reference[i, 0] = reference[0]
    d.reference[i, 1] = reference[1]
    d.rear_axle[i, 0] = hinge[0] - v.rear[i] * wp.cos(rear)
    d.rear_axle[i, 1] = hinge[1] - v.rear[i] * wp.sin(rear)
    path = d.path[i]
    true = project(c, path, reference[0], reference[1], d.s[i], r.reach)
    place = place_at(c, path, true.s)
    d.progress[i] = true.s - d.s[i]
    d.s[i] = true.s
    d.cross_track[i] = true.offset
    d.heading_error[i] = wrapped(yaw - wp.atan2(place.sine, place.cosine))
    x = s.localisation.position[i, 0]
    y = s.localisation.position[i, 1]
    believed = project(c, path, x, y, d.measured_s[i], r.reach)
    place = place_at(c, path, believed.s)
    d.measured_s[i] = believed.s
    d.measured_cross_track[i] = believed.offset
    d.measured_heading_error[i] = wrapped(s.localisation.heading[i] - wp.atan2(place.sine, place.cosine))


@wp.func
def read_sensors(m: StepMemory, v: Vehicle, s: Sensing, d: Driving, i: int, time: wp.float64):
    """Read all sensors at the end of a step; gives the solution of the GPS."""
    d.step[i] = d.step[i] + wp.int64(1)
    sense_joint(m, s.joint, i, time)
    return sense_all(m, v, s, i, time)


@wp.func
def read_at_rest(m: StepMemory, v: Vehicle, s: Sensing, i: int):
    """Read all sensors of a vehicle at rest, for the first time; gives the solution of the GPS."""
    rest_joint(s.joint, i, last(m, Output.JOINT_ANGLE, i))
    return sense_all(m, v, s, i, ZERO)


@wp.func
def begin_to_follow(m: StepMemory, c: Courses, v: Vehicle, s: Sensing, d: Driving, r: Rules, i: int):
    """Where a vehicle at rest is, and where on its path it begins."""
    follow(m, c, v, s, d, r, i)
    d.progress[i] = ZERO
    d.start_s[i] = d.s[i]
    d.mark_s[i] = d.s[i]


@wp.func
def sense_vehicle(m: StepMemory, c: Courses, v: Vehicle, s: Sensing, d: Driving, r: Rules, i: int, time: wp.float64):
    """Read all sensors at the end of a step, and find the vehicle on its path."""
    fix = read_sensors(m, v, s, d, i, time)
    locate(s.localisation, i, fix, s.roll[i], s.pitch[i], front_axle(v, i), s.speed[i], s.rates[i, 2], m.control_step)
    follow(m, c, v, s, d, r, i)


@wp.func
def rest_vehicle(m: StepMemory, c: Courses, v: Vehicle, s: Sensing, d: Driving, r: Rules, i: int):
    """First measurements of a vehicle at rest."""
    fix = read_at_rest(m, v, s, i)
    begin_at(s.localisation, i, fix, s.roll[i], s.pitch[i], front_axle(v, i))
    begin_to_follow(m, c, v, s, d, r, i)


@wp.kernel(enable_backward=False, cuda_max_registers=REGISTERS, module="aoro_gym.envs.path_tracking.kernels")
def sense(m: StepMemory, c: Courses, v: Vehicle, s: Sensing, d: Driving, r: Rules):
    """Read all sensors at the end of the step, and find the vehicles on their paths."""
    i = wp.tid()
    sense_vehicle(m, c, v, s, d, r, i, begin_step(m, i))


@wp.kernel(enable_backward=False, module="aoro_gym.envs.path_tracking.kernels")
def rest(m: StepMemory, c: Courses, k: Control, v: Vehicle, s: Sensing, d: Driving, r: Rules, t: Told):
    """First measurements of the vehicles whose episodes begin, at rest, and what is told of them."""
    i = beginning(m, wp.tid())
    if i >= 0:
        rest_vehicle(m, c, v, s, d, r, i)
        tell(m, k, s, d, t, i)
