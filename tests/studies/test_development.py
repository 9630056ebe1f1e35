"""Development plants: cases come back from their files as they were made, and what is counted of decisions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aoro_gym.diagnosis.network import hypotheses
from aoro_gym.diagnosis.network.decision import Decision
from aoro_gym.diagnosis.result import UNKNOWN
from aoro_gym.diagnosis_benchmark.judge.features import CHANNELS
from aoro_gym.diagnosis_benchmark.judge.suite import JudgedCase
from aoro_gym.effects.catalogue import IDS
from studies.development.__main__ import calibrating, family_weights, left_out, truth_of
from studies.development.cases import SUITE, DevelopmentCase, _read, _write, opened, planned, recording
from studies.development.rates import Decided, rates

SMALL = replace(SUITE, healthy=4, singles=4, pairs=4, outside=4, machines=2, protocols=2)


def made_up(made, case: JudgedCase) -> DevelopmentCase:
    """A case whose logs are numbers that tell it from others."""
    days = []
    for day in range(2):
        logs = []
        for number, name in enumerate(made.protocols[case.protocol]):
            told = made.excitations[name]
            shown = np.full(len(told.steering), 10.0 * int(case.name) + day + 0.1 * number)
            logs.append(recording(told, dict.fromkeys(CHANNELS, shown)))
        days.append(logs)
    return DevelopmentCase(case, {name: [1.5] for name in case.effects}, *days)


def test_cases_come_back_from_their_files(tmp_path):
    made = planned(5, SMALL)
    cases = [made_up(made, case) for case in made.cases if case.family == "level_1"]
    _write(tmp_path / "cases.npz", cases)
    again = _read(tmp_path / "cases.npz", made)
    assert [one.case for one in again] == [one.case for one in cases]
    for one, other in zip(cases, again, strict=True):
        assert one.sizes == other.sizes
        for day in ("healthy", "later"):
            for a, b in zip(getattr(one, day), getattr(other, day), strict=True):
                np.testing.assert_array_equal(a.commands, b.commands)
                np.testing.assert_allclose(a.channels["pressure_a"], b.channels["pressure_a"], rtol=1e-6)
    few = cases[0].with_channels(CHANNELS[:1], 2)
    assert len(few.later) == 2 and list(few.later[0].channels) == ["joint_angle"]


def test_opened_suites_are_those_that_were_scored():
    """By the first digits of their plans, as they stand in the pages of what was found."""
    assert [made.digest[:8] for made, _ in opened()] == ["a9dee96a", "7c041c02"]
    assert [[one.name for one in plants] for _, plants in opened()] == [
        ["alder", "birch", "cedar"],
        ["elm", "fir", "hazel"],
    ]


def decided(kind: str, effects: tuple[str, ...], verdict: str, *said: tuple[tuple[str, ...], float]) -> Decided:
    case = JudgedCase("1", kind, "level_0", 0, 0, dict.fromkeys(effects, (0, 0.5)), None, False, 0)
    named = tuple(dict.fromkeys(name for those, _ in said for name in those if name in IDS))
    return Decided(case, Decision(verdict, 0.01, said, np.zeros(len(IDS)), named if verdict != "no_gap" else ()))


def test_shares_count_the_cases_that_they_are_of():
    found = rates(
        [
            decided("healthy", (), "no_gap", ((), 0.9)),
            decided("healthy", (), "cause", (("payload",), 0.9)),
            decided("single", ("payload",), "cause", (("payload",), 0.9)),
            decided("single", ("payload",), "no_gap", ((), 0.9)),
            decided("single", ("payload",), "ambiguous", (("spool_lag",), 0.5), (("payload",), 0.4)),
            decided("pair", ("payload", "spool_lag"), "cause", (("payload",), 0.9)),
            decided("outside", (), "unknown", ((UNKNOWN,), 0.9)),
        ]
    )
    share = {name: (rate.value, rate.count) for name, rate in found.items()}
    assert share["false_alarms"] == (0.5, 2)
    assert share["noticed"] == (pytest.approx(2 / 3), 3) and share["named"] == (pytest.approx(1 / 3), 3)
    assert share["named_noticed"] == (0.5, 2) and share["declared"] == (1.0, 2) and share["declared_size"] == (1.5, 2)
    assert share["pairs_both"] == (0.0, 1) and share["pairs_one"] == (1.0, 1)
    assert share["outside"] == (1.0, 1) and share["known_rejected"] == (0.0, 4)
    # the healthy machine that is blamed, and the pair that is called one of its effects
    assert share["wrong_and_sure"] == (pytest.approx(2 / 7), 7)
    # Wilson's interval of 1 of 2: (1/2 ± z/2 √(1/(2 n) · ...)) as tabled, 9.5 to 90.5 %
    assert (found["false_alarms"].low95, found["false_alarms"].high95) == pytest.approx((0.0945, 0.9055), abs=1e-3)


def test_the_truth_of_a_case_is_a_hypothesis():
    made = planned(5, SMALL)
    numbers = {kind: {truth_of(c) for c in made.cases if c.kind == kind} for kind in ("healthy", "outside")}
    assert numbers == {"healthy": {0}, "outside": {1}}


def test_families_weigh_the_same_whatever_their_number_of_cases():
    family = np.array(["oak", "oak", "oak", "ash"])
    weights = family_weights(family)
    np.testing.assert_allclose(weights, [2 / 3, 2 / 3, 2 / 3, 2.0])
    assert weights.sum() == pytest.approx(len(family))


def test_layered_plants_calibrate_nothing():
    """What networks say of layered plants does not move a decision on another family."""
    rng = np.random.default_rng(3)
    families = [*["alder"] * 40, *["elm"] * 40, *["level_0"] * 40]
    cases = [JudgedCase(str(k), "healthy", name, 0, 0, {}, None, False, k) for k, name in enumerate(families)]
    shares = rng.dirichlet(np.full(hypotheses.HYPOTHESES, 0.1), len(cases))
    truth = np.tile([hypotheses.NOTHING, hypotheses.SINGLE], 60)
    layered = ~calibrating(np.array(families))
    assert layered.sum() == 40
    before = left_out(cases, shares, truth)
    shares[layered] = rng.dirichlet(np.full(hypotheses.HYPOTHESES, 0.1), 40)
    after = left_out(cases, shares, truth)
    independent = [(a.decision, b.decision) for a, b in zip(before, after, strict=True) if a.case.family != "level_0"]
    assert len(independent) == 80 and all(a.null_p == b.null_p and a.declared == b.declared for a, b in independent)
