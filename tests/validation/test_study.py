"""The whole validation, small: rows, errors, spreads, checks and files."""

import base64
import dataclasses
import gzip
import io
import json
import re

import numpy as np
import pytest
from rich.console import Console

from aoro_gym.sensors import JointAngleNoise
from aoro_gym.sensors.chain import sample, turn_flow
from aoro_gym.validation import FIGURES, key_figures_batch, validate
from aoro_gym.validation.report import print_tables, write_report
from aoro_gym.validation.shape import MAXIMA, SHAPE
from aoro_gym.validation.study import TARGETS, Validation, noise_spread
from aoro_gym.validation.turns import TURNS, Turn, run_turns

KEY = "steering.valve.spool_time_constant"


@pytest.fixture(scope="module")
def result(machine) -> Validation:
    """A validation with a second machine and an ensemble of two."""
    said = []
    found = validate(
        machine,
        uncalibrated=machine.scale({KEY: 1.5}),
        ensemble=machine.scale({KEY: np.array([0.8, 1.2])}),
        noise_runs=30,
        progress=lambda *told: said.append(told),
    )
    assert said[0] == ("full turns, 24 twins", 0.0)
    return found


def test_rows_are_complete(result):
    content = json.loads(json.dumps(result.to_json(), allow_nan=False))
    assert content["machine"] == "aoro_datasheet"
    kinds = {(row["direction"], row["signal_percent"], row["source"]) for row in content["rows"]}
    assert len(kinds) == len(content["rows"]) == 6 * 3 + 9
    for row in content["rows"]:
        assert set(row) == {"direction", "signal_percent", "source", *FIGURES}
        if row["source"].startswith("twin"):
            assert all(row[name] > 0 for name in FIGURES)
    assert content["notes"] == []


def test_rows_are_those_of_a_single_run(result, machine, left_turn):
    ticks, angle = sample(left_turn.time, left_turn["joint_angle"])
    alone = key_figures_batch(ticks, angle, machine)
    flow = turn_flow(machine.steering.cylinder, left_turn["joint_angle"], left_turn["joint_rate"], 1)
    raw = key_figures_batch(left_turn.time, left_turn["joint_angle"], machine, flow=flow)
    for source, figures in (("twin", alone), ("twin_raw", raw)):
        row = result.row(source, TURNS[0])
        # the ends of the recordings differ, by a joint that rests: far below the digits kept
        assert [row[name] for name in FIGURES] == pytest.approx([figures[name][0] for name in FIGURES], rel=1e-6)


def test_errors_follow_from_the_rows(result):
    assert len(result.errors) == 3 * (3 * 2 + 3)
    for item in result.errors:
        turn = next(t for t in TURNS if (t.direction, t.signal_percent) == (item["direction"], item["signal_percent"]))
        row, reference = result.row(item["source"], turn), result.row(item["reference"], turn)
        for name in FIGURES:
            if reference[name] is None:
                assert item["relative"][name] is item["difference"][name] is None
                continue
            assert item["relative"][name] == pytest.approx((row[name] - reference[name]) / reference[name])
            assert item["difference"][name] == pytest.approx(row[name] - reference[name])
            if item["reference"] == "mevea":
                kind, bound = TARGETS[name]
                error = abs(item[kind][name])
                if abs(error - bound) > 1e-6:
                    assert item["reached"][name] is (error < bound)
            else:
                assert item["reached"][name] is None
    reached, of = result.reached()
    assert of == 21
    assert 0 < reached <= 21
    assert result.misfit() > 0


def test_noise_surrounds_the_figures_without_it(result):
    assert len(result.noise) == 6
    for entry, turn in zip(result.noise, TURNS, strict=True):
        exact = result.row("twin", turn)
        for name in FIGURES:
            assert entry[name]["low90"] <= entry[name]["median"] <= entry[name]["high90"]
        # averages hardly feel the noise; extremes are pulled outward
        assert entry["steady_flow_L_per_min"]["median"] == pytest.approx(exact["steady_flow_L_per_min"], rel=0.01)
        assert entry["lowest_undershoot_L_per_min"]["median"] < exact["lowest_undershoot_L_per_min"]
        assert entry["second_peak_L_per_min"]["median"] > exact["second_peak_L_per_min"]


