"""Oil, orifices and valves of the plants. Pressures are gauge [Pa], 0 is the tank."""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false
import numpy as np
import warp as wp

from aoro_gym.diagnosis_benchmark.plants.records import Array, Constants, evaluate, f64, packed, positive, record, unit

ATMOSPHERE = wp.constant(f64(101_325.0))
"""[Pa]"""

LEAST_PRESSURE = wp.constant(f64(5_000.0))
"""Absolute pressure [Pa] below which gas expands no further, so that its law stays finite."""

DISSOLVED_AT = wp.constant(f64(30e5))
"""Pressure [Pa] from which all air is in solution: the least of the published estimates (1 to 10 MPa) that is a default
(3 MPa, Ruan and Burton's model as reviewed by Gholizadeh, Burton and Schoenau 2011)."""


@wp.func
def orifice(conductance: f64, drop: f64, laminar: f64):
    """Flow [m³/s] C Δp/√max(|Δp|, Δp_lam): turbulent, C √Δp, but linear below ``laminar`` [Pa] and continuous there."""
    return conductance * drop / wp.sqrt(wp.max(wp.abs(drop), laminar))


@wp.func
def check_valve(conductance: f64, drop: f64, crack: f64, laminar: f64):
    """Flow [m³/s] of an orifice that opens at ``crack`` [Pa] and lets nothing back."""
    flow = f64(0.0)
    if drop > crack:
        flow = orifice(conductance, drop - crack, laminar)
    return flow


@wp.func
def relief_valve(drop: f64, setting: f64, gain: f64):
    """Flow [m³/s] of a relief valve that opens at ``setting`` [Pa] by ``gain`` [m³/s/Pa]."""
    return gain * positive(drop - setting)


Oil = record("Oil", "modulus slope exponent share", level=wp.int32)
"""Modulus [Pa] of the liquid, its slope by pressure, the air's polytropic exponent and share, and which law of air."""


def oil_of(p: Constants, level: int, share: Array | None = None) -> dict[str, Array]:
    """Fields of :data:`Oil` (R,), with another ``share`` of air if one is given."""
    return {
        "modulus": p["oil.bulk_modulus"], "slope": p["oil.bulk_modulus_slope"],
        "exponent": p["oil.polytropic_exponent"], "share": p["oil.gas_fraction"] if share is None else share,
        "level": np.full_like(p["oil.bulk_modulus"], level),
    }  # fmt: skip


@wp.func
def air(oil: Oil, pressure: f64):
    """Volume of the oil and of the air that is still free, a unit of each at atmospheric pressure, and 1/(n P) of the air,
    each with its derivative by the pressure."""
    absolute = wp.max(pressure + ATMOSPHERE, LEAST_PRESSURE)
    stiffness = f64(1.0) / (oil.exponent * absolute)
    gas = wp.pow(ATMOSPHERE / absolute, f64(1.0) / oil.exponent)
    liquid, liquid_slope, gas_slope = f64(1.0), f64(0.0), -gas * stiffness
    if oil.level > 0:
        liquid = wp.exp(-pressure / oil.modulus)
        liquid_slope = -liquid / oil.modulus
        s = unit(pressure / DISSOLVED_AT)
        free, free_slope = (f64(1.0) - s) * (f64(1.0) - s) * (f64(1.0) + f64(2.0) * s), -f64(6.0) * s * (f64(1.0) - s)
        if oil.level == 3:
            free = positive(f64(1.0) - f64(2.0) * s)
            free_slope = wp.where(free > f64(0.0) and s > f64(0.0), f64(-2.0), f64(0.0))
        gas_slope = gas_slope * free + gas * free_slope / DISSOLVED_AT
        gas = gas * free
    return liquid, liquid_slope, gas, gas_slope, stiffness, -stiffness / absolute


