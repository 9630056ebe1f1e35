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


def test_healthy_days_scatter_by_one() -> None:
    found = reference("pressures")
    # 144 pairs of 24 machines: a variance of 24 × 3 free differences scatters by √(2/72)
    assert np.mean(found.days**2) == pytest.approx(1.0, abs=4 * np.sqrt(2 / 72))


@pytest.mark.parametrize("times", [0.7, 1.0, 1.6])
def test_a_change_of_some_thresholds_has_the_power_of_a_normal_distribution(times: float) -> None:
    found = reference("pressures")
    unit = found.axes @ signature("one")
    unit /= np.linalg.norm(unit)
    limit = found.limit(unit)
    std = float(np.sqrt(unit @ found.noise @ unit))
    change = np.linalg.solve(found.axes, times * limit * unit)
    verdict = judge(found, change, ["one"])
    assert verdict.power == pytest.approx(power(times * limit, limit, std))
    assert verdict.detectable == (times > 1.5)
    if times == 1.0:
        assert verdict.power == pytest.approx(0.5, abs=1e-6)


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
