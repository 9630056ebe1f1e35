"""Oil with undissolved air: effective bulk modulus by published laws. Pressures are absolute [Pa]; results [Pa].

Reviewed and compared in Gholizadeh, Burton, Schoenau: Fluid bulk modulus, comparison of low pressure models,
Int. J. Fluid Power 13 (2012) 7–16.
"""

import warp as wp

from aoro_gym.units import ATMOSPHERIC_PRESSURE

from .numbers import ONE, ZERO, f64, unit

ATMOSPHERE = wp.float64(ATMOSPHERIC_PRESSURE)
VACUUM = wp.float64(1000.0)  # below this pressure a chamber counts as vapour


@wp.func
def nykanen(p: wp.float64, liquid: wp.float64, air: wp.float64, exponent: wp.float64):
    """Nykänen, Esqué, Ellman (2000): gas and liquid in mechanical equilibrium, no gas dissolves.

    β = [X (p₀/p)^{1/n} + 1 − X]² / [X/(n p) (p₀/p)^{1/n} + (1 − X)/β_l], X volume share of gas at p₀, polytropic n.
    Valid for p > 0; β → n p for p → 0 and X > 0.
    """
    at = wp.max(p, VACUUM)
    gas = air * wp.pow(ATMOSPHERE / at, ONE / exponent)
    volume = gas + ONE - air
    return volume * volume / (gas / (exponent * at) + (ONE - air) / liquid)


@wp.func
def yu(p: wp.float64, liquid: wp.float64, air: wp.float64, exponent: wp.float64, dissolving: wp.float64):
    """Yu, Chen, Lu (1994): gas that dissolves in proportion to pressure, X (1 − c (p − p₀)), c > 0 [1/Pa].

    β = β_l (1 + g) / (1 + g β_l/(n p)), g = X (1 − c (p − p₀)) (p₀/p)^{1/n}, never below zero.
    """
    at = wp.max(p, VACUUM)
    left = air * wp.max(ZERO, ONE - dissolving * (at - ATMOSPHERE))
    gas = left * wp.pow(ATMOSPHERE / at, ONE / exponent)
    return liquid * (ONE + gas) / (ONE + gas * liquid / (exponent * at))


@wp.func
def ruan_burton(p: wp.float64, liquid: wp.float64, air: wp.float64, exponent: wp.float64, critical: wp.float64):
    """Ruan, Burton (2006): compression and dissolution up to a critical pressure, pure liquid above it.

    β = (1 + g)/(1/β_l + g/(n p)), g = X ψ(p) (p₀/p)^{1/n}, ψ = 1 − 3 L² + 2 L³, L = (p − p₀)/(p_c − p₀) in [0, 1].
    """
    at = wp.max(p, VACUUM)
    share = unit((at - ATMOSPHERE) / (critical - ATMOSPHERE))
    left = air * (ONE - share * share * (f64(3.0) - f64(2.0) * share))
    gas = left * wp.pow(ATMOSPHERE / at, ONE / exponent)
    return (ONE + gas) / (ONE / liquid + gas / (exponent * at))
