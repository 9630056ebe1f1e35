"""The family cedar: constants and what its device code needs besides."""

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
    "hose_modulus": Constant("Pa", 0.55e9, 0.75e9, 0.95e9, "E: static modulus of braid at no pressure"),
    "hose_volume": Constant("m³", 0.48e-3, 0.56e-3, 0.65e-3, "E: two legs of Ø16 mm, 3 m long, less a share of pipe"),
    "hose_taut": Constant(
        "Pa", 150 * BAR, 250 * BAR, 400 * BAR, "E: pressure at which the braid is twice as stiff and more"
    ),
    "critical_pressure": Constant("Pa", 30 * BAR, 50 * BAR, 90 * BAR, "Ruan, Burton 2006: 1–10 MPa, by rate and air"),
    "bristle_stiffness": Constant("1/m", 8, 11, 16, "E: shear stiffness 200–400 kN/m over a load of 24.5 kN"),
    "bristle_swivel": Constant("1/m", 45, 65, 95, "E: swivel stiffness 8–20 kN m/rad"),
    "bristle_damping": Constant("s/m", 0.14, 0.22, 0.32, "E: a tenth to a fifth of critical"),
    "bristle_length": Constant("m", 0.45, 0.60, 0.80, "Pacejka 2012: relaxation about a tire's radius"),
    "static_ratio": Constant("", 0.05, 0.10, 0.18, "Chrono's LuGre sets: μ_s/μ_c 1.1–1.2"),
    "stribeck_tire": Constant("m/s", 0.05, 0.10, 0.20, "E: 0.03–3.5"),
    "bearing_bend": Constant("rad", 3e-4, 6e-4, 1.2e-3, "E: elastic twist of a greased bearing before it slides"),
    "seal_friction": Constant("N", 150, 250, 400, "E: 20–600 N of preload", 0.08),
    "seal_pressure": Constant("N/Pa", 0.6e-4, 1e-4, 1.5e-4, "Excavator models: 1e-4"),
    "seal_static": Constant("", 1.25, 1.4, 1.6, "R: F_s/F_c 1.2–1.5"),
    "seal_speed": Constant("m/s", 0.006, 0.01, 0.016, "R: 1e-4…1e-2"),
    "seal_viscous": Constant("N s/m", 700, 1200, 2000, "Hopsan 500–1000; 300–5000"),
    "seal_bend": Constant("m", 8e-5, 1.5e-4, 3e-4, "E: presliding of rubber seals, 0.1 mm"),
    "seal_memory": Constant("s", 0.004, 0.008, 0.015, "Armstrong-Hélouvry 1994: frictional memory, ms to tens of ms"),
    "seal_dwell": Constant("s", 0.5, 1.0, 3.0, "Armstrong-Hélouvry 1994: static friction rises within seconds"),
    "dead_left": Constant("", 0.115, 0.125, 0.135, "P: opens between 0.23 and 0.30 V of 2 V, with half the friction"),
    "dead_right": Constant("", 0.155, 0.175, 0.195, "P: opens above 0.30 V, as above"),
    "flow_left": Constant("m³/s", 68.5 * L, 70.6 * L, 72.7 * L, "P: measured"),
    "flow_right": Constant("m³/s", 63.4 * L, 65.4 * L, 67.4 * L, "P: measured"),
    "notch_share": Constant("", 0.07, 0.10, 0.13, "D: fits the measured curve's middle points"),
    "hole_left": Constant("", 0.175, 0.19, 0.205, "D: as above"),
    "hole_right": Constant("", 0.205, 0.22, 0.235, "D: as above"),
    "metering_drop": Constant("Pa", 17 * BAR, 18.5 * BAR, 20 * BAR, "E: margin less compensator and lines"),
    "return_conductance": Constant("m³/s/√Pa", 2.0e-6, 2.4e-6, 2.9e-6, "P: fitted; 2–11 bar at 70 L/min"),
    "counter_least": Constant("", 0.28, 0.36, 0.46, "E: counterbalance throttles the return when the inlet falls"),
    "counter_start": Constant("Pa", 2 * BAR, 4 * BAR, 6 * BAR, "E"),
    "counter_range": Constant("Pa", 15 * BAR, 25 * BAR, 40 * BAR, "E: pilot ratio and spring"),
    "counter_lag": Constant("s", 0.008, 0.015, 0.025, "E: pilot orifice"),
    "spool_gap": Constant("m³/s/Pa", 2e-14, 7e-14, 2e-13, "R: spool leakage 5–60 cm³/min at 50 bar"),
    "current_lag": Constant("s", 0.004, 0.006, 0.010, "E: solenoid with current control"),
    "pilot_lag_left": Constant("s", 0.006, 0.010, 0.015, "E: pilot reducing valve fills the spool's chamber"),
    "pilot_lag_right": Constant("s", 0.008, 0.012, 0.018, "E: as above, not alike"),
    "spool_rate": Constant("1/s", 10, 14, 20, "E: 5–25 full strokes a second"),
    "spool_frequency": Constant("rad/s", 180, 240, 320, "E: spool on its centring spring, behind the pilot stage"),
    "spool_damping": Constant("", 0.7, 0.9, 1.2, "0.7–1"),
    "valve_play": Constant(
        "", 0.004, 0.008, 0.013, "E: dry friction of the spool; hysteresis 1–6 % is twice this", 0.05
    ),
    "compensator_drop": Constant("Pa", 0.5 * BAR, 1.0 * BAR, 1.8 * BAR, "E: weak spring of a downstream compensator"),
    "compensator_band": Constant("Pa", 1.2 * BAR, 2.0 * BAR, 3.0 * BAR, "E: from closed to fully open"),
    "compensator_conductance": Constant("m³/s/√Pa", 2.6e-6, 3.2e-6, 4.0e-6, "E: 90 L/min at 2–3 bar, fully open"),
    "compensator_lag": Constant("s", 0.006, 0.010, 0.016, "Hopsan: 0.010 s; 0.2–30 ms"),
    "sense_start": Constant("", 0.05, 0.07, 0.09, "E: the load-sensing tap opens before the edge"),
    "sense_orifice": Constant("m³/s/√Pa", 2.0e-8, 2.8e-8, 3.8e-8, "E: orifice of 1–1.3 mm"),
    "sense_bleed": Constant("m³/s/√Pa", 0.8e-9, 1.5e-9, 2.4e-9, "E: 0.3–1 L/min at 60 bar"),
    "sense_capacity": Constant("m³/Pa", 1.0e-13, 1.5e-13, 2.2e-13, "E: 0.1 L of line with hose"),
    "pump_flow": Constant("m³/s", 205 * L, 214 * L, 220 * L, "D: 140 cm³/rev at 1595 rpm, 96 %"),
    "pump_leakage": Constant("m³/s/Pa", 1e-12, 2e-12, 4e-12, "E: 1–3 L/min at 100 bar"),
    "unloading": Constant("m³/s/Pa", 4e-12, 8e-12, 1.4e-11, "E: damping orifice of the line, 5 L/min at 100 bar"),
    "pump_limit": Constant("Pa", 190 * BAR, 210 * BAR, 240 * BAR, "E: cut-off 180–280 bar"),
    "margin": Constant("Pa", 19 * BAR, 21 * BAR, 23 * BAR, "R: 14–25 bar", 0.01),
    "control_gain": Constant("1/Pa", 1.5e-7, 2.0e-7, 2.6e-7, "E: full stroke at 50 bar of error"),
    "control_time": Constant("s", 0.05, 0.08, 0.13, "E: actuator integrates slowly"),
    "swash_lag": Constant("s", 0.004, 0.006, 0.009, "E: control spool and actuator"),
    "stroke_up": Constant("s", 0.09, 0.12, 0.16, "R: 0.13 s; Hopsan 0.15"),
    "stroke_down": Constant("s", 0.05, 0.07, 0.10, "R: 0.06 s; Hopsan 0.12"),
}
"""Constants of the family."""

