"""hazel: constants, what follows from them, and how each effect comes about on it; its days differ the most."""

import math

import numpy as np

from aoro_gym.diagnosis_benchmark.independent.constants import Constant
from aoro_gym.units import BAR

from . import vehicle
from .vehicle import VEHICLE, Made, around

TABLE: dict[str, Constant] = {
    **VEHICLE,
    **vehicle.hydraulic_table(0.12),
    "slope_angle": vehicle.zero("rad", 0.005, "P: flat ground, not surveyed", 0.005),
    "null_shift": vehicle.zero("", 0.008, "E", 0.004),
    "angle_offset": vehicle.zero("rad", 0.006, "E", 0.0015),
    "pressure_offset_a": vehicle.zero("Pa", 0.9 * BAR, "E", 0.3 * BAR),
    "pressure_offset_b": vehicle.zero("Pa", 0.9 * BAR, "E", 0.3 * BAR),
    "inertia_front": around("kg m²", 3300.0, 0.12, "E: crane slewed out"),
    "line_resistance": around("1/m³", 1.6e9, 0.2, "D: hoses Ø14 mm"),
    "line_loss": around("Pa s²/m⁶", 5e10, 0.3, "E: fittings"),
    "stroke_time": around("s", 0.09, 0.15, "R, 1D"),
    "sense_relief": around("Pa", 190 * BAR, 0.04, "E: relief of the load-sensing line"),
    "relief_pressure": around("Pa", 260 * BAR, 0.03, "E"),
    "filter_resistance": around("1/m³", 5e9, 0.25, "E: 2.3 bar at nominal flow", 0.08),
    "bulk_at_20": around("Pa", 1.5e9, 0.07, "S27"),
    "line_gas": around("m³", 9e-6, 0.4, "E: 2 % of a hose", 0.25),
    "hose_modulus": around("Pa", 1.4e9, 0.12, "P: fast part"),
    "hose_creep": around("m³/Pa", 1.0e-13, 0.25, "S26: static below dynamic modulus"),
    "piston_leakage": around("m³/(s Pa)", 3e-13, 0.4, "1D", 0.12),
    "port_leakage": around("m³/(s Pa)", 3e-13, 0.4, "R: spool lands", 0.05),
    "seal_force": around("N", 380.0, 0.3, "E", 0.22),
    "seal_ratio": around("", 1.4, 0.08, "S14"),
    "stribeck_speed": around("m/s", 0.015, 0.3, "S14"),
    "seal_viscosity": around("N s/m", 600.0, 0.3, "S16"),
    "hinge_torque": around("N m", 200.0, 0.3, "E", 0.15),
    "joint_play": around("rad", 5e-4, 0.3, "E"),
    "joint_stiffness": around("N m/rad", 7e6, 0.25, "E: 2–20e6"),
    "joint_damping": around("N m s/rad", 2e3, 0.3, "E"),
    "droop": around("", 0.03, 0.3, "E", 0.1),
    "coil_lag": around("s", 0.005, 0.2, "E: L/R of the solenoid"),
    "spool_lag": around("s", 0.009, 0.2, "1D"),
    "spool_rate": around("1/s", 11.0, 0.15, "E"),
    "magnetic_width": around("", 0.011, 0.35, "E: 2.2 % hysteresis"),
    "driver_gain": around("", 1.0, 0.0, "P"),
    "driver_window": around("s", 0.010, 0.2, "E: the driver averages the command"),
    "driver_delay": around("s", 0.006, 0.3, "E"),
    "compensator_lag": around("s", 0.012, 0.3, "S16"),
    "compensator_stop": around("", 0.66, 0.08, "E: set by a screw"),
    "band_left": around("", 0.135, 0.05, "P: 0.27 V"),
    "band_right": around("", 0.175, 0.05, "P: 0.35 V"),
    "half_left": around("", 0.264, 0.04, "P"),
    "half_right": around("", 0.174, 0.04, "P"),
    "most_left": around("", 0.783, 0.02, "P"),
    "most_right": around("", 0.661, 0.02, "P"),
    "brake_torque": around("N m", 260.0, 0.2, "D", 0.1),
    "shear_displacement": around("m", 0.004, 0.3, "E: hard ground in Janosi, Hanamoto's law", 0.25),
    "ground_friction": around("", 0.66, 0.1, "E", 0.05),
    "scrub_limit": around("", 1.0, 0.12, "E", 0.03),
    "shear": around("", 1.0, 0.15, "S14", 0.03),
    "relaxation_length": around("m", 0.26, 0.25, "E"),
    "twist_base": around("N m/rad", 1.4e4, 0.2, "E: 8–40e3", 0.03),
    "tire_damping": around("N s/m", 2e3, 0.3, "E"),
    "update_period": around("s", 0.002, 0.2, "E: of the angle on its bus"),
    "angle_window": around("s", 0.006, 0.3, "E: moving mean in the sensor"),
    "eccentricity": Constant("", -0.002, 0.0, 0.002, "E: of the sensor's magnet"),
    "chain_lag": around("s", 0.0015, 0.3, "E: low-pass of the logger"),
    "angle_noise": around("rad", 3e-4, 0.2, "P"),
    "angle_step": around("rad", 2 * math.pi / 8192, 0.0, "S34: 13 bit"),
    "pressure_noise": around("Pa", 0.3 * BAR, 0.3, "E"),
}
"""Constants of a healthy hazel."""

