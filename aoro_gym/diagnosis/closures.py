"""How far a gap shrinks: S = 1 − (RMSE² − σ²) after / (RMSE² − σ²) before, by manoeuvre and signal.

σ² is the variance of the measurement: of its noise at standstill, and of the healthy log's where the prediction begins with
it. What the twin does wrong of its own is not taken off. S is given as it is, and with the signal's own clock and zero
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
from aoro_gym.diagnosis.recording import TICK
from aoro_gym.diagnosis.result import GapClosure
from aoro_gym.diagnosis.signatures import Block, Log

PERIOD = round(0.5 / TICK)
"""Samples of a block that is resampled: residuals are alike for less."""
RESAMPLES = 1000
"""Of every interval."""
CLEAR = 4.0
"""Standard deviations of the noise's own mean square by which a gap must exceed it."""
LAGS = (0, 2, 4, 6, 8, 10, 13, 16, 20, 25, 32, 40, 50, 64, 80)
"""Ticks by which the black box looks back at the command."""
RIDGES = np.logspace(-6.0, 2.0, 17)
"""Penalties of the black box, as shares of the mean power of its features, of which cross-validation picks one."""


def gap_closures(
    name: str, block: Block, before: Floats, after: Floats, draws: Floats, *, held_out: bool
) -> tuple[GapClosure, ...]:
    """S of a signal, as it is and refitted; none where the gap before does not exceed noise: RMSE² > σ² (1 + 4 √(2 / n)), as
    a mean of n independent squares of normals scatters.

    Args:
        name: Of the manoeuvre.
        block: What was measured.
        before: Prediction (F,) SI without effects.
        after: The same with them.
        draws: ``after`` of sizes that are as likely (F, n).
        held_out: The log took no part in the fit.
    """
    predicted = np.column_stack([before, after, draws])[block.counts]
    plain = block.measured[block.counts, None] - predicted
    own = np.stack([np.ones(len(plain)), block.clock[block.counts]], axis=1)
    basis, singular, _ = np.linalg.svd(own / np.linalg.norm(own, axis=0).clip(1e-12), full_matrices=False)
    basis = basis[:, singular > 1e-6]
    found = [
        _gap_closure(name, block, plain, 0.0, held_out, False),
        _gap_closure(name, block, plain - basis @ (basis.T @ plain), _absorbed(block, basis), held_out, True),
    ]
    return tuple(one for one in found if one is not None)


def _gap_closure(
    name: str, block: Block, error: Floats, absorbed: float, held_out: bool, refitted: bool
) -> GapClosure | None:
    """S of residuals (F, 2 + n), before, after and of draws, of whose noise's variance a share was fitted away."""
    variance, count = _noise(block, len(error))
    gaps = np.square(error) - variance * (1.0 - absorbed)
    gap, remaining = np.mean(gaps[:, 0]), np.mean(gaps[:, 1:], axis=0)
    if gap <= CLEAR * np.sqrt(2.0 / count) * variance:
        return None
    S = 1.0 - remaining / gap
    influence = S - (gaps[:, 1:] - (1.0 - S) * gaps[:, :1]) / gap
    low, high = np.quantile(_resampled(influence if len(S) == 1 else influence[:, 1:]), [0.05, 0.95])
    rms = np.sqrt(np.mean(np.square(error[:, :2]), axis=0))
    return GapClosure(
        manoeuvre=name,
        signal=block.signal,
        S=float(S[0]),
        low90=float(min(low, S[0])),
        high90=float(max(high, S[0])),
        before=float(rms[0]),
        after=float(rms[1]),
        noise=float(np.sqrt(variance)),
        held_out=held_out,
        refitted=refitted,
    )


def _noise(block: Block, count: int) -> tuple[float, float]:
    """Variance [SI²] of the noise in the difference, and how many independent samples have a mean square that scatters as
    that of ``count`` samples does: F / Σ ρₖ² (1 − |k| / F), with the autocorrelation ρₖ."""
    covariance = block.noise.covariance[:count]
    squares = np.square(covariance / covariance[0]) * (1.0 - np.arange(len(covariance)) / count)
    return block.copies * float(covariance[0]), count / (2.0 * float(np.sum(squares)) - 1.0)


