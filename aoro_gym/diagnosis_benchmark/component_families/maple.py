"""maple: constants of an older machine with a constant pump, what follows from them, and how each effect comes about."""

import math

from aoro_gym.diagnosis_benchmark.independent.constants import Constant
from aoro_gym.units import BAR, GRAVITY, LITRE_PER_MINUTE

from . import vehicle
from .vehicle import VEHICLE, Made, around

UNUSED = {"stroke_time"}
"""Constants of the steering circuit that a pump of one displacement does not have."""
TABLE: dict[str, Constant] = {
    **VEHICLE,
    **{name: one for name, one in vehicle.hydraulic_table(0.08).items() if name not in UNUSED},
    "flow_left": around("m³/s", 79.0 * LITRE_PER_MINUTE, 0.02, "P: measured, with the losses of lines"),
    "flow_right": around("m³/s", 72.5 * LITRE_PER_MINUTE, 0.02, "P: measured, with the losses of lines"),
    "mass_front_empty": around("kg", 4750.0, 0.05, "E: engine in the rear frame, crane slewed aside"),
    "mass_rear_empty": around("kg", 5250.0, 0.05, "E: the rest of 10 t"),
    "inertia_front": around("kg m²", 3150.0, 0.12, "E: parameters.md A, with two corners"),
    "inertia_rear": around("kg m²", 3500.0, 0.12, "E: parameters.md A, with two corners"),
    "pump_displacement": around("m³/rad", 85e-6 / (2 * math.pi), 0.02, "E: gear pump, 135 L/min at 1595 rpm"),
    "margin": around("Pa", 21 * BAR, 0.08, "E: spring of the unloading valve", 0.02),
    "sense_lag": around("s", 0.004, 0.3, "E"),
    "regulator_lead": around("s", 0.008, 0.15, "E: damping orifice of the unloading valve"),
    "unloading_lag": around("s", 0.05, 0.2, "E: spool of the unloading valve behind its orifice"),
    "unloading_band": around("Pa", 4 * BAR, 0.2, "E: rate of its spring over the stroke"),
    "unloading_drop": around("Pa", 16 * BAR, 0.1, "E: passes the full flow half open"),
    "relief_pressure": around("Pa", 190 * BAR, 0.04, "E: direct-acting main relief, 180–280 bar when all flow passes"),
    "override": around("Pa", 18 * BAR, 0.2, "R: rise to the full flow, 5–15 % of the setting"),
    "preload": around("Pa", 1.6 * BAR, 0.25, "R: back-pressure valve that feeds the anti-cavitation checks"),
    "return_slope": around("Pa s/m³", 3e8, 0.25, "E: 0.7 bar at the pump's flow"),
    "return_loss": around("Pa s²/m⁶", 1.2e11, 0.3, "E: cooler, 0.6 bar at the pump's flow"),
    "return_inertance": around("kg/m⁴", 3e6, 0.2, "D: ρ l/A, 2 m of Ø27 mm"),
    "bulk_at_20": around("Pa", 1.4e9, 0.07, "S23, S27: secant modulus without pressure"),
    "line_gas": around("m³", 7e-6, 0.4, "S17: 0.5 % of a side, in its hose", 0.18),
    "gas_time": around("s", 0.12, 0.4, "E: Pourmovahed, Otis 1990, scaled to pockets of some mL"),
    "hose_modulus": around("Pa", 0.9e9, 0.12, "P: 1.2e9 at 100 bar"),
    "line_bore": around("m", 0.0155, 0.03, "D: two hoses Ø12.7 mm as one line of their laminar loss"),
    "piston_leakage": around("m³/(s Pa)", 4e-13, 0.4, "1D", 0.06),
    "port_leakage": around("m³/(s √Pa)", 2e-9, 0.4, "E: 0.4 L/min at 100 bar", 0.05),
    "seal_force": around("N", 300.0, 0.3, "S14, E", 0.14),
    "seal_ratio": around("", 1.35, 0.08, "S14"),
    "stribeck_speed": around("m/s", 0.010, 0.3, "S14"),
    "seal_viscosity": around("N/√(N/m)", 900.0, 0.3, "S16: as 500 N s/m at 0.13 m/s"),
    "hinge_torque": around("N m", 170.0, 0.3, "E: under the weight alone", 0.10),
    "joint_play": around("rad", 6e-4, 0.3, "E: 0.2 mm at the pins"),
    "joint_stiffness": around("N m/rad", 9e6, 0.25, "E: 2–20e6"),
    "joint_damping": around("N m s/rad", 2.5e3, 0.3, "E: at 1 mrad"),
    "droop": around("", 0.035, 0.3, "E: mechanical governor, to 7 %", 0.03),
    "pilot_lag": around("s", 0.008, 0.2, "E: capacity and orifice of the pilot line"),
    "spool_lag": around("s", 0.006, 0.2, "1D"),
    "spool_rate": around("1/s", 12.0, 0.15, "E: 5–25, by the pilot's flow"),
    "spool_friction": around("", 0.014, 0.35, "E: 2.8 % hysteresis", 0.05),
    "spring_stiffness": around("", 1.0, 0.0, "P: as measured"),
    "remote_lag": around("s", 0.004, 0.3, "E: a third of the remote control's lag"),
    "remote_delay": around("s", 0.003, 0.3, "E"),
    "compensator_lag": around("s", 0.013, 0.3, "S16"),
    "compensator_spring": around("", 0.62, 0.05, "E: its spring sets where it rests"),
    "band_left": around("", 0.145, 0.03, "P: opens between 0.23 and 0.30 V"),
    "band_right": around("", 0.205, 0.05, "P: opens above 0.30 V"),
    "notch_left": around("", 2.14, 0.05, "D: through the measured flows"),
    "notch_right": around("", 2.15, 0.05, "D: through the measured flows"),
    "most_left": around("", 0.783, 0.02, "P"),
    "most_right": around("", 0.661, 0.02, "P"),
    "slot_left": around("", 0.98, 0.05, "D: to the measured flow at full signal"),
    "slot_right": around("", 1.7, 0.05, "D: to the measured flow at full signal"),
    "brake_torque": around("N m", 285.0, 0.2, "D: 8 bar on the motors", 0.06),
    "bearing": around("Pa", 6e6, 0.3, "E: hard ground as a cohesive soil of this bearing pressure", 0.15),
    "ground_friction": around("", 0.60, 0.1, "E: tangent of the angle of friction", 0.03),
    "adhesion": around("Pa", 2e4, 0.4, "E: of rubber on the ground, Mohr and Coulomb", 0.10),
    "tread_width": around("m", 0.36, 0.1, "E: of the patch, tread of 530 mm, crowned"),
    "carcass": around("", 1.0, 0.12, "E: plies carry 60 % of the stiffness, air the rest"),
    "inflation": around("", 1.0, 0.06, "E: share of 2 bar", 0.02),
    "relaxation_length": around("m", 0.32, 0.25, "E"),
    "tire_damping": around("N s/m", 2.2e3, 0.3, "E"),
    "bus_queue": around("s", 0.002, 0.4, "E: of the polled bus"),
    "poll_period": around("s", 0.002, 0.1, "E"),
    "angle_ladder": around("s", 0.0011, 0.3, "E: RC of a ladder of two"),
    "rail_error": Constant("", -0.003, 0.0, 0.003, "E: of the sensor's two supplies", 0.0004),
    "chain_lag": around("s", 0.0012, 0.3, "E: RC before the multiplexer"),
    "dwell": around("s", 2e-4, 0.2, "E: of the multiplexer on each channel"),
    "angle_noise": around("rad", 4.5e-4, 0.2, "P"),
    "angle_step": around("rad", 2 * math.pi / 4096, 0.0, "E: 12 bit"),
    "pressure_noise": around("Pa", 0.4 * BAR, 0.3, "E"),
}
"""Constants of a healthy maple."""

