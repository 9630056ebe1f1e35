"""Effects of mass: a payload on the front frame."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from aoro_gym.effects.effect import Effect, MachineEffect, Magnitude, Operational
from aoro_gym.machine.parameters import Machine
from aoro_gym.machine.quantities import Quantity

PAYLOAD_HEIGHT = 1.5
"""Height [m] of a payload over the design ground, above the middle of the front axle (E: a log in the folded crane)."""


def _payload(machine: Machine, mass: Quantity) -> Mapping[str, Quantity]:
    """A point over the middle of the front axle joined to the front frame (parallel axes)."""
    front = machine.frame.front
    share = mass / (front.mass + mass)
    ahead, above = np.asarray(front.cog_offset), PAYLOAD_HEIGHT - np.asarray(front.cog_height)
    reduced = front.mass * share
    return {
        "frame.front.mass": mass,
        "frame.front.cog_offset": -share * ahead,
        "frame.front.cog_height": share * above,
        "frame.front.inertia_xx": reduced * above**2,
        "frame.front.inertia_yy": reduced * (ahead**2 + above**2),
        "frame.front.inertia_zz": reduced * ahead**2,
    }


EFFECTS: tuple[Effect, ...] = (
    MachineEffect(
        id="payload",
        component="mass",
        physics="A load on the front frame, over the middle of its axle.",
        sign="+: heavier",
        magnitudes=(Magnitude("mass", "kg", 0.0, 1500.0, "E: ±500 to 1500 kg m² about the joint and more"),),
        operational=(Operational("mass of the machine", "kg", lambda machine, *magnitude: machine.mass),),
        change=_payload,
    ),
)
