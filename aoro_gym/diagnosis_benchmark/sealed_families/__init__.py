"""Sealed families: machines of three more families of laws, for one seal of a diagnosis only.

Written from literature and the published vehicle, apart from the twin and from the other plants, whose integrator and plane
kinematics alone they share. What an effect physically is differs from family to family; what is measured of it does not.
"""

from . import recording
from .catalogue import EFFECTS, Effect
from .effects import apply, magnitudes, measure
from .families import FAMILIES, another_day, machine, nominal
from .outside import FAMILIAR, OUTSIDE, Outside
from .recording import Run, record, trace

__all__ = [
    "EFFECTS",
    "FAMILIAR",
    "FAMILIES",
    "OUTSIDE",
    "Effect",
    "Outside",
    "Run",
    "another_day",
    "apply",
    "machine",
    "magnitudes",
    "measure",
    "nominal",
    "record",
    "recording",
    "trace",
]
