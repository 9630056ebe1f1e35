"""The published numbers as carried over."""

from importlib.resources import files

import pytest

from aoro_gym.simulation.key_figures import FIGURES
from aoro_gym.validation.published import published, published_rows, valve_flow


def test_tables_name_their_source():
    for name in ("left_turn_metrics.csv", "valve_flow.csv", "single_figures.csv"):
        text = files("aoro_gym").joinpath("validation", "data", name).read_text(encoding="utf-8")
        assert text.startswith("# Lehto et al., Machines 2026, 14, 128")


def test_every_turn_took_the_same_oil():
    """Time times mean flow is 2.331 L in every published row, to the digits that are printed."""
    complete = [row for row in published_rows() if row["turn_time_s"] is not None]
    assert len(complete) == 7
    for row in complete:
        time, flow = row["turn_time_s"], row["mean_flow_L_per_min"]
        assert isinstance(time, float)
        assert isinstance(flow, float)
        assert time * flow / 60 == pytest.approx(2.331, rel=0.005 / time + 0.05 / flow)


def test_rows_have_every_figure_and_direction():
    rows = published_rows()
    assert [(r["direction"], r["signal_percent"], r["source"]) for r in rows] == [
        *(("left", percent, source) for percent in (100.0, 75.0, 50.0) for source in ("physical", "mevea")),
        *(("right", percent, "physical") for percent in (100.0, 75.0, 50.0)),
    ]
    for row in rows:
        assert set(row) == {"direction", "signal_percent", "source", *FIGURES}


def test_mean_flows_to_the_left_are_the_valve_curve():
    curve = valve_flow()
    at = dict(zip(curve["signal_V"], curve["left_L_per_min"], strict=True))
    for row in published_rows():
        if (row["direction"], row["source"]) == ("left", "physical"):
            assert isinstance(row["signal_percent"], float)
            assert row["mean_flow_L_per_min"] == at[row["signal_percent"] / 50.0]
    assert curve["right_L_per_min"] == sorted(curve["right_L_per_min"])


def test_single_figures():
    assert published("turn_time_right") == 2.14
    assert published("motor_pressure") > published("motor_pressure_without_brake") > 0
    with pytest.raises(KeyError):
        published("colour")
