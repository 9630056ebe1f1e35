"""fir: constants, what follows from them, and how each effect comes about on it."""

import math

from aoro_gym.diagnosis_benchmark.independent.constants import Constant
from aoro_gym.units import BAR, LITRE_PER_MINUTE

from . import vehicle
from .vehicle import VEHICLE, Made, around

TABLE: dict[str, Constant] = {
    **VEHICLE,
    **vehicle.hydraulic_table(0.06),
    "flow_left": around("m³/s", 79.0 * LITRE_PER_MINUTE, 0.02, "P: measured, with the losses of long lines"),
    "flow_right": around("m³/s", 72.5 * LITRE_PER_MINUTE, 0.02, "P: measured, with the losses of long lines"),
    "mass_front_empty": around("kg", 5150.0, 0.05, "E: crane on a heavier front"),
    "mass_rear_empty": around("kg", 4850.0, 0.05, "E: the rest of 10 t"),
    "sense_lag": around("s", 0.005, 0.3, "E"),
    "regulator_lead": around("s", 0.018, 0.15, "E"),
    "cut_off": around("Pa", 185 * BAR, 0.03, "E: of the sensed pressure"),
    "relief_pressure": around("Pa", 225 * BAR, 0.03, "E: main-line relief above the cut-off"),
    "control_lag": around("s", 0.006, 0.3, "E: controller behind its damping orifice"),
    "check_pressure": around("Pa", 2.2 * BAR, 0.25, "1D, R: spring of a return check"),
    "check_slope": around("Pa s/m³", 6e8, 0.2, "E: 0.7 bar at nominal flow"),
    "tank_loss": around("Pa s²/m⁶", 4e10, 0.3, "E: cooler and pipes"),
    "bulk_at_20": around("Pa", 1.35e9, 0.07, "1D"),
    "pocket_volume": around("m³", 8e-6, 0.4, "E: unvented corners of two cylinders", 0.12),
    "saturation_pressure": around("Pa", 60 * BAR, 0.2, "S17: dissolution by 30–100 bar"),
    "dissolving_time": around("s", 0.4, 0.3, "E: Zhou et al. 2013, slower out of a pocket"),
    "hose_modulus": around("Pa", 1.05e9, 0.12, "P: static below dynamic"),
    "line_inertance": around("kg/m⁴", 1.0e7, 0.15, "D: ρ l/A, two hoses of 3 m"),
    "line_loss": around("Pa s²/m⁶", 6e10, 0.3, "E: fittings"),
    "piston_leakage": around("m³/(s √Pa)", 2.5e-9, 0.4, "E: 0.15 bar", 0.05),
    "port_leakage": around("m³/s/Pa^0.75", 4e-11, 0.4, "E: seats of shock valves"),
    "seal_force": around("N", 260.0, 0.3, "S15, E", 0.10),
    "seal_ratio": around("", 1.25, 0.08, "S14"),
    "stribeck_speed": around("m/s", 0.02, 0.3, "S14"),
    "seal_viscosity": around("m", 1.5e4, 0.3, "S16"),
    "hinge_torque": around("N m", 280.0, 0.3, "E", 0.06),
    "joint_play": around("rad", 4e-4, 0.3, "E"),
    "joint_stiffness": around("N m/rad", 6e6, 0.25, "E: 2–20e6"),
    "joint_damping": around("N m s/rad", 3e3, 0.3, "E"),
    "droop": around("", 0.02, 0.3, "E"),
    "pilot_lag": around("s", 0.005, 0.2, "E: pressure-reducing pilot valve"),
    "spool_lag": around("s", 0.008, 0.2, "1D"),
    "spool_rate": around("1/s", 11.0, 0.15, "E"),
    "spool_friction": around("", 0.012, 0.35, "E: 2.4 % hysteresis"),
    "bus_cycle": around("s", 0.010, 0.02, "E: command once a cycle"),
    "bus_delay": around("s", 0.006, 0.3, "E"),
    "compensator_lag": around("s", 0.016, 0.3, "S16"),
    "bypass": around("", 0.03, 0.4, "E: leakage past the compensator's land"),
    "band_left": around("", 0.135, 0.05, "P: 0.27 V"),
    "band_right": around("", 0.175, 0.05, "P: 0.35 V"),
    "bore_left": around("", 4.95, 0.08, "D: through the measured flows"),
    "bore_right": around("", 2.15, 0.08, "D: through the measured flows"),
    "brake_torque": around("N m", 230.0, 0.2, "D: 8 bar on the motors less viscous losses", 0.05),
    "motor_viscosity": around("N m s", 90.0, 0.3, "E: Schlösser", 0.05),
    "cone_number": around("", 140.0, 0.25, "E: hard ground; mobility number C I b d/W", 0.12),
    "ground_friction": around("", 0.62, 0.1, "E: asphalt and gravel", 0.03),
    "inflation": around("", 1.0, 0.06, "E: share of 2 bar", 0.02),
    "shear": around("", 1.0, 0.15, "S14"),
    "relaxation_length": around("m", 0.35, 0.25, "E"),
    "twist_stiffness": around("N m/rad", 1.7e4, 0.2, "E: 8–40e3"),
    "tire_damping": around("N s/m", 3e3, 0.3, "E"),
    "sample_hold": around("s", 0.003, 0.2, "E: of the angle's own converter"),
    "angle_lag": around("s", 0.004, 0.3, "E: analogue filter"),
    "loading": Constant("", -0.003, 0.0, 0.003, "E: of a potentiometer by its load"),
    "chain_delay": around("s", 0.002, 0.3, "E: bus of the logger"),
    "angle_noise": around("rad", 5e-4, 0.2, "P"),
    "angle_step": around("rad", 2 * math.pi / 16384, 0.0, "S34: 14 bit"),
    "pressure_noise": around("Pa", 0.35 * BAR, 0.3, "E"),
}
"""Constants of a healthy fir."""