REALISED = {
    "sensor_delay": {"bus_queue": 1.0},
    "sensor_filter": {"angle_ladder": 1.0},
    "measuring_chain": {"chain_lag": 1.0, "dwell": 0.5},
    "engine_droop": {"droop": 1.0},
    "pump_response": {"unloading_lag": 1.0},
    "pump_limit": {"relief_pressure": 1.0},
    "command_delay": {"remote_lag": 1.0},
    "spool_lag": {"pilot_lag": 1.0},
    "spool_rate": {"spool_rate": 1.0},
    "dead_band": {"band_left": 1.0, "band_right": 1.0},
    "valve_gain": {"spring_stiffness": -1.0},
    "valve_hysteresis": {"spool_friction": 1.0},
    "compensator_lag": {"compensator_lag": 1.0},
    "compensator_opening": {"compensator_spring": 1.0},
    "back_pressure": {"preload": 1.0},
    "oil_bulk_modulus": {"bulk_at_20": 1.0},
    "entrained_air": {"line_gas": 1.0},
    "hose_compliance": {"hose_modulus": -1.0},
    "cylinder_leakage": {"piston_leakage": 1.0},
    "cross_port_leakage": {"port_leakage": 1.0},
    "seal_friction": {"seal_force": 1.0},
    "joint_friction": {"hinge_torque": 1.0},
    "joint_backlash": {"joint_play": 1.0},
    "frame_compliance": {"joint_stiffness": -1.0},
    "driveline_resistance": {"brake_torque": 1.0},
    "tire_relaxation": {"relaxation_length": 1.0},
    "tire_stiffness": {"carcass": 1.0},
    "tire_scrub": {"tread_width": 1.0},
    "soft_ground": {"bearing": -1.0},
}
"""Constants that an effect scales, and by which power; the sensor's gain, temperature, payload and slope are shifted."""

