"""Roles after the substeps: one corner a warp, then the tree of bodies, then the oil that takes up what they moved.

All begin with the pose at the end of the last main step, which stays on the board until the tree has moved it: where a role
needs the middle of the step, it goes there itself.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from typing import Any

import warp as wp

from aoro_gym.twin.kernels.corners import CornerStart, Half, HullLoads, corner_step, hull_corner_loads
from aoro_gym.twin.kernels.hydraulics import Signals, pumps_torque
from aoro_gym.twin.kernels.motion import drift, kick, rear_rate, rear_rate_change, turn, wheel_rates
from aoro_gym.twin.kernels.outputs import GroundContact, record_outputs
from aoro_gym.twin.kernels.roles.board import HULL_ROWS, LOAD_ROWS, MOVED, OIL_ARM, OIL_MOTOR, Board
from aoro_gym.twin.kernels.state import (
    Pose,
    Velocity,
    load3,
    load4,
    load_actuators,
    load_arm,
    load_change,
    load_circuits,
    load_engine,
    load_loop,
    load_pose,
    load_steering,
    load_velocity,
    store3,
    store4,
    store_arm,
    store_change,
    store_engine,
    store_loop,
    store_pose,
    store_velocity,
)
from aoro_gym.twin.kernels.tree import tree
from aoro_gym.twin.physics.arms import arm_displace, arm_geometry
from aoro_gym.twin.physics.bodies import CornerLoad, hinge_rotation
from aoro_gym.twin.physics.driveline import DrivelineControl, driveline_displace
from aoro_gym.twin.physics.engine import engine_step
from aoro_gym.twin.physics.steering import steering_displace, steering_geometry
from aoro_gym.twin.records import MachineRecord, State

TWO_PI = wp.constant(6.283185307179586)


@wp.func
def middle_pose(board: wp.array2d(dtype=float), lane: int, velocity: Velocity, half: float):
    """Pose in the middle of the main step but for the wheels, and the front frame's rotation there."""
    pose = load_pose(board, lane)
    pose.orientation = turn(pose.orientation, velocity.angular, half)
    rotation = wp.quat_to_matrix(pose.orientation)
    return drift(pose, velocity, rotation, half), rotation


@wp.func
def half_of(
    m: MachineRecord,
    board: wp.array2d(dtype=float),
    lane: int,
    rear: bool,
    pose: Pose,
    rotation: wp.mat33,
    to_rear: wp.mat33,
    middle: Velocity,
):
    """The front or the ``rear`` half of the vehicle in the middle of the main step, which moves there by ``middle``."""
    out = Half(
        1.0, m.frame_front.pivot_x, rotation, pose.position, middle.linear, middle.angular,
        board[Board.MOTOR_FRONT, lane],
    )  # fmt: skip
    if rear:
        out = Half(
            -1.0, m.frame_rear.pivot_x, rotation * wp.transpose(to_rear), pose.position, to_rear * middle.linear,
            rear_rate(to_rear, middle), board[Board.MOTOR_REAR, lane],
        )  # fmt: skip
    return out


