"""What a vehicle measures besides what drives it: its arms, and the ground in its tracks."""

import warp as wp

from aoro_gym.envs.core.kernels.step import StepMemory, begin_step, beginning
from aoro_gym.envs.levelling.kernels.judge import tell
from aoro_gym.envs.levelling.kernels.memory import Arms, Frames, Ground, Limits
from aoro_gym.envs.path_tracking.kernels.geometry import height_at
from aoro_gym.envs.path_tracking.kernels.judge import tell as tell_of_drive
from aoro_gym.envs.path_tracking.kernels.memory import Control, Courses, Driving, Rules, Sensing, Told, Vehicle
from aoro_gym.envs.path_tracking.kernels.sense import last, rest_vehicle, sense_vehicle
from aoro_gym.sensors.kernels.joint_angle import joint_angle_shown
from aoro_gym.sensors.kernels.noise import tick, white
from aoro_gym.sensors.kernels.pressure import pressure_shown
from aoro_gym.twin.records import Output

ZERO = wp.constant(wp.float64(0.0))


@wp.func
def sense_pressure(m: StepMemory, a: Arms, i: int, sensor: int, channel: int, time: wp.float64):
    """Read the sensor of a channel."""
    true = last(m, channel, i)
    a.pressures[sensor, i] = true + a.noise[i] * (pressure_shown(a.pressure, sensor, i, true, time) - true)


@wp.func
def sense_arms(m: StepMemory, a: Arms, i: int, time: wp.float64):
    """Read angles and pressures; rates are what the angles have changed by."""
    for wheel in range(4):
        true = last(m, Output.ARM_ANGLE_FL + wheel, i)
        shown = true + a.noise[i] * (joint_angle_shown(a.angle, 4 * i + wheel, true, time) - true)
        a.rates[wheel, i] = (shown - a.angles[wheel, i]) / m.control_step
        a.angles[wheel, i] = shown
    for sensor in range(8):  # bores, then rods
        sense_pressure(m, a, i, sensor, Output.ARM_PRESSURE_BORE_FL + sensor, time)
    sense_pressure(m, a, i, 8, Output.PUMP_PRESSURE, time)


@wp.func
def read_ground(m: StepMemory, c: Courses, v: Vehicle, d: Driving, g: Ground, i: int, time: wp.float64):
    """Heights in both tracks over their mean."""
    x = last(m, Output.POSITION_X, i)
    y = last(m, Output.POSITION_Y, i)
    yaw = last(m, Output.YAW, i)
    sine = wp.sin(yaw)
    cosine = wp.cos(yaw)
    error = g.spread * g.noise[i]
    total = wp.float64(0.0)
    places = g.places.shape[0]
    for k in range(places):
        ahead = g.places[k, 0] + g.offset[i, 0]
        left = g.places[k, 1] * v.half_track[i] + g.offset[i, 1]
        height = height_at(c, d.course[i], x + cosine * ahead - sine * left, y + sine * ahead + cosine * left)
        if g.spread > ZERO:
            height += error * white(g.seeds[k, i], tick(time))
        g.heights[i, k] = height
        total += height
    mean = total / wp.float64(places)
    for k in range(places):
        g.heights[i, k] = g.heights[i, k] - mean


@wp.kernel(enable_backward=False, module="aoro_gym.envs.levelling.kernels")
def sense(m: StepMemory, c: Courses, v: Vehicle, s: Sensing, d: Driving, r: Rules, a: Arms, g: Ground):
    """Read all sensors at the end of the step, and find the vehicles on their paths."""
    i = wp.tid()
    time = begin_step(m, i)
    sense_vehicle(m, c, v, s, d, r, i, time)
    sense_arms(m, a, i, time)
    read_ground(m, c, v, d, g, i, time)


@wp.kernel(enable_backward=False, module="aoro_gym.envs.levelling.kernels")
def rest(
    m: StepMemory,
    c: Courses,
    k: Control,
    v: Vehicle,
    s: Sensing,
    d: Driving,
    r: Rules,
    a: Arms,
    g: Ground,
    t: Told,
    f: Frames,
    u: Limits,
    frames: wp.array2d(dtype=wp.float64),
):
    """First measurements of the vehicles whose episodes begin, at rest, and what is told of them."""
    i = beginning(m, wp.tid())
    if i < 0:
        return
    rest_vehicle(m, c, v, s, d, r, i)
    sense_arms(m, a, i, ZERO)
    for wheel in range(4):
        a.rates[wheel, i] = ZERO
    read_ground(m, c, v, d, g, i, ZERO)
    tell_of_drive(m, k, s, d, t, i)
    tell(d, f, u, t, frames, i)