REALISED = {
    "sensor_delay": {"sample_hold": 1.0},
    "sensor_filter": {"angle_lag": 1.0},
    "measuring_chain": {"chain_delay": 1.0},
    "engine_droop": {"droop": 1.0},
    "pump_response": {"control_lag": 1.0},
    "pump_limit": {"relief_pressure": 1.0},
    "command_delay": {"bus_cycle": 1.0},
    "spool_lag": {"pilot_lag": 1.0},
    "spool_rate": {"spool_rate": 1.0},
    "dead_band": {"band_left": 1.0, "band_right": 1.0},
    "valve_gain": {"edge_drop": 1.0},
    "valve_hysteresis": {"spool_friction": 1.0},
    "compensator_lag": {"compensator_lag": 1.0},
    "compensator_opening": {"bypass": 1.0},
    "back_pressure": {"check_pressure": 1.0},
    "oil_bulk_modulus": {"bulk_at_20": 1.0},
    "entrained_air": {"pocket_volume": 1.0},
    "hose_compliance": {"hose_modulus": -1.0},
    "cylinder_leakage": {"piston_leakage": 1.0},
    "cross_port_leakage": {"port_leakage": 1.0},
    "seal_friction": {"seal_force": 1.0},
    "joint_friction": {"hinge_torque": 1.0},
    "joint_backlash": {"joint_play": 1.0},
    "frame_compliance": {"joint_stiffness": -1.0},
    "driveline_resistance": {"motor_viscosity": 1.0},
    "tire_relaxation": {"relaxation_length": 1.0, "shear": -0.5},
    "tire_stiffness": {"inflation": 1.0},
    "tire_scrub": {"ground_friction": 1.0},
    "soft_ground": {"cone_number": -1.0},
}
"""Constants that an effect scales, and by which power; the sensor's gain, temperature, payload and slope are shifted."""


def _vehicle(m: Made) -> dict[str, float]:
    """Payload on the rear frame, a slope along."""
    return vehicle.loaded(m, "rear", 1.1) | vehicle.slope(m, 1.0, 0.0)


def _hydraulics(m: Made) -> dict[str, float]:
    """Oil at its temperature and valve. Vogel: ln μ = a + b/(T − c), through VG46 at 40 and 75 °C."""
    return vehicle.valve(m) | {
        "viscosity": 5.251e-5 * math.exp(891.45 / (vehicle.kelvin(m["temperature"]) - 178.7)),
        "bulk_modulus": m["bulk_at_20"] * math.exp(-0.0055 * (m["temperature"] - 20.0)),
    }


def _command(m: Made) -> dict[str, float]:
    """Pure delay of the command; the bus holds it besides."""
    return {"command_delay": m["bus_delay"]}


def _tires(m: Made) -> dict[str, float]:
    """Tires by their inflation, on ground by its cone number."""
    soil = 1.2 / m["cone_number"]
    stiff = m["shear"] * m["inflation"] ** 0.6
    return {
        "rolling": 0.012 + soil,
        "rut_drag": 0.5 * soil,
        "grip_sliding": m["ground_friction"],
        "scrub_moment": 2 / 3 * 0.175 / math.sqrt(m["inflation"]),
        "stiffness_along": 3.7e5 * stiff,
        "stiffness_across": 1.9e5 * stiff,
    }


