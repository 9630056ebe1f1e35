"""What the ground does to the machine: contacts, friction and torques at the four corners, and the frames' hulls."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from typing import Any

import warp as wp

from aoro_gym.twin.kernels.state import Deflections, OilLoads, Velocity
from aoro_gym.twin.physics.arms import ArmGeometry, ArmState, arm_seal_capacity, arm_torque
from aoro_gym.twin.physics.bodies import Accelerations, CornerLoad, FrameBody, arm_tangent, hull_corner, wheel_centre
from aoro_gym.twin.physics.friction import dry_friction, presliding
from aoro_gym.twin.physics.ground import ceiling, footing
from aoro_gym.twin.physics.tires import Hull, TireContact, hull_contact, tire_contact
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
    d = m.driveline
    side = 1.0 - 2.0 * float(i & 1)
    angle = arm_angles[i]
    rate = middle.arms[i]
    spin = middle.spins[i]
    wheel_rate = wheel_rates[i]
    out = CornerContact()

    capacity = arm_seal_capacity(m.arm, m.oil, g, cylinder, rate)
    out.arm_deflection = presliding(bent.arms[i], start.arms[i], h, capacity, m.arm.presliding_stiffness)

    # brakes and the motor's own friction hold between arm and wheel
    torque = half.displacement * oil.motors[i]
    brake = (
        d.brake_disc_torque
        + parking_brake * d.brake_parking_torque
        + (1.0 - d.motor_mechanical_efficiency) * wp.abs(torque)
    )
    out.wheel_deflection = presliding(bent.wheels[i], start_wheel_rates[i], h, brake, d.brake_presliding_stiffness)

    centre = wheel_centre(m.corner, half.pivot_x, half.direction, side, angle)
    hub_velocity = (
        half.velocity
        + wp.cross(half.omega, centre)
        + rate * arm_tangent(half.direction, angle, m.corner.arm_length)
    )
    under = footing(terrain, ground, half.origin + half.rotation * centre)
    contact = tire_contact(
        m.tire, under, half.rotation, half.origin, centre, hub_velocity, half.omega, spin, bent.bristle_x[i],
        bent.bristle_y[i], bent.twist[i], h,
    )
    out.bristle_x = contact.bristle_x
    out.bristle_y = contact.bristle_y
    out.twist = contact.twist
    out.normal = contact.load
    out.known = under.known

    load = CornerLoad()
    load.angle = angle
    load.rate = rate
    load.spin = spin
    load.arm_torque = arm_torque(m.arm, g, angle, rate, out.arm_deflection, capacity, oil.arms[i])
    stiffness = d.brake_presliding_stiffness
    damping = d.brake_presliding_damping
    load.wheel_torque = torque + dry_friction(out.wheel_deflection, wheel_rate, brake, stiffness, damping)
    load.force = contact.force
    load.moment = contact.moment

    if wp.abs(stiffness * out.wheel_deflection + damping * wheel_rate) >= brake:
        damping = 0.0
    out.load = implicitly_damped(load, contact, damping, change.spins[i], m.corner.spin_inertia, h)
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


@wp.struct
class HullLoads:
    """What the ground does to a frame, in its coordinates."""

    force: wp.vec3  # [N]
    moment: wp.vec3  # [N m] about the hinge's origin
    touch: float  # [N] sum of the forces' magnitudes


@wp.func
def hull_loads(m: Hull, frame: FrameBody, clearance: float, terrain: Any, ground: Any, half: Half):
    """Loads of the ground on a frame's eight corners."""
    out = HullLoads()
    for i in range(8):
        point = hull_corner(frame, clearance, i)
        world = half.origin + half.rotation * point
        if world[2] < ceiling(terrain, ground, world[0], world[1]):
            under = footing(terrain, ground, world)
            one = hull_contact(m, under, half.rotation, half.origin, point, half.velocity, half.omega)
            out.force += one
            out.moment += wp.cross(point, one)
            out.touch += wp.length(one)
    return out
