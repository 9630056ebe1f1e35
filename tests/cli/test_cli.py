"""The command line: every verb works, every wrong input is said in one line with exit code 2."""

import json
import math
import subprocess
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import typer
from rich.text import Text
from typer.core import TyperGroup
from typer.testing import CliRunner, Result

from aoro_gym import Machine, __version__, validation
from aoro_gym.calibration.published import Calibration
from aoro_gym.cli import app
from aoro_gym.recording.tables import read_table

runner = CliRunner()


def call(*arguments: str | int | Path) -> Result:
    """Run the command; its exceptions are ours."""
    return runner.invoke(app, [str(argument) for argument in arguments], catch_exceptions=False)


@pytest.fixture(scope="module")
def turn(tmp_path_factory) -> tuple[Path, Result]:
    """A short left turn with a parameter changed, and what was printed."""
    path = tmp_path_factory.mktemp("turn") / "log.csv"
    slow = "steering.valve.spool_time_constant=2"
    return path, call("simulate", "--manoeuvre", "left", "--duration", "1.6", "--scale", slow, "--out", path)


def test_version_and_help():
    assert call("--version").stdout == f"aoro-gym {__version__}\n"
    verbs = "parameters simulate validate calibrate demo terrain evaluate leaderboard curves gap train export bench"
    for verb in verbs.split():
        shown = call(verb, "--help")
        assert shown.exit_code == 0
        assert "Examples" in shown.stdout
        assert f"aoro-gym {verb}" in shown.stdout


def test_help_shows_every_word():
    # rich takes words in brackets for styles and leaves them out
    group = typer.main.get_command(app)
    assert isinstance(group, TyperGroup)
    for verb, command in group.commands.items():
        for text in (command.help, *(getattr(parameter, "help", None) for parameter in command.params)):
            styles = {str(span.style) for span in Text.from_markup(text or "").spans}
            assert styles <= {"bold"}, f"{verb}: {text}"


def test_help_fits_80_columns():
    group = typer.main.get_command(app)
    assert isinstance(group, TyperGroup)
    nested = group.commands["blind"]
    assert isinstance(nested, TyperGroup)
    for verb in [*group.commands, *(f"blind {name}" for name in nested.commands)]:
        shown = runner.invoke(app, [*verb.split(), "--help"], env={"COLUMNS": "80", "TERMINAL_WIDTH": "80"})
        assert shown.exit_code == 0
        for line in shown.stdout.splitlines():
            assert len(line) <= 80 and "…" not in line, f"{verb}: {line}"


def test_long_commands_can_be_quiet():
    group = typer.main.get_command(app)
    assert isinstance(group, TyperGroup)
    nested = group.commands["blind"]
    assert isinstance(nested, TyperGroup)
    commands = {**group.commands, **{f"blind {name}": one for name, one in nested.commands.items()}}
    lacking = {name for name, one in commands.items() if "--quiet" not in {text for p in one.params for text in p.opts}}
    assert lacking == {"parameters", "blind"}


def test_runs_as_a_module():
    command = [sys.executable, "-m", "aoro_gym", "--version"]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()[1] == __version__


def test_parameters_table():
    shown = call("parameters", "steering.valve.nominal_flow*", "--machine", "aoro_datasheet")
    assert shown.exit_code == 0
    assert "steering.valve.nominal_flow_left" in shown.stdout
    assert " 62 " in shown.stdout
    assert "L/min" in shown.stdout


def test_effects_are_listed_with_what_they_measure():
    shown = call("parameters", "--effects", "joint")
    assert "joint_backlash" in shown.stdout
    assert "pump_response" not in shown.stdout
    options = ("--json", "--scale", "driveline.brake.disc_torque=2")
    doubled, plain = (
        json.loads(call("parameters", "driveline", "--effects", *more).stdout)[0] for more in (options, options[:1])
    )
    assert doubled["id"] == plain["id"] == "driveline_resistance"
    assert doubled["operational"][0]["none"] == pytest.approx(2.0 * plain["operational"][0]["none"])
    assert doubled["operational"][0]["high"] - doubled["operational"][0]["none"] == pytest.approx(1000.0)


