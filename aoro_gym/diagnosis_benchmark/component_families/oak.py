"""oak: constants of a heavy-duty machine, what follows from them, and how each effect comes about on it."""

import math

from aoro_gym.diagnosis_benchmark.independent.constants import Constant
from aoro_gym.units import BAR, LITRE_PER_MINUTE

from . import vehicle
from .vehicle import VEHICLE, Made, around

TABLE: dict[str, Constant] = {
    **VEHICLE,
    **vehicle.hydraulic_table(0.07),
    "flow_left": around("m³/s", 70.2 * LITRE_PER_MINUTE, 0.02, "P: measured, less what the compensator lets pass"),
    "flow_right": around("m³/s", 64.3 * LITRE_PER_MINUTE, 0.02, "P: measured, less what the compensator lets pass"),
    "mass_front_empty": around("kg", 4700.0, 0.05, "E: heavy rear frame"),
    "mass_rear_empty": around("kg", 5300.0, 0.05, "E: the rest of 10 t"),
    "inertia_front": around("kg m²", 2900.0, 0.12, "E: parameters.md A, with two corners"),
    "inertia_rear": around("kg m²", 3600.0, 0.12, "E: parameters.md A, with two corners"),
    "wheel_inertia": around("kg m²", 52.0, 0.2, "E: heavy rims"),
    "slope_angle": vehicle.zero("rad", 0.004, "P: flat ground", 0.003),
    "compensator_drop": around("Pa", 0.8 * BAR, 0.15, "E: open compensator at nominal flow"),
    "check_drop": around("Pa", 3.2 * BAR, 0.15, "E: load check at nominal flow"),
    "regulator_lead": around("s", 0.018, 0.15, "E"),
    "sense_lag": around("s", 0.006, 0.3, "E"),
    "swash_lag": around("s", 0.005, 0.3, "E: inertia of swash plate and pistons behind the control orifice"),
    "swash_friction": around("Pa", 0.5 * BAR, 0.3, "E: of its bearings, as an error that does not move it"),
    "torque_limit": around("N m", 250.0, 0.06, "E: power regulator, 42 kW at 1595 rpm"),
    "relief_pressure": around("Pa", 195 * BAR, 0.03, "E: pilot of the main relief"),
    "relief_band": around("Pa", 10 * BAR, 0.2, "R: rise of a pilot-operated relief to its full lift"),
    "relief_lag": around("s", 0.002, 0.25, "R: main stage behind its pilot"),
    "return_length": around("", 1.0, 0.2, "E: 2 bar at nominal flow", 0.04),
    "return_gas": around("m³", 1.2e-4, 0.3, "E: bladder in the return line", 0.1),
    "bulk_at_20": around("Pa", 1.5e9, 0.07, "S27: 1/A of the density's law"),
    "air_share": around("", 0.010, 0.3, "S17: 0.5–1 %", 0.12),
    "saturation_pressure": around("Pa", 45 * BAR, 0.2, "S17: dissolution by 30–100 bar"),
    "hose_relaxed": around("Pa", 0.95e9, 0.12, "P: static below dynamic"),
    "wall_fast": around("Pa", 1.5e8, 0.3, "E: branch of 20 ms"),
    "wall_slow": around("Pa", 2.0e8, 0.3, "E: branch of 0.25 s"),
    "coil_radius": around("m", 0.20, 0.2, "E: to which hoses are bent"),
    "piston_gap": around("m", 2.2e-5, 0.12, "1D: 5e-13 m³/(s Pa) at 40 mPa s", 0.02),
    "port_leakage": around("m³/(s √Pa)", 2e-9, 0.4, "E: 0.4 L/min at 100 bar", 0.04),
    "seal_force": around("N", 350.0, 0.3, "S14, E", 0.12),
    "seal_ratio": around("", 1.5, 0.08, "S14"),
    "stribeck_speed": around("m/s", 0.018, 0.3, "S14"),
    "seal_viscosity": around("m", 1.1e4, 0.3, "S16"),
    "hinge_torque": around("N m", 320.0, 0.3, "E: large bearing", 0.08),
    "joint_play": around("rad", 3.5e-4, 0.3, "E"),
    "joint_stiffness": around("N m/rad", 5.5e6, 0.25, "E: 2–20e6"),
    "joint_damping": around("N m s/rad", 3.5e3, 0.3, "E"),
    "droop": around("", 0.028, 0.3, "E", 0.05),
    "spool_lag": around("s", 0.011, 0.2, "S16: jet pipe and spool"),
    "spool_rate": around("1/s", 10.0, 0.15, "E: by the pilot's flow at 25 bar"),
    "play_width": around("", 0.009, 0.4, "E: 2 % hysteresis", 0.05),
    "discharge": around("", 1.0, 0.0, "P: as measured"),
    "input_lag": around("s", 0.008, 0.25, "E: Bessel filter at the driver's input"),
    "input_delay": around("s", 0.003, 0.3, "E"),
    "compensator_lag": around("s", 0.015, 0.3, "S16: its damping orifice"),
    "compensator_frequency": around("rad/s", 220.0, 0.15, "E: 60 g and spring"),
    "band_left": around("", 0.125, 0.05, "P: opens between 0.23 and 0.30 V, rounded"),
    "band_right": around("", 0.165, 0.05, "P: opens above 0.30 V, rounded"),
    "half_left": around("", 0.264, 0.04, "P"),
    "half_right": around("", 0.174, 0.04, "P"),
    "most_left": around("", 0.783, 0.02, "P"),
    "most_right": around("", 0.661, 0.02, "P"),
    "brake_torque": around("N m", 250.0, 0.2, "D: 8 bar on the motors less churning", 0.05),
    "churning": around("N m s²", 45.0, 0.3, "E: wet discs", 0.05),
    "soil_stress": around("Pa", 3e10, 0.3, "E: hard ground in Wong and Reece's law", 0.2),
    "ground_friction": around("", 0.64, 0.1, "E: asphalt", 0.03),
    "bore_radius": around("m", 0.115, 0.1, "E: 2/3 of the patch's mean half size", 0.01),
    "stiff_along": around("N/m", 4.1e5, 0.15, "S14", 0.02),
    "stiff_across": around("N/m", 2.3e5, 0.15, "S14", 0.02),
    "relaxation_length": around("m", 0.20, 0.25, "E: a third of the radius"),
    "twist_stiffness": around("N m/rad", 1.6e4, 0.2, "E: 8–40e3"),
    "tire_damping": around("N s/m", 2.6e3, 0.3, "E"),
    "angle_delay": around("s", 0.002, 0.3, "E: of the resolver's converter"),
    "stamp_cycle": around("s", 0.002, 0.1, "E: times are rounded to the logger's cycle"),
    "angle_lag": around("s", 0.0035, 0.3, "E: its tracking loop"),
    "imbalance": Constant("", -0.003, 0.0, 0.003, "E: amplitudes of sine and cosine", 0.0003),
    "decimation": around("s", 0.003, 0.2, "E: length of the decimator's kernel"),
    "angle_noise": around("rad", 3.5e-4, 0.2, "P"),
    "angle_step": around("rad", 2 * math.pi / 16384, 0.0, "E: 14 bit"),
    "pressure_noise": around("Pa", 0.3 * BAR, 0.3, "E"),
}
"""Constants of a healthy oak."""

