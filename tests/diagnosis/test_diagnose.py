"""From logs to a diagnosis: a cause that the twin itself was given, what it writes, and what is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from aoro_gym.cli import app
from aoro_gym.diagnosis import diagnose as pipeline
from aoro_gym.diagnosis.diagnose import Logs, diagnose
from aoro_gym.diagnosis.recording import TICK
from aoro_gym.diagnosis.replay import Variants
from aoro_gym.diagnosis.result import VERDICTS, Cause, Diagnosis
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.execution.files import LOCK
from aoro_gym.machine import Machine
from aoro_gym.simulation.log import write_log
from tests.diagnosis.manoeuvres import blank, record, turn

MACHINE = Machine.load("aoro")
"""Of the laws and parameters that the shipped networks learned on."""
LAG = 0.05
MANOEUVRES = [blank("left", turn(0.8, 2.2), -0.3), blank("right", turn(-0.6, 2.0), 0.3)]


def recorded(seed: int, *effects):
    return record(Variants.of(MACHINE, effects, 1), MANOEUVRES, np.random.default_rng(seed))


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory):
    """A slow spool in two turns, with the same turns of the healthy machine; and where the result was written."""
    later = recorded(6, (EFFECTS["spool_lag"], (LAG,)))
    folder = tmp_path_factory.mktemp("diagnosis")
    told = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pipeline, "FITTED", 1)
        patch.setattr(pipeline, "next_experiments", lambda *args, **kwargs: ())  # has tests of its own
        found = diagnose(
            later, machine=MACHINE, healthy=recorded(5), out=folder, progress=lambda *about: told.append(about)
        )
    return found, folder, told


def test_the_cause_its_size_and_its_machine_are_given(diagnosed):
    found, folder, _ = diagnosed
    first = found.causes[0]
    assert found.verdict in ("cause", "ambiguous") and first.effects == ("spool_lag",)
    assert found.where_p < 0.02 and next(iter(found.components)) == "valve"
    assert found.declared_set[0] == "spool_lag"
    (size,) = first.magnitudes["spool_lag"]
    assert size.low90 < LAG < size.high90
    machine, affected = MACHINE, Machine.load(str(folder / first.machine_file))
    longer = affected.steering.valve.spool_time_constant - machine.steering.valve.spool_time_constant
    assert longer == pytest.approx(LAG, rel=0.2)


def test_the_gap_is_gone_on_manoeuvres_left_out(diagnosed):
    """Of the fit of its size: with the right laws little but noise may stay."""
    found, _, _ = diagnosed
    left_out = [one for one in found.shrinkage if one.held_out and not one.refitted]
    assert {one.manoeuvre for one in left_out} == {"left", "right"}
    assert found.controls["cause"] == pytest.approx(np.median([one.S for one in left_out]))
    assert found.controls["cause"] > 0.8
    assert 0.9 < sum(place.share for place in found.where) <= 1.0 + 1e-9  # the smallest are not listed
    assert {place.component for place in found.where} == {"valve"}


def test_what_is_written_can_be_read(diagnosed, tmp_path):
    found, _, told = diagnosed
    content = json.loads(found.save(tmp_path).read_text(encoding="utf-8"))
    assert content["verdict"] in VERDICTS
    shares = [cause["probability"] for cause in content["causes"]]
    assert sum(shares) <= 1.0 + 1e-9 and shares[0] == max(shares) and min(shares) >= pipeline.LISTED
    assert content["causes"][0]["magnitudes"]["spool_lag"]["unit"] == "s"
    assert content["declared_set"][0] == "spool_lag"
    assert any("first finding: spool lag" in sentence for sentence, _ in told)


def test_machine_files_of_the_diagnosis_before_go(tmp_path):
    """Its own only: what else lies in the folder stays."""
    (tmp_path / "machines").mkdir()
    files = {name: tmp_path / "machines" / f"{name}.toml" for name in ("old", "kept", "mine")}
    for file in files.values():
        file.write_text("")
    first = Diagnosis(machine="aoro", mode="day-one", logs=(), healthy=(), signals=(), verdict="ambiguous")
    causes = [Cause((name,), 0.5, machine_file=f"machines/{name}.toml") for name in ("old", "kept")]
    replace(first, causes=tuple(causes)).save(tmp_path)
    replace(first, causes=(causes[1],)).save(tmp_path)
    assert {name: file.exists() for name, file in files.items()} == {"old": False, "kept": True, "mine": True}


def test_two_healthy_days_have_no_gap(monkeypatch):
    monkeypatch.setattr(pipeline, "next_experiments", lambda *args, **kwargs: pytest.fail("nothing is to be found"))
    found = diagnose(recorded(7), healthy=recorded(8))
    assert found.verdict == "no_gap"
    assert found.where_p is not None and found.where_p > 0.02
    assert found.causes[0].effects == () and not found.declared_set and not found.shrinkage


def test_signals_that_all_logs_have_are_named():
    whole = recorded(1)[0]
    angle = replace(whole, channels={"joint_angle": whole.channels["joint_angle"]})
    assert Logs([whole], [whole], []).channels == ("joint_angle", "pressure_a", "pressure_b", "pump_pressure")
    assert Logs([whole], [angle], []).channels == ("joint_angle",)


def test_no_recording_is_refused():
    with pytest.raises(ValueError, match="no recording given"):
        diagnose([])


def test_a_log_of_radians_named_degrees_gives_no_cause(tmp_path):
    """What is wrong is said on the page, and in a word: it cannot tell."""
    (turned, _) = recorded(6)
    log = tmp_path / "radians.csv"
    write_log(
        log,
        {
            "time_s": TICK * np.arange(turned.ticks + 1),
            "steering_signal": np.append(turned.commands[:, 0], 0.0),
            "joint_angle_deg": turned.channels["joint_angle"],
        },
    )
    result = CliRunner().invoke(app, ["diagnose", str(log), "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    content = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert content["verdict"] == "inconclusive" and content["causes"] == []
    assert "radians or degrees" in content["limitations"][0]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [LOCK, "diagnosis.json", "report.html"]
    assert "radians or degrees" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
