"""Effects of the steering cylinders: leakage past the pistons, friction of the seals."""

from __future__ import annotations

import numpy as np

from aoro_gym.effects.effect import Effect, MachineEffect, Magnitude, Operational
from aoro_gym.effects.magnitudes import REFERENCE_PRESSURE, added
from aoro_gym.machine.parameters import Machine
from aoro_gym.machine.quantities import Quantity


def _piston_leakage(machine: Machine, *magnitude: Quantity) -> Quantity:
    return 2.0 * REFERENCE_PRESSURE * np.asarray(machine.steering.cylinder.leakage)


def _breakaway_force(machine: Machine, *magnitude: Quantity) -> Quantity:
    cylinder = machine.steering.cylinder
    return cylinder.seal_preload * np.asarray(cylinder.seal_static_ratio)


EFFECTS: tuple[Effect, ...] = (
    MachineEffect(
        id="cylinder_leakage",
        component="cylinders",
        physics="Worn piston seals: laminar leakage from one side of the pistons to the other.",
        sign="+: more",
        magnitudes=(Magnitude("flow", "m^3/s", 0.0, 1e-4, "1D: 1e-13 to 3e-12, S16: 1e-11 m³/s/Pa a cylinder"),),
        operational=(Operational("leakage past both pistons at 100 bar", "m^3/s", _piston_leakage),),
        change=lambda machine, flow: {"steering.cylinder.leakage": np.asarray(flow) / (2.0 * REFERENCE_PRESSURE)},
    ),
    MachineEffect(
        id="seal_friction",
        component="cylinders",
        physics="Tight or dry seals of the steering cylinders.",
        sign="+: more",
        magnitudes=(Magnitude("preload", "N", 0.0, 4000.0, "E: 20 to 600 N new; ten times that when dry"),),
        operational=(Operational("breakaway force of one cylinder without pressure", "N", _breakaway_force),),
        change=added("steering.cylinder.seal_preload"),
    ),
)
