"""The study of steps a second on soil, with a load, with a crane, and among objects."""

import json
import sys

import pytest

from studies import soil_and_load_speed


def test_it_compares_each_with_neither(tmp_path, monkeypatch):
    monkeypatch.setattr(soil_and_load_speed, "TWIN_STEPS", 40)
    asked = ["--twins", "1", "2", "--repeats", "1", "--kinds", "soil", "load", "crane"]
    monkeypatch.setattr(sys, "argv", ["soil_and_load_speed", str(tmp_path / "out.json"), *asked])
    soil_and_load_speed.main()
    rows = json.loads((tmp_path / "out.json").read_text())["rows"]
    assert [row["twins"] for row in rows] == [1, 2]
    for row in rows:
        for name in ("soil", "load", "crane"):
            assert row[f"{name}_ratio"] == pytest.approx(row["hard_steps_per_s"] / row[f"{name}_steps_per_s"])