def test_parameters_json_follows_set_and_scale():
    shown = call("parameters", "oil.*", "--json", "--set", "oil.gas_fraction=0.01", "--scale", "oil.bulk_modulus=0.5")
    rows = {row["key"]: row for row in json.loads(shown.stdout)}
    assert rows["oil.gas_fraction"]["value"] == 0.01
    plain = {row["key"]: row for row in json.loads(call("parameters", "oil.*", "--json").stdout)}
    assert rows["oil.bulk_modulus"]["value"] == pytest.approx(0.5 * plain["oil.bulk_modulus"]["value"])
    assert set(plain["oil.bulk_modulus"]) >= {"key", "value", "unit", "range", "role", "source"}


def test_implausible_values_are_named_once_on_the_terminal():
    result = call("parameters", "spool_time_constant", "--set", "steering.valve.spool_time_constant=5", "--json")
    assert result.exit_code == 0
    assert " ".join(result.stderr.split()) == (
        "warning: steering.valve.spool_time_constant = 5 s: outside of its plausible range 0.008 to 0.06 s; "
        "physically possible, so it is taken"
    )
    assert json.loads(result.stdout)[0]["value"] == 5.0
    assert "warning" not in call("parameters", "spool_time", "--set", "steering.valve.spool_time_constant=0.02").output


def test_simulate_writes_log_manifest_figures_and_plots(turn):
    path, shown = turn
    assert shown.exit_code == 0
    for suffix in (".csv", ".toml", ".json", ".png", ".html"):
        assert path.with_suffix(suffix).stat().st_size > 0
        assert f"wrote {path.with_suffix(suffix)}" in shown.stdout
    table = read_table(path)
    np.testing.assert_allclose(table["time_s"], np.arange(1, 161) / 100)
    noise = table["joint_angle_rad"] - np.radians(table["true_joint_angle_deg"])
    assert 0.0 < np.abs(noise).max() < np.radians(1.0)
    assert np.any(table["pressure_a_bar"] != table["true_pressure_a_bar"])
    np.testing.assert_array_equal(table["engine_speed_rpm"], table["true_engine_speed_rpm"])
    assert np.all(table["steering_signal_V"][table["time_s"] > 0.605] == 0.5)
    manifest = tomllib.loads(path.with_suffix(".toml").read_text())
    assert manifest["machine"]["scale"] == ["steering.valve.spool_time_constant=2"]
    assert manifest["sensors"].startswith("joint angle: published kind of noise")
    assert manifest["simulation"]["seed"] == 0
    figures = json.loads(path.with_suffix(".json").read_text())["figures"]
    assert figures["turn_time_s"] is None
    assert figures["highest_pressure_a_bar"] > 50


def test_simulate_says_that_the_turn_was_cut(turn):
    assert "did not reach its stop" in turn[1].stdout


def test_simulate_is_repeatable(turn, tmp_path):
    slow = "steering.valve.spool_time_constant=2"
    again = tmp_path / "again.csv"
    call("simulate", "--manoeuvre", "left", "--duration", "1.6", "--scale", slow, "--out", again)
    assert again.read_bytes() == turn[0].read_bytes()


def test_simulate_a_file_on_a_slope(tmp_path):
    commands = tmp_path / "commands.csv"
    commands.write_text("time_s,drive_signal,steering_signal\n0,0,0\n0.2,0.4,-0.5\n0.6,0,0\n")
    out = tmp_path / "log.parquet"
    options = [
        "--ideal-sensors",
        "--start-angle",
        "10",
        "--terrain-slope",
        "6",
        "--terrain-direction",
        "90",
        "--terrain-friction",
        "0.8",
    ]
    shown = call("simulate", "-m", commands, "--out", out, *options)
    assert shown.exit_code == 0, shown.output
    table = read_table(out)
    angle = np.degrees(table["joint_angle_rad"])
    np.testing.assert_allclose(angle, table["true_joint_angle_deg"], rtol=1e-12)
    assert angle[0] == pytest.approx(10.0, abs=0.1)
    assert angle[-1] < 10.0
    assert tomllib.loads(out.with_suffix(".toml").read_text())["sensors"] == "ideal"
    assert tomllib.loads(out.with_suffix(".toml").read_text())["ground"]["slope_deg"] == 6.0


