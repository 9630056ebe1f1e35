"""The kernels: ``reset`` puts twins at rest, ``advance`` moves them by many main steps in one launch. :func:`build` makes
them for one kind of ground.

One thread is one twin. A main step is drift – hydraulics – kick – drift:

1. half a step of the pose with the old velocity;
2. slow actuators (arm spools, pump 1, gears, traction valves: once a main step), then all hydraulic substeps, with the
   geometry of the middle pose and the old joint rates; the oil's mean torques over the step are kept;
3. contacts, friction and bodies at the middle pose, with velocities extrapolated to the middle of the step where a force
   depends on them: one kick of the velocity. Deflections of dry friction belong to the middle of the step, too, moved
   there by the velocity between (leapfrog);
4. half a step of the pose with the new velocity; the oil takes up the difference of volume between the old and the mean
   velocity.

Bodies and shut-in oil together form a symplectic scheme of second order (Störmer–Verlet): without losses their energy
does not drift. Flows through orifices are of first order in the substep.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from collections.abc import Callable
from functools import cache
from typing import Any

import warp as wp

from aoro_gym.twin.physics.arms import (
    Arm,
    ArmGeometry,
    ArmState,
    arm_displace,
    arm_gas,
    arm_geometry,
    arm_oil_torque,
    arm_step,
)
from aoro_gym.twin.physics.bodies import (
    CornerLoad,
    FrameBody,
    accelerate,
    arm_tangent,
    hinge_rotation,
    hull_corner,
    wheel_centre,
)
from aoro_gym.twin.physics.driveline import (
    DrivelineControl,
    DrivelineState,
    driveline_displace,
    driveline_gas,
    driveline_step,
    pump_torque,
)
from aoro_gym.twin.physics.engine import EngineState, engine_step, full_load_torque, governed_speed
from aoro_gym.twin.physics.fluid import Oil, pressure, without_gas
from aoro_gym.twin.physics.friction import dry_friction, end_stop, lag, presliding, seal_friction
from aoro_gym.twin.physics.ground import ceiling, footing, place
from aoro_gym.twin.physics.mount import MountState, mount_step, mount_torque
from aoro_gym.twin.physics.stance import stance
from aoro_gym.twin.physics.steering import (
    Exchange,
    SteeringGeometry,
    SteeringState,
    play,
    play_output,
    steering_displace,
    steering_gas,
    steering_geometry,
    steering_step,
    steering_torque,
)
from aoro_gym.twin.physics.tires import Hull, hull_contact, tire_contact
from aoro_gym.twin.records import Command, MachineRecord, Output, State

OK = wp.constant(0)
NON_FINITE = wp.constant(1)
TWO_PI = wp.constant(6.283185307179586)


@wp.func
def load4(state: wp.array2d(dtype=float), row: int, t: int):
    return wp.vec4(state[row, t], state[row + 1, t], state[row + 2, t], state[row + 3, t])


@wp.func
def store4(state: wp.array2d(dtype=float), row: int, t: int, value: wp.vec4):
    state[row, t] = value[0]
    state[row + 1, t] = value[1]
    state[row + 2, t] = value[2]
    state[row + 3, t] = value[3]


@wp.func
def load3(state: wp.array2d(dtype=float), row: int, t: int):
    return wp.vec3(state[row, t], state[row + 1, t], state[row + 2, t])


@wp.func
def store3(state: wp.array2d(dtype=float), row: int, t: int, value: wp.vec3):
    state[row, t] = value[0]
    state[row + 1, t] = value[1]
    state[row + 2, t] = value[2]


@wp.func
def load_steering(state: wp.array2d(dtype=float), t: int):
    s = SteeringState()
    s.supply = state[State.SUPPLY, t]
    s.port_a = state[State.PORT_A, t]
    s.port_b = state[State.PORT_B, t]
    s.tank_line = state[State.TANK_LINE, t]
    s.ls_pressure = state[State.LS_PRESSURE, t]
    s.spool = state[State.SPOOL, t]
    s.compensator = state[State.COMPENSATOR, t]
    s.swash = state[State.SWASH, t]
    s.flow_in = state[State.FLOW_IN, t]
    s.flow_out = state[State.FLOW_OUT, t]
    return s


@wp.func
def store_steering(state: wp.array2d(dtype=float), t: int, s: SteeringState):
    state[State.SUPPLY, t] = s.supply
    state[State.PORT_A, t] = s.port_a
    state[State.PORT_B, t] = s.port_b
    state[State.TANK_LINE, t] = s.tank_line
    state[State.LS_PRESSURE, t] = s.ls_pressure
    state[State.SPOOL, t] = s.spool
    state[State.COMPENSATOR, t] = s.compensator
    state[State.SWASH, t] = s.swash
    state[State.FLOW_IN, t] = s.flow_in
    state[State.FLOW_OUT, t] = s.flow_out


@wp.func
def load_arm(state: wp.array2d(dtype=float), wheel: int, t: int):
    s = ArmState()
    s.bore = state[int(State.ARM_BORE_FL) + wheel, t]
    s.rod = state[int(State.ARM_ROD_FL) + wheel, t]
    return s


@wp.func
def store_arm(state: wp.array2d(dtype=float), wheel: int, t: int, s: ArmState):
    state[int(State.ARM_BORE_FL) + wheel, t] = s.bore
    state[int(State.ARM_ROD_FL) + wheel, t] = s.rod


@wp.func
def load_driveline(state: wp.array2d(dtype=float), t: int):
    s = DrivelineState()
    s.forward = state[State.FORWARD, t]
    s.back = state[State.BACK, t]
    s.wheel_fl = state[State.HOSE_FL, t]
    s.wheel_fr = state[State.HOSE_FR, t]
    s.wheel_rl = state[State.HOSE_RL, t]
    s.wheel_rr = state[State.HOSE_RR, t]
    s.charge = state[State.CHARGE, t]
    return s


@wp.func
def store_driveline(state: wp.array2d(dtype=float), t: int, s: DrivelineState):
    state[State.FORWARD, t] = s.forward
    state[State.BACK, t] = s.back
    state[State.HOSE_FL, t] = s.wheel_fl
    state[State.HOSE_FR, t] = s.wheel_fr
    state[State.HOSE_RL, t] = s.wheel_rl
    state[State.HOSE_RR, t] = s.wheel_rr
    state[State.CHARGE, t] = s.charge


@wp.func
def turn(q: wp.quat, omega: wp.vec3, dt: float):
    """Quaternion after turning at body rate ``omega`` for ``dt`` (second order)."""
    half = 0.5 * dt
    return wp.normalize(q * wp.quat(half * omega[0], half * omega[1], half * omega[2], 1.0))


@wp.func
def motor_pressures(oil: Oil, s: DrivelineState):
    """Pressure difference [Pa] across every motor."""
    back = pressure(oil, s.back)
    return wp.vec4(
        pressure(oil, s.wheel_fl) - back,
        pressure(oil, s.wheel_fr) - back,
        pressure(oil, s.wheel_rl) - back,
        pressure(oil, s.wheel_rr) - back,
    )


@wp.func
def arm_seal_capacity(m: Arm, oil: Oil, g: ArmGeometry, s: ArmState, rate: float):
    """Friction torque [N m] at which an arm's cylinder breaks away or slides."""
    return g.lever * seal_friction(
        m.cylinder_seal_preload,
        m.cylinder_seal_pressure_coefficient,
        wp.max(pressure(oil, s.bore), 0.0) + wp.max(pressure(oil, s.rod), 0.0),
        m.cylinder_seal_static_ratio,
        m.cylinder_seal_stribeck_velocity,
        g.lever * rate,
    )


