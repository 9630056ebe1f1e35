"""Numbers and small functions that laws share, in double precision."""

import warp as wp

f64 = wp.float64

ZERO = wp.float64(0.0)
QUARTER = wp.float64(0.25)
HALF = wp.float64(0.5)
ONE = wp.float64(1.0)
TWO = wp.float64(2.0)
THREE = wp.float64(3.0)
SIX = wp.float64(6.0)
TINY = wp.float64(1e-12)


@wp.func
def unit(x: wp.float64):
    """``x`` held in [0, 1]."""
    return wp.clamp(x, ZERO, ONE)


@wp.func
def play(x: wp.float64, width: wp.float64):
    """Dead zone: what of ``x`` stands out of ±``width``."""
    return x - wp.clamp(x, -width, width)


@wp.func
def orifice(conductance: wp.float64, drop: wp.float64, transition: wp.float64):
    """Flow [m³/s] through an orifice: Q = K Δp/(Δp² + Δp_t²)^¼ → K √Δp, laminar for |Δp| ≪ Δp_t.

    K [m³/s/√Pa], Δp [Pa]. A smooth form of the laminar–turbulent orifice (Borutzky, Barnard, Thoma 2002); odd in Δp.
    """
    return conductance * drop / wp.sqrt(wp.sqrt(drop * drop + transition * transition) + TINY)


@wp.func
def mccloy(conductance: wp.float64, drop: wp.float64, transition: wp.float64):
    """Flow through an orifice whose discharge coefficient grows with the Reynolds number: C_d = C_max tanh(√(Δp/Δp_t)).

    McCloy, Martin: Control of Fluid Power, 1980. Q = K √|Δp| tanh(√(|Δp|/Δp_t)) sgn Δp: laminar for |Δp| ≪ Δp_t.
    """
    root = wp.sqrt(wp.abs(drop))
    return wp.sign(drop) * conductance * root * wp.tanh(root / wp.sqrt(transition))


@wp.func
def series(first: wp.float64, second: wp.float64):
    """Conductance of two turbulent orifices one after the other: 1/K² = 1/K₁² + 1/K₂²."""
    return first * second / wp.sqrt(first * first + second * second + f64(1e-40))


@wp.func
def check(conductance: wp.float64, drop: wp.float64, transition: wp.float64):
    """Flow through an orifice that only lets pass forwards."""
    return orifice(conductance, wp.max(drop, ZERO), transition)
