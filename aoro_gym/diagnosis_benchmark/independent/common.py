"""Constants of the vehicle that all families share, and what follows from them."""

import math
from collections.abc import Mapping
from functools import lru_cache

from aoro_gym.units import BAR, DEGREE, GRAVITY, LITRE_PER_MINUTE, RPM, ZERO_CELSIUS

from .constants import Constant, Table

LITRE = 1e-3
MM = 1e-3

BODY: Table = {
    "mass_front": Constant("kg", 4500, 4900, 5300, "E: axle loads 4.9/5.1 t of 10 t (P)"),
    "mass_rear": Constant("kg", 4700, 5100, 5500, "E: as above"),
    "yaw_inertia_front": Constant("kg m²", 2600, 3100, 3700, "E: two corners of 540 kg at half a track, and the body"),
    "yaw_inertia_rear": Constant("kg m²", 2900, 3500, 4100, "E: as above"),
    "axle_front": Constant("m", 1.62, 1.70, 1.78, "E: wheelbase 3.4 m gives the rim speed of 0.74 m/s (P)"),
    "axle_rear": Constant("m", 1.62, 1.70, 1.78, "E: as above"),
    "centre_front": Constant("m", 1.40, 1.50, 1.62, "E: 0.2 m from the axle towards the hinge"),
    "centre_rear": Constant("m", 1.48, 1.60, 1.70, "E: 0.1 m from the axle towards the hinge"),
    "track": Constant("m", 1.90, 1.97, 2.06, "E: 2.5 m overall less a tire's 0.53 m"),
    "slope_along": Constant("m/s²", -0.02, 0.0, 0.02, "E: a flat yard is level within 0.1°", 0.01),
    "slope_across": Constant("m/s²", -0.02, 0.0, 0.02, "E: as above", 0.01),
    "joint_stiffness": Constant("N m/rad", 6e6, 10e6, 16e6, "E: series torsion of frames and brackets 2–20 MN m/rad"),
    "joint_damping": Constant("N m s/rad", 2500, 4000, 6000, "E: some per cent of critical for rods of 8 kg m²"),
    "joint_play": Constant("rad", 1e-5, 5e-5, 2e-4, "E: pins within 0.01–0.04 mm at a lever of 0.19 m"),
    "rod_inertia": Constant("kg m²", 6.0, 8.0, 11.0, "E: two cylinders of 60 kg, oil columns and brackets"),
    "joint_friction": Constant("N m", 100, 200, 350, "E: μ 0.1 · 15 kN · 0.1 m · 2", 0.06),
    "stop_angle": Constant("rad", 39.6 * DEGREE, 40 * DEGREE, 40.4 * DEGREE, "D: whole stroke over the joint's range"),
    "stop_stiffness": Constant("N m/rad", 12e6, 15e6, 19e6, "E: hard stop"),
    "stop_damping": Constant("N m s/rad", 10e3, 14e3, 18e3, "E: about half of critical for the rods"),
    "mount_rear": Constant("m", 0.395, 0.40, 0.405, "D: stroke of 265 mm over ±40°"),
    "mount_front": Constant("m", 0.277, 0.28, 0.283, "D: as above"),
    "stroke": Constant("m", 0.265, 0.265, 0.265, "P: cylinder 80/40-265"),
    "bore": Constant("m", 0.080, 0.080, 0.080, "P"),
    "rod": Constant("m", 0.040, 0.040, 0.040, "P"),
    "dead_volume": Constant("m³", 0.06 * LITRE, 0.10 * LITRE, 0.16 * LITRE, "E: two cylinder ends a side"),
}
"""Frames, joint and cylinders."""

