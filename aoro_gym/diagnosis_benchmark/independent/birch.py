"""The family birch: constants and what its device code needs besides."""

import math
from collections.abc import Callable, Mapping

import numpy as np

from aoro_gym.units import ATMOSPHERIC_PRESSURE, BAR, LITRE_PER_MINUTE

from . import common
from .constants import Constant, Table

Made = Mapping[str, float]
L = LITRE_PER_MINUTE

TABLE: Table = {
    **common.COMMON,
    "transition": Constant("Pa", 0.9 * BAR, 1.2 * BAR, 1.6 * BAR, "P: laminar below 1 bar"),
    "carpet_fore": Constant("m", 0.105, 0.12, 0.135, "E: half of a contact patch of 0.35 m, elements at their middle"),
    "carpet_side": Constant("m", 0.090, 0.10, 0.115, "E: as above, tire 0.53 m wide and crowned"),
    "carpet_slip": Constant("m", 0.038, 0.048, 0.060, "E: lug and carcass shear before sliding"),
    "carpet_length": Constant("m", 0.45, 0.60, 0.80, "Pacejka 2012: relaxation about a tire's radius"),
    "carcass_damping": Constant("N s/m", 4000, 6500, 9000, "E: a tenth to a fifth of critical"),
    "bearing_static": Constant("", 1.15, 1.3, 1.5, "E: static over kinetic friction of greased pins"),
    "bearing_speed": Constant("rad/s", 0.012, 0.02, 0.03, "Brown, McPhee 2016: transition speed"),
    "seal_friction": Constant("N", 150, 250, 400, "E: 20–600 N of preload", 0.08),
    "seal_pressure": Constant("N/Pa", 0.6e-4, 1e-4, 1.5e-4, "Excavator models: 1e-4"),
    "seal_static": Constant("", 1.2, 1.3, 1.45, "R: F_s/F_c 1.2–1.5"),
    "seal_speed": Constant("m/s", 0.006, 0.01, 0.016, "R: 1e-4…1e-2"),
    "seal_viscous": Constant("N s/m", 900, 1600, 2600, "Hopsan 500–1000; 300–5000"),
    "seal_bend": Constant("m", 2e-4, 4e-4, 7e-4, "E: presliding of the soft element; the stiff one bends 0.3 of it"),
    "seal_share": Constant("", 0.4, 0.5, 0.6, "E: share of the soft element"),
    "dead_left": Constant("", 0.125, 0.135, 0.145, "P: opens between 0.23 and 0.30 V of 2 V"),
    "dead_right": Constant("", 0.155, 0.175, 0.195, "P: opens above 0.30 V"),
    "flow_left": Constant("m³/s", 68.5 * L, 70.6 * L, 72.7 * L, "P: measured"),
    "flow_right": Constant("m³/s", 63.4 * L, 65.4 * L, 67.4 * L, "P: measured"),
    "notch_left": Constant("", 0.66, 0.716, 0.77, "D: odds of the measured curve's middle points"),
    "notch_right": Constant("", 0.52, 0.562, 0.61, "D: as above"),
    "notch_exponent": Constant("", 1.75, 1.80, 1.85, "D: as above"),
    "return_lap_a": Constant("", 0.04, 0.07, 0.10, "E: return edges open before inlet edges"),
    "return_lap_b": Constant("", 0.05, 0.08, 0.11, "E: as above, not alike"),
    "return_conductance": Constant("m³/s/√Pa", 1.7e-6, 2.0e-6, 2.4e-6, "P: fitted; 2–11 bar at 70 L/min"),
    "spool_gap": Constant("m³/s/Pa", 2e-14, 7e-14, 2e-13, "R: spool leakage 5–60 cm³/min at 50 bar"),
    "spool_lag": Constant("s", 0.012, 0.018, 0.028, "E: 0.008–0.06; Hopsan 0.02"),
    "spool_rate": Constant("1/s", 10, 14, 20, "E: 5–25 full strokes a second"),
    "valve_play": Constant("", 0.004, 0.008, 0.013, "E: hysteresis 1–6 % is twice this", 0.05),
    "compensator_drop": Constant("Pa", 6 * BAR, 7.5 * BAR, 9 * BAR, "P: fitted, not printed; 4–14"),
    "compensator_droop": Constant("", 0.009, 0.014, 0.019, "E: some per cent of flow at 100 bar of load"),
    "droop_from": Constant("Pa", 35 * BAR, 40 * BAR, 45 * BAR, "E: load at which the flow curve was measured"),
    "compensator_conductance": Constant("m³/s/√Pa", 2.6e-6, 3.2e-6, 4.0e-6, "E: 90 L/min at 2–3 bar, fully open"),
    "compensator_lag": Constant("s", 0.006, 0.010, 0.016, "Hopsan: 0.010 s; 0.2–30 ms"),
    "sense_start": Constant("", 0.06, 0.08, 0.10, "E: the load-sensing tap opens before the edge"),
    "sense_lag": Constant("s", 0.005, 0.008, 0.014, "E: orifice and 3 m of Ø6 mm line"),
    "dead_time": Constant("s", 0.005, 0.007, 0.010, "E: control spool and actuator of the swash plate"),
    "pump_lag": Constant("s", 0.008, 0.012, 0.018, "E: with the line; NG140 strokes out in 0.13 s"),
    "pump_rise": Constant("Pa/s", 2000 * BAR, 2600 * BAR, 3400 * BAR, "E: 223 L/min into 1.5 L of line and hose"),
    "pump_fall": Constant("Pa/s", 2500 * BAR, 3500 * BAR, 5000 * BAR, "E: 0.06 s from full to no stroke"),
    "pump_droop": Constant("Pa s/m³", 0.8e8, 1.5e8, 2.5e8, "E: 1–3 bar at 70 L/min, controller and line"),
    "pump_limit": Constant("Pa", 190 * BAR, 210 * BAR, 240 * BAR, "E: cut-off 180–280 bar"),
    "margin": Constant("Pa", 19 * BAR, 22 * BAR, 25 * BAR, "R: 14–25 bar", 0.01),
    "hose_inertia": Constant("kg/m⁴", 1.5e7, 2.0e7, 2.6e7, "D: ρ l/A, Ø12.7–16 mm, 3 m"),
    "hose_resistance": Constant("Pa s/m³", 0.8e8, 1.3e8, 2.0e8, "D: 128 μ l/(π d⁴)"),
    "hose_turbulence": Constant("Pa s²/m⁶", 1.0e11, 1.8e11, 3.0e11, "D: friction factor 0.04 and fittings"),
    "dissolving": Constant("1/Pa", 1.0e-7, 2.0e-7, 4.0e-7, "Yu 1994, slowed: all dissolved at 25–100 bar"),
}
"""Constants of the family."""

