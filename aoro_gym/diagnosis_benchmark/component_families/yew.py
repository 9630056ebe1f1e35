"""yew: constants of an old, worn machine on radial tires, what follows from them, and how each effect comes about on it."""

import math

from aoro_gym.diagnosis_benchmark.independent.constants import Constant
from aoro_gym.units import BAR, LITRE_PER_MINUTE

from . import vehicle
from .vehicle import VEHICLE, Made, around

UNUSED = {"edge_drop"}
"""Constants of the steering circuit that follow from others here."""
TABLE: dict[str, Constant] = {
    **VEHICLE,
    **{name: one for name, one in vehicle.hydraulic_table(0.09).items() if name not in UNUSED},
    "flow_left": around("m³/s", 69.0 * LITRE_PER_MINUTE, 0.025, "P: measured, less what the compensator lets pass"),
    "flow_right": around("m³/s", 63.0 * LITRE_PER_MINUTE, 0.025, "P: measured, less what the compensator lets pass"),
    "mass_front_empty": around("kg", 5050.0, 0.06, "E: welded reinforcements in front"),
    "mass_rear_empty": around("kg", 5100.0, 0.06, "E: the rest of 10 t"),
    "inertia_front": around("kg m²", 3200.0, 0.13, "E: parameters.md A, with two corners"),
    "inertia_rear": around("kg m²", 3350.0, 0.13, "E: parameters.md A, with two corners"),
    "wheel_inertia": around("kg m²", 50.0, 0.2, "E"),
    "slope_angle": vehicle.zero("rad", 0.005, "P: flat ground", 0.004),
    "pump_displacement": around("m³/rad", 100e-6 / (2 * math.pi), 0.02, "E: vane pump, 160 L/min at 1595 rpm"),
    "pump_leakage": around("m³/(s Pa)", 3e-11, 0.3, "E: worn, 11 % of the flow at 100 bar", 0.05),
    "vane_band": around("Pa", 11 * BAR, 0.12, "E: pressure over the whole stroke of the ring"),
    "margin": around("Pa", 22 * BAR, 0.07, "E: spring of the ring", 0.015),
    "stroke_time": around("s", 0.06, 0.2, "E: ring in its oil"),
    "regulator_lead": around("s", 0.012, 0.15, "E"),
    "lift_pressure": around("Pa", 196 * BAR, 0.04, "E: main relief begins to open"),
    "lift_band": around("Pa", 13 * BAR, 0.2, "R: its spring over its lift"),
    "bulk_at_20": around("Pa", 1.48e9, 0.07, "S27"),
    "foam_share": around("", 0.014, 0.3, "S17: aerated, above 1 %", 0.16),
    "foam_time": around("s", 2.5, 0.3, "E: of small bubbles to dissolve at 30 bar"),
    "braid_slack": around("Pa", 0.85e9, 0.14, "P: static modulus, softened by age"),
    "braid_modulus": around("Pa", 5e8, 0.3, "E: dynamic less static"),
    "braid_friction": around("Pa", 12 * BAR, 0.3, "E: hysteresis of an old braid"),
    "barrel_gap": around("m", 3.2e-5, 0.15, "E: worn, four times the leakage of a new one", 0.03),
    "land_gap": around("m", 1.5e-5, 0.15, "R: clearance of worn spool lands", 0.02),
    "tank_pressure": around("Pa", 1.4 * BAR, 0.25, "E: of the return gallery", 0.06),
    "seal_force": around("N", 420.0, 0.35, "S14, E: hardened", 0.18),
    "seal_ratio": around("", 1.6, 0.08, "S14"),
    "stribeck_speed": around("m/s", 0.008, 0.3, "S14"),
    "seal_viscosity": around("m", 1.0e4, 0.3, "S16"),
    "hinge_torque": around("N m", 300.0, 0.35, "E: dry bush", 0.12),
    "joint_play": around("rad", 1.2e-3, 0.3, "E: 0.4 mm at the pins"),
    "joint_stiffness": around("N m/rad", 4.5e6, 0.25, "E: 2–20e6"),
    "joint_damping": around("N m s/rad", 3.5e3, 0.3, "E: where it touches"),
    "droop": around("", 0.04, 0.25, "E: mechanical governor, to 7 %", 0.05),
    "spool_lag": around("s", 0.013, 0.2, "E: dashpot of the spool"),
    "spool_rate": around("1/s", 9.0, 0.15, "E: 5–25"),
    "capstan": around("", 0.018, 0.3, "E: 3 % hysteresis at half the stroke", 0.06),
    "median_window": around("s", 0.010, 0.25, "E: of the lever's signal, against a worn track"),
    "median_delay": around("s", 0.004, 0.3, "E"),
    "compensator_lag": around("s", 0.016, 0.3, "S16"),
    "compensator_drop": around("Pa", 0.4 * BAR, 0.15, "E: open compensator at nominal flow"),
    "strainer_drop": around("Pa", 4.4 * BAR, 0.12, "E: strainer before it at nominal flow"),
    "bridge_ratio": around("", 0.6, 0.0, "E: share of the drop that is felt past a worn piston"),
    "bridge_spring": around("Pa", 4.2 * BAR, 0.06, "D: 7 bar over the edge"),
    "band_left": around("", 0.115, 0.06, "P: opens between 0.23 and 0.30 V, by a tip"),
    "band_right": around("", 0.155, 0.06, "P: opens above 0.30 V, by a tip"),
    "half_left": around("", 0.268, 0.05, "P"),
    "half_right": around("", 0.178, 0.05, "P"),
    "most_left": around("", 0.79, 0.025, "P"),
    "most_right": around("", 0.67, 0.025, "P"),
    "brake_torque": around("N m", 310.0, 0.2, "D: 8 bar on the motors", 0.08),
    "rut_modulus": around("Pa/m", 2e10, 0.4, "E: hard ground in Gerstner's law", 0.25),
    "ground_friction": around("", 0.62, 0.12, "E", 0.05),
    "contact_length": around("m", 0.42, 0.08, "E: long patch of a radial", 0.01),
    "belt_rigidity": around("", 1.0, 0.3, "E: bending stiffness of the belt, as new", 0.02),
    "relaxation_length": around("m", 0.38, 0.25, "E: long, of a soft carcass"),
    "twist_stiffness": around("N m/rad", 1.3e4, 0.2, "E: 8–40e3"),
    "tire_damping": around("N s/m", 1.9e3, 0.3, "E"),
    "packet_wait": around("s", 0.0035, 0.3, "E: mean wait of the sensor's packets"),
    "hann_window": around("s", 0.006, 0.3, "E: of the sensor's kernel"),
    "track_wear": Constant(
        "", -0.01, 0.0, 0.01, "E: ohms in the middle of the track, over those at its ends, less one", 0.001
    ),
    "chain_lag": around("s", 0.0012, 0.3, "E: each of two equal lags"),
    "angle_noise": around("rad", 5e-4, 0.2, "P"),
    "angle_step": around("rad", 2 * math.pi / 4096, 0.0, "E: 12 bit"),
    "pressure_noise": around("Pa", 0.45 * BAR, 0.3, "E"),
}
"""Constants of a healthy yew."""

