"""Which sizes explain later logs how well: costs over grids, from what effects do at a few nodes.

A signal of a log has the residual r = y − N φ − c d − o, of the measured change y, what effects do at nodes N with the
weights φ of their interpolation, the log's own clock c with its slopes d, and the signal's own zero o. Its error is of a
size that nobody knows, beyond that of noise σ, and wanders, so that a log holds few independent pieces n of it. With a
variance that is fitted, too, a block costs n/2 ln(1 + ⟨r²⟩/σ²): what one block shows very wrong does not rule the others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from aoro_gym.diagnosis.noise import Floats
from aoro_gym.diagnosis.recording import TICK
from aoro_gym.diagnosis.signatures import Nodes
from aoro_gym.units import BAR

CLOCK = 4e-3
"""Standard deviation [s] of the clocks of two logs against each other: samples are taken at instants of their own (E)."""
ZEROS = {"joint_angle": 1.1e-3, "engine_speed": 0.5}
"""Standard deviation [SI] of a zero from day to day (E); of pressures it is :data:`PRESSURE_ZERO`."""
PRESSURE_ZERO = 1.1 * BAR
"""The same of pressures (E)."""
PIECE = 4.0
"""Time [s] for which errors of twins and machines are alike (E): so that 90 % intervals hold the sizes of effects of
simulated days that often, on machines, under laws and with errors that no twin of the fit has."""
GRID = {1: 161, 2: 33, 3: 13, 4: 8}
"""Places of an axis on a grid, by the number of axes."""
ZOOMS = 3
"""Grids, each around what the last one left likely."""
LIKELY = 8.0
"""Cost above the least one up to which places are looked at more closely."""
SETTLING = 3
"""Rounds in which clocks and zeros get the weights of their blocks."""


@dataclass(frozen=True)
class Evidence:
    """Moments of B blocks over their samples; the columns are y, M nodes and the clock (K = M + 2).

    Attributes:
        logs: Number of each one's log (B,).
        squares: Mean products of columns (B, K, K).
        means: Means of columns (B, K).
        floors: Least variance of the residual [SI²] (B,).
        zeros: Standard deviation of its zero [SI] (B,).
        pieces: Independent ones (B,).
    """

    logs: NDArray[np.intp]
    squares: Floats
    means: Floats
    floors: Floats
    zeros: Floats
    pieces: Floats

    @classmethod
    def of(
        cls, logs: Sequence[int], columns: Sequence[Floats], floors: Sequence[float], zeros: Sequence[float]
    ) -> Evidence:
        """From columns (F, K) SI of every block."""
        return cls(
            np.array(logs),
            np.stack([one.T @ one / len(one) for one in columns]),
            np.stack([one.mean(axis=0) for one in columns]),
            np.array(floors),
            np.array(zeros),
            np.array([max(len(one) * TICK / PIECE, 1.0) for one in columns]),
        )

    def residuals(self, weights: Floats, scale: Floats) -> tuple[Floats, Floats]:
        """Mean squares (P, B) that the ``weights`` (P, M) of nodes leave and clocks (P, L) [s], where residuals have the
        variances ``scale`` (B,)."""
        v = np.concatenate([np.ones((len(weights), 1)), -weights], axis=1)
        share = self.pieces / scale
        taken = share / (share + self.zeros**-2)
        products = self.squares - taken[:, None, None] * self.means[:, :, None] * self.means[:, None, :]
        inner = np.stack([np.sum((v @ one[:-1, :-1]) * v, axis=1) for one in products], axis=1)
        slope, pace = v @ products[:, -1, :-1].T, products[:, -1, -1]
        member = self.logs[:, None] == np.arange(self.logs.max() + 1)
        clocks = ((share * slope) @ member) / ((share * pace) @ member + CLOCK**-2)
        own = clocks[:, self.logs]
        return np.maximum(inner - 2.0 * own * slope + own**2 * pace, 0.0), clocks

    def costs(self, weights: Floats, scale: Floats) -> Floats:
        """Costs (P, L) by log; see the module."""
        squares, clocks = self.residuals(weights, scale)
        member = self.logs[:, None] == np.arange(self.logs.max() + 1)
        blocks = 0.5 * self.pieces * np.log1p(squares / self.floors)
        return blocks @ member + 0.5 * np.square(clocks / CLOCK)


def zero_of(signal: str) -> float:
    """Standard deviation [SI] of a signal's zero."""
    return ZEROS.get(signal, PRESSURE_ZERO)


