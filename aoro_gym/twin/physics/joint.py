"""The articulated joint: its bearing, its end stops, and the steering cylinders' seals. Machine section ``joint``."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

from aoro_gym.twin.physics.bodies import FrameBody
from aoro_gym.twin.physics.fluid import Oil, pressure
from aoro_gym.twin.physics.friction import (
    bristle_step,
    dry_friction,
    end_stop,
    lugre_damping,
    lugre_friction,
    lugre_unload,
    presliding,
    seal_friction,
    smooth_drag,
)
from aoro_gym.twin.physics.laws import option
from aoro_gym.twin.physics.mount import MountState, mount_step
from aoro_gym.twin.physics.steering import steering_torque
from aoro_gym.twin.physics.steering_circuit import Steering, SteeringGeometry, SteeringState

PRESLIDING = option("friction", "presliding")
LUGRE = option("friction", "lugre")  # the smooth laws come behind it
COULOMB_VISCOUS = option("friction", "coulomb_viscous")
HARDENING = option("mount", "hardening")

SLIDING = wp.constant(1.0e3)  # [rad/s] at which nothing of the seals' static friction is left


@wp.struct
class Joint:
    """Parameters of the articulated joint."""

    range: float  # [rad] half range
    friction_torque: float  # [N m]
    backlash: float  # [rad] between cylinders and frames, full width
    mount_stiffness: float  # [N m/rad] between cylinders and frames; 0: rigid, and no play
    stop_torsional_stiffness: float  # [N m/rad]
    stop_torsional_damping: float  # [N m s/rad]
    presliding_stiffness: float  # [N m/rad]
    presliding_damping: float  # [N m s/rad]
    friction_law: int  # by the numbers of aoro_gym.machine.laws
    friction_velocity: float  # [rad/s]
    mount_law: int
    hardening_angle: float  # [rad]


@wp.func
def cylinder_seal(m: Steering, pressures: float, lever: float, rate: float):
    """Friction torque [N m] of one steering cylinder's seals; ``pressures`` [Pa] is the sum of both chambers."""
    return lever * seal_friction(
        m.cylinder_seal_preload,
        m.cylinder_seal_pressure_coefficient,
        pressures,
        m.cylinder_seal_static_ratio,
        m.cylinder_seal_stribeck_velocity,
        lever * rate,
    )


@wp.func
def joint_capacity(m: Joint, steering: Steering, oil: Oil, g: SteeringGeometry, s: SteeringState, rate: float):
    """Friction torque [N m] at which the joint breaks away or slides: its bearing and the seals of both cylinders. By the
    law ``coulomb_viscous`` it is that of sliding at any ``rate`` [rad/s]."""
    speed = wp.where(m.friction_law == COULOMB_VISCOUS, SLIDING, rate)
    pressures = wp.max(pressure(oil, s.port_a), 0.0) + wp.max(pressure(oil, s.port_b), 0.0)
    return (
        m.friction_torque
        + cylinder_seal(steering, pressures, g.lever_left, speed)
        + cylinder_seal(steering, pressures, g.lever_right, speed)
    )


@wp.func
def cylinder_drag(m: Steering, g: SteeringGeometry):
    """Viscous friction [N m s/rad] of both cylinders' seals about the joint."""
    return m.cylinder_seal_viscous * (g.lever_left * g.lever_left + g.lever_right * g.lever_right)


@wp.func
def joint_stop(m: Joint, angle: float, rate: float):
    """Torque [N m] of the joint's end stops."""
    return end_stop(angle, rate, m.range, m.stop_torsional_stiffness, m.stop_torsional_damping)


@wp.func
def mount_hardening(m: Joint):
    """Hardening [1/rad] of the mount: 1/b₀ by the law ``hardening``, with b₀ the bend that doubles its stiffness, else 0."""
    hardening = float(0.0)
    if m.mount_law == HARDENING:
        hardening = 1.0 / m.hardening_angle
    return hardening


@wp.func
def friction_step(m: Joint, deflection: float, rate: float, capacity: float, dt: float):
    """Deflection [rad] of the dry friction after ``dt`` at ``rate`` [rad/s]; 0 by laws that have none."""
    out = float(0.0)
    if m.friction_law == LUGRE:
        out = bristle_step(deflection, rate, lugre_unload(rate, capacity, m.presliding_stiffness), dt)
    elif m.friction_law == PRESLIDING:
        out = presliding(deflection, rate, dt, capacity, m.presliding_stiffness)
    return out


@wp.func
def least_inertia(front: FrameBody, rear: FrameBody):
    """Least inertia [kg m²] that a torque between the frames can turn: 1/I = 1/I_front + 1/I_rear, of two bare frames that
    share no hinge. What hangs on them and what holds them together only adds to it (Gauss's principle)."""
    return front.inertia_zz * rear.inertia_zz / (front.inertia_zz + rear.inertia_zz)