WHEELS: Table = {
    "tire_radius": Constant("m", 0.535, 0.55, 0.565, "E: loaded radius of a 0.60 m tire", 0.002),
    "wheel_inertia": Constant("kg m²", 35, 45, 58, "E: 200 kg at 0.45 m"),
    "wheel_brake": Constant("N m", 230, 320, 370, "D: 8.2 bar over a motor of 2.1–2.8 L/rev (P)", 0.06),
    "brake_speed": Constant("rad/s", 0.02, 0.03, 0.04, "E: smoothing of dry friction"),
    "ground_friction": Constant("", 0.70, 0.78, 0.88, "E: rubber on asphalt", 0.04),
    "swivel_friction": Constant("", 0.55, 0.70, 0.85, "E: Gough's formula on asphalt", 0.05),
    "inflation": Constant("Pa", 1.8 * BAR, 2.0 * BAR, 2.3 * BAR, "E: forestry tires 1.5–3.5 bar", 0.02),
    "motor_displacement": Constant("m³/rad", 3.3e-4, 4.2e-4, 4.48e-4, "P: MSE18, 2.1–2.8 L/rev"),
    "loop_leakage": Constant("m³/s/Pa", 4e-12, 8e-12, 1.6e-11, "E: four motors and a pump"),
    "loop_modulus": Constant("Pa", 0.6e9, 0.75e9, 0.9e9, "P: oil in four-spiral hose of 1.64 GPa", 0.03),
    "loop_volume": Constant("m³", 4 * LITRE, 6 * LITRE, 8 * LITRE, "E: 4 m of Ø25 mm, 10 m of Ø19 mm, motors"),
    "charge_pressure": Constant("Pa", 21 * BAR, 24 * BAR, 26 * BAR, "R: series 90 charge relief", 0.02),
    "charge_conductance": Constant("m³/s/Pa", 3e-9, 5e-9, 8e-9, "E: 54 L/min at some bar"),
    "flush_conductance": Constant("m³/s/Pa", 3e-10, 5e-10, 8e-10, "R: flushing 10–18 L/min some bar over charge"),
    "loop_relief": Constant("Pa", 345 * BAR, 400 * BAR, 450 * BAR, "R: cross-port relief"),
    "drive_flow": Constant(
        "m³/s", 195 * LITRE_PER_MINUTE, 207 * LITRE_PER_MINUTE, 215 * LITRE_PER_MINUTE, "D, P90R130"
    ),
    "drive_lag": Constant("s", 0.2, 0.3, 0.5, "R: electric displacement control"),
}
"""Wheels, ground and driveline."""

ENGINE: Table = {
    "engine_speed": Constant("rad/s", 1580 * RPM, 1595 * RPM, 1610 * RPM, "P", 0.001),
    "engine_torque": Constant("N m", 590, 630, 670, "E: 4045HF475 at 1600 rpm, 129 kW at 2400"),
    "engine_idle_torque": Constant("N m", 55, 65, 80, "D: friction at 1600 rpm"),
    "engine_inertia": Constant("kg m²", 1.0, 1.4, 2.0, "E: engine, flywheel, pumps"),
    "engine_droop": Constant("", 0.005, 0.01, 0.02, "E: electronic governor, nearly isochronous"),
    "governor_gain": Constant("N m s/rad", 25, 40, 60, "E: full torque at 15 rad/s"),
    "governor_time": Constant("s", 0.2, 0.35, 0.6, "E"),
}
"""Engine and governor."""

OIL: Table = {
    "oil_temperature": Constant("°C", 30, 35, 41, "E: warm machine", 0.05),
    "liquid_35": Constant("Pa", 1.25e9, 1.45e9, 1.65e9, "R: mineral oil 1.0–1.72 GPa at 35 °C"),
    "liquid_slope": Constant("", 8, 10, 12, "R: dβ/dp"),
    "air": Constant("", 0.003, 0.006, 0.012, "E: 0.2–5 % undissolved at rest; a well settled tank", 0.15),
    "polytropic": Constant("", 1.15, 1.25, 1.4, "between isothermal and adiabatic"),
    "hose_volume": Constant(
        "m³", 0.42 * LITRE, 0.50 * LITRE, 0.60 * LITRE, "E: two legs of Ø12.7–16 mm, 3 m long, a side"
    ),
    "hose_modulus": Constant("Pa", 0.9e9, 1.1e9, 1.3e9, "P: double wire braid, 1.2 GPa; static lower"),
    "transition": Constant("Pa", 0.5 * BAR, 0.8 * BAR, 1.2 * BAR, "P: laminar below 1 bar"),
    "cylinder_leakage": Constant("m³/s/Pa", 1e-13, 5e-13, 1.5e-12, "E: tight seals"),
    "cross_leakage": Constant("m³/s/Pa", 2e-13, 8e-13, 2e-12, "R: spool, 5–60 cm³/min at 50 bar a port"),
    "shock_pressure": Constant("Pa", 195 * BAR, 210 * BAR, 230 * BAR, "E: 150–250 bar"),
    "shock_conductance": Constant("m³/s/Pa", 0.6e-9, 1.0e-9, 1.6e-9, "E: 90 L/min at 15 bar of override"),
    "suction_conductance": Constant("m³/s/√Pa", 2.0e-6, 2.8e-6, 3.6e-6, "E: 120 L/min at 5 bar"),
    "suction_cracking": Constant("Pa", 0.2 * BAR, 0.3 * BAR, 0.5 * BAR, "E"),
    "return_preload": Constant("Pa", 1.2 * BAR, 2.0 * BAR, 2.8 * BAR, "E: return filter and check valve", 0.03),
    "return_line": Constant("m³/s/√Pa", 3.0e-6, 3.4e-6, 4.0e-6, "E: 1–6 bar of back-pressure at 70 L/min", 0.02),
    "line_volume": Constant("m³", 1.1 * LITRE, 1.5 * LITRE, 2.0 * LITRE, "E: Ø25 mm, 3 m"),
    "rest_pressure": Constant("Pa", 4.0 * BAR, 6.0 * BAR, 9.0 * BAR, "P: cylinders mainly at 5–15 bar", 0.08),
}
"""Oil, hoses and valves to tank."""