def test_ensemble_spans_its_members(result):
    assert result.ensemble_members == 2
    for entry, turn in zip(result.ensemble, TURNS, strict=True):
        exact = result.row("twin", turn)["first_peak_L_per_min"]
        assert entry["first_peak_L_per_min"]["low"] < exact < entry["first_peak_L_per_min"]["high"]


def test_checks(result):
    left, right, three_quarters, half, braked, bare, rim, mass, *swings, halved = result.checks
    assert (left["published"], right["published"]) == (1.98, 2.14)
    assert (braked["published"], bare["published"]) == (12.8, 4.6)
    assert (rim["published"], mass["published"]) == (0.74, 10_000)
    for check, turn in ((three_quarters, Turn("right", 75.0)), (half, Turn("right", 50.0))):
        known, own = (result.row(source, turn)["mean_flow_L_per_min"] for source in ("physical", "twin"))
        assert (check["published"], check["value"], check["bound"]) == (known, own, 0.02 * known)
    for check in (left, right, three_quarters, half, braked, bare, rim, mass):
        assert check["reached"] is (abs(check["value"] - check["published"]) <= check["bound"])
    assert bare["reached"]
    assert [check["what"][-13:] for check in swings] == [" 100 % signal", ", 75 % signal", ", 50 % signal"]
    assert all(check["reached"] is (0.0 <= check["value"] <= 2.0) for check in swings)
    assert halved["reached"]  # the substeps are fine enough for every flow figure


def test_shape(result):
    assert [figure["name"] for figure in result.shape] == list(SHAPE)
    for figure in result.shape:
        assert figure["reached"] is (abs(figure["value"] - figure["published"]) <= figure["bound"] + 1e-9), figure
    assert result.to_json()["shape"] == result.shape
    assert 0 < result.shape_reached < 7
    # by the unfiltered curve's maxima, which the filter moves by 0.02 s at most
    (curve,) = (curve for curve in result.curves if curve.turn == TURNS[0])
    (first,) = (figure["value"] for figure in result.shape if figure["name"] == MAXIMA[0])
    assert curve.raw_time[np.argmax(curve.raw_flow)] == pytest.approx(first, abs=0.021)


def test_curves_begin_at_zero_and_show_the_figures(result):
    for curve in result.curves:
        row = result.row("twin", curve.turn)
        peak = np.argmax(np.where((curve.time >= 0) & (curve.time < 0.295), curve.flow, -np.inf))
        assert curve.flow[peak] == pytest.approx(row["first_peak_L_per_min"], rel=1e-6)
        assert curve.time[peak] == pytest.approx(row["first_peak_time_s"], abs=1e-9)
        assert curve.low.shape == curve.high.shape == curve.time.shape
        assert (curve.low <= curve.high).all()


def test_seed_decides_the_noise(machine):
    recording, noise = run_turns(machine), JointAngleNoise.published()
    first, again, other = (noise_spread(recording, noise, 3, seed) for seed in (1, 1, 2))
    assert first == again != other
    silent = noise_spread(recording, JointAngleNoise(), 20, 1)
    for entry, noisy in zip(silent, noise_spread(recording, noise, 20, 1), strict=True):
        # without noise only the clock's phase is left: a sample at either end
        assert entry["turn_time_s"]["high90"] - entry["turn_time_s"]["low90"] <= 0.0201
        peak = "first_peak_L_per_min"
        assert entry[peak]["high90"] - entry[peak]["low90"] < noisy[peak]["high90"] - noisy[peak]["low90"]


def test_files(result, tmp_path):
    written = write_report(result, tmp_path / "out")
    assert [path.name for path in written] == [
        "validation.json", "left_turns.png", "right_turns.png", "errors.png", "index.html",
    ]  # fmt: skip
    assert json.loads(written[0].read_text(encoding="utf-8")) == result.to_json()
    for picture in written[1:4]:
        assert picture.read_bytes().startswith(b"\x89PNG")
    page = written[4].read_text(encoding="utf-8")
    markup = re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    assert not re.search(r"""(?:src|href)\s*=\s*["'](?!data:|#)""", markup)
    assert page.count('<tr class="level">') == 6
    assert "with sensor noise" in page
    for figure in result.shape:
        assert figure["what"] in markup
    packed = re.findall(r"H4sI[\w+/=]+", page)  # how gzip begins in base64
    plots = [gzip.decompress(base64.b64decode(one)).decode() for one in packed]
    assert any("twin's maxima" in plot for plot in plots)


