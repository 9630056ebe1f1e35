"""The kernel ``drive``: engine, pump 1, motors and brakes alone, their hubs turned by dynamometers.

It is the other side of the cut of :mod:`aoro_gym.twin.kernels.hubs`: given how fast each wheel turns, it says what torque
is at each flange. Its laws are those of the twin, and so is their order, so that both sides together, exchanging at every
main step without delay, are the twin.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

from aoro_gym.twin.kernels.hydraulics import actuators_step, driveline_control, load_signals
from aoro_gym.twin.kernels.state import Actuators, load4, store4
from aoro_gym.twin.physics.driveline import (
    Driveline,
    DrivelineState,
    driveline_displace,
    driveline_gas,
    driveline_step,
    motor_pressures,
    pump_torque,
)
from aoro_gym.twin.physics.engine import EngineState, engine_step
from aoro_gym.twin.physics.fluid import pressure
from aoro_gym.twin.physics.friction import dry_friction, presliding
from aoro_gym.twin.records import Demand, DrivelineOutput, MachineRecord, State


@wp.struct
class Hubs:
    """Four hubs on their dynamometers."""

    rate: wp.vec4  # [rad/s] in the last main step
    bent: wp.vec4  # [rad] friction of the brakes


@wp.func
def load_driveline(state: wp.array2d(dtype=float), t: int):
    """Actuators, oil, engine and brakes of driveline ``t``."""
    actuators = Actuators()
    actuators.drive_swash = state[State.DRIVE_SWASH, t]
    actuators.shift_front = state[State.SHIFT_FRONT, t]
    actuators.shift_rear = state[State.SHIFT_REAR, t]
    actuators.traction = load4(state, int(State.TRACTION_FL), t)
    loop = DrivelineState(
        state[State.FORWARD, t], state[State.BACK, t], state[State.HOSE_FL, t], state[State.HOSE_FR, t],
        state[State.HOSE_RL, t], state[State.HOSE_RR, t], state[State.CHARGE, t],
    )
    engine = EngineState(state[State.ENGINE_SPEED, t], state[State.GOVERNOR, t], state[State.ENGINE_TORQUE, t])
    hubs = Hubs(load4(state, int(State.SPIN_FL), t), load4(state, int(State.WHEEL_FRICTION_FL), t))
    return actuators, loop, engine, hubs


@wp.func
def store_driveline(
    state: wp.array2d(dtype=float), t: int, actuators: Actuators, loop: DrivelineState, engine: EngineState, hubs: Hubs
):
    """Inverse of :func:`load_driveline`."""
    state[State.DRIVE_SWASH, t] = actuators.drive_swash
    state[State.SHIFT_FRONT, t] = actuators.shift_front
    state[State.SHIFT_REAR, t] = actuators.shift_rear
    store4(state, int(State.TRACTION_FL), t, actuators.traction)
    state[State.FORWARD, t] = loop.forward
    state[State.BACK, t] = loop.back
    store4(state, int(State.HOSE_FL), t, wp.vec4(loop.wheel_fl, loop.wheel_fr, loop.wheel_rl, loop.wheel_rr))
    state[State.CHARGE, t] = loop.charge
    state[State.ENGINE_SPEED, t] = engine.speed
    state[State.GOVERNOR, t] = engine.integral
    state[State.ENGINE_TORQUE, t] = engine.torque
    store4(state, int(State.SPIN_FL), t, hubs.rate)
    store4(state, int(State.WHEEL_FRICTION_FL), t, hubs.bent)


@wp.func
def pumps_load(m: MachineRecord, loop: DrivelineState, swash: float, pump_2: float):
    """Torque [N m] of pump 1, the charge pump and ``pump_2`` on the engine."""
    d = m.driveline
    drop = pressure(m.oil, loop.forward) - pressure(m.oil, loop.back)
    return (
        pump_torque(swash * d.pump_displacement, drop, d.pump_mechanical_efficiency)
        + pump_2
        + d.charge_displacement * pressure(m.oil, loop.charge) / d.charge_mechanical_efficiency
    )


@wp.func
def hub(d: Driveline, torque: float, parking_brake: float, bent: float, start_rate: float, rate: float, h: float):
    """Torque [N m] at a flange, and deflection [rad] of the brakes: the motor's ``torque`` D Δp less dry friction, as in
    :func:`aoro_gym.twin.kernels.corners.corner_contact`."""
    brake = (
        d.brake_disc_torque
        + parking_brake * d.brake_parking_torque
        + (1.0 - d.motor_mechanical_efficiency) * wp.abs(torque)
    )
    deflection = presliding(bent, start_rate, h, brake, d.brake_presliding_stiffness)
    friction = dry_friction(deflection, rate, brake, d.brake_presliding_stiffness, d.brake_presliding_damping)
    return torque + friction, deflection


@wp.kernel(enable_backward=False)
def drive(
    # parameters
    machines: wp.array(dtype=MachineRecord),
    hub_inertia: float,
    # commands and demands (row, driveline), held over the launch
    commands: wp.array2d(dtype=float),
    demands: wp.array2d(dtype=float),
    # state in and out
    state: wp.array2d(dtype=float),
    clock: wp.array(dtype=int),
    # outputs (row, driveline)
    outputs: wp.array2d(dtype=float),
    # time stepping
    num_steps: int,
    num_substeps: int,
    h: float,
):
    """Move drivelines by ``num_steps`` main steps of ``h`` [s], at wheel rates that hold over them."""
    t = wp.tid()
    m = machines[t % machines.shape[0]]
    d = m.driveline
    actuators, loop, engine, hubs = load_driveline(state, t)
    signals = load_signals(commands, t)
    rate = load4(demands, int(Demand.RATE_FL), t)
    pump_2 = demands[Demand.PUMP_TORQUE, t]
    change = (1.0 / float(num_steps)) * (rate - hubs.rate)  # [rad/s] a main step
    middle = rate + 0.5 * change
    dt = h / float(num_substeps)
    mean = wp.vec4()
    speed = float(0.0)
    for step in range(num_steps):
        if clock[t] + step > 0:  # the end of the last one: the oil takes up what wheels turned beyond their old rate
            control = driveline_control(d.motor_displacement, actuators, actuators, engine.speed)
            loop = driveline_displace(d, m.oil, control, 0.5 * h * (rate - hubs.rate), loop)
            engine = engine_step(m.engine, engine, pumps_load(m, loop, actuators.drive_swash, pump_2), h)
        hubs.rate = rate
        if step == 0:
            speed = engine.speed
        old = actuators
        actuators = actuators_step(m, signals, 0.0, old, h)
        control = driveline_control(d.motor_displacement, old, actuators, engine.speed)
        gas = driveline_gas(m.oil, loop)
        drops = 0.5 * motor_pressures(m.oil, loop)
        for _ in range(num_substeps):
            loop = driveline_step(d, m.oil, gas, control, rate, loop, dt)
            drops += motor_pressures(m.oil, loop)
        drops = (1.0 / float(num_substeps)) * (drops - 0.5 * motor_pressures(m.oil, loop))
        torque = wp.vec4()
        bent = hubs.bent
        for i in range(4):
            size = wp.where(i < 2, control.displacement_front, control.displacement_rear)
            one, deflection = hub(d, size * drops[i], signals.parking_brake, bent[i], rate[i], middle[i], h)
            torque[i] = one
            bent[i] = deflection
        hubs.bent = bent
        mean += torque
    store_driveline(state, t, actuators, loop, engine, hubs)
    clock[t] += num_steps
    for i in range(4):
        outputs[int(DrivelineOutput.TORQUE_FL) + i, t] = mean[i] / float(num_steps) - hub_inertia * change[i] / h
    outputs[DrivelineOutput.ENGINE_SPEED, t] = speed
    outputs[DrivelineOutput.ENGINE_TORQUE, t] = engine.torque
    outputs[DrivelineOutput.DRIVE_PRESSURE_FORWARD, t] = pressure(m.oil, loop.forward)
    outputs[DrivelineOutput.DRIVE_PRESSURE_RETURN, t] = pressure(m.oil, loop.back)
    outputs[DrivelineOutput.DRIVE_SWASH, t] = actuators.drive_swash