@wp.func
def corner_role(
    m: MachineRecord,
    terrain: Any,
    ground: Any,
    board: wp.array2d(dtype=float),
    i: int,
    lane: int,
    parking_brake: float,
    h: float,
):
    """Corner ``i`` (fl, fr, rl, rr) over a main step of ``h`` [s]: arm, wheel, tire and ground; and what the ground does to
    four of its frame's corners."""
    half = 0.5 * h
    rear = i >= 2
    velocity = load_velocity(board, lane)
    change = load_change(board, lane)
    pose, rotation = middle_pose(board, lane, velocity, half)
    to_rear = hinge_rotation(pose.joint)
    middle = kick(velocity, change, half)
    side = half_of(m, board, lane, rear, pose, rotation, to_rear, middle)
    turning = change.angular[1]
    if rear:
        turning = rear_rate_change(to_rear, velocity, change)[1]

    x = CornerStart()
    arm_change = board[int(State.ARM_ACCELERATION_FL) + i, lane]
    x.start_arm_rate = board[int(State.ARM_RATE_FL) + i, lane]
    x.angle = board[int(Board.MIDDLE_ARM_FL) + i, lane]
    x.arm_rate = x.start_arm_rate + half * arm_change
    x.spin_change = board[int(State.SPIN_ACCELERATION_FL) + i, lane]
    x.spin = board[int(State.SPIN_FL) + i, lane] + half * x.spin_change
    x.start_wheel_rate = board[int(Board.WHEEL_RATE_FL) + i, lane]
    x.wheel_rate = x.start_wheel_rate + half * (x.spin_change - turning + side.direction * arm_change)
    x.oil_torque = board[OIL_ARM + LOAD_ROWS * i, lane]
    x.motor_pressure = board[OIL_MOTOR + LOAD_ROWS * i, lane]
    watch(board, lane, x.oil_torque + x.motor_pressure)
    x.bristle_x = board[int(State.BRISTLE_X_FL) + i, lane]
    x.bristle_y = board[int(State.BRISTLE_Y_FL) + i, lane]
    x.arm_deflection = board[int(State.ARM_FRICTION_FL) + i, lane]
    x.wheel_deflection = board[int(State.WHEEL_FRICTION_FL) + i, lane]
    x.twist = board[int(State.TWIST_FL) + i, lane]
    contact = corner_step(
        m, terrain, ground, side, 1.0 - 2.0 * float(i & 1), arm_geometry(m.arm, x.angle, 0.0),
        load_arm(board, i, lane), x, parking_brake, h,
    )  # fmt: skip
    board[int(State.BRISTLE_X_FL) + i, lane] = contact.bristle_x
    board[int(State.BRISTLE_Y_FL) + i, lane] = contact.bristle_y
    board[int(State.ARM_FRICTION_FL) + i, lane] = contact.arm_deflection
    board[int(State.WHEEL_FRICTION_FL) + i, lane] = contact.wheel_deflection
    board[int(State.TWIST_FL) + i, lane] = contact.twist
    board[int(Board.NORMAL_FL) + i, lane] = contact.normal
    board[int(Board.KNOWN_FL) + i, lane] = contact.known
    tell_load(board, i, lane, contact.load)

    frame = m.frame_front
    if rear:
        frame = m.frame_rear
    hull = HullLoads()
    for number in range(4):
        hull = hull_corner_loads(
            hull, m.hull, frame, m.frame_ground_clearance, terrain, ground, side, 4 * (i & 1) + number
        )
    row = int(Board.HULL_0_FL) + HULL_ROWS * i
    store3(board, row, lane, hull.force)
    store3(board, row + 3, lane, hull.moment)
    board[row + 6, lane] = hull.touch


@wp.func
def tell_load(board: wp.array2d(dtype=float), i: int, lane: int, load: CornerLoad):
    """The load of corner ``i``, to the role of the tree."""
    row = int(Board.LOAD_0_FL) + LOAD_ROWS * i
    board[row, lane] = load.arm_torque
    board[row + 1, lane] = load.wheel_torque
    store3(board, row + 2, lane, load.force)
    store3(board, row + 5, lane, load.moment)


@wp.func
def told_load(board: wp.array2d(dtype=float), i: int, lane: int, pose: Pose, middle: Velocity):
    """The load that the role of corner ``i`` told, with its motion in the middle of the step."""
    row = int(Board.LOAD_0_FL) + LOAD_ROWS * i
    return CornerLoad(
        pose.arms[i], middle.arms[i], middle.spins[i], board[row, lane], board[row + 1, lane],
        load3(board, row + 2, lane), load3(board, row + 5, lane),
    )  # fmt: skip


@wp.func
def told_hull(board: wp.array2d(dtype=float), i: int, lane: int):
    """What the ground does to the frame of corner ``i`` and the next one, each of whose roles told a half of it."""
    row = int(Board.HULL_0_FL) + HULL_ROWS * i
    other = row + HULL_ROWS
    return HullLoads(
        load3(board, row, lane) + load3(board, other, lane),
        load3(board, row + 3, lane) + load3(board, other + 3, lane),
        board[row + 6, lane] + board[other + 6, lane],
    )


