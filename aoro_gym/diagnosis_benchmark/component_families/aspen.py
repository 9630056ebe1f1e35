"""aspen: constants of a small maker's machine with a gear pump, what follows from them, and how each effect comes about."""

import math

import numpy as np

from aoro_gym.diagnosis_benchmark.independent.constants import Constant
from aoro_gym.units import BAR, LITRE_PER_MINUTE

from . import measuring, vehicle
from .vehicle import VEHICLE, Made, around

UNUSED = {"stroke_time"}
"""Constants of the steering circuit that a pump of one displacement does not have."""
TABLE: dict[str, Constant] = {
    **VEHICLE,
    **{name: one for name, one in vehicle.hydraulic_table(0.06).items() if name not in UNUSED},
    "flow_left": around("m³/s", 68.0 * LITRE_PER_MINUTE, 0.02, "P: measured, less what the compensator lets pass"),
    "flow_right": around("m³/s", 62.2 * LITRE_PER_MINUTE, 0.02, "P: measured, less what the compensator lets pass"),
    "mass_front_empty": around("kg", 4850.0, 0.06, "E: light front frame"),
    "mass_rear_empty": around("kg", 5150.0, 0.06, "E: the rest of 10 t"),
    "inertia_front": around("kg m²", 2950.0, 0.12, "E: parameters.md A, with two corners"),
    "inertia_rear": around("kg m²", 3450.0, 0.12, "E: parameters.md A, with two corners"),
    "wheel_inertia": around("kg m²", 40.0, 0.2, "E: light rims"),
    "slope_angle": vehicle.zero("rad", 0.004, "P: flat ground", 0.003),
    "pump_displacement": around("m³/rad", 82e-6 / (2 * math.pi), 0.02, "E: gear pump, 131 L/min at 1595 rpm"),
    "pump_leakage": around("m³/(s Pa)", 1.6e-11, 0.3, "E: volumetric efficiency 0.93 at 150 bar", 0.03),
    "margin": around("Pa", 20 * BAR, 0.07, "E: spring of the priority valve", 0.012),
    "sense_lag": around("s", 0.006, 0.3, "E: load-sensing line with its damping orifice"),
    "regulator_lead": around("s", 0.009, 0.15, "E: damping orifice of the priority valve"),
    "priority_lag": around("s", 0.055, 0.2, "E: spool of the priority valve behind its orifice"),
    "priority_band": around("Pa", 5 * BAR, 0.2, "E: rate of its spring over the stroke"),
    "priority_drop": around("Pa", 3.6 * BAR, 0.12, "E: its edge to the steering at nominal flow"),
    "bypass_drop": around("Pa", 11 * BAR, 0.12, "E: its other edge half open and the whole flow"),
    "poppet_pressure": around("Pa", 188 * BAR, 0.04, "E: main relief, 180–280 bar when all flow passes"),
    "poppet_band": around("Pa", 16 * BAR, 0.2, "R: spring of the poppet over its lift"),
    "filter_cake": around("", 1.0, 0.2, "E: 1.6 bar at nominal flow and 40 °C", 0.05),
    "bulk_most": around("Pa", 1.85e9, 0.06, "Jelali, Kroll 2003: 1.8e9 at 280 bar"),
    "pocket_at_rest": around("m³", 7e-6, 0.35, "S17: 0.5 % of a side, in a corner of it", 0.15),
    "neck_resistance": around("Pa s/m³", 4e10, 0.2, "E: gap of 0.3 mm before the pocket"),
    "hose_expansion": around("", 0.0095, 0.14, "E: share by which a hose grows at 100 bar, 1.5e9 Pa there"),
    "piston_clearance": around("m", 2.0e-5, 0.12, "1D: 5e-13 m³/(s Pa) at 40 mPa s", 0.02),
    "bore_opening": around("m", 2.8e-4, 0.15, "E: 0.4 L/min at 100 bar between the ports", 0.02),
    "seal_force": around("N", 340.0, 0.3, "S14, E", 0.13),
    "seal_ratio": around("", 1.45, 0.08, "S14"),
    "stribeck_speed": around("m/s", 0.014, 0.3, "S14"),
    "seal_viscosity": around("m", 1.3e4, 0.3, "S16"),
    "hinge_torque": around("N m", 210.0, 0.3, "E", 0.09),
    "joint_play": around("rad", 4.5e-4, 0.3, "E"),
    "joint_stiffness": around("N m/rad", 8e6, 0.25, "E: 2–20e6, where the pin bears fully"),
    "joint_damping": around("N m s/rad", 3e3, 0.3, "E"),
    "droop": around("", 0.032, 0.3, "E: mechanical governor, to 7 %", 0.03),
    "coil_lag": around("s", 0.007, 0.2, "E: L/R of the solenoid"),
    "spool_frequency": around("rad/s", 140.0, 0.12, "E: 250 g on its spring"),
    "spool_damping": around("", 0.85, 0.12, "E"),
    "spool_rate": around("1/s", 16.0, 0.15, "E: speed at which the solenoid has no force left"),
    "bristle_friction": around("", 0.0095, 0.35, "E: 2.5 % hysteresis", 0.06),
    "amplification": around("", 1.0, 0.0, "P: as measured"),
    "pulse_period": around("s", 0.008, 0.2, "E: driver's pulses, 125 Hz"),
    "compensator_lag": around("s", 0.014, 0.3, "S16"),
    "compensator_drop": around("Pa", 0.7 * BAR, 0.15, "E: open compensator at nominal flow"),
    "band_left": around("", 0.125, 0.05, "P: opens between 0.23 and 0.30 V"),
    "band_right": around("", 0.165, 0.05, "P: opens above 0.30 V"),
    "half_left": around("", 0.262, 0.04, "P"),
    "half_right": around("", 0.172, 0.04, "P"),
    "most_left": around("", 0.783, 0.02, "P"),
    "most_right": around("", 0.661, 0.02, "P"),
    "brake_torque": around("N m", 290.0, 0.2, "D: 8 bar on the motors", 0.05),
    "penetration": around("Pa", 6e6, 0.3, "E: cone index of hard ground", 0.15),
    "ground_friction": around("", 0.68, 0.1, "E: asphalt", 0.03),
    "contact_pressure": around("Pa", 2.6e5, 0.10, "E: mean pressure of the patch, 2–2.5 bar and the carcass", 0.02),
    "lug_height": around("m", 0.035, 0.15, "E: of the tread", 0.02),
    "relaxation_length": around("m", 0.28, 0.25, "E"),
    "twist_stiffness": around("N m/rad", 1.5e4, 0.2, "E: 8–40e3"),
    "tire_damping": around("N s/m", 2.4e3, 0.3, "E"),
    "beat_delay": around("s", 0.003, 0.3, "E: of two clocks that run apart"),
    "tent_window": around("s", 0.004, 0.3, "E: of the sensor's triangular kernel"),
    "rod_error": Constant("", -0.003, 0.0, 0.003, "E: speed of sound in the rod", 0.0004),
    "chain_lag": around("s", 0.002, 0.3, "E: Butterworth low-pass before the logger"),
    "angle_noise": around("rad", 4e-4, 0.2, "P"),
    "angle_step": around("rad", 2 * math.pi / 8192, 0.0, "E: 13 bit"),
    "pressure_noise": around("Pa", 0.35 * BAR, 0.3, "E"),
}
"""Constants of a healthy aspen."""

