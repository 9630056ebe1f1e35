"""The matcher on plants by hand: what it says of nothing, of one effect, of two that are alike, and of something else."""

from functools import cache

import numpy as np

from aoro_gym.diagnosis_benchmark.judge.library import Extent, Library, build
from aoro_gym.diagnosis_benchmark.judge.matcher import Matcher, write
from aoro_gym.diagnosis_benchmark.judge.observed import Observed, changed, observe
from aoro_gym.diagnosis_benchmark.judge.suite import JudgedCase, Plan, Suite, plan
from aoro_gym.diagnosis_benchmark.judge.verdicts import Reference
from aoro_gym.execution.files import read_json
from tests.diagnosis_benchmark.judge.families import Made

SUITE = Suite("by hand", 6, 9, 0, 3, 2, 1, 2, 1, ("left_50", "steps_1"))
FAMILY = Made("law_0.05", 0.05)


EXTENT = Extent(12, 4, 2, (0.0, 0.2, 0.4, 0.6, 0.8, 1.0))
MANOEUVRES = SUITE.only or ()


@cache
def library(law: float) -> Library:
    excitations = list(plan(SUITE, [FAMILY], 3).excitations.values())
    return build(Made(f"law_{law}", law), excitations, EXTENT, seed=1)


@cache
def matcher(own: bool = False) -> Matcher:
    """A matcher that four families with other laws have taught."""
    others = [library(law) for law in (-0.1, -0.05, 0.0, 0.1)]
    if own:
        return matcher().knowing(Reference.of(others, MANOEUVRES, "pressures", own=library(0.05)))
    return Matcher.of(others, MANOEUVRES, "pressures")


@cache
def observed() -> tuple[Plan, dict[str, tuple[JudgedCase, Observed]]]:
    made = plan(SUITE, [FAMILY], 3)
    found = observe(made, FAMILY, made.cases)
    return made, {case.name: (case, found[case.name]) for case in made.cases}


def said(kind: str, *, own: bool = False) -> list[tuple[JudgedCase, dict]]:
    made, cases = observed()
    return [
        (case, matcher(own).diagnose(changed(made, seen.healthy, seen.logs)))
        for case, seen in cases.values()
        if case.kind == kind
    ]


def test_healthy_machines_have_no_gap() -> None:
    verdicts = [found["verdict"] for _, found in said("healthy")]
    assert verdicts.count("no_gap") >= len(verdicts) - 1


def test_an_effect_is_named_and_two_that_are_alike_are_both_declared() -> None:
    for own in (False, True):
        large = [(c, f) for c, f in said("single", own=own) if next(iter(c.effects.values()))[1] > 0.3]
        assert len(large) > 3
        for case, found in large:
            (effect,) = case.effects
            assert effect in found["declared_set"]
            assert found["verdict"] == ("cause" if effect == "one" else "ambiguous")
            assert found["causes"][0]["effects"][0] in ({"one"} if effect == "one" else {"two", "twin"})
            assert abs(sum(cause["probability"] for cause in found["causes"]) - 1.0) < 1e-9


def test_the_exact_change_is_the_logs_without_their_noise() -> None:
    made, cases = observed()
    case, seen = next((c, s) for c, s in cases.values() if c.kind == "single" and "one" in c.effects)
    noisy = changed(made, seen.healthy, seen.logs)
    for name, change in seen.change.items():
        # means of some 40 effective samples of either log, 1 mrad each
        assert np.max(np.abs(noisy[name][0] - change[0])) < 5 * 1e-3 * np.sqrt(2 / 40)
        assert np.max(np.abs(change[0])) > 0.0
    assert case.name == next(iter(n for n, (c, _) in cases.items() if c is case))


def test_a_diagnosis_is_written_as_any_other(tmp_path) -> None:
    (_, found), *_ = said("single")
    write(found, tmp_path / "0001")
    kept = read_json(tmp_path / "0001" / "diagnosis.json")
    assert kept["verdict"] == found["verdict"]
    assert {"effects", "probability", "magnitudes"} <= set(kept["causes"][0])
