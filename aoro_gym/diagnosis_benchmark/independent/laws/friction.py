"""Dry friction with memory, force [N] (or torque [N m]) as state. ``v`` [m/s] or [rad/s]; ``bend`` [m] or [rad]."""

import warp as wp

from .numbers import HALF, ONE, f64


@wp.func
def stribeck(v: wp.float64, kinetic: wp.float64, static: wp.float64, speed: wp.float64):
    """Steady level of friction: F_c + (F_s − F_c) exp(−(v/v_s)²)."""
    ratio = v / speed
    return kinetic + (static - kinetic) * wp.exp(-ratio * ratio)


@wp.func
def bristle_rate(v: wp.float64, force: wp.float64, level: wp.float64, stiffness: wp.float64):
    """Bristle of Dahl (1968) and LuGre (Canudas de Wit 1995): Ḟ = σ (v − |v| F/g)."""
    return stiffness * (v - wp.abs(v) * force / level)


@wp.func
def maxwell_rate(v: wp.float64, force: wp.float64, level: wp.float64, stiffness: wp.float64):
    """An element of a Maxwell-slip model (Al-Bender, Lampaert, Swevers 2005), with a rounded yield.

    Ḟ = σ v (1 − ½ (1 + sgn(v F)) |F/s|²): elastic when unloading, gliding at the level s.
    """
    share = force / level
    loading = HALF * (ONE + wp.sign(v * force))
    return stiffness * v * (ONE - loading * share * share)


@wp.func
def bouc_wen_rate(v: wp.float64, force: wp.float64, level: wp.float64, stiffness: wp.float64):
    """Bouc–Wen hysteresis (Wen 1976), n = 2, β = 0.6, γ = 0.4: Ḟ = σ [v − (β |v| F |F| + γ v F²)/s²]."""
    share = force / level
    return stiffness * (v - f64(0.6) * wp.abs(v) * share * wp.abs(share) - f64(0.4) * v * share * share)


@wp.func
def armstrong_level(recent: wp.float64, kinetic: wp.float64, static: wp.float64, speed: wp.float64):
    """Friction level of Armstrong-Hélouvry's seven parameters (1994) at the speed ``recent`` a while ago:

    F_c + (F_s − F_c)/(1 + (v/v_s)²).
    """
    ratio = recent / speed
    return kinetic + (static - kinetic) / (ONE + ratio * ratio)


@wp.func
def coulomb(v: wp.float64, kinetic: wp.float64, static: wp.float64, speed: wp.float64):
    """Friction without memory (Brown, McPhee 2016): F_c tanh(4 v/v_t) + (F_s − F_c) (v/v_t)/(¼ (v/v_t)² + ¾)²."""
    ratio = v / speed
    bump = f64(0.25) * ratio * ratio + f64(0.75)
    return kinetic * wp.tanh(f64(4.0) * ratio) + (static - kinetic) * ratio / (bump * bump)