@wp.func
def joint_capacity(m: MachineRecord, oil: Oil, g: SteeringGeometry, s: SteeringState, rate: float):
    """Friction torque [N m] at which the joint breaks away or slides: its bearing and the seals of both cylinders."""
    st = m.steering
    pressures = wp.max(pressure(oil, s.port_a), 0.0) + wp.max(pressure(oil, s.port_b), 0.0)
    return (
        m.joint.friction_torque
        + g.lever_left
        * seal_friction(
            st.cylinder_seal_preload,
            st.cylinder_seal_pressure_coefficient,
            pressures,
            st.cylinder_seal_static_ratio,
            st.cylinder_seal_stribeck_velocity,
            g.lever_left * rate,
        )
        + g.lever_right
        * seal_friction(
            st.cylinder_seal_preload,
            st.cylinder_seal_pressure_coefficient,
            pressures,
            st.cylinder_seal_static_ratio,
            st.cylinder_seal_stribeck_velocity,
            g.lever_right * rate,
        )
    )


@wp.func
def cylinders_step(
    m: MachineRecord,
    oil: Oil,
    g: SteeringGeometry,
    s: SteeringState,
    joint: float,
    joint_rate: float,
    x: MountState,
    dt: float,
):
    """Mount after ``dt``, whose cylinders feel oil, friction and ends of the stroke, as the joint does without one."""
    stiffness = m.joint.presliding_stiffness
    damping = m.joint.presliding_damping
    capacity = joint_capacity(m, oil, g, s, x.rate)
    angle = joint + x.deflection
    stop = end_stop(
        angle, x.rate, m.joint.range, m.joint.stop_torsional_stiffness, m.joint.stop_torsional_damping
    )
    grip = float(0.0)
    drag = m.steering.cylinder_seal_viscous * (g.lever_left * g.lever_left + g.lever_right * g.lever_right)
    torque = (
        steering_torque(oil, g, s) + dry_friction(x.friction, x.rate, capacity, stiffness, damping) - drag * x.rate + stop
    )
    if wp.abs(stiffness * x.friction + damping * x.rate) < capacity:
        grip += stiffness
        drag += damping
    if stop != 0.0:
        grip += m.joint.stop_torsional_stiffness
        drag += m.joint.stop_torsional_damping
    out = mount_step(g, m.joint.mount_stiffness, m.joint.backlash, torque, grip, drag, joint_rate, x, dt)
    out.friction = presliding(x.friction, out.rate, dt, capacity, stiffness)
    return out


@wp.func
def arm_torque(m: Arm, g: ArmGeometry, angle: float, rate: float, deflection: float, capacity: float, oil_torque: float):
    """Torque [N m] that raises an arm: oil, seal friction, end stops."""
    return (
        oil_torque
        + dry_friction(deflection, rate, capacity, m.presliding_stiffness, m.presliding_damping)
        - m.cylinder_seal_viscous * g.lever * g.lever * rate
        + end_stop(angle, rate, m.swing, m.stop_torsional_stiffness, m.stop_torsional_damping)
    )


@wp.func
def hydraulics(
    # parameters
    m: MachineRecord,
    oil: Oil,
    # at this main step: chambers, controls, rates
    g: SteeringGeometry,
    g_fl: ArmGeometry,
    g_fr: ArmGeometry,
    g_rl: ArmGeometry,
    g_rr: ArmGeometry,
    control: DrivelineControl,
    spool_demand: float,
    joint: float,
    joint_rate: float,
    arm_rate: wp.vec4,
    wheel_rate: wp.vec4,
    mount_stiffness: float,
    # state
    steering: SteeringState,
    arm_fl: ArmState,
    arm_fr: ArmState,
    arm_rl: ArmState,
    arm_rr: ArmState,
    driveline: DrivelineState,
    mount: MountState,
    h: float,
    num_substeps: int,
):
    """All circuits over one main step of ``h`` [s]: their states, and the mean torques on joint [N m] and arms [N m] and
    mean motor pressures [Pa], by the trapezoidal rule over the substeps.

    Where there is a mount (``mount_stiffness`` > 0 [N m/rad]), the cylinders move on their own and it bears on the joint.
    """
    dt = h / float(num_substeps)
    backlash = m.joint.backlash
    # what takes a power, once for all substeps
    gas = steering_gas(oil, steering)
    gas_fl = arm_gas(oil, arm_fl)
    gas_fr = arm_gas(oil, arm_fr)
    gas_rl = arm_gas(oil, arm_rl)
    gas_rr = arm_gas(oil, arm_rr)
    gas_driveline = driveline_gas(oil, driveline)
    cylinder_rate = float(joint_rate)
    joint_end = steering_torque(oil, g, steering)
    if mount_stiffness > 0.0:
        cylinder_rate = mount.rate
        joint_end = mount_torque(mount_stiffness, backlash, mount.deflection, mount.rate - joint_rate)
    joint_sum = 0.5 * joint_end
    arm_sum_fl = 0.5 * arm_oil_torque(oil, g_fl, arm_fl)
    arm_sum_fr = 0.5 * arm_oil_torque(oil, g_fr, arm_fr)
    arm_sum_rl = 0.5 * arm_oil_torque(oil, g_rl, arm_rl)
    arm_sum_rr = 0.5 * arm_oil_torque(oil, g_rr, arm_rr)
    motor_sum = 0.5 * motor_pressures(oil, driveline)
    flow_in = float(0.0)
    flow_out = float(0.0)
    for substep in range(num_substeps):
        supply = pressure(oil, steering.supply)
        tank = pressure(oil, steering.tank_line)
        arm_fl, in_fl, out_fl, ls_fl = arm_step(m.arm, oil, gas_fl, g_fl, arm_rate[0], supply, tank, arm_fl, dt)
        arm_fr, in_fr, out_fr, ls_fr = arm_step(m.arm, oil, gas_fr, g_fr, arm_rate[1], supply, tank, arm_fr, dt)
        arm_rl, in_rl, out_rl, ls_rl = arm_step(m.arm, oil, gas_rl, g_rl, arm_rate[2], supply, tank, arm_rl, dt)
        arm_rr, in_rr, out_rr, ls_rr = arm_step(m.arm, oil, gas_rr, g_rr, arm_rate[3], supply, tank, arm_rr, dt)
        exchange = Exchange()
        exchange.supply_flow = in_fl + in_fr + in_rl + in_rr
        exchange.tank_flow = out_fl + out_fr + out_rl + out_rr
        exchange.load_pressure = wp.max(wp.max(ls_fl, ls_fr), wp.max(ls_rl, ls_rr))
        steering = steering_step(
            m.steering, oil, gas, g, spool_demand, control.engine_speed, cylinder_rate, exchange, steering, dt
        )
        driveline = driveline_step(m.driveline, oil, gas_driveline, control, wheel_rate, driveline, dt)

        joint_end = steering_torque(oil, g, steering)
        if mount_stiffness > 0.0:
            mount = cylinders_step(m, oil, g, steering, joint + float(substep) * dt * joint_rate, joint_rate, mount, dt)
            cylinder_rate = mount.rate
            joint_end = mount_torque(mount_stiffness, backlash, mount.deflection, mount.rate - joint_rate)
        joint_sum += joint_end
        arm_sum_fl += arm_oil_torque(oil, g_fl, arm_fl)
        arm_sum_fr += arm_oil_torque(oil, g_fr, arm_fr)
        arm_sum_rl += arm_oil_torque(oil, g_rl, arm_rl)
        arm_sum_rr += arm_oil_torque(oil, g_rr, arm_rr)
        motor_sum += motor_pressures(oil, driveline)
        flow_in += steering.flow_in
        flow_out += steering.flow_out
    share = 1.0 / float(num_substeps)
    joint_oil = share * (joint_sum - 0.5 * joint_end)
    arm_oil = share * wp.vec4(
        arm_sum_fl - 0.5 * arm_oil_torque(oil, g_fl, arm_fl),
        arm_sum_fr - 0.5 * arm_oil_torque(oil, g_fr, arm_fr),
        arm_sum_rl - 0.5 * arm_oil_torque(oil, g_rl, arm_rl),
        arm_sum_rr - 0.5 * arm_oil_torque(oil, g_rr, arm_rr),
    )
    motor_mean = share * (motor_sum - 0.5 * motor_pressures(oil, driveline))
    steering.flow_in = share * flow_in
    steering.flow_out = share * flow_out
    return steering, arm_fl, arm_fr, arm_rl, arm_rr, driveline, mount, joint_oil, arm_oil, motor_mean


