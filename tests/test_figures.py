"""Key figures against turns whose figures are known by construction."""

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid, quad

from aoro_gym.figures import TOLERANCE, Figures, key_figures, turn_figures, turn_flow

LITRE_PER_MINUTE = 1e-3 / 60
STOP = np.radians(40.0)
REST = 0.6
RISE = 0.01


def known(figures: Figures) -> dict[str, float]:
    """The figures, none of which is missing."""
    values = {name: value for name, value in figures.items() if value is not None}
    assert len(values) == len(figures)
    return values


def made_turn(direction: int = 1, duration: float = 2.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, angle and a flow with known extremes, of a turn whose joint moves at a constant rate."""
    time = np.arange(0.0, REST + duration + 1.0, 1e-3)
    since = time - REST
    angle = direction * np.clip(-STOP + 2 * STOP * since / duration, -STOP, STOP)
    knots = [-1.0, 0.0, 0.1, 0.4, 0.7, 0.9, duration, duration + RISE, 9.0]
    flow = np.interp(since, knots, [0, 0, 100, 50, 90, 70, 70, 0, 0]) * LITRE_PER_MINUTE
    return time, angle, flow


@pytest.mark.parametrize("direction", [1, -1])
def test_figures_of_a_made_turn(direction):
    duration = 2.0
    made = made_turn(direction, duration)
    figures = known(turn_figures(*made, stop=direction * STOP, volume=2.331e-3, prefix="raw_"))
    rate = 2 * STOP / duration
    late = TOLERANCE / rate  # the clock starts 0.1 deg after the start, and ends 0.1 deg before the stop
    turn_time = duration - 2 * late
    step = 1.001e-3  # each end of an interval is found to a sample
    assert figures["turn_time_s"] == pytest.approx(turn_time, abs=2 * step)
    assert figures["mean_flow_L_per_min"] == pytest.approx(2.331 * 60 / figures["turn_time_s"])
    assert figures["raw_first_peak_L_per_min"] == pytest.approx(100.0)
    assert figures["raw_first_peak_time_s"] == pytest.approx(0.1 - late, abs=step)
    assert figures["raw_lowest_undershoot_L_per_min"] == pytest.approx(50.0)
    assert figures["raw_second_peak_L_per_min"] == pytest.approx(90.0)
    assert figures["raw_steady_flow_L_per_min"] == pytest.approx(70.0)


def test_a_turn_that_does_not_arrive_has_no_figures():
    time, angle, flow = made_turn()
    cut = time < 2.0
    figures = turn_figures(time[cut], angle[cut], flow[cut], stop=STOP, volume=2.331e-3)
    assert set(figures.values()) == {None}
    still = turn_figures(time, np.full_like(time, -STOP), 0 * time, stop=STOP, volume=2.331e-3)
    assert set(still.values()) == {None}


def test_beyond_the_stop_has_arrived():
    time, angle, flow = made_turn()
    pressed = np.where(angle >= STOP - TOLERANCE, STOP + 2 * TOLERANCE, angle)  # springs past the window in one sample
    figures = turn_figures(time, pressed, flow, stop=STOP, volume=2.331e-3)
    assert figures["turn_time_s"] == turn_figures(time, angle, flow, stop=STOP, volume=2.331e-3)["turn_time_s"]


def test_a_full_turn_draws_both_full_strokes(machine):
    cylinder = machine.steering.cylinder
    volume, _ = quad(lambda angle: turn_flow(cylinder, angle, 1.0, 1), -cylinder.half_range, cylinder.half_range)
    mirrored, _ = quad(lambda angle: turn_flow(cylinder, angle, -1.0, -1), -cylinder.half_range, cylinder.half_range)
    assert volume == pytest.approx((cylinder.bore_area + cylinder.annulus_area) * cylinder.stroke, rel=1e-9)
    assert mirrored == pytest.approx(volume, rel=1e-9)
    assert volume == pytest.approx(2.331e-3, abs=0.5e-6)  # the published machine


def test_flow_of_a_left_turn_is_the_twins_own(left_turn):
    largest = np.abs(left_turn["joint_flow"]).max()
    np.testing.assert_allclose(left_turn["turn_flow"], left_turn["joint_flow"], atol=1e-5 * largest)


@pytest.mark.parametrize("turn", ["left_turn", "right_turn"])
def test_the_twins_turn_closes_its_oil_balance(turn, machine, request):
    recording = request.getfixturevalue(turn)
    figures = known(key_figures(recording, machine.steering.cylinder))
    drawn = cumulative_trapezoid(recording["turn_flow"], recording.time, initial=0.0).max()
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