REALISED = {
    "sensor_delay": {"beat_delay": 1.0},
    "sensor_filter": {"tent_window": 1.0},
    "measuring_chain": {"chain_lag": 1.0},
    "engine_droop": {"droop": 1.0},
    "pump_response": {"priority_lag": 1.0},
    "pump_limit": {"poppet_pressure": 1.0},
    "command_delay": {"pulse_period": 1.0},
    "spool_lag": {"coil_lag": 1.0},
    "spool_rate": {"spool_rate": 1.0},
    "dead_band": {"band_left": 1.0, "band_right": 1.0},
    "valve_gain": {"amplification": 1.0},
    "valve_hysteresis": {"bristle_friction": 1.0},
    "compensator_lag": {"compensator_lag": 1.0},
    "compensator_opening": {"priority_drop": -1.0},
    "back_pressure": {"filter_cake": 1.0},
    "oil_bulk_modulus": {"bulk_most": 1.0},
    "entrained_air": {"pocket_at_rest": 1.0},
    "hose_compliance": {"hose_expansion": 1.0},
    "cylinder_leakage": {"piston_clearance": 1.0},
    "cross_port_leakage": {"bore_opening": 1.0},
    "seal_friction": {"seal_force": 1.0},
    "joint_friction": {"hinge_torque": 1.0},
    "joint_backlash": {"joint_play": 1.0},
    "frame_compliance": {"joint_stiffness": -1.0},
    "driveline_resistance": {"brake_torque": 1.0},
    "tire_relaxation": {"relaxation_length": 1.0},
    "tire_stiffness": {"lug_height": -1.0},
    "tire_scrub": {"contact_pressure": -1.0},
    "soft_ground": {"penetration": -1.0},
}
"""Constants that an effect scales, and by which power; the sensor's gain, temperature, payload and slope are shifted."""

