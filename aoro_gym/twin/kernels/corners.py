"""What the ground does to the machine: contacts, friction and torques at the four corners, and the frames' hulls."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from typing import Any

import warp as wp

from aoro_gym.twin.kernels.state import Deflections, OilLoads, Velocity
from aoro_gym.twin.physics.arms import ArmGeometry, ArmState, arm_seal_capacity, arm_torque
from aoro_gym.twin.physics.bodies import Accelerations, CornerLoad, FrameBody, arm_tangent, hull_corner, wheel_centre
from aoro_gym.twin.physics.friction import dry_friction, presliding
from aoro_gym.twin.physics.ground import ceiling, footing
from aoro_gym.twin.physics.tire_discs import wheel_contact
from aoro_gym.twin.physics.tires import Hull, TireContact, hull_contact
from aoro_gym.twin.records import MachineRecord


@wp.struct
class Half:
    """One half of the vehicle in the middle of a main step, in the axes of its frame."""

    direction: float  # +1 front, −1 rear
    pivot_x: float  # [m] of the arms' pivots
    rotation: wp.mat33  # frame → world
    origin: wp.vec3  # [m] of the hinge in the world
    velocity: wp.vec3  # [m/s] of the hinge's origin
    omega: wp.vec3  # [rad/s]
    displacement: float  # [m³/rad] of a motor


@wp.struct
class CornerStart:
    """What one corner begins a main step with."""

    angle: float  # [rad] of the arm, in the middle of the step
    start_arm_rate: float  # [rad/s] at the start
    arm_rate: float  # [rad/s] in the middle
    spin: float  # [rad/s] absolute, in the middle
    spin_change: float  # [rad/s²] in the last step
    start_wheel_rate: float  # [rad/s] against the arm, at the start
    wheel_rate: float  # [rad/s] in the middle
    oil_torque: float  # [N m] on the arm
    motor_pressure: float  # [Pa] over the motor
    bristle_x: float  # [m]
    bristle_y: float
    arm_deflection: float  # [rad]
    wheel_deflection: float
    twist: float


@wp.struct
class CornerContact:
    """One corner after a main step: its load, and its friction elements."""

    load: CornerLoad
    bristle_x: float  # [m]
    bristle_y: float
    arm_deflection: float  # [rad]
    wheel_deflection: float
    twist: float
    normal: float  # [N] the wheel's load
    known: float  # [-] share of the wheel's patch that lies on the map


@wp.func
def implicitly_damped(
    load: CornerLoad, contact: TireContact, damping: float, last: float, inertia: float, h: float
):
    """``load`` at the middle rate that this step's wheel acceleration a brings, not the ``last`` one's [rad/s²]:
    (I + c h/2) a = τ + c h/2 a_last, with c the ``damping`` [N m s/rad] of the brake and that of the tire, which can damp a
    light wheel faster than one step."""
    out = load
    damping_tire = contact.damping * contact.lever * contact.lever
    implicit = 0.5 * h * (damping + damping_tire)
    lacking = last - (load.wheel_torque + load.moment[1]) / inertia
    share = 0.5 * h * lacking * inertia / (inertia + implicit)
    out.wheel_torque += share * damping
    out.moment += wp.vec3(0.0, share * damping_tire, 0.0)
    out.force -= (share * contact.damping * contact.lever) * contact.forward
    return out


@wp.func
def corner_step(
    m: MachineRecord,
    terrain: Any,
    ground: Any,
    half: Half,
    side: float,
    # circuits
    g: ArmGeometry,
    cylinder: ArmState,
    x: CornerStart,
    parking_brake: float,
    h: float,
):
    """Torques and contact force of a half's corner on one ``side`` (+1 left, −1 right) over a main step of ``h`` [s]."""
    d = m.driveline
    out = CornerContact()

    capacity = arm_seal_capacity(m.arm, m.oil, g, cylinder, x.arm_rate)
    out.arm_deflection = presliding(x.arm_deflection, x.start_arm_rate, h, capacity, m.arm.presliding_stiffness)

    # brakes and the motor's own friction hold between arm and wheel
    torque = half.displacement * x.motor_pressure
    brake = (
        d.brake_disc_torque
        + parking_brake * d.brake_parking_torque
        + (1.0 - d.motor_mechanical_efficiency) * wp.abs(torque)
    )
    out.wheel_deflection = presliding(x.wheel_deflection, x.start_wheel_rate, h, brake, d.brake_presliding_stiffness)

    centre = wheel_centre(m.corner, half.pivot_x, half.direction, side, x.angle)
    hub_velocity = (
        half.velocity
        + wp.cross(half.omega, centre)
        + x.arm_rate * arm_tangent(half.direction, x.angle, m.corner.arm_length)
    )
    under = footing(terrain, ground, half.origin + half.rotation * centre)
    contact = wheel_contact(
        terrain, ground, m.tire, under, half.rotation, half.origin, centre, hub_velocity, half.omega, x.spin,
        x.bristle_x, x.bristle_y, x.twist, h,
    )
    out.bristle_x = contact.bristle_x
    out.bristle_y = contact.bristle_y
    out.twist = contact.twist
    out.normal = contact.load
    out.known = under.known

    load = CornerLoad()
    load.angle = x.angle
    load.rate = x.arm_rate
    load.spin = x.spin
    load.arm_torque = arm_torque(m.arm, g, x.angle, x.arm_rate, out.arm_deflection, capacity, x.oil_torque)
    stiffness = d.brake_presliding_stiffness
    damping = d.brake_presliding_damping
    load.wheel_torque = torque + dry_friction(out.wheel_deflection, x.wheel_rate, brake, stiffness, damping)
    load.force = contact.force
    load.moment = contact.moment

    if wp.abs(stiffness * out.wheel_deflection + damping * x.wheel_rate) >= brake:
        damping = 0.0
    out.load = implicitly_damped(load, contact, damping, x.spin_change, m.corner.spin_inertia, h)
    return out


