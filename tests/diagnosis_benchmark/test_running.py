"""Cases are diagnosed in processes: one that fails is named and kept from nobody, and what has ended stays."""

import json
import multiprocessing
import time

import numpy as np
import pytest
from typer.testing import CliRunner

from aoro_gym.cli import app
from aoro_gym.diagnosis_benchmark import running
from aoro_gym.diagnosis_benchmark.running import diagnoses_folder, read_diagnoses, run_cases
from aoro_gym.execution import provenance
from aoro_gym.execution.digest import sources
from aoro_gym.execution.files import read_json
from aoro_gym.execution.locking import FolderInUse
from aoro_gym.execution.provenance import ChangedCode, ChangedInput
from tests.diagnosis_benchmark.stand_ins import run_slowly, stand_in
from tests.diagnosis_benchmark.suites import write_suite


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
    assert run_cases(suite, out, sensors="angle", device="cpu,cpu", workers=1, diagnose=stand_in) == {}
    assert (out / "001" / "diagnosis.json").stat().st_mtime_ns == kept, "a finished case was diagnosed again"
    assert not list(out.rglob("error.txt"))
    assert set(read_diagnoses(suite, out)[1]["004"]) == {"verdict", "sensors", "device"}


@pytest.mark.slow
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


@pytest.mark.slow
def test_kept_diagnoses_of_another_case_or_code_are_not_taken(suite, monkeypatch):
    out = suite / "kept"
    (suite / "mended").touch()
    run_cases(suite, out, sensors="angle", diagnose=stand_in)
    log = next((suite / "cases" / "002" / "logs").glob("*.csv"))
    before = log.read_text()
    log.write_text(before.replace("0", "1", 1))
    with pytest.raises(ChangedInput, match="case 002 has changed"):
        run_cases(suite, out, sensors="angle", diagnose=stand_in)
    log.write_text(before)
    edited = {**sources(), "diagnosis/fits.py": "0" * 16}
    monkeypatch.setattr(provenance, "sources", lambda: edited)
    with pytest.raises(ChangedCode, match=r"diagnosis/fits.py has changed"):
        run_cases(suite, out, sensors="angle", diagnose=stand_in)
    kept = (out / "001" / "diagnosis.json").stat().st_mtime_ns
    run_cases(suite, out, sensors="angle", accept_code_change=True, diagnose=stand_in)
    assert (out / "001" / "diagnosis.json").stat().st_mtime_ns == kept
    assert read_json(out / "provenance.json")["accepted_code_changes"]
    run_cases(suite, out, sensors="angle", restart=True, diagnose=stand_in)
    assert (out / "001" / "diagnosis.json").stat().st_mtime_ns != kept
    (out / "provenance.json").unlink()
    with pytest.raises(ChangedCode, match="without a record of their code"):
        run_cases(suite, out, sensors="angle", diagnose=stand_in)


@pytest.mark.slow
def test_killed_ten_times_at_random_moments_it_comes_to_the_same_results(suite, tmp_path):
    run_slowly(suite, tmp_path / "whole")
    rng = np.random.default_rng(0)
    for _ in range(10):
        process = multiprocessing.get_context("spawn").Process(target=run_slowly, args=(suite, tmp_path / "killed"))
        process.start()
        process.join(timeout=rng.uniform(0.0, 6.0))
        process.kill()
        process.join()
    run_slowly(suite, tmp_path / "killed")

    def files(folder):
        return {
            path.relative_to(folder): path.read_bytes()
            for path in folder.rglob("*")
            if path.is_file() and path.name != "provenance.json"
        }

    assert files(tmp_path / "killed") == files(tmp_path / "whole")


@pytest.mark.slow
def test_two_runs_do_not_share_a_folder(suite):
    out = suite / "kept"
    process = multiprocessing.get_context("spawn").Process(target=run_slowly, args=(suite, out))
    process.start()
    while not (out / "run.json").exists():
        assert process.is_alive()
        time.sleep(0.01)
    with pytest.raises(FolderInUse, match=rf"in use by process {process.pid} on"):
        run_cases(suite, out, sensors="angle", diagnose=stand_in)
    process.join()
    assert len(read_diagnoses(suite, out)[1]) == 4


def test_what_does_not_fit_is_refused(suite, tmp_path):
    with pytest.raises(ValueError, match=r"holds no seal\.json.*blind seal"):
        run_cases(tmp_path, tmp_path / "out", sensors="angle")
    with pytest.raises(ValueError, match="log 'angle' only"):
        run_cases(suite, tmp_path / "out", sensors="full")
    with pytest.raises(ValueError, match="sensors is 'nose'"):
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
    assert asked[0] == (suite / "diagnoses-angle", {
        "sensors": "angle", "device": "cpu", "workers": 3, "ray": None, "restart": False, "accept_code_change": False,
    })  # fmt: skip
    ill = runner.invoke(app, ["blind", "run", "--out", str(suite / "there"), str(suite)], catch_exceptions=False)
    assert ill.exit_code == 1 and asked[1][0] == suite / "there"
    assert "case 002 failed: ValueError: [bad] log" in ill.output
    for arguments, message in (
        ([str(suite.parent)], "holds no seal.json"),
        (["--device", "cuda:9", str(suite)], "is not available here"),
        (["--workers", "0", str(suite)], "--workers is 0, but must be a positive integer"),
    ):
        wrong = runner.invoke(app, ["blind", "run", *arguments])
        assert wrong.exit_code == 2 and message in wrong.output
    assert "Examples" in runner.invoke(app, ["blind", "run", "--help"]).output
