"""Diagnosis of key figures: what twins show, what networks are asked, and what follows from what they say."""

import json
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from aoro_gym.calibration.turns import population_figures
from aoro_gym.diagnosis import tables_diagnosis
from aoro_gym.diagnosis.network import hypotheses
from aoro_gym.diagnosis.network.decision import Calibration, NullStatistic
from aoro_gym.diagnosis.network.forward import Weights
from aoro_gym.diagnosis.network.shape import QUANTILES, Shape
from aoro_gym.diagnosis.network.tables_features import FEATURES
from aoro_gym.diagnosis.network.tables_forward import DAY_ONE, PAIRED
from aoro_gym.diagnosis.replay import Simulator, Variants
from aoro_gym.diagnosis.report import summary, write_report
from aoro_gym.diagnosis.result import KEY_FIGURES
from aoro_gym.diagnosis.simulation.turns import READ
from aoro_gym.diagnosis.tables import Row, read_rows
from aoro_gym.diagnosis.tables_diagnosis import Pair, _gap_closure, _setting, diagnose_rows, paired, rows_of
from aoro_gym.diagnosis.tables_twin import TwinTurns, turn_time
from aoro_gym.diagnosis.words import conclusions
from aoro_gym.effects.catalogue import EFFECTS, IDS
from aoro_gym.machine import Machine
from aoro_gym.simulation.key_figures import FIGURES
from aoro_gym.units import LITRE_PER_MINUTE
from aoro_gym.validation.turns import Turn

MACHINE = Machine.load("aoro")
PUBLISHED = Path(str(files("aoro_gym").joinpath("validation/data/left_turn_metrics.csv")))
LAG = 0.075
"""Added to the spool's time constant [s]."""
LEVELS = (100.0, 75.0)
CERTAIN = Calibration(100, 1.0, (NullStatistic("nothing", 1.0, tuple(np.linspace(0.5, 1.0, 100))),), 0.9, 0.2)
"""Nothing is wrong from a probability of one half on."""
CALIBRATIONS = {PAIRED: CERTAIN, DAY_ONE: CERTAIN}


def network(probabilities: dict[int, float], size: float = 1.0) -> Weights:
    """One that says the same of all tables: probabilities by number of a hypothesis, and sizes around ``size`` times a scale
    of :data:`LAG`, 5 % apart."""
    shape = Shape(width=4, heads=1, within=0, across=0, kept=1, rank=1)
    sizes = {
        "cause": (1, 4), "norm.weight": (4,), "norm.bias": (4,), "single.weight": (2 + len(IDS), 4),
        "single.bias": (2 + len(IDS),), "member.weight": (len(IDS), 4), "member.bias": (len(IDS),),
        "left.weight": (len(IDS), 4), "left.bias": (len(IDS),), "right.weight": (len(IDS), 4), "right.bias": (len(IDS),),
        "size.0.weight": (4, 4), "size.0.bias": (4,), "size.2.weight": (len(IDS) * len(QUANTILES), 4),
        "size.2.bias": (len(IDS) * len(QUANTILES),), "wide.weight": (8, FEATURES), "wide.bias": (8,),
        "narrow.weight": (4, 8), "narrow.bias": (4,), "effects": (len(IDS), 4), "own": (len(IDS), 4, 2 + len(QUANTILES)),
        "one.weight": (2, 4), "one.bias": (2,), "other.weight": (2, 4), "other.bias": (2,),
    }  # fmt: skip
    arrays = {name: np.zeros(of, np.float32) for name, of in sizes.items()}
    arrays["single.bias"] -= 30.0
    arrays["member.bias"] -= 30.0
    for number, share in probabilities.items():
        arrays["single.bias"][number] = np.log(share)
    arrays["size.2.bias"][:] = np.tile(np.arcsinh(size * np.linspace(0.9, 1.1, 5)), len(IDS))
    return Weights(shape, arrays, np.full(len(IDS), LAG))