def test_seed_draws_the_noise(turn, tmp_path):
    slow = "steering.valve.spool_time_constant=2"
    other = tmp_path / "other.csv"
    call("simulate", "-m", "left", "--duration", "1.6", "--scale", slow, "--seed", "1", "--out", other)
    first, second = read_table(turn[0]), read_table(other)
    assert np.any(first["joint_angle_rad"] != second["joint_angle_rad"])
    np.testing.assert_array_equal(first["true_joint_angle_deg"], second["true_joint_angle_deg"])


@pytest.mark.slow
def test_demo(tmp_path):
    shown = call("demo", "--out", tmp_path / "demo")
    assert shown.exit_code == 0, shown.output
    page = (tmp_path / "demo" / "index.html").read_text(encoding="utf-8")
    assert "Full turn left" in page
    assert "Straight drive" in page
    assert str(tmp_path / "demo" / "index.html") in shown.stdout
    assert "of 25 figures of the published machine itself are met, and" in page
    assert "of 21 of its published twin. Farthest from the machine: the first peak at 50 % signal, +" in page
    assert "AORO/Turning-v0" in page
    assert page.count("data:image/gif;base64,") == 1
    assert page.count("data:video/mp4;base64,") == 1
    assert "bridged over gaps" in page
    assert "They ended so: end of path reached; end of path reached." in page
    assert "policy paths-dagger of AORO/PathTracking-v0" in page and "pure-pursuit on the same path" in page
    pictures = ("left_turn.png", "straight_drive.png", "turning.gif", "drive/drive.mp4", "drive/plan_1.png")
    for name in (*pictures, "drive/scan.ply", "validation/index.html"):
        assert (tmp_path / "demo" / name).exists()
    assert json.loads((tmp_path / "demo" / "validation" / "validation.json").read_text())["uncalibrated"]


def test_evaluate_a_terrain_and_a_path(tmp_path):
    """Heights of a gentle slope, and 9 m of path across it."""
    x = np.arange(0.0, 20.0, 0.5)
    heights = 0.05 * x[:, None] + np.zeros(len(x))
    np.savetxt(
        tmp_path / "slope.csv",
        [(a, b, z) for row, b in zip(heights, x, strict=True) for a, z in zip(x, row, strict=True)],
        delimiter=",",
        header="x,y,z",
        comments="",
    )
    (tmp_path / "lane.csv").write_text("x,y\n5,10\n8,10\n11,10\n14,10\n")
    options = ["--terrain", tmp_path / "slope.csv", "--path", tmp_path / "lane.csv", "--policy", "stanley"]
    out = tmp_path / "evaluation"
    shown = call("evaluate", *options, "--policy", "preview", "--episodes", 2, "--seed", 3, "--no-films", "--out", out)
    assert shown.exit_code == 0, shown.output
    assert "lane.csv: 4 points, x, y; local x, y [m]" in shown.stderr.replace("\n", " ")
    content = json.loads((out / "evaluation.json").read_text())
    assert (content["env"], content["episodes"], content["seed"]) == ("AORO/PathTracking-v0", 2, 3)
    assert list(content["policies"]) == ["stanley", "preview"]
    assert content["courses"] == ["slope"]
    figures = content["policies"]["preview"]
    assert figures["success_rate"]["mean"] == 1.0
    assert 0.0 < figures["cross_track_rms_m"]["mean"] < 0.5
    # 9 m of lane, less 4 m before the start and 0.25 m before the end; a step covers less than 0.1 m
    assert figures["driven_m"]["mean"] == pytest.approx(4.75, abs=0.1)
    # of a machine across a slope of atan 0.05
    assert figures["worst_tilt_deg"]["mean"] > math.degrees(math.atan(0.04))
    for name in ("stanley", "cross track rms", "success rate", "ended: end of path reached"):
        assert name in shown.stdout
    for name in ("evaluation.json", "figures.png", "errors.png", "plan_1.png", "index.html"):
        assert f"wrote {out / name}" in shown.stdout

    (tmp_path / "short.csv").write_text("x,y\n5,10\n8,10\n")
    options = ["--terrain", tmp_path / "slope.csv", "--path", tmp_path / "short.csv", "--out", out]
    shown = call("evaluate", *options)
    assert shown.exit_code == 2
    assert "path 'short' is 3.00 m long, but must be at least 6.00 m" in " ".join(shown.stderr.split())


