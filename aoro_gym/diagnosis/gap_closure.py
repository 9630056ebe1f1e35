"""How far a gap shrinks: S = 1 − (RMSE² − σ²) after / (RMSE² − σ²) before, by manoeuvre and signal.

σ² is the variance of the measurement: of its noise at standstill, and of the healthy recordings' where they were subtracted.
What the twin does wrong of its own is not taken off. S is given as it is, and with the recording's own clock and zeros
fitted anew before and after, by least squares, which takes from σ² what they absorb of the noise.

The mean squares are those of few peaks, so a resample may have no gap to divide by. What is resampled is therefore what
each sample contributes to S to first order (its influence, Efron 1982),

    S − ((e² − σ²) after − (1 − S)(e² − σ²) before) / ⟨e² − σ²⟩ before,

whose mean is S: in circular blocks over time (Politis and Romano 1992), each with a draw of the prediction. Of K blocks
the scatter is known as Student's t with K − 1 degrees of freedom knows it, so that intervals are widened accordingly.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from scipy.linalg import matmul_toeplitz
from scipy.stats import norm, t

from aoro_gym.diagnosis.noise import Floats
from aoro_gym.diagnosis.problem import Problem
from aoro_gym.diagnosis.recording import TICK
from aoro_gym.diagnosis.result import GapClosure

BLOCK = round(0.5 / TICK)
"""Samples of a block that is resampled: residuals are alike for less."""
RESAMPLES = 2000
"""Of every interval."""
CLEAR = 4.0
"""Standard deviations of the noise's own mean square by which a gap must exceed it."""
LAGS = (0, 2, 4, 6, 8, 10, 13, 16, 20, 25, 32, 40, 50, 64, 80)
"""Ticks by which the black box looks back at the command."""
RIDGES = np.logspace(-6.0, 2.0, 17)
"""Penalties of the black box, as shares of the mean power of its features, of which cross-validation picks one."""


def gap_closures(
    problem: Problem, before: Floats, after: Floats, *, held_out: bool, draws: Floats | None = None, seed: int = 0
) -> tuple[GapClosure, ...]:
    """S of every recording and signal whose gap before exceeds noise: RMSE² > σ² (1 + 4 √(2 / n)), where a mean of n
    independent squares of normals scatters as that of the noise does.

    Args:
        problem: Its recordings are compared.
        before: Stacked prediction (D,) SI of the given twin.
        after: The same with the cause.
        held_out: The recordings took no part in the fit.
        draws: ``after`` for machines drawn from the posterior (D, n); the interval then holds their spread, too.
        seed: Of the resamples.
    """
    predicted = np.column_stack([before, after, *([] if draws is None else [draws])])
    plain = problem.measured[:, None] - predicted
    refitted, absorbed = _refitted(problem, plain, predicted)
    nothing = np.zeros((len(problem.blocks), plain.shape[1]))
    found = []
    for own, residuals, less in ((False, plain, nothing), (True, refitted, absorbed)):
        for k, error in enumerate(problem.split(residuals)):
            one = _gap_closure(problem, k, error, less[k], held_out, own, seed)
            found += [one] if one else []
    return tuple(found)


def _gap_closure(
    problem: Problem, block: int, error: Floats, absorbed: Floats, held_out: bool, refitted: bool, seed: int
) -> GapClosure | None:
    """S of one block with residuals (F, 2 + n), before, after and of draws, of whose noise's variance the shares
    ``absorbed`` (2 + n,) were fitted away. None where there is no gap to shrink."""
    index, signal = problem.blocks[block]
    variance, count = _noise(problem, block)
    gaps = np.square(error) - variance * (1.0 - absorbed)
    gap, remaining = np.mean(gaps[:, 0]), np.mean(gaps[:, 1:], axis=0)
    if gap <= CLEAR * np.sqrt(2.0 / count) * variance:
        return None
    S = 1.0 - remaining / gap
    influence = S - (gaps[:, 1:] - (1.0 - S) * gaps[:, :1]) / gap
    low, high = np.quantile(_resampled(influence if len(S) == 1 else influence[:, 1:], seed), [0.05, 0.95])
    rms = np.sqrt(np.mean(np.square(error[:, :2]), axis=0))
    return GapClosure(
        manoeuvre=problem.recordings[index].name,
        signal=signal,
        S=float(S[0]),
        low90=float(min(low, S[0])),
        high90=float(max(high, S[0])),
        before=float(rms[0]),
        after=float(rms[1]),
        noise=float(np.sqrt(variance)),
        held_out=held_out,
        refitted=refitted,
    )


