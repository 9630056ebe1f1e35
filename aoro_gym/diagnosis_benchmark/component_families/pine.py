"""pine: constants of a machine with flow sharing and long pipes, what follows from them, and how each effect comes about."""

import math

from aoro_gym.diagnosis_benchmark.independent.constants import Constant
from aoro_gym.units import BAR, LITRE_PER_MINUTE

from . import vehicle
from .vehicle import VEHICLE, Made, around

UNUSED = {"edge_drop", "line_resistance"}
"""Constants of the steering circuit that follow from others here."""
TABLE: dict[str, Constant] = {
    **VEHICLE,
    **{name: one for name, one in vehicle.hydraulic_table(0.05).items() if name not in UNUSED},
    "flow_left": around("m³/s", 77.6 * LITRE_PER_MINUTE, 0.02, "P: measured, at the regulated drop"),
    "flow_right": around("m³/s", 71.0 * LITRE_PER_MINUTE, 0.02, "P: measured, at the regulated drop"),
    "mass_front_empty": around("kg", 4950.0, 0.05, "E: tanks in front"),
    "mass_rear_empty": around("kg", 5050.0, 0.05, "E: the rest of 10 t"),
    "inertia_front": around("kg m²", 3100.0, 0.12, "E: parameters.md A, with two corners"),
    "inertia_rear": around("kg m²", 3550.0, 0.12, "E: parameters.md A, with two corners"),
    "wheel_inertia": around("kg m²", 48.0, 0.2, "E"),
    "slope_angle": vehicle.zero("rad", 0.003, "P: flat ground", 0.0025),
    "hose_volume": around("m³", 0.9e-3, 0.10, "D: 6 m of steel pipe, bore 13.8 mm"),
    "pipe_length": around("m", 6.0, 0.08, "E: valve in the rear frame's far end"),
    "pipe_bore": around("m", 0.0138, 0.02, "R: 18 × 2 mm"),
    "flexible": around("Pa", 0.9e9, 0.12, "P: static modulus of the hoses at both ends"),
    "margin": around("Pa", 20.5 * BAR, 0.05, "R", 0.008),
    "drop_spring": around("Pa", 12 * BAR, 0.05, "E: of the compensator behind the edge"),
    "compensator_drop": around("Pa", 4.4 * BAR, 0.12, "E: its open port at nominal flow"),
    "compensator_port": around("", 1.0, 0.0, "E: diameter of that port"),
    "stroke_time": around("s", 0.06, 0.15, "R: full stroke at 100 bar, 50–300 ms"),
    "regulator_lead": around("s", 0.010, 0.15, "E: damping orifices"),
    "sense_lag": around("s", 0.006, 0.3, "E: of the orifice at 10 bar"),
    "sense_limit": around("Pa", 178 * BAR, 0.03, "E: relief of the load-sensing line"),
    "cock_angle": around("", 17.0, 0.15, "E: degrees by which a cock in the return is closed", 0.02),
    "bulk_at_20": around("Pa", 1.58e9, 0.07, "S27"),
    "bubble_share": around("", 0.006, 0.35, "S17: 0.5–1 %", 0.14),
    "ring_gap": around("m", 3.0e-5, 0.12, "1D: 5e-13 m³/(s Pa) at 40 mPa s", 0.025),
    "crack_width": around("m", 3.6e-4, 0.12, "E: 0.4 L/min at 100 bar", 0.02),
    "seal_force": around("N", 330.0, 0.3, "S14, E", 0.14),
    "seal_ratio": around("", 1.5, 0.08, "S14"),
    "stribeck_speed": around("m/s", 0.016, 0.3, "S14"),
    "seal_viscosity": around("m", 1.2e4, 0.3, "S16"),
    "hinge_torque": around("N m", 160.0, 0.3, "E: roller bearing, grease", 0.09),
    "joint_play": around("rad", 3e-4, 0.3, "E"),
    "joint_stiffness": around("N m/rad", 6e6, 0.25, "E: 2–20e6"),
    "joint_damping": around("N m s/rad", 3e3, 0.3, "E"),
    "droop": around("", 0.025, 0.3, "E", 0.04),
    "pilot_lag": around("s", 0.006, 0.2, "E: pilot of the position control"),
    "spool_lag": around("s", 0.010, 0.2, "R"),
    "spool_rate": around("1/s", 11.0, 0.15, "E: by the pilot's flow"),
    "slip_width": around("", 0.012, 0.35, "E: 2.4 % hysteresis", 0.05),
    "transducer_scale": around("", 1.0, 0.0, "P: as measured"),
    "third_lag": around("s", 0.007, 0.25, "E: Butterworth filter of the command"),
    "third_delay": around("s", 0.004, 0.3, "E"),
    "compensator_lag": around("s", 0.012, 0.3, "S16"),
    "band_left": around("", 0.118, 0.05, "P: opens between 0.23 and 0.30 V, flat at first"),
    "band_right": around("", 0.158, 0.05, "P: opens above 0.30 V, flat at first"),
    "half_left": around("", 0.250, 0.04, "P"),
    "half_right": around("", 0.165, 0.04, "P"),
    "most_left": around("", 0.745, 0.02, "P"),
    "most_right": around("", 0.635, 0.02, "P"),
    "brake_torque": around("N m", 255.0, 0.2, "D: 8 bar on the motors less their own friction", 0.05),
    "motor_rub": around("", 0.06, 0.3, "R: mechanical losses of a radial piston motor over its torque"),
    "soil_stiffness": around("Pa", 7e9, 0.3, "E: hard ground in Reece's law; soil has some MPa", 0.15),
    "ground_friction": around("", 0.66, 0.1, "E", 0.04),
    "turf_stiffness": around("N m/rad", 7.5e3, 0.18, "E: 8–40e3 of the tire, in series with turf", 0.04),
    "patch_radius": around("m", 0.25, 0.06, "D: 24.5 kN on 1.25e5 Pa"),
    "stiff_along": around("N/m", 4.3e5, 0.15, "S14", 0.02),
    "stiff_across": around("N/m", 2.4e5, 0.15, "S14", 0.02),
    "relaxation_length": around("m", 0.22, 0.25, "E"),
    "tire_damping": around("N s/m", 2.1e3, 0.3, "E"),
    "twin_delay": around("s", 0.003, 0.3, "E: half of how late the second sensor is"),
    "angle_cube": around("s", 0.0013, 0.3, "E: each of three equal lags"),
    "slide_error": Constant("", -0.012, 0.0, 0.012, "E: share of the tangent that is not straightened", 0.0015),
    "raised_window": around("s", 0.005, 0.2, "E: raised cosine of the logger"),
    "angle_noise": around("rad", 3e-4, 0.2, "P"),
    "angle_step": around("rad", 2 * math.pi / 65536, 0.0, "E: 16 bit"),
    "pressure_noise": around("Pa", 0.3 * BAR, 0.3, "E"),
}
"""Constants of a healthy pine."""

