"""Bounded nonlinear least squares over a population of twins.

SciPy's trust-region reflective algorithm (Branch, Coleman, Li, SIAM J. Sci. Comput. 21, 1999) drives; every Jacobian is
one population: one twin a free parameter, all in one launch.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import qmc

STEP = 0.02
"""Finite-difference step in the unit cube: large against float32 noise, small against the curvature."""

FAILED = 20.0
"""Residual of a figure that does not exist, for example because a turn never ended."""

Residuals = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Points (N, d) → residuals (R, N) in standard deviations; NaN where there is none."""

Progress = Callable[[str, float], None]
"""Called with a sentence and the share in [0, 1] that is done."""


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
    max_iterations: int = 40,
    spread: float = 0.25,
    seed: int = 0,
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
        problem: What is fitted to what; a checkpoint of another problem is not resumed.
        checkpoint: File (JSON) to resume from and to write to.
        progress: Called as parts end.
    """
    dimension = len(prior)
    signature = {
        "prior": [float(u) for u in prior], "prior_weight": prior_weight, "population": population, "seed": seed,
        "spread": spread, "max_iterations": max_iterations, "problem": hashlib.sha256(problem.encode()).hexdigest(),
    }  # fmt: skip
    done = _resume(checkpoint, signature)

    def full(point: NDArray[np.float64], data: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.concatenate([data, prior_weight * (point - prior) / 0.25])

    def evaluate(points: NDArray[np.float64]) -> NDArray[np.float64]:
        found = residuals(np.atleast_2d(points))
        return np.clip(np.where(np.isfinite(found), found, FAILED), -FAILED, FAILED)

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

    for i in range(len(done["fits"]), starts):
        evaluations = 0

        def fun(point: NDArray[np.float64]) -> NDArray[np.float64]:
            nonlocal evaluations
            evaluations += 1
            return full(point, evaluate(point)[:, 0])

        def jacobian(point: NDArray[np.float64]) -> NDArray[np.float64]:
            nonlocal evaluations
            evaluations += dimension + 1
            steps = np.where(point < 0.5, STEP, -STEP)
            found = evaluate(np.vstack([point, point + np.diag(steps)]))
            slopes = (found[:, 1:] - found[:, :1]) / steps
            return np.vstack([slopes, np.eye(dimension) * prior_weight / 0.25])

        progress(f"refining start {i + 1} of {starts}", 0.3 + 0.7 * i / starts)
        result = least_squares(
            fun, done["ranking"][i], cast(Any, jacobian), bounds=(0.0, 1.0), method="trf", ftol=1e-4, xtol=1e-4, gtol=1e-6,
            max_nfev=max_iterations,
        )  # fmt: skip
        data = result.fun[: len(result.fun) - dimension]
        fit = Fit(tuple(map(float, result.x)), tuple(map(float, data)), float(2.0 * result.cost), evaluations)
        done["fits"].append(asdict(fit))
        _save(checkpoint, signature, done)
        progress(f"refining start {i + 1} of {starts}", 0.3 + 0.7 * (i + 1) / starts)
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
        whole = json.dumps({"signature": signature, "done": done})
        partial = checkpoint.with_suffix(".partial")
        partial.write_text(whole, encoding="utf-8")
        partial.replace(checkpoint)
