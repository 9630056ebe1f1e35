"""Soft ground under a tire: how deep it sinks, what its rut costs, and how much the soil can be sheared.

- Pressure and sinkage: Bekker, p = (k_c/b + k_φ) zⁿ; for peat with Wong's surface mat, p = k z + 4 m z²/D_h.
- Unloading and reloading: Wong, p = p_u − k_u (z_u − z) with k_u = k₀ + A_u z_u, from the deepest sinkage z_u that the place
  remembers; beyond it the virgin curve goes on.
- Shear: Janosi and Hanamoto, τ = (c + p tan φ) (1 − exp(−j/K)).
- Motion resistance: the horizontal part of the normal pressure on the wheel's arc, ∫ b p dz. For a rigid wheel on virgin
  soil that is Bekker's compaction resistance b (k_c/b + k_φ) z₀ⁿ⁺¹/(n + 1).
- Slip sinkage, where a soil has it: Lyasko, a wheel that slips by s sinks κ = (1 + s)/(1 − s/2) times as deep under the
  same pressure, p(z/κ) in place of p(z); a soil may have a part c of it, κ = (1 + c s)/(1 − c s/2).
- Passes, where a soil has them: the wheel that is the n-th over a place sinks n^m times as deep under the same pressure,
  p(z/n^m), so zₙ = z₁ n^m of a plate. Forestry's z₁ n^(1/a) has m = 1/a, with a of 2 to 3 in loose soil, 3 to 4 in medium
  and 4 to 5 in firm one. n changes as a wheel comes; what softens takes energy, and never gives any.
- Sideways: passive earth pressure on the sunk flank, ½ γ z² N_φ + 2 c z √N_φ a metre (Rankine).

The tire is a circle that its load flattens: depth z(x) = min(z₀, D − R + √(R² − x²)) at x [m] ahead of the axle. D is the
depth of the unloaded circle under the undisturbed surface, z₀ that of its flat base, D − z₀ the tire's own deflection.

Sources: Bekker, *Introduction to Terrain-Vehicle Systems* (1969); Wong, *Theory of Ground Vehicles* (4th ed. 2008), chapter
2, and *Terramechanics and Off-Road Vehicle Engineering* (2nd ed. 2010), chapters 4 and 5; Janosi and Hanamoto (1st Int.
Conf. Terrain-Vehicle Systems, 1961); Lyasko, *Slip sinkage effect in soil-vehicle mechanics* (J. Terramechanics 47, 2010,
pp. 21–31), whose formula was read in open code that names it; Saarilahti, *Maastoliikkuvuuden perusteet* (1991), equation
6.8 of passes, likewise; a raster that remembers: Krenn and Hirzinger, *SCM – a soil contact model for planetary rover
mobility simulations* (2008). Recalled, not read again (R).

Left out: the vertical part of shear on the arc, soil that the tire pushes ahead of it, lugs, rate of loading,
and berms: all soil of a rut is taken as compacted.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
from typing import Any

import warp as wp

from aoro_gym.twin.physics.friction import bristle_step
from aoro_gym.twin.physics.tires import Tire, lugre_capacity

EDGE = wp.constant(0.025)  # [m] by which a tire is wider to either side than its outer discs stand apart: 0.53 m in all
FIRM = wp.constant(1.0e8)  # [N/m³] stiffness of the firm ground below a soft layer
LEAST_REBOUND = wp.constant(2.0)  # [-] secant moduli p/z that unloading is stiff at least: half the depth comes back
SINKAGE_STEP = wp.constant(1.0e-3)  # [m] by which the base moves in a main step at most
FLANK_REGULARISATION = wp.constant(0.05)  # [m/s] lateral speed below which the push of the flank fades
POINTS = wp.constant(10)  # of the contact: four on the arc ahead, four on that behind, two on the flat base
GAUSS_PLACES = wp.constant(wp.vec4(0.06943184, 0.33000948, 0.66999052, 0.93056816))  # of four points on [0, 1]
GAUSS_WEIGHTS = wp.constant(wp.vec4(0.17392742, 0.32607258, 0.32607258, 0.17392742))
BASE_PLACE = wp.constant(0.57735027)  # of two points on [−1, 1]


@wp.struct
class Soil:
    """One soil."""

    k_c: float  # [N/m^(n+1)]
    k_phi: float  # [N/m^(n+2)]
    exponent: float  # [-] n
    mat: float  # [N/m³] m of a surface mat
    depth: float  # [m] of the soft layer; firm ground below
    cohesion: float  # [Pa]
    tan_phi: float  # [-] tangent of the angle of internal friction
    shear_modulus: float  # [m] K
    k_0: float  # [N/m³] unloading
    a_u: float  # [N/m⁴]
    flank_cohesion: float  # [Pa] 2 c √N_φ
    flank_weight: float  # [N/m³] ½ γ N_φ
    slip_sinkage: float  # [-] c: part of Lyasko's slip sinkage
    pass_exponent: float  # [-] m: the n-th wheel over a place sinks n^m times as deep


@wp.struct
class Patch:
    """A tire in soil, and how it moves."""

    radius: float  # [m] unloaded
    width: float  # [m]
    depth: float  # [m] D: of the unloaded circle under the undisturbed surface
    sinkage: float  # [m] z₀: of the flat base
    shear: float  # [m] shear displacement at the end of the contact
    roll: float  # [m/s] rolling speed; its sign says where the soil enters
    x: float  # [m] the axle in plan
    y: float
    east: float  # [-] rolling direction in plan, unit
    north: float


@wp.struct
class Reaction:
    """What soil does to a tire."""

    load: float  # [N] along the normal
    slope: float  # [N/m] of the load with the sinkage of the base
    resistance: float  # [N] against the rolling direction; negative where the soil behind presses more
    grip: float  # [N] that its shear strength can bear at this shear displacement
    flank: float  # [N] that its flank bears sideways
    length: float  # [m] of the contact


@wp.struct
class UniformRut:
    """A soil whose deepest sinkage is everywhere the same; 0: virgin."""

    deepest: float  # [m]


@wp.func
def remembered(memory: UniformRut, twin: int, x: float, y: float):
    """Deepest sinkage [m] at the plan position (x, y) [m]."""
    return memory.deepest


@wp.func
def recall(memory: Any, s: Soil, twin: int, x: float, y: float):
    """Deepest sinkage [m] at the plan position (x, y) [m], and how many times as deep wheels sink there as in virgin soil
    [-]: 1 where passes are not counted."""
    return remembered(memory, twin, x, y), 1.0


@wp.func
def contact_width(m: Tire):
    """Width b [m] of a tire."""
    return 2.0 * (m.disc_offset_outer + EDGE)


@wp.func
def half_chord(radius: float, rise: float):
    """Half of a circle's chord [m] at ``rise`` [m] over its lowest point: √(h (2 R − h)), R at most."""
    h = wp.clamp(rise, 0.0, radius)
    return wp.sqrt(h * (2.0 * radius - h))


