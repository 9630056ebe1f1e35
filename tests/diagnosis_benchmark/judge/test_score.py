"""The table against answers by hand."""

from typing import Any

import numpy as np
import pytest

from aoro_gym.diagnosis_benchmark.judge.score import ROWS, Judged, figure, loss, score
from aoro_gym.diagnosis_benchmark.judge.suite import JudgedCase


def case(kind: str, *effects: str, family: str = "ash", machine: int = 0, novel: bool = False) -> JudgedCase:
    outside = ("ice", 0.5) if kind == "outside" else None
    return JudgedCase("0001", kind, family, machine, 0, dict.fromkeys(effects, (0, 0.5)), outside, novel, 1)


def said(
    verdict: str, *effects: str, p: float = 0.6, declared: tuple[str, ...] = (), sizes: Any = None
) -> dict[str, Any]:
    cause = {"effects": list(effects), "probability": p, "magnitudes": sizes or {}}
    return {"verdict": verdict, "causes": [cause], "declared_set": list(declared)}


def judged(
    of: JudgedCase, diagnosis: dict[str, Any] | None, *, detectable: bool = True, alike: tuple[str, ...] = ()
) -> Judged:
    effects = list(of.effects)
    verdict = {
        "detectable": detectable, "isolable": len(alike) < 2, "class": list(alike or effects),
        "each": dict.fromkeys(effects, 1.0) if len(effects) == 2 else None,
    }  # fmt: skip
    return Judged(of, verdict, {e: {"magnitude": [2.0], "unit": "1"} for e in effects}, diagnosis)


INTERVAL = {"a": {"median": 2.0, "low90": 1.0, "high90": 3.0, "unit": "1"}}
BESIDE = {"a": {"median": 2.0, "low90": 2.5, "high90": 3.0, "unit": "1"}}
CASES = [
    judged(case("healthy"), said("no_gap")),
    judged(case("healthy"), said("unknown", "unknown", p=0.9)),
    judged(case("healthy"), said("calibration", "calibration", p=0.9)),
    judged(case("healthy"), said("cause", "a", p=0.9)),
    judged(case("single", "a"), said("cause", "a", p=0.9, declared=("a",), sizes=INTERVAL)),
    judged(case("single", "a"), said("ambiguous", "b", declared=("b", "a", "c"), sizes=None), alike=("a", "b")),
    judged(case("single", "a"), said("ambiguous", "a", declared=("a", "b"), sizes=BESIDE), alike=("a", "b")),
    judged(case("single", "a"), said("unknown", "unknown")),
    judged(case("single", "a"), said("no_gap"), detectable=False),
    judged(case("single", "a"), None),
    judged(case("pair", "a", "b"), said("cause", "a", "b", declared=("a", "b"))),
    judged(case("pair", "a", "b"), said("cause", "a", declared=("a",))),
    judged(case("outside"), said("unknown", "unknown")),
    judged(case("outside", novel=True), said("cause", "a", p=0.85)),
]


@pytest.mark.parametrize(
    ("row", "value", "count"),
    [
        ("false_alarms", 2 / 4, 4),
        ("isolable", 3 / 5, 5),
        ("named_isolable", 1 / 3, 3),
        ("named_detectable", 2 / 5, 5),
        ("named_class", 3 / 5, 5),
        ("declared", 3 / 5, 5),
        ("declared_size", (1 + 3 + 2 + 0) / 4, 4),
        ("pairs_both", 1 / 2, 2),
        ("pairs_one", 1.0, 2),
        ("outside", 1 / 2, 2),
        ("outside_novel", 0.0, 1),
        ("known_rejected", 2 / 7, 7),
        ("wrong_and_sure", 3 / 14, 14),  # healthy called a, a failure, an outsider called a
        ("covered", 1 / 2, 2),
    ],
)
def test_each_row_counts_what_it_says(row: str, value: float, count: int) -> None:
    found = score(CASES, "pressures")[row]
    assert found["value"] == pytest.approx(value)
    assert found["count"] == count


def test_goals_are_bounds_of_their_side() -> None:
    table = score(CASES, "pressures")
    assert table["false_alarms"]["met"] is False
    assert table["pairs_one"]["met"] is True
    assert table["declared_size"]["met"] is True
    assert table["named_detectable"]["met"] is None
    assert set(table) == {row.id for row in ROWS} | {"loss"}


def test_an_interval_is_that_of_machines_not_of_cases() -> None:
    # 10 machines of 50 cases that go together: the deviation is that of 10 draws
    values = [[float(machine % 2)] for machine in range(10) for _ in range(50)]
    machines = [machine for machine in range(10) for _ in range(50)]
    found = figure(values, machines)
    assert found.value == pytest.approx(0.5)
    assert found.high95 is not None
    assert found.low95 is not None
    width = (found.high95 - found.low95) / (2 * 1.96)
    assert width == pytest.approx(np.sqrt(0.25 / 10), rel=0.25)
    alone = figure(values, list(range(500)))
    assert alone.high95 is not None
    assert alone.low95 is not None
    assert (alone.high95 - alone.low95) / (2 * 1.96) == pytest.approx(np.sqrt(0.25 / 500), rel=0.25)


def test_the_loss_is_from_the_easiest_family_to_the_hardest() -> None:
    row = next(row for row in ROWS if row.id == "named_detectable")
    cases = [
        judged(case("single", "a", family=family, machine=machine), said("cause", "a" if right else "b"))
        for family, rights in {"ash": 4, "beech": 3, "elm": 1}.items()
        for machine in range(4)
        for right in [machine < rights]
    ]
    assert loss(cases, row).value == pytest.approx(0.75)
    assert score(cases, "angle")["loss"]["count"] == 12