REALISED = {
    "sensor_delay": {"packet_wait": 1.0},
    "sensor_filter": {"hann_window": 1.0},
    "measuring_chain": {"chain_lag": 1.0},
    "engine_droop": {"droop": 1.0},
    "pump_response": {"stroke_time": 1.0},
    "pump_limit": {"lift_pressure": 1.0},
    "command_delay": {"median_window": 1.0},
    "spool_lag": {"spool_lag": 1.0},
    "spool_rate": {"spool_rate": 1.0},
    "dead_band": {"band_left": 1.0, "band_right": 1.0},
    "valve_gain": {"bridge_ratio": -2.0},
    "valve_hysteresis": {"capstan": 1.0},
    "compensator_lag": {"compensator_lag": 1.0},
    "compensator_opening": {"strainer_drop": -1.0},
    "back_pressure": {"tank_pressure": 1.0},
    "oil_bulk_modulus": {"bulk_at_20": 1.0},
    "entrained_air": {"foam_share": 1.0},
    "hose_compliance": {"braid_slack": -1.0},
    "cylinder_leakage": {"barrel_gap": 1.0},
    "cross_port_leakage": {"land_gap": 1.0},
    "seal_friction": {"seal_force": 1.0},
    "joint_friction": {"hinge_torque": 1.0},
    "joint_backlash": {"joint_play": 1.0},
    "frame_compliance": {"joint_stiffness": -1.0},
    "driveline_resistance": {"brake_torque": 1.0},
    "tire_relaxation": {"relaxation_length": 1.0},
    "tire_stiffness": {"belt_rigidity": 4.0},
    "tire_scrub": {"contact_length": 1.0},
    "soft_ground": {"rut_modulus": -3.0},
}
"""Constants that an effect scales, and by which power; the sensor's gain, temperature, payload and slope are shifted."""

OIL_DENSITY = 862.0
BORE = 0.0127
"""Bore [m] of each of two hoses beside each other."""
ROUGHNESS = 0.012
"""Of worn hoses and their fittings, share of the bore."""
PISTON_LENGTH = 0.025
LAND_LENGTH, LAND_AROUND = 0.003, 4 * math.pi * 0.02
"""Length and circumference [m] of four spool lands."""
TIRE_WIDTH = 0.52
CENTRE_HEIGHT = 1.05
"""Height [m] of the centre of mass over the ground."""


