"""All hydraulic circuits over one main step: slow actuators once, pump, valves and cylinders in substeps."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from typing import Any

import warp as wp

from aoro_gym.twin.kernels.state import Actuators, Circuits, OilLoads, Pose, load4
from aoro_gym.twin.physics.arms import (
    ArmGeometry,
    ArmState,
    arm_displace,
    arm_fill,
    arm_flows,
    arm_gas,
    arm_geometry,
    arm_oil_torque,
)
from aoro_gym.twin.physics.driveline import (
    DrivelineControl,
    driveline_displace,
    driveline_gas,
    driveline_step,
    motor_pressures,
    motor_shares,
    pump_torque,
)
from aoro_gym.twin.physics.fluid import Oil, pressure
from aoro_gym.twin.physics.friction import lag
from aoro_gym.twin.physics.joint import cylinders_step, mount_hardening
from aoro_gym.twin.physics.mount import mount_torque
from aoro_gym.twin.physics.steering import (
    steering_displace,
    steering_gas,
    steering_geometry,
    steering_step,
    steering_torque,
)
from aoro_gym.twin.physics.steering_circuit import Exchange, SteeringGeometry, SteeringState
from aoro_gym.twin.physics.steering_valve import play
from aoro_gym.twin.records import Command, MachineRecord

UNLIMITED = wp.constant(1.0e6)  # [1/s] rate of an actuator without a limit


@wp.struct
class Signals:
    """Commands of one twin, held over a frame."""

    steering: float  # [-] −1 … 1
    drive: float  # [-] −1 … 1
    arms: wp.vec4  # [-] −1 … 1
    traction: wp.vec4  # [-] 0 … 1
    gear: float  # 1, 2 or 3
    parking_brake: float  # [-] 0 … 1
    crane: wp.vec4  # [-] −1 … 1, of machines that have one
    held: wp.vec4  # of the log in its grapple: [kg], [rad], [kg m²] twice


@wp.func
def load_signals(commands: wp.array2d(dtype=float), t: int):
    signals = Signals()
    signals.steering = commands[Command.STEERING_SIGNAL, t]
    signals.drive = commands[Command.DRIVE_SIGNAL, t]
    signals.arms = load4(commands, int(Command.ARM_FL), t)
    signals.traction = load4(commands, int(Command.TRACTION_FL), t)
    signals.gear = commands[Command.GEAR, t]
    signals.parking_brake = commands[Command.PARKING_BRAKE, t]
    return signals


@wp.func
def delay(history: wp.array2d(dtype=float), t: int, tick: int, signal: float, steps: float):
    """Value of ``signal`` some ``steps`` ago, linear between whole ones; ``history`` keeps the last ones in a ring."""
    kept = history.shape[0]
    history[tick % kept, t] = signal
    whole = int(wp.floor(steps))
    late = history[(tick + kept - whole) % kept, t]
    later = history[(tick + kept - whole - 1) % kept, t]
    return late + (steps - float(whole)) * (later - late)


@wp.func
def lags(x: wp.vec4, target: wp.vec4, time_constant: float, rate_limit: float, dt: float):
    """Four lags (fl, fr, rl, rr)."""
    return wp.vec4(
        lag(x[0], target[0], time_constant, rate_limit, dt),
        lag(x[1], target[1], time_constant, rate_limit, dt),
        lag(x[2], target[2], time_constant, rate_limit, dt),
        lag(x[3], target[3], time_constant, rate_limit, dt),
    )


@wp.func
def actuators_step(m: MachineRecord, signals: Signals, steering: float, x: Actuators, h: float):
    """Slow actuators after a main step of ``h`` [s]; ``steering`` is the delayed signal."""
    d = m.driveline
    out = Actuators()
    out.play = play(x.play, steering, m.steering.valve_hysteresis)
    out.arm_spools = lags(x.arm_spools, signals.arms, m.arm.valve_time_constant, m.arm.valve_rate_limit, h)
    out.drive_swash = lag(x.drive_swash, signals.drive, d.pump_time_constant, 1.0 / d.pump_stroke_time, h)
    share_front, share_rear = motor_shares(d, signals.gear)
    out.shift_front = lag(x.shift_front, share_front, d.motor_shift_time, UNLIMITED, h)
    out.shift_rear = lag(x.shift_rear, share_rear, d.motor_shift_time, UNLIMITED, h)
    out.traction = lags(x.traction, signals.traction, d.traction_time_constant, UNLIMITED, h)
    return out


@wp.func
def driveline_control(displacement: float, old: Actuators, new: Actuators, engine_speed: float):
    """Mean over the main step of what moves slowly; ``displacement`` [m³/rad] of an unshifted motor."""
    control = DrivelineControl()
    control.swash = 0.5 * (old.drive_swash + new.drive_swash)
    control.displacement_front = 0.5 * (old.shift_front + new.shift_front) * displacement
    control.displacement_rear = 0.5 * (old.shift_rear + new.shift_rear) * displacement
    control.traction = 0.5 * (old.traction + new.traction)
    control.engine_speed = engine_speed
    return control


@wp.struct
class Chambers:
    """Chambers of all cylinders at one pose."""

    steering: SteeringGeometry
    fl: ArmGeometry
    fr: ArmGeometry
    rl: ArmGeometry
    rr: ArmGeometry


@wp.func
def chambers_at(m: MachineRecord, pose: Pose, old: Actuators, new: Actuators):
    """Chambers at ``pose``, with the arms' valves open by the mean over the main step."""
    out = Chambers()
    out.steering = steering_geometry(m.steering, pose.joint)
    out.fl = arm_geometry(m.arm, pose.arms[0], 0.5 * (old.arm_spools[0] + new.arm_spools[0]))
    out.fr = arm_geometry(m.arm, pose.arms[1], 0.5 * (old.arm_spools[1] + new.arm_spools[1]))
    out.rl = arm_geometry(m.arm, pose.arms[2], 0.5 * (old.arm_spools[2] + new.arm_spools[2]))
    out.rr = arm_geometry(m.arm, pose.arms[3], 0.5 * (old.arm_spools[3] + new.arm_spools[3]))
    return out


