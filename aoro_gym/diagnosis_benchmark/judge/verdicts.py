"""Verdicts on cases: whether their change is detectable, and which effects it could be, by what other families show.

A :class:`Reference` is what some families' libraries say of one set of manoeuvres and one channel set. The families of a
reference never hold that of the plant which is judged. :func:`validate` leaves one family out after the other and counts
how often its healthy days exceed the threshold, and how often its effects are explained best by themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
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


@dataclass(frozen=True)
class Reference:
    """What families say of a set of manoeuvres and channels, on axes where healthy days scatter by 1 and laws apart.

    Attributes:
        manoeuvres: Their names.
        channels: Places of the channels.
        names: Effects by number.
        axes: Matrix (features, features) from features to these axes.
        laws: Variances (features,) of laws for a change of length 1.
        noise: Covariance (features, features) of the difference of two logs' noise.
        days: Healthy differences (pairs, features).
        paths: Of all effects.
        directions: Unit vectors (signatures, features).
    """

    manoeuvres: tuple[str, ...]
    channels: tuple[int, ...]
    names: tuple[str, ...]
    axes: Floats
    laws: Floats
    noise: Floats
    days: Floats
    paths: Paths
    directions: Floats

    @classmethod
    def of(
        cls, libraries: Sequence[Library], manoeuvres: Sequence[str], channel_set: str, *, own: bool = False
    ) -> Reference:
        """Learn from libraries.

        Args:
            libraries: Of the families.
            manoeuvres: Of the protocol.
            channel_set: One of :data:`CHANNEL_SETS`.
            own: Whether a single library stands for the plant's own laws: its machines count as families then.
        """
        channels = CHANNEL_SETS[channel_set]
        days = np.concatenate([one.day_pairs(manoeuvres, channels) for one in libraries])
        noise = 2.0 * shrunk_covariance(np.concatenate([one.noises(manoeuvres, channels) for one in libraries]))
        whiten = np.linalg.inv(np.linalg.cholesky(shrunk_covariance(days)))
        names = tuple(dict.fromkeys(effect for one in libraries for effect, _ in one.paths))
        signatures = [one.signatures(manoeuvres, channels) @ whiten.T for one in libraries]
        effects = [[names.index(effect) for effect, _ in one.paths] for one in libraries]
        if own:
            signatures = [every[:, :, m : m + 1] for every in signatures for m in range(every.shape[2])]
            effects = effects * len(signatures)
        paths = pieces(signatures, effects)
        laws, turn = np.linalg.eigh(scatter_of_laws(paths))
        axes = turn.T @ whiten
        turned = Paths(paths.group, paths.effect, paths.start @ turn, paths.end @ turn)
        lengths = np.linalg.norm(turned.end, axis=1, keepdims=True)
        directions = (turned.end / np.maximum(lengths, 1e-12))[lengths[:, 0] > 1.0]
        return cls(
            tuple(manoeuvres), channels, names, axes, np.maximum(laws, 0.0), axes @ noise @ axes.T, days @ axes.T,
            turned, directions,
        )  # fmt: skip

    def largest(self, changes: Floats) -> Floats:
        """T (n,): the largest part of ``changes`` (n, features) along a known direction."""
        return np.abs(changes @ self.directions.T).max(axis=1)

    @cached_property
    def _largest_of_days(self) -> Floats:
        return self.largest(self.days)

    def limit(self, change: Floats | None = None, level: float = LEVEL) -> float:
        """Threshold of T over healthy days, where the direction of ``change`` is looked at, too."""
        largest = self._largest_of_days
        if change is not None:
            largest = np.maximum(largest, np.abs(self.days @ change) / np.linalg.norm(change))
        return threshold(largest, level)

    def power(self, change: Floats) -> float:
        """Probability with which an exact change (features,) is seen."""
        length = float(np.linalg.norm(change))
        if length == 0.0:
            return 0.0
        return power(length, self.limit(change), float(np.sqrt(change @ self.noise @ change)) / length)

    def explain(self, change: Floats, *, noisy: bool) -> Explained:
        """Explain a change (features,) by each effect."""
        return explain(change, self.paths, self.laws, self.names, noisy=noisy)


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
    on_axes = reference.axes @ change
    seen = reference.power(on_axes)
    each = {e: reference.power(reference.axes @ (change - other)) for e, other in zip(effects, others, strict=False)}
    if len(effects) != 1:
        return Verdict(seen, seen >= POWER, each=each or None)
    found = reference.explain(on_axes, noisy=False)
    return Verdict(seen, seen >= POWER, found.alike(effects[0], NATS), found.best)


def validate(libraries: Sequence[Library], manoeuvres: Sequence[str], channel_set: str) -> dict[str, dict[str, Any]]:
    """By family left out: ``healthy`` differences and the ``false_alarms`` among them at the others' threshold; of its
    effects at all sizes, how many are ``detectable``, ``isolable`` of these, and ``best`` explained by themselves."""
    table = {}
    for left in libraries:
        reference = Reference.of([one for one in libraries if one is not left], manoeuvres, channel_set)
        days = left.day_pairs(manoeuvres, reference.channels) @ reference.axes.T
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