SOFT = {"bristle_stiffness": 1, "bristle_swivel": 1}
"""What is of the tires' stiffness, and its exponent."""

EVEN: dict[str, float] = {}
"""What else must be set for a machine that is alike on both sides."""

TIGHT = {"spool_gap": 0.0, "bristle_damping": 0.0}
"""A valve that is tight when closed, and tires that glide freely."""

TIED = {"tire_stiffness": {"tire_scrub"}, "tire_scrub": {"tire_stiffness"}}
"""Magnitudes that an effect moves besides its own, by the family's laws."""

KNOBS = {
    "pump_response": {
        "stroke_up": 1.0,
        "stroke_down": 1.0,
        "swash_lag": 1.0,
        "control_time": 0.5,
        "control_gain": -0.5,
    },
    "spool_lag": {"current_lag": 1.0, "pilot_lag_left": 1.0, "pilot_lag_right": 1.0},
    "compensator_lag": {"compensator_lag": 1.0},
    "valve_gain": {"flow_left": 1.0, "flow_right": 1.0},
    "hose_compliance": {"hose_modulus": -1.0},
    "tire_relaxation": {"bristle_length": 1.0},
    "tire_stiffness": SOFT,
}
"""Constants that an effect scales, and their exponents, where families differ."""


def bulk_modulus(made: Made, pressure: float) -> float:
    """Effective bulk modulus [Pa] of the oil at a pressure [Pa], by Ruan and Burton."""
    p = pressure + ATMOSPHERIC_PRESSURE
    share = min(max(pressure / (made["critical_pressure"] - ATMOSPHERIC_PRESSURE), 0.0), 1.0)
    left = made["air"] * (1.0 - share * share * (3.0 - 2.0 * share))
    gas = left * (ATMOSPHERIC_PRESSURE / p) ** (1.0 / made["polytropic"])
    return (1.0 + gas) / (1.0 / (made["liquid"] + made["liquid_slope"] * pressure) + gas / (made["polytropic"] * p))


