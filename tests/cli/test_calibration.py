"""The commands ``validate`` and ``calibrate``."""

import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from aoro_gym import Machine, validation
from aoro_gym.calibration.published import Calibration
from aoro_gym.calibration.report import tables
from aoro_gym.machine.laws import FAMILIES, family
from aoro_gym.reporting.terminal import Comparison
from aoro_gym.validation.turns import TURNS
from tests.cli.calling import call, check_refused


@pytest.fixture(scope="module")
def a_validation():
    return validation.validate("aoro", uncalibrated="aoro_datasheet", noise_runs=2)


@pytest.fixture
def quick(monkeypatch, a_validation):
    """Calls of the heavy parts: machines that were validated, and options of calibrations; what they found is made up, or
    of another machine, unless ``simulated``."""
    calls = SimpleNamespace(
        simulated=False, validated=[], calibrated=[], stop=False, verdict={"fits": True, "sentence": "fits: [/x] 1"}
    )
    found = validation.validate

    def quick_validate(machine, **options):
        calls.validated.append((machine.name, options))
        return found(machine, **options, noise_runs=2) if calls.simulated else a_validation

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
        "laws": {
            "chosen": "library",
            "told_apart": False,
            "alike": ["default"],
            "alike_by_the_screening": [],
            "left_out": ["a.csv"],
            "quick": False,
            "sentence": "laws: library, of two families",
            "families": [
                {
                    "family": "library",
                    "searched": 7,
                    "screening": 1.5,
                    "predicted": 1.4,
                    "fit": 1.0,
                    "ratio_to_the_best_95": None,
                },
                {
                    "family": "default",
                    "searched": 6,
                    "screening": 1.6,
                    "predicted": 1.5,
                    "fit": 0.9,
                    "ratio_to_the_best_95": [0.97, 1.2],
                },
            ],
        },
    },
}


@pytest.fixture
def no_pictures(monkeypatch):
    """Reports with empty pictures, for tests that do not look at them: these take most of a report's time."""

    def write(*arguments, **options):
        next(one for one in arguments if isinstance(one, Path)).write_text("a picture")

    for name in ("write_turns", "write_errors", "write_index"):
        monkeypatch.setattr(f"aoro_gym.validation.report.{name}", write)


def test_validate(tmp_path, quick, no_pictures):
    shown = call("validate", "--out", tmp_path)
    assert shown.exit_code == 0, shown.output
    name, options = quick.validated[0]
    assert (name, options["uncalibrated"].name) == ("aoro", "aoro_datasheet")
    assert "Full turns to the left" in shown.stdout
    for file in ("validation.json", "left_turns.png", "right_turns.png", "errors.png", "index.html"):
        assert (tmp_path / file).stat().st_size > 0
        assert f"wrote {tmp_path / file}" in shown.stdout


def test_validate_takes_laws_and_records_them(tmp_path, quick, no_pictures):
    shown = call("validate", "--laws", "library", "--uncalibrated", "none", "--out", tmp_path)
    assert shown.exit_code == 0, shown.output
    made_by = json.loads((tmp_path / "validation.json").read_text())["made_by"]
    assert made_by["machine"] == {"file": "aoro", "set": [], "scale": [], "laws": "library"}


def test_validate_takes_the_bundled_structures(tmp_path, quick, no_pictures):
    shown = call("validate", "--ensemble", "structures", "--uncalibrated", "none", "--out", tmp_path)
    assert shown.exit_code == 0, shown.output
    [(_, options)] = quick.validated
    names = [member.name for member in options["ensemble"]]
    assert len(names) >= 6
    laws = [json.dumps(member.laws.names) for member in (Machine.load("aoro"), *options["ensemble"])]
    assert len(set(laws)) == len(laws), "no two have the same laws, nor those of aoro"


@pytest.mark.slow
def test_validate_takes_an_ensemble_and_no_second_machine(tmp_path, quick):
    quick.simulated = True
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


def test_validate_recalibrates_first(tmp_path, quick, no_pictures):
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
    options = {"ensemble": 2, "starts": 1, "seed": 0, "device": "cpu", "hold_published": False}
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


def test_calibrate_fits_a_machine_of_the_laws_that_are_named(tmp_path, quick):
    shown = call("calibrate", "--published", "--laws", "library", "--out", tmp_path / "mine.toml")
    assert shown.exit_code == 0, shown.output
    assert Machine.load(tmp_path / "mine.toml").laws.names == family("library").names


def test_calibrate_on_logs(turn, tmp_path, quick):
    shown = call("calibrate", "--logs", turn[0], turn[0], "--machine", "aoro", "--out", tmp_path / "mine.toml")
    assert shown.exit_code == 0, shown.output
    options = {"ensemble": 0, "seed": 0, "device": "cpu", "families": list(FAMILIES), "quick": False}
    assert quick.calibrated == [("logs", "aoro", [turn[0]] * 2, options)]
    said = " ".join(shown.stderr.split())
    assert "choosing among 5 families of laws takes some 2.7 times" in said, (
        "what the choice costs is said before it begins"
    )
    assert "--laws NAME fixes it, --quick takes a look, --device cpu:simd" in said
    assert shown.stdout.startswith("fits: [/x] 1\n")
    for text in ("a.b", "1 - 3", "not identified", "residuals: 1.50", "leaning on a bound of its range: none"):
        assert text in shown.stdout
    for text in (
        "laws: library, of two",
        "What each family predicts of logs left out",
        "not told apart",
        "0.97 - 1.20",
    ):
        assert text in shown.stdout


