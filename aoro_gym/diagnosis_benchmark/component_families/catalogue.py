"""The 33 effects: what is measured of each on any machine, and the sizes that cases draw. SI units."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from aoro_gym.units import BAR, DEGREE, LITRE_PER_MINUTE

from .vehicle import ANNULUS_AREA, BORE_AREA, STROKE, Made

SUPPLY_MARGIN = 20 * BAR
SIDE_VOLUME = 0.5 * (BORE_AREA + ANNULUS_AREA) * STROKE
"""Oil of one side in the cylinders with the joint straight [m³]."""


@dataclass(frozen=True)
class Effect:
    """One effect of the catalogue.

    Args:
        magnitude: What is measured.
        unit: Of the magnitude's change; "relative" for a share of the healthy magnitude.
        weak, strong: Sizes of cases, least and largest.
        signs: Directions that happen.
        measure: Magnitude of a family's module on a machine with all constants.
    """

    magnitude: str
    unit: str
    weak: float
    strong: float
    measure: Callable[[Any, Made], float]
    signs: tuple[int, ...] = (1,)

    @property
    def relative(self) -> bool:
        """Whether sizes are shares of the healthy magnitude."""
        return self.unit == "relative"


def kick(family: Any, m: Made) -> float:
    """Flow at the first moment of a sudden full opening to the left over the regulated one, 20 bar over valve and port."""
    edge, passage = m["edge_left"], family.open_passage(m)
    first = math.sqrt(SUPPLY_MARGIN / (edge**-2 + passage**-2))
    return first / (edge * math.sqrt(m["edge_drop"]))


SENSOR: dict[str, Effect] = {
    "sensor_delay": Effect("mean delay of the joint angle", "s", 0.006, 0.05, lambda f, m: f.angle_delay(m)),
    "sensor_filter": Effect("mean lag of the joint angle's filter", "s", 0.006, 0.06, lambda f, m: f.angle_lag(m)),
    "sensor_gain": Effect(
        "measured range of the joint over the true one", "relative", 0.01, 0.08, lambda f, m: f.span(m), (1, -1)
    ),
    "measuring_chain": Effect("mean lag of all channels", "s", 0.006, 0.05, lambda f, m: f.chain_lag(m)),
}
SUPPLY: dict[str, Effect] = {
    "engine_droop": Effect("drop of the speed at 200 N m", "1", 0.015, 0.08, lambda f, m: m["droop"]),
    "pump_response": Effect("time to 63 % of the stroke", "s", 0.04, 0.3, lambda f, m: f.pump_response(m)),
    "pump_limit": Effect(
        "highest pressure of the supply", "Pa", 50 * BAR, 130 * BAR, lambda f, m: f.pump_limit(m), (-1,)
    ),
}
VALVE: dict[str, Effect] = {
    "command_delay": Effect("mean delay of the command", "s", 0.012, 0.08, lambda f, m: f.command_delay(m)),
    "spool_lag": Effect("mean lag of small spool motions", "s", 0.012, 0.09, lambda f, m: f.spool_lag(m)),
    "spool_rate": Effect("fastest stroke of the spool", "relative", 0.35, 0.88, lambda f, m: f.spool_rate(m), (-1,)),
    "dead_band": Effect(
        "signal at which the left edge opens, share of the full one", "1", 0.02, 0.10,
        lambda f, m: m["band_left"], (1, -1),
    ),
    "valve_gain": Effect(
        "regulated flow at 75 % to the left", "relative", 0.04, 0.2, lambda f, m: f.regulated_flow(m), (1, -1)
    ),
    "valve_hysteresis": Effect("width of the loop, share of the full signal", "1", 0.025, 0.16,
                               lambda f, m: f.hysteresis(m)),
    "compensator_lag": Effect("time constant of closing", "s", 0.012, 0.1, lambda f, m: m["compensator_lag"]),
    "compensator_opening": Effect("flow at sudden opening over the regulated one", "relative", 0.04, 0.14, kick),
    "back_pressure": Effect(
        "pressure behind the return edge at 70 L/min", "Pa", 2 * BAR, 14 * BAR,
        lambda f, m: f.back_pressure(m, 70 * LITRE_PER_MINUTE),
    ),
}  # fmt: skip
OIL: dict[str, Effect] = {
    "oil_temperature": Effect("temperature of the oil", "K", 9.0, 30.0, lambda f, m: m["temperature"], (1, -1)),
    "oil_bulk_modulus": Effect(
        "bulk modulus of the liquid at 100 bar", "relative", 0.15, 0.5, lambda f, m: f.bulk_modulus(m, 100 * BAR), (1, -1)
    ),
    "entrained_air": Effect(
        "free gas in a side at atmospheric pressure, the joint straight", "m³", 1.2e-5, 1.2e-4,
        lambda f, m: f.gas(m, SIDE_VOLUME),
    ),
    "hose_compliance": Effect("compliance of a side's hose at 100 bar", "relative", 0.3, 2.5,
                              lambda f, m: f.hose(m, 100 * BAR)),
    "cylinder_leakage": Effect("leakage past the pistons at 100 bar", "m³/s", 1.5 * LITRE_PER_MINUTE,
                               15 * LITRE_PER_MINUTE, lambda f, m: f.piston_leakage(m, 100 * BAR)),
    "cross_port_leakage": Effect("leakage between the ports at 100 bar", "m³/s", 1.5 * LITRE_PER_MINUTE,
                                 15 * LITRE_PER_MINUTE, lambda f, m: f.port_leakage(m, 100 * BAR)),
}  # fmt: skip
MECHANICS: dict[str, Effect] = {
    "seal_friction": Effect("breakaway force of a cylinder", "N", 500.0, 5000.0, lambda f, m: f.breakaway(m)),
    "joint_friction": Effect("breakaway torque of the bearing", "N m", 350.0, 3500.0, lambda f, m: m["hinge_torque"]),
    "joint_backlash": Effect("free play of the joint, straight", "rad", 0.002, 0.016, lambda f, m: 2 * m["joint_play"]),
    "frame_compliance": Effect(
        "compliance of rods and brackets", "relative", 0.5, 6.0, lambda f, m: 1 / m["joint_stiffness"]
    ),
    "payload": Effect("added mass", "kg", 300.0, 2500.0, lambda f, m: m["payload"]),
    "driveline_resistance": Effect("torque of brake and motor against a wheel at 1 rad/s", "N m", 150.0, 1200.0,
                                   lambda f, m: f.drag(m)),
}  # fmt: skip
GROUND: dict[str, Effect] = {
    "tire_relaxation": Effect(
        "distance rolled to 63 % of a force", "relative", 0.3, 0.75, lambda f, m: m["relaxation_length"], (1, -1)
    ),
    "tire_stiffness": Effect(
        "stiffness of a standing tire across", "relative", 0.15, 0.55, lambda f, m: m["stiffness_across"], (1, -1)
    ),
    "tire_scrub": Effect(
        "torque that swivels a standing wheel by 20°",
        "relative",
        0.12,
        0.6,
        lambda f, m: f.scrub(m, 20 * DEGREE),
        (1, -1),
    ),
    "soft_ground": Effect("rolling resistance over load", "1", 0.015, 0.11, lambda f, m: m["rolling"]),
    "ground_slope": Effect("slope under the machine", "rad", 0.015, 0.1, lambda f, m: m["slope_angle"], (1, -1)),
}
EFFECTS: Mapping[str, Effect] = {**SENSOR, **SUPPLY, **VALVE, **OIL, **MECHANICS, **GROUND}
"""All effects by id."""