OIL_DENSITY = 868.0
BORE = 0.0127
"""Bore [m] of each of two hoses beside each other."""
PISTON_LENGTH = 0.025
TIRE_WIDTH = 0.53
CARCASS_ACROSS, CARCASS_ALONG = 5.5e5, 9e5
"""Stiffness [N/m] of a carcass without its lugs."""
LUGS_ACROSS, LUGS_ALONG = 1.33e4, 2.5e4
"""Stiffness [N] of the tread times its height."""


def _vehicle(m: Made) -> dict[str, float]:
    """Payload low on the rear frame, between hinge and axle; a slope down to the left and a little forwards."""
    return vehicle.loaded(m, "rear", 0.8, 0.3) | vehicle.slope(m, 0.28, 0.96)


def notch(place: float) -> float:
    """Area of a milled notch uncovered to a share of its length, over the whole."""
    y, r = min(max(place, 0.0), 1.0), 0.3
    end = min(y, r)
    depth = 1.0 - end / r
    disc = r * r * (math.acos(depth) - depth * math.sqrt(1.0 - depth * depth))
    return (disc + 2 * r * (y - end)) / (0.5 * math.pi * r * r + 2 * r * (1 - r))


def _pairs(band: float, low: float, high: float, side: str) -> dict[str, float]:
    """Areas of three pairs of notches such that the openings at 50, 75 and 100 % are ``low``, ``high`` and 1; none below
    0."""
    first = low / notch((0.5 - band) / (0.8 - band))
    second = max(high - first * notch((0.75 - band) / (0.8 - band)), 0.0) / notch(0.25 / 0.35)
    third = max(1.0 - first - second, 0.0)
    return {f"pair_one_{side}": first, f"pair_two_{side}": second, f"pair_three_{side}": third}


