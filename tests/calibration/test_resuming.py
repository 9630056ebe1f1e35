"""A calibration that was ended anywhere goes on to the same result, or says what has changed; what it writes is whole."""

import errno
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from aoro_gym.calibration.logs import calibrate_logs
from aoro_gym.calibration.output import calibrate_to
from aoro_gym.calibration.resuming import unfinished_folder
from aoro_gym.execution import provenance
from aoro_gym.execution.digest import sources
from aoro_gym.execution.locking import FolderInUse
from aoro_gym.execution.provenance import ChangedCode, ChangedInput
from aoro_gym.machine import Machine

KEYS = ("steering.valve.nominal_flow_left", "steering.valve.spool_time_constant")

SCRIPT = """
import sys
from pathlib import Path
from aoro_gym.calibration.logs import calibrate_logs
from aoro_gym.calibration.output import calibrate_to
from aoro_gym.machine import Machine

machine = Machine.load("aoro_datasheet")
options = {"keys": sys.argv[3:], "starts": 2, "population": 128, "ensemble": 2}
calibrate_to(
    Path(sys.argv[1]), lambda folder: calibrate_logs(machine, [Path(sys.argv[2])], folder=folder, **options), force=True
)
"""


def write_turn(path: Path, size: float = 0.5, *, swinging: bool = False) -> Path:
    """A log that needs no machine: a turn that creeps up to an angle, or swings as no machine does."""
    time = np.arange(0.0, 3.0 if swinging else 1.6, 0.01)
    moving = np.maximum(time - 0.5, 0.0)
    angle = size * (np.sin(2.2 * moving) if swinging else 1.0 - np.exp(-1.5 * moving)) + 3e-4 * np.sin(400.0 * time)
    pressure = 20.0 + 60.0 * (time > 0.5) + 0.2 * np.sin(900.0 * time)
    rows = np.column_stack([time, np.where((time >= 0.5) & (time < time[-1] - 0.2), 0.8, 0.0), angle, pressure])
    header = "time_s,steering_signal,joint_angle_rad,pump_pressure_bar"
    np.savetxt(path, rows, delimiter=",", header=header, comments="")
    return path


def fit(log: Path, **options):
    """The calibration of a moment."""
    asked = {"keys": KEYS, "starts": 1, "population": 2} | options
    machine = asked.pop("machine", Machine.load("aoro_datasheet"))
    return lambda folder: calibrate_logs(machine, [log], folder=folder, **asked)


def outputs(folder: Path) -> dict[str, bytes]:
    """Contents of everything that a calibration to ``mine.toml`` wrote."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name.startswith(("mine", "0"))
    }


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The log, and what an uninterrupted calibration writes."""
    folder = tmp_path_factory.mktemp("whole")
    log = write_turn(folder / "turn.csv")
    here = Path.cwd()
    os.chdir(folder)  # the report holds the paths as they were given
    try:
        calibrate_to(Path("mine.toml"), fit(Path("turn.csv")), force=True)
    finally:
        os.chdir(here)
    return log, outputs(folder)


def interrupt_at(share: float):
    def progress(sentence: str, done: float) -> None:
        if done >= share:
            raise KeyboardInterrupt

    return progress


def test_an_interrupted_calibration_ends_as_an_uninterrupted_one_to_the_bit(whole, tmp_path, monkeypatch):
    log, expected = whole
    monkeypatch.chdir(tmp_path)
    Path("turn.csv").write_bytes(log.read_bytes())
    out = Path("mine.toml")
    for share in (0.3, 0.55, 0.8, 0.97):
        with pytest.raises(KeyboardInterrupt):
            calibrate_to(out, fit(Path("turn.csv"), progress=interrupt_at(share)), force=True)
        assert not out.exists()
    calibrate_to(out, fit(Path("turn.csv")), force=True)
    assert outputs(tmp_path) == expected
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.json", "mine.toml", "turn.csv"]


def test_the_share_that_is_told_grows_from_nothing_to_one(whole):
    log, _ = whole
    told = []
    fit(log, progress=lambda sentence, share: told.append(share))(None)
    assert told == sorted(told)
    assert told[0] == 0.0 and told[-1] == 1.0 and len(told) > 50


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    """A folder with a log and a calibration on it that was interrupted half-way."""
    folder = tmp_path_factory.mktemp("begun")
    with pytest.raises(KeyboardInterrupt):
        calibrate_to(folder / "mine.toml", fit(write_turn(folder / "turn.csv"), progress=interrupt_at(0.5)))
    return folder


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"seed": 1}, "seed was 0, is 1"),
        ({"ensemble": 2}, "ensemble was 0, is 2"),
        ({"keys": KEYS[:1]}, "keys"),
        ({"machine": Machine.load("aoro")}, "machine (range|role|value) "),
        ({"log": 0.4}, r"logs 1 turn\.csv has changed"),
        ({"pressure": True}, r"logs 1 turn\.csv has changed"),
        ({"manifest": "gear = 2\n"}, r"logs 1 turn\.toml"),
    ],
)
def test_a_changed_input_is_refused_by_name_or_begun_anew(begun, tmp_path, change, says):
    shutil.copytree(begun, tmp_path, dirs_exist_ok=True)
    log, out = tmp_path / "turn.csv", tmp_path / "mine.toml"
    assert (unfinished_folder(out) / "search.json").exists()
    if size := change.pop("log", None):
        write_turn(log, size)
    if change.pop("pressure", None):  # the last digit of one pressure
        text = log.read_text().splitlines()
        log.write_text("\n".join([*text[:100], text[100][:-6] + "1e+01", *text[101:]]) + "\n")
    if manifest := change.pop("manifest", None):
        log.with_suffix(".toml").write_text(manifest)
    with pytest.raises(ChangedInput, match=rf"begun with other inputs: .*{says}.*--restart begins anew"):
        calibrate_to(out, fit(log, progress=interrupt_at(0.0), **change))
    with pytest.raises(KeyboardInterrupt):
        calibrate_to(out, fit(log, progress=interrupt_at(0.0), restart=True, **change))
    assert not (unfinished_folder(out) / "search.json").exists()