def capacity(made: Made, volume: np.ndarray, pressure: np.ndarray) -> np.ndarray:
    """Compliance [m³/Pa] of a side, by its cylinders' volume [m³] and pressure [Pa]."""
    beta = np.vectorize(lambda p: bulk_modulus(made, p))(pressure)
    taut = 1.0 + np.maximum(pressure, 0.0) / made["hose_taut"]
    return (volume + made["hose_volume"]) / beta + made["hose_volume"] / (made["hose_modulus"] * taut**2)


def capacity_of_side(made: Made, volume: float, pressure: float) -> float:
    """Compliance [m³/Pa] of a whole side."""
    return float(capacity(made, np.array([volume]), np.array([pressure]))[0])


def bore_radius(made: Made) -> float:
    """Radius [m] at which a front tire's sliding friction makes its largest swivel torque (Gough)."""
    limit = made["swivel_friction"] / 3.0 * math.sqrt(made["load_front"] ** 3 / made["inflation"])
    return limit / (made["ground_friction"] * made["load_front"])


def swivel_torque(made: Made, angle: float) -> float:
    """Torque [N m] that a standing front tire resists with after swivelling slowly by an angle [rad]."""
    level = made["ground_friction"] * (1.0 + made["static_ratio"])
    share = 1.0 - math.exp(-made["bristle_swivel"] * bore_radius(made) * angle / level)
    return bore_radius(made) * made["load_front"] * level * share


def breakaway(made: Made, pressure: float) -> float:
    """Largest static friction [N] of a cylinder that has stood long, with both chambers at a pressure [Pa]."""
    return made["seal_static"] * (made["seal_friction"] + 2.0 * made["seal_pressure"] * pressure)


MEASURES: dict[str, Callable[[Made], float]] = {
    "pump_response": lambda m: m["stroke_up"] * 70.0 * L / m["pump_flow"] + m["swash_lag"],
    "spool_lag": lambda m: m["current_lag"] + m["pilot_lag_left"] + 2.0 * m["spool_damping"] / m["spool_frequency"],
    "compensator_lag": lambda m: m["compensator_lag"],
    "valve_gain": lambda m: m["flow_left"] / L,
    "hose_compliance": lambda m: (
        m["hose_volume"] / m["hose_modulus"] * 100.0 * BAR / (1.0 + 100.0 * BAR / m["hose_taut"]) * 1e6
    ),
    "tire_relaxation": lambda m: m["bristle_length"],
    "tire_stiffness": lambda m: m["bristle_swivel"] * m["load_front"] * bore_radius(m) ** 2,
}
"""Operational magnitudes where families differ, of all constants that the device code reads."""


def derived(machine: Mapping[str, float]) -> dict[str, float]:
    """All that the device code reads."""
    made = common.derived(machine, SOFT)
    for name in ("compensator_conductance", "return_conductance"):
        made[name] *= made["thinner"]
    return made
