"""What the study of sensitivities says of two numbers, and how it writes its tables."""

import json

import numpy as np

from aoro_gym import Machine
from aoro_gym.validation.theory.sensitivities import FIGURES
from studies.sensitivities import Compared, counts, json_of, laws_apart, place_remarks, verdict


def test_verdicts():
    assert verdict(1e-5, -1e-5, 1e-3) == "none"
    assert verdict(0.01, 0.0112, 1e-4) == "near"
    assert verdict(0.01, 0.013, 1e-4) == "sign"
    assert verdict(0.01, -0.01, 1e-4) == "opposed"
    assert verdict(0.0, 0.01, 1e-4) == "not predicted"
    assert verdict(0.01, 0.0, 1e-4) == "not seen"
    assert verdict(0.01, float("nan"), 1e-4) == "no turn"
    rows = [
        {"figure": "a", "signal_percent": 50.0, "verdict": "near"},
        {"figure": "a", "signal_percent": 75.0, "verdict": "sign"},
    ]
    assert counts(rows) == {
        "all": {"near": 1, "sign": 1},
        "a": {"near": 1, "sign": 1},
        "50 %": {"near": 1},
        "75 %": {"sign": 1},
    }


def test_extremes_that_are_not_the_same_are_named():
    theory, twin = np.array([[0.30, 0.60], [0.30, 0.70]]), np.array([[0.31, 0.555], [0.42, 0.62]])
    first, second = place_remarks(theory, twin)
    assert "end of its window" in first[FIGURES[3]] and FIGURES[2] not in first
    assert "another minimum" in second[FIGURES[2]] and "another maximum" in second[FIGURES[3]]


def test_tables_are_written_a_row_a_line():
    text = json_of({"machine": "x", "rows": [{"a": 0.123456, "b": None}, {"a": float("nan"), "b": "c"}]})
    assert json.loads(text) == {"machine": "x", "rows": [{"a": 0.1235, "b": None}, {"a": None, "b": "c"}]}
    assert text.count("\n") == 7


def _compared(machine, theory, twin):
    """Of one level, one change and one figure."""
    theory, twin = (np.full((1, 1, 1), value) for value in (theory, twin))
    said = np.array(verdict(float(theory.item()), float(twin.item()), 1e-4)).reshape(1, 1, 1)
    none = np.zeros((1, 1, 1))
    return Compared(machine, theory, twin, none, said, (none, none), (none, none), none)


def test_a_disagreement_is_the_laws_that_has_it_alone():
    plain = Machine.load("aoro")
    own = _compared(plain.with_laws(compensator="static", hose="stiffening"), 0.01, 0.02)
    near, far, farther = (_compared(plain, 0.01, twin) for twin in (0.0101, 0.02, 0.03))
    laws = ("compensator", "static"), ("hose", "stiffening")

    def apart(default, *single):
        return laws_apart(own, dict(zip((("", ""), *laws), (default, *single), strict=True))).item()

    assert apart(near, far, near) == "compensator: static"
    assert apart(near, far, farther) == "hose: stiffening"
    assert apart(near, near, near) == "several laws"
    assert apart(far, far, near) == "default laws"
    own = near
    assert apart(far, far, far) == ""
