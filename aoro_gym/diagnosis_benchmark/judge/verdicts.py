"""Verdicts on cases: whether their change is detectable, and which effects it could be, by what other families show.

A :class:`Reference` is what some families' libraries say of one set of manoeuvres and one channel set. The families of a
reference never hold that of the plant which is judged. :func:`validate` leaves one family out after the other and counts
how often its healthy days exceed the threshold, and how often its effects are explained best by themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from aoro_gym.diagnosis_benchmark.judge.features import CHANNEL_SETS, Floats
from aoro_gym.diagnosis_benchmark.judge.library import Library
from aoro_gym.diagnosis_benchmark.judge.statistics import (
    LEVEL,
    NATS,
    POWER,
    Explained,
    Paths,
    explain,
    pieces,
    power,
    scatter_of_laws,
    shrunk_covariance,
    threshold,
)  # fmt: skip

COMPARED = 0.5
"""Share of healthy days that a feature must compare; the others lie behind the arrival at a stop."""


@dataclass(frozen=True)
class Days:
    """Healthy days of one family in the metric of the others'.

    Attributes:
        axes: Matrix (axes, features) of that metric.
        pairs: Differences (pairs, axes) of the family's days.
        largest: Their largest part (pairs,) along a direction of the others' signatures.
    """

    axes: Floats
    pairs: Floats
    largest: Floats

    @classmethod
    def of(cls, left: Floats, others: Floats, signatures: Floats, kept: Any) -> Days:
        """From the features of the family's days, of the others' and of the others' signatures; of ``kept`` features."""
        axes = _whitening(others, kept)
        pairs = left @ axes.T
        return cls(axes, pairs, np.abs(pairs @ _directions(signatures @ axes.T).T).max(axis=1))

    def largest_with(self, change: Floats) -> Floats:
        """Largest part (pairs,) where the direction of a change (features,) is looked at, too."""
        along = self.axes @ change
        return np.maximum(self.largest, np.abs(self.pairs @ along) / max(float(np.linalg.norm(along)), 1e-12))


@dataclass(frozen=True)
class Reference:
    """What families say of a set of manoeuvres and channels, on axes where healthy days scatter by 1 and laws apart.

    Attributes:
        manoeuvres: Their names.
        channels: Places of the channels.
        names: Effects by number.
        axes: Matrix (axes, features) from features to these axes.
        laws: Variances (axes,) of laws for a change of length 1.
        noise: Covariance (axes, axes) of the difference of two logs' noise.
        paths: Of all effects.
        directions: Unit vectors (signatures, axes).
        days: Healthy days of each family.
    """

    manoeuvres: tuple[str, ...]
    channels: tuple[int, ...]
    names: tuple[str, ...]
    axes: Floats
    laws: Floats
    noise: Floats
    paths: Paths
    directions: Floats
    days: tuple[Days, ...]

    @classmethod
    def of(
        cls,
        libraries: Sequence[Library],
        manoeuvres: Sequence[str],
        channel_set: str,
        *,
        own: Library | None = None,
    ) -> Reference:
        """Learn from libraries.

        Args:
            libraries: Of families other than the plant's; at least two.
            manoeuvres: Of the protocol.
            channel_set: One of :data:`CHANNEL_SETS`.
            own: Library of the plant's own family, which alone explains then, its machines as families; for the oracle
                that knows the laws.
        """
        channels = CHANNEL_SETS[channel_set]
        days = [one.day_pairs(manoeuvres, channels) for one in libraries]
        kept = np.flatnonzero(np.mean(np.concatenate(days) != 0.0, axis=0) >= COMPARED)
        noise = 2.0 * shrunk_covariance(np.concatenate([one.noises(manoeuvres, channels) for one in libraries]))
        changes = [one.signatures(manoeuvres, channels) for one in libraries]
        flat = [every[np.isfinite(every).all(axis=-1)] for every in changes]
        whiten = _whitening(np.concatenate(days), kept)
        explaining = changes if own is None else np.moveaxis(own.signatures(manoeuvres, channels)[..., None, :], 2, 0)
        sources = libraries if own is None else [own] * len(explaining)
        names = tuple(dict.fromkeys(effect for one in sources for effect, _ in one.paths))
        numbers = [[names.index(effect) for effect, _ in one.paths] for one in sources]
        paths = pieces([every @ whiten.T for every in explaining], numbers)
        laws, turn = np.linalg.eigh(scatter_of_laws(paths))
        axes = turn.T @ whiten
        return cls(
            tuple(manoeuvres),
            channels,
            names,
            axes,
            np.maximum(laws, 0.0),
            axes @ noise @ axes.T,
            Paths(paths.group, paths.effect, paths.start @ turn, paths.end @ turn),
            _directions(np.concatenate(flat) @ axes.T),
            tuple(
                Days.of(days[left], np.concatenate(_without(days, left)), np.concatenate(_without(flat, left)), kept)
                for left in range(len(libraries))
            ),
        )

    def largest(self, changes: Floats) -> Floats:
        """T (n,): the largest part of ``changes`` (n, features) along a known direction."""
        return np.abs(changes @ self.axes.T @ self.directions.T).max(axis=1)

    def limit(self, change: Floats | None = None, level: float = LEVEL) -> float:
        """Threshold of T over the days of each family in the metric of the others, where the direction of ``change``
        (features,) is looked at, too."""
        largest = [one.largest if change is None else one.largest_with(change) for one in self.days]
        return threshold(np.concatenate(largest), level)

    def power(self, change: Floats) -> float:
        """Probability with which an exact change (features,) is seen."""
        on_axes = self.axes @ change
        length = float(np.linalg.norm(on_axes))
        if length == 0.0:
            return 0.0
        return power(length, self.limit(change), float(np.sqrt(on_axes @ self.noise @ on_axes)) / length)

    def explain(self, change: Floats, *, noisy: bool) -> Explained:
        """Explain a change (features,) by each effect."""
        return explain(self.axes @ change, self.paths, self.laws, self.names, noisy=noisy)