@wp.func
def bodies_role(
    m: MachineRecord, laws: Any, gravity: float, board: wp.array2d(dtype=float), state: wp.array2d(dtype=float), lane: int,
    t: int, h: float,
):  # fmt: skip
    """The tree of bodies under all loads over a main step of ``h`` [s]: pose and velocity at its end, and by how much joint,
    arms and wheels moved beyond their old velocity."""
    half = 0.5 * h
    start = load_velocity(board, lane)
    pose, rotation = middle_pose(board, lane, start, half)
    to_rear = hinge_rotation(pose.joint)
    middle = kick(start, load_change(board, lane), half)
    weight = wp.transpose(rotation) * wp.vec3(0.0, 0.0, -gravity)
    change = tree(
        m, laws, state, t, weight, to_rear, middle, board[Board.JOINT_TORQUE, lane],
        told_load(board, 0, lane, pose, middle), told_load(board, 1, lane, pose, middle),
        told_load(board, 2, lane, pose, middle), told_load(board, 3, lane, pose, middle), told_hull(board, 0, lane),
        told_hull(board, 2, lane), h,
    )  # fmt: skip
    velocity = kick(start, change, h)
    pose = drift(pose, velocity, rotation, half)
    pose.orientation = turn(pose.orientation, velocity.angular, half)
    omega_rear = rear_rate(hinge_rotation(pose.joint), velocity)
    end_rate = wheel_rates(velocity.angular, omega_rear, velocity.arms, velocity.spins)
    start_rate = load4(board, int(Board.WHEEL_RATE_FL), lane)
    wheels = pose.wheels + half * start_rate + half * end_rate
    for i in range(4):
        wheels[i] = wheels[i] - TWO_PI * wp.floor(wheels[i] / TWO_PI)
    pose.wheels = wheels
    store_pose(board, lane, pose)
    store_velocity(board, lane, velocity)
    store_change(board, lane, change)
    board[MOVED, lane] = half * (velocity.joint - start.joint)
    store4(board, MOVED + 1, lane, half * (velocity.arms - start.arms))
    store4(board, MOVED + 5, lane, half * (end_rate - start_rate))
    watch(
        board, lane,
        wp.length(pose.position) + wp.length(velocity.linear) + wp.length(velocity.angular) + velocity.joint
        + wp.length(velocity.arms) + wp.length(velocity.spins),
    )  # fmt: skip


@wp.func
def watch(board: wp.array2d(dtype=float), lane: int, total: float):
    """The twin no longer runs if the ``total`` of what a role has is not finite."""
    if not wp.isfinite(total):
        board[Board.ALIVE, lane] = 0.0


@wp.func
def steering_takes_up(m: MachineRecord, board: wp.array2d(dtype=float), lane: int):
    """The oil of the steering takes up what the joint moved beyond its old velocity: volumes stay exact."""
    g = steering_geometry(m.steering, board[Board.MIDDLE_JOINT, lane])
    s = steering_displace(m.steering, m.oil, g, board[MOVED, lane], load_steering(board, lane, m.varies_laws))
    board[State.PORT_A, lane] = s.port_a
    board[State.PORT_B, lane] = s.port_b
    watch(board, lane, s.supply + s.port_a + s.port_b + s.tank_line)


@wp.func
def arm_takes_up(m: MachineRecord, board: wp.array2d(dtype=float), i: int, lane: int):
    """Likewise the oil of arm ``i``."""
    g = arm_geometry(m.arm, board[int(Board.MIDDLE_ARM_FL) + i, lane], 0.0)
    store_arm(board, i, lane, arm_displace(m.arm, m.oil, g, board[MOVED + 1 + i, lane], load_arm(board, i, lane)))


@wp.func
def driveline_takes_up(m: MachineRecord, board: wp.array2d(dtype=float), lane: int, h: float):
    """Likewise the closed loop; and the engine after a main step of ``h`` [s] under all pumps."""
    control = DrivelineControl()
    control.displacement_front = board[Board.MOTOR_FRONT, lane]
    control.displacement_rear = board[Board.MOTOR_REAR, lane]
    moved = load4(board, MOVED + 5, lane)
    circuits = load_circuits(board, lane, 0)
    circuits.driveline = driveline_displace(m.driveline, m.oil, control, moved, load_loop(board, lane))
    store_loop(board, lane, circuits.driveline)
    torque = pumps_torque(m, circuits, board[State.DRIVE_SWASH, lane])
    engine = engine_step(m.engine, load_engine(board, lane), torque, h)
    store_engine(board, lane, engine)
    watch(board, lane, circuits.driveline.charge + engine.speed)


@wp.func
def tell_outputs(
    m: MachineRecord,
    terrain: Any,
    board: wp.array2d(dtype=float),
    outputs: wp.array3d(dtype=float),
    frame: int,
    signals: Signals,
    lane: int,
    t: int,
):
    """Outputs at the end of a frame, from the board."""
    contact = GroundContact(
        load4(board, int(Board.NORMAL_FL), lane),
        load4(board, int(Board.KNOWN_FL), lane),
        told_hull(board, 0, lane).touch + told_hull(board, 2, lane).touch,
    )
    record_outputs(
        outputs, frame, t, m, signals, load_pose(board, lane), load_velocity(board, lane), load_actuators(board, lane),
        load_circuits(board, lane, m.varies_laws), load_engine(board, lane), contact, terrain,
    )  # fmt: skip
