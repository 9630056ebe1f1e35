"""Effects of pump 2, which supplies the steering."""

from __future__ import annotations

from aoro_gym.effects.effect import Effect, MachineEffect, Operational
from aoro_gym.effects.magnitudes import factor, parameter, scaled

EFFECTS: tuple[Effect, ...] = (
    MachineEffect(
        id="pump_response",
        component="pump",
        physics="Pump 2's swash moves slower or faster, up and down.",
        sign="+: slower",
        magnitudes=(factor(0.4, 3.0, "R, S16: 0.05 to 0.30 s up"),),
        operational=(
            Operational(
                "time of the swash from zero to full at saturated error",
                "s",
                parameter("steering.pump.stroke_up_time"),
            ),
        ),
        change=scaled("steering.pump.stroke_up_time", "steering.pump.stroke_down_time"),
    ),
    MachineEffect(
        id="pump_limit",
        component="pump",
        physics="Pump 2's pressure cut-off stands elsewhere and caps the first acceleration.",
        sign="+: higher",
        magnitudes=(factor(0.4, 1.2, "1D: 178 to 243 bar; E: down to a misadjusted one"),),
        operational=(
            Operational("supply pressure at which pump 2 delivers nothing", "Pa", parameter("steering.pump.cutoff")),
        ),
        change=scaled("steering.pump.cutoff"),
    ),
)
