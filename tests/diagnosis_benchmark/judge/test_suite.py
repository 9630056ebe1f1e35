"""The plan of the suite: counts, seeds and runs."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from aoro_gym.diagnosis_benchmark import component_families
from aoro_gym.diagnosis_benchmark.judge.plants import JUDGED, ComponentPlants, IndependentPlants, judged_plants
from aoro_gym.diagnosis_benchmark.judge.suite import FAMILIAR, SUITES, Plan, plan
from tests.diagnosis_benchmark.judge.families import Made

FAMILIES = (Made("ash"), Made("beech"), Made("elm"))
SUITE = replace(SUITES["seal"], machines=4)


def planned(seed: int = 1) -> Plan:
    return plan(SUITE, FAMILIES, seed)


def test_the_same_seed_gives_the_same_plan_and_another_seed_another() -> None:
    assert planned().digest == planned().digest
    assert planned().digest != planned(2).digest
    assert plan(replace(SUITE, pairs=211), FAMILIES, 1).digest != planned().digest


def test_the_seal_holds_what_is_asked() -> None:
    found = planned()
    kinds = Counter(case.kind for case in found.cases)
    assert len(found.cases) >= 1500
    assert kinds["healthy"] >= 500
    assert kinds["pair"] >= 200
    assert kinds["outside"] >= 200
    assert min(Counter(c.family for c in found.cases if c.kind == "single").values()) >= 150
    novel = [case for case in found.cases if case.novel]
    assert len(novel) == kinds["outside"] // 2
    assert all(case.outside is not None and case.outside[0] not in FAMILIAR for case in novel)
    assert len({case.protocol for case in found.cases}) == SUITE.protocols >= 20
    assert len(set(found.protocols)) > 15
    shared = Counter((case.family, case.machine) for case in found.cases)
    assert len(shared) == SUITE.machines * len(FAMILIES)
    assert max(shared.values()) <= 2 * min(shared.values())
    assert len({case.seed for case in found.cases}) == len(found.cases)


def test_names_of_the_familiar_kinds_are_there() -> None:
    for plants in (IndependentPlants("alder"), ComponentPlants("fir")):
        familiar = FAMILIAR & set(plants.outside)
        assert len(plants.outside) >= 2 * len(familiar) - 1 >= 15
    assert {*IndependentPlants("alder").outside, *ComponentPlants("fir").outside} >= FAMILIAR


@pytest.mark.parametrize("names", [component_families.FAMILIES, component_families.SEALED])
def test_the_seal_can_be_planned_on_component_families(names: tuple[str, ...]) -> None:
    families = [ComponentPlants(name) for name in names]
    found = plan(SUITES["seal"], families, 1)
    assert len(found.cases) >= 1500
    kinds = {case.outside[0] for case in found.cases if case.outside is not None}
    assert kinds == set(component_families.OUTSIDE)
    for case in found.cases[::50]:
        plants = next(one for one in families if one.name == case.family)
        runs = found.runs(case, plants, found.machine(plants, case.machine))
        assert all(plants.magnitude(e, r.machine, s) for r in runs["logs"] for e, s in r.effects.items())


def test_groups_judge_by_families_of_their_own() -> None:
    judging = [one.name for group in JUDGED for one in judged_plants(group)]
    assert len(judging) == len(set(judging))
    assert [one.name for one in judged_plants("sealed")] == ["aspen", "pine", "yew"]


def test_cases_of_one_machine_share_its_healthy_day() -> None:
    found = planned()
    plants = FAMILIES[0]
    cases = [c for c in found.cases if c.family == plants.name and c.machine == 0][:2]
    first, second = (found.runs(case, plants, found.machine(plants, 0)) for case in cases)
    assert first["healthy"][0].machine == second["healthy"][0].machine
    assert first["logs"][0].machine != second["logs"][0].machine
    names = [run.excitation.name for run in first["logs"]]
    assert names == list(found.protocols[cases[0].protocol])
    assert len(names) == SUITE.logs


def test_a_pair_is_run_without_each_of_its_effects() -> None:
    found = planned()
    case = next(case for case in found.cases if case.kind == "pair" and case.family == "ash")
    runs = found.runs(case, FAMILIES[0], found.machine(FAMILIES[0], case.machine))
    both = set(runs["logs"][0].effects)
    assert len(both) == 2
    for name in both:
        assert set(runs[f"without {name}"][0].effects) == both - {name}
        assert runs[f"without {name}"][0].machine == runs["logs"][0].machine


def test_runs_of_a_case_are_the_same_each_time() -> None:
    found = planned()
    case = found.cases[0]
    plants = next(one for one in FAMILIES if one.name == case.family)
    logs = [
        plants.record(found.runs(case, plants, found.machine(plants, case.machine))["logs"], exact=False) for _ in "12"
    ]
    for a, b in zip(*logs, strict=True):
        np.testing.assert_array_equal(a["joint_angle"], b["joint_angle"])
