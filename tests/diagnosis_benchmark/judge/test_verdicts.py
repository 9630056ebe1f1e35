"""Verdicts on plants by hand, whose changes are known."""

from functools import cache

import numpy as np
import pytest

from aoro_gym.diagnosis_benchmark.judge.library import Extent, Library, build
from aoro_gym.diagnosis_benchmark.judge.statistics import power
from aoro_gym.diagnosis_benchmark.judge.suite import pool
from aoro_gym.diagnosis_benchmark.judge.verdicts import Reference, judge, validate
from tests.diagnosis_benchmark.judge.families import Made

MANOEUVRES = ("steps_1", "pulse_1")


@cache
def libraries() -> tuple[Library, ...]:
    excitations = list(pool(np.random.default_rng(0), 1, MANOEUVRES).values())
    return tuple(
        build(Made(f"law_{law}", law), excitations, Extent(12, 4, 2, (0.0, 0.5, 1.0)), seed=1)
        for law in (-0.1, 0.0, 0.1)
    )


@cache
def reference(channel_set: str) -> Reference:
    return Reference.of(libraries()[1:], MANOEUVRES, channel_set)


def signature(effect: str, size: int = 2) -> np.ndarray:
    library = libraries()[0]
    row = library.paths.index((effect, 0))
    return library.signatures(MANOEUVRES, reference("pressures").channels)[row, size, 0]


def test_healthy_days_of_another_family_scatter_by_one() -> None:
    days = libraries()[0].day_pairs(MANOEUVRES, reference("pressures").channels) @ reference("pressures").axes.T
    # 12 machines × 3 free differences, in a metric that 24 × 3 gave: √(2/36 + 2/72) each; features are many but alike
    assert np.mean(days**2) == pytest.approx(1.0, abs=4 * np.sqrt(2 / 36 + 2 / 72))


@pytest.mark.parametrize("times", [0.7, 1.0, 1.6])
def test_a_change_of_some_thresholds_has_the_power_of_a_normal_distribution(times: float) -> None:
    found = reference("pressures")
    shape = signature("one")
    unit = found.axes @ shape / np.linalg.norm(found.axes @ shape)
    limit = found.limit(shape)
    std = float(np.sqrt(unit @ found.noise @ unit))
    change = times * limit * shape / np.linalg.norm(found.axes @ shape)
    verdict = judge(found, change, ["one"])
    assert verdict.power == pytest.approx(power(times * limit, limit, std))
    assert verdict.detectable == (times > 1.5)
    if times == 1.0:
        assert verdict.power == pytest.approx(0.5, abs=1e-6)


def test_healthy_days_of_another_family_exceed_the_threshold_as_often_as_they_may() -> None:
    alarms = [
        np.mean(reference.largest(left.day_pairs(MANOEUVRES, reference.channels)) > reference.limit(level=0.9))
        for left in libraries()
        for reference in [Reference.of([one for one in libraries() if one is not left], MANOEUVRES, "pressures")]
    ]
    # 36 machines, whose pairs of days go together
    assert np.mean(alarms) == pytest.approx(0.1, abs=4 * np.sqrt(0.1 * 0.9 / 36))


def test_the_oracle_explains_by_the_own_family_alone() -> None:
    found = Reference.of(libraries()[1:], MANOEUVRES, "pressures", own=libraries()[0])
    assert judge(found, signature("one"), ["one"]).best == "one"
    assert set(found.paths.group) == {0, 1}
    assert found.limit() == reference("pressures").limit()


def test_an_effect_of_its_own_is_isolable_and_two_alike_are_one_class() -> None:
    found = reference("pressures")
    one, two = judge(found, signature("one"), ["one"]), judge(found, signature("two"), ["two"])
    assert one.detectable
    assert one.isolable
    assert one.best == "one"
    assert two.detectable
    assert set(two.alike) == {"two", "twin"}


def test_what_no_channel_of_the_set_shows_is_not_detectable() -> None:
    found = reference("angle")
    row = libraries()[0].paths.index(("two", 0))
    change = libraries()[0].signatures(MANOEUVRES, found.channels)[row, 2, 0]
    assert not judge(found, change, ["two"]).detectable


def test_each_of_two_effects_has_its_own_power() -> None:
    found = reference("pressures")
    large, small = signature("one"), 1e-3 * signature("two")
    verdict = judge(found, large + small, ["one", "two"], [small, large])
    assert verdict.detectable
    assert verdict.each is not None
    assert verdict.each["one"] > 0.99
    assert verdict.each["two"] < 0.1


def test_validation_leaves_each_family_out() -> None:
    table = validate(libraries(), MANOEUVRES, "pressures")
    assert list(table) == [one.family for one in libraries()]
    for row in table.values():
        assert row["healthy"] == 12 * 6
        assert row["effects"] == 4 * 3 * 2
        # two and twin are the same to the bit: the first is best of both
        assert 0 < row["best"] <= row["detectable"]
        assert 0 < row["isolable"] < row["detectable"]
        assert row["false_alarms"] <= 0.15 * row["healthy"]


def test_a_library_is_read_as_it_was_written(tmp_path) -> None:
    library = libraries()[0]
    library.save(tmp_path / "law.npz")
    found = Library.load(tmp_path / "law.npz")
    assert found.paths == library.paths
    assert found.family == library.family
    for name in MANOEUVRES:
        np.testing.assert_array_equal(found.effects[name], library.effects[name])
        np.testing.assert_array_equal(found.days[name].values, library.days[name].values)
        np.testing.assert_array_equal(found.exact[name].share, library.exact[name].share)
