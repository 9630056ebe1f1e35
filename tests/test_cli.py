"""The command line: every verb works, every wrong input is said in one line with exit code 2."""

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from aoro_gym import __version__
from aoro_gym.cli import app
from aoro_gym.log import read_table

runner = CliRunner()


def call(*arguments: str | Path) -> Result:
    """Run the command; its exceptions are ours."""
    return runner.invoke(app, [str(argument) for argument in arguments], catch_exceptions=False)


@pytest.fixture(scope="module")
def turn(tmp_path_factory) -> tuple[Path, Result]:
    """A short left turn with a parameter changed, and what was printed."""
    path = tmp_path_factory.mktemp("turn") / "log.csv"
    slow = "steering.valve.spool_time_constant=2"
    return path, call("simulate", "--manoeuvre", "left", "--duration", "1.2", "--scale", slow, "--out", path)


def test_version_and_help():
    assert call("--version").stdout == f"aoro-gym {__version__}\n"
    for verb in ("parameters", "simulate", "demo", "bench"):
        shown = call(verb, "--help")
        assert shown.exit_code == 0
        assert "Examples" in shown.stdout
        assert f"aoro-gym {verb}" in shown.stdout


def test_runs_as_a_module():
    command = [sys.executable, "-m", "aoro_gym", "--version"]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()[1] == __version__


def test_parameters_table():
    shown = call("parameters", "steering.valve.nominal_flow*")
    assert shown.exit_code == 0
    assert "steering.valve.nominal_flow_left" in shown.stdout
    assert "70.6" in shown.stdout
    assert "L/min" in shown.stdout


def test_parameters_json_follows_set_and_scale():
    shown = call("parameters", "oil.*", "--json", "--set", "oil.gas_fraction=0.01", "--scale", "oil.bulk_modulus=0.5")
    rows = {row["key"]: row for row in json.loads(shown.stdout)}
    assert rows["oil.gas_fraction"]["value"] == 0.01
    plain = {row["key"]: row for row in json.loads(call("parameters", "oil.*", "--json").stdout)}
    assert rows["oil.bulk_modulus"]["value"] == pytest.approx(0.5 * plain["oil.bulk_modulus"]["value"])
    assert set(plain["oil.bulk_modulus"]) >= {"key", "value", "unit", "range", "role", "source"}


def test_simulate_writes_log_manifest_figures_and_plots(turn):
    path, shown = turn
    assert shown.exit_code == 0
    for suffix in (".csv", ".toml", ".json", ".png", ".html"):
        assert path.with_suffix(suffix).stat().st_size > 0
        assert f"wrote {path.with_suffix(suffix)}" in shown.stdout
    table = read_table(path)
    np.testing.assert_allclose(table["time_s"], np.arange(1, 121) / 100)
    assert table["joint_angle_deg"][0] == pytest.approx(-40.0, abs=0.1)
    assert np.all(table["steering_signal_V"][table["time_s"] > 0.605] == 0.5)
    manifest = tomllib.loads(path.with_suffix(".toml").read_text())
    assert manifest["machine"]["scale"] == ["steering.valve.spool_time_constant=2"]
    assert manifest["sensors"] == "ideal"
    figures = json.loads(path.with_suffix(".json").read_text())["figures"]
    assert figures["turn_time_s"] is None
    assert figures["highest_pressure_a_bar"] > 50


def test_simulate_says_that_the_turn_was_cut(turn):
    assert "did not reach its stop" in turn[1].stdout


def test_simulate_is_repeatable(turn, tmp_path):
    slow = "steering.valve.spool_time_constant=2"
    again = tmp_path / "again.csv"
    call("simulate", "--manoeuvre", "left", "--duration", "1.2", "--scale", slow, "--out", again)
    assert again.read_bytes() == turn[0].read_bytes()


def test_simulate_a_file_on_a_slope(tmp_path):
    commands = tmp_path / "commands.csv"
    commands.write_text("time_s,drive_signal,steering_signal\n0,0,0\n0.2,0.4,-0.5\n0.6,0,0\n")
    out = tmp_path / "log.parquet"
    options = ["--start-angle", "10", "--terrain-slope", "6", "--terrain-direction", "90", "--terrain-friction", "0.8"]
    shown = call("simulate", "-m", commands, "--out", out, *options)
    assert shown.exit_code == 0, shown.output
    table = read_table(out)
    assert table["joint_angle_deg"][0] == pytest.approx(10.0, abs=0.1)
    assert table["joint_angle_deg"][-1] < 10.0
    assert tomllib.loads(out.with_suffix(".toml").read_text())["ground"]["slope_deg"] == 6.0


