"""Key figures of recordings: the published ones of a turn, and those of a drive."""

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from aoro_gym.sensors.chain import sample
from aoro_gym.simulation.figures import Figures, key_figures, turn_start
from aoro_gym.simulation.key_figures import FIGURES
from aoro_gym.simulation.key_figures import key_figures as published_figures
from aoro_gym.simulation.manoeuvres import STANDSTILL, Recording


def known(figures: Figures) -> dict[str, float]:
    """The figures, none of which is missing."""
    values = {name: value for name, value in figures.items() if value is not None}
    assert len(values) == len(figures)
    return values


def test_a_turn_has_the_published_figures(left_turn, machine):
    figures = known(key_figures(left_turn, machine.steering.cylinder))
    ticks, angle = sample(left_turn.time, left_turn["joint_angle"])
    assert {name: figures[name] for name in FIGURES} == published_figures(ticks, angle, machine)
    # sampled ten times as fast, and unfiltered: an extreme can only grow
    assert figures["raw_first_peak_L_per_min"] > figures["first_peak_L_per_min"]
    assert figures["raw_lowest_undershoot_L_per_min"] < figures["lowest_undershoot_L_per_min"]
    assert figures["raw_steady_flow_L_per_min"] == pytest.approx(figures["steady_flow_L_per_min"], rel=0.01)


def test_a_turn_that_does_not_arrive_has_no_figures_of_a_turn(left_turn, machine):
    cut = left_turn.time < STANDSTILL + 1.0
    channels = {name: values[cut] for name, values in left_turn.channels.items()}
    figures = key_figures(Recording(left_turn.manoeuvre, left_turn.time[cut], channels), machine.steering.cylinder)
    assert {figures[name] for name in FIGURES} == {None}
    assert figures["highest_pressure_a_bar"] is not None


def test_a_turn_starts_after_its_signal(left_turn, drive):
    start = turn_start(left_turn)
    assert start is not None
    assert STANDSTILL < start < STANDSTILL + 0.2
    assert turn_start(drive) is None


@pytest.mark.parametrize("turn", ["left_turn", "right_turn"])
def test_the_twins_turn_closes_its_oil_balance(turn, machine, request):
    recording = request.getfixturevalue(turn)
    figures = known(key_figures(recording, machine.steering.cylinder))
    drawn = cumulative_trapezoid(recording["joint_flow"], recording.time, initial=0.0).max()
    # the joint springs back from its stop by less than a degree of its 80
    assert drawn == pytest.approx(2.331e-3, rel=1 / 80)
    assert figures["raw_first_peak_L_per_min"] > figures["mean_flow_L_per_min"]
    high = "a" if turn == "left_turn" else "b"
    low = "b" if turn == "left_turn" else "a"
    assert figures[f"highest_pressure_{high}_bar"] > 5 * figures[f"highest_pressure_{low}_bar"]


def test_figures_of_a_drive(drive, machine):
    figures = key_figures(drive, machine.steering.cylinder)
    assert figures["distance_m"] == pytest.approx(np.hypot(drive["position_x"][-1], drive["position_y"][-1]), rel=0.01)
    assert figures["final_speed_m_per_s"] == pytest.approx(drive["speed"][-1], rel=0.1)
    assert "highest_pressure_a_bar" not in figures