class Interpolation:
    """Weights of all nodes of some effects, one family of laws, at places on their axes."""

    def __init__(self, effects: Sequence[Nodes]):
        self._splines: list[tuple[CubicSpline | None, int]] = []
        self.ranges: list[tuple[float, float]] = []
        """Of the places on every axis, as far as machines can have them."""
        for nodes in effects:
            for axis, where in zip(nodes.axes, nodes.places, strict=True):
                knots = np.sort(np.append(where, axis.none))
                spline = CubicSpline(knots, np.eye(len(knots))) if len(where) else None
                self._splines.append((spline, int(np.searchsorted(knots, axis.none))))
                low, high = max(float(knots[0]), 0.0), min(float(knots[-1]), 1.0)
                self.ranges.append((low, max(low, high)))

    def __call__(self, places: Floats) -> Floats:
        """Weights (P, M) at ``places`` (P, axes)."""
        parts = [
            np.delete(spline(places[:, k]), none, axis=1) if spline else np.empty((len(places), 0))
            for k, (spline, none) in enumerate(self._splines)
        ]
        return np.concatenate(parts, axis=1)


@dataclass(frozen=True)
class Weighed:
    """Places (P, axes) on a grid that holds all that is likely, their costs (P,), and the log of a cell's share of the whole
    range."""

    places: Floats
    costs: Floats
    cell: float

    @property
    def best(self) -> Floats:
        return self.places[int(np.argmin(self.costs))]

    @property
    def least(self) -> float:
        return float(self.costs.min())

    @property
    def evidence(self) -> float:
        """Log of the mean of exp(−cost) over the whole range."""
        highest = -self.least
        return highest + float(np.log(np.sum(np.exp(-self.costs - highest)))) + self.cell


Prior = Callable[[Floats], Floats]
"""Costs (P,) of places (P, axes) by what is known of sizes beforehand."""


def settled(evidence: Evidence, interpolation: Interpolation, prior: Prior) -> Floats:
    """Variances (B,) of the residuals at the best place, by which clocks and zeros are weighed."""
    whole = _grid(interpolation.ranges)
    weights, known = interpolation(whole), prior(whole)
    scale = evidence.floors + 0.3 * evidence.squares[:, 0, 0]
    for _ in range(SETTLING):
        best = int(np.argmin(evidence.costs(weights, scale).sum(axis=1) + known))
        scale = evidence.floors + evidence.residuals(weights[best : best + 1], scale)[0][0]
    return scale


def weigh(
    evidence: Evidence, interpolation: Interpolation, prior: Prior, scale: Floats, logs: NDArray[np.bool_]
) -> Weighed:
    """Costs of sizes by some of the logs, on grids that close in on what is likely.

    Args:
        evidence: Of all logs.
        interpolation: What the effects do at any place of their axes.
        prior: Cost of places beforehand.
        scale: Mean squares that residuals are weighed by.
        logs: Which of them count (L,).
    """
    ranges = interpolation.ranges
    boxes, whole = list(ranges), _volume(ranges)
    for zoom in range(ZOOMS):
        places = _grid(boxes)
        costs = evidence.costs(interpolation(places), scale) @ logs + prior(places)
        if zoom == ZOOMS - 1:
            break
        likely = places[costs < costs.min() + LIKELY]
        closer = []
        for k, (low, high) in enumerate(boxes):
            step = (high - low) / (GRID[len(boxes)] - 1)
            closer.append((max(likely[:, k].min() - step, low), min(likely[:, k].max() + step, high)))
        boxes = closer
    return Weighed(places, costs, _volume(boxes) - whole - float(np.log(len(places))))


def _grid(boxes: Sequence[tuple[float, float]]) -> Floats:
    """Places (P, axes)."""
    each = [np.linspace(low, high, GRID[len(boxes)]) for low, high in boxes]
    return np.stack([one.ravel() for one in np.meshgrid(*each, indexing="ij")], axis=1)


def _volume(boxes: Sequence[tuple[float, float]]) -> float:
    return float(np.sum([np.log(max(high - low, 1e-12)) for low, high in boxes]))
