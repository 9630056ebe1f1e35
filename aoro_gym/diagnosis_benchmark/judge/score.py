"""The score of a diagnosis on the judged suite: the table of what it must show, with 95 % intervals, for each family.

Shares count cases; their intervals are bootstrapped over machines, whose cases go together: machines are drawn with
replacement, 95 % lie between the 2.5 and 97.5 % points. A method *names* the effects of its first cause if its verdict is
``cause`` or ``ambiguous``. A case without a diagnosis counts against every share that it belongs to.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from aoro_gym.diagnosis_benchmark.judge.suite import JudgedCase

RESAMPLES = 2000
SURE = 0.8
"""Probability from which a wrong name is a grave error."""
NAMING = ("cause", "ambiguous")
SAYING = (*NAMING, "unknown")
"""Verdicts that are an alarm where nothing is wrong."""


@dataclass(frozen=True)
class Judged:
    """A case with its truth, the judge's verdict and a method's diagnosis.

    Attributes:
        case: Of the plan.
        verdict: As the judge sealed it for the channel set: ``detectable``, ``isolable``, ``class``, ``each``.
        magnitudes: True magnitude (parts,) and unit by effect.
        diagnosis: Content of ``diagnosis.json``, or None if the method failed.
    """

    case: JudgedCase
    verdict: Mapping[str, Any]
    magnitudes: Mapping[str, Mapping[str, Any]]
    diagnosis: Mapping[str, Any] | None

    @property
    def said(self) -> str:
        return self.diagnosis["verdict"] if self.diagnosis else "failed"

    @property
    def first(self) -> Mapping[str, Any]:
        causes = self.diagnosis["causes"] if self.diagnosis else ()
        return causes[0] if causes else {"effects": [], "probability": 0.0}

    @property
    def named(self) -> set[str]:
        return set(self.first["effects"]) if self.said in NAMING else set()

    @property
    def declared(self) -> set[str]:
        return set(self.diagnosis["declared_set"]) if self.diagnosis else set()

    @property
    def truth(self) -> set[str]:
        return set(self.case.effects)

    def seen(self, *kinds: str) -> bool:
        """Whether it is of one of these kinds and detectable, each of two effects."""
        each = self.verdict.get("each") or {}
        return self.case.kind in kinds and self.verdict["detectable"] and all(p >= 0.9 for p in each.values())


@dataclass(frozen=True)
class Row:
    """A row of the table.

    Attributes:
        id: Key of the JSON.
        title: What is counted.
        values: Of a case; none if it does not belong.
        goals: By channel set; a share or mean of at least or, if ``most``, at most this.
        most: Whether goals are upper bounds.
    """

    id: str
    title: str
    values: Callable[[Judged], Sequence[float]]
    goals: Mapping[str, float]
    most: bool = False


def _if(belongs: bool, *values: float) -> Sequence[float]:
    return [float(value) for value in values] if belongs else []


def _covered(one: Judged) -> Sequence[float]:
    """Whether the 90 % interval of each true effect in the declared set holds its size, in the cause named earliest."""
    found = []
    for effect in one.truth & one.declared if one.seen("single", "pair") else ():
        sizes = [c["magnitudes"][effect] for c in one.diagnosis["causes"] if effect in c.get("magnitudes", {})]  # pyright: ignore[reportOptionalSubscript]
        if sizes:
            true = one.magnitudes[effect]["magnitude"][0]
            found.append(float(sizes[0]["low90"] <= true <= sizes[0]["high90"]))
    return found


def _wrong_and_sure(one: Judged) -> bool:
    effects = set(one.first["effects"])
    wrong = bool(effects) and effects not in ({"unknown"}, {"calibration"}, one.truth)
    return one.said == "failed" or (wrong and one.first["probability"] >= SURE)


def _goals(pressures: float, ports: float, angle: float) -> Mapping[str, float]:
    return {"pressures": pressures, "ports": ports, "angle": angle}


ROWS: tuple[Row, ...] = (
    Row(
        "false_alarms", "nothing wrong: an alarm",
        lambda one: _if(one.case.kind == "healthy", one.said in (*SAYING, "failed")), _goals(0.03, 0.03, 0.03), True,
    ),
    Row(
        "isolable", "detectable single: isolable, by the judge",
        lambda one: _if(one.seen("single"), one.verdict["isolable"]), {"pressures": 0.7},
    ),
    Row(
        "named_isolable", "isolable single: named first",
        lambda one: _if(one.seen("single") and one.verdict["isolable"], one.named == one.truth), _goals(0.9, 0.85, 0.75),
    ),
    Row(
        "named_detectable", "detectable single: named first", lambda one: _if(one.seen("single"), one.named == one.truth), {}
    ),
    Row(
        "named_class", "detectable single: named first, or one of its class",
        lambda one: _if(one.seen("single"), len(one.named) == 1 and one.named <= set(one.verdict["class"])), {},
    ),
    Row(
        "declared", "detectable single: in the declared set",
        lambda one: _if(one.seen("single"), one.truth <= one.declared), _goals(0.97, 0.95, 0.95),
    ),
    Row(
        "declared_size", "detectable single: size of the declared set",
        lambda one: _if(one.seen("single") and one.said != "failed", len(one.declared)), _goals(2.0, 2.5, 5.0), True,
    ),
    Row(
        "pairs_both", "pair, each detectable: both named", lambda one: _if(one.seen("pair"), one.named == one.truth),
        _goals(0.7, 0.6, 0.35),
    ),
    Row(
        "pairs_one", "pair, each detectable: one named", lambda one: _if(one.seen("pair"), bool(one.named & one.truth)),
        _goals(0.95, 0.95, 0.85),
    ),
    Row(
        "outside", "detectable outside: told", lambda one: _if(one.seen("outside"), one.said == "unknown"),
        _goals(0.8, 0.7, 0.4),
    ),
    Row(
        "outside_novel", "the same, of kinds that nothing was trained on",
        lambda one: _if(one.seen("outside") and one.case.novel, one.said == "unknown"), {},
    ),
    Row(
        "known_rejected", "detectable single or pair: called unknown",
        lambda one: _if(one.seen("single", "pair"), one.said in ("unknown", "failed")), _goals(0.03, 0.03, 0.03), True,
    ),
    Row(
        "wrong_and_sure", f"any case: wrong at {SURE} or more", lambda one: [float(_wrong_and_sure(one))],
        _goals(0.03, 0.03, 0.03), True,
    ),
    Row("covered", "true effect in the set: the 90 % interval holds its size", _covered, _goals(0.86, 0.86, 0.86)),
)  # fmt: skip
"""What a diagnosis must show; beside them the loss from the easiest family to the hardest (:func:`loss`)."""

HARDEST = "named_detectable"
"""Row that :func:`loss` is of."""


@dataclass(frozen=True)
class Figure:
    """A mean with its 95 % interval; None where no case belongs."""

    value: float | None
    low95: float | None
    high95: float | None
    count: int


def figure(values: Sequence[Sequence[float]], clusters: Sequence[Any], seed: int = 0) -> Figure:
    """Mean of the ``values`` of cases that belong to ``clusters``, which are drawn again for the interval."""
    sums, counts = _by_cluster(values, clusters)
    if not counts.sum():
        return Figure(None, None, None, 0)
    means = _resampled(sums, counts, np.random.default_rng(seed))
    low, high = np.nanquantile(means, [0.025, 0.975])
    return Figure(float(sums.sum() / counts.sum()), float(low), float(high), int(counts.sum()))


def loss(judged: Sequence[Judged], row: Row, seed: int = 0) -> Figure:
    """Largest less least mean of a row over the families."""
    rng = np.random.default_rng(seed)
    means, drawn, total = [], [], 0
    for family in sorted({one.case.family for one in judged}):
        cases = [one for one in judged if one.case.family == family]
        sums, counts = _by_cluster([row.values(one) for one in cases], [one.case.machine for one in cases])
        if counts.sum():
            means.append(sums.sum() / counts.sum())
            drawn.append(_resampled(sums, counts, rng))
            total += int(counts.sum())
    if not means:
        return Figure(None, None, None, 0)
    low, high = np.nanquantile(np.max(drawn, axis=0) - np.min(drawn, axis=0), [0.025, 0.975])
    return Figure(float(max(means) - min(means)), float(low), float(high), total)


def _by_cluster(values: Sequence[Sequence[float]], clusters: Sequence[Any]) -> tuple[Any, Any]:
    """Sums and counts (clusters,) of values."""
    places = {cluster: place for place, cluster in enumerate(sorted(set(clusters)))}
    sums, counts = np.zeros(len(places)), np.zeros(len(places))
    for several, cluster in zip(values, clusters, strict=True):
        sums[places[cluster]] += sum(several)
        counts[places[cluster]] += len(several)
    return sums, counts


def _resampled(sums: Any, counts: Any, rng: np.random.Generator) -> Any:
    """Means (resamples,) over clusters drawn with replacement."""
    drawn = rng.multinomial(len(sums), np.full(len(sums), 1.0 / len(sums)), RESAMPLES)
    with np.errstate(invalid="ignore"):
        return drawn @ sums / (drawn @ counts)


def score(judged: Sequence[Judged], channel_set: str) -> dict[str, Any]:
    """Figures by row, each over all cases and by family, and whether the goal is met."""
    families = sorted({one.case.family for one in judged})

    def over(row: Row, cases: Sequence[Judged]) -> dict[str, Any]:
        return vars(figure([row.values(one) for one in cases], [(one.case.family, one.case.machine) for one in cases]))

    table = {}
    for row in ROWS:
        whole = over(row, judged)
        goal = row.goals.get(channel_set)
        met = None
        if goal is not None and whole["value"] is not None:
            met = whole["value"] <= goal if row.most else whole["value"] >= goal
        table[row.id] = whole | {
            "title": row.title,
            "goal": goal,
            "met": met,
            "families": {name: over(row, [one for one in judged if one.case.family == name]) for name in families},
        }
    row = next(row for row in ROWS if row.id == HARDEST)
    table["loss"] = vars(loss(judged, row)) | {"title": f"loss over families: {row.title}"}
    return table
