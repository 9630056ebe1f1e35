"""larch: constants of a modern electro-hydraulic machine, what follows from them, and how each effect comes about on it."""

import math

from aoro_gym.diagnosis_benchmark.independent.constants import Constant
from aoro_gym.units import BAR, GRAVITY, LITRE_PER_MINUTE

from . import vehicle
from .vehicle import VEHICLE, Made, around

TABLE: dict[str, Constant] = {
    **VEHICLE,
    **vehicle.hydraulic_table(0.05),
    "flow_left": around("m³/s", 85.0 * LITRE_PER_MINUTE, 0.02, "P: measured, before the compensator's droop"),
    "flow_right": around("m³/s", 78.5 * LITRE_PER_MINUTE, 0.02, "P: measured, before the compensator's droop"),
    "mass_front_empty": around("kg", 5000.0, 0.05, "E: cooler and electronics in front"),
    "mass_rear_empty": around("kg", 5000.0, 0.05, "E: the rest of 10 t"),
    "wheel_inertia": around("kg m²", 42.0, 0.2, "E"),
    "slope_angle": vehicle.zero("rad", 0.003, "P: flat ground", 0.0025),
    "compensator_drop": around("Pa", 2.0 * BAR, 0.15, "E: whole slot at nominal flow"),
    "spring_travel": around("", 0.58, 0.08, "E: where the compensator's spring lets it rest, share of its slot"),
    "stroke_time": around("s", 0.065, 0.15, "R: 63 % upwards of an electronic load-sensing pump"),
    "stroke_down": around("s", 0.045, 0.15, "R: 63 % downwards"),
    "control_band": around("Pa", 20 * BAR, 0.12, "E: margin's error that asks for the whole stroke"),
    "control_time": around("s", 0.075, 0.15, "E: integral time of the controller"),
    "regulator_lead": around("s", 0.013, 0.15, "E: derivative of the measured pressure"),
    "sense_lag": around("s", 0.005, 0.3, "E: pressure sensor and its filter"),
    "power_end": around("Pa", 205 * BAR, 0.03, "E: end of the spring's line"),
    "relief_pressure": around("Pa", 240 * BAR, 0.03, "E: main relief"),
    "cooler_bore": around("", 1.0, 0.03, "E: of the cooler's tubes", 0.006),
    "bulk_at_20": around("Pa", 1.62e9, 0.07, "S27"),
    "air_share": around("", 0.007, 0.3, "S17: 0.5–1 %", 0.15),
    "critical_pressure": around("Pa", 35 * BAR, 0.2, "Ruan, Burton 2006: above which no air is free (R)"),
    "hose_rubber": around("Pa", 1.0e9, 0.12, "P: static modulus of a hose, at 20 °C"),
    "piston_gap": around("m", 2.4e-5, 0.12, "1D: 5e-13 m³/(s Pa) at 40 mPa s", 0.03),
    "port_gap": around("m", 1.1e-5, 0.12, "R: clearance of spool lands", 0.015),
    "seal_force": around("N", 320.0, 0.3, "S14, E", 0.15),
    "seal_ratio": around("", 1.35, 0.08, "S14"),
    "stribeck_speed": around("m/s", 0.022, 0.3, "S14"),
    "seal_viscosity": around("m", 1.2e4, 0.3, "S16"),
    "hinge_torque": around("N m", 230.0, 0.3, "E", 0.1),
    "joint_play": around("rad", 3e-4, 0.3, "E"),
    "joint_stiffness": around("N m/rad", 5e6, 0.25, "E: 2–20e6, secant at 1 mrad"),
    "joint_damping": around("N m s/rad", 2.5e3, 0.3, "E"),
    "droop": around("", 0.022, 0.3, "E", 0.04),
    "coil_lag": around("s", 0.004, 0.2, "E: L/R of the solenoid under current control"),
    "spool_lag": around("s", 0.009, 0.2, "R: position control"),
    "spool_rate": around("1/s", 13.0, 0.15, "R: full stroke in 80 ms"),
    "spool_acceleration": around("1/s²", 2500.0, 0.2, "E: 14 m/s² over 5.5 mm"),
    "bouc_width": around("", 0.008, 0.4, "E: 1.6 % hysteresis", 0.05),
    "curve_scale": around("", 1.0, 0.0, "P: as measured"),
    "filter_cycle": around("s", 0.005, 0.2, "E: cycle of the control unit"),
    "filter_lag": around("s", 0.008, 0.25, "E: its exponential filter"),
    "compensator_lag": around("s", 0.013, 0.3, "S16"),
    "band_left": around("", 0.13, 0.05, "P: opens between 0.23 and 0.30 V"),
    "band_right": around("", 0.17, 0.05, "P: opens above 0.30 V"),
    "half_left": around("", 0.228, 0.04, "P: measured, before the droop"),
    "half_right": around("", 0.147, 0.04, "P: measured, before the droop"),
    "most_left": around("", 0.745, 0.02, "P: measured, before the droop"),
    "most_right": around("", 0.59, 0.02, "P: measured, before the droop"),
    "brake_torque": around("N m", 300.0, 0.2, "D: 8 bar on the motors", 0.06),
    "cone_index": around("Pa", 9e6, 0.3, "E: hard ground", 0.15),
    "ground_friction": around("", 0.65, 0.1, "E", 0.04),
    "disc_radius": around("m", 0.215, 0.08, "E: of the patch", 0.01),
    "sidewall": around("", 1.0, 0.13, "S14", 0.02),
    "relaxation_length": around("m", 0.24, 0.25, "E: 0.4 of the radius"),
    "twist_stiffness": around("N m/rad", 1.5e4, 0.2, "E: 8–40e3"),
    "tire_damping": around("N s/m", 2.2e3, 0.3, "E"),
    "queue_time": around("s", 0.004, 0.3, "E: mean wait of the angle in its queue"),
    "damper_lag": around("s", 0.002, 0.3, "E: each of two equal lags"),
    "linkage": Constant(
        "", -0.003, 0.0, 0.003, "E: lever on the sensor's shaft over that on the joint, less one", 0.0003
    ),
    "resample_period": around("s", 0.002, 0.2, "E: of the logger's own clock"),
    "angle_noise": around("rad", 2.6e-4, 0.2, "P"),
    "angle_step": around("rad", 2 * math.pi / 32768, 0.0, "E: 15 bit"),
    "pressure_noise": around("Pa", 0.25 * BAR, 0.3, "E"),
}
"""Constants of a healthy larch."""

