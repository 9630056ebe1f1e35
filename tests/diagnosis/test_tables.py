"""Diagnosis of key figures: tables that cannot be used, what figures are, and causes that the twin itself was given."""

import json
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from aoro_gym.calibration.turns import population_figures
from aoro_gym.diagnosis.linear import Linear
from aoro_gym.diagnosis.nuisances import Nuisances
from aoro_gym.diagnosis.replay import FINE, Variants
from aoro_gym.diagnosis.report import summary, write_report
from aoro_gym.diagnosis.result import CALIBRATION
from aoro_gym.diagnosis.tables import (
    ERROR,
    FAILED,
    Row,
    Turns,
    _black_box,
    _shrinkages,
    built_in,
    diagnose_rows,
    nothing,
    read_rows,
    selected,
)
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.machine import Machine
from aoro_gym.simulation.key_figures import FIGURES
from aoro_gym.validation.turns import Turn

MACHINE = Machine.load("aoro")
PUBLISHED = Path(str(files("aoro_gym").joinpath("validation/data/left_turn_metrics.csv")))
CANDIDATES = {name: EFFECTS[name] for name in ("joint_backlash", "spool_lag", "sensor_filter")}
PLAY, GIVE = 0.01, 1.5e-7
"""Of the joint [rad], and of its pins [rad/(N m)]."""
LEVELS = (100.0, 75.0)


def rows_of(variants: Variants, levels=LEVELS, std: float | None = None) -> list[Row]:
    """What a machine shows in left turns."""
    blank = [Row(Turn("left", level), {"first_peak_time_s": 0.1}) for level in levels]
    shown = Turns(blank, Nuisances(MACHINE, "range"), {}).figures(variants)
    known = [{name: value for name, value in one.items() if value is not None} for one in shown]
    return [Row(row.turn, one, dict.fromkeys(one, std) if std else {}) for row, one in zip(blank, known, strict=True)]


@pytest.fixture(scope="module")
def own() -> list[Row]:
    """Figures of the twin itself."""
    return rows_of(Variants(MACHINE))


@pytest.fixture(scope="module")
def turns(own) -> Turns:
    return Turns(own, Nuisances(MACHINE, "range"), {})


# ---- tables ----


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


# ---- figures ----


def test_figures_are_those_that_a_calibration_sees(own):
    """Turns end where the given twin's do, not at its stop: with one machine that is the same."""
    exact = population_figures(MACHINE, [row.turn for row in own], substeps=FINE.substeps)[:, :, 0]
    found = np.array([[row.figures[name] for name in FIGURES] for row in own])
    np.testing.assert_allclose(found, exact, rtol=1e-4)


def test_a_sensors_gain_leaves_a_turn_its_time(own, turns):
    """The stop is where the measured angle comes to rest. The flow that the chain finds grows as the angle does, and by a
    lever that hardly changes: by 3 % ± 1 %."""
    longer = turns.figures(Variants.of(MACHINE, [(EFFECTS["sensor_gain"], (0.03,))], 1))
    for row, shown in zip(own, longer, strict=True):
        assert shown["turn_time_s"] == pytest.approx(row.figures["turn_time_s"], abs=0.01)
        assert shown["steady_flow_L_per_min"] == pytest.approx(1.03 * row.figures["steady_flow_L_per_min"], rel=0.01)


def test_a_turn_that_does_not_end_is_far_off(turns):
    stuck = Variants(MACHINE.set({"steering.cylinder.seal_preload": 1e6}))
    (found,) = turns.simulate([stuck]).T
    off = (found - turns.measured) / np.sqrt(np.diag(turns.covariance))
    np.testing.assert_allclose(off, FAILED)
    assert set(turns.figures(stuck)[0].values()) == {None}


def test_noise_moves_extremes_outwards_where_the_table_does_not_say_how_they_scatter(own, turns):
    of = dict(zip(turns.compared, turns.bias, strict=True))
    for k in range(len(own)):
        assert of[k, "lowest_undershoot_L_per_min"] < -1.0
        assert of[k, "second_peak_L_per_min"] > 1.0
    known = Turns(rows_of(Variants(MACHINE), std=0.5), Nuisances(MACHINE, "range"), {})
    np.testing.assert_array_equal(known.bias, 0.0)
    np.testing.assert_allclose(np.diag(known.covariance), turns._own_error() ** 2 + 0.25, rtol=1e-6)


def test_time_and_mean_flow_are_one_figure():
    row = Row(Turn("left", 100.0), {"turn_time_s": 1.98, "mean_flow_L_per_min": 70.6})
    assert row.compared == ("turn_time_s",)
    assert Row(row.turn, {"mean_flow_L_per_min": 70.6}).compared == ("mean_flow_L_per_min",)


# ---- evidence ----