@wp.func
def slip_sinkage_factor(s: Soil, slip: float):
    """κ = (1 + c s)/(1 − c s/2) [-] at a ``slip`` s [-]: 1 without slip, or of a soil without slip sinkage."""
    part = s.slip_sinkage * wp.clamp(slip, 0.0, 1.0)
    return (1.0 + part) / (1.0 - 0.5 * part)


@wp.func
def pass_sinkage_factor(s: Soil, passes: int):
    """n^m [-] under the wheel that is the n-th over a place, which counts n ``passes``; 1 under the first."""
    return wp.pow(float(wp.max(passes, 1)), s.pass_exponent)


@wp.func
def virgin_pressure(s: Soil, width: float, length: float, dug: float, sinkage: float):
    """Pressure [Pa] under a plate of ``width`` by ``length`` [m] at its first ``sinkage`` z [m], and its slope [Pa/m].

    p = (k_c/b + k_φ) (z/κ)ⁿ + 4 m (z/κ)²/D_h with D_h = 2 b ℓ/(b + ℓ), the hydraulic diameter of the plate, κ what the wheel
    has ``dug`` by its slip (:func:`slip_sinkage_factor`) times what those before it have (:func:`pass_sinkage_factor`),
    and 10⁸ N/m³ for each metre below the soft layer.
    """
    z = wp.max(sinkage, 1.0e-6) / dug
    bekker = (s.k_c / width + s.k_phi) * wp.pow(z, s.exponent)
    mat = 2.0 * s.mat * (width + length) / (width * length)
    pressure = bekker + mat * z * z + FIRM * wp.max(sinkage - s.depth, 0.0)
    slope = (s.exponent * bekker / z + 2.0 * mat * z) / dug + wp.where(sinkage > s.depth, FIRM, 0.0)
    return pressure, slope