SPOOL = hypotheses.SINGLE + IDS.index("spool_lag")
SURE = network({SPOOL: 0.9, hypotheses.SINGLE + IDS.index("joint_friction"): 0.06, hypotheses.NOTHING: 0.04})


def turns_of(*levels: float) -> list[Row]:
    return [Row(Turn("left", level), {"first_peak_time_s": 0.1}) for level in levels]


def rows_with(*effects, levels=LEVELS) -> list[Row]:
    """What a machine with effects shows in left turns."""
    blank = turns_of(*levels)
    shown = TwinTurns(blank, MACHINE, Simulator()).figures([[Variants.of(MACHINE, list(effects), 1)]] * len(blank))
    return [
        Row(row.turn, {name: float(values[0]) for name, values in one.items()})
        for row, one in zip(blank, shown, strict=True)
    ]


@pytest.fixture(scope="module")
def healthy() -> list[Row]:
    """Figures of the twin itself."""
    return rows_with()


@pytest.fixture(scope="module")
def later() -> list[Row]:
    """Of a twin with a slow spool."""
    return rows_with((EFFECTS["spool_lag"], (LAG,)))


@pytest.fixture(scope="module")
def diagnosed(later, healthy, tmp_path_factory):
    folder = tmp_path_factory.mktemp("diagnosis")
    told = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tables_diagnosis, "SIZES", 2)
        found = diagnose_rows(
            later, MACHINE, healthy=healthy, networks=[SURE], calibrations=CALIBRATIONS, out=folder,
            progress=lambda *about: told.append(about),
        )  # fmt: skip
    return found, folder, told


# ---- twins ----


def test_figures_are_those_that_a_calibration_sees(healthy):
    """Turns end where the given twin's do, not at its stop: with one machine that is the same. Steps are twice as long, so
    what happens within one, half a step late in the mean, is felt 0.5 ms later."""
    exact = population_figures(MACHINE, [row.turn for row in healthy])[:, :, 0]
    found = np.array([[row.figures[name] for name in FIGURES] for row in healthy])
    for name, own, those in zip(FIGURES, found.T, exact.T, strict=True):
        np.testing.assert_allclose(
            own, those, rtol=1e-3, atol=5e-4 if name == "first_peak_time_s" else 0.0, err_msg=name
        )


def test_a_turn_that_does_not_end_has_no_figures():
    stuck = Variants(MACHINE.set({"steering.cylinder.seal_preload": 1e6}))
    (shown,) = TwinTurns(turns_of(100.0), MACHINE, Simulator()).figures([[stuck]])
    assert all(np.isnan(values).all() for values in shown.values())


def test_a_mean_flow_is_a_time():
    """The oil of a full turn, (bore + annulus) × stroke, over the flow."""
    cylinder = MACHINE.steering.cylinder
    oil = float((cylinder.bore_area + cylinder.annulus_area) * cylinder.stroke)
    row = Row(Turn("left", 100.0), {"mean_flow_L_per_min": 70.0})
    assert turn_time(row, MACHINE) == pytest.approx(oil / (70.0 * LITRE_PER_MINUTE))
    assert turn_time(Row(row.turn, {"turn_time_s": 2.0}), MACHINE) == 2.0
    assert turn_time(Row(row.turn, {"first_peak_time_s": 0.1}), MACHINE) is None
    with pytest.raises(ValueError, match="check the units of turn_time_s and mean_flow_L_per_min"):
        turn_time(Row(row.turn, {"turn_time_s": 2000.0, "mean_flow_L_per_min": 70.0}), MACHINE)


# ---- what networks are asked ----


def test_rows_of_the_same_turn_are_pairs():
    rows = read_rows(PUBLISHED, "physical")
    healthy = read_rows(PUBLISHED, "mevea")[1:]
    assert [pair.healthy for pair in paired(rows, healthy)] == [None, *healthy]