REALISED = {
    "sensor_delay": {"twin_delay": 1.0},
    "sensor_filter": {"angle_cube": 1.0},
    "measuring_chain": {"raised_window": 1.0},
    "engine_droop": {"droop": 1.0},
    "pump_response": {"stroke_time": 1.0},
    "pump_limit": {"sense_limit": 1.0},
    "command_delay": {"third_lag": 1.0},
    "spool_lag": {"spool_lag": 1.0},
    "spool_rate": {"spool_rate": 1.0},
    "dead_band": {"band_left": 1.0, "band_right": 1.0},
    "valve_gain": {"transducer_scale": -1.0},
    "valve_hysteresis": {"slip_width": 1.0},
    "compensator_lag": {"compensator_lag": 1.0},
    "compensator_opening": {"compensator_port": 1.0},
    "back_pressure": {"cock_angle": 1.0},
    "oil_bulk_modulus": {"bulk_at_20": 1.0},
    "entrained_air": {"bubble_share": 1.0},
    "hose_compliance": {"flexible": -1.0},
    "cylinder_leakage": {"ring_gap": 1.0},
    "cross_port_leakage": {"crack_width": 1.0},
    "seal_friction": {"seal_force": 1.0},
    "joint_friction": {"hinge_torque": 1.0},
    "joint_backlash": {"joint_play": 1.0},
    "frame_compliance": {"joint_stiffness": -1.0},
    "driveline_resistance": {"brake_torque": 1.0},
    "tire_relaxation": {"relaxation_length": 1.0},
    "tire_stiffness": {"stiff_across": 1.0, "stiff_along": 0.7},
    "tire_scrub": {"turf_stiffness": 1.0},
    "soft_ground": {"soil_stiffness": -1.0},
}
"""Constants that an effect scales, and by which power; the sensor's gain, temperature, payload and slope are shifted."""