@wp.func
def unloading_modulus(s: Soil, pressure: float, deepest: float):
    """k_u = k₀ + A_u z_u [N/m³] of soil that bore ``pressure`` [Pa] at its ``deepest`` sinkage z_u [m]; at least 2 p/z_u, so
    that it never gives back more than half of its sinkage."""
    return wp.max(s.k_0 + s.a_u * deepest, LEAST_REBOUND * pressure / wp.max(deepest, 1.0e-6))


@wp.func
def soil_pressure(s: Soil, width: float, length: float, dug: float, sinkage: float, deepest: float):
    """Pressure [Pa] at a ``sinkage`` [m] of soil that was pressed to its ``deepest`` one before, and its slope [Pa/m]; see
    :func:`virgin_pressure`."""
    pressure, slope = virgin_pressure(s, width, length, dug, wp.max(sinkage, deepest))
    if sinkage < deepest:
        slope = unloading_modulus(s, pressure, deepest)
        pressure -= slope * (deepest - sinkage)
        if pressure <= 0.0:
            pressure = 0.0
            slope = 0.0
    return pressure, slope


@wp.func
def rut_depth(s: Soil, width: float, length: float, dug: float, deepest: float):
    """Depth [m] that stays when soil unloads: z_u − p_u/k_u; see :func:`virgin_pressure`."""
    pressure, slope = virgin_pressure(s, width, length, dug, deepest)  # noqa: RUF059
    return wp.max(deepest - pressure / unloading_modulus(s, pressure, deepest), 0.0)


@wp.func
def janosi(s: Soil, pressure: float, shear: float):
    """Shear stress [Pa] at a ``shear`` displacement j [m]: (c + p tan φ) (1 − exp(−j/K))."""
    return (s.cohesion + pressure * s.tan_phi) * (1.0 - wp.exp(-shear / s.shear_modulus))


@wp.func
def flank_pressure(s: Soil, z: float):
    """Passive earth pressure [N/m] on a flank that is sunk by z [m]: 2 c z √N_φ + ½ γ z² N_φ."""
    return z * (s.flank_cohesion + s.flank_weight * z)


@wp.func
def bearing_arc(s: Soil, memory: Any, twin: int, w: Patch, length: float, dug: float, end: float):
    """Half a chord [m] up to where soil bears on the arc whose ``end`` [m] lies ahead (behind, if negative) of the axle: up
    to its depth that stayed in a rut, as the soil remembers it there."""
    deepest, before = recall(memory, s, twin, w.x + end * w.east, w.y + end * w.north)
    kept = wp.min(rut_depth(s, w.width, length, dug * before, deepest), w.sinkage)
    return half_chord(w.radius, w.depth - kept)


