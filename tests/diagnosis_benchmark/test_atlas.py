"""The atlas: distances against closed forms, classes of signatures made alike or orthogonal, and what is frozen."""

import json
from itertools import combinations

import numpy as np
import pytest
from typer.testing import CliRunner

from aoro_gym.cli import app
from aoro_gym.diagnosis.axes import axes_of
from aoro_gym.diagnosis.problem import Problem
from aoro_gym.diagnosis_benchmark import atlas as atlas_module
from aoro_gym.diagnosis_benchmark.atlas import (
    ALL,
    MEMBERS,
    SEED,
    SOMETIMES,
    STRONG,
    WEAK,
    Atlas,
    Side,
    assembled,
    classes_of,
    commissioned,
    deviating,
    distances,
    grouped,
    looks,
    needed,
    part_of,
    weakest,
)
from aoro_gym.diagnosis_benchmark.atlas_report import write_atlas
from aoro_gym.diagnosis_benchmark.cases import FAMILIES, MACHINES, WEAKEST, Excitation
from aoro_gym.diagnosis_benchmark.scoring import CLASSES, read_classes
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.machine import Machine
from tests.diagnosis.synthetic import STD, linear_of, problem_of

COUNT = 200
"""Samples of a recording."""
NAMES = ("spool_lag", "seal_friction", "joint_friction", "payload")
"""Effects whose one axis begins at none."""
STRAIGHT = {name: EFFECTS[name] for name in NAMES}
SLOPES = np.sin(np.outer(np.arange(2 * COUNT), (0.011, 0.023)))


def healthy(directions: dict[str, np.ndarray]) -> Problem:
    """A machine without deviations, of which angle and pressure were logged; effects shift both in proportion to their
    places along ``directions`` (2, COUNT), in standard deviations of the noise."""
    flat = np.zeros(COUNT)
    problem = problem_of({"log": {"joint_angle": flat, "pressure_a": flat}})
    scale = np.repeat([STD["joint_angle"], STD["pressure_a"]], COUNT)
    problem.effects = {name: EFFECTS[name] for name in directions}
    problem.axes = {name: axes_of(effect) for name, effect in problem.effects.items()}
    for name, direction in directions.items():
        (axis,) = problem.axes[name]
        problem.shifts[name, 0] = np.outer(scale * direction.ravel(), axis.nodes)
    problem.given, problem.given_stops = np.zeros(2 * COUNT), [False]
    linear_of(problem, SLOPES * scale[:, None])
    return problem


def wave(number: int, size: float = 5.0) -> np.ndarray:
    """Direction (COUNT,) that is nearly orthogonal to those of other numbers and to what nuisances do."""
    return size * np.sin(0.15 * number * np.arange(COUNT) + number)


def test_distances_of_a_linear_problem_are_those_of_least_squares():
    rng = np.random.default_rng(0)
    problem = healthy({name: rng.normal(0.0, 3.0, (2, COUNT)) for name in NAMES[:3]} | {"payload": np.ones((2, COUNT))})
    (axis,) = problem.axes["spool_lag"]
    linear = deviating(problem, Side(axis, 1.0), 0.6)
    found = distances(part_of(linear, [0]))
    # least |s − S z − J u|² + uᵀ P u, with P = LLᵀ, of as many equations; places within their range
    target = linear.shifts["spool_lag", 0] @ axis.spline(0.6)
    root = np.linalg.cholesky(linear.tangent.precision).T
    for number, name in enumerate((None, *NAMES)):
        columns = linear.tangent.jacobian
        prior = root
        if name is not None:
            direction = linear.shifts[name, 0] @ problem.axes[name][0].spline(1.0)
            columns, prior = np.column_stack([columns, direction]), np.column_stack([root, np.zeros(len(root))])
        whole = np.vstack([columns, prior])
        solution, (square,), *_ = np.linalg.lstsq(whole, np.concatenate([target, np.zeros(len(root))]))
        if name is not None and not 0.0 <= solution[-1] <= 1.0:
            square = found[0]  # a deviation the other way is none of its: nothing is left
        # a search ends where a step gains less than 0.01
        assert found[number] == pytest.approx(square, abs=0.01)
    assert found[1] < 0.01 < found[0]


