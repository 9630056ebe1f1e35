"""Launches that are kept: a diagnosis that was killed comes to what an uninterrupted one does, and launches less."""

import json
import multiprocessing
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aoro_gym.diagnosis.diagnose import diagnose
from aoro_gym.diagnosis.replay import Replay, Request, Signals, Simulator, Variants
from aoro_gym.diagnosis.resuming import FOLDER, Kept, resumable
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.execution import provenance
from aoro_gym.execution.digest import sources
from aoro_gym.execution.files import read_json, write_json
from aoro_gym.execution.locking import LOCK
from aoro_gym.execution.provenance import ChangedCode, ChangedInput
from aoro_gym.machine import Machine
from aoro_gym.terrains import Plane
from tests.diagnosis.manoeuvres import blank, record, turn

MACHINE = Machine.load("aoro")
BLANK = blank("left", turn(1.0, 1.2), -0.3)
KILLED_AFTER = 3
"""Launches."""


def lagging(simulator: Simulator) -> dict[str, Any]:
    """A slow spool, looked for among one effect."""
    slow = Variants.of(MACHINE, [(EFFECTS["spool_lag"], (0.03,))], 1)
    recordings = record(slow, [BLANK], np.random.default_rng(1))
    effects = {"spool_lag": EFFECTS["spool_lag"]}
    return diagnose(recordings, MACHINE, effects, commissioned=True, simulator=simulator).as_dict()


def begin(folder: Path) -> None:
    lagging(Kept("cpu", folder))


def diagnose_into(out: Path) -> None:
    """All that the command does between its input and its result."""
    with resumable("cpu", out, {"machine": MACHINE.identity}) as simulator:
        found = lagging(simulator)
        write_json(out / "diagnosis.json", found)


@pytest.mark.slow
def test_what_was_killed_goes_on_to_the_same_result(tmp_path, launches):
    whole = lagging(Simulator())
    everything = len(launches)
    process = multiprocessing.get_context("spawn").Process(target=begin, args=(tmp_path,))
    process.start()
    while len(list(tmp_path.glob("[0-9]*.npz"))) < KILLED_AFTER:
        assert process.is_alive(), "it ended before it was killed"
        time.sleep(0.01)
    process.kill()
    process.join()
    kept = len(list(tmp_path.glob("[0-9]*.npz")))
    assert KILLED_AFTER <= kept < everything
    launches.clear()
    resumed = lagging(Kept("cpu", tmp_path))
    assert len(launches) == everything - kept
    assert resumed.pop("seconds") > 0.0 and whole.pop("seconds") > 0.0
    assert json.dumps(resumed) == json.dumps(whole)


@pytest.mark.slow
def test_killed_ten_times_at_random_moments_it_comes_to_the_same_result(tmp_path):
    began = time.monotonic()
    diagnose_into(tmp_path / "whole")
    whole, took = read_json(tmp_path / "whole" / "diagnosis.json"), time.monotonic() - began
    rng = np.random.default_rng(0)
    for _ in range(10):
        process = multiprocessing.get_context("spawn").Process(target=diagnose_into, args=(tmp_path / "killed",))
        process.start()
        process.join(timeout=rng.uniform(0.0, 1.5 * took))
        process.kill()
        process.join()
    diagnose_into(tmp_path / "killed")
    killed = read_json(tmp_path / "killed" / "diagnosis.json")
    assert killed.pop("seconds") > 0.0 and whole.pop("seconds") > 0.0
    assert json.dumps(killed) == json.dumps(whole)
    assert {file.name for file in (tmp_path / "killed").iterdir()} == {"diagnosis.json", LOCK}


@pytest.fixture
def launches(monkeypatch) -> list[int]:
    """Twins of everything that is launched."""
    found: list[int] = []
    plain = Simulator.launch_together

    def counted(self: Simulator, requests: list[Request]) -> list[Signals]:
        found.append(sum(one.count for one in requests))
        return plain(self, requests)

    monkeypatch.setattr(Simulator, "launch_together", counted)
    return found


def task(machine: Machine = MACHINE, **changes: Any) -> list[Replay]:
    return [Replay(Variants(machine, **changes), BLANK)]


