"""Search for the valley in which a fit shall end, where slopes lead to a near one only: the cross-entropy method.

A machine that sways a tenth faster than its twin is a period ahead after ten, and twins halfway between them fit worse than
one that hardly sways. Slopes end there. A population does not: it is drawn, the best few say where the next is drawn, and so
on (Rubinstein, Methodology and Computing in Applied Probability 1, 1999).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aoro_gym.diagnosis.noise import Floats
from aoro_gym.diagnosis.problem import SWAY, ZEROS, Problem, Progress
from aoro_gym.diagnosis.replay import Variants

POPULATION, GENERATIONS = 96, 16
"""Machines of a generation, and how many there are."""
ELITE = 8
"""One in so many is among the best, around which the next generation is drawn."""
SPREAD, PLACES = 1.5, 0.2
"""Of the first generation: in prior standard deviations of nuisances, and of the places of effects."""
LAGGING = 0.4
"""Share of a generation's spread that is its forerunner's, lest it close in before it has arrived."""
SHRINKING = 0.8
"""What is left of that with every generation."""
LEADING = 0.3
"""Share of the very best in the middle of the next generation; the mean of the elite has the rest."""


class Population:
    """Machines of one hypothesis, drawn independently along the axes of the prior of its nuisances, and by place.

    Args:
        problem: Whose machine they are drawn around. A recording's own nuisances stay where they are.
        effects: Of the hypothesis.
        start: Nuisances (u,) and places (axes,) in the middle of the first generation; by default the machine's.
        size: Machines of a generation.
    """

    def __init__(
        self,
        problem: Problem,
        effects: Sequence[str] = (),
        start: tuple[Floats, Floats] | None = None,
        size: int = POPULATION,
    ):
        self.problem = problem
        self.size = size
        self.effects = tuple(effects)
        self._felt = felt = len(problem.felt)
        self._root = np.linalg.cholesky(np.linalg.inv(problem.precision[:felt, :felt]))
        nuisances, places = start or (np.zeros(len(problem.centre)), np.empty(0))
        self.best: tuple[Floats, Floats] = nuisances, places
        """Nuisances (u,) and places (axes,) that explain the recordings best."""
        self._middle = np.append(np.linalg.solve(self._root, nuisances[:felt]), places)
        self._spread = np.append(np.full(felt, SPREAD), np.full(len(places), PLACES))
        self._rng = np.random.default_rng(0)
        self._points, self._places = np.empty((0, 0)), np.empty((0, 0))

    def variants(self) -> Variants:
        """The next generation, the best one of the last among it."""
        felt, (low, high) = self._felt, self.problem.bounds
        drawn = self._middle + self._spread * self._rng.standard_normal((self.size - 1, len(self._middle)))
        nuisances, places = self.best
        self._points = np.tile(nuisances, (self.size, 1))
        self._points[1:, :felt] = np.clip(drawn[:, :felt] @ self._root.T, low[:felt], high[:felt])
        self._places = np.vstack([places, np.clip(drawn[:, felt:], 0.0, 1.0)])
        return self.problem.at(self._points, self.effects, self._places)

    def learn(self, misfit: Floats) -> None:
        """Take in the :func:`misfit` (N,) of the generation, less that by the prior."""
        total = misfit + np.einsum("ni,ij,nj->n", self._points, self.problem.precision, self._points)
        order = np.argsort(total)[: self.size // ELITE]
        self.best = self._points[order[0]], self._places[order[0]]
        along = np.linalg.solve(self._root, self._points[order, : self._felt].T).T
        elite = np.concatenate([along, self._places[order]], axis=1)
        self._middle = LEADING * elite[0] + (1.0 - LEADING) * elite.mean(axis=0)
        self._spread = (1.0 - LAGGING) * elite.std(axis=0) + LAGGING * SHRINKING * self._spread


def evolve(
    populations: Sequence[Population],
    generations: int = GENERATIONS,
    progress: Progress = lambda sentence, share: None,
) -> None:
    """Take ``populations``, of problems with the same recordings, through so many generations, in the same launches."""
    for generation in range(generations if populations else 0):
        progress("looking for the valley", generation / generations)
        problem = populations[0].problem
        found = misfit(problem, problem.simulate([one.variants() for one in populations]))
        ends = np.cumsum([one.size for one in populations])
        for one, mine in zip(populations, np.split(found, ends[:-1]), strict=True):
            one.learn(mine)


def misfit(problem: Problem, predicted: Floats) -> Floats:
    """−2 ln p (N,) of the recordings given stacked predictions (D, N) SI, but for a constant, where it is not known how far
    the twin errs in a channel of a recording::

        Σ n ln(mean (y − p)² + σ²)

    over channels and recordings, with σ of noise and zeros, and n samples far enough apart to be independent. Infinite where
    the simulation diverges.
    """
    square = np.square(problem.measured[:, None] - predicted)
    total = np.zeros(predicted.shape[1])
    ends = np.cumsum([len(part) for part in problem.split(problem.measured)])
    for (_, name), part in zip(problem.blocks, np.split(square, ends[:-1]), strict=True):
        floor = problem.noise[name].std ** 2 + ZEROS.get(name, 0.0) ** 2
        total += len(part) / SWAY * np.log(np.mean(part, axis=0) + floor)
    return np.where(np.isnan(total), np.inf, total)
