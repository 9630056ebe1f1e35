"""The most probable point that has all figures within their tolerances.

A range is read as 95 % of a normal distribution around the data sheet's value, so the most probable point u of the unit
cube minimises |(u − u₀)/0.25|² where every residual, in half tolerances, obeys |r(u)| ≤ :data:`LIMIT`. Least squares
answers another question: they pay with improbable parameters for figures nearer than they are known.

Sequential quadratic programming with an exact L1 penalty (R. Fletcher, *Practical Methods of Optimization*, 1987, ch. 14;
J. Nocedal, S. J. Wright, *Numerical Optimization*, 2006, §§ 18.1–18.5): figures are taken as linear within a box, which
leaves a convex quadratic program, elastic, so that it has a solution where none has all figures; a second-order correction
repeats it with the residuals found where its step ends; and the point of least |(u − u₀)/0.25|² + :data:`PENALTY` Σ
max(|r| − LIMIT, 0) is the next one. As in :mod:`.fit`, a Jacobian is one launch of twins and boxes of all sizes are another.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from aoro_gym.calibration.fit import ENOUGH, Checkpoint, Fit, Residuals, Search, Tried
from aoro_gym.calibration.progress import Work
from aoro_gym.calibration.space import PRIOR_STD
from aoro_gym.execution.digest import digest

LIMIT = 1.88
"""Largest residual, in half tolerances: 0.06 of a tolerance are left for rounding to six digits and to samples, between
which the narrow first peak at 50 % signal has 0.05 of its tolerance."""

PENALTY = 100.0
"""Of a residual beyond the limit, for a half tolerance. Exact where no figure's multiplier is larger: then the point of
least penalised cost is the most probable one that has all figures."""

CORRECTIONS = 3
"""Second-order corrections of a step: without them only the smallest steps keep to curved figures (Maratos' effect)."""

BOXES = (0.003, 0.01, 0.03, 0.1, 0.3)
"""Half widths, in the unit cube, of the boxes within which a step is tried."""

DIFFERENCE = 0.01
"""Finite-difference step in the unit cube: half of :mod:`.fit`'s, since a step along its limits needs nearer slopes."""

MOST_STEPS = 60
"""Jacobians of a search at most."""


def most_probable_fit(
    residuals: Residuals,
    prior: NDArray[np.float64],
    initial: NDArray[np.float64],
    *,
    limit: float = LIMIT,
    max_iterations: int = MOST_STEPS,
    problem: str = "",
    checkpoint: Path | None = None,
    work: Work | None = None,
) -> Fit:
    """The point nearest to ``prior`` that has no residual beyond ``limit``, or else one of least sum beyond it.

    The figures are curved, so that a search ends where its start leads; of several starts the best end is returned. The cost
    of the fit is the penalised one; without penalty it is :func:`prior_cost`. Every step is kept in ``checkpoint``: the same
    search, called again, goes on there and finds the same.

    Args:
        residuals: See :data:`aoro_gym.calibration.fit.Residuals`; in half tolerances.
        prior: Most probable point (d,) before any figure.
        initial: Point (d,) to start from, best near where figures are met, or several (S, d).
        limit: Largest residual.
        max_iterations: Jacobians a start at most.
        problem: Digest of what is fitted to what; a checkpoint of another problem is not resumed.
        checkpoint: File (JSON) to resume from and to write to.
        work: Told as searches begin; ``residuals`` count their work themselves.

    Raises:
        ValueError: the checkpoint is damaged.
    """
    starts = np.clip(np.atleast_2d(initial), 0.0, 1.0)
    signature = digest(prior, initial, limit, max_iterations, problem, DIFFERENCE, BOXES, ENOUGH, PENALTY, PRIOR_STD)
    kept = Checkpoint(checkpoint, signature)
    search = _ProbableSearch(residuals, prior, 1.0, max_iterations, kept, work or Work(), BOXES, DIFFERENCE, limit)
    for index, start in enumerate(starts.tolist()):
        of = f" from start {index + 1} of {len(starts)}" if len(starts) > 1 else ""
        search.refine(index, start, f"probable {index + 1}", f"the most probable machine{of}")
    return min(kept.fits, key=lambda fit: fit.cost)


def prior_cost(points: NDArray[np.float64], prior: NDArray[np.float64]) -> NDArray[np.float64]:
    """|(u − u₀)/0.25|² (...) of points u (..., d): minus twice the logarithm of their probability, but for a constant."""
    return np.sum(np.square((points - prior) / PRIOR_STD), axis=-1)


@dataclass
class _ProbableSearch(Search):
    """One search; see :func:`most_probable_fit`."""

    limit: float = LIMIT

    def tried(
        self, reach: NDArray[np.float64], slopes: NDArray[np.float64], residuals: NDArray[np.float64],
        point: NDArray[np.float64],
    ) -> Tried:  # fmt: skip
        """Where the quadratic program of each box leads, and where it does once corrected."""
        points, found = point[None], residuals[:, None]
        there = np.tile(residuals, (len(reach), 1))  # of the linear figures at the point, by box
        for _ in range(1 + CORRECTIONS):
            ends = np.array([
                elastic_step(slopes, one, point, self.prior, box, self.limit)
                for box, one in zip(reach, there, strict=True)
            ])  # fmt: skip
            seen = self.evaluate(ends)
            there = seen.T - (ends - point) @ slopes.T
            points, found = np.vstack([points, ends]), np.hstack([found, seen])
        beyond = np.sum(np.maximum(np.abs(found) - self.limit, 0.0), axis=0)
        return points, found, prior_cost(points, self.prior) + PENALTY * beyond


def elastic_step(
    slopes: NDArray[np.float64],
    residuals: NDArray[np.float64],
    point: NDArray[np.float64],
    prior: NDArray[np.float64],
    box: float,
    limit: float,
) -> NDArray[np.float64]:
    """The most probable point (d,) of a box, where residuals are linear and those beyond the limit are penalised.

    Args:
        slopes: Jacobian (R, d).
        residuals: (R,) at ``point``.
        point: (d,), the box's centre.
        prior: (d,) most probable point.
        box: Half width of the box, which the unit cube cuts.
        limit: Largest residual.
    """
    size, count = len(point), len(residuals)
    # in standard deviations from the prior the objective's Hessian is the unit matrix that SLSQP begins with
    slopes, at = PRIOR_STD * slopes, residuals + slopes @ (prior - point)
    begin = (point - prior) / PRIOR_STD
    low = (np.maximum(point - box, 0.0) - prior) / PRIOR_STD
    high = (np.minimum(point + box, 1.0) - prior) / PRIOR_STD
    rows = np.block([[slopes, -np.eye(count)], [-slopes, -np.eye(count)]])
    ends = np.concatenate([limit - at, limit + at])
    found = minimize(
        lambda x: 0.5 * x[:size] @ x[:size] + 0.5 * PENALTY * np.sum(x[size:]),
        np.concatenate([begin, np.maximum(np.abs(residuals) - limit, 0.0)]),
        jac=lambda x: np.concatenate([x[:size], np.full(count, 0.5 * PENALTY)]),
        method="SLSQP",
        bounds=[*zip(low, high, strict=True), *[(0.0, None)] * count],
        constraints={"type": "ineq", "fun": lambda x: ends - rows @ x, "jac": lambda x: -rows},
        options={"maxiter": 200, "ftol": 1e-9},
    )
    return np.clip(prior + PRIOR_STD * np.clip(found.x[:size], low, high), 0.0, 1.0)