@wp.func
def arm_torques(oil: Oil, g: Chambers, fl: ArmState, fr: ArmState, rl: ArmState, rr: ArmState):
    """Torques [N m] of the oil on the arms."""
    return wp.vec4(
        arm_oil_torque(oil, g.fl, fl),
        arm_oil_torque(oil, g.fr, fr),
        arm_oil_torque(oil, g.rl, rl),
        arm_oil_torque(oil, g.rr, rr),
    )


@wp.func
def further_sections(laws: Any, state: wp.array2d(dtype=float), t: int, signals: Signals, oil: Oil, h: float):
    """What twin ``t`` has on pump 2 beside steering and arms, at the start of a main step of ``h`` [s]: nothing. A crane
    takes the place of this and the next two (:mod:`aoro_gym.twin.kernels.crane_on_frame`)."""
    return float(0.0)


@wp.func
def further_step(
    laws: Any, t: int, m: MachineRecord, oil: Oil, steering: SteeringState, exchange: Exchange, sections: Any, dt: float
):
    """``exchange`` and ``sections`` after a substep of ``dt`` [s]."""
    return exchange, sections


@wp.func
def keep_further(laws: Any, state: wp.array2d(dtype=float), t: int, oil: Oil, sections: Any, share: float):
    """Keep what the substeps came to; ``share`` is one over their number."""
    return


