"""The family alder: constants and what its device code needs besides."""

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
    "air": Constant(
        "", 0.005, 0.0085, 0.014, "E: 0.2–5 % undissolved; foams a little more than the others' tanks", 0.15
    ),
    "stiffness_along": Constant("N/m", 3.0e5, 4.0e5, 5.0e5, "E: tire shear stiffness", 0.02),
    "stiffness_across": Constant("N/m", 1.6e5, 2.0e5, 2.6e5, "E: as above", 0.02),
    "carcass_damping": Constant(
        "N s/m", 3500, 5500, 8000, "E: a tenth to a fifth of critical for a quarter of the machine"
    ),
    "relaxation_along": Constant("m", 0.3, 0.4, 0.55, "Pacejka 2012: about half a tire's radius to one"),
    "relaxation_across": Constant("m", 0.4, 0.55, 0.75, "Pacejka 2012: as above"),
    "relaxation_swivel": Constant("m", 0.8, 1.2, 1.8, "E: rolling gives back part of the swivel torque"),
    "swivel_stiffness": Constant("N m/rad", 10e3, 15e3, 22e3, "E: Sharp, Granger 2003; breakaway at 0.05–0.2 rad"),
    "bearing_bend": Constant("rad", 2e-4, 4e-4, 8e-4, "E: elastic twist of a dry bearing before it slides"),
    "seal_friction": Constant("N", 150, 250, 400, "E: 20–600 N of preload", 0.08),
    "seal_pressure": Constant("N/Pa", 0.6e-4, 1e-4, 1.5e-4, "Excavator models: 1e-4"),
    "seal_static": Constant("", 1.2, 1.3, 1.45, "R: F_s/F_c 1.2–1.5"),
    "seal_speed": Constant("m/s", 0.006, 0.01, 0.016, "R: 1e-4…1e-2"),
    "seal_viscous": Constant("N s/m", 700, 1200, 2000, "Hopsan 500–1000; 300–5000"),
    "seal_bend": Constant("m", 8e-5, 1.5e-4, 3e-4, "E: presliding of rubber seals, 0.1 mm"),
    "dead_left": Constant("", 0.125, 0.135, 0.145, "P: opens between 0.23 and 0.30 V of 2 V"),
    "dead_right": Constant("", 0.155, 0.175, 0.195, "P: opens above 0.30 V"),
    "curve_left_50": Constant("m³/s", 19.6 * L, 20.4 * L, 21.2 * L, "P: measured, ±4 %"),
    "curve_left_75": Constant("m³/s", 53.5 * L, 55.3 * L, 57.0 * L, "P: measured"),
    "curve_left_100": Constant("m³/s", 68.5 * L, 70.6 * L, 72.7 * L, "P: measured"),
    "curve_right_50": Constant("m³/s", 12.0 * L, 12.5 * L, 13.0 * L, "P: measured"),
    "curve_right_75": Constant("m³/s", 41.8 * L, 43.2 * L, 44.6 * L, "P: measured"),
    "curve_right_100": Constant("m³/s", 63.4 * L, 65.4 * L, 67.4 * L, "P: measured"),
    "spool_gap": Constant("m³/s/Pa", 2e-14, 7e-14, 2e-13, "R: spool leakage 5–60 cm³/min at 50 bar"),
    "spool_frequency": Constant("rad/s", 80, 110, 160, "Hopsan: 100 rad/s; 50–250"),
    "spool_damping": Constant("", 0.7, 0.85, 1.0, "0.7–1"),
    "spool_rate": Constant("1/s", 10, 14, 20, "E: 5–25 full strokes a second"),
    "valve_play": Constant("", 0.004, 0.008, 0.013, "E: hysteresis 1–6 % is twice this", 0.05),
    "compensator_drop": Constant("Pa", 6 * BAR, 7 * BAR, 8.5 * BAR, "P: fitted, not printed; 4–14"),
    "compensator_spring": Constant("Pa", 0.8 * BAR, 1.2 * BAR, 1.8 * BAR, "E: spring's rise over the stroke"),
    "compensator_droop": Constant(
        "", 0.006, 0.011, 0.016, "E: flow force and gap; some per cent of flow at 100 bar of load"
    ),
    "droop_from": Constant("Pa", 35 * BAR, 40 * BAR, 45 * BAR, "E: load at which the flow curve was measured"),
    "compensator_conductance": Constant("m³/s/√Pa", 2.6e-6, 3.2e-6, 4.0e-6, "E: 90 L/min at 2–3 bar, fully open"),
    "compensator_stroke": Constant("m", 3e-3, 4e-3, 5e-3, "E"),
    "compensator_area": Constant("m²", 2.5e-4, 3.1e-4, 3.8e-4, "E: Ø20 mm"),
    "compensator_mass": Constant("kg", 0.12, 0.16, 0.22, "E: steel spool with a third of its spring"),
    "compensator_damping": Constant("N s/m", 700, 1000, 1500, "E: damping orifice of 0.6 mm"),
    "return_conductance": Constant("m³/s/√Pa", 1.6e-6, 1.9e-6, 2.3e-6, "P: fitted, not printed; 2–11 bar at 70 L/min"),
    "sense_start": Constant("", 0.06, 0.08, 0.10, "E: the load-sensing tap opens before the edge"),
    "sense_lag": Constant("s", 0.005, 0.008, 0.014, "E: orifice and 3 m of Ø6 mm line"),
    "sense_bleed": Constant("m³/s", 0.3 * L, 0.5 * L, 0.9 * L, "E: 0.3–1.5 L/min"),
    "pump_flow": Constant("m³/s", 205 * L, 214 * L, 220 * L, "D: 140 cm³/rev at 1595 rpm, 96 %"),
    "pump_leakage": Constant("m³/s/Pa", 1e-12, 2e-12, 4e-12, "E: 1–3 L/min at 100 bar"),
    "pump_limit": Constant("Pa", 190 * BAR, 210 * BAR, 240 * BAR, "E: cut-off 180–280 bar"),
    "margin": Constant("Pa", 18 * BAR, 21 * BAR, 24 * BAR, "R: 14–25 bar", 0.01),
    "control_band": Constant("Pa", 6 * BAR, 9 * BAR, 13 * BAR, "E: control spool fully open"),
    "control_frequency": Constant("rad/s", 200, 300, 420, "E: spool of the pressure–flow controller on its spring"),
    "control_damping": Constant("", 0.7, 0.9, 1.2, "E"),
    "control_lead": Constant("s", 0.007, 0.010, 0.014, "E: damping of the control spool; Hopsan's lead form"),
    "stroke_up": Constant("s", 0.09, 0.12, 0.16, "R: 0.13 s; Hopsan 0.15"),
    "stroke_down": Constant("s", 0.05, 0.07, 0.10, "R: 0.06 s; Hopsan 0.12"),
}
"""Constants of the family."""


