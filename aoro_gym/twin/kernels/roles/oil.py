"""Roles in the hydraulic substeps: steering, two pairs of arms, driveline.

Each begins with the state on the board, keeps its circuit in registers over the substeps, and leaves it on the board with
the circuit's mean loads. In a substep steering tells supply and return line, the arms what they draw, return and bear; the
driveline meets the others at the engine alone, which is as fast for a whole main step.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

from aoro_gym.twin.kernels.hydraulics import Signals, actuators_step, delay, driveline_control
from aoro_gym.twin.kernels.motion import rear_rate, wheel_rates
from aoro_gym.twin.kernels.roles.board import BORNE, DRAWN, LOAD_ROWS, OIL_ARM, OIL_MOTOR, RETURNED, Board, note
from aoro_gym.twin.kernels.state import (
    load_actuators,
    load_arm,
    load_compensator,
    load_loop,
    load_mount,
    load_steering,
    load_velocity,
    store4,
    store_arm,
    store_compensator,
    store_loop,
    store_mount,
    store_steering,
)
from aoro_gym.twin.physics.arms import (
    ArmGas,
    ArmGeometry,
    ArmState,
    arm_fill,
    arm_flows,
    arm_gas,
    arm_geometry,
    arm_oil_torque,
)
from aoro_gym.twin.physics.bodies import hinge_rotation
from aoro_gym.twin.physics.driveline import (
    DrivelineControl,
    DrivelineGas,
    DrivelineState,
    driveline_gas,
    driveline_step,
    motor_pressures,
)
from aoro_gym.twin.physics.fluid import pressure, without_gas
from aoro_gym.twin.physics.friction import lag
from aoro_gym.twin.physics.hoses import port_nominal_volume
from aoro_gym.twin.physics.joint import cylinders_step, least_inertia, mount_hardening, rigid_joint_torque
from aoro_gym.twin.physics.mount import MountState, mount_torque
from aoro_gym.twin.physics.steering import (
    SteeringFlows,
    steering_fill,
    steering_gas,
    steering_geometry,
    steering_torque,
)
from aoro_gym.twin.physics.steering_circuit import Exchange, SteeringGas, SteeringGeometry, SteeringState
from aoro_gym.twin.physics.steering_valve import play, play_output
from aoro_gym.twin.records import MachineRecord, State


@wp.func
def without_rare(m: MachineRecord, rare: bool):
    """``m``, and if not ``rare`` without gas and mount, which the compiler then leaves out."""
    out = m
    if not rare:
        out.oil = without_gas(m.oil)
        out.joint.mount_stiffness = 0.0
    return out


# ---- steering -------------------------------------------------------------------------------------------------------


@wp.struct
class SteeringRole:
    """What the steering warp keeps of a twin over the substeps."""

    circuit: SteeringState
    mount: MountState
    gas: SteeringGas
    g: SteeringGeometry
    spool_demand: float  # [-]
    engine_speed: float  # [rad/s]
    joint: float  # [rad] in the middle of the main step
    joint_rate: float  # [rad/s]
    cylinder_rate: float  # [rad/s] as a joint rate
    joint_end: float  # [N m] torque on the joint after the last substep
    joint_sum: float
    flow_in: float  # [m³/s] sums over the substeps
    flow_out: float


@wp.func
def mount_bears(m: MachineRecord, x: SteeringRole):
    """Torque [N m] of the mount on the joint."""
    slip = x.mount.rate - x.joint_rate
    return mount_torque(m.joint.mount_stiffness, m.joint.backlash, mount_hardening(m.joint), x.mount.deflection, slip)


@wp.func
def steering_begins(
    m: MachineRecord,
    board: wp.array2d(dtype=float),
    lane: int,
    history: wp.array2d(dtype=float),
    t: int,
    tick: int,
    signal: float,
    h: float,
):
    """The steering of a main step of ``h`` [s]: valve demand from the delayed ``signal``, chambers, and the circuit."""
    x = SteeringRole()
    x.joint_rate = board[State.JOINT_RATE, lane]
    x.joint = board[State.JOINT, lane] + 0.5 * h * x.joint_rate
    x.engine_speed = board[State.ENGINE_SPEED, lane]
    delayed = delay(history, t, tick, signal, m.steering.valve_command_delay / h)
    moved = play(board[State.PLAY, lane], delayed, m.steering.valve_hysteresis)
    board[State.PLAY, lane] = moved
    x.spool_demand = play_output(moved, m.steering.valve_hysteresis)
    board[Board.MIDDLE_JOINT, lane] = x.joint
    x.g = steering_geometry(m.steering, x.joint)
    x.circuit = load_steering(board, lane, m.varies_laws)
    x.mount = load_mount(board, lane)
    x.gas = steering_gas(m.oil, x.circuit)
    x.cylinder_rate = x.joint_rate
    x.joint_end = steering_torque(m.oil, x.g, x.circuit)
    if m.joint.mount_stiffness > 0.0:
        x.cylinder_rate = x.mount.rate
        x.joint_end = mount_bears(m, x)
    x.joint_sum = 0.5 * x.joint_end
    return x


@wp.func
def note_quotients_of_steering(m: MachineRecord, dt: float):
    """Quotients of parameters that each substep of ``dt`` [s] asks for, by the default laws."""
    s = m.steering
    note(s.valve_shock_flow / s.valve_shock_ramp)
    note(dt / s.valve_spool_time_constant)
    note(0.5 * dt / (s.valve_compensator_pressure * s.valve_compensator_time_constant))
    note(dt / s.pump_ls_time_constant)
    note(1.0 / (s.pump_control_band * s.pump_stroke_up_time))
    note(-1.0 / s.pump_stroke_down_time)
    note(1.0 / s.pump_stroke_up_time)
    note(s.pump_relief_flow / s.pump_relief_ramp)
    note(s.tank_line_back_flow / s.tank_line_back_pressure_ramp)
    note(s.tank_line_back_pressure_ramp / s.tank_line_back_flow)
    note(m.oil.bulk_modulus / port_nominal_volume(s))


@wp.func
def note_quotients_of_arms(m: MachineRecord):
    """Likewise of the arms."""
    a = m.arm
    fixed = a.hose_volume + a.cylinder_dead_volume
    note(a.valve_port_flow / a.valve_port_ramp)
    note(m.oil.bulk_modulus / (fixed + 0.5 * a.cylinder_bore_area * a.cylinder_linkage.stroke))
    note(m.oil.bulk_modulus / (fixed + 0.5 * a.cylinder_annulus_area * a.cylinder_linkage.stroke))


@wp.func
def tell_pressures(board: wp.array2d(dtype=float), lane: int, x: SteeringRole):
    """Supply and return line, to the arms."""
    board[State.SUPPLY, lane] = x.circuit.supply
    board[State.TANK_LINE, lane] = x.circuit.tank_line


@wp.func
def arms_exchange(board: wp.array2d(dtype=float), lane: int):
    """What all arms take, as their warps told it."""
    out = Exchange()
    out.supply_flow = board[DRAWN, lane] + board[DRAWN + 1, lane]
    out.tank_flow = board[RETURNED, lane] + board[RETURNED + 1, lane]
    out.load_pressure = wp.max(board[BORNE, lane], board[BORNE + 1, lane])
    return out


@wp.func
def steering_fills(
    m: MachineRecord, x: SteeringRole, q: SteeringFlows, begun: SteeringState, arms: Exchange, substep: int, dt: float
):
    """The steering after a substep of ``dt`` [s], with the cylinders on their mount where there is one."""
    out = x
    s = steering_fill(
        m.steering, m.oil, x.gas, x.g, x.engine_speed, x.cylinder_rate, arms, q, x.circuit, begun, dt
    )
    out.circuit = s
    out.joint_end = steering_torque(m.oil, x.g, s)
    if m.joint.mount_stiffness > 0.0:
        angle = x.joint + float(substep) * dt * x.joint_rate
        out.mount = cylinders_step(m.joint, m.steering, m.oil, x.g, s, angle, x.joint_rate, x.mount, dt)
        out.cylinder_rate = out.mount.rate
        out.joint_end = mount_bears(m, out)
    out.joint_sum = x.joint_sum + out.joint_end
    out.flow_in = x.flow_in + s.flow_in
    out.flow_out = x.flow_out + s.flow_out
    return out


@wp.func
def steering_ends(m: MachineRecord, board: wp.array2d(dtype=float), lane: int, x: SteeringRole, share: float, h: float):
    """Leave circuit and mount on the board, and all that turns the joint in the middle of the main step; ``share`` is one
    over the number of substeps."""
    oil_torque = share * (x.joint_sum - 0.5 * x.joint_end)
    s = x.circuit
    s.flow_in = share * x.flow_in
    s.flow_out = share * x.flow_out
    mount = x.mount
    torque = oil_torque
    if m.joint.mount_stiffness == 0.0:
        middle = x.joint_rate + 0.5 * h * board[State.JOINT_ACCELERATION, lane]
        torque, friction = rigid_joint_torque(
            m.joint, m.steering, m.oil, x.g, x.joint, middle, x.joint_rate, oil_torque, s, mount.friction,
            least_inertia(m.frame_front, m.frame_rear), h,
        )  # fmt: skip
        mount.friction = friction
    board[Board.JOINT_TORQUE, lane] = torque
    store_steering(board, lane, s, m.varies_laws)
    store_mount(board, lane, mount)


# ---- arms -----------------------------------------------------------------------------------------------------------


@wp.struct
class ArmsRole:
    """What a warp of arms keeps of a twin's left and right arm over the substeps."""

    left: ArmState
    right: ArmState
    gas_left: ArmGas
    gas_right: ArmGas
    g_left: ArmGeometry
    g_right: ArmGeometry
    rate_left: float  # [rad/s]
    rate_right: float
    sum_left: float  # [N m]
    sum_right: float


