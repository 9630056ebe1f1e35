"""Records between the laboratory's two processes, framed by :mod:`aoro_gym.cosimulation.protocol`: one a datagram."""

from __future__ import annotations

from aoro_gym.cosimulation.protocol import Field, Record
from aoro_gym.recording.commands import WHEELS

LARGEST_RATE, LARGEST_TORQUE = 100.0, 5e4
LONGEST_RUN = 2**32 - 1


def _wheels(name: str, unit: str, bound: float, text: str) -> tuple[Field, ...]:
    return tuple(Field(f"{name}_{wheel}", "f32", unit, -bound, bound, f"{text}, {wheel}") for wheel in WHEELS)


TICK = Field("tick", "u32", "1", 0, LONGEST_RUN, "number of the period, from 1")

BEGIN = Record(
    "laboratory_begin",
    32,
    (
        *_wheels("torque", "N m", LARGEST_TORQUE, "held by the brakes at rest"),
        Field("main_step", "f32", "s", 1e-5, 2e-3, "main step of both sides"),
        Field("steps", "u16", "1", 1, 1000, "main steps of a period"),
    ),
    "From the bodies: begin at rest. The answer is a record of tick 0, whose session holds from then on.",
)
DEMAND = Record(
    "laboratory_demand",
    33,
    (
        TICK,
        *_wheels("rate", "rad/s", LARGEST_RATE, "set-point of the dynamometer, wheel against arm"),
        Field("pump_torque", "f32", "N m", -1e4, 1e4, "pump 2 on the engine"),
        Field("drive_signal", "f32", "1", -1.0, 1.0, "command of pump 1, forwards positive"),
        Field("gear", "u8", "1", 1, 3, "command"),
        Field("parking_brake", "f32", "1", 0.0, 1.0, "command"),
        *(
            Field(f"traction_{wheel}", "f32", "1", 0.0, 1.0, f"command of the traction valve, {wheel}")
            for wheel in WHEELS
        ),
    ),
    "From the bodies, once a period.",
)
MEASURED = Record(
    "laboratory_measured",
    34,
    (
        TICK,
        *_wheels("torque", "N m", LARGEST_TORQUE, "at the flange, mean over the period, forwards positive"),
        Field("engine_speed", "f32", "rad/s", 0.0, 1000.0, "at the period's start"),
        Field("drive_pressure_forward", "f32", "Pa", -2e5, 1e8, "main of pump 1"),
        Field("drive_pressure_return", "f32", "Pa", -2e5, 1e8, "main of pump 1"),
        Field("stopped", "u8", "1", 0, 1, "1: the driveline has stopped and is braked, until it begins anew"),
    ),
    "From the driveline: what it measured in the period of the demand with the same tick.",
)
RECORDS = (BEGIN, DEMAND, MEASURED)