@pytest.mark.parametrize("command", ["evaluate", "train"])
def test_a_track_of_several_is_asked_for(tmp_path, command):
    one, other = (f"<trk><name>{name}</name><trkseg>{{}}</trkseg></trk>" for name in ("[/x] route", "yard"))
    points = "".join(f'<trkpt lat="{60 + 1e-5 * i:.6f}" lon="24"/>' for i in range(3))
    (tmp_path / "two.gpx").write_text(f"<gpx>{one.format(points)}{other.format(points)}</gpx>")
    asked = [command, "--env", "AORO/PathTracking-v0", "--path", tmp_path / "two.gpx", "--out", tmp_path / "out"]
    shown = call(*asked)
    assert shown.exit_code == 2
    said = " ".join(shown.stderr.split())
    assert "it holds 2 tracks: 1 GPX track '[/x] route' (3 points, 2.2 m), 2 GPX track 'yard'" in said
    assert "(--track)" in said
    shown = call(*asked, "--track", "yards")
    assert shown.exit_code == 2
    assert "no track is called 'yards'; it holds 2 tracks" in " ".join(shown.stderr.split())
    shown = call(*asked, "--track", "[/x] route")
    assert shown.exit_code == 2  # too short to drive
    assert "path 'two' is 2.23 m long" in " ".join(shown.stderr.split())
    without = [command, "--env", "AORO/PathTracking-v0", "--out", tmp_path / "out"]
    assert "--join-gaps is for a path; give its file with --path" in call(*without, "--join-gaps").stderr
    assert "crs 'EPSG:nine' is unknown" in call(*asked, "--track", "yard", "--path-crs", "EPSG:nine").stderr


def test_policies_in_files_are_evaluated_and_exported(tmp_path):
    from aoro_gym.agents.policies.policy import LearnedPolicy

    still = LearnedPolicy(
        weights=(np.zeros((1, 8), dtype=np.float32),),
        biases=(np.zeros(1, dtype=np.float32),),
        activation="tanh",
        squashed=False,
        low=-np.ones(1, dtype=np.float32),
        high=np.ones(1, dtype=np.float32),
        environment="AORO/Turning-v0",
    )
    _, file = still.save(tmp_path / "still")
    options = ["--env", "AORO/Turning-v0", "--episodes", 1, "--no-films", "--out", tmp_path / "evaluation"]
    shown = call("evaluate", "--policy", file, "--policy", "bang-bang", *options)
    assert shown.exit_code == 0, shown.output
    figures = json.loads((tmp_path / "evaluation" / "evaluation.json").read_text())["policies"]
    name = "-".join(file.with_suffix("").parts[1:])
    assert figures[name]["settled_share"]["mean"] == 0.0
    assert figures["bang-bang"]["settled_share"]["mean"] > 0.0
    shown = call("evaluate", "--policy", file, "--policy", file, *options)
    assert (shown.exit_code, "names the same one twice" in shown.stderr) == (2, True)
    shown = call("evaluate", "--policy", tmp_path / "model.zip", *options)
    assert (shown.exit_code, "--trust-pickle" in shown.stderr) == (2, True)

    board = tmp_path / "board"
    options = ["--env", "AORO/Turning-v0", "--episodes", 2, "--seed", 5, "--out", board]
    shown = call("leaderboard", "--policy", file, "--policy", "bang-bang", *options)
    assert shown.exit_code == 0, shown.output
    content = json.loads((board / "leaderboard.json").read_text())
    assert (content["policies"], content["seed"]) == (["bang-bang", name], 5)
    assert content["best_reference"] == "bang-bang"
    for end in ("json", "md", "png"):
        assert f"wrote {board / 'leaderboard'}.{end}" in shown.stdout

    pytest.importorskip("onnx")
    assert call("export", file).stdout == f"wrote {tmp_path / 'still.onnx'}\n"
    shown = call("export", tmp_path / "none.json")
    assert (shown.exit_code, "none.json" in shown.stderr) == (2, True)


