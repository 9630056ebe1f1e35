"""Baseline: a matcher that knows no laws, only how families scatter. It names the effect whose library path is nearest.

All that it knows are libraries of families other than the case's: the metric of healthy days and of the scatter between
laws (:mod:`.statistics`), and from leaving out one of these families after the other, how far explanations lie from
changes that they are true of. With the library of the case's own family in place of the others it is the oracle that
knows the laws.

A change within the threshold of healthy days is no gap. Else each effect has the nats ℓ of its nearest point, and the
probability e^{ℓ/τ}/Σ e^{ℓ/τ}; τ, ≥ 1, is the likeliest for the left-out families. The declared set holds what lies
within δ of the best, δ being the 97 % point of what the true effect lacks there. A second effect is named if it gains more
than it does in 97 % of the left-out single ones, and *unknown* is said if more is left than in 97 % of these. Sizes are
not given: families measure them in units of their own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import expit, softmax

from aoro_gym.diagnosis_benchmark.judge.features import Floats, features
from aoro_gym.diagnosis_benchmark.judge.library import Library
from aoro_gym.diagnosis_benchmark.judge.statistics import threshold
from aoro_gym.diagnosis_benchmark.judge.verdicts import Reference
from aoro_gym.execution.files import write_json

KEPT = 0.97
"""Share of left-out single effects that are in the set, without a second effect, and not unknown."""
FIRST = 5
"""Effects that a second one is sought for."""
TEMPERATURES = np.geomspace(1.0, 30.0, 30)


@dataclass(frozen=True)
class Fit:
    """Nearest points to a change.

    Attributes:
        nats: By effect, −∞ where none is known (effects,).
        residual: Squared length that the best leaves, a feature.
        gain: Nats that the best second effect adds.
        pair: Numbers of the best two effects.
        pair_residual: As ``residual``, of both.
    """

    nats: Floats
    residual: float
    gain: float
    pair: tuple[int, int]
    pair_residual: float


def fit(reference: Reference, change: Floats) -> Fit:
    """Fit one effect and two to a noisy change (features,).

    Two are sought in turns: the second from what each of the :data:`FIRST` best leaves, then the first again.
    """
    on_axes = reference.axes @ change
    square = max(float(on_axes @ on_axes) - len(on_axes), 0.0)
    weights = 1.0 / (1.0 + square * reference.laws)

    def nearest(rest: Floats) -> tuple[Floats, Floats]:
        """Squares by effect, and the nearest points (effects, axes)."""
        paths, count = reference.paths, len(reference.names)
        squares, shares = paths.nearest(rest, weights)
        points, least = np.zeros((count, len(rest))), np.full(count, np.inf)
        order = np.argsort(squares)
        effects, first = np.unique(paths.effect[order], return_index=True)
        best = order[first]
        least[effects] = squares[best]
        points[effects] = paths.start[best] + shares[best, None] * (paths.end[best] - paths.start[best])
        return least, points

    squares, points = nearest(on_axes)
    pair, pair_square = (0, 0), np.inf
    for one in np.argsort(squares)[:FIRST]:
        seconds, others = nearest(on_axes - points[one])
        seconds[one] = np.inf
        two = int(np.argmin(seconds))
        again, _ = nearest(on_axes - others[two])
        if again[one] < pair_square:
            pair, pair_square = (int(one), two), float(again[one])
    size = len(on_axes)
    best = float(squares.min())
    return Fit(-0.5 * squares, best / size, 0.5 * (best - pair_square), pair, pair_square / size)


@dataclass(frozen=True)
class Matcher:
    """A reference, and the limits that left-out families gave it.

    Attributes:
        reference: What it knows.
        limit: T of healthy days that a gap exceeds.
        temperature: τ.
        within: δ [nats].
        gain: Nats that a second effect must add.
        residual: Squared length, a feature, from which the cause is unknown.
    """

    reference: Reference
    limit: float
    temperature: float
    within: float
    gain: float
    residual: float

    @classmethod
    def of(
        cls,
        libraries: Sequence[Library],
        manoeuvres: Sequence[str],
        channel_set: str,
        *,
        seed: int = 0,
    ) -> Matcher:
        """Learn from libraries of at least three families.

        Args:
            libraries: Of families other than that of the cases.
            manoeuvres: Of the protocol.
            channel_set: Which channels are read.
            seed: Of the days that left-out effects are put on.
        """
        reference = Reference.of(libraries, manoeuvres, channel_set)
        rng = np.random.default_rng(seed)
        fits: list[tuple[int, Fit]] = []
        for left in libraries:
            others = Reference.of([one for one in libraries if one is not left], manoeuvres, channel_set)
            days = left.day_pairs(manoeuvres, others.channels)
            limit = others.limit()
            for (effect, _), sizes in zip(left.paths, left.signatures(manoeuvres, others.channels), strict=True):
                for machines in sizes if effect in others.names else ():
                    change = rng.choice(machines) + rng.choice(days)
                    if np.all(np.isfinite(change)) and others.largest(change[None])[0] > limit:
                        fits.append((others.names.index(effect), fit(others, change)))
        lacks = np.array([one.nats.max() - one.nats[true] for true, one in fits])
        return cls(
            reference,
            reference.limit(),
            _temperature(fits),
            threshold(lacks, KEPT),
            threshold(np.array([one.gain for _, one in fits]), KEPT),
            threshold(np.array([one.residual for _, one in fits]), KEPT),
        )

    def knowing(self, own: Reference) -> Matcher:
        """The oracle: the same limits, but explanations by the case's own family."""
        return replace(self, reference=own)

    def diagnose(self, changes: Mapping[str, Floats]) -> dict[str, Any]:
        """``diagnosis.json`` of noisy differences (channels, means) by manoeuvre."""
        change = features([changes[name] for name in self.reference.manoeuvres], self.reference.channels)
        seen = float(self.reference.largest(change[None])[0])
        found = fit(self.reference, change)
        share = softmax(found.nats / self.temperature)
        order = np.argsort(-share)
        causes = [
            {"effects": [self.reference.names[i]], "probability": float(share[i]), "magnitudes": {}} for i in order
        ]
        declared = [self.reference.names[i] for i in order if found.nats[i] >= found.nats.max() - self.within]
        verdict = "cause" if len(declared) == 1 else "ambiguous"
        if seen <= self.limit:
            sure = float(expit(2.0 * (self.limit - seen)))
            verdict, declared = "no_gap", []
            causes = [{"effects": [], "probability": sure, "magnitudes": {}}, *_scaled(causes, 1.0 - sure)]
        elif min(found.residual, found.pair_residual) > self.residual:
            sure = float(expit(found.residual / self.residual - 1.0))
            verdict, declared = "unknown", []
            causes = [{"effects": ["unknown"], "probability": sure, "magnitudes": {}}, *_scaled(causes, 1.0 - sure)]
        elif found.gain > self.gain:
            names = [self.reference.names[i] for i in found.pair]
            sure = float(expit((found.gain - self.gain) / self.temperature))
            declared = list(dict.fromkeys([*names, *declared]))
            causes = [{"effects": names, "probability": sure, "magnitudes": {}}, *_scaled(causes, 1.0 - sure)]
        return {"verdict": verdict, "causes": causes, "declared_set": declared}


def _scaled(causes: Sequence[dict[str, Any]], share: float) -> list[dict[str, Any]]:
    return [one | {"probability": one["probability"] * share} for one in causes]


def _temperature(fits: Sequence[tuple[int, Fit]]) -> float:
    """Temperature under which the true effects of ``fits`` are the likeliest."""

    def likelihood(temperature: float) -> float:
        return float(sum(np.log(softmax(one.nats / temperature)[true] + 1e-12) for true, one in fits))

    return float(max(TEMPERATURES, key=likelihood))


def write(diagnosis: Mapping[str, Any], folder: Path) -> None:
    """Write a diagnosis as any method does."""
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / "diagnosis.json", diagnosis)
