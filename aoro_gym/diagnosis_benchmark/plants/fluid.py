"""Oil, orifices and valves of the plants.

Pressures are gauge [Pa], 0 is the tank; every argument is a float or an array whose last axis is the runs (R,).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Constants = Mapping[str, Array]
"""SI values by dotted key, each (R,)."""

ATMOSPHERE = 101_325.0
"""[Pa]"""

LEAST_PRESSURE = 5_000.0
"""Absolute pressure [Pa] below which gas expands no further, so that its law stays finite."""

DISSOLVED_AT = 30e5
"""Pressure [Pa] from which all air is in solution: the least of the published estimates (1 to 10 MPa) that is a default
(3 MPa, Ruan and Burton's model as reviewed by Gholizadeh, Burton and Schoenau 2011)."""


def orifice(conductance: Array | float, drop: Array, laminar: Array | float) -> Array:
    """Flow [m³/s] C Δp/√max(|Δp|, Δp_lam): turbulent, C √Δp, but linear below ``laminar`` [Pa] and continuous there."""
    return conductance * drop / np.sqrt(np.maximum(np.abs(drop), laminar))


def check_valve(conductance: Array | float, drop: Array, crack: Array | float, laminar: Array | float) -> Array:
    """Flow [m³/s] of an orifice that opens at ``crack`` [Pa] and lets nothing back."""
    above = np.maximum(drop - crack, 0.0)
    return conductance * above / np.sqrt(np.maximum(above, laminar))


def relief_valve(drop: Array, setting: Array | float, gain: Array | float) -> Array:
    """Flow [m³/s] of a relief valve that opens at ``setting`` [Pa] by ``gain`` [m³/s/Pa]."""
    return gain * np.maximum(drop - setting, 0.0)


class Oil:
    """Tangent compressibility of oil with free air.

    Level 0: the air is a share α of the volume at atmospheric pressure and is compressed polytropically, none dissolves::

        1/β = [(1−α)/β_l(p) + G/(n P)] / [(1−α) + G],   G = α (P₀/P)^{1/n},   β_l = β₀ + m p

    Level 1 and 2: Cho's form of Nykänen's model (the oil's share shrinks with pressure, too) with Henry's dissolution: the
    free share falls as α ψ(p), ψ = (1−s)²(1+2s), s = p/p_c, to nothing at p_c. What is dissolved at a pressure is taken as
    settled; that dissolving takes time is left out. Source: survey of Gholizadeh, Burton and Schoenau, Int. J. Fluid
    Power 12 (2011).

    Level 3: the same with Henry's law as it stands, ψ = 1 − s, which dissolves the air by half of p_c (estimate).
    """

    def __init__(self, constants: Constants, level: int, share: Array | None = None):
        self.modulus = constants["oil.bulk_modulus"]
        self.slope = constants["oil.bulk_modulus_slope"]
        self.exponent = constants["oil.polytropic_exponent"]
        self.share = constants["oil.gas_fraction"] if share is None else share
        self.level = level
        self.aerated = bool(np.any(self.share > 0.0))

    def liquid_modulus(self, pressure: Array | float) -> Array:
        """Of the oil without air [Pa]."""
        return self.modulus + self.slope * np.maximum(pressure, 0.0)

    def compressibility(self, pressure: Array) -> Array:
        """1/β [1/Pa] at ``pressure`` (..., R)."""
        liquid = 1.0 / self.liquid_modulus(pressure)
        if not self.aerated:
            return liquid
        oil, gas, stiffness = self._parts(pressure)
        free = self.share * gas
        return ((1.0 - self.share) * oil * liquid + free * stiffness) / ((1.0 - self.share) * oil + free)

    def air_for(self, modulus: Array | float, pressure: Array | float) -> Array:
        """Share α of air (R,) with which the tangent modulus at ``pressure`` [Pa] is ``modulus`` [Pa].

        The compressibility is a quotient of two terms linear in α, so α follows in closed form.
        """
        at = np.asarray(pressure, dtype=np.float64)
        liquid, wanted = 1.0 / self.liquid_modulus(at), 1.0 / np.asarray(modulus)
        oil, gas, stiffness = self._parts(at)
        return oil * (wanted - liquid) / (gas * (stiffness - wanted) + oil * (wanted - liquid))

    def _parts(self, pressure: Array) -> tuple[Array | float, Array, Array]:
        """Volume of the oil and of the air that is still free, a unit of each at atmospheric pressure, and 1/(n P)."""
        absolute = np.maximum(pressure + ATMOSPHERE, LEAST_PRESSURE)
        gas = (ATMOSPHERE / absolute) ** (1.0 / self.exponent)
        stiffness = 1.0 / (self.exponent * absolute)
        if self.level == 0:
            return 1.0, gas, stiffness
        dissolving = np.minimum(np.maximum(pressure / DISSOLVED_AT, 0.0), 1.0)
        free = (1.0 - dissolving) ** 2 * (1.0 + 2.0 * dissolving)
        if self.level == 3:
            free = np.maximum(1.0 - 2.0 * dissolving, 0.0)
        return np.exp(-pressure / self.modulus), gas * free, stiffness


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