SOFT = {"stiffness_along": 1, "stiffness_across": 1, "swivel_stiffness": 1}
"""What is of the tires' stiffness, and its exponent."""

EVEN: dict[str, float] = {}
"""What else must be set for a machine that is alike on both sides."""

TIGHT = {"spool_gap": 0.0}
"""A valve that is tight when closed."""

TIED = {"tire_stiffness": {"tire_scrub"}}
"""Magnitudes that an effect moves besides its own, by the family's laws."""

KNOBS = {
    "pump_response": {"stroke_up": 1.0, "stroke_down": 1.0},
    "spool_lag": {"spool_frequency": -1.0},
    "compensator_lag": {"compensator_damping": 1.0},
    "valve_gain": {f"curve_{side}_{share}": 1.0 for side in ("left", "right") for share in (50, 75, 100)},
    "hose_compliance": {"hose_modulus": -1.0},
    "tire_relaxation": {f"relaxation_{way}": 1.0 for way in ("along", "across", "swivel")},
    "tire_stiffness": SOFT,
}
"""Constants that an effect scales, and their exponents, where families differ."""


def bulk_modulus(made: Made, pressure: float) -> float:
    """Nykänen's effective bulk modulus [Pa] of the oil at a pressure [Pa]."""
    p = pressure + ATMOSPHERIC_PRESSURE
    gas = made["air"] * (ATMOSPHERIC_PRESSURE / p) ** (1.0 / made["polytropic"])
    liquid = made["liquid"] + made["liquid_slope"] * pressure
    return (gas + 1.0 - made["air"]) ** 2 / (gas / (made["polytropic"] * p) + (1.0 - made["air"]) / liquid)


def capacity(made: Made, volume: np.ndarray, pressure: np.ndarray) -> np.ndarray:
    """Compliance [m³/Pa] of a side where its pressure is measured, by its cylinders' volume [m³] and pressure [Pa]."""
    beta = np.vectorize(lambda p: bulk_modulus(made, p))(pressure)
    return (volume + made["hose_volume"]) / beta + made["hose_volume"] / made["hose_modulus"]


def capacity_of_side(made: Made, volume: float, pressure: float) -> float:
    """Compliance [m³/Pa] of a whole side."""
    return float(capacity(made, np.array([volume]), np.array([pressure]))[0])


def swivel_torque(made: Made, angle: float) -> float:
    """Torque [N m] that a standing front tire resists with after swivelling by an angle [rad]: Dahl."""
    limit = made["swivel_friction"] / 3.0 * math.sqrt(made["load_front"] ** 3 / made["inflation"])
    return limit * (1.0 - math.exp(-made["swivel_stiffness"] * angle / limit))


def breakaway(made: Made, pressure: float) -> float:
    """Largest static friction [N] of a cylinder with both chambers at a pressure [Pa]."""
    return made["seal_static"] * (made["seal_friction"] + 2.0 * made["seal_pressure"] * pressure)


MEASURES: dict[str, Callable[[Made], float]] = {
    "pump_response": lambda m: (
        m["stroke_up"] * 70.0 * L / m["pump_flow"] + 2 * m["control_damping"] / m["control_frequency"]
    ),
    "spool_lag": lambda m: 2.0 * m["spool_damping"] / m["spool_frequency"],
    "compensator_lag": lambda m: (
        m["compensator_damping"] * m["compensator_stroke"] / (m["compensator_area"] * 10.0 * BAR)
    ),
    "valve_gain": lambda m: m["curve_left_100"] / L,
    "hose_compliance": lambda m: m["hose_volume"] / m["hose_modulus"] * 100.0 * BAR * 1e6,
    "tire_relaxation": lambda m: m["relaxation_across"],
    "tire_stiffness": lambda m: m["swivel_stiffness"],
}
"""Operational magnitudes where families differ, of all constants that the device code reads."""


def derived(machine: Mapping[str, float]) -> dict[str, float]:
    """All that the device code reads."""
    made = common.derived(machine, SOFT)
    for name in ("compensator_conductance", "return_conductance"):
        made[name] *= made["thinner"]
    return made