REALISED = {
    "sensor_delay": {"angle_delay": 1.0},
    "sensor_filter": {"angle_lag": 1.0},
    "measuring_chain": {"decimation": 1.0},
    "engine_droop": {"droop": 1.0},
    "pump_response": {"stroke_time": 1.0, "swash_lag": 0.5},
    "pump_limit": {"relief_pressure": 1.0},
    "command_delay": {"input_lag": 1.0},
    "spool_lag": {"spool_lag": 1.0},
    "spool_rate": {"spool_rate": 1.0},
    "dead_band": {"band_left": 1.0, "band_right": 1.0},
    "valve_gain": {"discharge": 1.0},
    "valve_hysteresis": {"play_width": 1.0},
    "compensator_lag": {"compensator_lag": 1.0},
    "compensator_opening": {"check_drop": -1.0},
    "back_pressure": {"return_length": 1.0},
    "oil_bulk_modulus": {"bulk_at_20": 1.0},
    "entrained_air": {"air_share": 1.0},
    "hose_compliance": {"hose_relaxed": -1.0, "wall_fast": -0.5},
    "cylinder_leakage": {"piston_gap": 1.0},
    "cross_port_leakage": {"port_leakage": 1.0},
    "seal_friction": {"seal_force": 1.0},
    "joint_friction": {"hinge_torque": 1.0},
    "joint_backlash": {"joint_play": 1.0},
    "frame_compliance": {"joint_stiffness": -1.0},
    "driveline_resistance": {"churning": 1.0},
    "tire_relaxation": {"relaxation_length": 1.0},
    "tire_stiffness": {"stiff_across": 1.0, "stiff_along": 0.6},
    "tire_scrub": {"bore_radius": 1.0},
    "soft_ground": {"soil_stress": -1.0},
}
"""Constants that an effect scales, and by which power; the sensor's gain, temperature, payload and slope are shifted."""