def test_networks_are_shown_what_a_table_says():
    """Signal, figures over their usual sizes, standard deviations, and a time from the mean flow."""
    row = Row(
        Turn("right", 75.0), {"mean_flow_L_per_min": 50.0, "first_peak_L_per_min": 90.0}, {"first_peak_L_per_min": 2.0}
    )
    (shown,) = rows_of([Pair(row)], MACHINE)
    first = 3 + len(READ)
    peak = READ.index("first_peak_L_per_min")
    assert shown[:3].tolist() == [-0.75, 0.75, -1.0]
    assert not shown[3:first].any()  # no healthy day
    assert shown[first + peak] == pytest.approx(90.0 / 60.0)
    assert 4.0 * shown[first] == pytest.approx(turn_time(row, MACHINE))
    assert np.count_nonzero(shown[first : first + len(READ)]) == 2
    assert shown[3 + 6 * len(READ) + peak] == pytest.approx(np.arcsinh(2.0 / (0.005 * 90.0 + 0.2)), rel=1e-6)


# ---- what follows ----


def test_the_cause_its_size_and_its_machine_are_given(diagnosed):
    found, folder, told = diagnosed
    first = found.causes[0]
    assert found.verdict == "cause" and found.mode == "commissioned" and first.effects == ("spool_lag",)
    assert found.signals == (KEY_FIGURES,) and found.declared_set == ("spool_lag",)
    (size,) = first.magnitudes["spool_lag"]
    assert (size.low90, size.median, size.high90) == pytest.approx((0.9 * LAG, LAG, 1.1 * LAG), rel=1e-5)
    assert first.settings["spool_lag"][0] == pytest.approx(LAG, rel=0.02)
    affected = Machine.load(str(folder / first.machine_file))
    longer = affected.steering.valve.spool_time_constant - MACHINE.steering.valve.spool_time_constant
    assert longer == pytest.approx(LAG, rel=0.02)
    assert next(iter(found.components)) == "valve"
    assert told[0][0] == "first finding: spool lag (90 %)"


def test_the_gap_is_gone_on_rows_left_out(diagnosed):
    """With the right cause and size nothing but what the table's scatter would have left, and is taken off: beyond one."""
    found, _, _ = diagnosed
    left_out = [one for one in found.shrinkage if one.held_out]
    assert [one.manoeuvre for one in left_out] == ["left, 100 %", "left, 75 %"]
    assert all(one.S > 0.95 and one.low90 <= one.S <= one.high90 for one in found.shrinkage)
    assert set(found.controls) == {"cause", "wrong_cause", "black_box"}
    wrong = found.controls["wrong_cause"]
    assert wrong is not None and wrong < found.controls["cause"]


def test_figures_that_moved_are_where_the_gap_lies(diagnosed):
    found, _, _ = diagnosed
    assert sum(place.share for place in found.where) == pytest.approx(1.0)
    assert {place.component for place in found.where} == {"valve"}
    assert "first_peak" in {place.phase for place in found.where}


def test_all_figures_stand_in_the_result(diagnosed, later, healthy):
    found, folder, _ = diagnosed
    content = json.loads(found.save(folder).read_text(encoding="utf-8"))
    figure = content["key_figures"]["left, 100 %"]["first_peak_L_per_min"]
    assert figure["measured"] == later[0].figures["first_peak_L_per_min"]
    assert figure["healthy"] == healthy[0].figures["first_peak_L_per_min"]
    assert figure["before"] == pytest.approx(figure["healthy"], rel=1e-5)
    assert figure["after"] == pytest.approx(figure["measured"], rel=0.01)
    page = write_report(found, folder).read_text(encoding="utf-8")
    assert "left, 100 %" in page and "2 healthy turns" in page
    assert summary(found)


def test_without_a_gap_nothing_is_closed(healthy):
    certain = network({hypotheses.NOTHING: 0.99, SPOOL: 0.01})
    found = diagnose_rows(healthy[:1], MACHINE, networks=[certain], calibrations=CALIBRATIONS)
    assert found.verdict == "no_gap" and found.mode == "day-one"
    assert found.shrinkage == () and found.where == () and found.controls == {}
    assert any("No healthy machine was measured" in text for text in found.limitations)
    assert conclusions(found).headline == "No cause shows in these figures"
    assert any("0 of 6 figures lie more than 2 of their standard deviations" in text for text in found.limitations)