@pytest.fixture
def quick(monkeypatch):
    """Calls of the heavy parts: machines that were validated, and options of calibrations."""
    calls = SimpleNamespace(validated=[], calibrated=[], stop=False, verdict={"fits": True, "sentence": "fits: [/x] 1"})
    found = validation.validate

    def quick_validate(machine, **options):
        calls.validated.append((machine.name, options))
        if not calls.validated[1:]:
            options = {**options, "noise_runs": 2}
        return found(machine, **options)

    def quick_calibrate(what):
        def calibrate(machine, *logs, ensemble=0, folder, progress, **options):
            assert not options.pop("restart") and not options.pop("accept_code_change")
            calls.calibrated.append((what, machine.name, *logs, {"ensemble": ensemble, **options}))
            progress("searching", 0.5)
            (folder / "search.json").write_text("{}")
            if calls.stop:
                raise KeyboardInterrupt
            better = machine.set({"oil.gas_fraction": 0.01}, source="calibrated")
            members = tuple(machine.set({"oil.gas_fraction": 0.01 + 0.001 * (i + 1)}) for i in range(ensemble))
            return Calibration(better, members, REPORTS[what] | {"verdict": calls.verdict})

        return calibrate

    monkeypatch.setattr(validation, "validate", quick_validate)
    monkeypatch.setattr("aoro_gym.calibration.published.calibrate_published", quick_calibrate("published"))
    monkeypatch.setattr("aoro_gym.calibration.logs.calibrate_logs", quick_calibrate("logs"))
    return calls


REPORTS = {
    "published": {
        "misses_tolerances": {
            "100": {"turn_time_s": 0.5, "mean_flow_L_per_min": -2.0},
            "50": {"turn_time_s": 0.1, "mean_flow_L_per_min": 0.0},
        },
        "largest_miss_tolerances": 2.0,
        "largest_change_at_half_the_substep_tolerances": None,
        "leaning_on_a_bound": [{"key": "oil.bulk_modulus", "end": "low"}],
        "not_felt": ["wheel.mass"],
    },
    "logs": {
        "rms_residual_std": 1.5,
        "parameters": [
            {"key": "a.b", "unit": "1", "value": 2.0, "low95": 1.0, "high95": 3.0, "identified": True},
            {"key": "c.d", "unit": "Pa", "value": 5.0, "low95": 0.0, "high95": 9.0, "identified": False},
        ],
        "not_felt": [],
        "leaning_on_a_bound": [],
    },
}


def test_validate(tmp_path, quick):
    shown = call("validate", "--out", tmp_path)
    assert shown.exit_code == 0, shown.output
    name, options = quick.validated[0]
    assert (name, options["uncalibrated"].name) == ("aoro", "aoro_datasheet")
    assert "Full turns to the left" in shown.stdout
    for file in ("validation.json", "left_turns.png", "right_turns.png", "errors.png", "index.html"):
        assert (tmp_path / file).stat().st_size > 0
        assert f"wrote {tmp_path / file}" in shown.stdout


def test_validate_takes_an_ensemble_and_no_second_machine(tmp_path, quick):
    machine = Machine.load("aoro")
    (tmp_path / "members").mkdir()
    for name in ("members/01.toml", "members/02.toml", "third.toml"):
        machine.save(tmp_path / name)
    ensemble = ["--ensemble", tmp_path / "members", "--ensemble", tmp_path / "third.toml"]
    shown = call("validate", "--uncalibrated", "none", *ensemble, "--out", tmp_path / "out")
    assert shown.exit_code == 0, shown.output
    result = json.loads((tmp_path / "out" / "validation.json").read_text())
    assert result["uncalibrated"] is None
    assert result["ensemble"]["members"] == 3