OIL_DENSITY = 865.0
CENTRE_HEIGHT = 1.05
"""Height [m] of the centre of mass over the ground."""
CRANE_REACH = 1.4
"""Distance [m] of a payload to the left of the middle line: the crane is slewed aside."""


def _vehicle(m: Made) -> dict[str, float]:
    """Payload beside the front frame, slope down to the rear and left: both shift loads, the slope by its height."""
    made = vehicle.loaded(m, "front", 1.3, 0.1 + CRANE_REACH**2) | vehicle.slope(m, -0.8, 0.6)
    shifted = made["mass_total"] * CENTRE_HEIGHT * made["slope_along"] / (4 * m["half_base"])
    tilted = made["mass_total"] * CENTRE_HEIGHT * made["slope_across"] + m["payload"] * GRAVITY * CRANE_REACH
    return made | {
        "load_front": made["load_front"] + shifted,
        "load_rear": made["load_rear"] - shifted,
        "load_tilt": tilted / (2 * m["track"]),
    }


def _hydraulics(m: Made) -> dict[str, float]:
    """Oil at its temperature, lines, unloading valve.

    Roelands 1966: lg(lg μ + 1.2) = lg G − S lg(1 + t/135), μ [mPa s], t [°C], through VG46 at 40 and 75 °C.
    """
    power = 10**0.59507 / (1.0 + m["temperature"] / 135.0) ** 1.3123
    viscosity = 1e-3 * 10 ** (power - 1.2)
    area = math.pi / 4 * m["line_bore"] ** 2
    length = m["line_resistance"] * math.pi * m["line_bore"] ** 4 / 128.0
    return vehicle.valve(m) | {
        "viscosity": viscosity,
        "bulk_modulus": m["bulk_at_20"] * (1.0 - 0.0045 * (m["temperature"] - 20.0)),
        "line_reynolds": 4.0 * OIL_DENSITY / (math.pi * m["line_bore"]),
        "line_turbulence": 0.5 * OIL_DENSITY * length / (m["line_bore"] * area**2),
        "unloading": 2.0 * m["pump_displacement"] * m["engine_speed"] / math.sqrt(m["unloading_drop"]),
    }


