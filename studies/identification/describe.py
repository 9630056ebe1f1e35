"""What fits predict, and how sure they are of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from aoro_gym.calibration.fit import costs, inward_steps, sound
from aoro_gym.calibration.published import LEVELS
from aoro_gym.simulation.key_figures import FIGURES
from studies.identification.bench import ALL, Bench, Model
from studies.identification.figures import OF_TURNS, REFERENCES, TRANSIENT, Found
from studies.identification.search import PULL, Job
from studies.identification.splits import ROW_NAMES, Split

DRAWS = 64
"""Machines that are drawn around a fit for the interval of what it predicts."""

Floats = NDArray[np.float64]


def numbers(values: Any, digits: int = 4) -> list[float | None]:
    """Numbers for JSON, None where there is none."""
    return [float(f"{value:.{digits}g}") if np.isfinite(value) else None for value in np.ravel(values)]


def unfitted(found: Found) -> dict[str, dict[str, float | None]]:
    """Mean error of the transient figures of one machine that was not fitted, by reference and level."""
    rows = [i for i, name in enumerate(FIGURES) if name in TRANSIENT]
    out = {}
    for reference in REFERENCES:
        errors = np.abs(found.errors(reference)[:, 0]).reshape(len(LEVELS), len(FIGURES))
        means = numbers(errors[:, rows].mean(axis=1))
        out[reference] = {f"{turn.signal_percent:g}": mean for turn, mean in zip(LEVELS, means, strict=True)}
    return out


def described(model: Model, split: Split, jobs: Sequence[Job], found: Sequence[Found]) -> dict[str, Any]:
    """Fits of one split, a seed each: the one of least cost in full, and scores and costs of all."""
    order = np.argsort([job.cost for job in jobs])
    best, one = jobs[order[0]], found[order[0]]
    point = np.array(best.point)
    data = split.residuals(one)[:, 0] / 2.0
    has_score = split.left_out != "nothing"
    scores = [numbers(split.score(found[i]) if has_score else np.nan)[0] for i in order]
    at_bounds = dict(set(model.space.at_bounds(point)) - set(model.space.at_bounds(model.prior)))
    return {
        "reference": split.reference, "left_out": split.left_out, "score": scores[0], "scores": scores,
        "costs": numbers([jobs[i].cost for i in order]), "seeds": [jobs[i].seed for i in order],
        "iterations": [jobs[i].iteration for i in order], "at_its_end": [jobs[i].ended for i in order],
        "rms_miss_tolerances": numbers(np.sqrt(np.mean(np.square(data))))[0],
        "largest_miss_tolerances": numbers(np.max(np.abs(data)))[0],
        "at_bounds": {key: at_bounds[key] for key in sorted(at_bounds)},
        "errors": numbers(one.errors(split.reference)[:, 0]),
        "misses_tolerances": dict(zip(ROW_NAMES, numbers(one.misses(split.reference)[:, 0]), strict=True)),
        "point": numbers(point, 6),
        **({} if has_score else {"points": [numbers(jobs[i].point, 4) for i in order]}),
    }  # fmt: skip


def intervals(wanted: Sequence[tuple[Model, Split, dict[str, Any]]], bench: Bench) -> None:
    """Add to each result what its fit leaves open: the spread of machines that fit as well, and of what they predict.

    Around a fit the posterior is drawn by its Jacobian (Laplace), and machines are kept whose cost is not beyond that of the
    fit by more than the 95 % quantile of chi-squared with one degree a parameter.
    """
    points = [np.array(result["point"]) for _, _, result in wanted]
    jacobians, deviations = [], []
    asked = []
    for (model, _, _), point in zip(wanted, points, strict=True):
        asked.append((model.name, np.vstack([point, point + np.diag(inward_steps(point))]), ALL))
    for (_, split, _), point, found in zip(wanted, points, bench.found(asked), strict=True):
        rows = sound(split.residuals(found))
        jacobian = (rows[:, 1:] - rows[:, :1]) / inward_steps(point)
        values, vectors = np.linalg.eigh(jacobian.T @ jacobian + PULL**2 * np.eye(len(point)))
        jacobians.append(vectors / np.sqrt(values))
        deviations.append(np.linalg.norm(jacobians[-1], axis=1))
    rng = np.random.default_rng(0)
    drawn = [
        np.clip(np.vstack([point, point + rng.standard_normal((DRAWS, len(point))) @ factor.T]), 0.0, 1.0)
        for point, factor in zip(points, jacobians, strict=True)
    ]
    found = bench.found(
        [(model.name, one, ALL) for (model, _, _), one in zip(wanted, drawn, strict=True)], sampled=True
    )
    for (model, split, result), own, one, std in zip(wanted, drawn, found, deviations, strict=True):
        cost = costs(sound(split.residuals(one)), own, model.prior, np.full(len(model.prior), PULL))
        kept = np.flatnonzero(cost <= cost[0] + chi2.ppf(0.95, len(model.prior)))
        errors = one.errors(split.reference)[:, kept]
        known = split.left_out != "nothing"
        rows = split.predicted[:OF_TURNS] if known else np.ones(OF_TURNS, dtype=bool)
        with np.errstate(all="ignore"):
            result["interval"] = {
                "machines": len(kept), "of": DRAWS + 1,
                "score": numbers(np.nanquantile(split.score(one)[kept], (0.05, 0.5, 0.95))) if known else None,
                "mean_prediction_score": numbers(np.mean(np.abs(np.nanmean(errors[rows], axis=1))))[0],
                "errors_5": numbers(np.nanquantile(errors, 0.05, axis=1)),
                "errors_95": numbers(np.nanquantile(errors, 0.95, axis=1)),
                "std_of_prior": numbers(PULL * std),
            }  # fmt: skip