def test_validate_recalibrates_first(tmp_path, quick):
    shown = call("validate", "--recalibrate", "--out", tmp_path, "--seed", 4)
    assert shown.exit_code == 0, shown.output
    assert quick.calibrated == [("published", "aoro_datasheet", {"ensemble": 0, "seed": 4, "device": "cpu"})]
    assert quick.validated[0][0] == "calibrated"
    assert Machine.load(tmp_path / "calibrated.toml").entries["oil.gas_fraction"].value == 0.01


def test_calibrate_against_the_published_figures(tmp_path, quick):
    out = tmp_path / "new" / "mine.toml"
    for members in (3, 2):
        shown = call("calibrate", "--published", "--ensemble", members, "--starts", 1, "--out", out)
        assert shown.exit_code == 0, shown.output
    options = {"ensemble": 2, "starts": 1, "seed": 0, "device": "cpu"}
    assert quick.calibrated[-1] == ("published", "aoro_datasheet", options)
    assert Machine.load(out).entries["oil.gas_fraction"].value == 0.01
    members = sorted((out.parent / "mine_ensemble").iterdir())
    assert [member.name for member in members] == ["01.toml", "02.toml"]
    report = json.loads(out.with_suffix(".json").read_text())
    assert report["machine_file"] == str(out)
    assert sorted(path.name for path in out.parent.iterdir()) == ["mine.json", "mine.toml", "mine_ensemble"]
    for text in (
        "100 % signal",
        "-2.00",
        "largest miss: 2.00",
        "oil.bulk_modulus (low end)",
        "not identifiable, so left as they were: wheel.mass",
    ):
        assert text in shown.stdout


def test_calibrate_on_logs(turn, tmp_path, quick):
    shown = call("calibrate", "--logs", turn[0], turn[0], "--machine", "aoro", "--out", tmp_path / "mine.toml")
    assert shown.exit_code == 0, shown.output
    assert quick.calibrated == [("logs", "aoro", [turn[0]] * 2, {"ensemble": 0, "seed": 0, "device": "cpu"})]
    assert shown.stdout.startswith("fits: [/x] 1\n")
    for text in ("a.b", "1 - 3", "not identified", "residuals: 1.50", "leaning on a bound of its range: none"):
        assert text in shown.stdout


def test_an_interrupted_calibration_says_that_it_resumes(tmp_path, quick):
    quick.stop = True
    shown = call("calibrate", "--published", "--out", tmp_path / "mine.toml")
    assert shown.exit_code == 130
    assert shown.stdout == ""
    assert shown.stderr == "interrupted: the same command goes on from where it stopped\n"
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml.unfinished"]


def test_a_calibration_that_does_not_fit_ends_with_its_verdict_and_without_a_machine(turn, tmp_path, quick):
    quick.verdict = {"fits": False, "sentence": "does not fit: 16 standard deviations where 1 is noise"}
    out = tmp_path / "mine.toml"
    shown = call("calibrate", "--logs", turn[0], "--ensemble", 1, "--out", out)
    assert shown.exit_code == 1
    assert shown.stdout.startswith("does not fit: 16 standard deviations where 1 is noise\n")
    assert f"error: {out} was not written" in shown.stderr and "--force" in shown.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.json", "mine.toml.unfinished"]
    assert json.loads(out.with_suffix(".json").read_text())["machine_file"] is None

    shown = call("calibrate", "--logs", turn[0], "--ensemble", 1, "--out", out, "--force")
    assert shown.exit_code == 0, shown.output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.json", "mine.toml", "mine_ensemble"]


def test_a_calibration_does_not_replace_the_manifest_of_its_log(turn, quick):
    shown = call("calibrate", "--logs", turn[0], "--out", turn[0].with_suffix(".toml"))
    assert (shown.exit_code, "would replace the manifest of" in shown.stderr) == (2, True)
    assert quick.calibrated == []