OIL_DENSITY = 872.0
STEEL = 2.06e11
"""Young's modulus [Pa] of steel."""
REGULATED = 8.5 * BAR
"""Drop [Pa] over a metering edge at which its nominal flow is given."""
RING_LENGTH = 0.006
"""Length [m] of a piston ring's gap."""
WALL = 0.002
"""Thickness [m] of the pipes' walls."""
ROUGHNESS = 3e-5
"""Of the pipes [m]."""
FLEXIBLE = 0.2
"""Share of a line's volume in hoses."""
RETURN_BORE = 0.019
LOG_LENGTH = 4.0
"""Of the payload [m]."""


def _vehicle(m: Made) -> dict[str, float]:
    """Payload of logs over the rear axle; a slope down forwards and a little to the right."""
    return vehicle.loaded(m, "rear", 1.8, LOG_LENGTH**2 / 12) | vehicle.slope(m, 0.96, -0.28)


def _hydraulics(m: Made) -> dict[str, float]:
    """Oil at its temperature, valve, pipes, cracks.

    Mauro, Yue, Ellison, Gupta, Allan 2009: lg μ = A + K/T exp(C/T), A = −4, through VG46 at 40 and 75 °C.
    """
    kelvin = vehicle.kelvin(m["temperature"])
    drop = m["margin"] - m["drop_spring"]
    bore, length = m["pipe_bore"], m["pipe_length"]
    area, back = math.pi / 4 * bore**2, math.pi / 4 * RETURN_BORE**2
    gap = 2 * math.pi * 0.08 * m["ring_gap"]
    laminar = gap * m["ring_gap"] ** 2 / (12.0 * RING_LENGTH)
    hydraulic = 2 * m["ring_gap"]
    turbulent = gap * (2 * hydraulic**1.25 / (0.316 * RING_LENGTH * OIL_DENSITY**0.75)) ** (4 / 7)
    return vehicle.valve({**m, "edge_drop": drop}) | {
        "edge_drop": drop,
        "edge_left": m["edge_scale"] * m["flow_left"] / math.sqrt(REGULATED),
        "edge_right": m["edge_scale"] * m["flow_right"] / math.sqrt(REGULATED),
        "compensator_passage": m["compensator_port"] ** 2 * m["flow_left"] / math.sqrt(m["compensator_drop"]),
        "viscosity": 10 ** (-4.0 + 177.39 / kelvin * math.exp(477.15 / kelvin)),
        "bulk_modulus": m["bulk_at_20"] - 8.5e6 * (m["temperature"] - 20.0),
        "wall_softness": (1 - FLEXIBLE) * bore / (STEEL * WALL) + FLEXIBLE / m["flexible"],
        "pipe_inertance": OIL_DENSITY * length / area,
        "pipe_resistance": 128.0 * length / (math.pi * bore**4),
        "pipe_reynolds": 4.0 * OIL_DENSITY / (math.pi * bore),
        "pipe_roughness": ROUGHNESS / (3.7 * bore),
        "sense_orifice": 9e-14 * math.sqrt(10 * BAR) / m["sense_lag"],
        "cock_loss": 0.1 * math.exp(0.13 * m["cock_angle"]) * 0.5 * OIL_DENSITY / back**2,
        "return_pipe": 128.0 * 2.0 / (math.pi * RETURN_BORE**4),
        "ring_laminar": laminar,
        "ring_turbulent": turbulent,
        "speed_square": 2.0 / OIL_DENSITY,
        "crack_area": math.pi / 4 * m["crack_width"] ** 2,
        "crack_density": OIL_DENSITY * m["crack_width"],
    }