def _hydraulics(m: Made) -> dict[str, float]:
    """Oil at its temperature, valves, hoses, gaps.

    Avramov 1998: μ = μ₁ exp((B/T)^a), μ₁ = 1e-4 Pa s, a = 2.4453, through VG46 at 40 and 75 °C.
    """
    full = m["pump_displacement"] * m["engine_speed"]
    bore = m["bore_opening"]
    gap = math.pi * 0.08 * m["piston_clearance"]
    return vehicle.valve(m) | {
        "standby_stroke": 1.0,
        "viscosity": 1e-4 * math.exp(5.98645 * (313.15 / vehicle.kelvin(m["temperature"])) ** 2.4453),
        "bulk_modulus": m["bulk_most"] * (1.0 - 0.005 * (m["temperature"] - 35.0)),
        "line_reynolds": 2.0 * OIL_DENSITY / (math.pi * BORE),
        "priority_passage": m["flow_left"] / math.sqrt(m["priority_drop"]),
        "bypass_passage": 2.0 * full / math.sqrt(m["bypass_drop"]),
        "centre_passage": full / math.sqrt(5.0 * BAR),
        "poppet_passage": 2.0 * full / math.sqrt(m["poppet_pressure"]),
        "cake": m["filter_cake"] * (1.6 * BAR) ** 0.6 / (0.04 * m["flow_left"]),
        "speed_square": 2.0 / OIL_DENSITY,
        "bore_area_leak": math.pi / 4 * bore**2,
        "bore_thickness": 1.0 / (OIL_DENSITY * bore),
        "gap_conductance": 2 * 1.9 * gap * m["piston_clearance"] ** 2 / (12.0 * PISTON_LENGTH),
        "gap_half_area": 0.5 * gap,
        **_pairs(min(m["band_left"], 0.45), m["half_left"], m["most_left"], "left"),
        **_pairs(min(m["band_right"], 0.45), m["half_right"], m["most_right"], "right"),
    }


def _command(m: Made) -> dict[str, float]:
    """No pure delay: the driver's pulses are all."""
    return {"command_delay": 0.0}


def _tires(m: Made) -> dict[str, float]:
    """Tires and ground.

    Mobility number CI b d/F √(δ/h)/(1 + b/(2 d)), δ/h = 0.2, resistance r₀ + 0.287/number (Gee-Clough 1980, whose r₀ of
    0.049 is that of soil and 0.012 here). Gough's swivel moment μ/3 √(F³/p). Lugs and carcass in series.
    """
    diameter, load = 2 * m["tire_radius"], m["load_mean"]
    number = m["penetration"] * TIRE_WIDTH * diameter / load * math.sqrt(0.2) / (1.0 + TIRE_WIDTH / (2 * diameter))
    return {
        "rolling": 0.012 + 0.287 / number,
        "grip": m["ground_friction"],
        "swivel_moment": m["ground_friction"] / 3.0 * math.sqrt(load**3 / m["contact_pressure"]),
        "stiffness_along": 1.0 / (1.0 / CARCASS_ALONG + m["lug_height"] / LUGS_ALONG),
        "stiffness_across": 1.0 / (1.0 / CARCASS_ACROSS + m["lug_height"] / LUGS_ACROSS),
    }


DERIVED = {"vehicle": _vehicle, "hydraulics": _hydraulics, "command": _command, "tires": _tires}
"""What follows from the constants, by part."""


def angle_delay(m: Made) -> float:
    """Mean delay [s] of the joint angle: halfway of what it climbs through."""
    return m["beat_delay"]


def angle_lag(m: Made) -> float:
    """Lag [s] of the angle's filter: of a triangle twice as long."""
    return m["tent_window"]


def span(m: Made) -> float:
    """Measured range of the joint over the true one: by the stroke of a cylinder."""
    ends = measuring.by_rod(np.array([-m["stop_angle"], m["stop_angle"]]), m)
    return m["angle_gain"] * float(ends[1] - ends[0]) / (2 * m["stop_angle"])


def chain_lag(m: Made) -> float:
    """Mean lag [s] of all channels: a Butterworth low-pass of second order."""
    return m["chain_lag"]


def command_delay(m: Made) -> float:
    """Mean delay [s] of the command: half a pulse to average, half a pulse that holds."""
    return m["pulse_period"]


def pump_response(m: Made) -> float:
    """Time [s] until 63 % of the pump's flow no longer pass by: of the priority valve."""
    return m["priority_lag"]


