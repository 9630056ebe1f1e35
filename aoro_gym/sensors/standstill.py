"""Noise of a sensor at standstill as an autoregressive process (Burg 1975: short stretches, sharp lines), and more of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz, toeplitz

Floats = NDArray[np.float64]

ORDER = 12
"""Of the autoregressive noise: holds a line at 6 Hz and its neighbours at 100 samples a second."""

WHITE = 1e-3
"""White share of the power that drawn noise has at least: lines without any have no process of finite memory."""


def noise_like(segments: Sequence[Floats], count: int, runs: int, rng: np.random.Generator) -> Floats:
    """Noise (count, runs) with the covariance of a sensor at rest, in its unit.

    Args:
        segments: Samples (F,) of the sensor at standstill, evenly spaced; their means are taken off.
        count: Samples of a run.
        runs: How many, each independent of the others.
        rng: Of the draws.
    """
    known = [np.asarray(one, dtype=np.float64) - np.mean(one) for one in segments if len(one)]
    order = min(ORDER, min((len(one) for one in known), default=0) // 3)
    if order < 1 or not any(np.any(one) for one in known):
        return np.zeros((count, runs))
    covariance, _ = autoregression(known, order)
    covariance[0] *= 1.0 + WHITE
    weights = solve_toeplitz(covariance[:order], covariance[1:])
    share, axes = np.linalg.eigh(toeplitz(covariance[:order]))
    values = np.empty((order + count, runs))
    values[:order] = axes @ (np.sqrt(np.maximum(share, 0.0))[:, None] * rng.standard_normal((order, runs)))
    new = np.sqrt(max(float(covariance[0] - weights @ covariance[1:]), 0.0)) * rng.standard_normal((count, runs))
    for k in range(count):
        values[order + k] = weights[::-1] @ values[k : order + k] + new[k]
    return values[order:]


def autoregression(segments: Sequence[Floats], order: int) -> tuple[Floats, Floats]:
    """Autocovariance (order + 1,) and weights (order,) of the autoregressive process of several segments."""
    forward, backward = list(segments), list(segments)
    power = sum(float(s @ s) for s in segments) / sum(len(s) for s in segments)
    covariance, left = [power], power
    polynomial = np.ones(1)
    for m in range(1, order + 1):
        ahead, behind = [f[1:] for f in forward], [b[:-1] for b in backward]
        both = sum(float(f @ f + b @ b) for f, b in zip(ahead, behind, strict=True))
        reflection = -2.0 * sum(float(f @ b) for f, b in zip(ahead, behind, strict=True)) / both if both > 0.0 else 0.0
        covariance.append(-reflection * left - float(polynomial[1:] @ np.array(covariance[m - 1 : 0 : -1])))
        padded = np.append(polynomial, 0.0)
        polynomial = padded + reflection * padded[::-1]
        left *= 1.0 - reflection**2
        forward = [f + reflection * b for f, b in zip(ahead, behind, strict=True)]
        backward = [b + reflection * f for f, b in zip(ahead, behind, strict=True)]
    return np.array(covariance), -polynomial[1:]