@wp.struct
class CornerMotion:
    """Motion of one corner in the middle of a main step."""

    angle: float  # [rad] arm
    rate: float  # [rad/s] arm
    spin: float  # [rad/s] wheel, absolute
    wheel_rate: float  # [rad/s] wheel relative to the arm
    start_rate: float  # [rad/s] arm, at the start of the step
    start_wheel_rate: float  # [rad/s] wheel relative to the arm, at the start of the step
    acceleration: float  # [rad/s²] of the wheel in the last main step, absolute


@wp.struct
class CornerElements:
    """Deflections of one corner's friction elements."""

    bristle_x: float  # [m]
    bristle_y: float
    arm: float  # [rad] seal of the arm's cylinder
    wheel: float  # [rad] brakes
    twist: float  # [rad] of the tire's patch


@wp.func
def wheel_rates(omega: wp.vec3, omega_rear: wp.vec3, arm_rate: wp.vec4, spin: wp.vec4):
    """Wheel rates [rad/s] relative to the arms, from the absolute spins: ω_w = Ω − ω_y ± φ̇."""
    return wp.vec4(
        spin[0] - omega[1] + arm_rate[0],
        spin[1] - omega[1] + arm_rate[1],
        spin[2] - omega_rear[1] - arm_rate[2],
        spin[3] - omega_rear[1] - arm_rate[3],
    )


@wp.func
def corner_load(
    # parameters
    m: MachineRecord,
    terrain: Any,
    ground: Any,
    pivot_x: float,
    direction: float,
    side: float,
    # circuits
    g: ArmGeometry,
    cylinder: ArmState,
    oil_torque: float,
    displacement: float,
    motor_pressure: float,
    parking_brake: float,
    # motion of the corner and of its frame
    motion: CornerMotion,
    elements: CornerElements,
    rotation: wp.mat33,
    origin: wp.vec3,
    velocity: wp.vec3,
    omega: wp.vec3,
    h: float,
):
    """Torques and contact force of one corner, its friction elements after the step, the wheel's load [N], and the
    share of its patch that lies on the map."""
    d = m.driveline
    out = CornerElements()

    capacity = arm_seal_capacity(m.arm, m.oil, g, cylinder, motion.rate)
    out.arm = presliding(elements.arm, motion.start_rate, h, capacity, m.arm.presliding_stiffness)

    # brakes and the motor's own friction hold between arm and wheel
    torque = displacement * motor_pressure
    brake = (
        d.brake_disc_torque
        + parking_brake * d.brake_parking_torque
        + (1.0 - d.motor_mechanical_efficiency) * wp.abs(torque)
    )
    out.wheel = presliding(elements.wheel, motion.start_wheel_rate, h, brake, d.brake_presliding_stiffness)

    centre = wheel_centre(m.corner, pivot_x, direction, side, motion.angle)
    hub_velocity = (
        velocity + wp.cross(omega, centre) + motion.rate * arm_tangent(direction, motion.angle, m.corner.arm_length)
    )
    under = footing(terrain, ground, origin + rotation * centre)
    contact = tire_contact(
        m.tire, under, rotation, origin, centre, hub_velocity, omega, motion.spin, elements.bristle_x,
        elements.bristle_y, elements.twist, h,
    )
    out.bristle_x = contact.bristle_x
    out.bristle_y = contact.bristle_y
    out.twist = contact.twist

    load = CornerLoad()
    load.angle = motion.angle
    load.rate = motion.rate
    load.spin = motion.spin
    load.arm_torque = arm_torque(
        m.arm, g, motion.angle, motion.rate, out.arm, capacity, oil_torque
    )
    stiffness = d.brake_presliding_stiffness
    damping = d.brake_presliding_damping
    load.wheel_torque = torque + dry_friction(out.wheel, motion.wheel_rate, brake, stiffness, damping)
    load.force = contact.force
    load.moment = contact.moment

    # Brake and tire can damp a light wheel faster than one step: with c their damping, their torque is taken at the
    # middle rate that this step's acceleration a brings, not the last one's: (I + c h/2) a = τ + c h/2 a_last.
    if wp.abs(stiffness * out.wheel + damping * motion.wheel_rate) >= brake:
        damping = 0.0
    damping_tire = contact.damping * contact.lever * contact.lever
    implicit = 0.5 * h * (damping + damping_tire)
    lacking = motion.acceleration - (load.wheel_torque + load.moment[1]) / m.corner.spin_inertia
    share = 0.5 * h * lacking * m.corner.spin_inertia / (m.corner.spin_inertia + implicit)
    load.wheel_torque += share * damping
    load.moment += wp.vec3(0.0, share * damping_tire, 0.0)
    load.force -= (share * contact.damping * contact.lever) * contact.forward
    return load, out, contact.load, under.known


