"""The study of steps a second on soil."""

import json
import sys

import pytest

from studies import soil_speed


def test_it_compares_hard_and_soft_ground(tmp_path, monkeypatch):
    monkeypatch.setattr(soil_speed, "TWIN_STEPS", 40)
    monkeypatch.setattr(sys, "argv", ["soil_speed", str(tmp_path / "out.json"), "--twins", "1", "2", "--repeats", "1"])
    soil_speed.main()
    rows = json.loads((tmp_path / "out.json").read_text())["rows"]
    assert [row["twins"] for row in rows] == [1, 2]
    for row in rows:
        assert row["ratio"] == pytest.approx(row["hard_steps_per_s"] / row["soil_steps_per_s"])