REALISED = {
    "sensor_delay": {"queue_time": 1.0},
    "sensor_filter": {"damper_lag": 1.0},
    "measuring_chain": {"resample_period": 1.0},
    "engine_droop": {"droop": 1.0},
    "pump_response": {"stroke_time": 1.0, "stroke_down": 0.5},
    "pump_limit": {"power_end": 1.0},
    "command_delay": {"filter_lag": 1.0},
    "spool_lag": {"spool_lag": 1.0},
    "spool_rate": {"spool_rate": 1.0},
    "dead_band": {"band_left": 1.0, "band_right": 1.0},
    "valve_gain": {"curve_scale": 1.0},
    "valve_hysteresis": {"bouc_width": 1.0},
    "compensator_lag": {"compensator_lag": 1.0},
    "compensator_opening": {"spring_travel": 1.0},
    "back_pressure": {"cooler_bore": -1.0},
    "oil_bulk_modulus": {"bulk_at_20": 1.0},
    "entrained_air": {"air_share": 1.0},
    "hose_compliance": {"hose_rubber": -1.0},
    "cylinder_leakage": {"piston_gap": 1.0},
    "cross_port_leakage": {"port_gap": 1.0},
    "seal_friction": {"seal_force": 1.0},
    "joint_friction": {"hinge_torque": 1.0},
    "joint_backlash": {"joint_play": 1.0},
    "frame_compliance": {"joint_stiffness": -1.0},
    "driveline_resistance": {"brake_torque": 1.0},
    "tire_relaxation": {"relaxation_length": 1.0},
    "tire_stiffness": {"sidewall": 1.0},
    "tire_scrub": {"disc_radius": 1.0},
    "soft_ground": {"cone_index": -1.0},
}
"""Constants that an effect scales, and by which power; the sensor's gain, temperature, payload and slope are shifted."""

OIL_DENSITY = 870.0
BORE = 0.0127
"""Bore [m] of each of two hoses beside each other."""
PISTON_LENGTH = 0.025
LAND_LENGTH, LAND_AROUND = 0.003, 4 * math.pi * 0.02
"""Length and circumference [m] of four spool lands."""
CURVE_FOOT = 0.12
"""Signal from which the electronic curve is stretched."""
COOLER_LAMINAR, COOLER_ENDS = 1.2 * BAR, 0.8 * BAR
"""Drops [Pa] of a clean cooler at nominal flow and 50 mPa s: its tubes, and their ends."""
TIRE_WIDTH = 0.6
GROWTH = 11.0


