"""Work goes on only with what it was begun with."""

import json
from pathlib import Path

import numpy as np
import pytest

from aoro_gym.execution import provenance
from aoro_gym.execution.digest import Contents, sources
from aoro_gym.execution.provenance import ChangedCode, ChangedInput, changed_inputs, check_provenance


def test_the_same_inputs_go_on(tmp_path: Path):
    file = tmp_path / "provenance.json"
    for _ in range(2):
        check_provenance(file, {"machine": {"front.mass": 4800.0}, "seed": 3, "weights": [1.0, 2.0]})
    assert json.loads(file.read_text())["inputs"]["machine front.mass"] == "4800.0"


@pytest.mark.parametrize(
    ("now", "says"),
    [
        ({"machine": {"front.mass": 4900.0}, "seed": 3}, "machine front.mass was 4800.0, is 4900.0"),
        ({"machine": {"front.mass": 4800.0}, "seed": 4}, "seed was 3, is 4"),
        ({"machine": {"front.mass": 4800.0}}, "seed was 3, is absent"),
        ({"machine": {"front.mass": 4800.0, "rear.mass": 1.0}, "seed": 3}, "rear.mass was absent, is 1.0"),
    ],
)
def test_a_changed_input_is_refused_by_name(tmp_path: Path, now: dict, says: str):
    file = tmp_path / "provenance.json"
    check_provenance(file, {"machine": {"front.mass": 4800.0}, "seed": 3})
    with pytest.raises(ChangedInput, match=says):
        check_provenance(file, now, accept_code_change=True)


def test_a_changed_file_is_refused_by_name(tmp_path: Path):
    terrain, file = tmp_path / "forest.ply", tmp_path / "provenance.json"
    terrain.write_text("a")
    check_provenance(file, {"terrain": Contents(terrain)})
    terrain.write_text("b")
    with pytest.raises(ChangedInput, match="terrain has changed"):
        check_provenance(file, {"terrain": Contents(terrain)})


def test_changed_code_is_named_and_may_be_accepted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    file = tmp_path / "provenance.json"
    check_provenance(file, {"seed": 3})
    edited = {**sources(), "twin/kernels/advance.py": "0" * 16}
    monkeypatch.setattr(provenance, "sources", lambda: edited)
    with pytest.raises(ChangedCode, match=r"twin/kernels/advance.py has changed.*--accept-code-change"):
        check_provenance(file, {"seed": 3})
    check_provenance(file, {"seed": 3}, accept_code_change=True)
    accepted = json.loads(file.read_text())["accepted_code_changes"]
    assert accepted[0]["changes"] == ["twin/kernels/advance.py has changed"]
    check_provenance(file, {"seed": 3})  # the new code is what the folder goes on with


def test_short_lists_are_shown_and_numbers_of_every_kind_are_numbers(tmp_path: Path):
    file = tmp_path / "provenance.json"
    check_provenance(file, {"net_arch": [64, 64], "rate": np.float64(0.5)})
    check_provenance(file, {"net_arch": (64, 64), "rate": 0.5})
    with pytest.raises(ChangedInput, match=r"net_arch was \[64, 64\], is \[64, 32\]"):
        check_provenance(file, {"net_arch": [64, 32], "rate": 0.5})


def test_some_inputs_are_compared_without_the_others(tmp_path: Path):
    file = tmp_path / "provenance.json"
    check_provenance(file, {"machine": {"mass": 1.0, "length": 2.0}, "machine_name": "a", "seed": 3})
    assert changed_inputs(file, {"machine": {"mass": 1.0, "length": 2.0}}) == []
    assert changed_inputs(file, {"machine": {"mass": 1.5}}) == [
        "machine length was 2.0, is absent",
        "machine mass was 1.0, is 1.5",
    ]
    assert changed_inputs(file, {"seed": 4}) == ["seed was 3, is 4"]
    with pytest.raises(FileNotFoundError):
        changed_inputs(tmp_path / "none.json", {})


def test_results_without_a_record_are_of_unknown_code(tmp_path: Path):
    file = tmp_path / "provenance.json"
    with pytest.raises(ChangedCode, match=r"without a record.*--accept-code-change"):
        check_provenance(file, {"seed": 3}, begun=True)
    assert not file.exists()
    check_provenance(file, {"seed": 3}, begun=True, accept_code_change=True)
    assert json.loads(file.read_text())["accepted_code_changes"]