def pump_limit(m: Made) -> float:
    """Highest pressure [Pa] of the supply: of the poppet at half its lift, which lets the whole flow pass."""
    return (m["poppet_pressure"] + 0.5 * m["poppet_band"]) / (1.0 - 0.5 * 0.06)


def spool_lag(m: Made) -> float:
    """Mean lag [s] of small motions of the spool: solenoid, and damping over spring."""
    return m["coil_lag"] + 2 * m["spool_damping"] / m["spool_frequency"]


def spool_rate(m: Made) -> float:
    """Stroke [1/s] at full current: force that falls with speed, and damping."""
    return 1.0 / (1.0 / m["spool_rate"] + 2 * m["spool_damping"] / m["spool_frequency"])


def regulated_flow(m: Made) -> float:
    """Flow [m³/s] at 75 % of the signal to the left with the compensator at rest."""
    band = min(m["band_left"], 0.45)
    pairs = [m[f"pair_{one}_left"] for one in ("one", "two")]
    area = pairs[0] * notch((0.75 - band) / (0.8 - band)) + pairs[1] * notch(0.25 / 0.35)
    return m["edge_left"] * area * m["amplification"] * math.sqrt(m["edge_drop"])


def hysteresis(m: Made) -> float:
    """Width of the loop, share of the full signal: friction that holds the spool either way, as it comes to rest."""
    return 2 * 1.3 * m["bristle_friction"]


def open_passage(m: Made) -> float:
    """Conductance [m³/(s √Pa)] of the open compensator and of the priority valve before it."""
    return (m["compensator_passage"] ** -2 + m["priority_passage"] ** -2) ** -0.5


def back_pressure(m: Made, flow: float) -> float:
    """Pressure [Pa] behind the return edge: of a filter with a compressible cake."""
    return m["tank_pressure"] + (m["cake"] * m["viscosity"] * flow) ** (1 / 0.6)


def bulk_modulus(m: Made, pressure: float) -> float:
    """Bulk modulus [Pa] of the oil with its finest bubbles: logarithmic."""
    return 0.5 * m["bulk_modulus"] * math.log10(90.0 * pressure / (280 * BAR) + 3.0)


def gas(m: Made, volume: float) -> float:
    """Free gas [m³] in a side at atmospheric pressure: in its pocket."""
    return m["pocket_at_rest"]


def hose(m: Made, pressure: float) -> float:
    """Compliance [m³/Pa] of a side's hose."""
    reference = 100 * BAR
    return m["hose_volume"] * 0.7 * m["hose_expansion"] * ((pressure + 4 * BAR) / reference) ** -0.3 / reference


def piston_leakage(m: Made, drop: float) -> float:
    """Leakage [m³/s] past both pistons at rest: laminar in an eccentric gap."""
    return m["gap_conductance"] / m["viscosity"] * drop


def port_leakage(m: Made, drop: float) -> float:
    """Leakage [m³/s] between the ports: through a bore twice as long as wide."""
    speed = math.sqrt(m["speed_square"] * drop) - 110.0 * m["viscosity"] * m["bore_thickness"]
    return 0.8 * m["bore_area_leak"] * max(speed, 0.0)


def breakaway(m: Made) -> float:
    """Breakaway force [N] of a cylinder: the highest dry friction over speed."""
    r = np.linspace(0.0, 2.0, 2001)
    return m["seal_force"] * float(np.max(np.tanh(4 * r) - (1 - 1 / m["seal_ratio"]) * np.tanh(0.5 * r)))


def drag(m: Made) -> float:
    """Torque [N m] of hub and motor against a wheel at 1 rad/s."""
    return m["brake_torque"]


def scrub(m: Made, angle: float) -> float:
    """Torque [N m] that swivels a standing wheel by an ``angle``."""
    return m["swivel_moment"] * math.tanh(m["twist_stiffness"] * angle / m["swivel_moment"])
