"""The study of how twins scale with devices."""

import json
import sys

from studies import device_scaling


def test_it_compares_one_device_with_all(tmp_path, monkeypatch):
    arguments = [str(tmp_path / "out.json"), "--device", "cpu,cpu", "--twins", "4", "--repeats", "1", "--steps", "1"]
    monkeypatch.setattr(sys, "argv", ["device_scaling", *arguments])
    device_scaling.main()
    (row,) = json.loads((tmp_path / "out.json").read_text())["rows"]
    assert row["devices"] == ["cpu", "cpu"] and row["apart"] == 0.0 and row["diverged"] == 0
    assert row["ratios"]["step"] == row["steps_per_s"]["step, all"][1] / row["steps_per_s"]["step, one"][1]
