"""Machines of the sealed families with effects of asked sizes, and the effects' magnitudes on machines."""

import math
from collections.abc import Mapping

from scipy.optimize import brentq

from .catalogue import EFFECTS
from .families import family_of

Made = Mapping[str, float]

SHIFTED = {"oil_temperature": "temperature", "payload": "payload", "ground_slope": "slope_angle"}
"""Constants that an effect shifts by its size."""
BENT = {"fir": "loading", "hazel": "eccentricity"}
"""Constants of the joint sensor that its gain shifts."""
REACH = 40.0
"""Largest logarithm of a constant's change."""


def measure(effect: str, family: str, machine: Made) -> float:
    """Operational magnitude of an effect on a machine."""
    module = family_of(family)
    return EFFECTS[effect].measure(module, module.derived(machine))


def _turned(effect: str, family: str, machine: Made, knob: float) -> dict[str, float]:
    """A machine with the constants of an effect scaled by powers of exp(knob), or shifted by the knob."""
    other = dict(machine)
    if effect == "sensor_gain" and family in BENT:
        other[BENT[family]] += knob
        return other
    for name, power in family_of(family).REALISED[effect].items():
        other[name] *= math.exp(power * knob)
    return other


def apply(effect: str, family: str, machine: Made, size: float) -> dict[str, float]:
    """A machine with an effect of a signed size.

    Args:
        effect: Id of the effect.
        family: Family of the machine.
        machine: Constants of the healthy machine.
        size: Change of the effect's magnitude, in its unit.

    Raises:
        ValueError: If no setting of the machine has that magnitude.
    """
    if effect not in EFFECTS:
        raise ValueError(f"no effect {effect!r}; there are {', '.join(EFFECTS)}")
    if size == 0.0:
        return dict(machine)
    if effect in SHIFTED:
        return dict(machine) | {SHIFTED[effect]: machine[SHIFTED[effect]] + size}
    healthy = measure(effect, family, machine)
    goal = healthy * (1.0 + size) if EFFECTS[effect].relative else healthy + size

    def off(knob: float) -> float:
        return measure(effect, family, _turned(effect, family, machine, knob)) - goal

    start, reach = off(0.0), 0.25
    while off(reach) * start > 0.0 and off(-reach) * start > 0.0:
        reach *= 1.5
        if reach > REACH:
            raise ValueError(f"{effect} of {size} {EFFECTS[effect].unit} is out of what family {family} can be")
    end = reach if off(reach) * start <= 0.0 else -reach
    knob = brentq(off, min(0.0, end), max(0.0, end), xtol=1e-13)
    return _turned(effect, family, machine, float(knob))  # pyright: ignore[reportArgumentType]


def apply_all(family: str, machine: Made, effects: Mapping[str, float]) -> dict[str, float]:
    """A machine with several effects, one after the other in the order of the catalogue."""
    unknown = set(effects) - set(EFFECTS)
    if unknown:
        raise ValueError(f"no effect {sorted(unknown)[0]!r}; there are {', '.join(EFFECTS)}")
    made = dict(machine)
    for effect in EFFECTS:
        if effects.get(effect):
            made = apply(effect, family, made, effects[effect])
    return made


def magnitudes(family: str, machine: Made) -> dict[str, float]:
    """Magnitudes of all effects on a machine."""
    return {effect: measure(effect, family, machine) for effect in EFFECTS}