SENSING: Table = {
    "command_delay": Constant("s", 0.005, 0.010, 0.020, "E: CAN cycle and amplifier, 3–40 ms"),
    "angle_filter": Constant("s", 0.5e-3, 1e-3, 2e-3, "R: rotary sensor's output stage"),
    "chain_filter": Constant("s", 0.3e-3, 0.5e-3, 1e-3, "E: no anti-alias filter (P)"),
    "pressure_filter": Constant("s", 0.6e-3, 1.0e-3, 2e-3, "R: response of pressure transmitters below 2 ms"),
    "angle_delay": Constant("s", 0.0, 0.001, 0.003, "R: 0.2–5 ms"),
    "chain_delay": Constant("s", 0.0, 0.001, 0.003, "E: logger reads its inputs one after the other"),
    "angle_gain": Constant("", 0.997, 1.0, 1.003, "R: linearity ±0.5 %"),
    "angle_offset": Constant("rad", -1e-3, 0.0, 1e-3, "E: zero setting", 3e-4),
    "angle_noise": Constant(
        "rad", 1.5e-4, 2.5e-4, 4e-4, "P: noise of the flow after the filter, 12–18 L/min peak to peak"
    ),
    "angle_step": Constant("rad", 3.8e-4, 3.835e-4, 3.9e-4, "R: 14 bit a turn"),
    "angle_wave": Constant("rad", 4e-4, 8e-4, 1.4e-3, "P: lines near 6 and 15 Hz, aliases of engine orders"),
    "pressure_noise": Constant("Pa", 0.10 * BAR, 0.15 * BAR, 0.25 * BAR, "R: 0.05 % of 400 bar"),
    "pressure_step": Constant("Pa", 0.09 * BAR, 0.098 * BAR, 0.10 * BAR, "R: 12 bit of 400 bar"),
    "pressure_offset_a": Constant("Pa", -0.6 * BAR, 0.0, 0.6 * BAR, "R: 0.25 % of 400 bar", 0.1 * BAR),
    "pressure_offset_b": Constant("Pa", -0.6 * BAR, 0.0, 0.6 * BAR, "R: as above", 0.1 * BAR),
    "pressure_offset_pump": Constant("Pa", -0.6 * BAR, 0.0, 0.6 * BAR, "R: as above", 0.1 * BAR),
    "pressure_wave": Constant("Pa", 0.15 * BAR, 0.3 * BAR, 0.6 * BAR, "E: piston ripple, sampled"),
}
"""Command path and measuring chain."""

COMMON: Table = {**BODY, **WHEELS, **ENGINE, **OIL, **SENSING}

OUTSIDE_ZERO = dict.fromkeys(
    (
        "burst_air", "burst_start", "burst_duration", "pocket_volume", "pocket_angle", "shock_leak", "shock_start",
        "bend_force", "bend_angle", "ripple", "ripple_frequency", "swing_torque", "swing_frequency", "swing_phase",
        "hunting", "hunting_frequency", "stone_torque", "heating",
    ),
    0.0,
) | {"grip": 1.0, "attached_left": 1.0, "attached_right": 1.0, "sense_fall": 1.0}  # fmt: skip
"""Values of a healthy machine of what may go wrong outside of the catalogue."""

EFFECT_ZERO = {"payload": 0.0, "sinkage": 0.0, "dead_time": 0.0, "rest_difference": 0.0}
"""Values of a healthy machine of what only an effect (or a test) brings."""


@lru_cache(maxsize=4096)
def mount_half_width(a: float, c: float, angle: float, stroke: float) -> float:
    """Lateral offset [m] of the mounts, so that the stroke spans the joint's range.

    L(θ_s) − L(−θ_s) = stroke, solved by bisection.
    """

    def span(w: float) -> float:
        squares, across, along = a * a + c * c + 2 * w * w, w * w - a * c, w * (a + c)
        even, odd = squares - 2 * across * math.cos(angle), 2 * along * math.sin(angle)
        return math.sqrt(even + odd) - math.sqrt(even - odd)

    low, high = 0.05, 0.5
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if span(middle) < stroke else (low, middle)
    return 0.5 * (low + high)


