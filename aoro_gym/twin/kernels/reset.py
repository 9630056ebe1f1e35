"""The kernel ``reset``: puts twins at rest on the ground, with idle circuits."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from typing import Any

import warp as wp

from aoro_gym.twin.kernels.stance import stance
from aoro_gym.twin.kernels.state import load_steering, store4
from aoro_gym.twin.physics.engine import full_load_torque, governed_speed
from aoro_gym.twin.physics.ground import place
from aoro_gym.twin.physics.joint import joint_capacity
from aoro_gym.twin.physics.steering import steering_geometry, steering_torque
from aoro_gym.twin.records import OK, Command, MachineRecord, State


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
    capacity = joint_capacity(m.joint, st, m.oil, g, steering, 0.0)
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