def test_the_weakest_stands_out_by_what_is_needed():
    """d² grows with the square of a share: k s² = 2 ln ODDS (T + ½ DOUBT k s²)."""
    problem = healthy({"spool_lag": np.stack([wave(3, 1.0), wave(4, 1.0)]), "payload": np.full((2, COUNT), 1e-3)})
    linear = part_of(linear_of(problem, problem.slopes), [0])
    side, small = (Side(problem.axes[name][0], 1.0) for name in problem.axes)
    shift = linear.shifts["spool_lag", 0] @ side.weights(1.0)
    whole = float(linear.tangent.projected(shift, shift))
    share = weakest(linear, side)
    log_odds = 2.0 * np.log(atlas_module.ODDS)
    trust = atlas_module.TRUST
    exact = np.sqrt(log_odds * trust.temperature / (1.0 - 0.5 * log_odds * trust.doubt) / whole)
    step = WEAKEST ** (-1.0 / (atlas_module.SHARES - 1))
    assert WEAKEST < exact <= share <= exact * step
    assert weakest(linear, small) == np.inf


def test_equal_signatures_make_a_class_and_orthogonal_ones_do_not():
    """Two that are the same in the angle, and different in the pressure; one that is like none; one that does nothing."""
    problem = healthy(
        {
            "spool_lag": np.stack([wave(3), wave(5)]),
            "seal_friction": np.stack([0.8 * wave(3), wave(7)]),
            "joint_friction": np.stack([wave(4), wave(6)]),
            "payload": np.zeros((2, COUNT)),
        }
    )
    found = assembled(["made up"], STRAIGHT, [looks(problem)])
    assert found.classes("angle") == [["spool_lag", "seal_friction"]]
    assert found.classes("full") == []
    assert found.seen("full") == found.seen("angle") == NAMES[:3]
    apart = found.apart("angle")
    assert apart[0, 1] == pytest.approx(0.0, abs=1e-3) and apart[0, 2] > 3.0 < apart[1, 2]
    assert np.all(np.isnan(apart[3])) and np.all(np.isnan(apart[:, 3]))
    assert found.best("full", "spool_lag", "seal_friction")[0] == "log"
    assert found.apart("angle", WEAK)[0, 1] == pytest.approx(0.0, abs=1e-3)
    # at the ends of the ranges the other falls short by a fifth, of a shift whose square is left
    outstanding = found.views["angle"].distances[STRONG][0, 0]
    left = 0.2**2 * outstanding / needed(outstanding)
    assert found.towards("angle", STRONG)[:2, :2] == pytest.approx(np.array([[0.0, left], [0.0, 0.0]]), abs=1e-3)


def test_classes_hold_no_two_that_can_be_told_apart():
    """Of a chain a–b–c whose ends are apart, the nearer two make a class; the other stays by itself."""
    chain = np.array([[0.0, 0.5, 1.4, 9.0], [0.5, 0.0, 0.7, 9.0], [1.4, 0.7, 0.0, 9.0], [9.0, 9.0, 9.0, 0.0]])
    assert grouped("abcd", chain) == [["a", "b"]]
    assert grouped("abcd", np.minimum(chain, 0.9)) == [["a", "b", "c", "d"]]
    assert grouped("ab", np.array([[0.0, 1.0], [1.0, 0.0]])) == []
    assert grouped("a", np.zeros((1, 1))) == grouped("", np.zeros((0, 0))) == []


def test_a_pair_is_alike_if_each_explains_the_other_whichever_way_it_deviates():
    """Stiffer oil is like stiffer hoses, but softer hoses are like nothing."""
    names = ("oil_bulk_modulus", "hose_compliance")
    effects = {name: EFFECTS[name] for name in names}
    d2 = np.array([[400.0, 0.0, 5.0], [400.0, 0.0, 5.0], [400.0, 200.0, 0.0], [400.0, 5.0, 0.0]])
    found = assembled(["made up"], effects, [dict.fromkeys(("angle", "full"), (np.full(4, 0.5), {ALL: d2}))])
    assert found.views["full"].sides == tuple(f"{name} {sign}" for name in names for sign in "-+")
    need = float(needed(400.0))
    np.testing.assert_allclose(found.towards("full"), [[0.0, 5.0 / need], [200.0 / need, 0.0]])
    np.testing.assert_allclose(found.apart("full"), [[0.0, 200.0 / need], [200.0 / need, 0.0]])
    assert found.classes("full") == []
    alike = np.minimum(d2, np.where(np.arange(3) > 0, 5.0, np.inf))
    both = assembled(["a", "b", "c"], effects, [
        dict.fromkeys(("angle", "full"), (np.full(4, 0.5), {ALL: one})) for one in (alike, d2, alike)
    ])  # fmt: skip
    assert both.classes("full") == [list(names)], "in most of three machines"


