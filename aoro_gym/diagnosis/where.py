"""Where a gap lies: the whitened residual that no calibration absorbs, by recording, signal and phase of the manoeuvre.

Without a cause the whitened residual of a :class:`~aoro_gym.diagnosis.linear.Linear` model is r₀ ~ N(0, A) with
A = I + J Jᵀ: noise, the twin's own error, and nuisances. So w = A^(−½) r₀ is white, and nearer to r₀ than any other that is
(Kessy, Lewin and Strimmer 2018): what nuisances may do is taken out of it, the rest stays where it is. Its energy is the
cost of the best fit by nuisances alone. Over a part of n samples it is χ² with n degrees of freedom, and parts are
independent of each other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from aoro_gym.diagnosis.linear import Linear
from aoro_gym.diagnosis.noise import MERGED, Floats
from aoro_gym.diagnosis.places import phases
from aoro_gym.diagnosis.problem import Problem
from aoro_gym.diagnosis.result import PHASES, Place

SIGNIFICANT = 0.05
"""Probability of a residual without a cause, above which no place is named."""


def places(problem: Problem, linear: Linear) -> tuple[tuple[Place, ...], float]:
    """Parts of the gap by share of its energy beyond what noise alone gives, largest first, and the probability of as clear
    a part anywhere without a cause; no parts where that exceeds :data:`SIGNIFICANT`.

    Args:
        problem: Learned.
        linear: Of ``problem``. With an error that grows with the gap (``ModelError.change``) the probability is an upper
            bound.
    """
    white = beyond(linear.tangent.spread, linear.residual)
    parts = _parts(problem, linear)
    excess = {part: float(np.sum(white[rows] ** 2)) - len(rows) for part, rows in parts.items()}
    p = probability([white[rows] for rows in parts.values()])
    above = {part: energy for part, energy in excess.items() if energy > 0.0}
    if p > SIGNIFICANT or not above:
        return (), p
    whole = sum(above.values())
    found = [
        Place("", phase, signal, problem.recordings[index].name, energy / whole)
        for (index, signal, phase), energy in above.items()
    ]
    return tuple(sorted(found, key=lambda place: -place.share)), p


def beyond(spread: Floats, columns: Floats) -> Floats:
    """(I + B Bᵀ)^(−½) of ``columns`` (D,) or (D, N): white again where n standard normals with a ``spread`` B (D, n) come on
    top of white noise."""
    directions, sizes, _ = np.linalg.svd(spread, full_matrices=False)
    shrunk = 1.0 - 1.0 / np.sqrt(1.0 + sizes**2)
    return columns - (directions * shrunk) @ (directions.T @ columns)


def probability(parts: list[Floats]) -> float:
    """Probability that white noise shows as clear a deviation in any of ``parts``, each (n,) samples.

    Each is tested twice, for its mean, z² = n w̄² ~ χ²₁, and for the scatter around it, Σ (w − w̄)² ~ χ²ₙ₋₁, which are
    independent (Cochran). The least of all K probabilities is Tippett's statistic: p = 1 − (1 − least)^K, uniform without a
    cause. Parts that are quieter than expected take nothing away from one that is not.
    """
    means = np.array([np.sum(part) / np.sqrt(len(part)) for part in parts])
    scatter = np.array([part @ part for part in parts]) - means**2
    freedom = np.array([len(part) - 1 for part in parts])
    local = np.concatenate([2.0 * norm.sf(np.abs(means)), chi2.sf(scatter[freedom > 0], freedom[freedom > 0])])
    return float(-np.expm1(len(local) * np.log1p(-np.min(local))))


def _parts(problem: Problem, linear: Linear) -> dict[tuple[int, str, str], NDArray[np.intp]]:
    """Rows of the whitened residual that belong to each recording, signal and phase."""
    phased = [phases(r, arrival) for r, arrival in zip(problem.recordings, problem.arrivals, strict=True)]
    parts, first = {}, 0
    for (index, signal), whitener in zip(problem.blocks, linear.whiteners, strict=True):
        merged = phased[index][: len(phased[index]) // MERGED * MERGED : MERGED][whitener.counts]
        for number in np.unique(merged):
            parts[index, signal, PHASES[number]] = first + np.flatnonzero(merged == number)
        first += len(merged)
    return parts