def _absorbed(block: Block, basis: Floats) -> float:
    """Share of its variance that noise loses with its projection on an orthonormal ``basis`` Q (F, c): tr(Qᵀ R Q) over the
    samples, with the correlation R."""
    covariance = block.noise.covariance[: len(basis)]
    return float(np.sum(basis * matmul_toeplitz(covariance / covariance[0], basis)) / len(basis))


def _resampled(values: Floats) -> Floats:
    """Means (RESAMPLES,) over blocks of time of ``values`` (F, n), each of one column."""
    rng = np.random.default_rng(0)
    count, columns = values.shape
    length = min(PERIOD, count // 3)
    mean = np.mean(values, axis=0)
    sums = np.cumsum(np.concatenate([np.zeros((1, columns)), values - mean, (values - mean)[:length]]), axis=0)
    blocks = (sums[length : length + count] - sums[:count]) / length
    starts = rng.integers(count, size=(RESAMPLES, round(count / length)))
    column = rng.integers(columns, size=RESAMPLES)
    freedom = count / length - 1.0
    inflation = np.sqrt((freedom + 1.0) / freedom) * t.ppf(0.95, freedom) / norm.ppf(0.95)
    return mean[column] + inflation * np.mean(blocks[starts, column[:, None]], axis=1)


def typical(found: Iterable[GapClosure]) -> float | None:
    """Median S of held-out manoeuvres as they are; None if there is none."""
    left_out = [one.S for one in found if one.held_out and not one.refitted]
    return float(np.median(left_out)) if left_out else None


def black_box(logs: Sequence[Log], blocks: Sequence[Block], folds: Sequence[tuple[Sequence[int], int]]) -> float | None:
    """What a model that knows no physics gets, as :func:`typical`: each signal's change as a linear function of features of
    the command and of what was expected without effects, by ridge regression.

    Args:
        logs: All of them.
        blocks: Their signals.
        folds: Numbers of the logs that are learned from, and of that which is predicted.
    """
    features = [_features(logs[block.log], block.log, blocks) for block in blocks]
    found: list[GapClosure] = []
    for learned, left_out in folds:
        for k, block in enumerate(blocks):
            mine = [j for j, b in enumerate(blocks) if b.signal == block.signal and b.log in learned]
            if block.log != left_out or not mine:
                continue
            x = np.concatenate([features[j][blocks[j].counts] for j in mine])
            y = np.concatenate([(blocks[j].measured - blocks[j].before[0])[blocks[j].counts] for j in mine])
            scale = np.maximum(np.sqrt(np.mean(np.square(x), axis=0)), 1e-12)
            after = block.before[0] + features[k] @ (_ridge(x / scale, y) / scale)
            name = logs[left_out].later.name
            found += gap_closures(name, block, block.before[0], after, np.empty((len(after), 0)), held_out=True)
    return typical(found)


def _features(log: Log, number: int, blocks: Sequence[Block]) -> Floats:
    """Features (F, n), zero at rest: the steering signal and its size some time ago, and the change since the start and the
    rate of each signal as expected; of those that a log lacks they are zero."""
    commands = log.later.commands[:, 0]
    nothing = np.zeros(len(commands) + 1)
    steering = np.concatenate([np.zeros(max(LAGS)), commands, commands[-1:]])
    past = [steering[max(LAGS) - lag :][: len(nothing)] for lag in LAGS]
    columns = [*past, *np.abs(past)]
    shown = {block.signal: block.before[0] for block in blocks if block.log == number}
    for signal in sorted({block.signal for block in blocks}):
        part = shown.get(signal, nothing)
        columns += [part - part[0], np.gradient(part)]
    return np.stack(columns, axis=1)


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
