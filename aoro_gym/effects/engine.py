"""Effects of the engine."""

from __future__ import annotations

from aoro_gym.effects.effect import Effect, MachineEffect, Magnitude, Operational
from aoro_gym.effects.magnitudes import added, parameter

EFFECTS: tuple[Effect, ...] = (
    MachineEffect(
        id="engine_droop",
        component="engine",
        physics="The governor lets the speed fall in proportion to the brake torque.",
        sign="+: falls",
        magnitudes=(Magnitude("droop", "1", 0.0, 0.07, "E: 0 to 7 % of governors"),),
        operational=(
            Operational(
                "relative fall of steady engine speed from no load to full load", "1", parameter("engine.droop")
            ),
        ),
        hidden="joint angle and pressures of standing turns, whose pump makes up for it; the engine's speed shows it",
        change=added("engine.droop"),
    ),
)
