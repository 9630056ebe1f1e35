"""Tables of key figures: what is read of them, which rows are selected, and which figures prove nothing."""

from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import pytest

from aoro_gym.diagnosis.tables import Row, built_in, read_rows, selected
from aoro_gym.machine import Machine
from aoro_gym.simulation.key_figures import FIGURES
from aoro_gym.validation.turns import Turn

MACHINE = Machine.load("aoro")
PUBLISHED = Path(str(files("aoro_gym").joinpath("validation/data/left_turn_metrics.csv")))


def test_a_table_is_read(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(
        "# repeats of five\nsource,signal_percent,direction,turn_time_s,std_turn_time_s,second_peak_L_per_min\n"
        "mine, 75, right, 3.1, 0.02,\nmine,100,,2.0,,80\nother,50,left,6.0,,\n"
    )
    first, second = read_rows(path, "mine")
    assert first == Row(Turn("right", 75.0), {"turn_time_s": 3.1}, {"turn_time_s": 0.02})
    assert second == Row(Turn("left", 100.0), {"turn_time_s": 2.0, "second_peak_L_per_min": 80.0})
    assert read_rows(path, "other")[0].title == "left, 50 %"


def test_a_table_of_a_spreadsheet_is_read(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("source;signal_percent;turn_time_s\nmine;75;3,1\nmine;100;2,25\n", encoding="utf-16")
    assert [row.figures["turn_time_s"] for row in read_rows(path)] == [3.1, 2.25]
    path.write_text("source,signal_percent,turn_time_s\nmine,1_00,3.1\n")
    with pytest.raises(ValueError, match="signal_percent is '1_00', but must be a number"):
        read_rows(path)


def test_the_published_table_is_read():
    rows = read_rows(PUBLISHED, "physical")
    assert [row.title for row in rows] == ["left, 100 %", "left, 75 %", "left, 50 %"]
    assert all(tuple(row.figures) == FIGURES for row in rows)
    assert rows[2].figures["turn_time_s"] == 6.86


def test_rows_are_selected():
    rows = [Row(Turn(side, level), {"turn_time_s": 2.0}) for side in ("left", "right") for level in (100.0, 50.0)]
    assert selected("--fit", ["signal=100"], rows) == [rows[0], rows[2]]
    assert selected("--fit", ["signal=100,50"], rows) == rows
    assert selected("--fit", ["direction=right", "signal=50"], rows) == rows[1:]


def test_figures_that_the_machine_file_was_made_with_are_known():
    """Those that its sources name: of the machine only the flow, of the published twin all; none of figures that are not
    quite the published ones, and none of a machine file that was not calibrated."""
    physical, mevea = (read_rows(PUBLISHED, source)[1] for source in ("physical", "mevea"))
    assert built_in(MACHINE, physical) == {"turn_time_s", "mean_flow_L_per_min"}
    assert built_in(MACHINE, mevea) == set(FIGURES)
    assert built_in(MACHINE, replace(mevea, figures={**mevea.figures, "turn_time_s": 2.491})) == set()
    assert built_in(Machine.load("aoro_datasheet"), mevea) == set()


def test_time_and_mean_flow_are_one_figure():
    row = Row(Turn("left", 100.0), {"turn_time_s": 1.98, "mean_flow_L_per_min": 70.6})
    assert row.compared == ("turn_time_s",)
    assert Row(row.turn, {"mean_flow_L_per_min": 70.6}).compared == ("mean_flow_L_per_min",)
