"""elm: constants, what follows from them, and how each effect comes about on it."""

import math

from aoro_gym.diagnosis_benchmark.independent.constants import Constant
from aoro_gym.units import BAR

from . import vehicle
from .vehicle import VEHICLE, Made, around

TABLE: dict[str, Constant] = {
    **VEHICLE,
    **vehicle.hydraulic_table(0.04),
    "cut_off": around("Pa", 205 * BAR, 0.04, "E: 180–280 bar"),
    "relief_pressure": around("Pa", 250 * BAR, 0.03, "E"),
    "tank_drop": around("Pa", 2.5 * BAR, 0.25, "1D: 1.5–5.5 bar at nominal flow"),
    "bulk_at_20": around("Pa", 1.45e9, 0.07, "S27"),
    "air_share": around("", 0.008, 0.3, "S17: 0.5 %", 0.08),
    "hose_modulus": around("Pa", 1.2e9, 0.12, "P"),
    "piston_leakage": around("m³", 1.5e-14, 0.4, "1D: 5e-13 m³/(s Pa) at 40 mPa s", 0.05),
    "port_leakage": around("m³/(s √Pa)", 3e-9, 0.4, "E: 0.5 L/min at 50 bar"),
    "seal_force": around("N", 320.0, 0.3, "S14, E", 0.08),
    "seal_ratio": around("", 1.3, 0.08, "S14"),
    "stribeck_speed": around("m/s", 0.012, 0.3, "S14"),
    "seal_viscosity": around("m", 1.3e4, 0.3, "S16: 500 N s/m at 40 mPa s"),
    "hinge_torque": around("N m", 230.0, 0.3, "E", 0.05),
    "joint_play": around("rad", 3e-4, 0.3, "E: half of 0.1 mm at the pins"),
    "joint_stiffness": around("N m/rad", 8e6, 0.25, "E: 2–20e6"),
    "joint_damping": around("N m s/rad", 2.5e3, 0.3, "E: 10 % of critical"),
    "droop": around("", 0.025, 0.3, "E: of the speed at 200 N m"),
    "spool_frequency": around("rad/s", 130.0, 0.15, "S16"),
    "spool_damping": around("", 0.9, 0.1, "S16"),
    "spool_rate": around("1/s", 9.0, 0.15, "E"),
    "lever_play": around("", 0.010, 0.4, "E: 2 % hysteresis"),
    "command_delay": around("s", 0.012, 0.3, "E"),
    "compensator_lag": around("s", 0.014, 0.3, "S16: 10 ms"),
    "band_left": around("", 0.135, 0.05, "P: 0.27 V"),
    "band_right": around("", 0.175, 0.05, "P: 0.35 V"),
    "half_left": around("", 0.264, 0.04, "P"),
    "half_right": around("", 0.174, 0.04, "P"),
    "most_left": around("", 0.783, 0.02, "P"),
    "most_right": around("", 0.661, 0.02, "P"),
    "brake_torque": around("N m", 300.0, 0.2, "D: 8 bar on the motors", 0.04),
    "soil_modulus": around("N/m³", 1.5e10, 0.3, "E: hard ground in Bekker's law", 0.1),
    "ground_friction": around("", 0.66, 0.1, "E: asphalt", 0.02),
    "patch_radius": around("m", 0.16, 0.12, "S19: patch at 2 bar"),
    "shear": around("", 1.0, 0.15, "S14", 0.01),
    "relaxation_length": around("m", 0.30, 0.25, "E: about half the radius"),
    "twist_stiffness": around("N m/rad", 1.5e4, 0.2, "E: 8–40e3"),
    "tire_damping": around("N s/m", 2.5e3, 0.3, "S11"),
    "angle_delay": around("s", 0.002, 0.4, "S34"),
    "angle_lag": around("s", 0.003, 0.3, "E: input filter"),
    "chain_window": around("s", 0.002, 0.2, "E: averaging converter"),
    "angle_noise": around("rad", 4e-4, 0.2, "P: 6 Hz noise"),
    "angle_step": around("rad", 2 * math.pi / 4096, 0.0, "E: 12 bit"),
    "pressure_noise": around("Pa", 0.25 * BAR, 0.3, "E"),
}
"""Constants of a healthy elm."""

REALISED = {
    "sensor_delay": {"angle_delay": 1.0},
    "sensor_filter": {"angle_lag": 1.0},
    "sensor_gain": {"angle_gain": 1.0},
    "measuring_chain": {"chain_window": 1.0},
    "engine_droop": {"droop": 1.0},
    "pump_response": {"stroke_time": 1.0},
    "pump_limit": {"cut_off": 1.0},
    "command_delay": {"command_delay": 1.0},
    "spool_lag": {"spool_frequency": -1.0},
    "spool_rate": {"spool_rate": 1.0},
    "dead_band": {"band_left": 1.0, "band_right": 1.0},
    "valve_gain": {"edge_scale": 1.0},
    "valve_hysteresis": {"lever_play": 1.0},
    "compensator_lag": {"compensator_lag": 1.0},
    "compensator_opening": {"compensator_drop": -1.0},
    "back_pressure": {"tank_drop": 1.0},
    "oil_bulk_modulus": {"bulk_at_20": 1.0},
    "entrained_air": {"air_share": 1.0},
    "hose_compliance": {"hose_modulus": -1.0},
    "cylinder_leakage": {"piston_leakage": 1.0},
    "cross_port_leakage": {"port_leakage": 1.0},
    "seal_friction": {"seal_force": 1.0},
    "joint_friction": {"hinge_torque": 1.0},
    "joint_backlash": {"joint_play": 1.0},
    "frame_compliance": {"joint_stiffness": -1.0},
    "driveline_resistance": {"brake_torque": 1.0},
    "tire_relaxation": {"relaxation_length": 1.0},
    "tire_stiffness": {"shear": 1.0},
    "tire_scrub": {"patch_radius": 1.0},
    "soft_ground": {"soil_modulus": -1.0},
}
"""Constants that an effect scales, and by which power; temperature, payload and slope are shifted."""