def _vehicle(m: Made) -> dict[str, float]:
    """Payload above the joint, half of it on either frame, as tall as its inertia says; a slope down to the front and left.

    Its centre stands 0.15 m from the hinge on each frame; square of its radius of gyration 0.8 m².
    """
    half = {**m, "payload": 0.5 * m["payload"]}
    made = vehicle.loaded(half, "front", 0.15, 0.8)
    other = vehicle.loaded(half, "rear", 0.15, 0.8)
    made |= {name: other[name] for name in ("mass_rear", "centre_rear", "yaw_inertia_rear")}
    base = 2 * m["half_base"]
    lever = made["mass_front"] * (m["half_base"] + made["centre_front"])
    lever += made["mass_rear"] * (m["half_base"] - made["centre_rear"])
    total = made["mass_front"] + made["mass_rear"]
    front = 0.5 * GRAVITY * lever / base
    made |= {"mass_total": total, "load_front": front, "load_rear": 0.5 * GRAVITY * total - front}
    return made | vehicle.slope(m, 0.6, 0.8)


def bore(place: float) -> float:
    """Area of a bore uncovered to a share of its diameter, over the whole."""
    angle = math.acos(1.0 - 2.0 * min(max(place, 0.0), 1.0))
    return (angle - 0.5 * math.sin(2.0 * angle)) / math.pi


def _rows(band: float, low: float, high: float, side: str) -> dict[str, float]:
    """Areas of three rows of bores such that the openings at 50, 75 and 100 % are ``low``, ``high`` and 1; none below 0."""
    first = low / bore((0.5 - band) / (1.0 - band))
    second = max(high - first * bore((0.75 - band) / (1.0 - band)), 0.0)
    third = max(1.0 - first - second, 0.0)
    return {f"row_one_{side}": first, f"row_two_{side}": second, f"row_three_{side}": third}


def _hydraulics(m: Made) -> dict[str, float]:
    """Oil at its temperature, valve, hoses, cooler and gaps.

    Slotte 1881: μ = μ₄₀ ((40 + c)/(T + c))ⁿ, through VG46 at 40 and 75 °C with c = 50, n = 4.16 (T in °C). Rubber: its
    modulus falls by 1.2 % a kelvin (E).
    """
    flow, gap = m["flow_left"], 2 * math.pi * 0.08 * m["piston_gap"]
    narrow = m["cooler_bore"] ** -4
    return vehicle.valve(m) | {
        "viscosity": 0.0398 * (90.0 / (m["temperature"] + 50.0)) ** 4.16,
        "bulk_modulus": m["bulk_at_20"] - 8e6 * (m["temperature"] - 20.0),
        "wall_modulus": m["hose_rubber"] * math.exp(-0.012 * (m["temperature"] - 20.0)),
        "line_reynolds": 2.0 * OIL_DENSITY / (math.pi * BORE),
        "cooler_laminar": narrow * COOLER_LAMINAR / (0.05 * flow),
        "cooler_ends": narrow * COOLER_ENDS / flow**2,
        "gap_resistance": 12.0 * PISTON_LENGTH / (gap * m["piston_gap"] ** 2),
        "gap_entrance": 1.5 * 0.5 * OIL_DENSITY / gap**2,
        "land_conductance": LAND_AROUND * m["port_gap"] ** 3 / (12.0 * LAND_LENGTH),
        "flow_force": 0.12 * math.sqrt(BAR) / flow,
        "curve_foot": CURVE_FOOT,
        **_rows(min(m["band_left"], 0.45), m["half_left"], m["most_left"], "left"),
        **_rows(min(m["band_right"], 0.45), m["half_right"], m["most_right"], "right"),
    }


def _command(m: Made) -> dict[str, float]:
    """No pure delay: the control unit's filter is all."""
    return {"command_delay": 0.0}


def _tires(m: Made) -> dict[str, float]:
    """Tires and ground by the mobility number B = CI b d/F (1 + 5 δ/h)/(1 + 3 b/d) (Brixius 1987), δ/h = 0.2."""
    diameter = 2 * m["tire_radius"]
    number = m["cone_index"] * TIRE_WIDTH * diameter / m["load_mean"] * 2.0 / (1.0 + 3.0 * TIRE_WIDTH / diameter)
    return {
        "mobility": number,
        "rolling": 0.012 + 1.0 / number,
        "grip": m["ground_friction"] * (1.0 - math.exp(-0.1 * number)),
        "bore_arm": 8 / 15 * m["disc_radius"],
        "stiffness_along": 4.3e5 * math.sqrt(m["sidewall"]),
        "stiffness_across": 2.4e5 * m["sidewall"],
    }


DERIVED = {"vehicle": _vehicle, "hydraulics": _hydraulics, "command": _command, "tires": _tires}
"""What follows from the constants, by part."""


def angle_delay(m: Made) -> float:
    """Mean delay [s] of the joint angle: its mean wait."""
    return m["queue_time"]


def angle_lag(m: Made) -> float:
    """Lag [s] of the angle's filter: two equal lags, critically damped."""
    return 2 * m["damper_lag"]


