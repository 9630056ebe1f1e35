"""The component families: machines drawn from them, what effects change on them, their kernels and measuring."""

import importlib
import math
from collections.abc import Callable, Mapping, Sequence
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from aoro_gym.diagnosis_benchmark.independent.group import Group, Made, Sampled

from . import measuring
from .catalogue import EFFECTS
from .outside import OUTSIDE

FAMILIES = ("elm", "fir", "hazel")
SHIFTED = {"oil_temperature": "temperature", "payload": "payload", "ground_slope": "slope_angle"}
"""Constants that an effect shifts by its size."""
BENT = {"fir": "loading", "hazel": "eccentricity"}
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

    def family_of(self, name: str) -> ModuleType:
        if name not in FAMILIES:
            raise ValueError(f"family must be one of {', '.join(FAMILIES)}, not {name!r}")
        return importlib.import_module(f"{__package__}.{name}")

    def laws(self, family: str, kind: Any) -> Any:
        from .laws import assembly, places

        laws = importlib.import_module(f"{__package__}.laws.{family}")
        return SimpleNamespace(
            State=places.State,
            derivative=assembly.assemble(laws, kind),
            limit=laws.limit,
            start=laws.start,
            remembered=assembly.nothing_remembered,
            hydraulic_signals=laws.hydraulic_signals,
        )

    def turned(self, effect: str, family: str, machine: Made, knob: float) -> dict[str, float]:
        """A machine with the constants of an effect scaled by powers of exp(knob), or shifted by the knob."""
        other = dict(machine)
        if effect in SHIFTED:
            other[SHIFTED[effect]] += knob
        elif effect == "sensor_gain" and family in BENT:
            other[BENT[family]] += knob
        else:
            for name, power in self.family_of(family).REALISED[effect].items():
                other[name] *= math.exp(power * knob)
        return other

    def known_knob(self, effect: str, size: float, off: Callable[[float], float]) -> float | None:
        return size if effect in SHIFTED else None

    def sampling(self, machine: Made, times: np.ndarray, length: float, period: float) -> tuple[np.ndarray, np.ndarray]:
        fine = np.arange(math.ceil(length / period - 1e-9)) * period
        return fine, fine

    def command(self, family: str, values: np.ndarray, machine: Mapping[str, float]) -> np.ndarray:
        return measuring.command(family, values, machine)

    def measured(
        self,
        family: str,
        signals: np.ndarray,
        runs: Sequence[Sampled],
        rngs: Sequence[np.random.Generator],
        noise: bool,
    ) -> list[dict[str, np.ndarray]]:
        each = zip(signals, runs, rngs, strict=True)
        return [measuring.measured(family, one[:, 1:], run.times, run.machine, rng, noise) for one, run, rng in each]


GROUP = Component()
"""All component families."""