def test_held_out_rows_are_tests(later, healthy, monkeypatch):
    """And those that are asked of are none; a figure that the machine file was made with proves something all the same where
    days are compared."""
    monkeypatch.setattr(tables_diagnosis, "SIZES", 1)
    found = diagnose_rows(
        later[:1], MACHINE, healthy=healthy, held_out=later[1:], networks=[SURE], calibrations=CALIBRATIONS
    )
    assert [(one.manoeuvre, one.held_out) for one in found.shrinkage] == [("left, 100 %", False), ("left, 75 %", True)]
    assert found.logs == ("left, 100 %",)
    assert found.key_figures["left, 75 %"]["first_peak_L_per_min"]["held_out"] is True


def test_what_only_a_table_says_of_a_machine_without_a_twin_is_said(healthy):
    """The published machine alone, at one level, asked of networks that say nothing certain: figures are compared with the
    twin's, and those that it was made with do not count where left out."""
    unsure = network({hypotheses.OUTSIDE: 0.9, SPOOL: 0.1})
    rows = read_rows(PUBLISHED, "physical")[:1]
    found = diagnose_rows(rows, MACHINE, networks=[unsure], calibrations=CALIBRATIONS)
    assert found.verdict == "unknown" and found.shrinkage == ()
    assert found.where and {place.component for place in found.where} == {""}
    assert any("made with these figures" in text for text in found.limitations)


def test_a_size_is_a_setting_of_the_twin():
    """A longer spool time by its own magnitude; what an effect cannot do, by as much as it can."""
    assert _setting("spool_lag", MACHINE, LAG)[0] == pytest.approx(LAG, rel=0.02)
    assert _setting("spool_lag", MACHINE, 10.0)[0] == EFFECTS["spool_lag"].magnitudes[0].high
    both = _setting("valve_gain", MACHINE, 0.0)
    assert len(both) == len(EFFECTS["valve_gain"].magnitudes)


def test_shrinkage_is_nil_of_what_changes_nothing_and_whole_of_what_is_right():
    gaps = np.array([3.0, -4.0, 5.0, 0.5])
    same = _gap_closure("turn", gaps, np.zeros((4, 3)), held_out=True)
    assert same.S == 0.0 and same.low90 == same.high90 == 0.0
    right = _gap_closure("turn", gaps, np.tile(gaps[:, None], 3), held_out=True)
    power = float(np.mean(gaps**2))
    # the variance that scatter would have had is taken off: 1 + 1 / (power − 1)
    assert pytest.approx(1.0 + 1.0 / (power - 1.0)) == right.S and right.after == 0.0
    assert right.before == pytest.approx(np.sqrt(power))


def test_a_black_box_carries_factors_from_level_to_level(healthy):
    """By the mean of the levels that it learns from."""
    higher = [
        Row(row.turn, {name: factor * value for name, value in row.figures.items() if "mean" not in name})
        for row, factor in zip(healthy, (1.1, 1.2), strict=True)
    ]
    turns = TwinTurns(higher, MACHINE, Simulator())
    gap = tables_diagnosis._Gap(paired(higher[:1], healthy), paired(higher[1:], healthy), turns, MACHINE)
    name = "steady_flow_L_per_min"
    found = gap._black_box(1, [1])[name][0] - gap.before[1][name]
    assert found == pytest.approx(0.1 * healthy[1].figures[name], rel=1e-3)


def test_what_cannot_be_asked_is_refused(healthy):
    with pytest.raises(ValueError, match="no row to fit"):
        diagnose_rows([], MACHINE)
    other = [Row(Turn("right", 100.0), {"turn_time_s": 2.2})]
    with pytest.raises(
        ValueError, match=r"no healthy row has a turn of right, 100 %; there are left, 100 %, left, 75 %"
    ):
        diagnose_rows(other, MACHINE, healthy=healthy)