OIL_DENSITY = 865.0
BORE = 0.0127
"""Bore [m] of each of two hoses beside each other."""
PISTON_LENGTH = 0.025
CENTRE_HEIGHT = 1.0
"""Height [m] of the centre of mass over the ground."""
BARUS = 2e-8
"""Pressure coefficient [1/Pa] of the viscosity."""
ROUNDING = 0.02
"""Rounding of the metering edges, share of the stroke."""


def _vehicle(m: Made) -> dict[str, float]:
    """Payload that overhangs behind the rear axle; a slope down to the right, which shifts load between the sides."""
    made = vehicle.loaded(m, "rear", 2.5, 0.5) | vehicle.slope(m, 0.0, -1.0)
    tilted = made["mass_total"] * CENTRE_HEIGHT * made["slope_across"]
    return made | {"load_tilt": tilted / (2 * m["track"])}


def land(depth: float) -> float:
    """Opening of an edge with a rounding: √(x² + r²) − r."""
    return math.sqrt(max(depth, 0.0) ** 2 + ROUNDING**2) - ROUNDING


def _lands(band: float, low: float, high: float, side: str) -> dict[str, float]:
    """Widths of three lands of a ``side`` such that the openings at 50, 75 and 100 % are ``low``, ``high`` and 1."""
    band = min(band, 0.45)
    first = low / land(0.5 - band)
    second = (high - first * land(0.75 - band)) / land(0.25)
    third = (1.0 - first * land(1.0 - band) - second * land(0.5)) / land(0.25)
    return {f"first_{side}": first, f"second_{side}": second, f"third_{side}": third}


def _hydraulics(m: Made) -> dict[str, float]:
    """Oil at its temperature, valve, hoses and relief.

    Andrade 1930: μ = μ₄₀ exp(B (1/T − 1/T₄₀)), through VG46 at 40 and 75 °C.
    """
    made = vehicle.valve(m)
    area = 2 * math.pi / 4 * BORE**2
    reynolds = OIL_DENSITY * BORE / area
    return made | {
        "viscosity": 0.0398 * math.exp(4240.0 * (1.0 / vehicle.kelvin(m["temperature"]) - 1.0 / 313.15)),
        "bulk_modulus": m["bulk_at_20"] / (1.0 + 0.006 * (m["temperature"] - 20.0)),
        "check_passage": m["flow_left"] / math.sqrt(m["check_drop"]),
        "entrance_loss": 1.25 * 0.5 * OIL_DENSITY / area**2,
        "dean": reynolds * math.sqrt(0.5 * BORE / m["coil_radius"]),
        "gap_conductance": 2 * math.pi * 0.08 * m["piston_gap"] ** 3 / (12.0 * PISTON_LENGTH),
        "relief_passage": 240.0 * LITRE_PER_MINUTE / math.sqrt(m["relief_pressure"]),
        "return_passage": m["flow_left"] / (2 * BAR * m["return_length"]) ** (4 / 7),
        **_lands(m["band_left"], m["half_left"], m["most_left"], "left"),
        **_lands(m["band_right"], m["half_right"], m["most_right"], "right"),
    }


def _command(m: Made) -> dict[str, float]:
    """Pure delay of the command; the driver's input filter comes besides."""
    return {"command_delay": m["input_delay"]}


def _tires(m: Made) -> dict[str, float]:
    """Tires and ground.

    Entry angle θ_e of a triangle of radial stress with its peak k z/b at 0.4 θ_e: F = 0.21 k r² θ_e³; resistance of rolling
    1.4 θ_e/3 of the load (Wong, Reece 1967, for small angles and a straight pressure–sinkage line).
    """
    entry = (m["load_mean"] / (0.21 * m["soil_stress"] * m["tire_radius"] ** 2)) ** (1 / 3)
    soil = 1.4 * entry / 3
    return {
        "tire_rolling": 0.008,
        "soil_rolling": soil,
        "rolling": 0.008 + soil,
        "grip_sticking": m["ground_friction"] / 0.96,
        "stiffness_along": m["stiff_along"],
        "stiffness_across": m["stiff_across"],
    }


DERIVED = {"vehicle": _vehicle, "hydraulics": _hydraulics, "command": _command, "tires": _tires}
"""What follows from the constants, by part."""


def angle_delay(m: Made) -> float:
    """Mean delay [s] of the joint angle: pure; rounding of times goes either way."""
    return m["angle_delay"]