@pytest.fixture(scope="module")
def pulse():
    """Of a short pulse of the twin itself."""
    names = ("sensor_delay", "command_delay", "engine_droop", "joint_friction")
    steering = 0.6 * np.repeat([0.0, 1.0, 0.0], (70, 40, 80))
    problem = commissioned(
        Machine.load(MACHINES / "ensemble" / "01.toml"), [Excitation("pulse", 0.0, steering)],
        {name: EFFECTS[name] for name in names},
    )  # fmt: skip
    return assembled(["01"], problem.effects, [looks(problem)])


def test_late_commands_look_like_a_late_angle_where_no_pressure_tells(pulse):
    """A machine at rest that is told later does all the same later; only its pressures say that the angle is not late."""
    assert pulse.classes("angle") == [["sensor_delay", "command_delay"]]
    assert pulse.classes("full") == []
    assert "engine_droop" not in pulse.seen("full")
    assert pulse.apart("angle")[0, 1] < 0.1 and pulse.apart("full")[0, 1] > 1.0
    diagonal = np.diag(pulse.apart("full"))
    assert np.nanmax(diagonal) < 0.01, "an effect explains itself"


def test_what_is_written_is_read_again(pulse, tmp_path):
    paths = write_atlas(pulse, tmp_path)
    assert [path.name for path in paths] == ["atlas.json", "classes.json", "atlas.png"]
    again = Atlas.from_dict(json.loads(paths[0].read_text(encoding="utf-8")))
    assert again.effects == pulse.effects and again.members == ("01",)
    for sensors in ("angle", "full"):
        np.testing.assert_allclose(again.apart(sensors), pulse.apart(sensors), rtol=0.02, atol=1e-4)
        assert read_classes(sensors, paths[1]) == tuple(map(frozenset, pulse.classes(sensors)))
    assert paths[2].stat().st_size > 10_000


def test_the_command_writes_it(pulse, tmp_path, monkeypatch):
    monkeypatch.setattr(atlas_module, "survey", lambda **arguments: pulse)
    done = CliRunner().invoke(app, ["blind", "atlas", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert "sensor_delay = command_delay" in done.output
    assert (tmp_path / "atlas.png").is_file()
    refused = CliRunner().invoke(app, ["blind", "atlas", "--out", str(tmp_path / "atlas.json")])
    assert refused.exit_code == 2 and "is a file" in refused.output


def test_machines_and_manoeuvres_are_those_of_development():
    assert not set(MEMBERS) & set(FAMILIES["score"].members)
    names = [excitation.name for excitation in FAMILIES["development"].excitations(np.random.default_rng(SEED))]
    assert len(names) == 10 and names[-1:] == list(SOMETIMES)


# ---- what is frozen ----

FROZEN = json.loads(CLASSES.read_text(encoding="utf-8"))
SHIPPED = json.loads(CLASSES.with_name("atlas.json").read_text(encoding="utf-8"))


def test_the_frozen_classes_follow_from_the_frozen_atlas():
    classes = classes_of(Atlas.from_dict(SHIPPED))
    for sensors in SHIPPED["sensors"]:
        assert FROZEN[sensors] == classes[sensors]
    assert {key: FROZEN[key] for key in SHIPPED if key in FROZEN} == {
        key: SHIPPED[key] for key in SHIPPED if key in FROZEN
    }, "made in one run"
    assert SHIPPED["effects"] == list(EFFECTS)


@pytest.mark.parametrize("sensors", ["angle", "full"])
def test_all_of_a_frozen_class_are_alike_by_the_rule_that_it_states(sensors):
    view = SHIPPED["sensors"][sensors]
    odds, temperature, doubt = (FROZEN[key] for key in ("odds", "temperature", "doubt"))
    classes = read_classes(sensors)
    assert sum(map(len, classes)) == len(frozenset().union(*classes)), "classes have nothing in common"
    for a, b in (pair for group in classes for pair in combinations(sorted(group), 2)):
        for true, other in ((a, b), (b, a)):
            rows = [row for side, row in zip(view["sides"], view["d2"][ALL], strict=True) if side["effect"] == true]
            stood_out = [row for row in rows if row[0] is not None]
            assert stood_out
            for row in stood_out:
                distance, outstanding = row[1 + SHIPPED["effects"].index(other)], row[0]
                assert distance < 2.0 * np.log(odds) * (temperature + doubt * outstanding / 2.0) < outstanding
