"""What the ground does to the machine: contacts, friction and torques at the four corners, and the frames' hulls."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from typing import Any

import warp as wp

from aoro_gym.twin.kernels.state import Deflections, Pose, Velocity
from aoro_gym.twin.physics.arms import ArmGeometry, ArmState, arm_seal_capacity, arm_torque
from aoro_gym.twin.physics.bodies import Accelerations, CornerLoad, FrameBody, arm_tangent, hull_corner, wheel_centre
from aoro_gym.twin.physics.friction import dry_friction, presliding
from aoro_gym.twin.physics.ground import ceiling, footing
from aoro_gym.twin.physics.tires import Hull, hull_contact, tire_contact
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
class Corner:
    """One corner before a main step: motion, loads from the circuits, and its friction elements."""

    angle: float  # [rad] arm
    rate: float  # [rad/s] arm, in the middle of the step
    spin: float  # [rad/s] wheel, absolute, in the middle of the step
    wheel_rate: float  # [rad/s] wheel relative to the arm, in the middle of the step
    start_rate: float  # [rad/s] arm, at the start of the step
    start_wheel_rate: float  # [rad/s] wheel relative to the arm, at the start of the step
    acceleration: float  # [rad/s²] of the wheel in the last main step, absolute
    oil_torque: float  # [N m] of the oil on the arm
    motor_pressure: float  # [Pa]
    bristle_x: float  # [m]
    bristle_y: float
    arm_deflection: float  # [rad] seal of the arm's cylinder
    wheel_deflection: float  # [rad] brakes
    twist: float  # [rad] of the tire's patch


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
def corner(
    i: int,
    pose: Pose,
    start: Velocity,
    middle: Velocity,
    wheel_rate: wp.vec4,
    middle_wheel_rate: wp.vec4,
    change: Accelerations,
    arm_oil: wp.vec4,
    motor_pressures: wp.vec4,
    x: Deflections,
):
    """Corner ``i`` (fl, fr, rl, rr)."""
    return Corner(
        pose.arms[i], middle.arms[i], middle.spins[i], middle_wheel_rate[i], start.arms[i], wheel_rate[i],
        change.spins[i], arm_oil[i], motor_pressures[i], x.bristle_x[i], x.bristle_y[i], x.arms[i], x.wheels[i],
        x.twist[i],
    )


@wp.func
def corner_contact(
    m: MachineRecord,
    terrain: Any,
    ground: Any,
    half: Half,
    side: float,
    g: ArmGeometry,
    cylinder: ArmState,
    x: Corner,
    parking_brake: float,
    h: float,
):
    """Torques and contact force of one corner, ``side`` +1 left, −1 right, over a main step of ``h`` [s]."""
    d = m.driveline
    out = CornerContact()

    capacity = arm_seal_capacity(m.arm, m.oil, g, cylinder, x.rate)
    out.arm_deflection = presliding(x.arm_deflection, x.start_rate, h, capacity, m.arm.presliding_stiffness)

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
        + x.rate * arm_tangent(half.direction, x.angle, m.corner.arm_length)
    )
    under = footing(terrain, ground, half.origin + half.rotation * centre)
    contact = tire_contact(
        m.tire, under, half.rotation, half.origin, centre, hub_velocity, half.omega, x.spin, x.bristle_x, x.bristle_y,
        x.twist, h,
    )
    out.bristle_x = contact.bristle_x
    out.bristle_y = contact.bristle_y
    out.twist = contact.twist
    out.normal = contact.load
    out.known = under.known

    load = CornerLoad()
    load.angle = x.angle
    load.rate = x.rate
    load.spin = x.spin
    load.arm_torque = arm_torque(m.arm, g, x.angle, x.rate, out.arm_deflection, capacity, x.oil_torque)
    stiffness = d.brake_presliding_stiffness
    damping = d.brake_presliding_damping
    load.wheel_torque = torque + dry_friction(out.wheel_deflection, x.wheel_rate, brake, stiffness, damping)
    load.force = contact.force
    load.moment = contact.moment

    # Brake and tire can damp a light wheel faster than one step: with c their damping, their torque is taken at the
    # middle rate that this step's acceleration a brings, not the last one's: (I + c h/2) a = τ + c h/2 a_last.
    if wp.abs(stiffness * out.wheel_deflection + damping * x.wheel_rate) >= brake:
        damping = 0.0
    damping_tire = contact.damping * contact.lever * contact.lever
    implicit = 0.5 * h * (damping + damping_tire)
    lacking = x.acceleration - (load.wheel_torque + load.moment[1]) / m.corner.spin_inertia
    share = 0.5 * h * lacking * m.corner.spin_inertia / (m.corner.spin_inertia + implicit)
    load.wheel_torque += share * damping
    load.moment += wp.vec3(0.0, share * damping_tire, 0.0)
    load.force -= (share * contact.damping * contact.lever) * contact.forward
    out.load = load
    return out


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


@wp.func
def hull_loads(m: Hull, frame: FrameBody, clearance: float, terrain: Any, ground: Any, half: Half):
    """Force [N], moment about the hinge origin [N m] and summed magnitude [N] of the ground on a frame's eight corners."""
    force = wp.vec3(0.0, 0.0, 0.0)
    moment = wp.vec3(0.0, 0.0, 0.0)
    touch = float(0.0)
    for i in range(8):
        point = hull_corner(frame, clearance, i)
        world = half.origin + half.rotation * point
        if world[2] < ceiling(terrain, ground, world[0], world[1]):
            under = footing(terrain, ground, world)
            one = hull_contact(m, under, half.rotation, half.origin, point, half.velocity, half.omega)
            force += one
            moment += wp.cross(point, one)
            touch += wp.length(one)
    return force, moment, touch
