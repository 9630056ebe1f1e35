"""The component families: machines drawn from them, what effects change on them, their kernels and measuring."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from aoro_gym.diagnosis_benchmark.independent.group import Group, Made, Sampled

from . import measuring
from .catalogue import EFFECTS
from .outside import OUTSIDE
from .parts import FAMILIES, Family, family_of, laws_of

SHIFTED = {"oil_temperature": "temperature", "payload": "payload", "ground_slope": "slope_angle"}
"""Constants that an effect shifts by its size."""
BENT = {"fir": "loading", "hazel": "eccentricity", "maple": "rail_error", "oak": "imbalance", "larch": "linkage",
        "aspen": "rod_error", "pine": "slide_error", "yew": "track_wear"}  # fmt: skip
"""Constants of the joint sensor that its gain shifts."""


class Component(Group):
    """Families whose measuring starts from exact signals on a grid of 1 ms."""

    families = FAMILIES
    effects = EFFECTS
    outside = OUTSIDE
    settle = 0.2
    period = measuring.GRID
    logged = (7, 9, 10, 11, 4, 5, 6)
    reach = 40.0

    def family_of(self, name: str) -> Family:
        return family_of(name)

    def laws(self, family: str, kind: Any) -> Any:
        return laws_of(family, kind)

    def turned(self, effect: str, family: str, machine: Made, knob: float) -> dict[str, float]:
        """A machine with the constants of an effect scaled by powers of exp(knob), or shifted by the knob."""
        other, parts = dict(machine), family_of(family).parts
        if effect in SHIFTED:
            other[SHIFTED[effect]] += knob
        elif effect == "sensor_gain" and parts["angle"] in BENT:
            other[BENT[parts["angle"]]] += knob
        else:
            for name, power in family_of(family).REALISED[effect].items():
                other[name] *= math.exp(power * knob)
        return other

    def known_knob(self, effect: str, size: float, off: Callable[[float], float]) -> float | None:
        return size if effect in SHIFTED else None

    def sampling(self, machine: Made, times: np.ndarray, length: float, period: float) -> tuple[np.ndarray, np.ndarray]:
        fine = np.arange(math.ceil(length / period - 1e-9)) * period
        return fine, fine

    def command(self, family: str, values: np.ndarray, machine: Mapping[str, float]) -> np.ndarray:
        return measuring.command(family_of(family).parts["command"], values, machine)

    def measured(
        self,
        family: str,
        signals: np.ndarray,
        runs: Sequence[Sampled],
        rngs: Sequence[np.random.Generator],
        noise: bool,
    ) -> list[dict[str, np.ndarray]]:
        parts = family_of(family).parts
        each = zip(signals, runs, rngs, strict=True)
        return [measuring.measured(parts, one[:, 1:], run.times, run.machine, rng, noise) for one, run, rng in each]


GROUP = Component()
"""All component families."""