def _command(m: Made) -> dict[str, float]:
    """Pure delay of the command; three lags of the remote control come besides."""
    return {"command_delay": m["remote_delay"]}


def _tires(m: Made) -> dict[str, float]:
    """Carcass and air, on a patch as large as an ellipse; ground that is compacted and pushed ahead.

    Contact length L = F/(b q) of a plastic soil of bearing pressure q = 5.14 c, sinkage L²/(2 r), compaction F L/(2 r), the
    work b q z a metre; ahead of the wheel passive earth pressure, b (½ γ z² K + 2 c z √K), K = 3 for 30° (Mohr, Coulomb).
    The rear wheels sink by n^(1/3) of passes (Abebe, Tanaka, Yamazaki 1989) less deep; resistance to rolling is the mean.
    """
    width = 0.53
    contact = m["load_mean"] / (width * m["bearing"])
    sinkage = contact**2 / (2 * m["tire_radius"])
    pushed = 0.5 * 1.8e4 * sinkage**2 * 3.0 + 2 * m["bearing"] / 5.14 * sinkage * math.sqrt(3.0)
    bulldozing = width * pushed / m["load_mean"]
    soil = contact / (2 * m["tire_radius"]) + bulldozing
    stiff = 0.6 * m["carcass"] + 0.4 * m["inflation"]
    radius = math.sqrt(0.5 * m["tread_width"] * 0.15)
    across = 2.1e5 * stiff
    return {
        "rolling": 0.010 + soil,
        "rolling_front": 0.010 + soil * 2 / 2 ** (1 / 3),
        "rolling_rear": 0.010 + soil * (2 - 2 / 2 ** (1 / 3)),
        "rut_drag": 0.6 * bulldozing,
        "grip_sliding": m["ground_friction"],
        "patch_adhesion": m["adhesion"] * math.pi * radius**2,
        "scrub_adhesion": 2 * math.pi / 3 * radius**3 * m["adhesion"],
        "scrub_arm": 2 / 3 * radius,
        "stiffness_along": 3.8e5 * stiff,
        "stiffness_across": across,
        "twist_stiffness": 2.8 * across * radius**2,
    }


DERIVED = {"vehicle": _vehicle, "hydraulics": _hydraulics, "command": _command, "tires": _tires}
"""What follows from the constants, by part."""


def angle_delay(m: Made) -> float:
    """Mean delay [s] of the joint angle: half the period of the poll, and the queue behind it."""
    return m["bus_queue"] + 0.5 * m["poll_period"]


def angle_lag(m: Made) -> float:
    """Lag [s] of the angle's filter: an RC ladder of two, 1/(1 + 3 RC s + (RC s)²)."""
    return 3.0 * m["angle_ladder"]


def span(m: Made) -> float:
    """Measured range of the joint over the true one: a tapped potentiometer whose supplies have drifted."""
    return m["angle_gain"] * (1.0 + m["rail_error"])


def chain_lag(m: Made) -> float:
    """Mean lag [s] of all channels: RC, and half the multiplexer's round of seven channels less one."""
    return m["chain_lag"] + 3.0 * m["dwell"]


def command_delay(m: Made) -> float:
    """Mean delay [s] of the command: pure, and three equal lags."""
    return m["remote_delay"] + 3.0 * m["remote_lag"]


def pump_response(m: Made) -> float:
    """Time [s] until 63 % of the pump's flow are no longer let go: of the unloading valve."""
    return m["unloading_lag"]


def pump_limit(m: Made) -> float:
    """Highest pressure [Pa] of the supply: of the relief valve when the full flow passes it."""
    return m["relief_pressure"] + m["override"]


