"""The vehicle that all component families drive around: its constants, and what follows from them. SI units."""

import math
from collections.abc import Mapping
from functools import lru_cache

from scipy.optimize import brentq

from aoro_gym.diagnosis_benchmark.independent.constants import Constant
from aoro_gym.units import BAR, DEGREE, GRAVITY, LITRE_PER_MINUTE, RPM, ZERO_CELSIUS

Made = Mapping[str, float]

BORE_AREA = math.pi / 4 * 0.08**2
ANNULUS_AREA = math.pi / 4 * (0.08**2 - 0.04**2)
STROKE = 0.265
MOUNT_REAR, MOUNT_FRONT = 0.40, 0.28
REFERENCE_DROP = 7 * BAR
"""Drop over a metering edge at which its nominal flow is given (parameters.md C)."""
STILL = {
    "bent_stiffness": 0.0, "bent_angle": 0.0, "jam_angle": 9.0, "jam_side": 1.0, "jam_stiffness": 0.0,
    "push_torque": 0.0, "push_start": 0.0, "push_length": 0.1, "slew_torque": 0.0, "slew_start": 0.0,
    "slew_length": 0.1, "crust_loss": 0.0, "crust_start": 0.0, "other_conductance": 0.0, "other_start": 0.0,
    "other_length": 0.1, "accumulator_volume": 0.0, "accumulator_precharge": 10 * BAR, "pinch_resistance": 0.0,
    "pinch_angle": 0.0, "dead_piston": 0.0, "load_skew": 0.0, "free_axle": 0.0, "half_block": 0.0,
    "heating": 0.0, "dead_time": 0.0, "attached_left": 1.0, "attached_right": 1.0, "load_tilt": 0.0,
}  # fmt: skip
"""Constants of disturbances, all at nought, and what only some families have."""


def around(unit: str, nominal: float, spread: float, source: str, day: float = 0.0) -> Constant:
    """A constant whose range is a share on either side.

    Args:
        unit: Of the numbers.
        nominal: Middle of the range.
        spread: Share of the nominal on either side.
        source: Tag and note.
        day: Standard deviation between days, of the logarithm.
    """
    return Constant(unit, nominal * (1 - spread), nominal, nominal * (1 + spread), source, day)


def zero(unit: str, half: float, source: str, day: float = 0.0) -> Constant:
    """A constant around nought."""
    return Constant(unit, -half, 0.0, half, source, day)


