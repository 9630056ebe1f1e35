"""Effects of the joint and its frames: friction, backlash, compliance."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from aoro_gym.effects.effect import Effect, MachineEffect, Magnitude, Operational
from aoro_gym.effects.magnitudes import added, parameter
from aoro_gym.machine.parameters import Machine
from aoro_gym.machine.quantities import Quantity

TIGHT = 1e-3
"""Play [rad] below which pins still touch all round: a quarter of a millimetre at either end."""


def _worn_pins(machine: Machine, play: Quantity, compliance: Quantity) -> Mapping[str, Quantity]:
    """A free play, and pins that touch along a line, the less of it the wider the play, up to :data:`TIGHT`."""
    return {"joint.backlash": play, "joint.compliance": compliance * np.clip(np.asarray(play) / TIGHT, 0.0, 1.0)}


EFFECTS: tuple[Effect, ...] = (
    MachineEffect(
        id="joint_friction",
        component="joint",
        physics="Dry friction in the bearing of the joint.",
        sign="+: more",
        magnitudes=(Magnitude("torque", "N*m", 0.0, 5000.0, "E: 50 to 500 N m greased; ten times that when seizing"),),
        operational=(
            Operational("breakaway torque of the joint's bearing", "N*m", parameter("joint.friction_torque")),
        ),
        change=added("joint.friction_torque"),
    ),
    MachineEffect(
        id="joint_backlash",
        component="joint",
        physics="Worn pins: the cylinders cross a free play before they push the frames, through pins that give way "
        "where they touch; the sensor sees the joint.",
        sign="+: more play",
        magnitudes=(
            Magnitude(
                "play", "rad", 0.0, 0.012, "E, D: pins of 0.3 to 1.5 mm, 0.3° a millimetre, both ends", least=TIGHT
            ),
            Magnitude(
                "compliance",
                "rad/(N*m)",
                1.5e-8,
                1.5e-7,
                "E: pins of 1e8 to 1e9 N/m at 0.18 m",
                none=5e-8,
                scale="log",
            ),
        ),
        operational=(
            Operational("free play of the joint with the cylinders held", "rad", parameter("joint.backlash")),
        ),
        change=_worn_pins,
    ),
    MachineEffect(
        id="frame_compliance",
        component="joint",
        physics="Frames and cylinder mounts bend, a torsion spring in series with the oil.",
        sign="+: softer",
        magnitudes=(Magnitude("compliance", "rad/(N*m)", 0.0, 5e-7, "E: 2 to 20 MN m/rad", least=5e-8),),
        operational=(
            Operational("joint angle per torque with the cylinders held", "rad/(N*m)", parameter("joint.compliance")),
        ),
        change=added("joint.compliance"),
    ),
)