@wp.func
def compressibility(oil: Oil, pressure: f64):
    """Tangent compressibility 1/β [1/Pa] of oil with free air at ``pressure``, and its derivative by it.

    Level 0: the air is a share α of the volume at atmospheric pressure and is compressed polytropically, none dissolves::

        1/β = [(1−α)/β_l(p) + G/(n P)] / [(1−α) + G],   G = α (P₀/P)^{1/n},   β_l = β₀ + m p

    Level 1 and 2: Cho's form of Nykänen's model (the oil's share shrinks with pressure, too) with Henry's dissolution: the
    free share falls as α ψ(p), ψ = (1−s)²(1+2s), s = p/p_c, to nothing at p_c. What is dissolved at a pressure is taken as
    settled; that dissolving takes time is left out. Source: survey of Gholizadeh, Burton and Schoenau, Int. J. Fluid
    Power 12 (2011).

    Level 3: the same with Henry's law as it stands, ψ = 1 − s, which dissolves the air by half of p_c (estimate).
    """
    value = f64(1.0) / (oil.modulus + oil.slope * positive(pressure))
    rise = wp.where(pressure > f64(0.0), -oil.slope * value * value, f64(0.0))
    if oil.share > f64(0.0) and (oil.level == 0 or pressure < DISSOLVED_AT):
        liquid, liquid_slope, gas, gas_slope, stiffness, stiffness_slope = air(oil, pressure)
        rest = f64(1.0) - oil.share
        total = rest * liquid + oil.share * gas
        total_slope = rest * liquid_slope + oil.share * gas_slope
        yielding_slope = rest * (liquid_slope * value + liquid * rise) + oil.share * (
            gas_slope * stiffness + gas * stiffness_slope
        )
        value = (rest * liquid * value + oil.share * gas * stiffness) / total
        rise = (yielding_slope - value * total_slope) / total
    return value, rise


@wp.func
def _compressibility(oil: Oil, pressure: f64):
    value, _rise = compressibility(oil, pressure)
    return value


@wp.func
def _air(oil: Oil, pressure: f64):
    _liquid, _liquid_slope, gas, _gas_slope, _stiffness, _stiffness_slope = air(oil, pressure)
    return gas


def compressibility_of(oil: dict[str, Array], pressure: Array | float) -> Array:
    """1/β [1/Pa] (..., R) of :func:`oil_of` at ``pressure``."""
    return evaluate(_compressibility, packed(Oil, oil, len(oil["modulus"])), Oil, pressure)


def air_for(oil: dict[str, Array], modulus: Array | float, pressure: float) -> Array:
    """Share α of air (R,) with which the tangent modulus at ``pressure`` [Pa] is ``modulus`` [Pa].

    The compressibility is a quotient of two terms linear in α, so α follows in closed form.
    """
    gas = evaluate(_air, packed(Oil, oil, len(oil["modulus"])), Oil, pressure)
    level = oil["level"][0]
    liquid, wanted = 1.0 / (oil["modulus"] + oil["slope"] * pressure), 1.0 / np.asarray(modulus)
    shrunk = np.exp(-pressure / oil["modulus"]) if level else 1.0
    stiffness = 1.0 / (oil["exponent"] * (pressure + float(ATMOSPHERE)))
    return shrunk * (wanted - liquid) / (gas * (stiffness - wanted) + shrunk * (wanted - liquid))


def viscosity(celsius: Array | float) -> Array:
    """Kinematic viscosity [m²/s] of a VG 46 oil by Walther's law, log log(ν + 0.7) = A − B log T, through 80 mm²/s at 30 °C
    and 12 mm²/s at 75 °C (lecture text on hydraulic fluids; it then gives 46.9 at 40 °C, nominally 46)."""
    warm, hot = np.log10(303.15), np.log10(348.15)
    at_warm, at_hot = np.log10(np.log10(80.7)), np.log10(np.log10(12.7))
    slope = (at_warm - at_hot) / (hot - warm)
    return 1e-6 * (10.0 ** (10.0 ** (at_warm - slope * (np.log10(np.asarray(celsius) + 273.15) - warm))) - 0.7)


def density(celsius: Array | float) -> Array:
    """Density [kg/m³], 870 at 15 °C, falling by 6.5e-4 a kelvin."""
    return 870.0 * (1.0 - 6.5e-4 * (np.asarray(celsius) - 15.0))
