"""From an action to commands: :meth:`aoro_gym.envs.path_tracking.task.PathTracking.commands` for one vehicle."""

import warp as wp

from aoro_gym.envs.core.kernels.step import StepMemory, taken_action
from aoro_gym.envs.path_tracking.kernels.memory import Control, Driving, Sensing, Vehicle
from aoro_gym.twin.records import Command, Output

ZERO = wp.constant(wp.float64(0.0))
ONE = wp.constant(wp.float64(1.0))
THIRD = wp.constant(1.0 / 3.0)


@wp.func
def shifted_gear(
    k: Control, i: int, drive: float, speed: wp.float64, pressure: wp.float64, top: wp.float64, step: wp.float64
):
    """The gear for the next ``step`` [s]; see :class:`aoro_gym.envs.path_tracking.assistance.AutomaticGear`."""
    held = k.held[i] + step
    gear = k.gear[i]
    index = int(gear) - 1
    above = wp.min(index + 1, 2)
    below = wp.max(index - 1, 0)
    rises = (
        index < 2
        and speed > k.up_speed * top / k.share[index]
        and wp.abs(drive) >= k.up_signal
        and pressure * k.share[index] / k.share[above] < k.up_pressure
    )
    slow = speed < k.down_speed * top / k.share[below]
    falls = index > 0 and (slow or pressure > k.down_pressure)
    if held >= k.hold and (falls or rises):
        held = wp.float64(0.0)
        if falls:
            gear = gear - ONE
        else:
            gear = gear + ONE
    k.held[i] = held
    k.gear[i] = gear
    return gear


@wp.func
def beyond(value: wp.float64, band: wp.float64):
    """What of ``value`` lies outside of ±``band``."""
    return value - wp.clamp(value, -band, band)


@wp.func
def arm_pressure(k: Control, s: Sensing, v: Vehicle, i: int, wheel: int):
    """What an arm's cylinder bears [Pa]."""
    return s.pressures[k.bores + wheel, i] - v.rod_share[i] * s.pressures[k.rods + wheel, i]


@wp.func
def arm_angle(m: StepMemory, wheel: int, i: int):
    """The angle of an arm [rad] at the end of the last step."""
    return wp.float64(m.outputs[m.outputs.shape[0] - 1, Output.ARM_ANGLE_FL + wheel, i])


@wp.func
def move_arms(m: StepMemory, k: Control, s: Sensing, v: Vehicle, i: int):
    """Command the arms; see :class:`aoro_gym.envs.path_tracking.assistance.ArmController`."""
    borne = wp.vec4d(
        arm_pressure(k, s, v, i, 0),
        arm_pressure(k, s, v, i, 1),
        arm_pressure(k, s, v, i, 2),
        arm_pressure(k, s, v, i, 3),
    )
    twist = wp.float64(0.25) * (borne[0] - borne[1] - borne[2] + borne[3])
    twist = k.twist[i] + m.control_step / (m.control_step + k.share_time) * (twist - k.twist[i])
    k.twist[i] = twist
    sunk = wp.float64(0.0)
    for wheel in range(4):
        sunk += v.arm_length[i] * (arm_angle(m, wheel, i) - v.arm_rest[wheel, i])
    # of the corners in the front frame's axes; the rear frame is turned by −θ against it
    sine = wp.sin(s.joint.angles[0, i])
    cosine = wp.cos(s.joint.angles[0, i])
    track = v.half_track[i]
    rear = v.rear[i]
    x = wp.vec4d(v.front[i], v.front[i], track * sine - rear * cosine, -track * sine - rear * cosine)
    y = wp.vec4d(track, -track, rear * sine + track * cosine, rear * sine - track * cosine)
    signs = wp.vec4d(ONE, -ONE, -ONE, ONE)
    for wheel in range(4):
        demand = -signs[wheel] * k.share_gain * beyond(twist, k.share_band)
        demand = demand + k.height_gain * wp.float64(0.25) * sunk
        if k.level_gain > ZERO:
            low = x[wheel] * wp.sin(s.pitch[i]) - y[wheel] * wp.sin(s.roll[i])
            demand = demand + k.level_gain * beyond(low, k.level_band)
        demand = wp.clamp(demand, -ONE, ONE)
        size = wp.abs(demand)
        signal = wp.float64(0.0)
        if size > wp.float64(0.02):
            signal = wp.sign(demand) * (v.arm_dead_band[i] + (ONE - v.arm_dead_band[i]) * size)
        m.commands[Command.ARM_FL + wheel, i] = float(wp.clamp(signal, -k.largest, k.largest))


@wp.func
def open_valves(m: StepMemory, k: Control, s: Sensing, i: int):
    """Command the traction valves; see :class:`aoro_gym.envs.path_tracking.assistance.TractionControl`."""
    total = wp.float64(0.0)
    for wheel in range(4):
        total += wp.abs(s.wheel_rates[i, wheel])
    for wheel in range(4):
        turning = wp.abs(s.wheel_rates[i, wheel])
        opening = k.openings[i, wheel]
        if turning > k.excess * (total - turning) / wp.float64(3.0) + k.slack:
            opening = opening - m.control_step * k.close
        else:
            opening = opening + m.control_step * k.open
        opening = wp.clamp(opening, k.least, ONE)
        k.openings[i, wheel] = opening
        m.commands[Command.TRACTION_FL + wheel, i] = float(opening)


@wp.func
def make_room(d: Driving, i: int):
    """Let the actions there are become older by a step."""
    memory = d.actions.shape[0]
    for column in range(d.actions.shape[2]):
        for age in range(memory - 1):
            d.actions[memory - 1 - age, i, column] = d.actions[memory - 2 - age, i, column]


@wp.func
def command(m: StepMemory, k: Control, s: Sensing, v: Vehicle, d: Driving, i: int):
    """Command the twin by the newest action."""
    drive = d.actions[0, i, 1]
    m.commands[Command.STEERING_SIGNAL, i] = d.actions[0, i, 0]
    m.commands[Command.DRIVE_SIGNAL, i] = drive
    gear = k.gear[i]
    if k.gear_column >= 0:
        part = d.actions[0, i, k.gear_column]
        gear = wp.float64(1.0)
        if part >= -THIRD:
            gear += ONE
        if part >= THIRD:
            gear += ONE
        k.gear[i] = gear
    elif k.automatic != 0:
        drop = wp.abs(s.pressures[k.drop[0], i] - s.pressures[k.drop[1], i])
        gear = shifted_gear(k, i, drive, wp.abs(s.speed[i]), drop, v.top_speed[i], m.control_step)
    m.commands[Command.GEAR, i] = float(gear)
    if k.arms_column >= 0:
        for wheel in range(4):
            m.commands[Command.ARM_FL + wheel, i] = d.actions[0, i, k.arms_column + wheel]
    elif k.controls_arms != 0:
        move_arms(m, k, s, v, i)
    if k.traction_column >= 0:
        for wheel in range(4):
            opening = wp.min(1.0 + d.actions[0, i, k.traction_column + wheel], 1.0)
            m.commands[Command.TRACTION_FL + wheel, i] = opening
    elif k.controls_traction != 0:
        open_valves(m, k, s, i)


@wp.kernel(enable_backward=False, module="aoro_gym.envs.path_tracking.kernels")
def act(m: StepMemory, k: Control, s: Sensing, v: Vehicle, d: Driving):
    """Command the twins, and remember the action."""
    i = wp.tid()
    make_room(d, i)
    for column in range(d.actions.shape[2]):
        d.actions[0, i, column] = taken_action(m, i, column)
    command(m, k, s, v, d, i)
