"""Means of what was driven, and their 95 % intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest, bootstrap, trim_mean

CONFIDENCE = 0.95
RESAMPLES = 9999
"""Of a bootstrap."""
Floats = NDArray[np.float64]


class Interval(NamedTuple):
    """Mean of a metric over the episodes, and where the mean of all possible episodes lies with 95 % confidence."""

    mean: float
    """Or another statistic, such as the mean of the middle half."""
    low95: float
    """NaN, as ``high95``, with fewer than two episodes; only of a rate one episode says something."""
    high95: float
    episodes: int | None = None
    """Over so many: those that have the metric."""
    bounds: int = 0
    """In so many of them it is a lower bound, and so is the mean."""


def interquartile_mean(values: Floats, axis: int = -1) -> Any:
    """Mean of the middle half of the values, those that are NaN left out: what a few wild episodes hardly move, and more
    exact than the median."""
    if not np.isnan(values).any():
        return trim_mean(values, 0.25, axis=axis)
    ordered = np.sort(np.moveaxis(values, axis, -1), axis=-1)  # NaN last
    count = np.isfinite(ordered).sum(axis=-1, keepdims=True)
    rank, cut = np.arange(ordered.shape[-1]), count // 4
    return np.mean(ordered, axis=-1, where=(rank >= cut) & (rank < count - cut))


def interval(values: Floats, *, rate: bool = False, statistic: Callable[..., Any] = np.mean) -> Interval:
    """Mean and 95 % interval of ``values`` (N,), those that are NaN left out.

    The interval is the percentiles' of a bootstrap over the episodes, always with the same draws; of a ``rate``, whose
    values are 0 and 1, it is the exact one of Clopper and Pearson.

    Args:
        values: One an episode, or a row (N, R) of its repeats, which are resampled together.
        rate: Whether they are 0 or 1.
        statistic: Instead of the mean, such as :func:`interquartile_mean`; not for rates.
    """
    if values.ndim == 2 and values.shape[1] > 1:
        return _of_rows(values, statistic)
    values = values[np.isfinite(values)]
    if not values.size:
        return Interval(math.nan, math.nan, math.nan, 0)
    if rate:
        low, high = binomtest(round(values.sum()), values.size).proportion_ci(CONFIDENCE)
        return Interval(float(values.mean()), float(low), float(high), values.size)
    mean = float(statistic(values))
    if values.size < 2:
        return Interval(mean, math.nan, math.nan, values.size)
    found = bootstrap(
        (values,),
        statistic,
        n_resamples=RESAMPLES,
        confidence_level=CONFIDENCE,
        method="percentile",
        batch=max(1, 1_000_000 // values.size),
        rng=np.random.default_rng(0),
    ).confidence_interval
    return Interval(mean, float(found.low), float(found.high), values.size)


def _of_rows(values: Floats, statistic: Callable[..., Any]) -> Interval:
    """The same of rows (N, R), resampled whole; the statistic leaves out what is NaN."""
    known = values[np.isfinite(values)]
    if not known.size:
        return Interval(math.nan, math.nan, math.nan, 0)
    if len(values) < 2:
        return Interval(float(statistic(known)), math.nan, math.nan, known.size)

    def resampled(rng: np.random.Generator, count: int) -> Floats:
        drawn = values[rng.integers(len(values), size=(count, len(values)))].reshape(count, -1)
        return statistic(drawn[np.isfinite(drawn).any(axis=1)], axis=-1)

    return Interval(float(statistic(known)), *_percentiles(resampled, values.size), known.size)


def stratified_interval(
    values: Floats, strata: NDArray[np.intp], *, statistic: Callable[..., Any] = np.mean
) -> Interval:
    """Statistic and 95 % interval of ``values`` (N,) whose strata stay while their members might have been others; those
    that are NaN are left out.

    The interval is the percentiles' of a stratified bootstrap, always with the same draws: members are resampled within
    their stratum, so that what tells strata apart adds nothing (R. Agarwal et al., "Deep reinforcement learning at the edge
    of the statistical precipice", NeurIPS 2021). Of n members n - 1 are drawn, with which the variance of the mean of few
    is right, where n draws make it too small by the share 1 / n (J. N. K. Rao and C. F. J. Wu, "Resampling inference with
    complex survey data", J. American Statistical Association 83, 1988).

    Args:
        values: Those of a metric.
        strata: The stratum of each (N,).
        statistic: Of all values together, such as :func:`interquartile_mean`; takes ``axis``.
    """
    known = np.isfinite(values)
    if not known.any():
        return Interval(math.nan, math.nan, math.nan, 0)
    order = np.argsort(strata[known], kind="stable")
    members = values[known][order]
    _, counts = np.unique(strata[known], return_counts=True)
    mean = float(statistic(members))
    if counts.max() < 2:
        return Interval(mean, math.nan, math.nan, members.size)
    draws = np.maximum(counts - 1, 1)
    first, size = (np.repeat(of_each, draws) for of_each in (np.cumsum(counts) - counts, counts))

    def resampled(rng: np.random.Generator, count: int) -> Floats:
        rows = first + (rng.random((count, len(first))) * size).astype(np.intp)
        return statistic(members[rows], axis=-1)

    return Interval(mean, *_percentiles(resampled, len(first)), members.size)


def _percentiles(resampled: Callable[[np.random.Generator, int], Floats], size: int) -> tuple[float, float]:
    """Ends of the interval of a statistic, of which ``resampled`` gives so many draws, each of ``size`` values: a million
    values at once."""
    rng = np.random.default_rng(0)
    parts = np.array_split(np.arange(RESAMPLES), math.ceil(RESAMPLES * size / 1_000_000))
    tail = 50.0 * (1.0 - CONFIDENCE)
    low, high = np.percentile(np.concatenate([resampled(rng, len(part)) for part in parts]), [tail, 100.0 - tail])
    return float(low), float(high)


def plain(metrics: Mapping[str, Mapping[str, Interval]]) -> dict[str, dict[str, dict[str, float | None]]]:
    """Metrics by policy and name for JSON; None where an interval says nothing. ``episodes`` is over how many a metric is,
    and ``lower_bounds`` in how many of those it is at least so much."""
    return {policy: {name: _plain(value) for name, value in found.items()} for policy, found in metrics.items()}


def _plain(value: Interval) -> dict[str, float | None]:
    numbers = {"mean": value.mean, "low95": value.low95, "high95": value.high95}
    found: dict[str, float | None] = {key: number if math.isfinite(number) else None for key, number in numbers.items()}
    if value.episodes is not None:
        found["episodes"] = value.episodes
    if value.bounds:
        found["lower_bounds"] = value.bounds
    return found