@wp.func
def corner_contact(
    m: MachineRecord,
    terrain: Any,
    ground: Any,
    half: Half,
    i: int,
    # circuits
    g: ArmGeometry,
    cylinder: ArmState,
    # motion at the start and in the middle of the step; wheel rates relative to the arms; the last step's acceleration
    arm_angles: wp.vec4,
    start: Velocity,
    middle: Velocity,
    start_wheel_rates: wp.vec4,
    wheel_rates: wp.vec4,
    change: Accelerations,
    # loads and friction elements
    oil: OilLoads,
    bent: Deflections,
    parking_brake: float,
    h: float,
):
    """Torques and contact force of corner ``i`` (fl, fr, rl, rr) over a main step of ``h`` [s]."""
    x = CornerStart(
        arm_angles[i], start.arms[i], middle.arms[i], middle.spins[i], change.spins[i], start_wheel_rates[i],
        wheel_rates[i], oil.arms[i], oil.motors[i], bent.bristle_x[i], bent.bristle_y[i], bent.arms[i], bent.wheels[i],
        bent.twist[i],
    )
    return corner_step(m, terrain, ground, half, 1.0 - 2.0 * float(i & 1), g, cylinder, x, parking_brake, h)


@wp.func
def deflections(fl: CornerContact, fr: CornerContact, rl: CornerContact, rr: CornerContact):
    """Friction elements of all corners after the main step."""
    out = Deflections()
    out.bristle_x = wp.vec4(fl.bristle_x, fr.bristle_x, rl.bristle_x, rr.bristle_x)
    out.bristle_y = wp.vec4(fl.bristle_y, fr.bristle_y, rl.bristle_y, rr.bristle_y)
    out.arms = wp.vec4(fl.arm_deflection, fr.arm_deflection, rl.arm_deflection, rr.arm_deflection)
    out.wheels = wp.vec4(fl.wheel_deflection, fr.wheel_deflection, rl.wheel_deflection, rr.wheel_deflection)
    out.twist = wp.vec4(fl.twist, fr.twist, rl.twist, rr.twist)
    return out


@wp.struct
class HullLoads:
    """What the ground does to a frame, in its coordinates."""

    force: wp.vec3  # [N]
    moment: wp.vec3  # [N m] about the hinge's origin
    touch: float  # [N] sum of the forces' magnitudes


@wp.func
def hull_corner_loads(
    loads: HullLoads, m: Hull, frame: FrameBody, clearance: float, terrain: Any, ground: Any, half: Half, i: int
):
    """``loads`` with those of the ground on corner ``i`` (0 … 7) of a frame."""
    out = loads
    point = hull_corner(frame, clearance, i)
    world = half.origin + half.rotation * point
    if world[2] < ceiling(terrain, ground, world[0], world[1]):
        under = footing(terrain, ground, world)
        one = hull_contact(m, under, half.rotation, half.origin, point, half.velocity, half.omega)
        out.force += one
        out.moment += wp.cross(point, one)
        out.touch += wp.length(one)
    return out


@wp.func
def hull_loads(m: Hull, frame: FrameBody, clearance: float, terrain: Any, ground: Any, half: Half):
    """Loads of the ground on a frame's eight corners."""
    out = HullLoads()
    for i in range(8):
        out = hull_corner_loads(out, m, frame, clearance, terrain, ground, half, i)
    return out
