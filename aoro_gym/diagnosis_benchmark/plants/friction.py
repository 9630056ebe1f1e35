"""Dry friction: what resists at a speed, and what sticking remembers.

Level 0: Stribeck capacity over a Prandtl element (spring and damper that slide at the capacity). Level 1 and 2: Brown and
McPhee's continuous law for joint and cylinders, Dahl's for the wheels, which have to hold on a slope. Level 3: Makkar's
continuous law, and Dahl's.
"""

# device code: its types are Warp's
# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportOperatorIssue=false
# pyright: reportCallIssue=false, reportIndexIssue=false, reportArgumentType=false, reportAssignmentType=false
import warp as wp

from aoro_gym.diagnosis_benchmark.plants.records import clipped, f64, square

CREEP = wp.constant(f64(1e-3))
"""Cylinder speed [m/s] at which Brown and McPhee's law passes its static level; slower, the cylinder creeps."""

BEARING_RATIO = wp.constant(f64(1.15))
"""Static over sliding torque of the joint's bearing above level 0, which has none (plain steel on bronze, estimate)."""


@wp.func
def stribeck_level(sliding: f64, ratio: f64, speed: f64, stribeck: f64):
    """Capacity F_c (1 + (r − 1) exp(−(v/v_s)²)) [N]."""
    return sliding * (f64(1.0) + (ratio - f64(1.0)) * wp.exp(-square(speed / stribeck)))


@wp.func
def prandtl_force(stretch: f64, speed: f64, stiffness: f64, damping: f64, capacity: f64):
    """Force or torque on the moving part, −clip(k z + c v, ±capacity).

    Args:
        stretch: Bristle z [m or rad].
        speed: Sliding speed v [m/s or rad/s].
        stiffness: k [N/m or N m/rad].
        damping: c [N s/m or N m s/rad].
        capacity: Force or torque at which it slides [N or N m].
    """
    return -clipped(stiffness * stretch + damping * speed, capacity)


@wp.func
def brown_mcphee(speed: f64, sliding: f64, static: f64):
    """Friction on the moving part [N], without the viscous part::

        F = −F_c tanh(4x) − (F_s − F_c) x / (x²/4 + 3/4)²,   x = v / v_t

    largest, F_s to 0.1 %, at v_t = :data:`CREEP`. Source: Brown and McPhee, J. Comput. Nonlinear Dyn. 11 (2016) 054502.
    """
    x = speed / CREEP
    return -sliding * wp.tanh(f64(4.0) * x) - (static - sliding) * x / square(f64(0.25) * x * x + f64(0.75))


@wp.func
def makkar(speed: f64, sliding: f64, static: f64):
    """Friction on the moving part [N], without the viscous part::

        F = −F_c tanh(4x) − (F_s − F_c) (tanh(2x) − tanh(x/10)),   x = v / v_t,   v_t = :data:`CREEP`

    largest near 1.1 v_t, where 0.87 of F_s − F_c is added. Source: Makkar, Dixon, Sawyer and Hu, IEEE/ASME Int. Conf.
    Advanced Intelligent Mechatronics (2005) 600; their three rates are estimates here.
    """
    x = speed / CREEP
    bump = wp.tanh(f64(2.0) * x) - wp.tanh(f64(0.1) * x)
    return -sliding * wp.tanh(f64(4.0) * x) - (static - sliding) * bump


@wp.func
def dry_law(level: int, speed: f64, sliding: f64, static: f64):
    """Friction [N] of joint and cylinders above level 0."""
    if level == 3:
        return makkar(speed, sliding, static)
    return brown_mcphee(speed, sliding, static)


@wp.func
def dahl(share: f64, travel: f64, per_capacity: f64):
    """Force as a share of the capacity after ``travel`` at a constant rate: s' = κ |v| (sgn v − s), solved exactly.

    ``per_capacity`` κ [1/rad or 1/m] is stiffness over capacity. Source: Dahl, AIAA J. 14 (1976) 1675.
    """
    toward = wp.sign(travel)
    return toward + (share - toward) * wp.exp(-per_capacity * wp.abs(travel))
