"""Magnitudes of effects as axes of a search, and what effects do along them, interpolated between simulated nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import log_ndtr

from aoro_gym.diagnosis.noise import Floats
from aoro_gym.effects.effect import Effect, Magnitude

NODES = (0.05, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.0)
"""Magnitudes simulated on either side of ``none``: shares of the way to the end of the range."""
FEW_NODES = (0.1, 0.4, 1.0)
"""The same where many effects are simulated around many machines."""
FINE = 41
"""Places of the grid on which a search begins."""
STEPS = 20
"""Most Gauss–Newton steps of a search between the nodes."""
PRIOR_INFORMATION = 12.0
"""Of a place: its prior is uniform over [0, 1], whose variance is 1/12."""


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

    def reach(self, end: float) -> float:
        """How far off an ``end`` of the range, 0 or 1, is from none; negative where none lies beyond it."""
        return 1.0 - self.none if end else self.none

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
    def fine(self) -> Floats:
        """Places of the grid on which a search begins."""
        return np.linspace(0.0, 1.0, FINE)

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


class Shift:
    """Cost of the shift of some axes together, −2 φ·b + φᵀ G φ with the spline weights φ of their places.

    Args:
        axes: Of one effect or of two.
        gram: G (n, n) over all their nodes.
        linear: b (n,).
    """

    def __init__(self, axes: Sequence[Axis], gram: Floats, linear: Floats):
        self.axes = axes
        self.gram = gram
        self.linear = linear
        self.starts = np.cumsum([0, *(len(axis.nodes) for axis in axes)])

    def grid(self) -> tuple[float, ...]:
        """Best place of each axis for itself, on a grid."""
        return tuple(
            float(axis.fine[int(np.argmin(cost))]) for axis, cost in zip(self.axes, self._profiles, strict=True)
        )

    def valleys(self, most: int) -> list[tuple[float, ...]]:
        """Places from which all ways lead up, each axis for itself, on a grid: the deepest ``most``. Of several axes one may
        be all that there is."""
        minima = []
        for axis, cost in zip(self.axes, self._profiles, strict=True):
            ahead, behind = np.append(cost[1:], np.inf), np.append(np.inf, cost[:-1])
            found = np.flatnonzero((cost <= ahead) & (cost <= behind))
            alone = [(0.0, axis.none)] if len(self.axes) > 1 else []
            minima.append([*((float(cost[i]), float(axis.fine[i])) for i in found), *alone])
        ways = sorted(product(*minima), key=lambda way: sum(cost for cost, _ in way))
        return [tuple(place for _, place in way) for way in ways[:most]]

    def at_nodes(self) -> tuple[float, tuple[float, ...]]:
        """Least cost with one node of each effect, whose other axes are at none, and its places."""
        alone = np.diag(self.gram) - 2.0 * self.linear
        nodes = [(k, float(z)) for k, axis in enumerate(self.axes) for z in axis.nodes]
        effects = dict.fromkeys(axis.effect.id for axis in self.axes)
        first, *others = ([i for i, (k, _) in enumerate(nodes) if self.axes[k].effect.id == name] for name in effects)
        if others:
            (second,) = others
            both = alone[first][:, None] + alone[second] + 2.0 * self.gram[np.ix_(first, second)]
            i, j = np.unravel_index(int(np.argmin(both)), both.shape)
            cost, chosen = both[i, j], [first[i], second[j]]
        else:
            chosen = [first[int(np.argmin(alone[first]))]]
            cost = alone[chosen[0]]
        at = dict(nodes[i] for i in chosen)
        return float(cost), tuple(at.get(k, axis.none) for k, axis in enumerate(self.axes))

    @cached_property
    def _profiles(self) -> list[Floats]:
        """Cost on the grid of each axis for itself."""
        out = []
        for k, axis in enumerate(self.axes):
            mine = slice(self.starts[k], self.starts[k + 1])
            weights = axis.spline(axis.fine)
            out.append(
                np.einsum("fi,ij,fj->f", weights, self.gram[mine, mine], weights) - 2.0 * weights @ self.linear[mine]
            )
        return out

    def at(self, places: Floats) -> tuple[float, Floats, Floats]:
        """Cost, half its gradient (a,), and the information (a, a) at ``places`` (a,)."""
        weights = np.concatenate([axis.spline(z) for axis, z in zip(self.axes, places, strict=True)])
        slopes = np.zeros((len(self.axes), len(weights)))
        for k, (axis, z) in enumerate(zip(self.axes, places, strict=True)):
            slopes[k, self.starts[k] : self.starts[k + 1]] = axis.spline(z, 1)
        pull = self.gram @ weights - self.linear
        cost = float(weights @ (pull - self.linear))
        return cost, slopes @ pull, slopes @ self.gram @ slopes.T

    def descend(self, first: Sequence[float]) -> tuple[float, tuple[float, ...], Floats]:
        """Least cost near ``first``, its places, and the information there (Gauss–Newton within the ranges)."""
        places: Floats = np.array(first, dtype=np.float64)
        cost, gradient, information = self.at(places)
        reach = 1.0
        for _ in range(STEPS):
            damped = information + 1e-9 * np.eye(len(places))
            tried = np.clip(places - reach * np.linalg.solve(damped, gradient), 0.0, 1.0)
            new = self.at(tried)
            if new[0] < cost:
                done = cost - new[0] < 1e-2
                places, (cost, gradient, information) = tried, new
                reach = min(1.0, 2.0 * reach)
                if done:
                    break
            else:
                reach *= 0.3
        return cost, tuple(map(float, places)), information


def volume(places: Sequence[float], information: Floats, pull: Floats | None = None) -> float:
    """Log of the share of a uniform prior over the ranges that the normal around a best fit occupies (Laplace).

    Args:
        places: (a,) of the best fit within the ranges.
        information: (a, a) there.
        pull: (a,) half the fall of the cost a place would bring beyond the end of a range that holds it.
    """
    if not len(places):
        return 0.0
    z = np.array(places)
    covariance = np.linalg.inv(information + PRIOR_INFORMATION * np.eye(len(z)))
    std = np.sqrt(np.diag(covariance))
    beyond = np.zeros_like(z) if pull is None else pull * std
    low, high = -z / std - beyond, (1.0 - z) / std - beyond
    # of the two equal differences of normal distributions, that of the tails which do not cancel
    above = low > 0.0
    low, high = np.where(above, -high, low), np.where(above, -low, high)
    inside = log_ndtr(high) + np.log1p(-np.exp(np.minimum(log_ndtr(low) - log_ndtr(high), -1e-12)))
    return float(0.5 * np.linalg.slogdet(2.0 * np.pi * covariance)[1] + np.sum(inside + 0.5 * beyond**2))
