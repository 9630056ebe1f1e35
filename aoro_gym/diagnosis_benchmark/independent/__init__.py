"""Independent plants: machines of three families of laws, written from literature alone, that stand in for real ones.

They judge a diagnosis on data that it has no model of. A family's laws are device code in double precision
(``laws``), its constants have ranges and sources, every effect has an operational magnitude, and a logger at 100
Hz records what it sees.
"""

from functools import partial

from . import recording
from .catalogue import EFFECTS, Effect
from .families import FAMILIES, GROUP
from .outside import FAMILIAR, OUTSIDE, Outside
from .recording import Run

machine, another_day, nominal = GROUP.machine, GROUP.another_day, GROUP.nominal
apply, measure, magnitudes = GROUP.apply, GROUP.measure, GROUP.magnitudes
record, trace = partial(recording.record, GROUP), partial(recording.trace, GROUP)

__all__ = [
    "EFFECTS",
    "FAMILIAR",
    "FAMILIES",
    "GROUP",
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
    "trace",
]
