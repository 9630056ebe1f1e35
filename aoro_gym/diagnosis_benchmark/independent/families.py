"""The independent families: machines drawn from them, what effects change on them, their kernels and measuring."""

import importlib
import math
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any

import numpy as np
from scipy.optimize import newton

from . import measuring
from .catalogue import EFFECTS
from .group import Group, Made, Sampled
from .outside import OUTSIDE

FAMILIES = ("alder", "birch", "cedar")


class Independent(Group):
    """Families whose logger reads filtered signals, late by the delays of sensor and chain."""

    families = FAMILIES
    effects = EFFECTS
    outside = OUTSIDE
    settle = 0.15
    period = 0.01
    logged = (1, 2, 3, 4, 5, 6)
    reach = 12.0

    def family_of(self, name: str) -> ModuleType:
        if name not in FAMILIES:
            raise ValueError(f"family must be one of {', '.join(FAMILIES)}, not {name!r}")
        return importlib.import_module(f"{__package__}.{name}")

    def laws(self, family: str, kind: Any) -> Any:
        return importlib.import_module(f"{__package__}.laws.{family}")

    def turned(self, effect: str, family: str, machine: Made, knob: float) -> dict[str, float]:
        """A machine with the constants of an effect scaled by powers of exp(knob), or shifted by weights of it."""
        other, one = dict(machine), EFFECTS[effect]
        for name, exponent in (self.family_of(family).KNOBS.get(effect) or one.scale).items():
            other[name] = other[name] * math.exp(exponent * knob)
        for name, weight in one.shift.items():
            other[name] = other.get(name, 0.0) + weight * knob
        return other

    def known_knob(self, effect: str, size: float, off: Callable[[float], float]) -> float | None:
        if not EFFECTS[effect].shift:
            return None
        knob: Any = newton(off, 0.0, x1=size, tol=1e-13, rtol=1e-12)  # linear in the knob, or nearly so
        return float(knob)

    def sampling(self, machine: Made, times: np.ndarray, length: float, period: float) -> tuple[np.ndarray, np.ndarray]:
        others = times - machine["chain_delay"]
        return others - machine["angle_delay"], others

    def measured(
        self,
        family: str,
        signals: np.ndarray,
        runs: Sequence[Sampled],
        rngs: Sequence[np.random.Generator],
        noise: bool,
    ) -> list[dict[str, np.ndarray]]:
        each = zip(signals, runs, rngs, strict=True)
        return [measuring.measured(one, run.other_times, run.machine, rng, noise) for one, run, rng in each]


GROUP = Independent()
"""All independent families."""
