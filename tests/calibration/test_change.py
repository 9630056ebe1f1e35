"""What a change of parameters does, with the turn time restored or not."""

import json
from collections.abc import Iterator

import pytest

from aoro_gym import Machine
from aoro_gym.calibration import change, change_report
from aoro_gym.calibration.change import Change, study_change
from aoro_gym.calibration.change_report import sentence, tables, write_change
from aoro_gym.simulation.key_figures import FIGURES
from aoro_gym.validation.turns import TURNS

DROP = "steering.valve.nominal_drop_in_left"


@pytest.fixture(scope="module")
def wider() -> Iterator[tuple[Change, Change]]:
    """A fifth more oil at the same drop through the left supply edge: as it comes, and with the time restored. Of the turns
    the first one alone."""
    machine = Machine.load("aoro")
    changed = machine.set({DROP: float(machine.entries[DROP].value) / 1.2**2}, check_ranges=False)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(change, "TURNS", TURNS[:1])
        patch.setattr(change, "SIDES", ("left",))
        patch.setattr(change_report, "SIDES", ("left",))
        plain = study_change(machine, changed)
        patch.setattr(change, "motor_pressure", lambda machine, device: [12.8])
        yield plain, study_change(machine, changed, recalibrate=True)


def test_a_wider_edge_turns_faster_and_its_recalibration_undoes_it(wider):
    plain, restored = wider
    left = plain.turns[0]
    assert left.turn == TURNS[0]
    # the edge carries a fifth more oil at the same drop, of which a compensator that droops takes back some
    assert -100.0 * (1.0 - 1.0 / 1.2) - 1.0 < (left.percent("turn_time_s") or 0.0) < -5.0
    assert set(plain.changed) == {DROP} and plain.recalibrated == ()
    # nothing else was changed, so what restores the time is the value before: to a straight line over the last bracket
    assert restored.recalibrated == (DROP,)
    before, after = restored.changed[DROP]
    assert after == pytest.approx(before, rel=2e-3)
    assert all(abs(restored.turns[0].percent(name) or 0.0) < 1.0 for name in FIGURES)


def test_curves_begin_with_the_turn_and_the_drive_is_the_same(wider):
    left = wider[0].turns[0]
    assert left.flow.shape == (2, len(left.time))
    assert abs(left.flow[:, left.time < -0.1]).max() < 1.0
    assert left.flow[1].max() > left.flow[0].max()
    before, after = wider[0].motor_pressure
    assert after == pytest.approx(before, rel=1e-3), "steering valves do not drive"
    assert before == pytest.approx(12.8, rel=0.02)


def test_report(wider, tmp_path):
    written = write_change(wider[1], tmp_path, {"seed": 0})
    assert [path.name for path in written] == ["study.json", "left_turns.png", "index.html"]
    content = json.loads(written[0].read_text())
    assert len(content["turns"]) == 1 and set(content["turns"][0]["percent"]) == set(FIGURES)
    assert content["made_by"] == {"seed": 0} and content["recalibrated"]
    assert [table.row_count for table in tables(wider[1])] == [len(wider[1].changed), 7, 1]
    assert "restored" in sentence(wider[1]) and "restored" not in sentence(wider[0])
    assert "Full turns to the left" in written[-1].read_text()


def test_an_edge_that_cannot_restore_the_time_is_refused():
    machine = Machine.load("aoro")
    slow = machine.scale({"steering.valve.nominal_flow_left": 0.3}, check_ranges=False)
    with pytest.raises(ValueError, match=r"no steering\.valve\.nominal_drop_in_left within its range"):
        study_change(machine, slow, recalibrate=True)