def _vehicle(m: Made) -> dict[str, float]:
    """Payload on a winch far ahead of the front axle; a slope down to the rear and right, which shifts loads by its
    height."""
    made = vehicle.loaded(m, "front", 2.4, 0.2) | vehicle.slope(m, -0.6, -0.8)
    shifted = made["mass_total"] * CENTRE_HEIGHT * made["slope_along"] / (4 * m["half_base"])
    return made | {
        "load_front": made["load_front"] + shifted,
        "load_rear": made["load_rear"] - shifted,
        "load_tilt": made["mass_total"] * CENTRE_HEIGHT * made["slope_across"] / (2 * m["track"]),
    }


def rhombus(place: float) -> float:
    """Area of a rhombic port uncovered to a share of its diagonal, over the whole."""
    y = min(max(place, 0.0), 1.0)
    return 2 * y * y if y < 0.5 else 1 - 2 * (1 - y) ** 2


def _rows(band: float, low: float, high: float, side: str) -> dict[str, float]:
    """Areas of three rows of ports such that the openings at 50, 75 and 100 % are ``low``, ``high`` and 1; none below 0."""
    first = low / rhombus((0.5 - band) / (0.8 - band))
    second = max(high - first * rhombus((0.75 - band) / (0.8 - band)), 0.0) / rhombus(0.25 / 0.35)
    third = max(1.0 - first - second, 0.0)
    return {f"rhombus_one_{side}": first, f"rhombus_two_{side}": second, f"rhombus_three_{side}": third}


def _hydraulics(m: Made) -> dict[str, float]:
    """Oil at its temperature, valve, hoses, gaps.

    Litovitz 1952: μ = μ₄₀ exp(B (1/T³ − 1/T₄₀³)), through VG46 at 40 and 75 °C.
    """
    full = m["pump_displacement"] * m["engine_speed"]
    area = 2 * math.pi / 4 * BORE**2
    length = m["line_resistance"] * 2 * math.pi * BORE**4 / 128.0
    friction = (2 * math.log10(3.7 / ROUGHNESS)) ** -2
    drop = m["bridge_spring"] / m["bridge_ratio"]
    return vehicle.valve(m) | {
        "edge_drop": drop,
        "standby_stroke": m["pump_leakage"] * m["margin"] / full,
        "viscosity": 0.0398 * math.exp(1.5413e8 * (vehicle.kelvin(m["temperature"]) ** -3 - 313.15**-3)),
        "bulk_modulus": m["bulk_at_20"] - 7.5e6 * (m["temperature"] - 20.0),
        "rough_loss": friction * length / BORE * 0.5 * OIL_DENSITY / area**2,
        "strainer_passage": m["flow_left"] / math.sqrt(m["strainer_drop"]),
        "borda_loss": 0.5 * OIL_DENSITY / area**2,
        "lift_passage": full / math.sqrt(m["lift_pressure"]),
        "barrel_conductance": 2 * math.pi * 0.08 * m["barrel_gap"] ** 3 / (12.0 * PISTON_LENGTH),
        "land_conductance": LAND_AROUND * m["land_gap"] ** 3 / (12.0 * LAND_LENGTH),
        **_rows(min(m["band_left"], 0.45), m["half_left"], m["most_left"], "left"),
        **_rows(min(m["band_right"], 0.45), m["half_right"], m["most_right"], "right"),
    }


def _command(m: Made) -> dict[str, float]:
    """Pure delay of the command; a median comes besides."""
    return {"command_delay": m["median_delay"]}


def _tires(m: Made) -> dict[str, float]:
    """Tires and ground.

    Gerstner 1832: R = 0.86 ∛(F⁴/(b k d²)), p = k z. Belt on the springs of its sidewalls: 2 √2 k^¾ (E I)^¼ (Winkler).
    """
    diameter, load = 2 * m["tire_radius"], m["load_mean"]
    stiff = m["belt_rigidity"] ** 0.25
    return {
        "rolling": 0.009 + 0.86 * (load / (TIRE_WIDTH * m["rut_modulus"] * diameter**2)) ** (1 / 3),
        "grip": m["ground_friction"],
        "swivel_arm": 0.25 * m["contact_length"],
        "stiffness_along": 3.4e5 * stiff,
        "stiffness_across": 1.8e5 * stiff,
    }


DERIVED = {"vehicle": _vehicle, "hydraulics": _hydraulics, "command": _command, "tires": _tires}
"""What follows from the constants, by part."""


def angle_delay(m: Made) -> float:
    """Mean delay [s] of the joint angle: mean wait of its packets."""
    return m["packet_wait"]


