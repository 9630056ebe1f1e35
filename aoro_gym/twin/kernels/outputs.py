"""Outputs of one twin at the end of a frame."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from typing import Any

import warp as wp

from aoro_gym.twin.kernels.hydraulics import Signals
from aoro_gym.twin.kernels.motion import rear_rate, wheel_rates
from aoro_gym.twin.kernels.state import Actuators, Circuits, Pose, Velocity
from aoro_gym.twin.physics.bodies import hinge_rotation
from aoro_gym.twin.physics.driveline import motor_pressures
from aoro_gym.twin.physics.engine import EngineState
from aoro_gym.twin.physics.fluid import pressure
from aoro_gym.twin.physics.steering import steering_geometry
from aoro_gym.twin.records import MachineRecord, Output


@wp.struct
class GroundContact:
    """What the ground bore in the last main step."""

    wheel_load: wp.vec4  # [N]
    on_map: wp.vec4  # [-] share of each wheel's patch that lies on the map
    hull_force: float  # [N]


@wp.func
def record_outputs(
    outputs: wp.array3d(dtype=float),
    frame: int,
    t: int,
    m: MachineRecord,
    signals: Signals,
    pose: Pose,
    velocity: Velocity,
    actuators: Actuators,
    circuits: Circuits,
    engine: EngineState,
    contact: GroundContact,
    terrain: Any,
):
    """Write all rows of :class:`Output`, a line each; ``terrain`` is for grounds with rows of their own."""
    oil = m.oil
    steering = circuits.steering
    driveline = circuits.driveline
    omega_rear = rear_rate(hinge_rotation(pose.joint), velocity)
    rate = wheel_rates(velocity.angular, omega_rear, velocity.arms, velocity.spins)
    g = steering_geometry(m.steering, pose.joint)
    rotation = wp.quat_to_matrix(pose.orientation)
    drop = motor_pressures(oil, driveline)
    outputs[frame, Output.STEERING_SIGNAL, t] = signals.steering
    outputs[frame, Output.DRIVE_SIGNAL, t] = signals.drive
    outputs[frame, Output.JOINT_ANGLE, t] = pose.joint
    outputs[frame, Output.JOINT_RATE, t] = velocity.joint
    # oil into the port that the command pressurises
    pressurised = wp.where(signals.steering < 0.0, g.displacement_b, g.displacement_a)
    outputs[frame, Output.JOINT_FLOW, t] = pressurised * velocity.joint
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
    outputs[frame, Output.DRIVE_SWASH, t] = actuators.drive_swash
    outputs[frame, Output.SHIFT_FRONT, t] = actuators.shift_front
    outputs[frame, Output.SHIFT_REAR, t] = actuators.shift_rear
    outputs[frame, Output.ARM_PRESSURE_BORE_FL, t] = pressure(oil, circuits.fl.bore)
    outputs[frame, Output.ARM_PRESSURE_BORE_FR, t] = pressure(oil, circuits.fr.bore)
    outputs[frame, Output.ARM_PRESSURE_BORE_RL, t] = pressure(oil, circuits.rl.bore)
    outputs[frame, Output.ARM_PRESSURE_BORE_RR, t] = pressure(oil, circuits.rr.bore)
    outputs[frame, Output.ARM_PRESSURE_ROD_FL, t] = pressure(oil, circuits.fl.rod)
    outputs[frame, Output.ARM_PRESSURE_ROD_FR, t] = pressure(oil, circuits.fr.rod)
    outputs[frame, Output.ARM_PRESSURE_ROD_RL, t] = pressure(oil, circuits.rl.rod)
    outputs[frame, Output.ARM_PRESSURE_ROD_RR, t] = pressure(oil, circuits.rr.rod)
    for i in range(4):
        outputs[frame, int(Output.MOTOR_PRESSURE_FL) + i, t] = drop[i]
        outputs[frame, int(Output.WHEEL_RATE_FL) + i, t] = rate[i]
        outputs[frame, int(Output.ARM_ANGLE_FL) + i, t] = pose.arms[i]
        outputs[frame, int(Output.WHEEL_LOAD_FL) + i, t] = contact.wheel_load[i]
    outputs[frame, Output.ENGINE_SPEED, t] = engine.speed
    outputs[frame, Output.ENGINE_TORQUE, t] = engine.torque
    outputs[frame, Output.POSITION_X, t] = pose.position[0]
    outputs[frame, Output.POSITION_Y, t] = pose.position[1]
    outputs[frame, Output.POSITION_Z, t] = pose.position[2]
    outputs[frame, Output.ROLL, t] = wp.atan2(rotation[2, 1], rotation[2, 2])
    outputs[frame, Output.PITCH, t] = -wp.asin(wp.clamp(rotation[2, 0], -1.0, 1.0))
    outputs[frame, Output.YAW, t] = wp.atan2(rotation[1, 0], rotation[0, 0])
    outputs[frame, Output.SPEED, t] = velocity.linear[0]
    outputs[frame, Output.YAW_RATE, t] = velocity.angular[2]
    outputs[frame, Output.HULL_FORCE, t] = contact.hull_force
    off_map = float(0.0)
    for i in range(4):
        off_map += wp.where(contact.on_map[i] < 0.5, 1.0, 0.0)
    outputs[frame, Output.WHEELS_OFF_MAP, t] = off_map


@wp.func
def record_further_outputs(laws: Any, outputs: wp.array3d(dtype=float), frame: int, state: wp.array2d(dtype=float), t: int):
    """Write the rows of what only some machines have, a crane; of this one nothing."""
    return
