"""Dry friction with true stiction, and first-order actuators.

Sources: Prandtl's elasto-plastic element (Visintin, *Differential Models of Hysteresis*, 1994) with Stribeck capacity; LuGre
bristles (Canudas de Wit, Olsson, Åström and Lischinsky, IEEE TAC 40, 1995, 419).
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import warp as wp

LEAST_CAPACITY = wp.constant(1.0e-3)  # [N m] or [N]: LuGre friction of none at all


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
def bristle_step(z: float, slip: float, unload: float, dt: float):
    """Deflection [m] or [rad] after ``dt``: ż = v − λ z with λ = σ₀|v|/g (``unload`` [1/s]); linearly implicit, so stable
    at any slip speed. Signed: on reversal the bristle unloads before it bends the other way."""
    return (z + dt * slip) / (1.0 + dt * unload)


@wp.func
def lugre_unload(rate: float, capacity: float, stiffness: float):
    """Rate λ = σ₀|v|/g [1/s] at which a bristle of LuGre friction unloads."""
    return stiffness * wp.abs(rate) / wp.max(capacity, LEAST_CAPACITY)


@wp.func
def lugre_damping(rate: float, capacity: float, damping: float):
    """Bristle damping σ₁ [N m s/rad] (or N s/m) that LuGre friction yields work with at no speed: min(σ₁, 4 g/|v|).

    F v − d(σ₀ z²/2)/dt = σ₁ ż² + σ₁ (σ₀|v|/g) ż z + σ₀² |v| z²/g is no less than zero for any z and ż if σ₁ |v| ≤ 4 g
    (Olsson, *Control Systems with Friction*, Lund 1996, ch. 3). With nominal seals only above 1 rad/s.
    """
    return wp.min(damping, 4.0 * capacity / wp.max(wp.abs(rate), 1.0e-6))


@wp.func
def lugre_friction(deflection: float, rate: float, capacity: float, stiffness: float, damping: float):
    """Friction torque [N m] (or force) against the motion: −(σ₀ z + σ₁ ż) with ż = v − σ₀|v| z/g, g the ``capacity``.

    Sticks as a spring σ₀ that yields little by little, slides at g. Valid for sliding, reversal and hysteresis before
    sliding; under a load that swings below breakaway it drifts (Dupont et al., IEEE TAC 47, 2002, 787).
    """
    change = rate - lugre_unload(rate, capacity, stiffness) * deflection
    return -(stiffness * deflection + lugre_damping(rate, capacity, damping) * change)


@wp.func
def smooth_drag(rate: float, capacity: float, velocity: float):
    """Secant slope F/v [N m s/rad] (or N s/m) of the friction F = g tanh(v/v_t) against the motion.

    g is the ``capacity``, v_t the ``velocity`` at which it fades. Valid while things slide: at rest it resists nothing, so
    that a load creeps at v_t artanh(F/g).
    """
    ratio = rate / velocity
    slope = capacity / velocity
    if ratio != 0.0:
        slope *= wp.tanh(ratio) / ratio
    return slope


@wp.func
def end_stop(position: float, rate: float, limit: float, stiffness: float, damping: float):
    """Torque [N m] (or force) of a hard stop at ±``limit``: spring and damper that push back and never pull."""
    side = wp.sign(position)
    if wp.abs(position) <= limit:
        return 0.0
    return -side * wp.max(stiffness * (wp.abs(position) - limit) + damping * side * rate, 0.0)


@wp.func
def lag(x: float, target: float, time_constant: float, rate_limit: float, dt: float):
    """First-order lag with a rate limit after ``dt`` of a constant ``target``; exact where the limit is not reached."""
    change = (target - x) * (1.0 - wp.exp(-dt / time_constant))
    return x + wp.clamp(change, -rate_limit * dt, rate_limit * dt)