@wp.func
def wheel_reaction(s: Soil, memory: Any, twin: int, w: Patch):
    """What soil does to a tire at a sinkage, by quadrature of its pressure over the contact.

    Gauss points on the arc ahead (4), the flat base (2) and the arc behind (4); on the arcs in the square root of the
    way from the base, up to where soil bears: what reloads and comes up lies within some mm of depth, which points on the
    whole arc would miss. The soil remembers along the middle line of the tire. Shear displacement grows linearly from where
    soil begins to bear. The flank is sunk over the whole of both arcs, whether soil bears below them or not.
    """
    out = Reaction()
    flat = half_chord(w.radius, w.depth - w.sinkage)
    end = half_chord(w.radius, w.depth)
    out.length = wp.max(flat + end, 1.0e-3)
    dug = slip_sinkage_factor(s, w.shear / out.length)  # J/ℓ is the slip, of the last contact length
    reach_ahead = bearing_arc(s, memory, twin, w, out.length, dug, end)
    reach_behind = bearing_arc(s, memory, twin, w, out.length, dug, -end)
    entry = wp.where(w.roll < 0.0, reach_behind, reach_ahead)
    points = int(POINTS)
    for i in range(points):
        place = float(0.0)
        weight = flat
        ahead = float(0.0)  # of the arc's depth against x [-]
        z = w.sinkage
        if i < 8:
            share = GAUSS_PLACES[i & 3]
            arc = wp.where(i < 4, reach_ahead, reach_behind) - flat
            place = flat + arc * share * share
            weight = 2.0 * arc * share * GAUSS_WEIGHTS[i & 3]
            rest = wp.sqrt(wp.max(w.radius * w.radius - place * place, 1.0e-6))
            z = w.depth - w.radius + rest
            ahead = place / rest
            if i < 4:
                sunk = flat + (end - flat) * share * share
                side = w.depth - w.radius + wp.sqrt(wp.max(w.radius * w.radius - sunk * sunk, 1.0e-6))
                both = 4.0 * (end - flat) * share * GAUSS_WEIGHTS[i]
                out.flank += both * flank_pressure(s, wp.max(side, 0.0))
            else:
                place = -place
                ahead = -ahead
        else:
            place = wp.where(i == 8, flat, -flat) * BASE_PLACE
            out.flank += weight * flank_pressure(s, z)
        z = wp.max(z, 0.0)
        deepest, before = recall(memory, s, twin, w.x + place * w.east, w.y + place * w.north)
        pressure, slope = soil_pressure(s, w.width, out.length, dug * before, z, deepest)
        out.load += w.width * weight * pressure
        out.resistance += w.width * weight * pressure * ahead
        if i >= 8:
            out.slope += w.width * weight * slope
        if pressure > 0.0:
            way = entry - wp.where(w.roll < 0.0, -place, place)
            out.grip += w.width * weight * janosi(s, pressure, w.shear * wp.max(way, 0.0) / out.length)
    return out


@wp.func
def sinkage_step(stiffness: float, w: Patch, r: Reaction):
    """Sinkage [m] of the base a Newton step nearer to where tire and soil bear the same load, k (D − z₀) = F(z₀), and by
    ``SINKAGE_STEP`` at most: so it cannot leap over soil that reloads."""
    change = (stiffness * (w.depth - w.sinkage) - r.load) / (stiffness + r.slope)
    return wp.clamp(w.sinkage + wp.clamp(change, -SINKAGE_STEP, SINKAGE_STEP), 0.0, w.depth)


@wp.func
def shear_step(shear: float, slip_x: float, slip_y: float, roll: float, way: float, length: float, width: float, dt: float):
    """Shear displacement [m] at the contact's end after ``dt``: J̇ = |v_s| − J (max(|Ω r|, |V|)/ℓ + |v_y|/b).

    In steady rolling J = i ℓ, with the slip i = 1 − V/(Ω r) of a driven wheel, 1 − Ω r/V of a braked one; a wheel that
    stands shears its soil by the way that it slips. ``roll`` Ω r, ``way`` V and slips in [m/s].
    """
    slip = wp.sqrt(slip_x * slip_x + slip_y * slip_y)
    renewed = wp.max(wp.abs(roll), wp.abs(way)) / length + wp.abs(slip_y) / width
    return bristle_step(shear, slip, renewed, dt)


@wp.func
def soil_friction(m: Tire, grip: float, load: float, speed: float, friction: float):
    """Multiplier [-] of the tire's friction: what the soil bears of the ``load`` [N] at a slip ``speed`` [m/s], and no
    more than the ground's own ``friction``, that of rubber on it."""
    capacity = lugre_capacity(m, speed, 1.0) * wp.max(load, 1.0)
    return wp.clamp(grip / capacity, 1.0e-4, friction)


@wp.func
def flank_force(r: Reaction, slip: float):
    """Force [N] of the soil beside a sunk tire against a lateral ``slip`` v [m/s]: F v/√(v² + v₀²)."""
    return r.flank * slip / wp.sqrt(slip * slip + FLANK_REGULARISATION * FLANK_REGULARISATION)
