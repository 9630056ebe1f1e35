"""What can be seen of a change, and what else could explain it: the judge's statistics, on features.

All lengths are in the metric of healthy days: with the covariance Σ₀ of differences between two noisy days of a healthy
machine, over families, L L' = Σ₀ and x → L⁻¹ x, so that such a difference has the covariance 1. *Assumed*: differences
have the mean zero, as the days are exchangeable; about their distribution nothing, thresholds are empirical.

**Detectable.** A healthy difference h, looked at for any known change, shows T(h) = max |u'h| over the unit vectors u of
the library's signatures and of the case's own exact change Δ. The threshold q is the 99 % point of T over healthy
differences of the other families: the ⌈0.99 (n + 1)⌉-th smallest of n, which a further exchangeable one exceeds in 1 %.
The case shows ‖Δ‖ along its own direction u; noise of both logs adds a normal deviation of variance s² = u' 2Σ_N u. Its
power is Φ((‖Δ‖ − q)/s) + Φ((−‖Δ‖ − q)/s).

**Isolable.** An explanation is a point μ on an effect's path, which for a family and machine leads from nothing straight
from one simulated size to the next. Its log-likelihood, up to a constant that all share, is −½ (d − μ)' C⁻¹ (d − μ) with
C = 1 + a² S: a day's change and noise, and the error of laws, which grows with the change's own length a. S is the
covariance of (v − μ)/‖v‖ over all signatures v and their nearest points μ on paths of the same effect in the other
families. As C hangs on the case alone, it weighs all explanations alike and needs no determinant. The nearest point of
a path is found in closed form, so sizes are a maximum, not a grid. *Assumed*: laws err alike for all effects, in
proportion to the change.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from aoro_gym.diagnosis_benchmark.judge.features import Floats

LEVEL = 0.99
"""Share of healthy differences below a threshold."""
POWER = 0.9
"""From which a change counts as detectable."""
NATS = 3.0
"""By which an explanation must be worse not to count."""


def shrunk_covariance(samples: Floats) -> Floats:
    """Covariance (p, p) of ``samples`` (n, p) of mean zero, its correlations shrunk by what their own scatter asks for.

    Schäfer and Strimmer (2005): r → (1 − λ) r, λ = Σ Var(r) / Σ r² over the pairs of different features, within [0, 1].
    """
    count, size = samples.shape
    if count < 2:
        raise ValueError(f"a covariance needs at least 2 samples, not {count}")
    scale = np.sqrt(np.mean(samples**2, axis=0))
    scale[scale == 0.0] = 1.0
    unit = samples / scale
    correlation = unit.T @ unit / count
    off = ~np.eye(size, dtype=bool)
    variance = ((unit**2).T @ (unit**2) / count - correlation**2) / (count - 1)
    total = np.sum(correlation[off] ** 2)
    shrinkage = min(1.0, float(np.sum(variance[off]) / total)) if total > 0.0 else 1.0
    return scale[:, None] * np.where(off, (1.0 - shrinkage) * correlation, correlation) * scale


def threshold(values: Floats, level: float = LEVEL) -> float:
    """Value that a further exchangeable one exceeds with a probability of at most 1 − ``level``.

    Raises:
        ValueError: If there are too few values for it.
    """
    place = math.ceil(level * (len(values) + 1))
    if place > len(values):
        raise ValueError(
            f"the {100 * level:g} % point needs {math.ceil(level / (1 - level))} values, not {len(values)}"
        )
    return float(np.sort(values)[place - 1])


def power(length: float, limit: float, std: float) -> float:
    """Probability that a normal value around ``length`` of deviation ``std`` lies beyond ± ``limit``."""
    return float(ndtr((length - limit) / std) + ndtr((-length - limit) / std))


@dataclass(frozen=True)
class Paths:
    """Paths of effects as straight pieces, in whatever metric their ends are.

    Attributes:
        group: Number of the family of each piece (pieces,).
        effect: Number of its effect (pieces,).
        start, end: Ends (pieces, features).
    """

    group: NDArray[np.int64]
    effect: NDArray[np.int64]
    start: Floats
    end: Floats

    def nearest(self, change: Floats, weights: Floats | float = 1.0) -> tuple[Floats, Floats]:
        """Squared distances (pieces,) of ``change`` (features,) from the pieces, and where along each they are (pieces,).

        Args:
            change: In the paths' metric.
            weights: Of each feature's square.
        """
        along, away = self.end - self.start, change - self.start
        square = np.sum(weights * along**2, axis=1)
        share = np.clip(np.sum(weights * along * away, axis=1) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
        rest = away - share[:, None] * along
        return np.sum(weights * rest**2, axis=1), share

    def best(self, squares: Floats, effects: int) -> Floats:
        """Least of ``squares`` (pieces,) by effect (effects,); infinite where there is none."""
        found = np.full(effects, np.inf)
        np.minimum.at(found, self.effect, squares)
        return found

    def of(self, chosen: NDArray[np.bool_]) -> Paths:
        """Some of the pieces."""
        return Paths(self.group[chosen], self.effect[chosen], self.start[chosen], self.end[chosen])


def pieces(signatures: Sequence[Floats], effects: Sequence[Sequence[int]]) -> Paths:
    """Paths from the signatures (paths, sizes, machines, features) of each group, whose paths belong to ``effects``.

    A size that a machine cannot have (NaN) is passed over.
    """
    group, effect, start, end = [], [], [], []
    for number, (every, ids) in enumerate(zip(signatures, effects, strict=True)):
        for one, sizes in zip(ids, every, strict=True):
            for machine in range(sizes.shape[1]):
                points = [np.zeros(sizes.shape[-1]), *(p for p in sizes[:, machine] if np.all(np.isfinite(p)))]
                for a, b in itertools.pairwise(points):
                    group.append(number)
                    effect.append(one)
                    start.append(a)
                    end.append(b)
    return Paths(np.array(group), np.array(effect), np.array(start), np.array(end))


def scatter_of_laws(paths: Paths, least: float = 3.0) -> Floats:
    """Covariance S (features, features) of what other families' nearest points lack of a signature, in its lengths.

    Args:
        paths: In the metric of healthy days.
        least: Length below which a signature does not count, as nobody sees it.
    """
    lacks = []
    lengths = np.linalg.norm(paths.end, axis=1)
    for effect in np.unique(paths.effect):
        same = paths.of(paths.effect == effect)
        for place in np.flatnonzero((paths.effect == effect) & (lengths > least)):
            others = same.of(same.group != paths.group[place])
            if not len(others.group):
                continue
            squares, shares = others.nearest(paths.end[place])
            best = int(np.argmin(squares))
            nearest = others.start[best] + shares[best] * (others.end[best] - others.start[best])
            lacks.append((paths.end[place] - nearest) / lengths[place])
    if len(lacks) < 2:
        raise ValueError("no effect is long enough in two families, so their scatter is not known")
    return shrunk_covariance(np.array(lacks))


@dataclass(frozen=True)
class Explained:
    """How well each effect explains a change.

    Attributes:
        nats: Log-likelihood of the best explanation by effect, up to a constant.
        residual: Squared length of what the best of all leaves.
    """

    nats: dict[str, float]
    residual: float

    @property
    def best(self) -> str:
        return max(self.nats, key=self.nats.__getitem__)

    def alike(self, effect: str, nats: float = NATS) -> tuple[str, ...]:
        """Effects that explain the change no worse by ``nats`` or more than ``effect`` does, which is one of them."""
        least = self.nats[effect] - nats
        return tuple(name for name, value in self.nats.items() if name == effect or value > least)


def explain(change: Floats, paths: Paths, law_scatter: Floats, names: Sequence[str], *, noisy: bool) -> Explained:
    """Explain a change by each effect.

    Args:
        change: (features,), in the metric of healthy days and on the axes of the scatter of laws.
        paths: On the same axes.
        law_scatter: Variances (features,) of laws along these axes, for a change of length 1.
        names: Of the effects by number.
        noisy: Whether the change holds a day's noise, whose expected square is taken from that of its length.
    """
    square = max(float(change @ change) - (len(change) if noisy else 0.0), 0.0)
    squares, _ = paths.nearest(change, 1.0 / (1.0 + square * law_scatter))
    best = paths.best(squares, len(names))
    known = {name: -0.5 * float(value) for name, value in zip(names, best, strict=True) if np.isfinite(value)}
    return Explained(known, float(best.min()))