def test_changed_code_is_named_and_accepted_and_recorded(whole, tmp_path, monkeypatch):
    log, expected = whole
    out = tmp_path / "mine.toml"
    with pytest.raises(KeyboardInterrupt):
        calibrate_to(out, fit(log, progress=interrupt_at(0.6)))
    edited = {**sources(), "twin/kernels/advance.py": "0" * 16}
    monkeypatch.setattr(provenance, "sources", lambda: edited)
    with pytest.raises(ChangedCode, match=r"twin/kernels/advance\.py has changed.*--accept-code-change"):
        calibrate_to(out, fit(log))
    found, _ = calibrate_to(out, fit(log, accept_code_change=True), force=True)
    assert found.report["accepted_code_changes"] == ["twin/kernels/advance.py has changed"]
    assert out.read_bytes() == expected["mine.toml"]


def test_a_machine_that_does_not_fit_is_written_by_force_alone_and_not_computed_again(tmp_path):
    log, out = write_turn(tmp_path / "turn.csv", 0.35, swinging=True), tmp_path / "mine.toml"
    found, written = calibrate_to(out, fit(log))
    assert not found.fits
    assert written == [tmp_path / "mine.json"] and not out.exists()
    kept = (unfinished_folder(out) / "search.json").stat().st_mtime_ns
    sentences = []
    again, written = calibrate_to(
        out, fit(log, progress=lambda sentence, share: sentences.append(sentence)), force=True
    )
    assert not any(sentence.startswith(("start", "evaluating")) for sentence in sentences) and kept
    assert written[0] == out
    assert "does not fit" in Machine.load(out).entries[KEYS[0]].source
    assert again.report == found.report
    assert not unfinished_folder(out).exists()


HOLD = (
    "import sys, time; from pathlib import Path; from aoro_gym.execution.locking import locked\n"
    "with locked(Path(sys.argv[1])):\n"
    "    print('held', flush=True); time.sleep(60)\n"
)


def test_a_second_process_on_one_output_is_told_of_the_first(whole, tmp_path):
    log, _ = whole
    out = tmp_path / "mine.toml"
    hold = [sys.executable, "-c", HOLD, str(unfinished_folder(out))]
    with subprocess.Popen(hold, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None and holder.stdout.readline() == b"held\n"
        try:
            with pytest.raises(FolderInUse, match=f"is in use by process {holder.pid} on"):
                calibrate_to(out, fit(log))
        finally:
            holder.kill()
    calibrate_to(out.with_name("other.toml"), fit(log), force=True)  # beside it there is room for another


@pytest.mark.parametrize("limit", [500, 20_000])
def test_a_full_disk_ends_it_with_what_was_there_and_it_goes_on_later(whole, tmp_path, limit):
    """A limit on the size of files stands in for the disk."""
    log, expected = whole
    out = tmp_path / "mine.toml"
    out.write_text("old")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, before[1]))
        with pytest.raises(OSError) as caught:
            calibrate_to(out, fit(log), force=True)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
    assert caught.value.errno == errno.EFBIG
    assert str(tmp_path) in str(caught.value.filename)
    assert out.read_text() == "old"
    calibrate_to(out, fit(log), force=True)
    assert out.read_bytes() == expected["mine.toml"]


@pytest.mark.slow
def test_killed_at_ten_random_moments_it_ends_as_an_uninterrupted_one_to_the_bit(tmp_path):
    drawn = random.Random(7)
    places = [tmp_path / "whole", *(tmp_path / f"killed{i}" for i in range(10))]
    for place in places:
        place.mkdir()
        write_turn(place / "turn.csv")
    command = [sys.executable, "-c", SCRIPT, "mine.toml", "turn.csv", *KEYS]
    begin = time.monotonic()
    subprocess.run(command, cwd=places[0], check=True)
    duration = time.monotonic() - begin
    for place in places[1:]:
        with subprocess.Popen(command, cwd=place) as process:
            try:
                process.wait(timeout=duration * drawn.random())
            except subprocess.TimeoutExpired:
                process.send_signal(signal.SIGKILL)
        subprocess.run(command, cwd=place, check=True)
        assert outputs(place) == outputs(places[0])
        assert not (place / "mine.toml.unfinished").exists()
        assert not list(place.rglob("*.partial*")), "nothing half written is left"
