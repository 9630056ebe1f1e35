"""Dry friction: what resists at a speed, and what sticking remembers.

Level 0: Stribeck capacity over a Prandtl element (spring and damper that slide at the capacity). Level 1 and 2: Brown and
McPhee's continuous law for joint and cylinders, Dahl's for the wheels, which have to hold on a slope. Level 3: Makkar's
continuous law, and Dahl's.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aoro_gym.diagnosis_benchmark.plants.fluid import Array

CREEP = 1e-3
"""Cylinder speed [m/s] at which Brown and McPhee's law passes its static level; slower, the cylinder creeps."""

BEARING_RATIO = 1.15
"""Static over sliding torque of the joint's bearing above level 0, which has none (plain steel on bronze, estimate)."""


def stribeck_level(sliding: Array, ratio: Array, speed: Array, stribeck: Array) -> Array:
    """Capacity F_c (1 + (r − 1) exp(−(v/v_s)²)) [N]."""
    return sliding * (1.0 + (ratio - 1.0) * np.exp(-((speed / stribeck) ** 2)))


def prandtl_force(
    stretch: Array, speed: Array, stiffness: Array | float, damping: Array | float, capacity: Array | float
) -> Array:
    """Force or torque on the moving part, −clip(k z + c v, ±capacity).

    Args:
        stretch: Bristle z (R,) [m or rad].
        speed: Sliding speed v (R,) [m/s or rad/s].
        stiffness: k [N/m or N m/rad].
        damping: c [N s/m or N m s/rad].
        capacity: Force or torque at which it slides [N or N m].
    """
    return -np.minimum(np.maximum(stiffness * stretch + damping * speed, -capacity), capacity)


def clipped(stretch: Array, limit: Array) -> Array:
    """``stretch`` kept within ±``limit``."""
    return np.minimum(np.maximum(stretch, -limit), limit)


def brown_mcphee(speed: Array, sliding: Array | float, static: Array | float) -> Array:
    """Friction on the moving part [N], without the viscous part::

        F = −F_c tanh(4x) − (F_s − F_c) x / (x²/4 + 3/4)²,   x = v / v_t

    largest, F_s to 0.1 %, at v_t = :data:`CREEP`. Source: Brown and McPhee, J. Comput. Nonlinear Dyn. 11 (2016) 054502.
    """
    x = speed / CREEP
    return -sliding * np.tanh(4.0 * x) - (static - sliding) * x / (0.25 * x**2 + 0.75) ** 2


def makkar(speed: Array, sliding: Array | float, static: Array | float) -> Array:
    """Friction on the moving part [N], without the viscous part::

        F = −F_c tanh(4x) − (F_s − F_c) (tanh(2x) − tanh(x/10)),   x = v / v_t,   v_t = :data:`CREEP`

    largest near 1.1 v_t, where 0.87 of F_s − F_c is added. Source: Makkar, Dixon, Sawyer and Hu, IEEE/ASME Int. Conf.
    Advanced Intelligent Mechatronics (2005) 600; their three rates are estimates here.
    """
    x = speed / CREEP
    return -sliding * np.tanh(4.0 * x) - (static - sliding) * (np.tanh(2.0 * x) - np.tanh(0.1 * x))


def dry_law(level: int) -> Callable[[Array, Array | float, Array | float], Array]:
    """Law of joint and cylinders above level 0."""
    return makkar if level == 3 else brown_mcphee


def dahl(share: Array, travel: Array, per_capacity: Array) -> Array:
    """Force as a share of the capacity after ``travel`` at a constant rate: s' = κ |v| (sgn v − s), solved exactly.

    ``per_capacity`` κ [1/rad or 1/m] is stiffness over capacity. Source: Dahl, AIAA J. 14 (1976) 1675.
    """
    toward = np.sign(travel)
    return toward + (share - toward) * np.exp(-per_capacity * np.abs(travel))
