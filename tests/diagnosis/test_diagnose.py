"""From logs to a diagnosis: a cause that the twin itself was given, what it writes, and what is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm
from typer.testing import CliRunner

from aoro_gym.cli import app
from aoro_gym.diagnosis.attribution import TRUST
from aoro_gym.diagnosis.diagnose import ERROR, STAGES, _commissioned, _common, _noise, diagnose
from aoro_gym.diagnosis.findings import declared_of, verdict_of
from aoro_gym.diagnosis.linear import Hypothesis, Linear
from aoro_gym.diagnosis.nuisances import Nuisances
from aoro_gym.diagnosis.recording import TICK
from aoro_gym.diagnosis.replay import Simulator, Variants
from aoro_gym.diagnosis.result import CALIBRATION, UNKNOWN, VERDICTS
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.execution.files import LOCK
from aoro_gym.machine import Machine
from aoro_gym.simulation.log import write_log
from tests.diagnosis.manoeuvres import FULL, blank, record, turn

CANDIDATES = {name: EFFECTS[name] for name in ("spool_lag", "joint_friction", "sensor_gain")}
LAG = 0.03


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory):
    """A slow spool in two turns, with the same turns of the healthy machine; and where the result was written."""
    rng = np.random.default_rng(5)
    machine = Machine.load("aoro")
    blanks = [blank("left", turn(0.8, 2.2), -0.3), blank("right", turn(-0.6, 2.0), 0.3)]
    healthy = record(Variants(machine), blanks, rng)
    later = record(Variants.of(machine, [(EFFECTS["spool_lag"], (LAG,))], 1), blanks, rng)
    folder = tmp_path_factory.mktemp("diagnosis")
    return diagnose(later, machine, CANDIDATES, healthy=healthy, out=folder), folder


@pytest.mark.slow
def test_the_cause_its_size_and_its_machine_are_given(diagnosed):
    found, folder = diagnosed
    first = found.causes[0]
    said = [(c.title, c.probability) for c in found.causes]
    assert first.effects == ("spool_lag",), said
    assert sum(c.probability for c in found.causes if "spool_lag" in c.effects) > 0.9, said
    (size,) = first.magnitudes["spool_lag"]
    assert size.low90 < LAG < size.high90
    assert size.median == pytest.approx(LAG, rel=0.1)
    # two turns say more than what other laws may make of the size; a quantile of so many draws is 0.015 off or less
    assert np.log(size.high90 / size.low90) == pytest.approx(2.0 * norm.ppf(0.95) * TRUST["pressure"].laws, rel=0.1)
    assert next(iter(found.components)) == "valve"
    machine, affected = Machine.load("aoro"), Machine.load(str(folder / first.machine_file))
    longer = affected.steering.valve.spool_time_constant - machine.steering.valve.spool_time_constant
    assert longer == pytest.approx(LAG, rel=0.1)


@pytest.mark.slow
def test_the_verdict_is_a_cause(diagnosed):
    found, _ = diagnosed
    assert found.verdict == "cause" and found.causes[0].effects == ("spool_lag",), found.causes[0].probability


@pytest.mark.slow
def test_the_gap_is_gone_on_manoeuvres_left_out(diagnosed):
    """Of the fit of its size: with the right law nothing but noise may stay."""
    found, _ = diagnosed
    left_out = [one for one in found.shrinkage if one.held_out and not one.refitted]
    assert {one.manoeuvre for one in left_out} == {"left", "right"}
    assert found.controls["cause"] == pytest.approx(np.median([one.S for one in left_out]))
    assert found.controls["cause"] > 0.9
    assert found.where and found.where_p < 1e-6
    assert sum(place.share for place in found.where) == pytest.approx(1.0)


@pytest.mark.slow
def test_the_part_of_the_cause_contradicts_its_boundary(diagnosed):
    found, _ = diagnosed
    assert found.boundaries[0].part == "circuit" and found.boundaries[0].contradicts
    assert not any(one.contradicts for one in found.boundaries if one.part == "mechanics")
    assert {place.component for place in found.where} == {"valve"}


@pytest.mark.slow
def test_what_is_written_can_be_read(diagnosed, tmp_path):
    found, _ = diagnosed
    content = json.loads(found.save(tmp_path).read_text(encoding="utf-8"))
    assert content["verdict"] in VERDICTS
    assert sum(cause["probability"] for cause in content["causes"]) == pytest.approx(1.0, abs=0.05)
    assert content["causes"][0]["magnitudes"]["spool_lag"]["unit"] == "s"
    assert content["declared_set"][0] == "spool_lag"
    assert [one["part"] for one in content["boundaries"]] == [one.part for one in found.boundaries]


def test_only_signals_that_all_logs_have_are_compared():
    whole, angle = blank("whole", turn(0.8, 2.2), 0.0), blank("angle", turn(0.8, 2.2), 0.0)
    angle = replace(angle, channels={"joint_angle": angle.channels["joint_angle"]})
    assert _common([whole, whole]) == tuple(whole.channels)
    assert _common([whole, angle]) == ("joint_angle",)


@pytest.mark.slow
def test_healthy_logs_tell_what_data_sheets_leave_out():
    """Air in the oil and tires that stand on patches: what the fit finds lies within four standard deviations of what it
    leaves open, which is a small part of what was open before."""
    truth = {"oil.gas_fraction": 0.002, "tire.scrub_radius": 0.05}
    machine = Machine.load("aoro")
    blanks = [blank("left", turn(0.8, 2.2), -0.3), blank("right", turn(-0.6, 2.0), 0.3)]
    healthy = record(Variants(machine.set(truth)), blanks, np.random.default_rng(3))
    of = {"error": ERROR, "noise": _noise(healthy, FULL), "simulator": Simulator()}
    twin, uncertain, _ = _commissioned(healthy, machine, of, lambda sentence, share: None)
    before, after = Nuisances(machine.with_default_priors(), "commissioning"), Nuisances(twin, "day", uncertain)
    assert before.keys == after.keys
    for key, value in truth.items():
        k = after.keys.index(key)
        missed = abs(twin.entries[key].value - value) / np.diff(twin.entries[key].range).item()
        assert missed < 4.0 * after.std[k], key
        assert after.std[k] < 0.5 * before.std[k], key


def test_the_healthy_fit_goes_on_from_where_a_population_came_to(monkeypatch):
    """Slopes alone would end in the valley that is next to the given machine."""
    points, begun = [], []

    def evolve(populations, **_):
        (population,) = populations
        points.append(np.full(len(population.best[0]), 0.1))
        population.best = points[0], population.best[1]

    def settle(problem, stages, progress):
        begun.append(problem.centre)
        return Linear(problem, problem.error, effects=False).tangent

    monkeypatch.setattr("aoro_gym.diagnosis.diagnose.evolve", evolve)
    monkeypatch.setattr("aoro_gym.diagnosis.diagnose.settle", settle)
    machine = Machine.load("aoro")
    healthy = record(Variants(machine), [blank("left", turn(0.8, 1.6), -0.3)], np.random.default_rng(3))
    noise = _noise(healthy, _common(healthy))
    _commissioned(
        healthy, machine, {"error": ERROR, "noise": noise, "simulator": Simulator()}, lambda sentence, share: None
    )
    assert all(np.array_equal(centre, points[0]) for centre in begun) and len(begun) == STAGES


def of(*pairs: tuple[tuple[str, ...], float]) -> list[Hypothesis]:
    found = [Hypothesis(effects, 0.0, probability=probability) for effects, probability in pairs]
    return sorted(found, key=lambda h: -h.probability)


@pytest.mark.parametrize(
    ("hypotheses", "verdict", "declared"),
    [
        (of(((), 0.97), (("payload",), 0.03)), "no_gap", ()),
        (of(((), 0.2), ((CALIBRATION,), 0.8)), "calibration", (CALIBRATION,)),
        (of((("payload",), 0.96), ((), 0.04)), "cause", ("payload",)),
        (of((("payload",), 0.6), (("spool_lag",), 0.4)), "ambiguous", ("payload", "spool_lag")),
        (
            of((("payload",), 0.7), (("payload", "spool_lag"), 0.2), (("spool_lag",), 0.1)),
            "cause",
            ("payload", "spool_lag"),
        ),
        (of((("payload", "spool_lag"), 0.7), (("payload",), 0.3)), "ambiguous", ("payload", "spool_lag")),
        (
            of(((), 0.08), *(((f"effect {k}",), 0.04) for k in range(23))),
            "ambiguous",
            [f"effect {k}" for k in range(22)],
        ),
        (of(((UNKNOWN,), 0.99), (("payload",), 0.01)), "unknown", (UNKNOWN,)),
        (of((("payload",), 0.7), ((), 0.3)), "inconclusive", ("payload",)),
        (of((("payload",), 0.6), ((), 0.15), (("spool_lag",), 0.25)), "ambiguous", ("payload", "spool_lag")),
    ],
)
def test_verdicts_follow_from_probabilities(hypotheses, verdict, declared):
    assert verdict_of(hypotheses) == verdict
    assert set(declared_of(hypotheses, 0.95)) == set(declared)


def test_a_log_of_radians_named_degrees_gives_no_cause(tmp_path):
    """What is wrong is said on the page, and in a word: it cannot tell."""
    (turned,) = record(Variants(Machine.load("aoro")), [blank("left", turn(0.8, 2.2), -0.3)], np.random.default_rng(6))
    log = tmp_path / "radians.csv"
    write_log(
        log,
        {
            "time_s": TICK * np.arange(turned.ticks + 1),
            "steering_signal": np.append(turned.commands[:, 0], 0.0),
            "joint_angle_deg": turned.channels["joint_angle"],
        },
    )
    result = CliRunner().invoke(app, ["diagnose", str(log), "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    content = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert content["verdict"] == "inconclusive" and content["causes"] == []
    assert "radians or degrees" in content["limitations"][0]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [LOCK, "diagnosis.json", "report.html"]
    assert "radians or degrees" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
