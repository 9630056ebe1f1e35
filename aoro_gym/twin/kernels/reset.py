"""The kernel ``reset``: puts twins at rest on the ground, with idle circuits."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from typing import Any

import warp as wp

from aoro_gym.twin.kernels.stance import UP, stance
from aoro_gym.twin.kernels.state import Actuators, Circuits, Deflections, Pose, Velocity, store_state
from aoro_gym.twin.kernels.tree import store_load_state
from aoro_gym.twin.physics.arms import ArmState
from aoro_gym.twin.physics.bodies import Accelerations, hinge_rotation
from aoro_gym.twin.physics.driveline import Driveline, DrivelineState
from aoro_gym.twin.physics.engine import EngineState, full_load_torque, governed_speed
from aoro_gym.twin.physics.fluid import Oil
from aoro_gym.twin.physics.ground import place
from aoro_gym.twin.physics.hoses import HOSE_VISCOELASTIC
from aoro_gym.twin.physics.joint import LUGRE, joint_capacity, mount_hardening
from aoro_gym.twin.physics.load import resting_load
from aoro_gym.twin.physics.mount import MountState, mount_bend
from aoro_gym.twin.physics.steering import RETURN_ORIFICE, steering_geometry, steering_torque
from aoro_gym.twin.physics.steering_circuit import Steering, SteeringState
from aoro_gym.twin.records import OK, Command, LoadRow, MachineRecord


@wp.func
def idle_steering(m: Steering, engine_speed: float):
    """Steering circuit at rest: pump 2 holds its margin against its leakage, ports at the return line's pressure."""
    s = SteeringState()
    s.supply = m.pump_margin
    s.swash = m.pump_leakage * m.pump_margin / (m.pump_displacement * engine_speed)
    back = m.tank_line_back_pressure
    if m.return_line_law == RETURN_ORIFICE:
        back = float(0.0)
    s.port_a = back
    s.port_b = back
    s.tank_line = back
    s.compensator = 1.0
    return s


@wp.func
def held_joint(m: MachineRecord, joint: float, torque: float, s: SteeringState):
    """Steering circuit and mount that hold the joint against ``torque`` [N m]: dry friction what oil at the return line's
    pressure does not, higher pressure what is beyond it. By laws without stiction, pressure holds all of it."""
    out = s
    mount = MountState()
    g = steering_geometry(m.steering, joint)
    borne = torque
    if m.joint.mount_stiffness > 0.0:
        edge = wp.sign(borne)
        if m.joint.backlash > 0.0 and wp.abs(borne) <= m.joint.friction_torque:
            borne = 0.0  # in the middle of its play, while tires hold what is as little
            edge = 0.0
        bent = mount_bend(m.joint.mount_stiffness, mount_hardening(m.joint), borne)
        mount.deflection = bent + 0.5 * m.joint.backlash * edge
    capacity = joint_capacity(m.joint, m.steering, m.oil, g, s, 0.0)
    if m.joint.friction_law > LUGRE:
        capacity = 0.0
    lacking = borne - steering_torque(m.oil, g, s)
    held = wp.clamp(lacking, -capacity, capacity)
    mount.friction = -held / m.joint.presliding_stiffness
    out.port_a += wp.max(lacking - held, 0.0) / g.displacement_a
    out.port_b += wp.min(lacking - held, 0.0) / g.displacement_b
    out.law.hose_a = out.port_a
    out.law.hose_b = out.port_b
    if m.steering.hose_law == HOSE_VISCOELASTIC:  # walls that have crept
        late = m.steering.hose_delayed_share * m.steering.hose_compliance
        out.law.hose_strain_a = late * wp.max(out.port_a, 0.0)
        out.law.hose_strain_b = late * wp.max(out.port_b, 0.0)
    return out, mount


@wp.func
def idle_driveline(m: Driveline, oil: Oil, engine_speed: float):
    """The loop on charge: what the pump's cases do not take goes over the relief."""
    surplus = m.charge_displacement * engine_speed - 2.0 * m.pump_leakage * m.charge_relief_pressure
    charge = m.charge_relief_pressure + m.charge_relief_ramp * surplus / m.charge_relief_flow
    main = charge - m.charge_check_crack - m.pump_leakage * charge * wp.sqrt(oil.laminar_pressure) / m.charge_cv_check
    return DrivelineState(main, main, main, main, main, main, charge)


@wp.func
def idle_engine(m: MachineRecord, charge: float, swash: float):
    """Engine under its idle pumps: ``charge`` [Pa] and pump 2 at ``swash``."""
    speed = m.engine.set_speed
    load = (
        m.engine.friction_0
        + m.engine.friction_1 * speed
        + m.driveline.charge_displacement * charge / m.driveline.charge_mechanical_efficiency
        + swash * m.steering.pump_displacement * m.steering.pump_margin / m.steering.pump_mechanical_efficiency
    )
    idle = load - m.engine.friction_0 - m.engine.friction_1 * speed
    return EngineState(governed_speed(m.engine, idle, full_load_torque(m.engine, speed)), load, load)


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
    for row in range(history.shape[0]):
        history[row, t] = 0.0
    for row in range(commands.shape[0]):
        commands[row, t] = 0.0
    for wheel in range(4):
        commands[int(Command.TRACTION_FL) + wheel, t] = 1.0
    commands[Command.GEAR, t] = 1.0
    clock[t] = 0
    status[t] = OK

    # what bears the machine: pose, arms, oil in their cylinders, bent tires, brakes that hold the wheels
    zero = wp.vec4()
    ones = wp.vec4(1.0, 1.0, 1.0, 1.0)
    stand = stance(m, terrain, ground, pose[0, t], pose[1, t], pose[2, t], pose[3, t])
    place_at = Pose(
        wp.vec3(pose[0, t], pose[1, t], stand.height), wp.vec3(), stand.rotation, pose[3, t], stand.arm, zero
    )
    brakes = -stand.brake / m.driveline.brake_presliding_stiffness
    bent = Deflections(stand.bristle_x, stand.bristle_y, zero, brakes, zero)
    steering, mount = held_joint(m, pose[3, t], stand.joint, idle_steering(m.steering, m.engine.set_speed))
    rod = m.arm.rod_rest_pressure
    bore = stand.bore_pressure
    circuits = Circuits(
        steering, mount, ArmState(bore[0], rod, 1.0), ArmState(bore[1], rod, 1.0), ArmState(bore[2], rod, 1.0),
        ArmState(bore[3], rod, 1.0), idle_driveline(m.driveline, m.oil, m.engine.set_speed),
    )
    actuators = Actuators(0.0, zero, 0.0, 1.0, 1.0, ones)
    engine = idle_engine(m, circuits.driveline.charge, steering.swash)
    store_state(state, t, place_at, Velocity(), Accelerations(), bent, actuators, circuits, engine, 1)
    if state.shape[0] > int(LoadRow.LOAD_SLIDE):
        up = hinge_rotation(pose[3, t]) * wp.quat_rotate_inv(stand.rotation, UP)
        store_load_state(state, t, resting_load(m.payload, up, ground.gravity))