@wp.func
def hull_loads(
    m: Hull,
    frame: FrameBody,
    clearance: float,
    terrain: Any,
    ground: Any,
    rotation: wp.mat33,
    origin: wp.vec3,
    velocity: wp.vec3,
    omega: wp.vec3,
):
    """Force [N], moment about the hinge origin [N m] and summed magnitude [N] of the ground on a frame's eight corners."""
    force = wp.vec3(0.0, 0.0, 0.0)
    moment = wp.vec3(0.0, 0.0, 0.0)
    touch = float(0.0)
    for i in range(8):
        point = hull_corner(frame, clearance, i)
        world = origin + rotation * point
        if world[2] < ceiling(terrain, ground, world[0], world[1]):
            one = hull_contact(m, footing(terrain, ground, world), rotation, origin, point, velocity, omega)
            force += one
            moment += wp.cross(point, one)
            touch += wp.length(one)
    return force, moment, touch


@wp.kernel(enable_backward=False)
def exchange(
    records: wp.array(dtype=MachineRecord), indices: wp.array(dtype=int), machines: wp.array(dtype=MachineRecord)
):
    """Write ``records`` into ``machines`` at ``indices``."""
    i = wp.tid()
    machines[indices[i]] = records[i]


@wp.kernel(enable_backward=False)
def multiply(indices: wp.array(dtype=int), values: wp.array2d(dtype=float), twins: wp.array(dtype=Any)):
    """Write multipliers of friction and rolling resistance into ``twins`` at ``indices``; negative ones leave the old."""
    i = wp.tid()
    one = twins[indices[i]]
    if values[0, i] >= 0.0:
        one.friction = values[0, i]
    if values[1, i] >= 0.0:
        one.rolling_resistance = values[1, i]
    twins[indices[i]] = one


def reset(
    # parameters
    machines: wp.array(dtype=MachineRecord),
    terrain: Any,
    # what to reset, and to what
    mask: wp.array(dtype=wp.bool),
    pose: wp.array2d(dtype=float),
    numbers: wp.array(dtype=int),
    # state out
    state: wp.array2d(dtype=float),
    commands: wp.array2d(dtype=float),
    history: wp.array2d(dtype=float),
    clock: wp.array(dtype=int),
    status: wp.array(dtype=int),
):
    """Machine at rest on its wheels; ``pose`` rows: x, y [m], heading, joint angle [rad]. Where ``numbers`` is not negative,
    the twin moves to that terrain."""
    t = wp.tid()
    if not mask[t]:
        return
    m = machines[t % machines.shape[0]]
    if numbers[t] >= 0:
        place(terrain, t, numbers[t])
    ground = terrain.twins[t]
    for row in range(state.shape[0]):
        state[row, t] = 0.0
    for row in range(history.shape[0]):
        history[row, t] = 0.0
    for row in range(commands.shape[0]):
        commands[row, t] = 0.0
    for wheel in range(4):
        commands[int(Command.TRACTION_FL) + wheel, t] = 1.0
        state[int(State.TRACTION_FL) + wheel, t] = 1.0
    commands[Command.GEAR, t] = 1.0
    clock[t] = 0
    status[t] = OK

    # what bears the machine: pose, arms, oil in their cylinders, bent tires, brakes that hold the wheels
    stand = stance(m, terrain, ground, pose[0, t], pose[1, t], pose[2, t], pose[3, t])
    state[State.X, t] = pose[0, t]
    state[State.Y, t] = pose[1, t]
    state[State.Z, t] = stand.height
    for i in range(4):
        state[int(State.QX) + i, t] = stand.rotation[i]
    state[State.JOINT, t] = pose[3, t]
    for wheel in range(4):
        state[int(State.ARM_FL) + wheel, t] = stand.arm[wheel]
        state[int(State.ARM_BORE_FL) + wheel, t] = stand.bore_pressure[wheel]
        state[int(State.ARM_ROD_FL) + wheel, t] = m.arm.rod_rest_pressure
        state[int(State.WHEEL_FRICTION_FL) + wheel, t] = -stand.brake[wheel] / m.driveline.brake_presliding_stiffness
    store4(state, int(State.BRISTLE_X_FL), t, stand.bristle_x)
    store4(state, int(State.BRISTLE_Y_FL), t, stand.bristle_y)

    # circuits idle: pump 2 holds its margin against its leakage, ports at the return line's pressure
    st = m.steering
    speed = m.engine.set_speed
    swash = st.pump_leakage * st.pump_margin / (st.pump_displacement * speed)
    state[State.SUPPLY, t] = st.pump_margin
    state[State.SWASH, t] = swash
    state[State.PORT_A, t] = st.tank_line_back_pressure
    state[State.PORT_B, t] = st.tank_line_back_pressure
    state[State.TANK_LINE, t] = st.tank_line_back_pressure
    state[State.COMPENSATOR, t] = 1.0
    # the joint: dry friction holds what oil at the return line's pressure does not, higher pressure what is beyond it
    steering = load_steering(state, t)
    g = steering_geometry(st, pose[3, t])
    borne = stand.joint
    if m.joint.mount_stiffness > 0.0:
        edge = wp.sign(borne)
        if m.joint.backlash > 0.0 and wp.abs(borne) <= m.joint.friction_torque:
            borne = 0.0  # in the middle of its play, while tires hold what is as little
            edge = 0.0
        state[State.MOUNT, t] = borne / m.joint.mount_stiffness + 0.5 * m.joint.backlash * edge
    capacity = joint_capacity(m, m.oil, g, steering, 0.0)
    lacking = borne - steering_torque(m.oil, g, steering)
    held = wp.clamp(lacking, -capacity, capacity)
    state[State.JOINT_FRICTION, t] = -held / m.joint.presliding_stiffness
    state[State.PORT_A, t] += wp.max(lacking - held, 0.0) / g.displacement_a
    state[State.PORT_B, t] += wp.min(lacking - held, 0.0) / g.displacement_b

    # the loop on charge: what the pump's cases do not take goes over the relief
    d = m.driveline
    surplus = d.charge_displacement * speed - 2.0 * d.pump_leakage * d.charge_relief_pressure
    charge = d.charge_relief_pressure + d.charge_relief_ramp * surplus / d.charge_relief_flow
    main = charge - d.charge_check_crack - d.pump_leakage * charge * wp.sqrt(m.oil.laminar_pressure) / d.charge_cv_check
    state[State.CHARGE, t] = charge
    state[State.FORWARD, t] = main
    state[State.BACK, t] = main
    for wheel in range(4):
        state[int(State.HOSE_FL) + wheel, t] = main
    state[State.SHIFT_FRONT, t] = 1.0
    state[State.SHIFT_REAR, t] = 1.0

    load = (
        m.engine.friction_0
        + m.engine.friction_1 * speed
        + d.charge_displacement * charge / d.charge_mechanical_efficiency
        + swash * st.pump_displacement * st.pump_margin / st.pump_mechanical_efficiency
    )
    full = full_load_torque(m.engine, speed)
    idle = load - m.engine.friction_0 - m.engine.friction_1 * speed
    state[State.ENGINE_SPEED, t] = governed_speed(m.engine, idle, full)
    state[State.GOVERNOR, t] = load
    state[State.ENGINE_TORQUE, t] = load


