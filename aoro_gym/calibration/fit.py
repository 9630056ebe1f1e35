"""Bounded nonlinear least squares over a population of twins.

Gauss–Newton steps within the bounds and within a box around the point: each is a linear least-squares problem with
bounds, solved by SciPy (``lsq_linear``: Branch, Coleman, Li, SIAM J. Sci. Comput. 21, 1999). Twins are cheap side by
side: a Jacobian is one launch with a twin a free parameter, and the steps of boxes of all sizes are another, so that no
trust region has to be guessed. From the data-sheet machine this ended at 14.5 on the published figures, where
``least_squares`` had ended at 42.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear
from scipy.stats import qmc

from aoro_gym.log import write_whole

STEP = 0.02
"""Finite-difference step in the unit cube: large against float32 noise, small against the curvature."""

FAILED = 20.0
"""Residual of a figure that does not exist, for example because a turn never ended."""

Residuals = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Points (N, d) → residuals (R, N) in standard deviations; NaN where there is none."""

Progress = Callable[[str, float], None]
"""Called with a sentence and the share in [0, 1] that is done."""


BOXES = (0.01, 0.03, 0.1, 0.2, 0.4)
"""Half widths, in the unit cube, of the boxes within which a step is tried."""

ENOUGH = 1e-3
"""A step that lowers the cost by less than this share ends a search."""


@dataclass(frozen=True)
class Fit:
    """One converged search."""

    point: tuple[float, ...]
    residuals: tuple[float, ...]
    cost: float
    """Sum of squared residuals, priors included."""
    evaluations: int


def least_squares_fit(
    residuals: Residuals,
    prior: NDArray[np.float64],
    *,
    prior_weight: float,
    starts: int,
    population: int,
    max_iterations: int = 25,
    spread: float = 0.25,
    seed: int = 0,
    initial: NDArray[np.float64] | None = None,
    problem: str = "",
    checkpoint: Path | None = None,
    progress: Progress = lambda sentence, share: None,
) -> list[Fit]:
    """Fit from several starts, the best first.

    A seeded Sobol population around the prior is evaluated in one launch a batch; its best members are refined one by
    one. Every finished part is kept in ``checkpoint`` and not repeated when the same search is called again.

    Args:
        residuals: See :data:`Residuals`.
        prior: Point (d,) that the search is drawn to.
        prior_weight: Weight of the pull to the prior: residuals w (u − u₀)/0.25 are added, where 0.25 is the standard
            deviation that belongs to a range read as 95 %.
        starts: How many members are refined; the prior itself is always one.
        population: Size of the first population.
        max_iterations: Jacobians a start.
        spread: Standard deviation of the population around the prior in the unit cube.
        seed: Seed of the population.
        initial: Point (d,) to refine, in place of a population.
        problem: What is fitted to what; a checkpoint of another problem is not resumed.
        checkpoint: File (JSON) to resume from and to write to.
        progress: Called as parts end.
    """
    dimension = len(prior)
    signature = {
        "prior": [float(u) for u in prior], "prior_weight": prior_weight, "population": population, "seed": seed,
        "initial": None if initial is None else initial.tolist(), "spread": spread,
        "max_iterations": max_iterations, "problem": hashlib.sha256(problem.encode()).hexdigest(),
    }  # fmt: skip
    done = _resume(checkpoint, signature)

    def evaluate(points: NDArray[np.float64]) -> NDArray[np.float64]:
        found = residuals(np.atleast_2d(points))
        return np.clip(np.where(np.isfinite(found), found, FAILED), -FAILED, FAILED)

    if "ranking" not in done and initial is not None:
        done["ranking"] = [initial.tolist()]
    if "ranking" not in done:
        progress(f"evaluating a population of {population}", 0.0)
        normal = qmc.MultivariateNormalQMC(np.zeros(dimension), rng=np.random.default_rng(seed)).random(population)
        points = np.clip(prior + spread * normal, 0.01, 0.99)
        points[0] = np.clip(prior, 0.01, 0.99)
        batches = np.array_split(points, max(1, population // 64))
        cost = []
        for i, batch in enumerate(batches):
            cost.append(np.sum(np.square(evaluate(batch)), axis=0))
            progress(f"evaluating a population of {population}", 0.3 * (i + 1) / len(batches))
        ranking = np.argsort(np.concatenate(cost))
        ranking = np.concatenate([[0], ranking[ranking != 0]])[: max(starts, 1)]
        done["ranking"] = points[ranking].tolist()
        _save(checkpoint, signature, done)

    def refine(start: list[float], told: Callable[[int], None]) -> Fit:
        """Gauss–Newton within the bounds and a box around the point; boxes of all sizes are tried in one launch."""
        point = np.array(start)
        pull = prior_weight / 0.25
        step, reach, evaluations = STEP, np.array(BOXES), 0
        data = np.empty(0)
        for iteration in range(max_iterations):
            told(iteration)
            steps = np.where(point < 0.5, step, -step)
            found = evaluate(np.vstack([point, point + np.diag(steps)]))
            data = found[:, 0]
            slopes = np.vstack([(found[:, 1:] - found[:, :1]) / steps, np.eye(dimension) * pull])
            aim = -np.concatenate([data, pull * (point - prior)])
            tried = [point]
            for box in reach:
                ends = np.maximum(-point, -box) - 1e-9, np.minimum(1.0 - point, box) + 1e-9
                tried.append(np.clip(point + lsq_linear(slopes, aim, ends).x, 0.0, 1.0))
            found = evaluate(np.array(tried))
            evaluations += dimension + 1 + len(tried)
            costs = np.sum(np.square(found), axis=0) + np.sum(np.square(pull * (np.array(tried) - prior)), axis=1)
            best = int(np.argmin(costs))
            data, point = found[:, best], tried[best]
            if costs[best] > (1.0 - ENOUGH) * costs[0]:
                if step < STEP:
                    break
                step, reach = 0.5 * step, reach / 3.0  # once more, nearer: the figures are not quite smooth
        cost = float(np.sum(np.square(data)) + np.sum(np.square(pull * (point - prior))))
        return Fit(tuple(map(float, point)), tuple(map(float, data)), cost, evaluations)

    for i in range(len(done["fits"]), starts):

        def told(iteration: int, start: int = i) -> None:
            share = (start + iteration / max_iterations) / starts
            progress(f"start {start + 1} of {starts}, step {iteration + 1}", 0.3 + 0.7 * share)

        done["fits"].append(asdict(refine(done["ranking"][i], told)))
        _save(checkpoint, signature, done)
    progress("refined", 1.0)
    fits = [Fit(tuple(f["point"]), tuple(f["residuals"]), f["cost"], f["evaluations"]) for f in done["fits"]]
    return sorted(fits, key=lambda fit: fit.cost)


def _resume(checkpoint: Path | None, signature: dict) -> dict:
    if checkpoint is not None and checkpoint.exists():
        kept = json.loads(checkpoint.read_text(encoding="utf-8"))
        if kept.get("signature") == signature:
            return kept["done"]
    return {"fits": []}


def _save(checkpoint: Path | None, signature: dict, done: dict) -> None:
    if checkpoint is not None:
        write_whole(checkpoint, json.dumps({"signature": signature, "done": done}))
