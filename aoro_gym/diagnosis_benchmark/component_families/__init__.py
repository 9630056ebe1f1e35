"""Component families: machines of more families of laws, part by part on common states.

Written from literature and the published vehicle, apart from the twin and from the independent plants, whose integrator and
plane kinematics alone they share. What an effect physically is differs from family to family; what is measured of it does
not.
"""

from functools import partial

from aoro_gym.diagnosis_benchmark.independent import recording
from aoro_gym.diagnosis_benchmark.independent.outside import Outside
from aoro_gym.diagnosis_benchmark.independent.recording import Run

from .catalogue import EFFECTS, Effect
from .families import FAMILIES, GROUP
from .outside import FAMILIAR, OUTSIDE
from .parts import ALL_FAMILIES, SEALED

machine, another_day, nominal = GROUP.machine, GROUP.another_day, GROUP.nominal
apply, measure, magnitudes = GROUP.apply, GROUP.measure, GROUP.magnitudes
record, trace = partial(recording.record, GROUP), partial(recording.trace, GROUP)

__all__ = [
    "ALL_FAMILIES",
    "EFFECTS",
    "FAMILIAR",
    "FAMILIES",
    "GROUP",
    "OUTSIDE",
    "SEALED",
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
    "trace",
]