REALISED = {
    "sensor_delay": {"update_period": 1.0},
    "sensor_filter": {"angle_window": 1.0},
    "measuring_chain": {"chain_lag": 1.0},
    "engine_droop": {"droop": 1.0},
    "pump_response": {"stroke_time": 1.0},
    "pump_limit": {"sense_relief": 1.0},
    "command_delay": {"driver_window": 1.0},
    "spool_lag": {"coil_lag": 1.0},
    "spool_rate": {"spool_rate": 1.0},
    "dead_band": {"band_left": 1.0, "band_right": 1.0},
    "valve_gain": {"driver_gain": 1.0},
    "valve_hysteresis": {"magnetic_width": 1.0},
    "compensator_lag": {"compensator_lag": 1.0},
    "compensator_opening": {"compensator_stop": 1.0},
    "back_pressure": {"filter_resistance": 1.0},
    "oil_bulk_modulus": {"bulk_at_20": 1.0},
    "entrained_air": {"line_gas": 1.0},
    "hose_compliance": {"hose_creep": 1.0},
    "cylinder_leakage": {"piston_leakage": 1.0},
    "cross_port_leakage": {"port_leakage": 1.0},
    "seal_friction": {"seal_force": 1.0},
    "joint_friction": {"hinge_torque": 1.0},
    "joint_backlash": {"joint_play": 1.0},
    "frame_compliance": {"joint_stiffness": -1.0},
    "driveline_resistance": {"brake_torque": 1.0},
    "tire_relaxation": {"relaxation_length": 1.0},
    "tire_stiffness": {"shear": 1.0, "twist_base": 0.5},
    "tire_scrub": {"scrub_limit": 1.0, "twist_base": 0.5},
    "soft_ground": {"shear_displacement": 1.0},
}
"""Constants that an effect scales, and by which power; the sensor's gain, temperature, payload and slope are shifted."""


def _vehicle(m: Made) -> dict[str, float]:
    """Payload at the crane's tip, a slope along a diagonal."""
    return vehicle.loaded(m, "front", 2.6, 0.4) | vehicle.slope(m, math.sqrt(0.5), math.sqrt(0.5))


def _hydraulics(m: Made) -> dict[str, float]:
    """Oil at its temperature (Reynolds 1886) and valve."""
    return vehicle.valve(m) | {
        "viscosity": 0.0398 * math.exp(-0.034 * (m["temperature"] - 40.0)),
        "bulk_modulus": m["bulk_at_20"] * (1.0 - 0.006 * (m["temperature"] - 20.0)),
    }


def _command(m: Made) -> dict[str, float]:
    """Pure delay of the command; its driver averages it besides."""
    return {"command_delay": m["driver_delay"]}


def _tires(m: Made) -> dict[str, float]:
    """Tires in series with ground that shears, with plastic slip sinkage (Wong 2008)."""
    limit = m["ground_friction"] * math.exp(-3.0 * m["shear_displacement"])
    soil = m["shear_displacement"] / (limit * m["load_mean"])
    return {
        "grip_sliding": limit,
        "rolling": 0.013 + 1.2 * m["shear_displacement"],
        "stiffness_along": 1.0 / (1.0 / (4.2e5 * m["shear"]) + soil),
        "stiffness_across": 1.0 / (1.0 / (2.4e5 * m["shear"]) + soil),
        "scrub_moment": 2 / 3 * limit * m["load_mean"] * 0.165 * m["scrub_limit"],
        "twist_stiffness": 1.0 / (1.0 / m["twist_base"] + 0.25 * soil / 0.18**2),
    }


DERIVED = {"vehicle": _vehicle, "hydraulics": _hydraulics, "command": _command, "tires": _tires}
"""What follows from the constants, by part."""


def angle_delay(m: Made) -> float:
    """Mean delay [s] of the joint angle: a period until the next update, joined by straight lines."""
    return m["update_period"]


def angle_lag(m: Made) -> float:
    """Lag [s] of the angle's filter: half a moving mean."""
    return 0.5 * m["angle_window"]


