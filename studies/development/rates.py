"""How well decisions on cases with a known truth do: shares with Wilson's 95 % intervals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from aoro_gym.diagnosis.network.decision import SURE, Decision
from aoro_gym.diagnosis_benchmark.judge.suite import JudgedCase

NAMING = ("cause", "ambiguous")


@dataclass(frozen=True)
class Decided:
    """A case and what was said of it."""

    case: JudgedCase
    decision: Decision

    @property
    def truth(self) -> set[str]:
        return set(self.case.effects)

    @property
    def named(self) -> set[str]:
        return set(self.decision.hypotheses[0][0]) if self.decision.verdict in NAMING else set()

    @property
    def gap(self) -> bool:
        return self.decision.verdict != "no_gap"


def _of(kind: str, value: Callable[[Decided], float], noticed: bool = False) -> Callable[[Decided], float | None]:
    def asked(one: Decided) -> float | None:
        return value(one) if one.case.kind == kind and (one.gap or not noticed) else None

    return asked


def _wrong_and_sure(one: Decided) -> float:
    effects, share = one.decision.hypotheses[0]
    return float(one.decision.verdict in NAMING and share >= SURE and set(effects) != one.truth)


ROWS: Mapping[str, tuple[str, Callable[[Decided], float | None]]] = {
    "false_alarms": ("nothing wrong: a gap is said", _of("healthy", lambda one: one.gap)),
    "noticed": ("single: a gap is said", _of("single", lambda one: one.gap)),
    "named": ("single: named first", _of("single", lambda one: one.named == one.truth)),
    "named_noticed": ("single with a gap said: named first", _of("single", lambda one: one.named == one.truth, True)),
    "declared": (
        "single with a gap said: in the declared set",
        _of("single", lambda one: one.truth <= set(one.decision.declared), True),
    ),
    "declared_size": ("the same: size of the declared set", _of("single", lambda one: len(one.decision.declared), True)),
    "pairs_noticed": ("pair: a gap is said", _of("pair", lambda one: one.gap)),
    "pairs_both": ("pair with a gap said: both named", _of("pair", lambda one: one.named == one.truth, True)),
    "pairs_one": ("pair with a gap said: one named", _of("pair", lambda one: bool(one.named & one.truth), True)),
    "outside_noticed": ("outside: a gap is said", _of("outside", lambda one: one.gap)),
    "outside": ("outside with a gap said: told", _of("outside", lambda one: one.decision.verdict == "unknown", True)),
    "known_rejected": (
        "single or pair: called unknown",
        lambda one: float(one.decision.verdict == "unknown") if one.case.kind in ("single", "pair") else None,
    ),
    "wrong_and_sure": (f"any case: wrong at {SURE} or more", _wrong_and_sure),
}  # fmt: skip
"""What is counted, of which cases."""


@dataclass(frozen=True)
class Rate:
    """A mean over ``count`` cases with its 95 % interval."""

    value: float
    low95: float
    high95: float
    count: int


def rates(decided: Sequence[Decided]) -> dict[str, Rate]:
    """All of :data:`ROWS` that there are cases of."""
    found = {}
    for name, (_, asked) in ROWS.items():
        values = np.array([value for one in decided if (value := asked(one)) is not None], dtype=float)
        if len(values):
            found[name] = _rate(values)
    return found


def _rate(values: np.ndarray) -> Rate:
    """Wilson's interval of a share; that of a normal mean of what is no share."""
    count, mean = len(values), float(values.mean())
    z = float(norm.ppf(0.975))
    if np.isin(values, (0.0, 1.0)).all():
        middle, scale = (mean + z**2 / (2 * count)) / (1 + z**2 / count), 1 + z**2 / count
        half = z * np.sqrt(mean * (1 - mean) / count + z**2 / (4 * count**2)) / scale
        return Rate(mean, float(middle - half), float(middle + half), count)
    half = z * float(values.std(ddof=1)) / np.sqrt(count) if count > 1 else 0.0
    return Rate(mean, mean - half, mean + half, count)
