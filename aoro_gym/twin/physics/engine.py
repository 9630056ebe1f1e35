"""Diesel engine: torque curve, governor, inertia. Machine section ``engine``."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

from aoro_gym import units

RPM = wp.constant(units.RPM)


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
def rise(n: float, n0: float, n1: float, height: float):
    """Ramp from 0 at ``n0`` and below to ``height`` at ``n1`` and above."""
    return height * wp.clamp((n - n0) / (n1 - n0), 0.0, 1.0)


@wp.func
def full_load_torque(m: Engine, speed: float):
    """Brake torque [N m] at full load and ``speed`` [rad/s]: linear between the curve's points, 0 below 300 rpm
    and above 2600 rpm. The sum of the ramps between them."""
    n = speed / RPM
    torque = rise(n, 300.0, 900.0, m.torque_rpm_900)
    torque += rise(n, 900.0, 1200.0, m.torque_rpm_1200 - m.torque_rpm_900)
    torque += rise(n, 1200.0, 1400.0, m.torque_rpm_1400 - m.torque_rpm_1200)
    torque += rise(n, 1400.0, 1600.0, m.torque_rpm_1600 - m.torque_rpm_1400)
    torque += rise(n, 1600.0, 1800.0, m.torque_rpm_1800 - m.torque_rpm_1600)
    torque += rise(n, 1800.0, 2000.0, m.torque_rpm_2000 - m.torque_rpm_1800)
    torque += rise(n, 2000.0, 2200.0, m.torque_rpm_2200 - m.torque_rpm_2000)
    torque += rise(n, 2200.0, 2400.0, m.torque_rpm_2400 - m.torque_rpm_2200)
    torque += rise(n, 2400.0, 2600.0, -m.torque_rpm_2400)
    return wp.max(torque, 0.0)


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
