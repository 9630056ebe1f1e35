"""Effects of tires and ground: stiffness, grip, scrub, sinkage, slope."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from aoro_gym.effects.effect import Effect, GroundEffect, MachineEffect, Magnitude, Operational
from aoro_gym.effects.magnitudes import factor, given, parameter, scaled
from aoro_gym.machine.parameters import Machine
from aoro_gym.machine.quantities import Quantity
from aoro_gym.terrains.plane import Plane
from aoro_gym.units import GRAVITY

REFERENCE_LOAD = 24.5e3
"""Wheel load [N] at which tires are measured: a quarter of the machine."""


SWIVEL = np.radians(20.0)
"""Angle [rad] by which a wheel is swivelled to measure its resistance."""


def _soft_ground(machine: Machine, resistance: Quantity) -> Mapping[str, Quantity]:
    """Bekker's compaction resistance of a rigid wheel on ground with p = k z: R/W = 0.75 √(z/D) (*Theory of Land
    Locomotion*, 1956). The sinkage z that belongs to it is bearing in series with the tire."""
    tire = machine.tire
    sinkage = 2.0 * tire.radius * (np.asarray(resistance) / 0.75) ** 2
    load = 0.25 * GRAVITY * np.asarray(machine.mass)
    in_series = 1.0 / (1.0 + tire.stiffness * sinkage / load)
    return {
        "tire.rolling_resistance": resistance,
        "tire.stiffness": machine.value("tire.stiffness") * (in_series - 1.0),
    }


def _ground_slope(plane: Plane, ahead: Quantity, left: Quantity) -> Plane:
    """Gradients add: that of the plane and that of the slope ahead (world x) and to the left (world y)."""
    direction, steepness = np.radians(plane.direction_deg), np.tan(np.radians(plane.slope_deg))
    x = steepness * np.cos(direction) + np.tan(ahead)
    y = steepness * np.sin(direction) + np.tan(left)
    level = np.equal(ahead, 0.0) & np.equal(left, 0.0)
    return Plane(
        slope_deg=np.where(level, plane.slope_deg, np.degrees(np.arctan(np.hypot(x, y)))),
        direction_deg=np.where(level, plane.direction_deg, np.degrees(np.arctan2(y, x))),
        friction=plane.friction,
        rolling_resistance=plane.rolling_resistance,
    )


def _tire_scrub(machine: Machine, radius: Quantity) -> Mapping[str, Quantity]:
    """A longer lever of the friction that resists swivelling: the bore torque's own, or one that the other laws add."""
    bore = machine.laws.obeys("swivel", "bore_torque")
    return {"tire.scrub_radius": np.where(bore, 0.0, radius), "tire.bore_radius": np.where(bore, radius, 0.0)}


def _swivel_torque(machine: Machine, *magnitude: Quantity) -> Quantity:
    """Torque after a swivel ψ from rest, of a wheel that does not roll: of one contact point M (1 − exp(−ψ/ψ₀)) (Dahl); of
    the bore torque kψ, no more than M; of five discs M, as all of them slide by then."""
    tire, laws = machine.tire, machine.laws
    sliding = tire.friction_coulomb * REFERENCE_LOAD
    point = sliding * tire.scrub_radius * (1.0 - np.exp(-SWIVEL / np.asarray(tire.scrub_angle)))
    bore = np.minimum(tire.bore_stiffness * SWIVEL, sliding * tire.bore_radius)
    offset = 0.4 * (np.asarray(tire.disc_offset_inner) + tire.disc_offset_outer)
    discs = sliding * (offset + tire.scrub_radius)
    return np.where(
        laws.obeys("swivel", "five_discs"), discs, np.where(laws.obeys("swivel", "bore_torque"), bore, point)
    )


EFFECTS: tuple[Effect, ...] = (
    MachineEffect(
        id="tire_relaxation",
        component="wheels_and_ground",
        physics="Tires that are softer or stiffer in the ground's plane: grip builds up over more or less way.",
        sign="+: stiffer",
        magnitudes=(factor(0.15, 2.5, "S13, S14: 142 to 400 kN/m; S11: up to 4.4 MN/m"),),
        operational=(
            Operational(
                "lateral stiffness of one standing tire at 24.5 kN",
                "N/m",
                parameter("tire.sigma0_lateral", REFERENCE_LOAD),
            ),
        ),
        change=scaled("tire.sigma0_longitudinal", "tire.sigma0_lateral"),
    ),
    MachineEffect(
        id="tire_stiffness",
        component="wheels_and_ground",
        physics="Tires of another inflation: other vertical stiffness.",
        sign="+: stiffer",
        magnitudes=(factor(0.5, 1.6, "S13, S14, R: 300 to 650 kN/m at 150 to 350 kPa"),),
        operational=(Operational("vertical stiffness of one tire", "N/m", parameter("tire.stiffness")),),
        change=scaled("tire.stiffness"),
    ),
    MachineEffect(
        id="tire_scrub",
        component="wheels_and_ground",
        physics="The tires' patches twist on the ground as the frames yaw, and resist it.",
        sign="+: more",
        magnitudes=(Magnitude("radius", "m", 0.0, 0.2, "S19 to S21: 2.2 to 3.9 kN m a wheel at full friction"),),
        operational=(
            Operational("torque that swivels one standing wheel by 20° from rest at 24.5 kN", "N*m", _swivel_torque),
        ),
        change=_tire_scrub,
    ),
    MachineEffect(
        id="soft_ground",
        component="wheels_and_ground",
        physics="Ground that the wheels sink into: compaction resists rolling, and the bearing is soft.",
        sign="+: more resistance",
        magnitudes=(Magnitude("resistance", "1", 0.0, 0.15, "S29: 0.05 to 0.1 on soil"),),
        operational=(
            Operational("towing resistance of a free wheel over its load", "1", parameter("tire.rolling_resistance")),
        ),
        change=_soft_ground,
    ),
    GroundEffect(
        id="ground_slope",
        component="wheels_and_ground",
        physics="The ground, taken as level, is a plane with a slope: gravity pulls on the halves.",
        sign="+: rises ahead; rises to the left",
        magnitudes=(
            Magnitude("ahead", "rad", -0.1, 0.1, "D: 0 to 3° unnoticed; E: twice that"),
            Magnitude("left", "rad", -0.1, 0.1, "D: 0 to 3° unnoticed; E: twice that"),
        ),
        operational=(
            Operational("rise of the ground along the machine's heading at the start", "rad", given),
            Operational("rise of the ground to the left of it", "rad", lambda machine, ahead, left: left),
        ),
        change=_ground_slope,
    ),
)