@wp.func
def hydraulics(
    # parameters
    m: MachineRecord,
    laws: Any,
    oil: Oil,
    mount_stiffness: float,
    # at this main step: chambers, controls, rates
    g: Chambers,
    control: DrivelineControl,
    spool_demand: float,
    joint: float,
    joint_rate: float,
    arm_rate: wp.vec4,
    wheel_rate: wp.vec4,
    # state
    circuits: Circuits,
    state: wp.array2d(dtype=float),
    t: int,
    signals: Signals,
    h: float,
    num_substeps: int,
):
    """All circuits over one main step of ``h`` [s]: their states, and their mean loads by the trapezoidal rule over the
    substeps.

    Where there is a mount (``mount_stiffness`` > 0 [N m/rad]), the cylinders move on their own and it bears on the joint.
    One function, as its variables are the state that a thread keeps in registers over the substeps.
    """
    dt = h / float(num_substeps)
    steering = circuits.steering
    mount = circuits.mount
    fl = circuits.fl
    fr = circuits.fr
    rl = circuits.rl
    rr = circuits.rr
    driveline = circuits.driveline
    # what takes a power, once for all substeps
    gas = steering_gas(oil, steering)
    gas_fl = arm_gas(oil, fl)
    gas_fr = arm_gas(oil, fr)
    gas_rl = arm_gas(oil, rl)
    gas_rr = arm_gas(oil, rr)
    gas_driveline = driveline_gas(oil, driveline)
    cylinder_rate = float(joint_rate)
    joint_end = steering_torque(oil, g.steering, steering)
    hardening = mount_hardening(m.joint)
    if mount_stiffness > 0.0:
        cylinder_rate = mount.rate
        joint_end = mount_torque(
            mount_stiffness, m.joint.backlash, hardening, mount.deflection, mount.rate - joint_rate
        )
    joint_sum = 0.5 * joint_end
    arm_sum = 0.5 * arm_torques(oil, g, fl, fr, rl, rr)
    motor_sum = 0.5 * motor_pressures(oil, driveline)
    flow_in = float(0.0)
    flow_out = float(0.0)
    sections = further_sections(laws, state, t, signals, oil, h)
    for substep in range(num_substeps):
        supply = pressure(oil, steering.supply)
        tank = pressure(oil, steering.tank_line)
        flows_fl = arm_flows(m.arm, m.arm_valve, oil, g.fl, arm_rate[0], supply, tank, fl, dt)
        flows_fr = arm_flows(m.arm, m.arm_valve, oil, g.fr, arm_rate[1], supply, tank, fr, dt)
        flows_rl = arm_flows(m.arm, m.arm_valve, oil, g.rl, arm_rate[2], supply, tank, rl, dt)
        flows_rr = arm_flows(m.arm, m.arm_valve, oil, g.rr, arm_rate[3], supply, tank, rr, dt)
        fl = arm_fill(m.arm, oil, gas_fl, g.fl, fl, flows_fl.bore, flows_fl.rod, dt)
        fl.compensator = flows_fl.compensator
        fr = arm_fill(m.arm, oil, gas_fr, g.fr, fr, flows_fr.bore, flows_fr.rod, dt)
        fr.compensator = flows_fr.compensator
        rl = arm_fill(m.arm, oil, gas_rl, g.rl, rl, flows_rl.bore, flows_rl.rod, dt)
        rl.compensator = flows_rl.compensator
        rr = arm_fill(m.arm, oil, gas_rr, g.rr, rr, flows_rr.bore, flows_rr.rod, dt)
        rr.compensator = flows_rr.compensator
        exchange = Exchange()
        exchange.supply_flow = flows_fl.drawn + flows_fr.drawn + flows_rl.drawn + flows_rr.drawn
        exchange.tank_flow = flows_fl.returned + flows_fr.returned + flows_rl.returned + flows_rr.returned
        exchange.load_pressure = wp.max(wp.max(flows_fl.load, flows_fr.load), wp.max(flows_rl.load, flows_rr.load))
        exchange, sections = further_step(laws, t, m, oil, steering, exchange, sections, dt)
        steering = steering_step(
            m.steering, oil, gas, g.steering, spool_demand, control.engine_speed, cylinder_rate, exchange, steering, dt
        )
        driveline = driveline_step(m.driveline, oil, gas_driveline, control, wheel_rate, driveline, dt)
        joint_end = steering_torque(oil, g.steering, steering)
        if mount_stiffness > 0.0:
            angle = joint + float(substep) * dt * joint_rate
            mount = cylinders_step(m.joint, m.steering, oil, g.steering, steering, angle, joint_rate, mount, dt)
            cylinder_rate = mount.rate
            joint_end = mount_torque(
                mount_stiffness, m.joint.backlash, hardening, mount.deflection, mount.rate - joint_rate
            )
        joint_sum += joint_end
        arm_sum += arm_torques(oil, g, fl, fr, rl, rr)
        motor_sum += motor_pressures(oil, driveline)
        flow_in += steering.flow_in
        flow_out += steering.flow_out
    share = 1.0 / float(num_substeps)
    mean = OilLoads()
    mean.joint = share * (joint_sum - 0.5 * joint_end)
    mean.arms = share * (arm_sum - 0.5 * arm_torques(oil, g, fl, fr, rl, rr))
    mean.motors = share * (motor_sum - 0.5 * motor_pressures(oil, driveline))
    steering.flow_in = share * flow_in
    steering.flow_out = share * flow_out
    keep_further(laws, state, t, oil, sections, share)
    return Circuits(steering, mount, fl, fr, rl, rr, driveline), mean


@wp.func
def displace(
    m: MachineRecord,
    g: Chambers,
    control: DrivelineControl,
    joint: float,
    arms: wp.vec4,
    wheels: wp.vec4,
    x: Circuits,
):
    """Circuits after joint, arms and wheels have turned by so much [rad] with all valves shut."""
    out = Circuits()
    out.steering = steering_displace(m.steering, m.oil, g.steering, joint, x.steering)
    out.mount = x.mount
    out.fl = arm_displace(m.arm, m.oil, g.fl, arms[0], x.fl)
    out.fr = arm_displace(m.arm, m.oil, g.fr, arms[1], x.fr)
    out.rl = arm_displace(m.arm, m.oil, g.rl, arms[2], x.rl)
    out.rr = arm_displace(m.arm, m.oil, g.rr, arms[3], x.rr)
    out.driveline = driveline_displace(m.driveline, m.oil, control, wheels, x.driveline)
    return out


@wp.func
def pumps_torque(m: MachineRecord, circuits: Circuits, drive_swash: float):
    """Torque [N m] of all pumps on the engine."""
    s = circuits.steering
    loop = circuits.driveline
    d = m.driveline
    drop = pressure(m.oil, loop.forward) - pressure(m.oil, loop.back)
    return (
        pump_torque(drive_swash * d.pump_displacement, drop, d.pump_mechanical_efficiency)
        + s.swash * m.steering.pump_displacement * pressure(m.oil, s.supply) / m.steering.pump_mechanical_efficiency
        + d.charge_displacement * pressure(m.oil, loop.charge) / d.charge_mechanical_efficiency
    )
