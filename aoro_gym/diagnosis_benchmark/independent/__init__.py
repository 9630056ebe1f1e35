"""Independent plants: machines of three families of laws, written from literature alone, that stand in for real ones.

They judge a diagnosis on data that it has no model of. A family's laws are device code in double precision
(``laws``), its constants have ranges and sources, every effect has an operational magnitude, and a logger at 100
Hz records what it sees.
"""

from .catalogue import EFFECTS, Effect
from .effects import apply, magnitudes, measure
from .families import FAMILIES, another_day, machine, nominal
from .outside import OUTSIDE, Outside
from .recording import Recorded, Run, record, trace

__all__ = [
    "EFFECTS",
    "FAMILIES",
    "OUTSIDE",
    "Effect",
    "Outside",
    "Recorded",
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
