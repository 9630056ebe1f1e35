"""The 33 effects: what each changes on a machine of any family, and its operational magnitude.

An effect turns one knob of a machine until its magnitude has moved by what is asked. The knob scales or shifts
constants of the family's own laws; the magnitude is what a bench would show, whatever the laws.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import ModuleType

from aoro_gym.units import BAR, DEGREE, GRAVITY, LITRE_PER_MINUTE

Made = Mapping[str, float]
SEVENTY = 70.0 * LITRE_PER_MINUTE
TEN, HUNDRED = 10.0 * BAR, 100.0 * BAR


@dataclass(frozen=True)
class Effect:
    """A deviation from the healthy machine.

    Args:
        unit: Of magnitude and size; "relative" sizes are changes by the healthy magnitude.
        magnitude: What is measured.
        weak, strong: Sizes from hardly visible to gross.
        measure: Magnitude of a machine: (family's module, all constants that its laws read).
        signs: Of sizes that make sense.
        scale: Constants that are scaled, with exponents; a family's own ``KNOBS`` come first.
        shift: Constants that are shifted instead, with their weights.
        note: Where it does not show.
    """

    unit: str
    magnitude: str
    weak: float
    strong: float
    measure: Callable[[ModuleType, Made], float]
    signs: tuple[int, ...] = (1,)
    scale: Mapping[str, float] = field(default_factory=dict)
    shift: Mapping[str, float] = field(default_factory=dict)
    note: str = ""

    @property
    def relative(self) -> bool:
        """Whether sizes are relative to the healthy magnitude."""
        return self.unit == "relative"


def _constant(name: str, factor: float = 1.0) -> Callable[[ModuleType, Made], float]:
    return lambda family, made: made[name] * factor


def _own(effect: str) -> Callable[[ModuleType, Made], float]:
    return lambda family, made: family.MEASURES[effect](made)


def _leakage(name: str) -> Callable[[ModuleType, Made], float]:
    return lambda family, made: made[name] / made["viscosity"] * HUNDRED / LITRE_PER_MINUTE


BOTH = (1, -1)

SENSORS = {
    "sensor_delay": Effect(
        "s", "delay of the logged joint angle", 0.004, 0.06, _constant("angle_delay"), shift={"angle_delay": 1.0}
    ),
    "sensor_filter": Effect(
        "s",
        "time constant of the joint angle's filter",
        0.004,
        0.08,
        _constant("angle_filter"),
        shift={"angle_filter": 1.0},
    ),
    "sensor_gain": Effect(
        "1", "gain of the joint angle", 0.006, 0.06, _constant("angle_gain"), BOTH, shift={"angle_gain": 1.0}
    ),
    "measuring_chain": Effect(
        "s",
        "time constant of the logger's input filter, of angle and pressures alike",
        0.004,
        0.06,
        _constant("chain_filter"),
        shift={"chain_filter": 1.0},
    ),
}

SUPPLY = {
    "engine_droop": Effect(
        "1",
        "fall of the engine's speed at full torque",
        0.02,
        0.12,
        _constant("engine_droop"),
        shift={"engine_droop": 1.0},
        note="shows in the engine's speed; the pump has flow to spare, so the joint hardly feels it",
    ),
    "pump_response": Effect("s", "time from standby to the flow of 70 L/min", 0.02, 0.25, _own("pump_response")),
    "pump_limit": Effect(
        "bar",
        "highest pressure of the pump",
        50.0,
        150.0,
        _constant("pump_limit", 1 / BAR),
        (-1,),
        shift={"pump_limit": BAR},
        note="shows only where the load reaches it: first peak and end stop at large commands",
    ),
}

VALVE = {
    "command_delay": Effect(
        "s", "dead time from command to spool", 0.004, 0.08, _constant("command_delay"), shift={"command_delay": 1.0}
    ),
    "spool_lag": Effect("s", "mean lag of the spool behind small commands", 0.008, 0.12, _own("spool_lag")),
    "spool_rate": Effect(
        "s",
        "time for the full stroke at the rate limit",
        0.05,
        0.5,
        lambda f, m: 1.0 / m["spool_rate"],
        scale={"spool_rate": -1.0},
    ),
    "dead_band": Effect(
        "1",
        "command at which the valve opens, mean of both sides",
        0.02,
        0.1,
        lambda f, m: 0.5 * (m["dead_left"] + m["dead_right"]),
        BOTH,
        shift={"dead_left": 1.0, "dead_right": 1.0},
    ),
    "valve_gain": Effect("relative", "flow at the full signal", 0.03, 0.3, _own("valve_gain"), BOTH),
    "valve_hysteresis": Effect(
        "1",
        "width of the command's loop at constant flow",
        0.01,
        0.12,
        _constant("valve_play", 2.0),
        shift={"valve_play": 0.5},
        note="a single turn from rest sees half of it as dead band; reversals show it",
    ),
    "compensator_lag": Effect("s", "time in which the compensator settles", 0.006, 0.1, _own("compensator_lag")),
    "compensator_opening": Effect(
        "relative",
        "flow through the fully open compensator at 10 bar",
        0.15,
        0.7,
        lambda f, m: m["compensator_conductance"] * math.sqrt(TEN) / LITRE_PER_MINUTE,
        BOTH,
        {"compensator_conductance": 1.0},
        note="a larger opening hardly shows: the healthy one passes more than is asked",
    ),
    "back_pressure": Effect(
        "bar",
        "pressure of the return gallery at 70 L/min",
        1.0,
        15.0,
        lambda f, m: (m["return_preload"] + (SEVENTY / m["return_line"]) ** 2) / BAR,
        scale={"return_line": -1.0},
    ),
    "cross_port_leakage": Effect(
        "L/min",
        "leakage between the ports at 100 bar, in the valve",
        0.2,
        8.0,
        _leakage("cross_leakage"),
        scale={"cross_leakage": 1.0},
        note="at the joint the same as leakage over the pistons, but for the hoses between",
    ),
}

OIL = {
    "oil_temperature": Effect(
        "K", "temperature of the oil", 5.0, 25.0, _constant("oil_temperature"), BOTH, shift={"oil_temperature": 1.0}
    ),
    "oil_bulk_modulus": Effect(
        "relative",
        "effective bulk modulus of the oil at 100 bar",
        0.08,
        0.5,
        lambda f, m: f.bulk_modulus(m, HUNDRED) / BAR,
        (-1,),
        {"liquid_35": 1.0},
    ),
    "entrained_air": Effect(
        "relative",
        "effective bulk modulus of the oil at 10 bar",
        0.15,
        0.85,
        lambda f, m: f.bulk_modulus(m, TEN) / BAR,
        (-1,),
        {"air": -1.0},
    ),
    "hose_compliance": Effect(
        "mL", "volume that the hoses of a side give way by at 100 bar", 1.0, 10.0, _own("hose_compliance")
    ),
}

CYLINDERS = {
    "cylinder_leakage": Effect(
        "L/min",
        "leakage over the pistons at 100 bar",
        0.2,
        8.0,
        _leakage("cylinder_leakage"),
        scale={"cylinder_leakage": 1.0},
    ),
    "seal_friction": Effect(
        "N",
        "breakaway force of a cylinder at 20 bar",
        200.0,
        5000.0,
        lambda f, m: f.breakaway(m, 20.0 * BAR),
        scale={"seal_friction": 1.0},
    ),
    "joint_friction": Effect(
        "N m",
        "breakaway torque of the joint's bearing",
        150.0,
        4000.0,
        _constant("joint_friction"),
        scale={"joint_friction": 1.0},
    ),
    "joint_backlash": Effect(
        "mrad",
        "free play of the joint between the cylinders",
        1.5,
        20.0,
        _constant("joint_play", 2e3),
        scale={"joint_play": 1.0},
        note="a turn in one direction takes it up once, before the joint moves",
    ),
    "frame_compliance": Effect(
        "mrad",
        "twist between cylinders and joint at 10 kN m",
        0.5,
        8.0,
        lambda f, m: 1e7 / m["joint_stiffness"],
        scale={"joint_stiffness": -1.0},
    ),
}

VEHICLE = {
    "payload": Effect(
        "kg",
        "mass on the rear frame (+) or on the front one (−)",
        200.0,
        2500.0,
        _constant("payload"),
        BOTH,
        shift={"payload": 1.0},
    ),
    "driveline_resistance": Effect(
        "N m", "resisting torque of a wheel", 150.0, 4000.0, _constant("wheel_brake"), scale={"wheel_brake": 1.0}
    ),
    "tire_relaxation": Effect(
        "m",
        "relaxation length",
        0.15,
        2.0,
        _own("tire_relaxation"),
        note="shows in the family alder; in birch a little, in cedar hardly, as wheels of a standing machine roll little",
    ),
    "tire_stiffness": Effect("relative", "swivel stiffness of a standing tire", 0.2, 0.7, _own("tire_stiffness"), BOTH),
    "tire_scrub": Effect(
        "N m",
        "swivel torque of a standing tire at 20°",
        150.0,
        1200.0,
        lambda f, m: f.swivel_torque(m, 20 * DEGREE),
        BOTH,
        {"swivel_friction": 1.0},
    ),
    "soft_ground": Effect("mm", "sinkage of a wheel", 10.0, 120.0, _constant("sinkage", 1e3), shift={"sinkage": 1e-3}),
    "ground_slope": Effect(
        "deg",
        "side slope, upwards to the left",
        0.5,
        6.0,
        lambda f, m: math.asin(-m["slope_across"] / GRAVITY) / DEGREE,
        BOTH,
        shift={"slope_across": -GRAVITY * DEGREE},
    ),
}

EFFECTS: Mapping[str, Effect] = {**SENSORS, **SUPPLY, **VALVE, **OIL, **CYLINDERS, **VEHICLE}
"""All effects by their id."""