def spool_lag(m: Made) -> float:
    """Mean lag [s] of small motions of the spool: pilot and spool."""
    return m["pilot_lag"] + m["spool_lag"]


def spool_rate(m: Made) -> float:
    """Stroke [1/s] by the pilot's flow at full error: τ v + (v/r)² = 1."""
    return 2.0 / (m["pilot_lag"] + math.sqrt(m["pilot_lag"] ** 2 + 4.0 / m["spool_rate"] ** 2))


def regulated_flow(m: Made) -> float:
    """Flow [m³/s] at 75 % of the signal to the left with the compensator at rest."""
    travel = max(0.08 + 0.67 / m["spring_stiffness"] - m["band_left"], 0.0)
    end = math.sqrt(m["most_left"] / m["notch_left"])
    area = m["notch_left"] * travel**2 if travel < end else min(m["most_left"] + m["slot_left"] * (travel - end), 1.0)
    return m["edge_left"] * area * math.sqrt(m["edge_drop"])


def hysteresis(m: Made) -> float:
    """Width of the loop, share of the full signal."""
    return 2 * m["spool_friction"]


def open_passage(m: Made) -> float:
    """Conductance [m³/(s √Pa)] of the compensator at rest: a round port that its land has uncovered."""
    angle = math.acos(1 - 2 * min(m["compensator_spring"], 1.0))
    return m["compensator_passage"] * (angle - 0.5 * math.sin(2 * angle)) / math.pi


def back_pressure(m: Made, flow: float) -> float:
    """Pressure [Pa] behind the return edge: of a preloaded valve, its slope, and pipes."""
    return m["tank_pressure"] + m["preload"] + m["return_slope"] * flow + m["return_loss"] * flow**2


def bulk_modulus(m: Made, pressure: float) -> float:
    """Bulk modulus [Pa] of the liquid: tangent of a secant modulus K₀ + 5 p."""
    secant = m["bulk_modulus"] + 5.0 * pressure
    return secant * (secant - pressure) / m["bulk_modulus"]


def gas(m: Made, volume: float) -> float:
    """Free gas [m³] in a side at atmospheric pressure: in its hose."""
    return m["line_gas"]


def hose(m: Made, pressure: float) -> float:
    """Compliance [m³/Pa] of a side's hose: 70 % braid that stiffens exponentially, 30 % steel pipe."""
    braid = 0.7 / m["hose_modulus"] * math.exp(-pressure / (350 * BAR))
    return m["hose_volume"] * (braid + 0.3 / 2.6e10)


def piston_leakage(m: Made, drop: float) -> float:
    """Leakage [m³/s] past both pistons with the joint straight: laminar, most in the middle of the barrel."""
    return m["piston_leakage"] * drop * 0.04 / m["viscosity"]


def port_leakage(m: Made, drop: float) -> float:
    """Leakage [m³/s] between the ports: past cones that lift at 12 bar, and a seep."""
    lifted = max(drop - 12 * BAR, 0.0)
    return m["port_leakage"] * lifted / math.sqrt(math.sqrt(lifted**2 + 0.25 * BAR**2) + 1e-12) + 1.5e-13 * drop


def breakaway(m: Made) -> float:
    """Breakaway force [N] of a cylinder without pressure: the elastoplastic limit at rest."""
    return m["seal_force"]


def drag(m: Made) -> float:
    """Torque [N m] of brake and motor against a wheel at 1 rad/s."""
    return m["brake_torque"] / math.sqrt(1 + 0.03**2)


def scrub(m: Made, angle: float) -> float:
    """Torque [N m] that swivels a standing wheel by an ``angle``: an elastic and plastic disc."""
    most = m["scrub_adhesion"] + m["scrub_arm"] * m["grip_sliding"] * m["load_mean"]
    first = 0.75 * most / m["twist_stiffness"]
    return m["twist_stiffness"] * angle if angle < first else most * (1 - 0.25 * (first / angle) ** 3)