VEHICLE: Mapping[str, Constant] = {
    "mass_front_empty": around("kg", 4900.0, 0.05, "E: P gives 10 t in all"),
    "mass_rear_empty": around("kg", 5100.0, 0.05, "E: P gives 10 t in all"),
    "inertia_front": around("kg m²", 3000.0, 0.12, "E: parameters.md A, with two corners"),
    "inertia_rear": around("kg m²", 3400.0, 0.12, "E: parameters.md A, with two corners"),
    "place_front": around("m", 1.54, 0.04, "E: centre of mass from the hinge"),
    "place_rear": around("m", 1.62, 0.04, "E: centre of mass from the hinge"),
    "half_base": around("m", 1.70, 0.02, "D: wheelbase 3.4 m"),
    "track": around("m", 1.97, 0.03, "E: overall width 2.5 m"),
    "tire_radius": around("m", 0.60, 0.03, "E"),
    "wheel_inertia": around("kg m²", 45.0, 0.2, "E"),
    "stop_angle": around("rad", 40 * DEGREE, 0.02, "D: of the stroke's closure"),
    "payload": zero("kg", 0.0, "P: none"),
    "slope_angle": zero("rad", 0.003, "P: flat ground", 0.002),
    "motor_displacement": around("m³/rad", 2.6e-3 / (2 * math.pi), 0.08, "A: MSE18"),
    "loop_compliance": around("m³/Pa", 7e-12, 0.2, "E: 5 L of oil in hoses"),
    "loop_leakage": around("m³/(s Pa)", 8e-12, 0.4, "E: four motors at 2e-12"),
    "loop_relief": around("Pa", 400 * BAR, 0.04, "R"),
    "charge_pressure": around("Pa", 24 * BAR, 0.08, "R", 0.02),
    "drive_displacement": around("m³/rad", 130e-6 / (2 * math.pi), 0.01, "P"),
    "drive_lag": around("s", 0.35, 0.3, "S5: stroke of the electric control"),
    "engine_speed": around("rad/s", 1595 * RPM, 0.003, "P", 0.002),
    "engine_inertia": around("kg m²", 1.4, 0.2, "E"),
    "engine_idle_torque": around("N m", 70.0, 0.15, "D"),
    "pump_efficiency": around("", 0.9, 0.03, "E"),
    "pump_displacement": around("m³/rad", 140e-6 / (2 * math.pi), 0.01, "P"),
    "rod_inertia": around("kg m²", 12.0, 0.15, "E: rods and brackets at the joint"),
    "stop_stiffness": around("N m/rad", 8e6, 0.2, "E: hard stop"),
    "stop_damping": around("N m s/rad", 4e4, 0.2, "E"),
    "dead_volume": around("m³", 1e-4, 0.2, "E: two ends a side"),
    "hose_volume": around("m³", 0.43e-3, 0.15, "E: parameters.md C"),
    "supply_volume": around("m³", 1.5e-3, 0.2, "E"),
    "command_gain": around("", 1.0, 0.0, "P"),
    "null_shift": zero("", 0.006, "E: of the valve's null", 0.002),
    "angle_gain": around("", 1.0, 0.003, "S34: linearity"),
    "angle_offset": zero("rad", 0.004, "E", 0.0005),
    "pressure_offset_a": zero("Pa", 0.7 * BAR, "E: 0.3 % of 250 bar", 0.15 * BAR),
    "pressure_offset_b": zero("Pa", 0.7 * BAR, "E: 0.3 % of 250 bar", 0.15 * BAR),
    "pressure_offset_pump": zero("Pa", 0.9 * BAR, "E: 0.3 % of 350 bar", 0.2 * BAR),
}


@lru_cache(maxsize=4096)
def mount_width(stop_angle: float) -> float:
    """Half width [m] of the mounts such that the full stroke spans the joint's range."""
    squares = MOUNT_REAR**2 + MOUNT_FRONT**2

    def length(width: float, angle: float) -> float:
        across, along = width**2 - MOUNT_REAR * MOUNT_FRONT, width * (MOUNT_REAR + MOUNT_FRONT)
        return math.sqrt(squares + 2 * width**2 - 2 * (across * math.cos(angle) - along * math.sin(angle)))

    found = brentq(lambda w: length(w, stop_angle) - length(w, -stop_angle) - STROKE, 0.1, 0.35, xtol=1e-14)
    return float(found)  # pyright: ignore[reportArgumentType]


def geometry(m: Made) -> dict[str, float]:
    """Constants of the two cylinders at the joint."""
    width = mount_width(m["stop_angle"])
    squares = MOUNT_REAR**2 + MOUNT_FRONT**2 + 2 * width**2
    across, along = width**2 - MOUNT_REAR * MOUNT_FRONT, width * (MOUNT_REAR + MOUNT_FRONT)
    low = squares - 2 * (across * math.cos(m["stop_angle"]) + along * math.sin(m["stop_angle"]))
    return {
        "mount_squares": squares,
        "mount_across": across,
        "mount_along": along,
        "length_low": math.sqrt(low),
        "stroke": STROKE,
        "bore_area": BORE_AREA,
        "annulus_area": ANNULUS_AREA,
    }