@wp.func
def chambers_of_arm(m: MachineRecord, board: wp.array2d(dtype=float), i: int, lane: int, signal: float, h: float):
    """Chambers of arm ``i`` in the middle of the main step of ``h`` [s]; its spool follows the ``signal``."""
    old = board[int(State.ARM_SPOOL_FL) + i, lane]
    new = lag(old, signal, m.arm.valve_time_constant, m.arm.valve_rate_limit, h)
    board[int(State.ARM_SPOOL_FL) + i, lane] = new
    angle = board[int(State.ARM_FL) + i, lane] + 0.5 * h * board[int(State.ARM_RATE_FL) + i, lane]
    board[int(Board.MIDDLE_ARM_FL) + i, lane] = angle
    return arm_geometry(m.arm, angle, 0.5 * (old + new))


@wp.func
def arms_begin(
    m: MachineRecord, board: wp.array2d(dtype=float), i: int, lane: int, signal_left: float, signal_right: float, h: float
):
    """The left arm ``i`` and the right one of its pair in a main step of ``h`` [s]."""
    x = ArmsRole()
    x.g_left = chambers_of_arm(m, board, i, lane, signal_left, h)
    x.g_right = chambers_of_arm(m, board, i + 1, lane, signal_right, h)
    x.left = load_arm(board, i, lane)
    x.right = load_arm(board, i + 1, lane)
    if m.varies_laws > 0:
        x.left = load_compensator(board, i, lane, x.left)
        x.right = load_compensator(board, i + 1, lane, x.right)
    x.gas_left = arm_gas(m.oil, x.left)
    x.gas_right = arm_gas(m.oil, x.right)
    x.rate_left = board[int(State.ARM_RATE_FL) + i, lane]
    x.rate_right = board[int(State.ARM_RATE_FL) + i + 1, lane]
    x.sum_left = 0.5 * arm_oil_torque(m.oil, x.g_left, x.left)
    x.sum_right = 0.5 * arm_oil_torque(m.oil, x.g_right, x.right)
    return x


