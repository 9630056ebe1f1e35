"""Parameter sets that fit equally well and are as different as the data allow.

Around a fitted point the residuals are nearly linear, so the directions that the data do not see are those of small
singular values of the Jacobian. Candidates are drawn with the prior's spread along those and with next to none along the
others, are evaluated as one population, and of those that fit as well the farthest apart are kept (greedy max–min
distance).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from aoro_gym.calibration.fit import Residuals, inward_steps
from aoro_gym.calibration.space import PRIOR_STD

CANDIDATES = 256
"""Points that are drawn for an ensemble, in each of its rounds."""


def posterior_factor(
    residuals: Residuals, point: NDArray[np.float64], prior_std: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gauss–Newton posterior at ``point`` (d,): factor L (d, d) with covariance L Lᵀ in the unit cube, and the Jacobian.

    ``prior_std`` is the standard deviation of every parameter before the data (unit cube).
    """
    steps = inward_steps(point)
    found = residuals(np.vstack([point, point + np.diag(steps)]))
    jacobian = np.nan_to_num((found[:, 1:] - found[:, :1]) / steps)
    information = jacobian.T @ jacobian + np.eye(len(point)) / prior_std**2
    values, vectors = np.linalg.eigh(information)
    return vectors / np.sqrt(values), jacobian


def draw_ensemble(
    residuals: Residuals,
    fitted: NDArray[np.float64],
    count: int,
    *,
    accept: Callable[[NDArray[np.float64]], NDArray[np.bool_]],
    candidates: int = CANDIDATES,
    prior_std: float = PRIOR_STD,
    seed: int = 0,
) -> NDArray[np.float64]:
    """Up to ``count`` points (count, d) that fit as well as ``fitted`` (K, d), whose first row is always kept.

    Fewer where no more of the candidates fit as well.

    Args:
        residuals: See :data:`aoro_gym.calibration.fit.Residuals`.
        fitted: Fitted points, the best first; the others are candidates, too.
        count: Members wanted.
        accept: Residuals (R, N) → which of the N points fit as well as the best (N,); NaN residuals never do.
        candidates: Points drawn.
        prior_std: Spread [unit cube] in directions that the data do not see.
        seed: Seed of the draws.
    """
    rng = np.random.default_rng(seed)
    best = fitted[0]
    factor, _ = posterior_factor(residuals, best, prior_std)
    # from the posterior's spread to one whose share the data cannot see: prior_std along blind directions, and along
    # seen ones so little that residuals change by half a standard deviation at most, to first order
    factor *= np.linalg.norm(factor, axis=0) / prior_std
    # shrinking rounds: where the linear picture fails far from the best point, nearer draws still fit
    kept = [best]
    for shrink in (1.0, 0.6, 0.35, 0.2):
        drawn = np.clip(best + shrink * rng.standard_normal((candidates, len(best))) @ factor.T, 0.0, 1.0)
        points = np.vstack([fitted[1:], drawn]) if shrink == 1.0 else drawn  # the other fits count once
        found = residuals(points)
        good = np.all(np.isfinite(found), axis=0) & accept(np.nan_to_num(found))
        kept.extend(points[good])
        if len(kept) > 3 * count:
            break
    return farthest_apart(np.array(kept), min(count, len(kept)))


def farthest_apart(points: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """``count`` of the ``points`` (K, d), the first included, chosen one by one as far as possible from those chosen."""
    chosen = [0]
    distance = np.linalg.norm(points - points[0], axis=1)
    while len(chosen) < count:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return points[chosen]