def _copies(problem: Problem, block: int) -> float:
    """How many times a signal's noise is in a block: once, and with the healthy recordings' mean."""
    index, signal = problem.blocks[block]
    known = problem.references.get((problem.recordings[index].signature, signal))
    return 1.0 if known is None else 1.0 + 1.0 / known.repeats


def _noise(problem: Problem, block: int) -> tuple[float, float]:
    """Variance [SI²] of the noise in a block, and how many independent samples have a mean square that scatters as its does:
    F / Σ ρₖ² (1 − |k| / F), with the autocorrelation ρₖ."""
    index, signal = problem.blocks[block]
    count = len(problem.recordings[index].channels[signal])
    covariance = problem.noise[signal].covariance[:count]
    squares = np.square(covariance / covariance[0]) * (1.0 - np.arange(len(covariance)) / count)
    return float(_copies(problem, block) * covariance[0]), count / (2.0 * float(np.sum(squares)) - 1.0)


def _resampled(values: Floats, seed: int) -> Floats:
    """Means (RESAMPLES,) over blocks of time of ``values`` (F, n), each of one column."""
    rng = np.random.default_rng(seed)
    count, columns = values.shape
    length = min(BLOCK, count // 3)
    mean = np.mean(values, axis=0)
    sums = np.cumsum(np.concatenate([np.zeros((1, columns)), values - mean, (values - mean)[:length]]), axis=0)
    blocks = (sums[length : length + count] - sums[:count]) / length
    starts = rng.integers(count, size=(RESAMPLES, round(count / length)))
    column = rng.integers(columns, size=RESAMPLES)
    freedom = count / length - 1.0
    inflation = np.sqrt((freedom + 1.0) / freedom) * t.ppf(0.95, freedom) / norm.ppf(0.95)
    return mean[column] + inflation * np.mean(blocks[starts, column[:, None]], axis=1)


def _refitted(problem: Problem, residuals: Floats, predicted: Floats) -> tuple[Floats, Floats]:
    """``residuals`` (D, m) less what each recording's own clock and zeros explain, by least squares in the noise of the
    signals, and the shares (blocks, m) of its variance that they absorb of the noise."""
    lengths = [len(part) for part in problem.split(residuals)]
    scale = np.repeat([problem.noise[signal].std for _, signal in problem.blocks], lengths)
    refitted = np.empty_like(residuals)
    absorbed = np.empty((len(problem.blocks), residuals.shape[1]))
    for m, (residual, prediction) in enumerate(zip(residuals.T, predicted.T, strict=True)):
        own = problem.own(prediction) / scale[:, None]
        basis, singular, _ = np.linalg.svd(own, full_matrices=False)
        basis = basis[:, singular > 1e-9 * singular[0]]
        refitted[:, m] = residual - scale * (basis @ (basis.T @ (residual / scale)))
        absorbed[:, m] = _absorbed(problem, basis)
    return refitted, absorbed


def _absorbed(problem: Problem, basis: Floats) -> Floats:
    """Shares (blocks,) of its variance that the noise loses in every block with its projection P = Q Qᵀ on an orthonormal
    ``basis`` Q (D, c): tr(2 P R − P R P) of the block over its samples, with the correlation R of all noise."""
    parts = problem.split(basis)
    correlated = []
    for (_, signal), part in zip(problem.blocks, parts, strict=True):
        covariance = problem.noise[signal].covariance[: len(part)]
        correlated.append(matmul_toeplitz(covariance / covariance[0], part))
    inner = sum(part.T @ other for part, other in zip(parts, correlated, strict=True))
    return np.array(
        [
            (2.0 * np.sum(part * other) - np.sum((part @ inner) * part)) / len(part)
            for part, other in zip(parts, correlated, strict=True)
        ]
    )


def typical(found: Iterable[GapClosure]) -> float | None:
    """Median S of held-out manoeuvres as they are; None if there is none."""
    left_out = [one.S for one in found if one.held_out and not one.refitted]
    return float(np.median(left_out)) if left_out else None


def black_box(fitted: Problem, before: Floats, left_out: Problem, before_left_out: Floats) -> float | None:
    """What a model that knows no physics gets, as :func:`typical`: residuals as a linear function of features of the command
    and of the given twin's own prediction, by ridge regression on all ``fitted`` recordings, for each signal.

    Args:
        fitted: Recordings that it learns from.
        before: Stacked prediction (D,) of the given twin.
        left_out: Recordings that it is applied to; signals that were not fitted are left alone.
        before_left_out: As ``before``.
    """
    after = before_left_out.copy()
    learned, asked = (_features(*one, fitted.signals) for one in ((fitted, before), (left_out, before_left_out)))
    residuals = fitted.split(fitted.measured - before)
    parts = left_out.split(after)  # views of ``after``
    for signal in fitted.signals:
        mine = [k for k, (_, name) in enumerate(fitted.blocks) if name == signal]
        x, y = np.concatenate([learned[k] for k in mine]), np.concatenate([residuals[k] for k in mine])
        scale = np.maximum(np.sqrt(np.mean(np.square(x), axis=0)), 1e-12)
        weights = _ridge(x / scale, y) / scale
        for k, (_, name) in enumerate(left_out.blocks):
            if name == signal:
                parts[k] += asked[k] @ weights
    return typical(gap_closures(left_out, before_left_out, after, held_out=True))


def _features(problem: Problem, predicted: Floats, signals: Sequence[str]) -> list[Floats]:
    """Features (F, n) of every block, zero at rest: the steering signal and its size some time ago, and the change since the
    start and the rate of each of the predicted ``signals``; of those that a recording lacks they are zero."""
    shown = dict(zip(problem.blocks, problem.split(predicted), strict=True))
    out = []
    for index, _ in problem.blocks:
        commands = problem.recordings[index].commands[:, 0]
        nothing = np.zeros(len(commands) + 1)
        steering = np.concatenate([np.zeros(max(LAGS)), commands, commands[-1:]])
        past = [steering[max(LAGS) - lag :][: len(nothing)] for lag in LAGS]
        columns = [*past, *np.abs(past)]
        for signal in signals:
            part = shown.get((index, signal), nothing)
            columns += [part - part[0], np.gradient(part)]
        out.append(np.stack(columns, axis=1))
    return out


def _ridge(x: Floats, y: Floats) -> Floats:
    """Weights (n,) of ``y`` (F,) on ``x`` (F, n), with the penalty of the least generalised cross-validation (Golub, Heath
    and Wahba 1979)."""
    u, singular, v = np.linalg.svd(x, full_matrices=False)
    target = u.T @ y
    power = singular**2
    filters = power / (power + RIDGES[:, None] * np.mean(power))  # (penalties, n)
    error = y @ y - np.sum((1.0 - (1.0 - filters) ** 2) * target**2, axis=1)
    best = filters[np.argmin(error / (len(y) - np.sum(filters, axis=1)) ** 2)]
    return v.T @ (best * target / np.maximum(singular, 1e-12 * singular[0]))