def advance(
    # parameters
    machines: wp.array(dtype=MachineRecord),
    terrain: Any,
    # commands (set, row, twin): each set holds for an equal number of frames
    commands: wp.array3d(dtype=float),
    # state in and out
    state: wp.array2d(dtype=float),
    history: wp.array2d(dtype=float),
    clock: wp.array(dtype=int),
    status: wp.array(dtype=int),
    # outputs (frame, row, twin): one frame every ``frame_steps`` main steps
    outputs: wp.array3d(dtype=float),
    # time stepping
    first: int,
    num_frames: int,
    frame_steps: int,
    num_substeps: int,
    h: float,
):
    """Advance the twins from ``first`` on by ``num_frames`` times ``frame_steps`` main steps of ``h`` [s] with
    ``num_substeps`` each."""
    t = first + wp.tid()
    if status[t] != OK:
        return
    m = machines[t % machines.shape[0]]
    ground = terrain.twins[t]

    # ---- load -------------------------------------------------------------------------------------------------------
    position = load3(state, int(State.X), t)
    remainder = load3(state, int(State.REST_X), t)
    q = wp.quat(state[State.QX, t], state[State.QY, t], state[State.QZ, t], state[State.QW, t])
    joint = state[State.JOINT, t]
    arm = load4(state, int(State.ARM_FL), t)
    wheel = load4(state, int(State.WHEEL_FL), t)
    velocity = load3(state, int(State.VX), t)
    omega = load3(state, int(State.WX), t)
    joint_rate = state[State.JOINT_RATE, t]
    arm_rate = load4(state, int(State.ARM_RATE_FL), t)
    spin = load4(state, int(State.SPIN_FL), t)
    d_velocity = load3(state, int(State.AVX), t)
    d_omega = load3(state, int(State.AWX), t)
    d_joint = state[State.JOINT_ACCELERATION, t]
    d_arm = load4(state, int(State.ARM_ACCELERATION_FL), t)
    d_spin = load4(state, int(State.SPIN_ACCELERATION_FL), t)
    bristle_x = load4(state, int(State.BRISTLE_X_FL), t)
    bristle_y = load4(state, int(State.BRISTLE_Y_FL), t)
    arm_friction = load4(state, int(State.ARM_FRICTION_FL), t)
    wheel_friction = load4(state, int(State.WHEEL_FRICTION_FL), t)
    twist = load4(state, int(State.TWIST_FL), t)
    steering = load_steering(state, t)
    spool_play = state[State.PLAY, t]
    mount = MountState()
    mount.deflection = state[State.MOUNT, t]
    mount.rate = state[State.MOUNT_RATE, t]
    mount.friction = state[State.JOINT_FRICTION, t]
    arm_fl = load_arm(state, 0, t)
    arm_fr = load_arm(state, 1, t)
    arm_rl = load_arm(state, 2, t)
    arm_rr = load_arm(state, 3, t)
    arm_spool = load4(state, int(State.ARM_SPOOL_FL), t)
    driveline = load_driveline(state, t)
    drive_swash = state[State.DRIVE_SWASH, t]
    shift_front = state[State.SHIFT_FRONT, t]
    shift_rear = state[State.SHIFT_REAR, t]
    traction = load4(state, int(State.TRACTION_FL), t)
    engine = EngineState()
    engine.speed = state[State.ENGINE_SPEED, t]
    engine.integral = state[State.GOVERNOR, t]
    engine.torque = state[State.ENGINE_TORQUE, t]
    tick = clock[t]

    oil = m.oil
    z_axis = wp.vec3(0.0, 0.0, 1.0)

    for frame in range(num_frames):
        told = commands[frame * commands.shape[0] // num_frames]
        steering_signal = told[Command.STEERING_SIGNAL, t]
        drive_signal = told[Command.DRIVE_SIGNAL, t]
        arm_signal = load4(told, int(Command.ARM_FL), t)
        traction_signal = load4(told, int(Command.TRACTION_FL), t)
        gear = told[Command.GEAR, t]
        parking_brake = told[Command.PARKING_BRAKE, t]
        wheel_load = wp.vec4(0.0, 0.0, 0.0, 0.0)
        hull_force = float(0.0)
        on_map = wp.vec4(1.0, 1.0, 1.0, 1.0)
        for step in range(frame_steps):
            # ---- half a drift: the middle pose -----------------------------------------------------------------------
            q = turn(q, omega, 0.5 * h)
            rotation = wp.quat_to_matrix(q)
            shift = rotation * (0.5 * h * velocity) + remainder
            moved = position + shift
            remainder = shift - (moved - position)
            position = moved
            joint += 0.5 * h * joint_rate
            arm += 0.5 * h * arm_rate
            to_rear = hinge_rotation(joint)
            rear_rotation = rotation * wp.transpose(to_rear)

            # wheel rates relative to the arms, and how they change
            omega_rear = to_rear * omega - joint_rate * z_axis
            d_omega_rear = to_rear * d_omega + joint_rate * wp.cross(z_axis, to_rear * omega)
            rate = wheel_rates(omega, omega_rear, arm_rate, spin)
            d_rate = wheel_rates(d_omega, d_omega_rear, d_arm, d_spin)
            wheel += 0.5 * h * rate

            # ---- slow actuators: their value in the middle of the step -----------------------------------------------
            kept = history.shape[0]
            history[tick % kept, t] = steering_signal
            delay = m.steering.valve_command_delay / h
            whole = int(wp.floor(delay))
            late = history[(tick + kept - whole) % kept, t]
            later = history[(tick + kept - whole - 1) % kept, t]
            delayed = late + (delay - float(whole)) * (later - late)
            spool_play = play(spool_play, delayed, m.steering.valve_hysteresis)
            spool_demand = play_output(spool_play, m.steering.valve_hysteresis)

            spool_old = arm_spool
            swash_old = drive_swash
            front_old = shift_front
            rear_old = shift_rear
            traction_old = traction
            tau = m.arm.valve_time_constant
            limit = m.arm.valve_rate_limit
            arm_spool = wp.vec4(
                lag(arm_spool[0], arm_signal[0], tau, limit, h),
                lag(arm_spool[1], arm_signal[1], tau, limit, h),
                lag(arm_spool[2], arm_signal[2], tau, limit, h),
                lag(arm_spool[3], arm_signal[3], tau, limit, h),
            )
            drive_swash = lag(
                drive_swash, drive_signal, m.driveline.pump_time_constant, 1.0 / m.driveline.pump_stroke_time, h
            )
            shift_front = lag(shift_front, wp.where(gear > 2.5, 0.5, 1.0), m.driveline.motor_shift_time, 1.0e6, h)
            shift_rear = lag(shift_rear, wp.where(gear > 1.5, 0.5, 1.0), m.driveline.motor_shift_time, 1.0e6, h)
            tau = m.driveline.traction_time_constant
            traction = wp.vec4(
                lag(traction[0], traction_signal[0], tau, 1.0e6, h),
                lag(traction[1], traction_signal[1], tau, 1.0e6, h),
                lag(traction[2], traction_signal[2], tau, 1.0e6, h),
                lag(traction[3], traction_signal[3], tau, 1.0e6, h),
            )
            control = DrivelineControl()
            control.swash = 0.5 * (swash_old + drive_swash)
            control.displacement_front = 0.5 * (front_old + shift_front) * m.driveline.motor_displacement
            control.displacement_rear = 0.5 * (rear_old + shift_rear) * m.driveline.motor_displacement
            control.traction = 0.5 * (traction_old + traction)
            control.engine_speed = engine.speed

            # ---- hydraulic substeps ----------------------------------------------------------------------------------
            g = steering_geometry(m.steering, joint)
            g_fl = arm_geometry(m.arm, arm[0], 0.5 * (spool_old[0] + arm_spool[0]))
            g_fr = arm_geometry(m.arm, arm[1], 0.5 * (spool_old[1] + arm_spool[1]))
            g_rl = arm_geometry(m.arm, arm[2], 0.5 * (spool_old[2] + arm_spool[2]))
            g_rr = arm_geometry(m.arm, arm[3], 0.5 * (spool_old[3] + arm_spool[3]))
            if oil.gas_fraction > 0.0 or m.joint.mount_stiffness > 0.0:
                steering, arm_fl, arm_fr, arm_rl, arm_rr, driveline, mount, joint_oil, arm_oil, motor_mean = hydraulics(
                    m, oil, g, g_fl, g_fr, g_rl, g_rr, control, spool_demand, joint, joint_rate, arm_rate, rate,
                    m.joint.mount_stiffness, steering, arm_fl, arm_fr, arm_rl, arm_rr, driveline, mount, h, num_substeps,
                )
            else:  # compiled without gas and mount
                steering, arm_fl, arm_fr, arm_rl, arm_rr, driveline, mount, joint_oil, arm_oil, motor_mean = hydraulics(
                    m, without_gas(oil), g, g_fl, g_fr, g_rl, g_rr, control, spool_demand, joint, joint_rate, arm_rate, rate,
                    0.0, steering, arm_fl, arm_fr, arm_rl, arm_rr, driveline, mount, h, num_substeps,
                )

            # ---- motion in the middle of the step, extrapolated ------------------------------------------------------
            mid_velocity = velocity + 0.5 * h * d_velocity
            mid_omega = omega + 0.5 * h * d_omega
            mid_joint_rate = joint_rate + 0.5 * h * d_joint
            mid_arm_rate = arm_rate + 0.5 * h * d_arm
            mid_spin = spin + 0.5 * h * d_spin
            mid_rate = rate + 0.5 * h * d_rate
            mid_omega_rear = to_rear * mid_omega - mid_joint_rate * z_axis
            mid_velocity_rear = to_rear * mid_velocity

            # ---- joint torque: oil, friction, stops; or the mount, whose cylinders feel them ---------------------------
            st = m.steering
            joint_torque = joint_oil
            if m.joint.mount_stiffness == 0.0:
                capacity = joint_capacity(m, oil, g, steering, mid_joint_rate)
                stiffness = m.joint.presliding_stiffness
                mount.friction = presliding(mount.friction, joint_rate, h, capacity, stiffness)
                joint_torque += dry_friction(
                    mount.friction, mid_joint_rate, capacity, stiffness, m.joint.presliding_damping
                )
                joint_torque -= (
                    st.cylinder_seal_viscous
                    * (g.lever_left * g.lever_left + g.lever_right * g.lever_right)
                    * mid_joint_rate
                )
                joint_torque += end_stop(
                    joint,
                    mid_joint_rate,
                    m.joint.range,
                    m.joint.stop_torsional_stiffness,
                    m.joint.stop_torsional_damping,
                )

            # ---- corners: arms, wheels, tires; hulls ----------------------------------------------------------------
            c_fl = CornerMotion(
                arm[0], mid_arm_rate[0], mid_spin[0], mid_rate[0], arm_rate[0], rate[0], d_spin[0]
            )
            c_fr = CornerMotion(
                arm[1], mid_arm_rate[1], mid_spin[1], mid_rate[1], arm_rate[1], rate[1], d_spin[1]
            )
            c_rl = CornerMotion(
                arm[2], mid_arm_rate[2], mid_spin[2], mid_rate[2], arm_rate[2], rate[2], d_spin[2]
            )
            c_rr = CornerMotion(
                arm[3], mid_arm_rate[3], mid_spin[3], mid_rate[3], arm_rate[3], rate[3], d_spin[3]
            )
            e_fl = CornerElements(bristle_x[0], bristle_y[0], arm_friction[0], wheel_friction[0], twist[0])
            e_fr = CornerElements(bristle_x[1], bristle_y[1], arm_friction[1], wheel_friction[1], twist[1])
            e_rl = CornerElements(bristle_x[2], bristle_y[2], arm_friction[2], wheel_friction[2], twist[2])
            e_rr = CornerElements(bristle_x[3], bristle_y[3], arm_friction[3], wheel_friction[3], twist[3])
            drive = control.displacement_front
            load_fl, e_fl, normal_fl, known_fl = corner_load(
                m, terrain, ground, m.frame_front.pivot_x, 1.0, 1.0, g_fl, arm_fl, arm_oil[0],
                drive, motor_mean[0], parking_brake, c_fl, e_fl, rotation, position, mid_velocity, mid_omega, h,
            )
            load_fr, e_fr, normal_fr, known_fr = corner_load(
                m, terrain, ground, m.frame_front.pivot_x, 1.0, -1.0, g_fr, arm_fr, arm_oil[1],
                drive, motor_mean[1], parking_brake, c_fr, e_fr, rotation, position, mid_velocity, mid_omega, h,
            )
            drive = control.displacement_rear
            load_rl, e_rl, normal_rl, known_rl = corner_load(
                m, terrain, ground, m.frame_rear.pivot_x, -1.0, 1.0, g_rl, arm_rl, arm_oil[2],
                drive, motor_mean[2], parking_brake, c_rl, e_rl, rear_rotation, position, mid_velocity_rear,
                mid_omega_rear, h,
            )
            load_rr, e_rr, normal_rr, known_rr = corner_load(
                m, terrain, ground, m.frame_rear.pivot_x, -1.0, -1.0, g_rr, arm_rr, arm_oil[3],
                drive, motor_mean[3], parking_brake, c_rr, e_rr, rear_rotation, position, mid_velocity_rear,
                mid_omega_rear, h,
            )
            bristle_x = wp.vec4(e_fl.bristle_x, e_fr.bristle_x, e_rl.bristle_x, e_rr.bristle_x)
            bristle_y = wp.vec4(e_fl.bristle_y, e_fr.bristle_y, e_rl.bristle_y, e_rr.bristle_y)
            arm_friction = wp.vec4(e_fl.arm, e_fr.arm, e_rl.arm, e_rr.arm)
            wheel_friction = wp.vec4(e_fl.wheel, e_fr.wheel, e_rl.wheel, e_rr.wheel)
            twist = wp.vec4(e_fl.twist, e_fr.twist, e_rl.twist, e_rr.twist)
            wheel_load = wp.vec4(normal_fl, normal_fr, normal_rl, normal_rr)

            front_force, front_moment, front_touch = hull_loads(
                m.hull, m.frame_front, m.frame_ground_clearance, terrain, ground, rotation, position, mid_velocity,
                mid_omega,
            )
            rear_force, rear_moment, rear_touch = hull_loads(
                m.hull, m.frame_rear, m.frame_ground_clearance, terrain, ground, rear_rotation, position,
                mid_velocity_rear, mid_omega_rear,
            )
            hull_force = front_touch + rear_touch
            on_map = wp.vec4(known_fl, known_fr, known_rl, known_rr)

            # ---- accelerations of the tree ---------------------------------------------------------------------------
            weight = wp.transpose(rotation) * wp.vec3(0.0, 0.0, -ground.gravity)
            change = accelerate(
                m.frame_front, m.frame_rear, m.corner, weight, to_rear, mid_velocity, mid_omega, mid_joint_rate,
                joint_torque, load_fl, load_fr, load_rl, load_rr, front_force, front_moment, rear_force, rear_moment,
            )
            d_velocity = change.linear
            d_omega = change.angular
            d_joint = change.joint
            d_arm = change.arms
            d_spin = change.spins

            # ---- kick, and half a drift to the end of the step -------------------------------------------------------
            start_joint_rate = joint_rate
            start_arm_rate = arm_rate
            velocity += h * d_velocity
            omega += h * d_omega
            joint_rate += h * d_joint
            arm_rate += h * d_arm
            spin += h * d_spin
            shift = rotation * (0.5 * h * velocity) + remainder
            moved = position + shift
            remainder = shift - (moved - position)
            position = moved
            q = turn(q, omega, 0.5 * h)
            joint += 0.5 * h * joint_rate
            arm += 0.5 * h * arm_rate
            omega_rear = hinge_rotation(joint) * omega - joint_rate * z_axis
            wheel += (0.5 * h) * wheel_rates(omega, omega_rear, arm_rate, spin)
            for i in range(4):
                wheel[i] = wheel[i] - TWO_PI * wp.floor(wheel[i] / TWO_PI)

            # ---- the oil takes up what the joints moved beyond the old velocity: volumes stay exact ------------------
            turned = 0.5 * h * (joint_rate - start_joint_rate)
            steering = steering_displace(m.steering, oil, g, turned, steering)
            raised = (0.5 * h) * (arm_rate - start_arm_rate)
            arm_fl = arm_displace(m.arm, oil, g_fl, raised[0], arm_fl)
            arm_fr = arm_displace(m.arm, oil, g_fr, raised[1], arm_fr)
            arm_rl = arm_displace(m.arm, oil, g_rl, raised[2], arm_rl)
            arm_rr = arm_displace(m.arm, oil, g_rr, raised[3], arm_rr)
            rolled = (0.5 * h) * (wheel_rates(omega, omega_rear, arm_rate, spin) - rate)
            driveline = driveline_displace(m.driveline, oil, control, rolled, driveline)

            # ---- engine under its pumps ------------------------------------------------------------------------------
            drive_drop = pressure(oil, driveline.forward) - pressure(oil, driveline.back)
            engine_load = (
                pump_torque(drive_swash * m.driveline.pump_displacement, drive_drop, m.driveline.pump_mechanical_efficiency)
                + steering.swash * st.pump_displacement * pressure(oil, steering.supply) / st.pump_mechanical_efficiency
                + m.driveline.charge_displacement
                * pressure(oil, driveline.charge)
                / m.driveline.charge_mechanical_efficiency
            )
            engine = engine_step(m.engine, engine, engine_load, h)
            tick += 1

            # any NaN or infinity in a velocity or a pressure reaches this sum within a step
            watch = (
                wp.length(position) + wp.length(velocity) + wp.length(omega) + joint_rate + wp.length(arm_rate)
                + wp.length(spin) + steering.supply + steering.port_a + steering.port_b + steering.tank_line
                + wp.length(motor_mean) + driveline.charge + wp.length(arm_oil)
                + engine.speed
            )
            if not wp.isfinite(watch):
                status[t] = NON_FINITE
                return

        # ---- record ------------------------------------------------------------------------------------------------
        omega_rear = hinge_rotation(joint) * omega - joint_rate * z_axis
        rate = wheel_rates(omega, omega_rear, arm_rate, spin)
        g = steering_geometry(m.steering, joint)
        rotation = wp.quat_to_matrix(q)
        drop = motor_pressures(oil, driveline)
        outputs[frame, Output.STEERING_SIGNAL, t] = steering_signal
        outputs[frame, Output.DRIVE_SIGNAL, t] = drive_signal
        outputs[frame, Output.JOINT_ANGLE, t] = joint
        outputs[frame, Output.JOINT_RATE, t] = joint_rate
        # oil into the port that the command pressurises
        pressurised = wp.where(steering_signal < 0.0, g.displacement_b, g.displacement_a)
        outputs[frame, Output.JOINT_FLOW, t] = pressurised * joint_rate
        outputs[frame, Output.PRESSURE_A, t] = pressure(oil, steering.port_a)
        outputs[frame, Output.PRESSURE_B, t] = pressure(oil, steering.port_b)
        outputs[frame, Output.PUMP_PRESSURE, t] = pressure(oil, steering.supply)
        outputs[frame, Output.RETURN_PRESSURE, t] = pressure(oil, steering.tank_line)
        outputs[frame, Output.LS_PRESSURE, t] = steering.ls_pressure
        outputs[frame, Output.SPOOL, t] = steering.spool
        outputs[frame, Output.COMPENSATOR, t] = steering.compensator
        outputs[frame, Output.PUMP_SWASH, t] = steering.swash
        outputs[frame, Output.FLOW_IN, t] = steering.flow_in
        outputs[frame, Output.FLOW_OUT, t] = steering.flow_out
        outputs[frame, Output.PUMP_FLOW, t] = steering.swash * m.steering.pump_displacement * engine.speed
        outputs[frame, Output.DRIVE_PRESSURE_FORWARD, t] = pressure(oil, driveline.forward)
        outputs[frame, Output.DRIVE_PRESSURE_RETURN, t] = pressure(oil, driveline.back)
        outputs[frame, Output.CHARGE_PRESSURE, t] = pressure(oil, driveline.charge)
        outputs[frame, Output.DRIVE_SWASH, t] = drive_swash
        outputs[frame, Output.SHIFT_FRONT, t] = shift_front
        outputs[frame, Output.SHIFT_REAR, t] = shift_rear
        outputs[frame, Output.ARM_PRESSURE_BORE_FL, t] = pressure(oil, arm_fl.bore)
        outputs[frame, Output.ARM_PRESSURE_BORE_FR, t] = pressure(oil, arm_fr.bore)
        outputs[frame, Output.ARM_PRESSURE_BORE_RL, t] = pressure(oil, arm_rl.bore)
        outputs[frame, Output.ARM_PRESSURE_BORE_RR, t] = pressure(oil, arm_rr.bore)
        outputs[frame, Output.ARM_PRESSURE_ROD_FL, t] = pressure(oil, arm_fl.rod)
        outputs[frame, Output.ARM_PRESSURE_ROD_FR, t] = pressure(oil, arm_fr.rod)
        outputs[frame, Output.ARM_PRESSURE_ROD_RL, t] = pressure(oil, arm_rl.rod)
        outputs[frame, Output.ARM_PRESSURE_ROD_RR, t] = pressure(oil, arm_rr.rod)
        for i in range(4):
            outputs[frame, int(Output.MOTOR_PRESSURE_FL) + i, t] = drop[i]
            outputs[frame, int(Output.WHEEL_RATE_FL) + i, t] = rate[i]
            outputs[frame, int(Output.ARM_ANGLE_FL) + i, t] = arm[i]
            outputs[frame, int(Output.WHEEL_LOAD_FL) + i, t] = wheel_load[i]
        outputs[frame, Output.ENGINE_SPEED, t] = engine.speed
        outputs[frame, Output.ENGINE_TORQUE, t] = engine.torque
        outputs[frame, Output.POSITION_X, t] = position[0]
        outputs[frame, Output.POSITION_Y, t] = position[1]
        outputs[frame, Output.POSITION_Z, t] = position[2]
        outputs[frame, Output.ROLL, t] = wp.atan2(rotation[2, 1], rotation[2, 2])
        outputs[frame, Output.PITCH, t] = -wp.asin(wp.clamp(rotation[2, 0], -1.0, 1.0))
        outputs[frame, Output.YAW, t] = wp.atan2(rotation[1, 0], rotation[0, 0])
        outputs[frame, Output.SPEED, t] = velocity[0]
        outputs[frame, Output.YAW_RATE, t] = omega[2]
        outputs[frame, Output.HULL_FORCE, t] = hull_force
        off_map = float(0.0)
        for i in range(4):
            off_map += wp.where(on_map[i] < 0.5, 1.0, 0.0)
        outputs[frame, Output.WHEELS_OFF_MAP, t] = off_map

    # the rest of the state, which a clamp could have hidden above
    rest = (
        joint + wp.length(arm) + wp.length(wheel) + wp.length(remainder) + q[0] + q[1] + q[2] + q[3]
        + wp.length(d_velocity) + wp.length(d_omega) + d_joint + wp.length(d_arm) + wp.length(d_spin)
        + wp.length(bristle_x) + wp.length(bristle_y) + wp.length(arm_friction)
        + wp.length(wheel_friction) + wp.length(twist) + mount.deflection + mount.rate + mount.friction
        + steering.ls_pressure + steering.spool + spool_play + steering.compensator
        + steering.swash + steering.flow_in + steering.flow_out + arm_fl.bore + arm_fl.rod + arm_fr.bore + arm_fr.rod
        + arm_rl.bore + arm_rl.rod + arm_rr.bore + arm_rr.rod + wp.length(arm_spool) + driveline.forward
        + driveline.back + driveline.wheel_fl + driveline.wheel_fr + driveline.wheel_rl + driveline.wheel_rr
        + drive_swash + shift_front + shift_rear + wp.length(traction) + engine.integral + engine.torque
    )
    if not wp.isfinite(rest):
        status[t] = NON_FINITE
        return

    # ---- store ------------------------------------------------------------------------------------------------------
    store3(state, int(State.X), t, position)
    store3(state, int(State.REST_X), t, remainder)
    for i in range(4):
        state[int(State.QX) + i, t] = q[i]
    state[State.JOINT, t] = joint
    store4(state, int(State.ARM_FL), t, arm)
    store4(state, int(State.WHEEL_FL), t, wheel)
    store3(state, int(State.VX), t, velocity)
    store3(state, int(State.WX), t, omega)
    state[State.JOINT_RATE, t] = joint_rate
    store4(state, int(State.ARM_RATE_FL), t, arm_rate)
    store4(state, int(State.SPIN_FL), t, spin)
    store3(state, int(State.AVX), t, d_velocity)
    store3(state, int(State.AWX), t, d_omega)
    state[State.JOINT_ACCELERATION, t] = d_joint
    store4(state, int(State.ARM_ACCELERATION_FL), t, d_arm)
    store4(state, int(State.SPIN_ACCELERATION_FL), t, d_spin)
    store4(state, int(State.BRISTLE_X_FL), t, bristle_x)
    store4(state, int(State.BRISTLE_Y_FL), t, bristle_y)
    store4(state, int(State.ARM_FRICTION_FL), t, arm_friction)
    store4(state, int(State.WHEEL_FRICTION_FL), t, wheel_friction)
    store4(state, int(State.TWIST_FL), t, twist)
    store_steering(state, t, steering)
    state[State.PLAY, t] = spool_play
    state[State.MOUNT, t] = mount.deflection
    state[State.MOUNT_RATE, t] = mount.rate
    state[State.JOINT_FRICTION, t] = mount.friction
    store_arm(state, 0, t, arm_fl)
    store_arm(state, 1, t, arm_fr)
    store_arm(state, 2, t, arm_rl)
    store_arm(state, 3, t, arm_rr)
    store4(state, int(State.ARM_SPOOL_FL), t, arm_spool)
    store_driveline(state, t, driveline)
    state[State.DRIVE_SWASH, t] = drive_swash
    state[State.SHIFT_FRONT, t] = shift_front
    state[State.SHIFT_REAR, t] = shift_rear
    store4(state, int(State.TRACTION_FL), t, traction)
    state[State.ENGINE_SPEED, t] = engine.speed
    state[State.GOVERNOR, t] = engine.integral
    state[State.ENGINE_TORQUE, t] = engine.torque
    clock[t] = tick


@cache
def build(kind: Any) -> tuple[Any, Any]:
    """The kernels ``reset`` and ``advance`` for one kind of ground: ``Planes``, ``Rasters`` or ``Meshes``.

    Each kind is a module of its own, compiled when first asked for. On CUDA with approximate division, roots and
    exponentials (``fast_math``; the CPU's compiler ignores it): 4.5 times the speed, and a turn that differs by 1e-4 of a
    channel's range at most.
    """
    module = f"{__name__}.{kind.key.lower()}"
    wp.set_module_options({"fast_math": True, "default_grid_stride": False}, module=module)

    def kernel(function: Callable[..., None]) -> Any:
        generic = wp.kernel(function, enable_backward=False, module=module)
        return wp.overload(generic, {"terrain": kind})

    return kernel(reset), kernel(advance)
