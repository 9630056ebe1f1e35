"""Grades by repeated turns: how often a further run is excellent, and what is good or missed."""

import numpy as np
import pytest

from aoro_gym.calibration.grades import TICK_STD, graded, half_width, sentence
from aoro_gym.calibration.measured import MeasuredTurn
from aoro_gym.calibration.procedure_logs import grade_turns, turn_figures
from aoro_gym.calibration.report import tables
from aoro_gym.machine import Machine
from aoro_gym.sensors.chain import SAMPLE_RATE
from aoro_gym.sensors.joint_angle import JointAngleNoise, JointAngleSensor
from aoro_gym.simulation.key_figures import FIGURES, key_figures_batch
from aoro_gym.validation.turns import Turn, run_turns

PEAK = "first_peak_L_per_min"


@pytest.mark.parametrize("repeats", [3, 5, 12])
def test_one_more_run_is_excellent_in_95_percent(repeats):
    """By draws: of 20,000 their share has a standard deviation of 0.15 %; five of them are allowed."""
    rng = np.random.default_rng(repeats)
    runs = 100.0 + 2.0 * rng.standard_normal((20_000, repeats + 1))
    known, further = runs[:, :-1], runs[:, -1]
    width = np.array([half_width(std, repeats) for std in np.std(known, axis=1, ddof=1)])
    share = np.mean(np.abs(further - known.mean(axis=1)) <= width)
    assert share == pytest.approx(0.95, abs=5.0 * np.sqrt(0.95 * 0.05 / 20_000))


def test_beyond_the_runs_the_bound_of_the_validation_counts():
    runs = [99.0, 100.0, 101.0]  # s = 1, t = 4.303: ± 4.97; the bound of a first peak is 5 %
    grades = [graded(PEAK, runs, twin, turn_time=2.0) for twin in (104.9, 104.99, 105.1, np.nan)]
    assert [one.grade for one in grades if one] == ["excellent", "good", "missed", "missed"]
    assert grades[0] is not None and grades[0].run_to_run == pytest.approx(4.9683, abs=1e-3)
    assert grades[2] is not None and grades[2].deviation == pytest.approx(5.1)
    assert sentence([one for one in grades if one]).endswith("1 excellent, 1 good, 2 missed")


def test_two_repeats_give_no_grade():
    assert graded(PEAK, [99.0, 101.0, np.nan], 100.0, turn_time=2.0) is None


def test_equal_times_are_known_to_a_tick():
    """Times are read from samples: three equal ones still leave ± 4.30 · 2.9 ms · √(4/3) = 14.3 ms."""
    one = graded("turn_time_s", [1.98] * 3, 1.99, turn_time=1.98)
    assert one is not None and one.grade == "excellent" and one.run_to_run == pytest.approx(0.01434, abs=1e-5)
    flow = graded("mean_flow_L_per_min", [70.6] * 3, 70.6, turn_time=1.98)
    assert flow is not None and flow.std == pytest.approx(70.6 * TICK_STD / 1.98)


def test_grades_of_turns_and_their_table():
    left, right = Turn("left", 100.0), Turn("right", 100.0)
    figures: dict[str, float] = dict(zip(FIGURES, (1.98, 70.6, 69.0, 104.4, 0.15, 46.8, 88.7), strict=True))
    turns = [
        MeasuredTurn(f"{i}.csv", left, 1.98, 70.6, figures | {PEAK: 104.0 + 0.4 * i}, np.zeros(60)) for i in range(3)
    ]
    turns.append(MeasuredTurn("right.csv", right, 2.14, 65.4, figures, np.zeros(60)))
    twin = figures | {PEAK: 99.1, "lowest_undershoot_L_per_min": 62.8}
    found = grade_turns(turns, {left: twin, right: figures})
    assert list(found) == [left], "one right turn has no spread"
    grades = {one.figure: one.grade for one in found[left]}
    assert [grades[name] for name in FIGURES] == [
        "excellent", "excellent", "excellent", "missed", "excellent", "missed", "excellent"
    ]  # fmt: skip
    rows = [{"direction": "left", "signal_percent": 100.0, **vars(one)} for one in found[left]]
    report = {"verdict": {"fits": True, "sentence": "fits"}, "grades": rows, "graded": sentence(found[left])}
    _, table, text = tables(report)
    assert "first peak" in str(getattr(table, "rows", "")) and "5 excellent, 0 good, 2 missed" in str(text)


def test_the_twins_figures_are_as_noisy_as_those_of_the_logs():
    """The sensor's noise lowers undershoots and raises second peaks of all recordings. The mean of 200 recordings of the
    twin's own turn is known to a fourteenth of what one scatters, 5 % of what noise does to it; a process of order 12 that
    is fitted to half seconds is not quite that noise, for which a fifth is allowed."""
    machine, turn = Machine.load("aoro_datasheet"), Turn("left", 75.0)
    recording = run_turns(machine, [turn])
    every = round(1.0 / (SAMPLE_RATE * (recording.time[1] - recording.time[0])))
    exact = np.repeat(recording.angle[::every, 0], 200, axis=1)
    assert np.ptp(exact[:50, 0]) < 1e-4, "half a second of standstill comes first"
    sensor = JointAngleSensor(noise=JointAngleNoise.published())
    ticks, angle = sensor.record(exact, np.arange(len(exact)) / SAMPLE_RATE, np.random.default_rng(0))
    found = key_figures_batch(ticks, angle, machine)
    own = {name: float(values[0]) for name, values in found.items()}
    turns = [MeasuredTurn(f"{k}.csv", turn, 3.08, 45.4, own, angle[:50, k]) for k in range(100)]
    without, noisy = (figures[turn] for figures in turn_figures(machine, turns))
    for name in ("lowest_undershoot_L_per_min", "second_peak_L_per_min"):
        bias = np.mean(found[name]) - without[name]
        assert abs(bias) > 3.0
        assert noisy[name] - without[name] == pytest.approx(bias, rel=0.2), name
