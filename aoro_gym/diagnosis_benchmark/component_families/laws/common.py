"""Small laws of textbooks that more than one family uses."""

import warp as wp

from aoro_gym.diagnosis_benchmark.independent.laws.numbers import ONE, TWO, ZERO, f64, unit

from .places import vec2d, vec4d


@wp.func
def passage(drop: wp.float64, quadratic: wp.float64, linear: wp.float64):
    """Flow [m³/s] of Δp = R Q + c Q², for Δp ≥ 0, else nought: an orifice behind a laminar resistance.

    c [Pa s²/m⁶], R [Pa s/m³]; the positive root in the form without cancellation. Idelchik: Handbook of Hydraulic
    Resistance, 2008 (two-term law).
    """
    given = wp.max(drop, ZERO)
    return TWO * given / (linear + wp.sqrt(linear * linear + f64(4.0) * quadratic * given) + f64(1e-3))


@wp.func
def segment(value: wp.float64, x0: wp.float64, y0: wp.float64, x1: wp.float64, y1: wp.float64):
    """Straight line between two points, held at its ends."""
    return y0 + (y1 - y0) * unit((value - x0) / (x1 - x0))


@wp.func
def excess(value: wp.float64, width: wp.float64):
    """Part of ``value`` beyond ±``width``: what a loose coupling or a dry friction passes on."""
    return value - wp.clamp(value, -width, width)


@wp.func
def bounded(rate: wp.float64, value: wp.float64):
    """Rate of a share that cannot leave [0, 1]."""
    held = rate
    if value <= ZERO:
        held = wp.max(rate, ZERO)
    if value >= ONE:
        held = wp.min(rate, ZERO)
    return held


@wp.func
def coulomb(speed: wp.float64, scale: wp.float64):
    """Direction of a dry friction, smooth within ``scale``: tanh(v/v₀)."""
    return wp.tanh(speed / scale)


@wp.func
def relief(pressure: wp.float64, setting: wp.float64, slope: wp.float64):
    """Flow [m³/s] of a direct-acting relief valve: linear above its setting (Merritt, Hydraulic Control Systems, 1967)."""
    return slope * wp.max(pressure - setting, ZERO)


@wp.func
def into_ports(spool: wp.float64, f: vec4d, valves_a: wp.float64, valves_b: wp.float64, leak: wp.float64):
    """Flows [m³/s] into A and into B: f[0] into one and f[1] out of the other, as the spool stands, what the port's
    own valves let in, and less and plus what leaks from A to B."""
    into_a = f[0]
    into_b = -f[1]
    if spool <= ZERO:
        into_a = -f[1]
        into_b = f[0]
    return vec2d(into_a + valves_a - leak, into_b + valves_b + leak)