@wp.func
def joint_friction(m: Joint, deflection: float, rate: float, capacity: float, inertia: float, h: float):
    """Dry friction [N m] of the joint at ``rate`` [rad/s], explicit in a main step of ``h`` [s].

    By the smooth laws the speed at which it fades is at least 2 g h/I, with I the ``inertia`` [kg m²] that it can move at
    least: a step then takes at most half of any rate, whatever the parameters. Of the nominal machine that is a seventh of
    ``friction_velocity``, and nothing changes.
    """
    torque = float(0.0)
    if m.friction_law == LUGRE:
        torque = lugre_friction(deflection, rate, capacity, m.presliding_stiffness, m.presliding_damping)
    elif m.friction_law > LUGRE:
        torque = -rate * smooth_drag(rate, capacity, wp.max(m.friction_velocity, 2.0 * capacity * h / inertia))
    else:
        torque = dry_friction(deflection, rate, capacity, m.presliding_stiffness, m.presliding_damping)
    return torque


@wp.func
def rigid_joint_torque(
    # parameters
    m: Joint,
    steering: Steering,
    oil: Oil,
    g: SteeringGeometry,
    # motion in the middle of the main step, and the rate at its start
    angle: float,
    rate: float,
    start_rate: float,
    # loads
    oil_torque: float,
    s: SteeringState,
    deflection: float,
    inertia: float,
    h: float,
):
    """Torque [N m] that turns a joint whose cylinders are fixed to it: oil, dry friction, seals, end stops; and the
    deflection [rad] of the dry friction after a main step of ``h`` [s]. ``inertia`` as of :func:`least_inertia`."""
    capacity = joint_capacity(m, steering, oil, g, s, rate)
    bent = friction_step(m, deflection, start_rate, capacity, h)
    torque = oil_torque + joint_friction(m, bent, rate, capacity, inertia, h)
    torque -= cylinder_drag(steering, g) * rate
    torque += joint_stop(m, angle, rate)
    return torque, bent


@wp.struct
class Seals:
    """Dry friction that holds the steering cylinders on their mount, linear in their rate w over a substep:
    τ − ``grip`` dt w − ``drag`` (w − w₀)."""

    torque: float  # [N m] τ at the old rate w₀
    grip: float  # [N m/rad]
    drag: float  # [N m s/rad]


@wp.func
def seals(m: Joint, deflection: float, rate: float, capacity: float, dt: float):
    """Dry friction at the cylinders' old ``rate`` [rad/s].

    LuGre by its bristles' implicit step: σ₀ z' + σ₁ ż' with z' = (z + dt w)/(1 + λ dt), λ = σ₀|w₀|/g. The smooth laws by
    their secant, F = −(F₀/w₀) w: no step reverses the motion, so the lightest cylinder is stable.
    """
    out = Seals()
    stiffness = m.presliding_stiffness
    damping = m.presliding_damping
    if m.friction_law == LUGRE:
        share = 1.0 / (1.0 + dt * lugre_unload(rate, capacity, stiffness))
        out.torque = share * lugre_friction(deflection, rate, capacity, stiffness, damping)
        out.grip = share * stiffness
        out.drag = share * lugre_damping(rate, capacity, damping)
    elif m.friction_law > LUGRE:
        out.drag = smooth_drag(rate, capacity, m.friction_velocity)
        out.torque = -out.drag * rate
    else:
        out.torque = dry_friction(deflection, rate, capacity, stiffness, damping)
        if wp.abs(stiffness * deflection + damping * rate) < capacity:
            out.grip = stiffness
            out.drag = damping
    return out


@wp.func
def cylinders_step(
    m: Joint,
    steering: Steering,
    oil: Oil,
    g: SteeringGeometry,
    s: SteeringState,
    joint: float,
    joint_rate: float,
    x: MountState,
    dt: float,
):
    """Mount after ``dt``, whose cylinders feel oil, friction and ends of the stroke, as the joint does without one."""
    capacity = joint_capacity(m, steering, oil, g, s, x.rate)
    stop = joint_stop(m, joint + x.deflection, x.rate)
    dry = seals(m, x.friction, x.rate, capacity, dt)
    grip = dry.grip
    drag = cylinder_drag(steering, g)
    torque = steering_torque(oil, g, s) + dry.torque - drag * x.rate + stop
    drag += dry.drag
    if stop != 0.0:
        grip += m.stop_torsional_stiffness
        drag += m.stop_torsional_damping
    hardening = mount_hardening(m)
    out = mount_step(g, m.mount_stiffness, m.backlash, hardening, torque, grip, drag, joint_rate, x, dt)
    out.friction = friction_step(m, x.friction, out.rate, capacity, dt)
    return out
