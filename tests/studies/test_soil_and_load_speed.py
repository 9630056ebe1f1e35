"""The study of steps a second on soil and with a load."""

import json
import sys

import pytest

from studies import soil_and_load_speed


def test_it_compares_soil_and_load_with_neither(tmp_path, monkeypatch):
    monkeypatch.setattr(soil_and_load_speed, "TWIN_STEPS", 40)
    monkeypatch.setattr(
        sys, "argv", ["soil_and_load_speed", str(tmp_path / "out.json"), "--twins", "1", "2", "--repeats", "1"]
    )
    soil_and_load_speed.main()
    rows = json.loads((tmp_path / "out.json").read_text())["rows"]
    assert [row["twins"] for row in rows] == [1, 2]
    for row in rows:
        for name in ("soil", "load"):
            assert row[f"{name}_ratio"] == pytest.approx(row["hard_steps_per_s"] / row[f"{name}_steps_per_s"])