@wp.func
def arms_flow(m: MachineRecord, board: wp.array2d(dtype=float), pair: int, lane: int, x: ArmsRole, dt: float):
    """Flows of both arms over a substep of ``dt`` [s] from the pressures that steering told, and what it is told of them in
    turn."""
    supply = pressure(m.oil, board[State.SUPPLY, lane])
    tank = pressure(m.oil, board[State.TANK_LINE, lane])
    left = arm_flows(m.arm, m.arm_valve, m.oil, x.g_left, x.rate_left, supply, tank, x.left, dt)
    right = arm_flows(m.arm, m.arm_valve, m.oil, x.g_right, x.rate_right, supply, tank, x.right, dt)
    board[DRAWN + pair, lane] = left.drawn + right.drawn
    board[RETURNED + pair, lane] = left.returned + right.returned
    board[BORNE + pair, lane] = wp.max(left.load, right.load)
    return left, right


@wp.func
def arms_fill(
    m: MachineRecord, x: ArmsRole, bore_left: float, rod_left: float, bore_right: float, rod_right: float, dt: float
):
    """Both arms after a substep of ``dt`` [s] with net flows [m³/s] into their chambers."""
    out = x
    out.left = arm_fill(m.arm, m.oil, x.gas_left, x.g_left, x.left, bore_left, rod_left, dt)
    out.right = arm_fill(m.arm, m.oil, x.gas_right, x.g_right, x.right, bore_right, rod_right, dt)
    out.sum_left = x.sum_left + arm_oil_torque(m.oil, x.g_left, out.left)
    out.sum_right = x.sum_right + arm_oil_torque(m.oil, x.g_right, out.right)
    return out