def span(m: Made) -> float:
    """Measured range of the joint over the true one: an eccentric magnet adds e sin θ."""
    return m["angle_gain"] + m["eccentricity"] * math.sin(m["stop_angle"]) / m["stop_angle"]


def chain_lag(m: Made) -> float:
    """Mean lag [s] of all channels: of a low-pass of first order."""
    return m["chain_lag"]


def command_delay(m: Made) -> float:
    """Mean delay [s] of the command: pure, and half a moving mean."""
    return m["driver_delay"] + 0.5 * m["driver_window"]


def pump_response(m: Made) -> float:
    """Time [s] until the pump has made 63 % of its stroke: at its fastest rate."""
    return 0.63 * m["stroke_time"]


def pump_limit(m: Made) -> float:
    """Highest pressure [Pa] of the supply: load sensing's relief and the margin."""
    return m["sense_relief"] + m["margin"]


def spool_lag(m: Made) -> float:
    """Mean lag [s] of small motions of the spool: coil and spool."""
    return m["coil_lag"] + m["spool_lag"]


def spool_rate(m: Made) -> float:
    """Stroke [1/s] at full error."""
    return m["spool_rate"] / (1.0 + (m["spool_rate"] * m["spool_lag"]) ** 4) ** 0.25


def _opening(s: float, m: Made) -> float:
    """Share of the left edge that is open: Fritsch and Carlson's cubic."""
    from scipy.interpolate import CubicHermiteSpline

    band, low, high = m["band_left"], m["half_left"], m["most_left"]
    slope = 2 / ((0.5 - band) / low + 0.25 / (high - low))
    last = 2 / (0.25 / (high - low) + 0.25 / (1 - high))
    curve = CubicHermiteSpline([band, 0.5, 0.75, 1.0], [0.0, low, high, 1.0], [0.0, slope, last, 0.0])
    return float(curve(np.clip(s, band, 1.0)))


def regulated_flow(m: Made) -> float:
    """Flow [m³/s] at 75 % of the signal to the left with the compensator at rest."""
    return m["edge_left"] * _opening(0.75 * m["driver_gain"], m) * math.sqrt(m["edge_drop"])


def hysteresis(m: Made) -> float:
    """Width of the loop, share of the full signal."""
    return 2 * m["magnetic_width"]


def open_passage(m: Made) -> float:
    """Conductance [m³/(s √Pa)] of the compensator at its stop."""
    return m["compensator_passage"] * min(m["compensator_stop"], 1.0)


def back_pressure(m: Made, flow: float) -> float:
    """Pressure [Pa] behind the return edge: of a filter by Darcy."""
    return m["tank_pressure"] + m["filter_resistance"] * m["viscosity"] * flow


def bulk_modulus(m: Made, pressure: float) -> float:
    """Bulk modulus [Pa] of the liquid by Tait."""
    scale = 0.0894 * m["bulk_modulus"]
    return (scale + pressure) * (1 - 0.0894 * math.log(1 + pressure / scale)) / 0.0894


def gas(m: Made, volume: float) -> float:
    """Free gas [m³] in a side at atmospheric pressure: in its hose."""
    return m["line_gas"]


def hose(m: Made, pressure: float) -> float:
    """Compliance [m³/Pa] of a side's hose, crept."""
    return m["hose_volume"] / m["hose_modulus"] + m["hose_creep"]


def piston_leakage(m: Made, drop: float) -> float:
    """Leakage [m³/s] past both pistons: a seal that pressure lifts."""
    return m["piston_leakage"] * drop * (1 + drop / (80 * BAR)) * 0.04 / m["viscosity"]


def port_leakage(m: Made, drop: float) -> float:
    """Leakage [m³/s] between the ports: along spool lands."""
    return m["port_leakage"] * drop * 0.04 / m["viscosity"]


def breakaway(m: Made) -> float:
    """Breakaway force [N] of a cylinder without pressure: the peak of Brown and McPhee's curve."""
    r = np.linspace(0.0, 3.0, 3001)
    bell = (m["seal_ratio"] - 1) * r / (r**2 / 4 + 0.75) ** 2
    return float(m["seal_force"] / m["seal_ratio"] * np.max(np.tanh(4 * r) + bell))


def drag(m: Made) -> float:
    """Torque [N m] of brake and motor against a wheel at 1 rad/s."""
    return m["brake_torque"] * (1 + 0.25 * math.exp(-25.0))


def scrub(m: Made, angle: float) -> float:
    """Torque [N m] that swivels a standing wheel by an ``angle``: dz/dψ = 1 − (k z/M₀)⁴ along one axis."""
    rate, share = m["twist_stiffness"] / m["scrub_moment"], 0.0
    step = angle / 400
    for _ in range(400):
        middle = share + 0.5 * step * rate * (1 - share**4)
        share += step * rate * (1 - middle**4)
    return m["scrub_moment"] * share
