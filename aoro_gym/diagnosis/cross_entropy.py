"""Search for the valley in which a fit shall end, where slopes lead to a near one only: the cross-entropy method.

A machine that sways a tenth faster than its twin is a period ahead after ten, and twins halfway between them fit worse than
one that hardly sways. Slopes end there. A population does not: it is drawn, the best few say where the next is drawn, and so
on (Rubinstein, Methodology and Computing in Applied Probability 1, 1999).
"""

from __future__ import annotations

import numpy as np

from aoro_gym.diagnosis.noise import Floats
from aoro_gym.diagnosis.problem import SWAY, ZEROS, Problem, Progress

POPULATION, ELITE, GENERATIONS = 128, 16, 16
"""Machines of a generation, the best of them, around which the next is drawn, and how often."""
SPREAD = 1.5
"""Of the first generation, in prior standard deviations."""
LAGGING = 0.4
"""Share of a generation's spread that is its forerunner's, lest it close in before it has arrived."""
SHRINKING = 0.8
"""What is left of that with every generation."""
LEADING = 0.3
"""Share of the very best in the middle of the next generation; the mean of the elite has the rest."""


def explore(problem: Problem, progress: Progress = lambda sentence, share: None) -> Floats:
    """Nuisances (u,) that a population around the machine of a ``problem`` comes to."""
    rng = np.random.default_rng(0)
    felt, (low, high) = len(problem.felt), problem.bounds
    best = middle = np.zeros(len(low))
    spread = np.zeros(len(low))
    spread[:felt] = SPREAD
    for generation in range(GENERATIONS):
        progress("looking for the valley", generation / GENERATIONS)
        drawn = middle + spread * rng.standard_normal((POPULATION - 1, len(low)))
        points = np.clip(np.vstack([best, drawn]), low, high)
        elite = points[np.argsort(misfit(problem, points))[:ELITE]]
        best = elite[0]
        middle = LEADING * best + (1.0 - LEADING) * elite.mean(axis=0)
        spread = (1.0 - LAGGING) * elite.std(axis=0) + LAGGING * SHRINKING * spread
    return best


def misfit(problem: Problem, points: Floats) -> Floats:
    """−2 ln p (N,) of nuisances ``points`` (N, u), but for a constant, where it is not known how far the twin errs in a
    channel of a recording::

        Σ n ln(mean (y − p)² + σ²) + uᵀ P u

    over channels and recordings, with σ of noise and zeros, and n samples far enough apart to be independent. Infinite where
    the twin is lost.
    """
    square = np.square(problem.measured[:, None] - problem.simulate([problem.at(points)]))
    total = np.einsum("ni,ij,nj->n", points, problem.precision, points)
    ends = np.cumsum([len(part) for part in problem.split(problem.measured)])
    for (_, name), part in zip(problem.blocks, np.split(square, ends[:-1]), strict=True):
        floor = problem.noise[name].std ** 2 + ZEROS.get(name, 0.0) ** 2
        total += len(part) / SWAY * np.log(np.mean(part, axis=0) + floor)
    return np.where(np.isnan(total), np.inf, total)