@pytest.mark.slow
def test_the_evidence_of_nothing_is_that_of_a_normal_distribution(own):
    """Of the twin's figures with its own error and the noise, whose share in the extremes is integrated out."""
    moved = [
        replace(row, figures={n: v * (1.04 if "peak" in n else 1.0) for n, v in row.figures.items()}) for row in own
    ]
    problem = Turns(moved, Nuisances(MACHINE, "range"), {})
    problem.learn()
    linear = Linear(problem, problem.error)
    seen = np.diag(problem._spread(ERROR) - problem.covariance) / np.diag(problem.covariance)
    covariance = (
        problem.covariance + np.diag(seen * np.diag(problem.covariance)) + 0.25 * np.outer(problem.bias, problem.bias)
    )
    exact = multivariate_normal.logpdf(problem.measured - problem.given, cov=covariance)  # pyright: ignore[reportArgumentType]
    count = len(problem.compared)
    assert nothing(problem, linear).log_evidence - 0.5 * count * np.log(2.0 * np.pi) == pytest.approx(exact, abs=1e-6)


def test_shrinkage_is_nil_of_what_changes_nothing_and_whole_of_what_is_right(own, turns):
    gap = rows_of(Variants.of(MACHINE, [(EFFECTS["joint_backlash"], (PLAY, GIVE))], 1))
    problem = Turns(gap, Nuisances(MACHINE, "range"), {})
    same = _shrinkages(problem, problem.given[:, None], held_out=True)
    assert same
    assert all(one.S == 0.0 and one.low90 == one.high90 == 0.0 for one in same)
    # nothing but the variance that noise would have had is left, and taken off: beyond one
    right = _shrinkages(problem, problem.measured[:, None], held_out=True)
    assert all(one.S >= 1.0 and one.after == 0.0 for one in right)
    assert _shrinkages(turns, turns.given[:, None], held_out=True) == ()


def test_a_black_box_carries_factors_from_level_to_level(own):
    """By the mean of the levels that it learns from; of one level it repeats what it has seen."""
    off = [
        replace(row, figures={name: factor * row.figures[name] for name in FIGURES if "mean" not in name})
        for row, factor in zip(own, (1.1, 1.2), strict=True)
    ]
    both, first, second = (Turns(rows, Nuisances(MACHINE, "range"), {}) for rows in (off, off[:1], off[1:]))
    np.testing.assert_allclose(_black_box(first, first)[:, 0], first.measured)
    steady = second.compared.index((0, "steady_flow_L_per_min"))
    assert _black_box(both, second)[steady, 0] == pytest.approx(1.15 * second.given[steady], rel=1e-3)
    assert _black_box(first, second)[steady, 0] == pytest.approx(1.1 * second.given[steady], rel=1e-3)


# ---- the diagnosis ----


@pytest.mark.slow
def test_the_twins_own_figures_show_no_gap(own):
    found = diagnose_rows(own[:1], MACHINE, CANDIDATES)
    assert found.verdict == "no_gap"
    assert found.shrinkage == ()
    assert found.where == ()


@pytest.mark.slow
def test_another_calibration_is_called_so(tmp_path):
    """A valve at the upper end of its range turns faster than any effect of the few here would make it."""
    high = MACHINE.entries["steering.valve.nominal_flow_left"].range[1]
    found = diagnose_rows(
        rows_of(Variants(MACHINE.set({"steering.valve.nominal_flow_left": high})), (100.0,)),
        MACHINE,
        CANDIDATES,
        out=tmp_path,
    )
    assert found.causes[0].effects == (CALIBRATION,), [(c.title, c.probability) for c in found.causes]
    assert found.fit_test_p is not None
    assert found.fit_test_p > 0.05
    moved = Machine.load(str(tmp_path / found.causes[0].machine_file))
    after = rows_of(Variants(moved))[0].figures["turn_time_s"]
    assert after == pytest.approx(found.key_figures["left, 100 %"]["turn_time_s"]["measured"], rel=0.02)


@pytest.mark.slow
def test_a_cause_its_size_and_what_is_gone_elsewhere(tmp_path):
    """Play of the joint, fitted at one level and asked of another."""
    shown = rows_of(Variants.of(MACHINE, [(EFFECTS["joint_backlash"], (PLAY, GIVE))], 1), levels=(75.0, 60.0, 100.0))
    found = diagnose_rows(shown[:2], MACHINE, CANDIDATES, held_out=shown[2:], out=tmp_path)
    first = found.causes[0]
    assert first.effects == ("joint_backlash",), [(c.title, c.probability) for c in found.causes]
    (size,) = first.magnitudes["joint_backlash"]
    assert size.low90 < PLAY <= size.high90
    assert found.components["joint"] > 0.5
    (left,) = [one for one in found.shrinkage if one.held_out]
    assert left.manoeuvre == "left, 100 %"
    assert left.S > 0.5
    assert found.controls["cause"] == left.S
    content = json.loads(found.save(tmp_path).read_text(encoding="utf-8"))
    figure = content["key_figures"]["left, 100 %"]["lowest_undershoot_L_per_min"]
    assert figure["held_out"] is True
    assert figure["built_in"] is False
    assert abs(figure["after"] - figure["measured"]) < abs(figure["before"] - figure["measured"])
    assert (tmp_path / first.machine_file).is_file()
    page = write_report(found, tmp_path).read_text(encoding="utf-8")
    assert "left, 100 %" in page
    assert summary(found)
