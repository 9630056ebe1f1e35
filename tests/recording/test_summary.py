"""What `aoro-gym diagnose --check` says: what was read, in which units, what is missing and what is not read."""

from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from aoro_gym.cli import app

K = np.arange(300)


def log(path, pressure="pressure_a_kPa", factor=100.0):
    signal = np.where((K > 50) & (K < 250), 0.6, 0.0)
    angle = 0.0018 * np.cumsum(signal) + 2e-4 * np.random.default_rng(0).standard_normal(len(K))
    lines = [f"time [ms],steering_signal_V,joint_angle_deg,{pressure},[/x],true_spool"]
    for k, u, a in zip(K, signal, angle, strict=True):
        lines.append(f"{10 * k},{2.5 - 2 * u},{np.degrees(a):.5f},{factor * (20 + 60 * (u > 0) + a):.3f},idle,nan")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return str(path)


def test_check_says_what_was_read_and_writes_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shown = CliRunner().invoke(app, ["diagnose", "--check", log(tmp_path / "good.csv")])
    assert shown.exit_code == 0, shown.output
    for text in (
        "good.csv: 2.99 s at 100 Hz, the first 0.52 s at rest",
        "time: time [ms], in ms",
        "command steering_signal: steering_signal_V, in V, 0 to 0.6",
        "joint_angle: joint_angle_deg, in deg, ",
        "pressure_a: pressure_a_kPa, in kPa, 20 to 80.21 bar",
        "missing: pressure_b, pump_pressure",
        "not read: [/x], true_* (1, of a simulator)",
        "note: good.csv: unknown columns were not read: [/x]",
    ):
        assert text in shown.stdout
    assert [path.name for path in tmp_path.iterdir()] == ["good.csv"]


def test_what_a_sum_of_floats_leaves_of_zero_is_zero(tmp_path):
    path = tmp_path / "zero.csv"
    lines = Path(log(path)).read_text(encoding="utf-8").splitlines()
    cells = [line.split(",") for line in lines]
    cells[10][3] = "1e-12"
    path.write_text("\n".join(map(",".join, cells)) + "\n", encoding="utf-8")
    shown = CliRunner().invoke(app, ["diagnose", "--check", str(path)])
    assert "pressure_a: pressure_a_kPa, in kPa, 0 to 80.21 bar" in shown.stdout


def test_check_of_a_log_that_is_refused_ends_with_2_after_all_were_read(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    bad = log(tmp_path / "bad.csv", "pressure_a_bar")
    shown = CliRunner().invoke(app, ["diagnose", "--check", bad, log(tmp_path / "good.csv")])
    assert shown.exit_code == 2
    assert "good.csv: 2.99 s" in shown.stdout
    first, last = shown.stderr.splitlines()
    assert first.startswith("error: ") and "hoses burst" in first
    assert last == "error: 1 of 2 logs cannot be used"