def viscosity(celsius: float) -> float:
    """Kinematic viscosity [mm²/s] of an ISO VG 46 oil, 46 at 40 °C and 12 at 75 °C.

    Walther: lg lg(ν + 0.7) = A − B lg T, T [K]; from −10 to 100 °C.
    """
    t1, t2 = math.log10(313.15), math.log10(348.15)
    z1, z2 = (math.log10(math.log10(nu + 0.7)) for nu in (46.0, 12.0))
    slope = (z1 - z2) / (t2 - t1)
    return 10.0 ** (10.0 ** (z1 - slope * (math.log10(celsius + ZERO_CELSIUS) - t1))) - 0.7


def derived(machine: Mapping[str, float], soft: Mapping[str, int]) -> dict[str, float]:
    """What device code needs besides the constants themselves: oil at its temperature, geometry, loads of the wheels.

    Bulk modulus −0.5 %/K, density −0.065 %/K (flow through an orifice ∝ ρ^−½ enters with the conductances of each
    family). ``soft`` names what is of the tires' stiffness and its exponent: soft ground lowers it.
    """
    made = dict(OUTSIDE_ZERO | EFFECT_ZERO) | dict(machine)
    a, c, angle = made["mount_rear"], made["mount_front"], made["stop_angle"]
    w = mount_half_width(a, c, angle, made["stroke"])
    made["mount_squares"] = a * a + c * c + 2 * w * w
    made["mount_across"] = w * w - a * c
    made["mount_along"] = w * (a + c)
    even = made["mount_squares"] - 2 * made["mount_across"] * math.cos(angle)
    made["length_low"] = math.sqrt(even - 2 * made["mount_along"] * math.sin(angle))
    made["bore_area"] = math.pi / 4 * made["bore"] ** 2
    made["annulus_area"] = made["bore_area"] - math.pi / 4 * made["rod"] ** 2
    warmer = made["oil_temperature"] - 35.0
    made["viscosity"] = viscosity(made["oil_temperature"]) / viscosity(35.0)
    made["liquid"] = made["liquid_35"] * math.exp(-0.005 * warmer)
    made["thinner"] = math.sqrt(1.0 / (1.0 - 6.5e-4 * warmer))
    for name in ("return_line", "suction_conductance"):
        made[name] *= made["thinner"]
    if made["payload"]:
        load_up(made)
    moment = made["mass_front"] * (made["centre_front"] + made["axle_rear"])
    moment += made["mass_rear"] * (made["axle_rear"] - made["centre_rear"])
    front = moment / (made["axle_front"] + made["axle_rear"])
    rear = made["mass_front"] + made["mass_rear"] - front
    made["load_front"], made["load_rear"] = 0.5 * GRAVITY * front, 0.5 * GRAVITY * rear
    if made["sinkage"]:
        sink(made, soft)
    return made


def sink(made: dict[str, float], soft: Mapping[str, int]) -> None:
    """Soften the ground under the wheels by their sinkage z [m].

    Rolling resistance + 0.9 z/(2 R) of the load (linear fits of rutting, Saarilahti 2002); shear builds up over a
    longer way (Janosi, Hanamoto 1961), stiffness/(1 + z/0.03 m); the rut's walls add to the swivel torque, the
    soil's grip falls.
    """
    z = made["sinkage"]
    made["wheel_brake"] += 0.5 * (made["load_front"] + made["load_rear"]) * 0.45 * z
    for name, exponent in soft.items():
        made[name] /= (1.0 + z / 0.03) ** exponent
    made["swivel_friction"] *= 1.0 + 6.0 * z
    made["ground_friction"] /= 1.0 + 3.0 * z


def load_up(made: dict[str, float]) -> None:
    """Put the payload onto the rear frame's axle (a bunk), a negative one onto the front frame's (crane, grapple)."""
    end = "rear" if made["payload"] > 0.0 else "front"
    load, mass, centre = abs(made["payload"]), made[f"mass_{end}"], made[f"centre_{end}"]
    away = made[f"axle_{end}"] - centre
    made[f"yaw_inertia_{end}"] += mass * load / (mass + load) * away * away + load * 0.5**2
    made[f"mass_{end}"] = mass + load
    made[f"centre_{end}"] = centre + load / (mass + load) * away