def _whitening(days: Floats, kept: Any) -> Floats:
    """Matrix (axes, features) to a metric in which ``days`` (pairs, features) scatter by 1; of ``kept`` features."""
    matrix = np.zeros((len(kept), days.shape[1]))
    matrix[:, kept] = np.linalg.inv(np.linalg.cholesky(shrunk_covariance(days[:, kept])))
    return matrix


def _directions(signatures: Floats) -> Floats:
    """Unit vectors of those that are longer than 1."""
    lengths = np.linalg.norm(signatures, axis=1)
    return signatures[lengths > 1.0] / lengths[lengths > 1.0, None]


def _without(items: Sequence[Any], place: int) -> list[Any]:
    return [one for number, one in enumerate(items) if number != place]


@dataclass(frozen=True)
class Verdict:
    """What the judge says of a case under a channel set.

    Attributes:
        power: With which its exact change is seen.
        detectable: Whether that is enough.
        alike: By true effect, the effects that explain the case as well, itself among them; of cases with one effect.
        best: Effect that explains it best; empty of cases with nothing wrong.
        each: Power of each effect's own change beside the other, of two.
    """

    power: float
    detectable: bool
    alike: tuple[str, ...] = ()
    best: str = ""
    each: dict[str, float] | None = None

    @property
    def isolable(self) -> bool:
        """Whether no other effect explains the case as well."""
        return len(self.alike) == 1

    def as_dict(self) -> dict[str, Any]:
        """As it is sealed."""
        return {
            "power": self.power, "detectable": self.detectable, "isolable": self.isolable, "class": list(self.alike),
            "best": self.best, "each": self.each,
        }  # fmt: skip


def judge(reference: Reference, change: Floats, effects: Sequence[str], others: Sequence[Floats] = ()) -> Verdict:
    """Judge a case.

    Args:
        reference: Of families without that of the plant.
        change: Exact difference (features,) of the later day from the healthy one.
        effects: True ones.
        others: Of two effects, the change without each, in their order.
    """
    seen = reference.power(change)
    each = {e: reference.power(change - other) for e, other in zip(effects, others, strict=False)}
    if len(effects) != 1:
        return Verdict(seen, seen >= POWER, each=each or None)
    found = reference.explain(change, noisy=False)
    return Verdict(seen, seen >= POWER, found.alike(effects[0], NATS), found.best)


def validate(libraries: Sequence[Library], manoeuvres: Sequence[str], channel_set: str) -> dict[str, dict[str, Any]]:
    """By family left out: ``healthy`` differences and the ``false_alarms`` among them at the others' threshold; of its
    effects at all sizes, how many are ``detectable``, ``isolable`` of these, and ``best`` explained by themselves."""
    table = {}
    for left in libraries:
        reference = Reference.of([one for one in libraries if one is not left], manoeuvres, channel_set)
        days = left.day_pairs(manoeuvres, reference.channels)
        verdicts = []
        for (effect, _), sizes in zip(left.paths, left.signatures(manoeuvres, reference.channels), strict=True):
            changes = sizes.reshape(-1, sizes.shape[-1])
            verdicts += [(effect, judge(reference, one, [effect])) for one in changes if np.all(np.isfinite(one))]
        seen = [(effect, verdict) for effect, verdict in verdicts if verdict.detectable]
        table[left.family] = {
            "healthy": len(days),
            "false_alarms": int(np.sum(reference.largest(days) > reference.limit())),
            "effects": len(verdicts),
            "detectable": len(seen),
            "isolable": sum(verdict.isolable for _, verdict in seen),
            "best": sum(verdict.best == effect for effect, verdict in seen),
        }
    return table