@pytest.mark.parametrize(
    ("laws", "families", "machine"),
    [
        ("library", [], "library"),
        ("file", [], "default"),
        ("library, file", ["library", "file"], "default"),
        ("families", list(FAMILIES), "default"),
    ],
)
def test_laws_that_are_named_are_kept_or_chosen_from(turn, tmp_path, quick, monkeypatch, laws, families, machine):
    seen = []
    monkeypatch.setattr(
        "aoro_gym.calibration.logs.calibrate_logs",
        lambda machine, logs, **options: (
            seen.append((machine.laws.names, options["families"], options["quick"]))
            or Calibration(machine, (), REPORTS["logs"] | {"verdict": quick.verdict})
        ),
    )
    shown = call("calibrate", "--logs", turn[0], "--laws", laws, "--quick", "--out", tmp_path / "mine.toml")
    assert shown.exit_code == 0, shown.output
    assert seen == [(family(machine).names, families, True)]
    assert "choosing" not in shown.stderr


def test_laws_that_there_are_not_are_refused(turn):
    check_refused(f"calibrate --logs {turn[0]} --laws default,libary", "did you mean 'library'")
    check_refused(f"calibrate --logs {turn[0]} --laws default,default", "names default twice")
    check_refused("calibrate --published --quick", "--quick needs --logs")


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


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("validate --out good.csv", "--out good.csv is a file; name a folder"),
        ("validate --machine none.toml", "no machine file none.toml"),
        ("validate --uncalibrated tractor", "no bundled machine 'tractor'"),
        ("validate --ensemble none.toml", "no machine file none.toml"),
        ("validate --ensemble empty", "--ensemble empty holds no machine file (.toml)"),
        ("validate --seed -1", "--seed is -1, but must be an integer of at least 0"),
        ("validate --recalibrate --machine bad.toml", "drop --machine, --set, --scale and --laws"),
        ("validate --recalibrate --uncalibrated none", "starts from --uncalibrated, which is none"),
        ("calibrate", "give one of --published, --logs LOG... and --procedure LOG..."),
        ("calibrate --published --logs good.csv", "give one of --published, --logs LOG... and --procedure LOG..."),
        ("calibrate --published good.csv", "--published takes no logs, but got good.csv"),
        ("calibrate --logs", "--logs needs the logs behind it"),
        ("calibrate --hold-published --logs good.csv", "--hold-published needs --published"),
        ("calibrate --procedure", "--procedure needs the logs behind it"),
        ("calibrate --procedure good.csv --starts 2", "--procedure searches nothing"),
        ("calibrate --logs good.csv --drive-speed 1", "--drive-speed 1 needs --procedure"),
        ("calibrate --logs none.csv", "file none.csv does not exist"),
        ("calibrate --logs good.csv", "good.csv has no column joint_angle_rad or joint_angle_deg, only"),
        ("calibrate --published --out machine.json", "--out machine.json must end in .toml"),
        ("calibrate --published --starts 0", "--starts is 0, but must be a positive integer"),
        ("calibrate --published --device tpu", "--device 'tpu' is not available here"),
    ],
)
def test_wrong_input_is_one_line_before_anything_runs(files, arguments, message):
    check_refused(arguments, message)


def test_a_study_of_nothing_or_of_what_is_not_there_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_refused("study", "nothing is changed; give --set KEY=VALUE or --scale KEY=FACTOR")
    check_refused("study --scale no.such=2", "no.such")


def test_a_study_writes_its_files_and_says_what_was_changed(tmp_path, monkeypatch):
    monkeypatch.setattr("aoro_gym.calibration.change.TURNS", TURNS[:1])
    monkeypatch.setattr("aoro_gym.calibration.change_report.SIDES", ("left",))
    monkeypatch.setattr("aoro_gym.calibration.change.motor_pressure", lambda machine, device: [12.8])
    shown = call("study", "--scale", "steering.hose_bulk_modulus=0.5", "--out", tmp_path)
    assert shown.exit_code == 0, shown.output
    assert "steering.hose_bulk_modulus" in shown.stdout and "motor pressure at 0.75 m/s" in shown.stdout
    content = json.loads((tmp_path / "study.json").read_text())
    assert content["turns"][0]["percent"]["first_peak_L_per_min"] > 0.5, "softer hoses let the joint swing farther"
    assert (tmp_path / "index.html").exists()


def test_bounds_are_a_short_list_with_identified_parameters_first():
    ends = [{"key": f"part.{i}", "end": "low"} for i in range(9)]
    known = [{"key": "part.7", "unit": "1", "value": 1.0, "low95": 0.0, "high95": 2.0, "identified": True}]
    verdict = {
        "sentence": "fits: all", "fits": True, "serves": "fit for control: yes",
        "channels": {"pressure_a": {"residual_std": 2.5, "unexplained_share": 0.1, "largest_share": 0.5, "fits": True}},
    }  # fmt: skip
    shown = list(tables({"verdict": verdict, "leaning_on_a_bound": ends, "parameters": known}))
    line = shown[-1]
    assert isinstance(line, str) and line.startswith("leaning on a bound of its range: part.7 (low end), part.0")
    assert line.endswith("and 4 more, in the report")
    assert "fit for control: yes" in shown
    assert isinstance(shown[1], Comparison)
    assert list(shown[1].rows[0][:4]) == ["pressure a", "2.50", "10 %", "50 %"]
