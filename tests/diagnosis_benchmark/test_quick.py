"""A part of the quick suite, end to end: cases are made and sealed, diagnosed without their answers, and scored."""

import pytest

from aoro_gym.diagnosis_benchmark.cases import FAMILIES, SUITES, Suite
from aoro_gym.diagnosis_benchmark.running import read_diagnoses, run_cases
from aoro_gym.diagnosis_benchmark.scoring import Score, score_cases
from aoro_gym.diagnosis_benchmark.sealing import write_cases
from aoro_gym.execution.files import write_json

pytestmark = pytest.mark.slow

PART = Suite("part", null=1, single=1, pair=0, outside=0, nuisance=0, logs=SUITES["quick"].logs)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A healthy machine and one with an effect, with all sensors: an oracle that knows the machine's laws sees by the angle
    alone what nobody does who does not know them."""
    folder = tmp_path_factory.mktemp("quick")
    family = FAMILIES["development"]
    write_cases(PART, folder / "check", folder / "answers", mode="commissioned", sensors="full", family=family, seed=1)
    return folder


def scored(folder, out, diagnose=None) -> Score:
    assert run_cases(folder / "check", out, sensors="full", diagnose=diagnose) == {}
    sensors, found = read_diagnoses(folder / "check", out)
    assert sensors == "full" and list(found) == ["001", "002"]
    return score_cases(folder / "check", folder / "answers", out, folder / "oracle")


def no_gap(place, out, *, sensors, device):
    """A diagnosis that finds nothing, whatever the log."""
    empty = {"causes": [], "declared_set": [], "components": {}, "shrinkage": [], "logs": []}
    write_json(out / "diagnosis.json", {"verdict": "no_gap", **empty})


def check(score: Score) -> None:
    """Of a healthy machine nothing is said to be wrong, what an oracle sees is not called no gap; no wrong name is sure."""
    outcomes = score.outcomes
    assert (outcomes["false_alarms"].all.value, outcomes["false_alarms"].all.count) == (0.0, 1)
    assert outcomes["wrong_and_sure"].all.value == 0.0
    assert outcomes["named_first"].detectable.count == 1
    assert [case.verdict for case in score.cases if case.detectable and case.verdict == "no_gap"] == []


def test_a_part_of_the_quick_suite(folder, tmp_path):
    check(scored(folder, tmp_path))


def test_a_diagnosis_that_always_says_no_gap_fails(folder, tmp_path):
    with pytest.raises(AssertionError, match="no_gap"):
        check(scored(folder, tmp_path, no_gap))
