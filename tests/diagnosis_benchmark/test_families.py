"""What the groups of families share: logs stay what they were, however many runs are computed at once."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from aoro_gym.diagnosis_benchmark import component_families, independent
from aoro_gym.diagnosis_benchmark.independent import recording

STORED = Path(__file__).with_name("logs_of_families.json")
"""Logs without noise at :data:`SHOWN`, as they were when families were written; ``python -m`` this module writes them."""
SHOWN = [0, 20, 35, 59]
"""Samples that are stored."""
FAMILIES = [(independent, family) for family in independent.FAMILIES]
FAMILIES += [(component_families, family) for family in component_families.ALL_FAMILIES]
KINDS = {independent: "clock_drift", component_families: "kind_17"}
"""A deviation of each group."""


def runs(group, family: str) -> list[independent.Run]:
    """A drawn machine on two days, with two effects, and with a deviation."""
    rng = np.random.default_rng(5)
    machine = group.machine(family, rng)
    day = group.another_day(family, machine, rng)
    steering, drive = np.zeros(60), np.where(np.arange(60) > 30, 0.25, 0.0)
    steering[8:35], steering[40:] = 0.85, -0.6
    effects = {"oil_temperature": 15.0, "cylinder_leakage": 2.0 * group.EFFECTS["cylinder_leakage"].weak}
    return [
        group.Run(family, machine, steering, seed=1),
        group.Run(family, day, steering, effects, drive, -0.3, 2),
        group.Run(family, machine, steering[:50], seed=3, outside=KINDS[group], outside_size=0.7),
    ]


@pytest.mark.parametrize(("group", "family"), FAMILIES, ids=lambda one: one if isinstance(one, str) else "")
def test_logs_are_what_they_were(group, family: str) -> None:
    stored = json.loads(STORED.read_text(encoding="utf-8"))[family]
    for log, kept in zip(group.record(runs(group, family), noise=False), stored, strict=True):
        for name, values in kept.items():
            got = log[name][[k for k in SHOWN if k < len(log[name])]]
            # rounding of another processor (1e-16) may grow by stiff oil and dry friction: seven orders are left to it
            np.testing.assert_allclose(got, values, rtol=1e-9, atol=1e-9 * max(1.0, float(np.ptp(log[name]))))


@pytest.mark.parametrize("group", [independent, component_families])
def test_logs_are_the_same_however_many_are_computed_at_once(group, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = [run for family in group.FAMILIES[:2] for run in runs(group, family)] * 2
    whole = group.record(asked)
    monkeypatch.setattr(recording, "CHUNK", 1)
    monkeypatch.setattr(recording, "TOGETHER", 1)
    assert len(recording.chunked(group.GROUP, asked, "cpu", None, 6)) == len(asked)  # a run at a time
    for one, other in zip(whole, group.record(asked), strict=True):
        assert all(np.array_equal(values, other[name]) for name, values in one.items())


def test_a_chunk_holds_what_memory_allows() -> None:
    asked = runs(independent, "alder") * 5
    waves = recording.chunked(independent.GROUP, asked, "cpu", None, 6)
    assert sorted(i for wave in waves for _, members in wave for i in members) == list(range(len(asked)))
    lengths = [len(asked[members[0]].steering) for wave in waves for _, members in wave]
    assert lengths == sorted(lengths) and len(set(lengths)) == 2
    for family, members in waves[0]:
        assert {asked[i].family for i in members} == {family}
        assert len({len(asked[i].steering) for i in members}) == 1


if __name__ == "__main__":
    found = {
        family: [
            {name: values[[k for k in SHOWN if k < len(values)]].tolist() for name, values in log.items()}
            for log in group.record(runs(group, family), noise=False)
        ]
        for group, family in FAMILIES
    }
    STORED.write_text(json.dumps(found, indent=0), encoding="utf-8")
