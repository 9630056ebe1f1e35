"""Tires of a standing or slowly rolling machine: forces along and across, and the torque against swivelling.

All take a wheel's motion (slip forwards, ground speed sideways, ground speed along, yaw rate), its load [N] and its
deflections. They return force forwards [N], force sideways [N], torque [N m] on the machine, and the deflections'
rates. Valid for speeds of up to a few m/s.
"""

from typing import Any

import warp as wp

from .geometry import vec4d, vec6d
from .numbers import HALF, ONE, QUARTER, f64

vec7d = wp.types.vector(length=7, dtype=wp.float64)


@wp.func
def swivel_limit(m: Any, load: wp.float64):
    """Largest swivel torque [N m] of a standing tire: μ_s/3 √(N³/p) (Gough's formula), p inflation pressure [Pa]."""
    return m.swivel_friction / f64(3.0) * wp.sqrt(load * load * load / m.inflation)


@wp.func
def relaxation_tire(m: Any, motion: vec4d, load: wp.float64, ux: wp.float64, uy: wp.float64, turn: wp.float64):
    """Relaxation length with Dahl saturation, and the swivel of Sharp and Granger (2003).

    F = k u + c u̇, u̇ = v − |v| k u/(μ N) − |V| u/σ; M = k_ψ ψ, ψ̇ = ω − |ω| k_ψ ψ/M_∞ − |V| ψ/σ_ψ.
    """
    limit = m.ground_friction * load
    rolling = wp.abs(motion[2])
    bore = swivel_limit(m, load)
    rate_x = motion[0] - wp.abs(motion[0]) * m.stiffness_along * ux / limit - rolling * ux / m.relaxation_along
    rate_y = motion[1] - wp.abs(motion[1]) * m.stiffness_across * uy / limit - rolling * uy / m.relaxation_across
    rate_t = motion[3] - wp.abs(motion[3]) * m.swivel_stiffness * turn / bore - rolling * turn / m.relaxation_swivel
    along = m.stiffness_along * ux + m.carcass_damping * rate_x
    across = m.stiffness_across * uy + m.carcass_damping * rate_y
    return vec6d(along, -across, -m.swivel_stiffness * turn, rate_x, rate_y, rate_t)


@wp.func
def brush(share: wp.float64):
    """Brush with parabolic pressure (Fromm; Pacejka 2012): 3 s − 3 s |s| + s³ for |s| < 1, then ±1."""
    s = wp.clamp(share, -ONE, ONE)
    return f64(3.0) * s - f64(3.0) * s * wp.abs(s) + s * s * s


@wp.func
def carpet_tire(m: Any, motion: vec4d, load: wp.float64, u: vec4d):
    """Carpet of four brush elements: fore and aft ones shear sideways, left and right ones shear along.

    An element's slip v is that of its place, at the arms a (fore) and b (side); u̇ = v − |v| u/u_s − |V| u/ℓ, force
    ¼ μ N brush(u/u_s) + ½ c u̇.
    """
    most = QUARTER * m.ground_friction * load
    rolling = wp.abs(motion[2]) / m.carpet_length
    slip = m.carpet_slip
    v = vec4d(
        motion[1] + m.carpet_fore * motion[3],
        motion[1] - m.carpet_fore * motion[3],
        motion[0] + m.carpet_side * motion[3],
        motion[0] - m.carpet_side * motion[3],
    )
    f = vec4d()
    rate = vec4d()
    for i in range(4):
        rate[i] = v[i] - wp.abs(v[i]) * u[i] / slip - rolling * u[i]
        f[i] = most * brush(u[i] / slip) + HALF * m.carcass_damping * rate[i]
    torque = -m.carpet_fore * (f[0] - f[1]) - m.carpet_side * (f[2] - f[3])
    return vec7d(f[2] + f[3], -f[0] - f[1], torque, rate[0], rate[1], rate[2], rate[3])


@wp.func
def lugre_tire(m: Any, motion: vec4d, load: wp.float64, zx: wp.float64, zy: wp.float64, zt: wp.float64):
    """LuGre with one common sliding speed of all three directions (after Velenis, Tsiotras, Canudas de Wit 2005).

    ż_i = v_i − σ₀ |v| z_i/g(|v|) − κ |V| z_i, F_i = N (σ₀ z_i + σ₁ ż_i), v = (slip, sideways, r_b ω), torque r_b F_ψ.
    Swivelling has bristles of its own stiffness.
    """
    bore = swivel_limit(m, load) / (m.ground_friction * load)
    vt = bore * motion[3]
    speed = wp.sqrt(motion[0] * motion[0] + motion[1] * motion[1] + vt * vt + f64(1e-10))
    level = m.ground_friction * (ONE + m.static_ratio * wp.exp(-wp.sqrt(speed / m.stribeck_tire)))
    rolling = wp.abs(motion[2]) / m.bristle_length
    slide = m.bristle_stiffness * speed / level + rolling
    rate_x = motion[0] - slide * zx
    rate_y = motion[1] - slide * zy
    rate_t = vt - (m.bristle_swivel * speed / level + rolling) * zt
    damping = m.bristle_damping
    force_x = load * (m.bristle_stiffness * zx + damping * rate_x)
    force_y = load * (m.bristle_stiffness * zy + damping * rate_y)
    force_t = load * (m.bristle_swivel * zt + damping * rate_t)
    return vec6d(force_x, -force_y, -bore * force_t, rate_x, rate_y, rate_t)