def test_demo(tmp_path):
    shown = call("demo", "--out", tmp_path / "demo")
    assert shown.exit_code == 0, shown.output
    page = (tmp_path / "demo" / "index.html").read_text(encoding="utf-8")
    assert "Full turn left" in page
    assert "Straight drive" in page
    assert str(tmp_path / "demo" / "index.html") in shown.stdout
    for name in ("left_turn", "straight_drive"):
        assert (tmp_path / "demo" / f"{name}.png").exists()


def test_bench(tmp_path):
    path = tmp_path / "bench.json"
    shown = call("bench", "--twins", "1,2", "--seconds", "0.05", "--json", path)
    assert shown.exit_code == 0, shown.output
    result = json.loads(path.read_text())
    assert [case["twins"] for case in result["cases"]] == [1, 2]
    for case in result["cases"]:
        assert case["what"] == "twin"
        assert case["device"] == "cpu"
        assert 0 < case["min"] <= case["steps_per_s"] <= case["max"]
    assert set(result) == {"machine", "cases", "peers", "ratios"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("simulate -m up", "--manoeuvre 'up' is none of left, right, drive"),
        ("simulate -m none.csv", "file none.csv does not exist"),
        ("simulate -m bad.csv", "bad.csv, line 3: steering_signal = 2 is outside [-1, 1]"),
        ("simulate -m good.csv --out good.csv", "would overwrite the commands in good.csv"),
        ("simulate -m good.csv --out good.parquet", "would overwrite the commands in good.csv"),
        ("simulate -m good.csv --signal 50", "--signal = 50 serves left, right and drive"),
        ("simulate -m good.csv --start-angle 41", "--start-angle = 41 is outside [-40, 40] deg"),
        ("simulate -m good.csv --start-angle nan", "--start-angle = nan is outside"),
        ("simulate -m left --start-angle 5", "--start-angle serves a command file only"),
        ("simulate -m left --signal nan", "--signal = nan is outside (0, 100] %"),
        ("simulate -m right --signal -50", "--signal = -50 is outside (0, 100] %"),
        ("simulate -m left --duration 0.2", "--duration = 0.2 is outside [0.61, 3600] s"),
        ("simulate -m left --out log.xlsx", "log log.xlsx must end in .csv or .parquet"),
        ("simulate -m left --device tpu", "--device 'tpu' is not available here; choose one of: cpu"),
        ("simulate -m left --seed -1", "--seed = -1 is below 0"),
        ("simulate -m left --machine tractor", "no bundled machine 'tractor'"),
        ("simulate -m left --machine none.toml", "no machine file none.toml"),
        ("simulate -m left --machine bad.toml", "bad.toml"),
        ("simulate -m left --set joint.range", "--set 'joint.range' is not KEY=NUMBER"),
        ("simulate -m left --set joint.rang=1", "unknown parameter 'joint.rang': did you mean 'joint.range'?"),
        ("simulate -m left --set joint.range=wide", "--set joint.range=wide: 'wide' is not a finite number"),
        ("simulate -m left --set joint.range=1 --set joint.range=2", "--set names joint.range twice"),
        ("simulate -m left --set joint.range=1 --scale joint.range=2", "given to both --set and --scale"),
        ("simulate -m left --scale wheel.mass=-1", "wheel.mass = -220 kg"),
        ("simulate -m left --terrain-slope 60", "terrain slope_deg = 60 is outside [-45, 45] deg"),
        ("parameters nothing.like.it", "no parameter matches 'nothing.like.it'"),
        ("demo --out good.csv", "--out good.csv is a file; name a folder"),
        ("bench --twins 0", "--twins '0': '0' is no whole number from 1"),
        ("bench --twins 1,many", "'many' is no whole number from 1"),
        ("bench --seconds nan", "--seconds = nan is outside (0, 600] s"),
        ("bench --json .", ". is a folder; name a file in it"),
    ],
)
def test_wrong_input_is_one_line_before_anything_runs(tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    Path("good.csv").write_text("time_s,steering_signal\n0,0\n1,0.5\n")
    Path("bad.csv").write_text("time_s,steering_signal\n0,0\n1,2\n")
    Path("bad.toml").write_text("value = [")
    before = sorted(Path().iterdir())
    shown = call(*arguments.split())
    assert shown.exit_code == 2
    assert shown.stdout == ""
    lines = shown.stderr.strip().splitlines()
    assert len(lines) == 1, shown.stderr
    assert lines[0].startswith("error: ")
    assert message in lines[0]
    assert sorted(Path().iterdir()) == before
    assert Path("good.csv").read_text() == "time_s,steering_signal\n0,0\n1,0.5\n"