def span(m: Made) -> float:
    """Measured range of the joint over the true one: levers of unequal length."""
    return m["angle_gain"] * math.asin((1.0 + m["linkage"]) * math.sin(m["stop_angle"])) / m["stop_angle"]


def chain_lag(m: Made) -> float:
    """Mean lag [s] of all channels: a line between two samples waits for the second."""
    return m["resample_period"]


def command_delay(m: Made) -> float:
    """Mean delay [s] of the command: an exponential filter in cycles, 1/(e^(T/τ) − 1) of them, and half a cycle's hold."""
    cycle = m["filter_cycle"]
    return cycle / math.expm1(cycle / m["filter_lag"]) + 0.5 * cycle


def pump_response(m: Made) -> float:
    """Time [s] to 63 % of the stroke: the lag upwards."""
    return m["stroke_time"]


def pump_limit(m: Made) -> float:
    """Highest pressure [Pa] of the supply: the end of the power line."""
    return m["power_end"]


def spool_lag(m: Made) -> float:
    """Mean lag [s] of small motions of the spool: solenoid, position and speed control."""
    return m["coil_lag"] + m["spool_lag"]


def spool_rate(m: Made) -> float:
    """Stroke [1/s] at full error."""
    return m["spool_rate"]


def regulated_flow(m: Made) -> float:
    """Flow [m³/s] at 75 % of the signal to the left with the compensator at its regulated drop."""
    place = min(CURVE_FOOT + m["curve_scale"] * (0.75 - CURVE_FOOT), 1.05)
    band = min(m["band_left"], 0.45)
    rows = [m[f"row_{one}_left"] for one in ("one", "two", "three")]
    third = 4.0 * (place - 0.5)
    area = rows[0] * bore((place - band) / (1.0 - band)) + rows[1] * bore(third) + rows[2] * bore(third - 1.0)
    return m["edge_left"] * area * math.sqrt(m["edge_drop"])


def hysteresis(m: Made) -> float:
    """Width of the loop, share of the full signal."""
    return 2 * m["bouc_width"]


def open_passage(m: Made) -> float:
    """Conductance [m³/(s √Pa)] of the compensator where its spring lets it rest."""
    return m["compensator_passage"] * min(m["spring_travel"], 1.0)


def back_pressure(m: Made, flow: float) -> float:
    """Pressure [Pa] behind the return edge: of a cooler."""
    return m["tank_pressure"] + m["cooler_laminar"] * m["viscosity"] * flow + m["cooler_ends"] * flow**2


def bulk_modulus(m: Made, pressure: float) -> float:
    """Bulk modulus [Pa] of the liquid: a straight line over pressure."""
    return m["bulk_modulus"] + GROWTH * pressure


def gas(m: Made, volume: float) -> float:
    """Free gas [m³] in a side of a ``volume`` at atmospheric pressure."""
    return m["air_share"] * (volume + m["hose_volume"])


def hose(m: Made, pressure: float) -> float:
    """Compliance [m³/Pa] of a side's hose at the oil's temperature."""
    return m["hose_volume"] / m["wall_modulus"]


def piston_leakage(m: Made, drop: float) -> float:
    """Leakage [m³/s] past both pistons: an annular gap and its entrance."""
    linear, quadratic = m["gap_resistance"] * m["viscosity"], m["gap_entrance"]
    return 2 * drop / (linear + math.sqrt(linear**2 + 4 * quadratic * drop))


def port_leakage(m: Made, drop: float) -> float:
    """Leakage [m³/s] between the ports: along worn lands."""
    return m["land_conductance"] / m["viscosity"] * drop


def breakaway(m: Made) -> float:
    """Breakaway force [N] of a cylinder without pressure: Dahl's limit at rest."""
    return m["seal_force"]


def drag(m: Made) -> float:
    """Torque [N m] of brake and motor against a wheel at 1 rad/s."""
    return 0.9 * m["brake_torque"]


def scrub(m: Made, angle: float) -> float:
    """Torque [N m] that swivels a standing wheel by an ``angle``: dq/dψ = k (1 − (q/6)⁴), a disc of bristles."""
    most = m["bore_arm"] * m["grip"] * m["load_mean"]
    rate, twist, step = m["twist_stiffness"] / (1.875 * most), 0.0, angle / 200
    for _ in range(200):
        middle = twist + 0.5 * step * rate * (1.0 - (twist / 6.0) ** 4)
        twist += step * rate * (1.0 - (middle / 6.0) ** 4)
    u = 2.0 / (math.sqrt(twist**2 + 4.0) + twist)
    return most * 7.5 * (0.25 * twist * u**4 + (1.0 - u**3) / 3.0 - (1.0 - u**5) / 5.0)
