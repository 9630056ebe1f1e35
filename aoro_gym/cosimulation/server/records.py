"""What the server and its clients send each other, and what voltages mean."""

from __future__ import annotations

import math
from collections.abc import Mapping

from aoro_gym.cosimulation.protocol import LATEST, Field, Record
from aoro_gym.machine.kinematics import NODES
from aoro_gym.recording.commands import COMMAND_BOUNDS, WHEELS
from aoro_gym.units import BAR

LOWEST_VOLTS, MIDDLE_VOLTS, HIGHEST_VOLTS = 0.5, 2.5, 4.5
"""Range [V] of every analogue command. Steering is the machine's own: u = (2.5 V − V) / 2 V, so that 0.5 V is full left;
the others are chosen likewise, (E): drive and arms (V − 2.5 V) / 2 V, brake and traction (V − 0.5 V) / 4 V."""
HALF_RANGE = HIGHEST_VOLTS - MIDDLE_VOLTS
GEARS = (1, 3)


def _volts(name: str, rest: float, text: str) -> Field:
    return Field(f"{name}_V", "f32", "V", LOWEST_VOLTS, HIGHEST_VOLTS, text, default=rest)


def _wheels(name: str, unit: str, low: float, high: float, text: str) -> tuple[Field, ...]:
    """A number of every corner: front left, front right, rear left, rear right."""
    return tuple(Field(f"{name}_{wheel}", "f32", unit, low, high, f"{text}, {PLACES[wheel]}") for wheel in WHEELS)


PLACES = dict(zip(WHEELS, ("front left", "front right", "rear left", "rear right"), strict=True))

HELLO = Record("hello", 1, (), "Asks for the session (naming session 0), or for telemetry (naming the session).")
STATE = Record(
    "state",
    2,
    (
        Field("lock_step", "u8", "1", 0, 1, "1: the twin advances by grants; 0: in real time"),
        Field("main_step", "f64", "s", 0.0, 1.0, "time step of the twin"),
        Field("telemetry_step", "f64", "s", 0.0, 1.0, "time between two records of telemetry"),
    ),
    "The answer to a hello, and to a grant once it is used up; its header names the session and the simulated time.",
)
COMMAND = Record(
    "command",
    3,
    (
        _volts("steering", MIDDLE_VOLTS, "steering valve: 0.5 V full left, 4.5 V full right"),
        _volts("drive", MIDDLE_VOLTS, "drive pump: 4.5 V full ahead, 0.5 V full astern"),
        _volts("brake", LOWEST_VOLTS, "parking brake: 0.5 V released, 4.5 V fully on"),
        *(_volts(f"arm_{wheel}", MIDDLE_VOLTS, f"arm valve, {PLACES[wheel]}: 4.5 V full up") for wheel in WHEELS),
        *(
            _volts(f"traction_{wheel}", HIGHEST_VOLTS, f"traction valve, {PLACES[wheel]}: 4.5 V open")
            for wheel in WHEELS
        ),
        Field("gear", "u8", "1", *GEARS, "gear", default=1),
    ),
    "What the machine shall do. The time in its header is that of the newest telemetry that it is an answer to.",
)
GRANT = Record(
    "grant",
    5,
    (Field("until", "f64", "s", 0.0, LATEST, "simulated time up to which the twin may advance"),),
    "In lock-step: lets the twin advance. The same time granted again is answered again, and moves nothing.",
)

MEASURED_PRESSURES = {
    "pressure_a": "steering cylinders, port A (pressurised in a left turn)",
    "pressure_b": "steering cylinders, port B",
    "pump_pressure": "pump of steering and arms",
    "drive_pressure_forward": "closed loop, line that is pressurised ahead",
    "drive_pressure_return": "closed loop, other line",
    **{f"arm_pressure_bore_{wheel}": f"arm cylinder, bore's end, {PLACES[wheel]}" for wheel in WHEELS},
    **{f"arm_pressure_rod_{wheel}": f"arm cylinder, rod's end, {PLACES[wheel]}" for wheel in WHEELS},
}
"""Channels of the twin that have a pressure sensor."""
HIGHEST_PRESSURE = 600.0 * BAR
MOST_SENTENCES = 2**32 - 1

