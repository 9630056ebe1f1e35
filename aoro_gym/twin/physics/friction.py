"""Dry friction with true stiction, and first-order actuators.

Source: Prandtl's elasto-plastic element (Visintin, *Differential Models of Hysteresis*, 1994) with Stribeck capacity.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp


@wp.func
def seal_friction(preload: float, slope: float, pressures: float, static_ratio: float, stribeck: float, speed: float):
    """Friction capacity [N] of a cylinder's seals: (F_0 + μ Σp)(1 + (r−1) exp(−(v/v_s)²)), Σp of both chambers [Pa]."""
    ratio = speed / stribeck
    return (preload + slope * pressures) * (1.0 + (static_ratio - 1.0) * wp.exp(-ratio * ratio))


@wp.func
def presliding(deflection: float, rate: float, dt: float, capacity: float, stiffness: float):
    """Deflection of a Prandtl element after ``dt``: ż = v, held within ±capacity/stiffness.

    Below breakaway it is a spring: no creep, ever. Units: rad (or m) with N m/rad (or N/m).
    """
    limit = capacity / stiffness
    return wp.clamp(deflection + dt * rate, -limit, limit)


@wp.func
def dry_friction(deflection: float, rate: float, capacity: float, stiffness: float, damping: float):
    """Friction torque [N m] (or force) against the motion: −clip(k z + c v, ±capacity)."""
    return -wp.clamp(stiffness * deflection + damping * rate, -capacity, capacity)


@wp.func
def end_stop(position: float, rate: float, limit: float, stiffness: float, damping: float):
    """Torque [N m] (or force) of a hard stop at ±``limit``: spring and damper that push back and never pull."""
    side = wp.sign(position)
    torque = float(0.0)
    if wp.abs(position) > limit:
        torque = -side * wp.max(stiffness * (wp.abs(position) - limit) + damping * side * rate, 0.0)
    return torque


@wp.func
def lag(x: float, target: float, time_constant: float, rate_limit: float, dt: float):
    """First-order lag with a rate limit after ``dt`` of a constant ``target``; exact where the limit is not reached."""
    change = (target - x) * (1.0 - wp.exp(-dt / time_constant))
    return x + wp.clamp(change, -rate_limit * dt, rate_limit * dt)
