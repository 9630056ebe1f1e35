"""Structures that are compared: the families of laws, and mixtures around ``materials``.

``materials`` has four options that no other family has: air that dissolves, hoses that creep, tires that wind up on their
patch, and a compensator that feels the load through the load-sensing line. Mixtures have one of them, three of them with the
other laws of another family, or ``materials`` without one; so it is seen which part predicts.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from aoro_gym.calibration.procedure import measured_curve
from aoro_gym.machine import Machine
from aoro_gym.machine.laws import FAMILIES, LAWS

OWN = {"gas": "dissolving", "hose": "viscoelastic", "swivel": "bore_torque"}
"""What ``materials`` alone has, beside the compensator's sensing."""
VALVE = {"flow_force": "steady", "compensator": "spring_mass", "shock_valve": "lag", "compensator_sensing": "port"}
"""The valve of ``valve_maker``."""

STRUCTURES: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "materials": ("materials", {}),
    "default": ("default", {}),
    "valve_maker": ("valve_maker", {}),
    "library": ("library", {}),
    "vehicle": ("vehicle", {}),
    "default_materials": ("default", OWN),
    "valve_maker_materials": ("valve_maker", OWN),
    "library_materials": ("library", OWN),
    "materials_plain_air": ("materials", {"gas": "polytropic"}),
    "materials_plain_hose": ("materials", {"hose": "linear"}),
    "materials_plain_tire": ("materials", {"swivel": "contact_point"}),
    "materials_valve": ("materials", VALVE),
    "materials_port": ("materials", {"compensator_sensing": "port"}),
    "default_sensing": ("default", {"compensator_sensing": "load_sensing_line"}),
    "default_air": ("default", {"gas": "dissolving"}),
    "default_hose": ("default", {"hose": "viscoelastic"}),
    "default_tire": ("default", {"swivel": "bore_torque"}),
}
"""Family and options that differ from it, by name; the first ones are the families."""


def machine_of(structure: str) -> Machine:
    """The data sheets' machine with the measured valve table and the laws of a structure."""
    family, options = STRUCTURES[structure]
    return measured_curve(Machine.load("aoro_datasheet").with_default_priors().with_laws(family, **options))


def uncertain(structure: str, machine: Machine) -> list[str]:
    """Keys of parameters that may be searched: uncertain ones, and those of the chosen options."""
    family, options = STRUCTURES[structure]
    chosen = {**FAMILIES[family], **options}
    own = {key for law, option in chosen.items() for key in LAWS[law].parameters.get(option, ())}
    return [
        p.key
        for p in machine.parameters()
        if (p.role in ("nuisance", "both") or p.key in own) and p.range[0] < p.range[1]
    ]


def felt(keys: list[str], changes: NDArray[np.float64], least: float) -> list[str]:
    """Those of ``keys`` that move a row of ``changes`` (R, d) by more than ``least``; NaN is no change."""
    return list(compress(keys, np.nanmax(np.abs(changes), axis=0, initial=0.0) > least))