DERIVED = {"vehicle": _vehicle, "hydraulics": _hydraulics, "command": _command, "tires": _tires}
"""What follows from the constants, by part."""


def angle_delay(m: Made) -> float:
    """Mean delay [s] of the joint angle: half of what its converter holds a sample."""
    return 0.5 * m["sample_hold"]


def angle_lag(m: Made) -> float:
    """Lag [s] of the angle's filter: Butterworth of second order, √2/ω."""
    return m["angle_lag"]


def span(m: Made) -> float:
    """Measured range of the joint over the true one: a potentiometer whose load bends and scales its curve."""
    return m["angle_gain"] * (1.0 + m["loading"])


def chain_lag(m: Made) -> float:
    """Mean lag [s] of all channels: pure."""
    return m["chain_delay"]


def command_delay(m: Made) -> float:
    """Mean delay [s] of the command: pure, and half a cycle of the bus that holds it."""
    return m["bus_delay"] + 0.5 * m["bus_cycle"]


def pump_response(m: Made) -> float:
    """Time [s] until the pump has made 63 % of its stroke: its rate behind a late controller."""
    return 0.63 * m["stroke_time"] + m["control_lag"]


def pump_limit(m: Made) -> float:
    """Highest pressure [Pa] of the supply: of the cut-off, or of a main-line relief that opens before."""
    return min(m["relief_pressure"], m["cut_off"] + m["margin"])


def spool_lag(m: Made) -> float:
    """Mean lag [s] of small motions of the spool: pilot and spool."""
    return m["pilot_lag"] + m["spool_lag"]


def spool_rate(m: Made) -> float:
    """Fastest stroke [1/s]."""
    return m["spool_rate"]


def regulated_flow(m: Made) -> float:
    """Flow [m³/s] at 75 % of the signal to the left with the compensator at rest."""
    area = ((0.75 - m["band_left"]) / (1 - m["band_left"])) ** 5
    share = math.sqrt((1 + m["bore_left"]) * area / (1 + m["bore_left"] * area))
    return m["edge_left"] * share * math.sqrt(m["edge_drop"])


def hysteresis(m: Made) -> float:
    """Width of the loop, share of the full signal."""
    return 2 * m["spool_friction"]


def open_passage(m: Made) -> float:
    """Conductance [m³/(s √Pa)] of the compensator at rest, with its bypass."""
    return m["compensator_passage"] * (1 + m["bypass"])


def back_pressure(m: Made, flow: float) -> float:
    """Pressure [Pa] behind the return edge: of a check valve's spring and slope, and pipes."""
    return m["tank_pressure"] + m["check_pressure"] + m["check_slope"] * flow + m["tank_loss"] * flow**2


def bulk_modulus(m: Made, pressure: float) -> float:
    """Bulk modulus [Pa] of the liquid."""
    return m["bulk_modulus"] + 10.0 * pressure


def gas(m: Made, volume: float) -> float:
    """Free gas [m³] in a side at atmospheric pressure: its pocket."""
    return m["pocket_volume"]


def hose(m: Made, pressure: float) -> float:
    """Compliance [m³/Pa] of a side's hose."""
    return m["hose_volume"] / (m["hose_modulus"] * (1 + pressure / (400 * BAR)))


def piston_leakage(m: Made, drop: float) -> float:
    """Leakage [m³/s] past both pistons: turbulent."""
    return m["piston_leakage"] * drop / (drop**2 + 0.25 * BAR**2) ** 0.25 + 4e-13 * drop


def port_leakage(m: Made, drop: float) -> float:
    """Leakage [m³/s] between the ports: past worn seats, Δp^0.75."""
    return m["port_leakage"] * drop / (drop**2 + BAR**2) ** 0.125


def breakaway(m: Made) -> float:
    """Breakaway force [N] of a cylinder without pressure: all elements at their limits."""
    return m["seal_force"]


def drag(m: Made) -> float:
    """Torque [N m] of brake and motor against a wheel at 1 rad/s."""
    return m["brake_torque"] + m["motor_viscosity"]


def scrub(m: Made, angle: float) -> float:
    """Torque [N m] that swivels a standing wheel by an ``angle``: magic formula of the bounded twist."""
    limit = m["scrub_moment"] * m["grip_sliding"] * m["load_mean"]
    bound = 3.5 * limit / m["twist_stiffness"]
    twist = bound * (1.0 - math.exp(-angle / bound))
    return limit * math.sin(1.3 * math.atan(m["twist_stiffness"] * twist / (1.3 * limit)))