SOFT = {"carpet_slip": -1}
"""What is of the tires' stiffness, and its exponent."""

EVEN = {"return_lap_b": TABLE["return_lap_a"].nominal}
"""What else must be set for a machine that is alike on both sides."""

TIGHT = {"spool_gap": 0.0}
"""A valve that is tight when closed."""

TIED = {"tire_stiffness": {"tire_scrub"}, "tire_scrub": {"tire_stiffness"}}
"""Magnitudes that an effect moves besides its own, by the family's laws."""

KNOBS = {
    "pump_response": {"dead_time": 1.0, "pump_lag": 1.0},
    "spool_lag": {"spool_lag": 1.0},
    "compensator_lag": {"compensator_lag": 1.0},
    "valve_gain": {"flow_left": 1.0, "flow_right": 1.0},
    "hose_compliance": {"hose_modulus": -1.0},
    "tire_relaxation": {"carpet_length": 1.0},
    "tire_stiffness": {"carpet_slip": -1.0},
}
"""Constants that an effect scales, and their exponents, where families differ."""


def bulk_modulus(made: Made, pressure: float) -> float:
    """Yu's effective bulk modulus [Pa] of the oil at a pressure [Pa]."""
    p = pressure + ATMOSPHERIC_PRESSURE
    left = made["air"] * max(0.0, 1.0 - made["dissolving"] * pressure)
    gas = left * (ATMOSPHERIC_PRESSURE / p) ** (1.0 / made["polytropic"])
    liquid = made["liquid"] + made["liquid_slope"] * pressure
    return liquid * (1.0 + gas) / (1.0 + gas * liquid / (made["polytropic"] * p))


def capacity(made: Made, volume: np.ndarray, pressure: np.ndarray, share: float = 0.35) -> np.ndarray:
    """Compliance [m³/Pa] of the volume in which a side's pressure is measured, with ``share`` of the hose."""
    beta = np.vectorize(lambda p: bulk_modulus(made, p))(pressure)
    hose = share * made["hose_volume"]
    return (volume + hose) / beta + hose / made["hose_modulus"]


def capacity_of_side(made: Made, volume: float, pressure: float) -> float:
    """Compliance [m³/Pa] of a whole side."""
    return float(capacity(made, np.array([volume]), np.array([pressure]), 1.0)[0])


def swivel_torque(made: Made, angle: float) -> float:
    """Torque [N m] that a standing front tire resists with after swivelling by an angle [rad]: four elements."""
    total = 0.0
    for arm in (made["carpet_fore"], made["carpet_side"]):
        s = 1.0 - math.exp(-arm * angle / made["carpet_slip"])
        total += 0.5 * made["ground_friction"] * made["load_front"] * arm * (3.0 * s - 3.0 * s * s + s**3)
    return total


def swivel_stiffness(made: Made) -> float:
    """Slope [N m/rad] of the swivel torque at its start."""
    arms = made["carpet_fore"] ** 2 + made["carpet_side"] ** 2
    return 1.5 * made["ground_friction"] * made["load_front"] * arms / made["carpet_slip"]


def breakaway(made: Made, pressure: float) -> float:
    """Largest static friction [N] of a cylinder with both chambers at a pressure [Pa]."""
    return made["seal_static"] * (made["seal_friction"] + 2.0 * made["seal_pressure"] * pressure)


MEASURES: dict[str, Callable[[Made], float]] = {
    "pump_response": lambda m: m["dead_time"] + m["pump_lag"],
    "spool_lag": lambda m: m["spool_lag"],
    "compensator_lag": lambda m: m["compensator_lag"],
    "valve_gain": lambda m: m["flow_left"] / L,
    "hose_compliance": lambda m: m["hose_volume"] / m["hose_modulus"] * 100.0 * BAR * 1e6,
    "tire_relaxation": lambda m: m["carpet_length"],
    "tire_stiffness": swivel_stiffness,
}
"""Operational magnitudes where families differ, of all constants that the device code reads."""


def derived(machine: Mapping[str, float]) -> dict[str, float]:
    """All that the device code reads."""
    made = common.derived(machine, SOFT)
    for name in ("compensator_conductance", "return_conductance"):
        made[name] *= made["thinner"]
    for name in ("carpet_fore", "carpet_side"):
        made[name] *= made["swivel_friction"] / common.COMMON["swivel_friction"].nominal
    return made