@wp.func
def arms_end(m: MachineRecord, board: wp.array2d(dtype=float), i: int, lane: int, x: ArmsRole, share: float):
    """Leave the oil of both arms on the board, and its mean torques."""
    last_left = arm_oil_torque(m.oil, x.g_left, x.left)
    last_right = arm_oil_torque(m.oil, x.g_right, x.right)
    row = OIL_ARM + LOAD_ROWS * i
    board[row, lane] = share * (x.sum_left - 0.5 * last_left)
    board[row + LOAD_ROWS, lane] = share * (x.sum_right - 0.5 * last_right)
    store_arm(board, i, lane, x.left)
    store_arm(board, i + 1, lane, x.right)
    if m.varies_laws > 0:
        store_compensator(board, i, lane, x.left)
        store_compensator(board, i + 1, lane, x.right)


# ---- driveline ------------------------------------------------------------------------------------------------------


@wp.struct
class DrivelineRole:
    """What the driveline's warp keeps of a twin over the substeps."""

    loop: DrivelineState
    gas: DrivelineGas
    control: DrivelineControl
    rate: wp.vec4  # [rad/s] of the wheels against their arms
    sum: wp.vec4  # [Pa]


@wp.func
def driveline_begins(m: MachineRecord, board: wp.array2d(dtype=float), lane: int, signals: Signals, h: float):
    """The driveline of a main step of ``h`` [s]: its actuators, wheel rates and oil."""
    x = DrivelineRole()
    velocity = load_velocity(board, lane)
    to_rear = hinge_rotation(board[State.JOINT, lane] + 0.5 * h * velocity.joint)
    x.rate = wheel_rates(velocity.angular, rear_rate(to_rear, velocity), velocity.arms, velocity.spins)
    store4(board, int(Board.WHEEL_RATE_FL), lane, x.rate)
    old = load_actuators(board, lane)
    new = actuators_step(m, signals, 0.0, old, h)
    board[State.DRIVE_SWASH, lane] = new.drive_swash
    board[State.SHIFT_FRONT, lane] = new.shift_front
    board[State.SHIFT_REAR, lane] = new.shift_rear
    store4(board, int(State.TRACTION_FL), lane, new.traction)
    x.control = driveline_control(m.driveline.motor_displacement, old, new, board[State.ENGINE_SPEED, lane])
    board[Board.MOTOR_FRONT, lane] = x.control.displacement_front
    board[Board.MOTOR_REAR, lane] = x.control.displacement_rear
    x.loop = load_loop(board, lane)
    x.gas = driveline_gas(m.oil, x.loop)
    x.sum = 0.5 * motor_pressures(m.oil, x.loop)
    return x


@wp.func
def driveline_moves(m: MachineRecord, x: DrivelineRole, dt: float):
    """The driveline after a substep of ``dt`` [s]."""
    out = x
    out.loop = driveline_step(m.driveline, m.oil, x.gas, x.control, x.rate, x.loop, dt)
    out.sum = x.sum + motor_pressures(m.oil, out.loop)
    return out


@wp.func
def driveline_ends(m: MachineRecord, board: wp.array2d(dtype=float), lane: int, x: DrivelineRole, share: float):
    """Leave the closed loop on the board, and the mean pressures over the motors."""
    mean = share * (x.sum - 0.5 * motor_pressures(m.oil, x.loop))
    for i in range(4):
        board[OIL_MOTOR + LOAD_ROWS * i, lane] = mean[i]
    store_loop(board, lane, x.loop)
