"""The state of one twin in structs: loaded once a launch, kept in registers, stored once."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

from aoro_gym.twin.physics.arms import ArmState
from aoro_gym.twin.physics.bodies import Accelerations
from aoro_gym.twin.physics.driveline import DrivelineState
from aoro_gym.twin.physics.engine import EngineState
from aoro_gym.twin.physics.mount import MountState
from aoro_gym.twin.physics.steering_circuit import SteeringLawState, SteeringState
from aoro_gym.twin.records import State


@wp.struct
class Pose:
    """Where the bodies are."""

    position: wp.vec3  # [m] of the hinge's origin
    remainder: wp.vec3  # [m] that float32 rounds off the position
    orientation: wp.quat  # front frame → world
    joint: float  # [rad]
    arms: wp.vec4  # [rad]
    wheels: wp.vec4  # [rad]


@wp.struct
class Velocity:
    """How the bodies move; its derivatives are :class:`aoro_gym.twin.physics.bodies.Accelerations`."""

    linear: wp.vec3  # [m/s] of the hinge's origin, front frame
    angular: wp.vec3  # [rad/s] front frame
    joint: float  # [rad/s]
    arms: wp.vec4  # [rad/s]
    spins: wp.vec4  # [rad/s] absolute wheel spins


@wp.struct
class Deflections:
    """Deflections of the friction elements at the corners."""

    bristle_x: wp.vec4  # [m]
    bristle_y: wp.vec4
    arms: wp.vec4  # [rad] seals of the arms' cylinders
    wheels: wp.vec4  # [rad] brakes
    twist: wp.vec4  # [rad] of the tires' patches


@wp.struct
class Actuators:
    """What follows the commands slowly."""

    play: float  # [-] output of the steering valve's hysteresis
    arm_spools: wp.vec4  # [-] −1 … 1
    drive_swash: float  # [-] −1 … 1 of pump 1
    shift_front: float  # [-] displacement of the motors over its largest
    shift_rear: float
    traction: wp.vec4  # [-] openings of the traction valves


@wp.struct
class Circuits:
    """Oil in all circuits, and the steering cylinders on their mounts."""

    steering: SteeringState
    mount: MountState
    fl: ArmState
    fr: ArmState
    rl: ArmState
    rr: ArmState
    driveline: DrivelineState


@wp.struct
class OilLoads:
    """What the oil does to the bodies, on the mean over a main step."""

    joint: float  # [N m] or the mount, where there is one
    arms: wp.vec4  # [N m] raises them
    motors: wp.vec4  # [Pa] over each motor


@wp.func
def load3(state: wp.array2d(dtype=float), row: int, t: int):
    return wp.vec3(state[row, t], state[row + 1, t], state[row + 2, t])


@wp.func
def load4(state: wp.array2d(dtype=float), row: int, t: int):
    return wp.vec4(state[row, t], state[row + 1, t], state[row + 2, t], state[row + 3, t])


@wp.func
def store3(state: wp.array2d(dtype=float), row: int, t: int, value: wp.vec3):
    state[row, t] = value[0]
    state[row + 1, t] = value[1]
    state[row + 2, t] = value[2]


@wp.func
def store4(state: wp.array2d(dtype=float), row: int, t: int, value: wp.vec4):
    state[row, t] = value[0]
    state[row + 1, t] = value[1]
    state[row + 2, t] = value[2]
    state[row + 3, t] = value[3]


@wp.func
def load_law_state(state: wp.array2d(dtype=float), t: int):
    return SteeringLawState(
        state[State.SPOOL_RATE, t], state[State.COMPENSATOR_RATE, t], state[State.PUMP_VALVE, t], state[State.SHOCK_A, t],
        state[State.SHOCK_B, t], state[State.HOSE_STRAIN_A, t], state[State.HOSE_STRAIN_B, t], state[State.HOSE_A, t],
        state[State.HOSE_B, t], state[State.HOSE_FLOW_A, t], state[State.HOSE_FLOW_B, t],
    )


@wp.func
def store_law_state(state: wp.array2d(dtype=float), t: int, law: SteeringLawState):
    state[State.SPOOL_RATE, t] = law.spool_rate
    state[State.COMPENSATOR_RATE, t] = law.compensator_rate
    state[State.PUMP_VALVE, t] = law.pump_valve
    state[State.SHOCK_A, t] = law.shock_a
    state[State.SHOCK_B, t] = law.shock_b
    state[State.HOSE_STRAIN_A, t] = law.hose_strain_a
    state[State.HOSE_STRAIN_B, t] = law.hose_strain_b
    state[State.HOSE_A, t] = law.hose_a
    state[State.HOSE_B, t] = law.hose_b
    state[State.HOSE_FLOW_A, t] = law.hose_flow_a
    state[State.HOSE_FLOW_B, t] = law.hose_flow_b


@wp.func
def load_pose(state: wp.array2d(dtype=float), t: int):
    pose = Pose()
    pose.position = load3(state, int(State.X), t)
    pose.remainder = load3(state, int(State.REST_X), t)
    pose.orientation = wp.quat(state[State.QX, t], state[State.QY, t], state[State.QZ, t], state[State.QW, t])
    pose.joint = state[State.JOINT, t]
    pose.arms = load4(state, int(State.ARM_FL), t)
    pose.wheels = load4(state, int(State.WHEEL_FL), t)
    return pose


@wp.func
def store_pose(state: wp.array2d(dtype=float), t: int, pose: Pose):
    store3(state, int(State.X), t, pose.position)
    store3(state, int(State.REST_X), t, pose.remainder)
    for i in range(4):
        state[int(State.QX) + i, t] = pose.orientation[i]
    state[State.JOINT, t] = pose.joint
    store4(state, int(State.ARM_FL), t, pose.arms)
    store4(state, int(State.WHEEL_FL), t, pose.wheels)


@wp.func
def load_velocity(state: wp.array2d(dtype=float), t: int):
    velocity = Velocity()
    velocity.linear = load3(state, int(State.VX), t)
    velocity.angular = load3(state, int(State.WX), t)
    velocity.joint = state[State.JOINT_RATE, t]
    velocity.arms = load4(state, int(State.ARM_RATE_FL), t)
    velocity.spins = load4(state, int(State.SPIN_FL), t)
    return velocity


@wp.func
def store_velocity(state: wp.array2d(dtype=float), t: int, velocity: Velocity):
    store3(state, int(State.VX), t, velocity.linear)
    store3(state, int(State.WX), t, velocity.angular)
    state[State.JOINT_RATE, t] = velocity.joint
    store4(state, int(State.ARM_RATE_FL), t, velocity.arms)
    store4(state, int(State.SPIN_FL), t, velocity.spins)


@wp.func
def load_change(state: wp.array2d(dtype=float), t: int):
    change = Accelerations()
    change.linear = load3(state, int(State.AVX), t)
    change.angular = load3(state, int(State.AWX), t)
    change.joint = state[State.JOINT_ACCELERATION, t]
    change.arms = load4(state, int(State.ARM_ACCELERATION_FL), t)
    change.spins = load4(state, int(State.SPIN_ACCELERATION_FL), t)
    return change


@wp.func
def store_change(state: wp.array2d(dtype=float), t: int, change: Accelerations):
    store3(state, int(State.AVX), t, change.linear)
    store3(state, int(State.AWX), t, change.angular)
    state[State.JOINT_ACCELERATION, t] = change.joint
    store4(state, int(State.ARM_ACCELERATION_FL), t, change.arms)
    store4(state, int(State.SPIN_ACCELERATION_FL), t, change.spins)


@wp.func
def load_actuators(state: wp.array2d(dtype=float), t: int):
    actuators = Actuators()
    actuators.play = state[State.PLAY, t]
    actuators.arm_spools = load4(state, int(State.ARM_SPOOL_FL), t)
    actuators.drive_swash = state[State.DRIVE_SWASH, t]
    actuators.shift_front = state[State.SHIFT_FRONT, t]
    actuators.shift_rear = state[State.SHIFT_REAR, t]
    actuators.traction = load4(state, int(State.TRACTION_FL), t)
    return actuators


@wp.func
def load_steering(state: wp.array2d(dtype=float), t: int, varies_laws: int):
    """The steering circuit of twin ``t``; states of laws other than the default ones only if they ``varies_laws``."""
    steering = SteeringState()
    steering.supply = state[State.SUPPLY, t]
    steering.port_a = state[State.PORT_A, t]
    steering.port_b = state[State.PORT_B, t]
    steering.tank_line = state[State.TANK_LINE, t]
    steering.ls_pressure = state[State.LS_PRESSURE, t]
    steering.spool = state[State.SPOOL, t]
    steering.compensator = state[State.COMPENSATOR, t]
    steering.swash = state[State.SWASH, t]
    steering.flow_in = state[State.FLOW_IN, t]
    steering.flow_out = state[State.FLOW_OUT, t]
    if varies_laws > 0:
        steering.law = load_law_state(state, t)
    return steering


@wp.func
def store_steering(state: wp.array2d(dtype=float), t: int, s: SteeringState, varies_laws: int):
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
    if varies_laws > 0:
        store_law_state(state, t, s.law)


@wp.func
def load_mount(state: wp.array2d(dtype=float), t: int):
    return MountState(state[State.MOUNT, t], state[State.MOUNT_RATE, t], state[State.JOINT_FRICTION, t])


@wp.func
def store_mount(state: wp.array2d(dtype=float), t: int, mount: MountState):
    state[State.MOUNT, t] = mount.deflection
    state[State.MOUNT_RATE, t] = mount.rate
    state[State.JOINT_FRICTION, t] = mount.friction


@wp.func
def load_arm(state: wp.array2d(dtype=float), i: int, t: int):
    """Oil of arm ``i`` (fl, fr, rl, rr)."""
    return ArmState(state[int(State.ARM_BORE_FL) + i, t], state[int(State.ARM_ROD_FL) + i, t], 0.0)


@wp.func
def load_compensator(state: wp.array2d(dtype=float), i: int, t: int, arm: ArmState):
    """``arm`` with the compensator of arm ``i``, which only dynamic sections have."""
    out = arm
    out.compensator = state[int(State.ARM_COMPENSATOR_FL) + i, t]
    return out


@wp.func
def store_arm(state: wp.array2d(dtype=float), i: int, t: int, arm: ArmState):
    state[int(State.ARM_BORE_FL) + i, t] = arm.bore
    state[int(State.ARM_ROD_FL) + i, t] = arm.rod


@wp.func
def store_compensator(state: wp.array2d(dtype=float), i: int, t: int, arm: ArmState):
    state[int(State.ARM_COMPENSATOR_FL) + i, t] = arm.compensator


@wp.func
def load_loop(state: wp.array2d(dtype=float), t: int):
    return DrivelineState(
        state[State.FORWARD, t], state[State.BACK, t], state[State.HOSE_FL, t], state[State.HOSE_FR, t],
        state[State.HOSE_RL, t], state[State.HOSE_RR, t], state[State.CHARGE, t],
    )


@wp.func
def store_loop(state: wp.array2d(dtype=float), t: int, loop: DrivelineState):
    state[State.FORWARD, t] = loop.forward
    state[State.BACK, t] = loop.back
    store4(state, int(State.HOSE_FL), t, wp.vec4(loop.wheel_fl, loop.wheel_fr, loop.wheel_rl, loop.wheel_rr))
    state[State.CHARGE, t] = loop.charge


@wp.func
def load_engine(state: wp.array2d(dtype=float), t: int):
    return EngineState(state[State.ENGINE_SPEED, t], state[State.GOVERNOR, t], state[State.ENGINE_TORQUE, t])


@wp.func
def store_engine(state: wp.array2d(dtype=float), t: int, engine: EngineState):
    state[State.ENGINE_SPEED, t] = engine.speed
    state[State.GOVERNOR, t] = engine.integral
    state[State.ENGINE_TORQUE, t] = engine.torque


@wp.func
def load_circuits(state: wp.array2d(dtype=float), t: int, varies_laws: int):
    """Oil in all circuits of twin ``t``, and the mount."""
    circuits = Circuits()
    circuits.steering = load_steering(state, t, varies_laws)
    circuits.mount = load_mount(state, t)
    circuits.fl = load_arm(state, 0, t)
    circuits.fr = load_arm(state, 1, t)
    circuits.rl = load_arm(state, 2, t)
    circuits.rr = load_arm(state, 3, t)
    if varies_laws > 0:
        circuits.fl = load_compensator(state, 0, t, circuits.fl)
        circuits.fr = load_compensator(state, 1, t, circuits.fr)
        circuits.rl = load_compensator(state, 2, t, circuits.rl)
        circuits.rr = load_compensator(state, 3, t, circuits.rr)
    circuits.driveline = load_loop(state, t)
    return circuits


@wp.func
def load_state(state: wp.array2d(dtype=float), t: int, varies_laws: int):
    """State of twin ``t`` by part of the machine; that of laws other than the default ones only if they ``varies_laws``."""
    bent = Deflections()
    bent.bristle_x = load4(state, int(State.BRISTLE_X_FL), t)
    bent.bristle_y = load4(state, int(State.BRISTLE_Y_FL), t)
    bent.arms = load4(state, int(State.ARM_FRICTION_FL), t)
    bent.wheels = load4(state, int(State.WHEEL_FRICTION_FL), t)
    bent.twist = load4(state, int(State.TWIST_FL), t)
    return (
        load_pose(state, t),
        load_velocity(state, t),
        load_change(state, t),
        bent,
        load_actuators(state, t),
        load_circuits(state, t, varies_laws),
        load_engine(state, t),
    )


@wp.func
def store_state(
    state: wp.array2d(dtype=float),
    t: int,
    pose: Pose,
    velocity: Velocity,
    change: Accelerations,
    bent: Deflections,
    actuators: Actuators,
    circuits: Circuits,
    engine: EngineState,
    varies_laws: int,
):
    """Inverse of :func:`load_state`."""
    store_pose(state, t, pose)
    store_velocity(state, t, velocity)
    store_change(state, t, change)
    store4(state, int(State.BRISTLE_X_FL), t, bent.bristle_x)
    store4(state, int(State.BRISTLE_Y_FL), t, bent.bristle_y)
    store4(state, int(State.ARM_FRICTION_FL), t, bent.arms)
    store4(state, int(State.WHEEL_FRICTION_FL), t, bent.wheels)
    store4(state, int(State.TWIST_FL), t, bent.twist)
    state[State.PLAY, t] = actuators.play
    store4(state, int(State.ARM_SPOOL_FL), t, actuators.arm_spools)
    state[State.DRIVE_SWASH, t] = actuators.drive_swash
    state[State.SHIFT_FRONT, t] = actuators.shift_front
    state[State.SHIFT_REAR, t] = actuators.shift_rear
    store4(state, int(State.TRACTION_FL), t, actuators.traction)
    store_steering(state, t, circuits.steering, varies_laws)
    store_mount(state, t, circuits.mount)
    store_arm(state, 0, t, circuits.fl)
    store_arm(state, 1, t, circuits.fr)
    store_arm(state, 2, t, circuits.rl)
    store_arm(state, 3, t, circuits.rr)
    if varies_laws > 0:
        store_compensator(state, 0, t, circuits.fl)
        store_compensator(state, 1, t, circuits.fr)
        store_compensator(state, 2, t, circuits.rl)
        store_compensator(state, 3, t, circuits.rr)
    store_loop(state, t, circuits.driveline)
    store_engine(state, t, engine)


@wp.func
def watched(pose: Pose, velocity: Velocity, circuits: Circuits, oil: OilLoads, engine: EngineState):
    """A sum that any NaN or infinity in a velocity or a pressure reaches within a main step."""
    steering = circuits.steering
    return (
        wp.length(pose.position) + wp.length(velocity.linear) + wp.length(velocity.angular) + velocity.joint
        + wp.length(velocity.arms) + wp.length(velocity.spins) + steering.supply + steering.port_a + steering.port_b
        + steering.tank_line + wp.length(oil.motors) + circuits.driveline.charge + wp.length(oil.arms)
        + engine.speed
    )


@wp.func
def rest(
    pose: Pose, change: Accelerations, bent: Deflections, actuators: Actuators, circuits: Circuits, engine: EngineState
):
    """Sum of the rest of the state, where a clamp could have hidden what is not finite from :func:`watched`."""
    q = pose.orientation
    steering = circuits.steering
    loop = circuits.driveline
    mount = circuits.mount
    return (
        pose.joint + wp.length(pose.arms) + wp.length(pose.wheels) + wp.length(pose.remainder) + q[0] + q[1] + q[2]
        + q[3] + wp.length(change.linear) + wp.length(change.angular) + change.joint + wp.length(change.arms)
        + wp.length(change.spins) + wp.length(bent.bristle_x) + wp.length(bent.bristle_y) + wp.length(bent.arms)
        + wp.length(bent.wheels) + wp.length(bent.twist) + mount.deflection + mount.rate + mount.friction
        + steering.ls_pressure + steering.spool + actuators.play + steering.compensator + steering.swash
        + steering.flow_in + steering.flow_out + steering.law.spool_rate + steering.law.compensator_rate
        + steering.law.pump_valve + steering.law.shock_a + steering.law.shock_b + steering.law.hose_strain_a
        + steering.law.hose_strain_b + steering.law.hose_a + steering.law.hose_b + steering.law.hose_flow_a
        + steering.law.hose_flow_b + circuits.fl.bore + circuits.fl.rod + circuits.fr.bore + circuits.fr.rod
        + circuits.rl.bore + circuits.rl.rod + circuits.rr.bore + circuits.rr.rod + wp.length(actuators.arm_spools)
        + circuits.fl.compensator + circuits.fr.compensator + circuits.rl.compensator + circuits.rr.compensator
        + loop.forward + loop.back + loop.wheel_fl + loop.wheel_fr + loop.wheel_rl + loop.wheel_rr
        + actuators.drive_swash + actuators.shift_front + actuators.shift_rear + wp.length(actuators.traction)
        + engine.integral + engine.torque
    )