TELEMETRY = Record(
    "telemetry",
    4,
    (
        Field("utc", "f64", "s", 0.0, 86_400.0, "time of day of this record, by the clock of the GPS sentences"),
        Field(
            "command_sequence", "u64", "1", 0, 2**53 - 1, "sequence number of the command that is obeyed; 0: none yet"
        ),
        Field("watchdog", "u8", "1", 0, 1, "1: no valid command came in time; neutral and brakes"),
        Field("gear", "u8", "1", *GEARS, "gear that is commanded"),
        Field("joint_angle", "f32", "rad", -math.pi, math.pi, "joint angle, positive left"),
        *_wheels("wheel_speed", "rad/s", -1000.0, 1000.0, "wheel speed, positive ahead"),
        Field("roll", "f32", "rad", -math.pi, math.pi, "front frame, positive where the left side is up"),
        Field("pitch", "f32", "rad", -math.pi, math.pi, "front frame, positive where the nose is down"),
        *(Field(f"rate_{axis}", "f32", "rad/s", -100.0, 100.0, f"angular velocity about {axis}") for axis in "xyz"),
        *(Field(f"force_{axis}", "f32", "m/s^2", -1000.0, 1000.0, f"specific force along {axis}") for axis in "xyz"),
        *(Field(name, "f32", "Pa", -BAR, HIGHEST_PRESSURE, text) for name, text in MEASURED_PRESSURES.items()),
        *_wheels("arm_angle", "rad", -math.pi, math.pi, "arm angle, exact"),
        Field("engine_speed", "f32", "rad/s", -1000.0, 1000.0, "engine speed, exact"),
    ),
    "What the machine's sensors show, a hundred times a second; x ahead, y left, z up. What is exact has no model of a"
    " sensor. A value beyond its bounds is sent as the bound.",
)
POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
"""Of a node in the world's axes: translation [m], and unit quaternion."""
FARTHEST = 1e6
"""[m]"""
POSES = Record(
    "poses",
    6,
    tuple(
        Field(f"{node}_{name}", "f32", *(("m", -FARTHEST, FARTHEST) if name in "xyz" else ("1", -1.001, 1.001)), node)
        for node in NODES
        for name in POSE
    ),
    "Where the machine's parts are, for a renderer: sent with each record of telemetry to the address of --poses alone.",
)
RECORDS = (HELLO, STATE, COMMAND, TELEMETRY, GRANT)
"""All records of the server and its clients."""


def commands_of(volts: Mapping[str, float]) -> dict[str, float]:
    """The twin's commands, by name, that the fields of a :data:`COMMAND` stand for."""
    shares = {"steering_signal": (MIDDLE_VOLTS - volts["steering_V"]) / HALF_RANGE}
    shares["drive_signal"] = (volts["drive_V"] - MIDDLE_VOLTS) / HALF_RANGE
    shares["parking_brake"] = (volts["brake_V"] - LOWEST_VOLTS) / (2.0 * HALF_RANGE)
    for wheel in WHEELS:
        shares[f"arm_{wheel}"] = (volts[f"arm_{wheel}_V"] - MIDDLE_VOLTS) / HALF_RANGE
        shares[f"traction_{wheel}"] = (volts[f"traction_{wheel}_V"] - LOWEST_VOLTS) / (2.0 * HALF_RANGE)
    return {**shares, "gear": volts["gear"]}


def neutral(gear: float) -> dict[str, float]:
    """The twin's commands where nobody commands: all valves in the middle, brakes on, the gear stays. A chosen behaviour."""
    rest = {name: initial for name, (_, _, initial) in COMMAND_BOUNDS.items()}
    return {**rest, "parking_brake": 1.0, "gear": gear}


def within_bounds(record: Record, values: Mapping[str, float]) -> dict[str, float]:
    """``values``, which are finite, clipped to the bounds of a record's fields."""
    return {one.name: min(max(values[one.name], one.low), one.high) for one in record.fields}
