"""Diesel engine: torque curve, governor, inertia. Machine section ``engine``."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

RPM = wp.constant(0.10471975511965977)  # [rad/s]


@wp.struct
class Engine:
    """Engine parameters; torques are brake torques at the flywheel."""

    set_speed: float  # [rad/s]
    inertia: float  # [kg m²] engine, flywheel and pumps
    friction_0: float  # [N m]
    friction_1: float  # [N m s/rad]
    governor_proportional: float  # [N m s/rad]
    governor_integral: float  # [N m/rad]
    droop: float  # [-] relative fall of the governed speed from no load to full load
    torque_time_constant: float  # [s]
    smoke_rate: float  # [N m/s]
    torque_rpm_900: float  # [N m]
    torque_rpm_1200: float
    torque_rpm_1400: float
    torque_rpm_1600: float
    torque_rpm_1800: float
    torque_rpm_2000: float
    torque_rpm_2200: float
    torque_rpm_2400: float


@wp.struct
class EngineState:
    speed: float  # [rad/s]
    integral: float  # [N m] governor
    torque: float  # [N m] indicated


@wp.func
def between(x: float, x0: float, y0: float, x1: float, y1: float):
    """Linear interpolation through (x0, y0) and (x1, y1)."""
    return y0 + (y1 - y0) * (x - x0) / (x1 - x0)


@wp.func
def full_load_torque(m: Engine, speed: float):
    """Brake torque [N m] at full load and ``speed`` [rad/s]: linear between the curve's points, 0 below 300 rpm
    and above 2600 rpm."""
    n = speed / RPM
    torque = float(0.0)
    if n > 2400.0:
        torque = wp.max(between(n, 2400.0, m.torque_rpm_2400, 2600.0, 0.0), 0.0)
    elif n > 2200.0:
        torque = between(n, 2200.0, m.torque_rpm_2200, 2400.0, m.torque_rpm_2400)
    elif n > 2000.0:
        torque = between(n, 2000.0, m.torque_rpm_2000, 2200.0, m.torque_rpm_2200)
    elif n > 1800.0:
        torque = between(n, 1800.0, m.torque_rpm_1800, 2000.0, m.torque_rpm_2000)
    elif n > 1600.0:
        torque = between(n, 1600.0, m.torque_rpm_1600, 1800.0, m.torque_rpm_1800)
    elif n > 1400.0:
        torque = between(n, 1400.0, m.torque_rpm_1400, 1600.0, m.torque_rpm_1600)
    elif n > 1200.0:
        torque = between(n, 1200.0, m.torque_rpm_1200, 1400.0, m.torque_rpm_1400)
    elif n > 900.0:
        torque = between(n, 900.0, m.torque_rpm_900, 1200.0, m.torque_rpm_1200)
    elif n > 300.0:
        torque = between(n, 300.0, 0.0, 900.0, m.torque_rpm_900)
    return torque


@wp.func
def governed_speed(m: Engine, brake_torque: float, full: float):
    """Speed [rad/s] that the governor holds under ``brake_torque`` [N m] of ``full`` load: n_0 (1 − δ T/T_full), down to
    full load and no higher than without load (speed droop as of ISO 8528-2)."""
    return m.set_speed * (1.0 - m.droop * wp.clamp(brake_torque / wp.max(full, 1.0), 0.0, 1.0))


@wp.func
def engine_step(m: Engine, s: EngineState, load: float, dt: float):
    """Engine after ``dt`` [s] under ``load`` [N m]: J ω̇ = T − T_f(ω) − load, with T_f = f₀ + f₁ω.

    The governor is a PI on the speed error, clamped to what the curve gives (the integral too, so that it never winds
    up); the torque follows with a lag and rises no faster than the smoke limit. Without droop it is isochronous.
    """
    friction = m.friction_0 + m.friction_1 * s.speed
    full = full_load_torque(m, s.speed)
    limit = full + friction
    error = governed_speed(m, s.integral - friction, full) - s.speed
    integral = wp.clamp(s.integral + dt * m.governor_integral * error, 0.0, limit)
    demand = wp.clamp(m.governor_proportional * error + integral, 0.0, limit)
    torque = s.torque + dt * wp.min((demand - s.torque) / m.torque_time_constant, m.smoke_rate)
    out = EngineState()
    out.integral = integral
    out.torque = torque
    out.speed = wp.max(s.speed + dt * (torque - friction - load) / m.inertia, 0.0)
    return out
