"""Effects of the driveline."""

from __future__ import annotations

from aoro_gym.effects.effect import Effect, MachineEffect, Magnitude, Operational
from aoro_gym.effects.magnitudes import added, parameter

EFFECTS: tuple[Effect, ...] = (
    MachineEffect(
        id="driveline_resistance",
        component="driveline",
        physics="Dragging brakes or motors: dry friction at every wheel.",
        sign="+: more",
        magnitudes=(Magnitude("torque", "N*m", 0.0, 1000.0, "D: 230 to 370 N m in the published figures; E"),),
        operational=(
            Operational(
                "dry torque that one wheel's brake disc turns with",
                "N*m",
                parameter("driveline.brake.disc_torque"),
            ),
        ),
        change=added("driveline.brake.disc_torque"),
    ),
)