def test_bench(tmp_path):
    path = tmp_path / "bench.json"
    shown = call("bench", "--twins", "1,2", "--seconds", "0.05", "--json", path)
    assert shown.exit_code == 0, shown.output
    result = json.loads(path.read_text())
    assert sorted({case["twins"] for case in result["cases"]}) == [1, 2]
    for case in result["cases"]:
        assert case["what"] == "twin"
        assert case["device"] == "cpu"
        assert 0 < case["min"] <= case["steps_per_s"] <= case["max"]
        share = 100.0 * case["share_of_ceiling"]
        assert 0 < share < 100 and f"{share:.3g} %" in shown.output
    assert set(result) == {"machine", "cases", "peers", "ratios"}
    assert list(tmp_path.iterdir()) == [path]


def test_terrain(tmp_path):
    slope = np.add.outer(np.zeros(41), 0.1 * np.arange(51.0))
    slope[20:30, 20:30] = np.nan
    np.save(tmp_path / "ground.npy", slope)
    shown = call(
        "terrain", tmp_path / "ground.npy", "--cell", 1, "--hole-limit", 4, "--out", tmp_path / "made" / "fine.ply"
    )
    assert shown.exit_code == 0, shown.output
    assert "median 5.7°" in shown.stdout
    assert "1 place without ground, 1 of them inside" in shown.stdout
    report = json.loads((tmp_path / "made" / "fine.json").read_text())
    assert report["slope_max_deg"] == pytest.approx(math.degrees(math.atan(0.1)))
    assert report["extent_m"] == pytest.approx([50.0, 40.0, 5.0])
    assert [hole["at_edge"] for hole in report["holes"]] == [False]
    for suffix in (".ply", ".png"):
        assert (tmp_path / "made" / f"fine{suffix}").stat().st_size > 1000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("simulate -m up", "--manoeuvre 'up' is none of left, right, drive"),
        ("simulate -m none.csv", "file none.csv does not exist"),
        ("simulate -m bad.csv", "bad.csv, line 3: steering_signal = 2 is outside [-1, 1]"),
        ("simulate -m good.csv --out good.csv", "would overwrite the commands in good.csv"),
        ("simulate -m good.csv --out good.parquet", "would overwrite the commands in good.csv"),
        ("simulate -m good.csv --signal 50", "--signal = 50 serves left, right and drive"),
        (
            "simulate -m good.csv --machine aoro_datasheet --start-angle 41",
            "--start-angle = 41 is outside [-40, 40] deg",
        ),
        ("simulate -m good.csv --start-angle nan", "--start-angle = nan is outside"),
        ("simulate -m left --start-angle 5", "--start-angle serves a command file only"),
        ("simulate -m left --signal nan", "--signal = nan is outside (0, 100] %"),
        (
            "simulate -m left --signal 0.75",
            "--signal = 0.75 is in per cent, and 0.75 % would move nothing; did you mean 75?",
        ),
        ("simulate -m drive --signal 0.5", "did you mean 50?"),
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
        ("simulate -m left --machine aoro_datasheet --scale wheel.mass=-1", "wheel.mass = -220 kg"),
        ("simulate -m left --terrain-slope 60", "terrain slope_deg = 60 is outside [-45, 45] deg"),
        ("parameters nothing.like.it", "no parameter matches 'nothing.like.it'"),
        ("parameters --effects nothing", "no effect matches 'nothing'; choose from: sensor_delay"),
        ("demo --out good.csv", "--out good.csv is a file; name a folder"),
        ("evaluate --out good.csv", "--out good.csv is a file; name a folder"),
        ("evaluate --env X", "--env 'X' cannot be evaluated; choose one of: AORO/Turning-v0, AORO/PathTracking-v0"),
        ("leaderboard --env X", "--env 'X' cannot be evaluated; choose one of"),
        ("leaderboard --episodes 0", "--episodes = 0 is outside [1, 10000]"),
        ("leaderboard --readme good.csv", "good.csv lacks the lines <!-- leaderboard AORO/PathTracking-v0 -->"),
        ("gap --policy preview", "give one of --diagnosis and --improved"),
        ("gap --policy preview --improved aoro", "the plant is the baseline; give --plant or --effect"),
        ("gap --policy preview --diagnosis empty", "empty/diagnosis.json: No such file"),
        ("gap --policy preview --improved aoro --effect x=1", "'x' is no effect on the machine; choose from"),
        (
            "gap --policy preview --improved aoro --effect payload=9 --retrain 9",
            "preview cannot be retrained; give a file",
        ),
        ("train --seeds 3", "--seeds needs --ray"),
        ("train --ray local --seeds 0", "--seeds = 0 is below 1"),
        ("train --trials 3", "--trials needs --ray"),
        ("train --space mine.yml", "--space needs --trials"),
        ("train --ray local --trials 0", "--trials = 0 is below 1"),
        ("train --ray local --trials 2 --seeds 2", "--seeds and --trials are both given"),
        ("train --ray local --resume runs", "--resume and --ray are both given"),
        ("train --algo dqn", "algo is 'dqn'; choose one of: ppo, sac"),
        ("train --terrain good.csv", "--terrain is for AORO/PathTracking-v0"),
        ("train --out good.csv", "--out good.csv is a file; name a folder"),
        ("train --resume empty", "empty holds no training.json; nothing was trained there"),
        ("train --machine nothing.toml", "nothing.toml"),
        ("evaluate --policy walker", "'walker' is no policy for AORO/PathTracking-v0; choose from: pure-pursuit"),
        ("evaluate --episodes 0", "--episodes = 0 is outside [1, 10000]"),
        ("evaluate --seed -1", "--seed = -1 is below 0"),
        ("evaluate --env AORO/Turning-v0 --path x.csv", "--path is for AORO/PathTracking-v0"),
        ("evaluate --terrain none.ply", "none.ply: No such file or directory"),
        ("evaluate --path none.gpx", "none.gpx: No such file or directory"),
        ("validate --out good.csv", "--out good.csv is a file; name a folder"),
        ("validate --machine none.toml", "no machine file none.toml"),
        ("validate --uncalibrated tractor", "no bundled machine 'tractor'"),
        ("validate --ensemble none.toml", "no machine file none.toml"),
        ("validate --ensemble empty", "--ensemble empty holds no machine file (.toml)"),
        ("validate --seed -1", "--seed = -1 is below 0"),
        ("validate --recalibrate --machine bad.toml", "drop --machine, --set and --scale"),
        ("validate --recalibrate --uncalibrated none", "starts from --uncalibrated, which is none"),
        ("calibrate", "give one of --published and --logs LOG..."),
        ("calibrate --published --logs good.csv", "give one of --published and --logs LOG..."),
        ("calibrate --published good.csv", "--published takes no logs, but got good.csv"),
        ("calibrate --logs", "--logs needs the logs behind it"),
        ("calibrate --logs none.csv", "file none.csv does not exist"),
        ("calibrate --logs good.csv", "good.csv has no column joint_angle_rad or joint_angle_deg, only"),
        ("calibrate --published --out machine.json", "--out machine.json must end in .toml"),
        ("calibrate --published --starts 0", "--starts = 0 is below 1"),
        ("calibrate --published --device tpu", "--device 'tpu' is not available here"),
        ("terrain none.tif", "none.tif: No such file or directory"),
        ("terrain good.csv", "good.csv: its columns are named time_s, steering_signal, which are not x, y and z"),
        ("terrain bad.toml", "bad.toml: terrains end in one of"),
        ("terrain good.csv --out fine.stl", "--out fine.stl must end in .ply"),
        ("terrain good.csv --units yards", "units = 'yards' is none of"),
        ("bench --twins 0", "--twins '0': '0' must be a positive integer"),
        ("bench --twins 1,many", "'many' must be a positive integer"),
        ("bench --seconds nan", "seconds = nan is outside (0, 600] s"),
        ("bench --what twin,drive", "what 'drive' is unknown; choose from: twin, env, train"),
        ("bench --threads 0", "--threads '0': '0' must be a positive integer"),
        ("bench --json .", ". is a folder; name a file in it"),
    ],
)
def test_wrong_input_is_one_line_before_anything_runs(tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    Path("good.csv").write_text("time_s,steering_signal\n0,0\n1,0.5\n")
    Path("bad.csv").write_text("time_s,steering_signal\n0,0\n1,2\n")
    Path("bad.toml").write_text("value = [")
    Path("empty").mkdir()
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