def _command(m: Made) -> dict[str, float]:
    """Pure delay of the command; a filter of third order comes besides."""
    return {"command_delay": m["third_delay"]}


def _tires(m: Made) -> dict[str, float]:
    """Tires and ground.

    Reece 1965: p = (c k_c + γ b k_φ) z/b, here with its factor k as one; sinkage of a rigid wheel (1.5 F/(k √d))^⅔, work
    k z²/2 a metre over the load (Bekker 1956, exponent 1).
    """
    stiffness = m["soil_stiffness"]
    sinkage = (1.5 * m["load_mean"] / (stiffness * math.sqrt(2 * m["tire_radius"]))) ** (2 / 3)
    return {
        "rolling": 0.011 + 0.5 * stiffness * sinkage**2 / m["load_mean"],
        "grip": m["ground_friction"],
        "swivel_moment": 2 / 3 * m["ground_friction"] * m["patch_radius"] * m["load_mean"],
        "twist_stiffness": m["turf_stiffness"],
        "stiffness_along": m["stiff_along"],
        "stiffness_across": m["stiff_across"],
    }


DERIVED = {"vehicle": _vehicle, "hydraulics": _hydraulics, "command": _command, "tires": _tires}
"""What follows from the constants, by part."""


def angle_delay(m: Made) -> float:
    """Mean delay [s] of the joint angle: of the mean of a prompt and a late sensor."""
    return m["twin_delay"]


def angle_lag(m: Made) -> float:
    """Lag [s] of the angle's filter: three equal ones."""
    return 3 * m["angle_cube"]


def span(m: Made) -> float:
    """Measured range of the joint over the true one: a tangent that is not all straightened."""
    stop = m["stop_angle"]
    return m["angle_gain"] * (1.0 + m["slide_error"] * (math.tan(stop) / stop - 1.0))


def chain_lag(m: Made) -> float:
    """Mean lag [s] of all channels: half a raised cosine."""
    return 0.5 * m["raised_window"]


def command_delay(m: Made) -> float:
    """Mean delay [s] of the command: pure, and of a Butterworth filter of third order."""
    return m["third_delay"] + m["third_lag"]


def pump_response(m: Made) -> float:
    """Time [s] until the pump has made 63 % of its stroke at 100 bar with its regulator wide open."""
    return 0.63 * m["stroke_time"]


def pump_limit(m: Made) -> float:
    """Highest pressure [Pa] of the supply: of the load-sensing line's relief and the margin."""
    return m["sense_limit"] + m["margin"]


def spool_lag(m: Made) -> float:
    """Mean lag [s] of small motions of the spool: pilot and spool."""
    return m["pilot_lag"] + m["spool_lag"]


def spool_rate(m: Made) -> float:
    """Stroke [1/s] at full error: 1/(τ + 1/r)."""
    return 1.0 / (m["spool_lag"] + 1.0 / m["spool_rate"])


def rational(t: float, y0: float, y1: float, slope: float, s0: float, s1: float) -> float:
    """Rational quadratic on [0, 1] between two points.

    Args:
        t: Place, 0 to 1.
        y0: Value at 0.
        y1: Value at 1.
        slope: Mean slope [per unit of the spool].
        s0: Slope at 0, in the same unit.
        s1: Slope at 1, in the same unit.
    """
    u = t * (1 - t)
    return y0 + (y1 - y0) * (slope * t * t + s0 * u) / (slope + (s0 + s1 - 2 * slope) * u)