def angle_lag(m: Made) -> float:
    """Lag [s] of the angle's filter: Bessel of second order."""
    return m["angle_lag"]


def span(m: Made) -> float:
    """Measured range of the joint over the true one: a resolver whose sine is larger than its cosine."""
    stop = m["stop_angle"]
    return m["angle_gain"] * math.atan2((1.0 + m["imbalance"]) * math.sin(stop), math.cos(stop)) / stop


def chain_lag(m: Made) -> float:
    """Mean lag [s] of all channels: half the length of a symmetric kernel."""
    return 0.5 * m["decimation"]


def command_delay(m: Made) -> float:
    """Mean delay [s] of the command: pure, and of a Bessel filter of second order."""
    return m["input_delay"] + m["input_lag"]


def pump_response(m: Made) -> float:
    """Time [s] until the pump has made 63 % of its stroke: at its fastest rate, behind its inertia."""
    return 0.63 * m["stroke_time"] + m["swash_lag"]


def pump_limit(m: Made) -> float:
    """Highest pressure [Pa] of the supply: of the relief at its full lift."""
    return m["relief_pressure"] + m["relief_band"]


def spool_lag(m: Made) -> float:
    """Mean lag [s] of small motions of the spool."""
    return m["spool_lag"]


def spool_rate(m: Made) -> float:
    """Stroke [1/s] at full error and full pilot pressure."""
    return m["spool_rate"] / math.sqrt(1.0 + (m["spool_rate"] * m["spool_lag"]) ** 2)


def regulated_flow(m: Made) -> float:
    """Flow [m³/s] at 75 % of the signal to the left with the compensator at rest."""
    full = math.tanh(m["most_left"] / (1.1 * m["viscosity"]))
    return m["edge_left"] * m["discharge"] * full * m["most_left"] * math.sqrt(m["edge_drop"])


def hysteresis(m: Made) -> float:
    """Width of the loop, share of the full signal: twice the plays by their weights, 0.4 and 0.3 of 2.5 times the width."""
    return 2.3 * m["play_width"]


def open_passage(m: Made) -> float:
    """Conductance [m³/(s √Pa)] of the compensator at rest and the load check behind it."""
    return (m["compensator_passage"] ** -2 + m["check_passage"] ** -2) ** -0.5


def back_pressure(m: Made, flow: float) -> float:
    """Pressure [Pa] behind the return edge: of a long hose by Blasius."""
    return m["tank_pressure"] + (flow / m["return_passage"]) ** (7 / 4) * (m["viscosity"] / 0.04) ** 0.25


def bulk_modulus(m: Made, pressure: float) -> float:
    """Bulk modulus [Pa] of the liquid by Dowson and Higginson's density."""
    start, b = 1.0 / m["bulk_modulus"], 1.7e-9
    return (1.0 + b * pressure) * (1.0 + (start + b) * pressure) / start


def gas(m: Made, volume: float) -> float:
    """Free gas [m³] in a side of a ``volume`` at atmospheric pressure."""
    return m["air_share"] * (volume + m["hose_volume"])


def hose(m: Made, pressure: float) -> float:
    """Compliance [m³/Pa] of a side's hose, relaxed."""
    return m["hose_volume"] / m["hose_relaxed"]


def piston_leakage(m: Made, drop: float) -> float:
    """Leakage [m³/s] past both pistons: in a gap, the oil thicker under pressure."""
    return m["gap_conductance"] / m["viscosity"] * (1.0 - math.exp(-BARUS * drop)) / BARUS


def port_leakage(m: Made, drop: float) -> float:
    """Leakage [m³/s] between the ports: through a short bore."""
    root = math.sqrt(drop)
    return m["port_leakage"] * root * math.tanh(root / (2 * math.sqrt(BAR) * m["viscosity"] / 0.04))


def breakaway(m: Made) -> float:
    """Breakaway force [N] of a cylinder without pressure: before its film has grown."""
    return m["seal_force"]


def drag(m: Made) -> float:
    """Torque [N m] of brake and motor against a wheel at 1 rad/s."""
    return m["brake_torque"] + m["churning"]


def scrub(m: Made, angle: float) -> float:
    """Torque [N m] that swivels a standing wheel by an ``angle`` while its bore slides: T (1 − exp(−c ψ/T))."""
    most = 0.92 * m["bore_radius"] * m["grip_sticking"] * m["load_mean"]
    return most * (1.0 - math.exp(-m["twist_stiffness"] * angle / most))