def test_tables(result):
    stream = io.StringIO()
    print_tables(Console(file=stream, width=220), result)
    text = stream.getvalue()
    for words in ("lowest undershoot", "published twin", "ensemble", "uncalibrated", "motor pressure at 0.75 m/s"):
        assert words in text
    for what, _, _ in SHAPE.values():
        assert what in text
    assert "104.4" in text
    (swing,) = (check for check in result.checks if check["what"] == "steady flow's swing, left turn, 50 % signal")
    (line,) = (line for line in text.splitlines() if swing["what"] in line)
    assert f" {swing['value']:.2f} " in line and "±\N{NO-BREAK SPACE}2.00" in line


def test_the_headline_names_the_machine_and_its_published_twin(result):
    machine = result.misses("physical")
    assert len(machine) == 25  # to the left all, to the right the time at full signal and what follows from it
    # by hand, of the row of 50 %: the machine's first peak is 32.4 L/min
    (peak,) = (one for one in machine if (one.figure, one.signal_percent) == ("first_peak_L_per_min", 50.0))
    twin = result.row("twin", Turn("left", 50.0))
    assert twin is not None and isinstance(twin["first_peak_L_per_min"], float)
    assert peak.error == pytest.approx(twin["first_peak_L_per_min"] / 32.4 - 1.0)
    assert peak.in_bounds == pytest.approx(abs(peak.error) / 0.05, rel=1e-6)
    assert machine == sorted(machine, key=lambda one: -one.in_bounds)
    met = sum(one.in_bounds <= 1.0 for one in machine)
    assert f"{met} of 25 figures of the published machine itself" in result.headline()
    assert f"{result.reached()[0]} of 21 of its published twin" in result.headline()
    assert f"of the shape of that one's curve {result.shape_reached} of 7." in result.headline()
    assert machine[0].words in result.headline()
    assert sum(one.in_bounds <= 1.0 for one in result.misses("mevea")) == result.reached()[0]


@pytest.mark.slow
def test_a_report_without_second_machine_noise_and_ensemble(machine, tmp_path, monkeypatch):
    monkeypatch.setattr("aoro_gym.validation.study.motor_pressure_at", lambda *_, **__: np.array([np.nan]))
    plain = validate(machine, noise_runs=0)
    write_report(plain, tmp_path)
    assert [check["value"] for check in plain.checks if check["what"].startswith("motor pressure")] == [None, None]
    stream = io.StringIO()
    print_tables(Console(file=stream, width=160), plain)
    assert "ensemble" not in stream.getvalue()
    assert plain.row("twin_uncalibrated", TURNS[0]) is None


def test_a_lost_twin_and_one_that_does_not_arrive_leave_blanks(machine, tmp_path, monkeypatch):
    whole = run_turns(machine)
    angle, flow = whole.angle.copy(), whole.flow.copy()
    angle[900:, 1] = flow[900:, 1] = np.nan  # 75 % to the left: diverged
    angle[1200:, 5], flow[1200:, 5] = angle[1200, 5], 0.0  # 50 % to the right: stuck
    broken = dataclasses.replace(whole, angle=angle, flow=flow, diverged=((1, 0, "non-finite state"),))
    monkeypatch.setattr("aoro_gym.validation.study.run_turns", lambda *_, **__: broken)
    monkeypatch.setattr("aoro_gym.validation.study.motor_pressure_at", lambda *_, **__: np.array([12.8e5]))
    result = validate(machine, noise_runs=5)
    assert result.notes == [
        "aoro_datasheet, left turn, 75 % signal: simulation diverged (non-finite state)",
        "aoro_datasheet, right turn, 50 % signal: did not reach its stop",
    ]
    for index in (1, 5):
        row = result.row("twin", TURNS[index])
        assert row is not None
        assert [row[name] for name in FIGURES] == [None] * 7
        assert result.noise[index]["turn_time_s"] == {"low90": None, "median": None, "high90": None}
    assert result.reached()[1] == 21
    assert result.reached()[0] <= 14
    assert all(figure["value"] is not None for figure in result.shape)  # of another turn
    assert "at 75 % signal, not reached" in result.headline()
    write_report(result, tmp_path)
    print_tables(Console(file=io.StringIO()), result)