def assert_same(found: list[Signals], expected: list[Signals]) -> None:
    for mine, theirs in zip(found, expected, strict=True):
        assert mine.keys() == theirs.keys()
        for name, values in mine.items():
            assert values.dtype == theirs[name].dtype
            np.testing.assert_array_equal(values, theirs[name])


def test_a_launch_that_was_kept_is_read(tmp_path, launches):
    expected = Kept("cpu", tmp_path).run(task())
    assert_same(Kept("cpu", tmp_path).run(task()), expected)
    assert len(launches) == 1


@pytest.mark.parametrize(
    "other",
    [
        task(MACHINE.scale({"steering.pump.margin": 1.01})),
        task(plane=Plane(slope_deg=0.1)),
        task(chain=((EFFECTS["sensor_delay"], (0.01,)),)),
        [Replay(Variants(MACHINE), blank("left", turn(0.99, 1.2), -0.3))],
        [Replay(Variants(MACHINE), blank("left", turn(1.0, 1.2), -0.31))],
    ],
    ids=["machine", "plane", "measuring chain", "commands", "start"],
)
def test_what_another_run_kept_is_not_read_but_removed(other, tmp_path, launches):
    Kept("cpu", tmp_path).run(task())
    found = Kept("cpu", tmp_path).run(other)
    assert len(launches) == 2 and len(list(tmp_path.iterdir())) == 1
    assert_same(found, Simulator().run(other))


def interrupt(out: Path, **inputs: Any) -> None:
    """A diagnosis that has kept a launch in ``out`` when Ctrl-C ends it."""
    with pytest.raises(KeyboardInterrupt), resumable("cpu", out, inputs) as simulator:
        simulator.run(task())
        raise KeyboardInterrupt


def test_an_unfinished_diagnosis_goes_on_with_its_inputs_only(tmp_path, launches):
    heavier = MACHINE.scale({"frame.front.mass": 1.01})
    interrupt(tmp_path, machine=MACHINE.identity)
    with pytest.raises(ChangedInput, match=r"machine value frame.front.mass was .*--restart begins anew"):
        interrupt(tmp_path, machine=heavier.identity)
    interrupt(tmp_path, machine=MACHINE.identity)
    assert len(launches) == 1
    with resumable("cpu", tmp_path, {"machine": heavier.identity}, restart=True) as simulator:
        simulator.run(task())
    assert len(launches) == 2


def test_launches_of_other_code_are_named_and_kept_only_if_accepted(tmp_path, launches, monkeypatch):
    interrupt(tmp_path)
    edited = {**sources(), "twin/kernels/advance.py": "0" * 16}
    monkeypatch.setattr(provenance, "sources", lambda: edited)
    with pytest.raises(ChangedCode, match=r"twin/kernels/advance.py has changed.*--accept-code-change"):
        interrupt(tmp_path)
    with resumable("cpu", tmp_path, accept_code_change=True) as simulator:
        simulator.run(task())
    assert simulator.code_changes == ("twin/kernels/advance.py has changed",)
    assert len(launches) == 1


@pytest.mark.parametrize("damage", [lambda whole: b"", lambda whole: whole[:-50], lambda whole: b"?" * len(whole)])
def test_a_file_that_is_not_whole_is_not_read(damage, tmp_path, launches):
    expected = Kept("cpu", tmp_path).run(task())
    (kept,) = tmp_path.iterdir()
    kept.write_bytes(damage(kept.read_bytes()))
    assert_same(Kept("cpu", tmp_path).run(task()), expected)
    assert len(launches) == 2


def test_nothing_stays_of_a_diagnosis_that_ends_well(tmp_path):
    with pytest.raises(KeyboardInterrupt), resumable("cpu", tmp_path) as simulator:
        simulator.run(task())
        raise KeyboardInterrupt
    assert len(list((tmp_path / FOLDER).glob("*.npz"))) == 1
    with resumable("cpu", tmp_path) as simulator:
        simulator.run(task())
    assert {file.name for file in tmp_path.iterdir()} == {LOCK}


def test_a_diagnosis_does_not_end_where_nothing_can_be_kept(tmp_path):
    (tmp_path / "file").write_text("no folder")
    assert_same(Kept("cpu", tmp_path / "file" / "launches").run(task()), Simulator().run(task()))