def angle_lag(m: Made) -> float:
    """Lag [s] of the angle's filter: half a raised cosine."""
    return 0.5 * m["hann_window"]


def span(m: Made) -> float:
    """Measured range of the joint over the true one: a track that is worn about its middle."""
    stop = m["stop_angle"]
    worn = m["track_wear"] * 0.125 * math.sqrt(math.pi) * math.erf(stop / 0.25)
    return m["angle_gain"] * (1.0 + worn / stop)


def chain_lag(m: Made) -> float:
    """Mean lag [s] of all channels: two equal ones."""
    return 2 * m["chain_lag"]


def command_delay(m: Made) -> float:
    """Mean delay [s] of the command: pure, and half the window of a median."""
    return m["median_delay"] + 0.5 * m["median_window"]


def pump_response(m: Made) -> float:
    """Time [s] until the ring has made 63 % of its stroke: its lag."""
    return m["stroke_time"]


def pump_limit(m: Made) -> float:
    """Highest pressure [Pa] of the supply: of the relief at its full lift, which the flow helps to hold."""
    return (m["lift_pressure"] + m["lift_band"]) / 1.05


def spool_lag(m: Made) -> float:
    """Mean lag [s] of small motions of the spool, out and home."""
    return 1.25 * m["spool_lag"]


def spool_rate(m: Made) -> float:
    """Stroke [1/s] at full error, outwards."""
    return 1.0 / (m["spool_lag"] ** 3 + m["spool_rate"] ** -3) ** (1 / 3)


def regulated_flow(m: Made) -> float:
    """Flow [m³/s] at 75 % of the signal to the left with the compensator at rest."""
    band = min(m["band_left"], 0.45)
    rows = [m[f"rhombus_{one}_left"] for one in ("one", "two")]
    area = rows[0] * rhombus((0.75 - band) / (0.8 - band)) + rows[1] * rhombus(0.25 / 0.35)
    return m["edge_left"] * area * math.sqrt(m["edge_drop"])


def hysteresis(m: Made) -> float:
    """Width of the loop at half the signal, share of the full one: the cable's ends out and home."""
    rub = m["capstan"]
    return (0.5 + 0.4 * rub) / (1 - rub) - (0.5 - 0.4 * rub) / (1 + rub)


def open_passage(m: Made) -> float:
    """Conductance [m³/(s √Pa)] of the open compensator and of the strainer before it."""
    return (m["compensator_passage"] ** -2 + m["strainer_passage"] ** -2) ** -0.5


def back_pressure(m: Made, flow: float) -> float:
    """Pressure [Pa] behind the return edge: of a gallery under pressure, and of the dive into it."""
    return m["tank_pressure"] + m["borda_loss"] * flow**2


def bulk_modulus(m: Made, pressure: float) -> float:
    """Bulk modulus [Pa] of the liquid by Bridgman's parabola."""
    q = pressure / m["bulk_modulus"]
    return m["bulk_modulus"] * (1 - q + 5.5 * q * q) / (1 - 11 * q)


def gas(m: Made, volume: float) -> float:
    """Free gas [m³] in a side of a ``volume`` at atmospheric pressure."""
    return m["foam_share"] * (volume + m["hose_volume"])


def hose(m: Made, pressure: float) -> float:
    """Compliance [m³/Pa] of a side's hose once its braid slips."""
    return m["hose_volume"] / m["braid_slack"]


def piston_leakage(m: Made, drop: float) -> float:
    """Leakage [m³/s] past both pistons: in a gap where the oil warms."""
    return m["barrel_conductance"] / m["viscosity"] * math.expm1(9e-9 * drop) / 9e-9


def port_leakage(m: Made, drop: float) -> float:
    """Leakage [m³/s] between the ports: past lands that are pushed aside."""
    return m["land_conductance"] / m["viscosity"] * (1 + 1.5 * math.tanh(drop / (60 * BAR)) ** 2) * drop


def breakaway(m: Made) -> float:
    """Breakaway force [N] of a cylinder without pressure: its static friction."""
    return m["seal_force"]


def drag(m: Made) -> float:
    """Torque [N m] of brake and motor against a wheel at 1 rad/s."""
    return m["brake_torque"] * (0.8 + 0.55 * math.exp(-1.0))


def scrub(m: Made, angle: float) -> float:
    """Torque [N m] that swivels a standing wheel by an ``angle``: a ring of brushes."""
    most = m["swivel_arm"] * m["grip"] * m["load_mean"]
    q = min(m["twist_stiffness"] * angle / (1.5 * most), 1.0)
    w = math.sqrt(1 - q)
    return most * 1.5 * (q * w + 2 / 3 - w + w**3 / 3)
