"""The articulated joint: its bearing, its end stops, and the steering cylinders' seals. Machine section ``joint``."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

from aoro_gym.twin.physics.fluid import Oil, pressure
from aoro_gym.twin.physics.friction import dry_friction, end_stop, presliding, seal_friction
from aoro_gym.twin.physics.mount import MountState, mount_step
from aoro_gym.twin.physics.steering import Steering, SteeringGeometry, SteeringState, steering_torque


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
    """Friction torque [N m] at which the joint breaks away or slides: its bearing and the seals of both cylinders."""
    pressures = wp.max(pressure(oil, s.port_a), 0.0) + wp.max(pressure(oil, s.port_b), 0.0)
    return (
        m.friction_torque
        + cylinder_seal(steering, pressures, g.lever_left, rate)
        + cylinder_seal(steering, pressures, g.lever_right, rate)
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
    h: float,
):
    """Torque [N m] that turns a joint whose cylinders are fixed to it: oil, dry friction, seals, end stops; and the
    deflection [rad] of the dry friction after a main step of ``h`` [s]."""
    capacity = joint_capacity(m, steering, oil, g, s, rate)
    bent = presliding(deflection, start_rate, h, capacity, m.presliding_stiffness)
    torque = oil_torque + dry_friction(bent, rate, capacity, m.presliding_stiffness, m.presliding_damping)
    torque -= cylinder_drag(steering, g) * rate
    torque += joint_stop(m, angle, rate)
    return torque, bent


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
    stiffness = m.presliding_stiffness
    damping = m.presliding_damping
    capacity = joint_capacity(m, steering, oil, g, s, x.rate)
    stop = joint_stop(m, joint + x.deflection, x.rate)
    grip = float(0.0)
    drag = cylinder_drag(steering, g)
    torque = (
        steering_torque(oil, g, s) + dry_friction(x.friction, x.rate, capacity, stiffness, damping) - drag * x.rate + stop
    )
    if wp.abs(stiffness * x.friction + damping * x.rate) < capacity:
        grip += stiffness
        drag += damping
    if stop != 0.0:
        grip += m.stop_torsional_stiffness
        drag += m.stop_torsional_damping
    out = mount_step(g, m.mount_stiffness, m.backlash, torque, grip, drag, joint_rate, x, dt)
    out.friction = presliding(x.friction, out.rate, dt, capacity, stiffness)
    return out