def opening(place: float, m: Made) -> float:
    """Share of the left edge that is open at a ``place`` of the spool."""
    band, low, high = min(m["band_left"], 0.45), m["half_left"], m["most_left"]
    first, second, last = low / (0.5 - band), 4 * (high - low), 4 * (1 - high)
    joint, top = math.sqrt(first * second), math.sqrt(second * last)
    s = min(max(place, band), 1.0)
    if s <= 0.5:
        return rational((s - band) / (0.5 - band), 0.0, low, first, 0.0, joint)
    if s <= 0.75:
        return rational(4 * s - 2, low, high, second, joint, top)
    return rational(4 * s - 3, high, 1.0, last, top, 0.5 * last)


def regulated_flow(m: Made) -> float:
    """Flow [m³/s] at 75 % of the signal to the left with the compensator at rest."""
    return m["edge_left"] * opening(0.75 / m["transducer_scale"], m) * math.sqrt(m["edge_drop"])


def hysteresis(m: Made) -> float:
    """Width of the loop, share of the full signal: both elements slip."""
    return 2 * m["slip_width"]


def open_passage(m: Made) -> float:
    """Conductance [m³/(s √Pa)] of the open compensator."""
    return m["compensator_passage"]


def back_pressure(m: Made, flow: float) -> float:
    """Pressure [Pa] behind the return edge: of a cock and a pipe."""
    return m["tank_pressure"] + m["cock_loss"] * flow**2 + m["return_pipe"] * m["viscosity"] * flow


def bulk_modulus(m: Made, pressure: float) -> float:
    """Bulk modulus [Pa] of the liquid by Kumari and Dass."""
    return m["bulk_modulus"] + 10.5 / 4e-9 * -math.expm1(-4e-9 * pressure)


def gas(m: Made, volume: float) -> float:
    """Free gas [m³] in a side of a ``volume`` at atmospheric pressure."""
    return m["bubble_share"] * (volume + m["hose_volume"])


def hose(m: Made, pressure: float) -> float:
    """Compliance [m³/Pa] of a side's pipe and of the hoses at its ends."""
    return m["hose_volume"] * m["wall_softness"]


def piston_leakage(m: Made, drop: float) -> float:
    """Leakage [m³/s] past both pistons: in the gap of a ring, laminar, then turbulent."""
    laminar = m["ring_laminar"] / m["viscosity"] * drop
    turbulent = m["ring_turbulent"] * m["viscosity"] ** (-1 / 7) * (drop + 1.0) ** (4 / 7)
    return laminar / math.sqrt(1.0 + (laminar / turbulent) ** 2)


def port_leakage(m: Made, drop: float) -> float:
    """Leakage [m³/s] between the ports: through a crack as a sharp orifice."""
    speed = math.sqrt(m["speed_square"] * drop)
    root = math.sqrt(speed * m["crack_density"] / m["viscosity"])
    coefficient = 1.0 + 1.07 * math.exp(-0.126 * root) - 2.07 * math.exp(-0.246 * root)
    return 0.61 * coefficient * m["crack_area"] * speed


def breakaway(m: Made) -> float:
    """Breakaway force [N] of a cylinder without a film."""
    return m["seal_force"]


def drag(m: Made) -> float:
    """Torque [N m] of brake and motor against a wheel at 1 rad/s, without pressure on the motor."""
    return m["brake_torque"] + 30.0


def scrub(m: Made, angle: float) -> float:
    """Torque [N m] that swivels a standing wheel by an ``angle``: a hyperbola."""
    elastic = m["twist_stiffness"] * angle
    return elastic / (1.0 + elastic / m["swivel_moment"])
