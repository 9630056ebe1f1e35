"""A part of the quick suite, end to end: cases are made and sealed, diagnosed without their answers, and scored."""

import pytest

from aoro_gym.diagnosis_benchmark.cases import FAMILIES, SUITES, Suite
from aoro_gym.diagnosis_benchmark.running import diagnoses_folder, read_diagnoses, run_cases
from aoro_gym.diagnosis_benchmark.scoring import score_cases
from aoro_gym.diagnosis_benchmark.sealing import write_cases

PART = Suite("part", null=1, single=0, pair=0, outside=0, nuisance=0, logs=SUITES["quick"].logs)


@pytest.mark.slow
def test_a_part_of_the_quick_suite(tmp_path):
    """Of a healthy machine nothing is said to be wrong, and the score says so. By the angle alone, which takes less time."""
    cases, answers, out = tmp_path / "check", tmp_path / "answers.json", diagnoses_folder(tmp_path / "check", "angle")
    family = FAMILIES["development"]
    write_cases(PART, cases, answers, mode="commissioned", sensors="angle", family=family, seed=1)
    assert run_cases(cases, out, sensors="angle") == {}
    sensors, found = read_diagnoses(cases, out)
    assert sensors == "angle" and list(found) == ["001"]
    outcomes = score_cases(cases, answers, out, tmp_path / "oracle").outcomes
    assert (outcomes["false_alarms"].all.value, outcomes["false_alarms"].all.count) == (0.0, 1)
    assert outcomes["wrong_and_sure"].all.value == 0.0
    assert outcomes["named_first"].all.count == 0