BASE_STEEPNESS, BASE_LEVEL = 3.904, 9.966
"""Walther's constants of a VG46 oil (46 mm²/s at 40 °C, 12 at 75 °C)."""


def _vehicle(m: Made) -> dict[str, float]:
    """Payload on the front frame, a slope across."""
    return vehicle.loaded(m, "front", 1.9) | vehicle.slope(m, 0.0, 1.0)


def _hydraulics(m: Made) -> dict[str, float]:
    """Oil at its temperature, valve and return."""
    power = 10 ** (BASE_LEVEL - BASE_STEEPNESS * math.log10(vehicle.kelvin(m["temperature"])))
    density = 880.0 * (1.0 - 6.5e-4 * (m["temperature"] - 15.0))
    return vehicle.valve(m) | {
        "viscosity": density * 1e-6 * (10**power - 0.7),
        "bulk_modulus": m["bulk_at_20"] * (1.0 - 0.005 * (m["temperature"] - 20.0)),
        "tank_conductance": m["flow_left"] / math.sqrt(m["tank_drop"]),
    }


def _tires(m: Made) -> dict[str, float]:
    """Tires on ground that they sink into."""
    sinkage = (1.5 * m["load_mean"] / (0.53 * m["soil_modulus"] * math.sqrt(2 * m["tire_radius"]))) ** (2 / 3)
    return {
        "rolling": 0.01 + 0.5 * 0.53 * m["soil_modulus"] * sinkage**2 / m["load_mean"],
        "grip_sliding": 0.9 * m["ground_friction"],
        "grip_sticking": 1.1 * m["ground_friction"],
        "scrub_moment": (1 + sinkage / 0.08) * 2 / 3 * m["ground_friction"] * m["load_mean"] * m["patch_radius"],
        "stiffness_along": 4e5 * m["shear"],
        "stiffness_across": 2.2e5 * m["shear"],
    }


DERIVED = {"vehicle": _vehicle, "hydraulics": _hydraulics, "tires": _tires}
"""What follows from the constants, by part."""


def angle_delay(m: Made) -> float:
    """Pure delay [s] of the joint angle."""
    return m["angle_delay"]


def angle_lag(m: Made) -> float:
    """Lag [s] of the angle's filter, of first order."""
    return m["angle_lag"]


def span(m: Made) -> float:
    """Measured range of the joint over the true one: a plain gain."""
    return m["angle_gain"]


def chain_lag(m: Made) -> float:
    """Mean lag [s] of all channels: half the window that the converter averages over."""
    return 0.5 * m["chain_window"]


def command_delay(m: Made) -> float:
    """Mean delay [s] of the command: pure."""
    return m["command_delay"]


def pump_response(m: Made) -> float:
    """Time [s] until the pump has made 63 % of its stroke: at its fastest rate."""
    return 0.63 * m["stroke_time"]


def pump_limit(m: Made) -> float:
    """Highest pressure [Pa] of the supply: of the cut-off."""
    return m["cut_off"]


def spool_lag(m: Made) -> float:
    """Mean lag [s] of small motions of the spool: 2 ζ/ω."""
    return 2 * m["spool_damping"] / m["spool_frequency"]


def spool_rate(m: Made) -> float:
    """Fastest stroke [1/s]."""
    return m["spool_rate"]


def regulated_flow(m: Made) -> float:
    """Flow [m³/s] at 75 % of the signal to the left with the compensator at rest."""
    return m["edge_left"] * m["most_left"] * math.sqrt(m["edge_drop"])


def hysteresis(m: Made) -> float:
    """Width of the loop, share of the full signal."""
    return 2 * m["lever_play"]


def open_passage(m: Made) -> float:
    """Conductance [m³/(s √Pa)] of the compensator at rest."""
    return m["compensator_passage"]


def back_pressure(m: Made, flow: float) -> float:
    """Pressure [Pa] behind the return edge: of an orifice."""
    return m["tank_pressure"] + (flow / m["tank_conductance"]) ** 2


def bulk_modulus(m: Made, pressure: float) -> float:
    """Bulk modulus [Pa] of the liquid: the same at all pressures."""
    return m["bulk_modulus"]


def gas(m: Made, volume: float) -> float:
    """Free gas [m³] in a side of a ``volume`` at atmospheric pressure."""
    return m["air_share"] * (volume + m["hose_volume"])


def hose(m: Made, pressure: float) -> float:
    """Compliance [m³/Pa] of a side's hose."""
    return m["hose_volume"] / m["hose_modulus"]


def piston_leakage(m: Made, drop: float) -> float:
    """Leakage [m³/s] past both pistons: laminar."""
    return m["piston_leakage"] / m["viscosity"] * drop


def port_leakage(m: Made, drop: float) -> float:
    """Leakage [m³/s] between the ports: an orifice that starts laminar."""
    return m["port_leakage"] * drop / (drop**2 + 4 * BAR**2) ** 0.25


def breakaway(m: Made) -> float:
    """Breakaway force [N] of a cylinder without pressure."""
    return m["seal_force"]


def drag(m: Made) -> float:
    """Torque [N m] of brake and motor against a wheel at 1 rad/s."""
    return m["brake_torque"]


def scrub(m: Made, angle: float) -> float:
    """Torque [N m] that swivels a standing wheel by an ``angle``: Dahl's law."""
    return m["scrub_moment"] * (1.0 - math.exp(-m["twist_stiffness"] * angle / m["scrub_moment"]))
