"""Cases are diagnosed in processes: one that fails is named and kept from nobody, and what has ended stays."""

import json

import pytest
from typer.testing import CliRunner

from aoro_gym.cli import app
from aoro_gym.diagnosis import running
from aoro_gym.diagnosis.running import diagnoses_folder, read_diagnoses, run_cases
from aoro_gym.log import write_json
from tests.diagnosis.suites import write_suite


def stand_in(place, out, *, sensors, device):
    """A diagnosis that fails on the third case and forgets its result of the fourth, until told otherwise."""
    assert (place / "machine.toml").is_file() and list((place / "logs").glob("*.csv"))
    mended = (place.parents[1] / "mended").exists()
    if place.name == "003" and not mended:
        raise ValueError("the log is too short")
    if place.name == "004" and not mended:
        return
    write_json(out / "diagnosis.json", {"verdict": "no_gap", "sensors": sensors, "device": device})


@pytest.fixture
def suite(tmp_path):
    write_suite(tmp_path)
    return tmp_path / "check"


def test_failures_are_named_and_tried_again(suite):
    out, told = diagnoses_folder(suite, "angle"), []
    failures = run_cases(
        suite, out, sensors="angle", workers=2, diagnose=stand_in, progress=lambda sentence, share: told.append(share)
    )
    assert failures["003"] == "ValueError: the log is too short"
    assert failures["004"].startswith("FileNotFoundError: the diagnosis ended without")
    assert list(failures) == ["003", "004"]
    assert told == [0.25, 0.5, 0.75, 1.0]
    assert "Traceback" in (out / "003" / "error.txt").read_text()
    sensors, found = read_diagnoses(suite, out)
    assert sensors == "angle"
    assert found["003"] == failures["003"]
    assert found["001"] == {"verdict": "no_gap", "sensors": "angle", "device": "cpu"}

    kept = (out / "001" / "diagnosis.json").stat().st_mtime_ns
    (suite / "mended").touch()
    assert run_cases(suite, out, sensors="angle", workers=1, diagnose=stand_in) == {}
    assert (out / "001" / "diagnosis.json").stat().st_mtime_ns == kept, "a finished case was diagnosed again"
    assert not list(out.rglob("error.txt"))
    assert set(read_diagnoses(suite, out)[1]["004"]) == {"verdict", "sensors", "device"}


def test_an_interrupted_run_goes_on(suite):
    out = suite / "kept"
    (suite / "mended").touch()

    def interrupt(sentence, share):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_cases(suite, out, sensors="angle", diagnose=stand_in, progress=interrupt)
    assert len(list(out.rglob("diagnosis.json"))) < 4
    with pytest.raises(ValueError, match=r"cases have no diagnosis, 00\d among them.*blind run"):
        read_diagnoses(suite, out)
    assert run_cases(suite, out, sensors="angle", diagnose=stand_in) == {}
    assert len(read_diagnoses(suite, out)[1]) == 4


def test_what_does_not_fit_is_refused(suite, tmp_path):
    with pytest.raises(ValueError, match=r"holds no seal\.json.*blind seal"):
        run_cases(tmp_path, tmp_path / "out", sensors="angle")
    with pytest.raises(ValueError, match="log 'angle' only"):
        run_cases(suite, tmp_path / "out", sensors="full")
    with pytest.raises(ValueError, match="sensors 'nose'"):
        run_cases(suite, tmp_path / "out", sensors="nose")
    with pytest.raises(ValueError, match="holds no diagnoses; let 'aoro-gym blind run"):
        read_diagnoses(suite, tmp_path / "out")
    (suite / "mended").touch()
    run_cases(suite, tmp_path / "out", sensors="angle", diagnose=stand_in)
    seal = json.loads((suite / "seal.json").read_text())
    seal["sha256"]["cases"] = "another"
    (suite / "seal.json").write_text(json.dumps(seal))
    with pytest.raises(ValueError, match="diagnoses of other cases"):
        run_cases(suite, tmp_path / "out", sensors="angle", diagnose=stand_in)
    with pytest.raises(ValueError, match="diagnoses of other cases"):
        read_diagnoses(suite, tmp_path / "out")


def test_the_command_runs(suite, monkeypatch):
    runner, asked = CliRunner(), []

    def run(folder, out, **options):
        asked.append((out, {name: value for name, value in options.items() if name != "progress"}))
        return {} if len(asked) == 1 else {"002": "ValueError: [bad] log"}

    monkeypatch.setattr(running, "run_cases", run)
    well = runner.invoke(app, ["blind", "run", "--workers", "3", str(suite)], catch_exceptions=False)
    assert well.exit_code == 0, well.output
    assert asked[0] == (suite / "diagnoses-angle", {"sensors": "angle", "device": "cpu", "workers": 3, "ray": None})
    ill = runner.invoke(app, ["blind", "run", "--out", str(suite / "there"), str(suite)], catch_exceptions=False)
    assert ill.exit_code == 1 and asked[1][0] == suite / "there"
    assert "case 002 failed: ValueError: [bad] log" in ill.output
    for arguments, message in (
        ([str(suite.parent)], "holds no seal.json"),
        (["--device", "cuda:9", str(suite)], "is not available here"),
        (["--workers", "0", str(suite)], "--workers = 0 is below 1"),
    ):
        wrong = runner.invoke(app, ["blind", "run", *arguments])
        assert wrong.exit_code == 2 and message in wrong.output
    assert "Examples" in runner.invoke(app, ["blind", "run", "--help"]).output
