"""Magnitudes of effects as axes of a search, and what effects do along them, interpolated between simulated nodes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from aoro_gym.diagnosis.noise import Floats
from aoro_gym.effects.effect import Effect, Magnitude

NODES = (0.05, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.0)
"""Magnitudes simulated on either side of ``none``: shares of the way to the end of the range."""


@dataclass(frozen=True)
class Axis:
    """One magnitude of one effect, searched between 0 and 1 over its range from where it counts as a cause, and simulated at
    some ``shares`` of the way from none to the ends."""

    effect: Effect
    index: int
    shares: tuple[float, ...] = NODES

    @property
    def magnitude(self) -> Magnitude:
        return self.effect.magnitudes[self.index]

    @cached_property
    def none(self) -> float:
        """Place of none, below 0 where not every deviation counts."""
        return float(self.place(self.magnitude.none))

    @property
    def low(self) -> float:
        """Magnitude at the place 0."""
        return self.magnitude.low if self.magnitude.least is None else self.magnitude.least

    def value(self, place: Floats | float) -> Floats:
        """Magnitude at ``place`` in [0, 1]."""
        low, high = self.low, self.magnitude.high
        z = np.asarray(place, dtype=np.float64)
        return low * (high / low) ** z if self.magnitude.scale == "log" else low + (high - low) * z

    def place(self, value: Floats | float) -> Floats:
        low, high = self.low, self.magnitude.high
        v = np.asarray(value, dtype=np.float64)
        return np.log(v / low) / np.log(high / low) if self.magnitude.scale == "log" else (v - low) / (high - low)

    @cached_property
    def nodes(self) -> Floats:
        """Places that are simulated; denser near ``none``."""
        shares = np.array(self.shares)
        below = self.none - self.none * shares if self.none > 1e-9 else np.empty(0)
        above = self.none + (1.0 - self.none) * shares if self.none < 1.0 - 1e-9 else np.empty(0)
        return np.sort(np.concatenate([below, above]))

    @cached_property
    def _basis(self) -> tuple[CubicSpline, int]:
        places = np.sort(np.append(self.nodes, self.none))
        return CubicSpline(places, np.eye(len(places))), int(np.searchsorted(places, self.none))

    def spline(self, place: Floats | float, derivative: int = 0) -> Floats:
        """Weights (…, nodes) of the shifts at the nodes in the shift at ``place``; that at ``none`` is zero."""
        basis, where = self._basis
        return np.delete(basis(place, derivative), where, axis=-1)


def axes_of(effect: Effect, shares: tuple[float, ...] = NODES) -> list[Axis]:
    return [Axis(effect, index, shares) for index in range(len(effect.magnitudes))]
