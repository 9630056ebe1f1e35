"""Machines with effects of asked sizes, and the effects' magnitudes on machines."""

import math
from collections.abc import Mapping
from types import ModuleType
from typing import Any

from scipy.optimize import brentq, newton

from .catalogue import EFFECTS, Effect
from .families import family_of

Made = Mapping[str, float]


def measure(effect: str, family: str, machine: Made) -> float:
    """Operational magnitude of an effect on a machine."""
    module = family_of(family)
    return EFFECTS[effect].measure(module, module.derived(machine))


def _turned(one: Effect, module: ModuleType, effect: str, machine: Made, knob: float) -> dict[str, float]:
    """A machine with the knob of an effect turned: scaled by exp(knob), or shifted by knob."""
    other = dict(machine)
    for name, exponent in (module.KNOBS.get(effect) or one.scale).items():
        other[name] = other[name] * math.exp(exponent * knob)
    for name, weight in one.shift.items():
        other[name] = other.get(name, 0.0) + weight * knob
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
    one, module = EFFECTS[effect], family_of(family)
    if size == 0.0:
        return dict(machine)
    healthy = one.measure(module, module.derived(machine))
    goal = healthy * (1.0 + size) if one.relative else healthy + size

    def off(knob: float) -> float:
        return one.measure(module, module.derived(_turned(one, module, effect, machine, knob))) - goal

    if one.shift:  # linear in the knob, or nearly so
        knob: Any = newton(off, 0.0, x1=size, tol=1e-13, rtol=1e-12)
        return _turned(one, module, effect, machine, float(knob))
    reach, start = 0.25, off(0.0)
    while off(reach) * start > 0.0 and off(-reach) * start > 0.0:
        reach *= 1.5
        if reach > 12.0:
            raise ValueError(f"{effect} of {size} {one.unit} is out of what family {family} can be")
    end = reach if off(reach) * start <= 0.0 else -reach
    knob = brentq(off, min(0.0, end), max(0.0, end), xtol=1e-13)
    return _turned(one, module, effect, machine, knob)


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