def loaded(m: Made, frame: str, place: float, own: float = 0.1) -> dict[str, float]:
    """Masses, centres and inertias with the payload at a ``place`` [m] ahead of the hinge (front) or behind it (rear).

    ``own``: square of the payload's radius of gyration [m²].
    """
    made = {}
    for name in ("front", "rear"):
        mass, centre = m[f"mass_{name}_empty"], m[f"place_{name}"]
        added = m["payload"] if name == frame else 0.0
        whole = (mass * centre + added * place) / (mass + added)
        made[f"mass_{name}"] = mass + added
        made[f"centre_{name}"] = whole
        made[f"yaw_inertia_{name}"] = (
            m[f"inertia_{name}"] + mass * (centre - whole) ** 2 + added * ((place - whole) ** 2 + own)
        )
    base = 2 * m["half_base"]
    total = made["mass_front"] + made["mass_rear"]
    lever = made["mass_front"] * (m["half_base"] + made["centre_front"])
    lever += made["mass_rear"] * (m["half_base"] - made["centre_rear"])
    made["load_front"] = 0.5 * GRAVITY * lever / base
    made["load_rear"] = 0.5 * GRAVITY * total - made["load_front"]
    return made | {
        "mass_total": total,
        "load_mean": 0.25 * GRAVITY * (m["mass_front_empty"] + m["mass_rear_empty"]),
        "axle_front": m["half_base"],
        "axle_rear": m["half_base"],
    }


def slope(m: Made, along: float, across: float) -> dict[str, float]:
    """Accelerations [m/s²] down a slope whose direction is a unit vector in axes of the rear frame."""
    pull = GRAVITY * math.sin(m["slope_angle"])
    return {"slope_along": pull * along, "slope_across": pull * across}


def valve(m: Made) -> dict[str, float]:
    """Conductances [m³/(s √Pa)] of edges, compensator and return, from flows at drops."""
    root = math.sqrt(REFERENCE_DROP)
    return {
        "edge_left": m["edge_scale"] * m["flow_left"] / root,
        "edge_right": m["edge_scale"] * m["flow_right"] / root,
        "compensator_passage": m["flow_left"] / math.sqrt(m["compensator_drop"]),
        "return_edge": m["flow_left"] / math.sqrt(m["return_drop"]),
        "rest_pressure": m["tank_pressure"] + 1.5 * BAR,
        "standby_stroke": m["pump_leakage"] * m["margin"] / (m["pump_displacement"] * m["engine_speed"]),
    }


def hydraulic_table(day: float) -> dict[str, Constant]:
    """Constants of the steering circuit that all families have; ``day``: daily spread of seals and settings."""
    return {
        "temperature": Constant("°C", 31.0, 35.0, 39.0, "E: oil in tests", day),
        "flow_left": around("m³/s", 73.5 * LITRE_PER_MINUTE, 0.02, "P: measured"),
        "flow_right": around("m³/s", 67.5 * LITRE_PER_MINUTE, 0.02, "P: measured"),
        "edge_scale": around("", 1.0, 0.0, "D"),
        "edge_drop": around("Pa", REFERENCE_DROP, 0.06, "P: fitted to 4–14 bar"),
        "compensator_drop": around("Pa", 4 * BAR, 0.15, "E: open compensator at nominal flow"),
        "return_drop": around("Pa", 4 * BAR, 0.3, "1D"),
        "tank_pressure": around("Pa", 1.0 * BAR, 0.3, "E", day),
        "margin": around("Pa", 20 * BAR, 0.08, "R", 0.2 * day),
        "pump_leakage": around("m³/(s Pa)", 2.5e-11, 0.3, "E: 3 L/min at standby with the bleed"),
        "shock_pressure": around("Pa", 230 * BAR, 0.05, "E"),
        "stroke_time": around("s", 0.11, 0.15, "R: table of the NG140"),
        "sense_lag": around("s", 0.008, 0.3, "E: orifice and line"),
        "regulator_lead": around("s", 0.014, 0.15, "E: damping orifices"),
        "line_resistance": around("1/m³", 2.35e9, 0.2, "D: two hoses Ø12.7 mm, 3 m, Hagen–Poiseuille"),
    }


def kelvin(celsius: float) -> float:
    """Absolute temperature [K]."""
    return celsius + ZERO_CELSIUS
