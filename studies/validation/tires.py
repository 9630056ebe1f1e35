"""Side force of the twin's tire laws beside a measured tire, and its stiffness beside two.

No force curve of a forestry tire could be had. The nearest with public coefficients is Goodyear's 335/65R22.5 G275 MSA, an
on- and off-road truck tire: Calspan measured its side force, and the coefficients (MF-Tyre 5.0) stand in Project Chrono's
``data/vehicle/feda/tires/335_65R22_5_G275MSA_40psi.tir``. Its longitudinal coefficients are the fitting program's
defaults, as the file says, and are not used.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.machine import Machine

NOMINAL, LOAD = 16929.0, 23809.0
"""Load [N] that the coefficients are about, and the largest that was measured; a wheel of AORO carries 24.5 kN."""
STEEPEST = 0.1968
"""Slip angle [rad] up to which both sides were measured."""
PRESSURE = 2.7
"""Inflation of the measured tire [bar]."""
STIFFNESSES = (
    ("335/65R22.5 G275 MSA, Project Chrono's file", "2.7 bar", 406.52),
    ("495/70R24 XM47, rolling, 1600 kg (Keen, EAEC01/01041, abstract)", "1 bar", 328.0),
    ("the same", "3 bar", 645.0),
)
"""Measured tires, their inflation and vertical stiffness [kN/m]."""
ANGLES = (0.5, 1.0, 2.0, 4.0, 6.0, 8.0, 11.0)
"""Slip angles [°] of the page."""
SPEED = 1.0
"""Speed [m/s] at which the twin's laws are taken."""

Floats = NDArray[np.float64]


def measured_force(angle: ArrayLike, load: float = LOAD) -> Floats:
    """Side force over load [-] of the measured tire at slip ``angle`` [rad], not cambered, mean of both sides.

    Magic formula, Pacejka, *Tire and Vehicle Dynamics* (3rd ed. 2012), section 4.3, with the file's ``P..Y`` coefficients.
    """
    more = load / NOMINAL - 1.0
    peak, shape = -0.70977 + 0.14161 * more, 1.5328
    steepness = cornering_stiffness(load) / (shape * -peak)
    shift, offset = 4.7162e-3 + 9.7415e-5 * more, 0.013920 - 0.011621 * more

    def one_side(slip: Floats) -> Floats:
        x = slip + shift
        curvature = (0.085482 - 0.041758 * more) * (1.0 - 0.83929 * np.sign(x))
        return (
            peak * np.sin(shape * np.arctan(steepness * x - curvature * (steepness * x - np.arctan(steepness * x))))
            + offset
        )

    slip = np.asarray(angle, dtype=np.float64)
    return 0.5 * (one_side(-slip) - one_side(slip))


def cornering_stiffness(load: float = LOAD) -> float:
    """Slope of the side force over load [1/rad] at no slip."""
    return 14.584 * NOMINAL * float(np.sin(2.0 * np.arctan(load / (2.1214 * NOMINAL)))) / load


def steady_lugre(machine: Machine, angle: ArrayLike, speed: float = SPEED) -> Floats:
    """Side force over load [-] of the law ``lugre`` in steady slip: g(v) + σ₂ v at the side speed v, whatever the angle."""
    tire, side = machine.tire, speed * np.sin(np.asarray(angle, dtype=np.float64))
    grip = tire.friction_coulomb + (tire.friction_static - tire.friction_coulomb) * np.exp(
        -((side / tire.stribeck_velocity) ** 2)
    )
    return np.where(side > 0.0, grip + tire.sigma2_lateral * side, 0.0)


def way_to_grip(machine: Machine, angle: ArrayLike) -> Floats:
    """Way [m] rolled until the bristle of ``lugre`` carries 63 % of its steady force: g/σ₀ of sideways motion."""
    tire = machine.tire
    return np.asarray(tire.friction_static / tire.sigma0_lateral / np.tan(angle), dtype=np.float64)


def steady_relaxation(machine: Machine, angle: ArrayLike, speed: float = SPEED) -> Floats:
    """Side force over load [-] of the law ``relaxation`` in steady slip: σ₀ ℓ tan α up to the friction g(v)."""
    tire, slip = machine.tire, np.asarray(angle, dtype=np.float64)
    side = speed * np.sin(slip)
    grip = tire.friction_coulomb + (tire.friction_static - tire.friction_coulomb) * np.exp(
        -((side / tire.stribeck_velocity) ** 2)
    )
    return np.minimum(tire.sigma0_lateral * tire.relaxation_lateral * np.tan(slip), grip)


def compared() -> dict[str, Any]:
    """Curves of the page: slip angles [°], side force over load of the measured tire and of both laws of the data sheet."""
    angle, sheet = np.radians(ANGLES), Machine.load("aoro_datasheet")

    def listed(values: Floats) -> list[float]:
        return [float(f"{value:.4g}") for value in values]

    return {
        "angle_deg": list(ANGLES),
        "measured": listed(measured_force(angle)),
        "lugre": listed(steady_lugre(sheet, angle)),
        "lugre_way_m": listed(way_to_grip(sheet, angle)),
        "relaxation": listed(steady_relaxation(sheet, angle)),
        "cornering_stiffness": {
            "measured": float(f"{cornering_stiffness():.4g}"),
            "relaxation": float(sheet.tire.sigma0_lateral * sheet.tire.relaxation_lateral),
        },
        "stiffness_kN_per_m": {
            "measured": [list(one) for one in STIFFNESSES], "twin": float(sheet.tire.stiffness) / 1e3
        },
    }  # fmt: skip
