"""Days that are drawn: nothing wrong on the first, what is said to be wrong on the others, and nothing else."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from aoro_gym.diagnosis.simulation import outsiders
from aoro_gym.diagnosis.simulation.days import (
    CHAIN,
    HEALTHY,
    Days,
    another_day,
    bases,
    deviating,
    draw_days,
    draw_magnitudes,
    free_parameters,
)
from aoro_gym.diagnosis.simulation.prior import KINDS, Prior
from aoro_gym.effects.catalogue import EFFECTS, IDS

LATER = 4
PRIOR = replace(Prior(), spreads=(0.5,))


@pytest.fixture(scope="module")
def days() -> Days:
    return draw_days(PRIOR, 60, LATER, seed=5)


@pytest.mark.slow
def test_a_seed_gives_the_same_days_and_another_seed_others(days: Days) -> None:
    again, other = draw_days(PRIOR, 60, LATER, seed=5), draw_days(PRIOR, 60, LATER, seed=6)
    for field in fields(Days):
        np.testing.assert_array_equal(getattr(days, field.name), getattr(again, field.name))
    assert not np.array_equal(days.records, other.records)


def test_nothing_is_wrong_on_the_first_days(days: Days) -> None:
    first = np.arange(len(days.kind)) % (HEALTHY + LATER) < HEALTHY
    assert np.all(days.kind[first] == KINDS.index("none"))
    assert {KINDS[kind] for kind in days.kind[~first]} == set(KINDS)


def test_kinds_say_how_many_effects_there_are(days: Days) -> None:
    outside = days.kind == KINDS.index("outside")
    np.testing.assert_array_equal(days.outsider >= 0, outside)
    np.testing.assert_array_equal((days.effects >= 0).sum(axis=1), np.where(outside, 0, days.kind))
    assert np.all(days.effects[days.kind == 1, 0] >= 0)
    both = days.effects[days.kind == 2]
    assert np.all(both[:, 0] != both[:, 1])


def test_every_effect_changes_what_it_is_measured_by(days: Days) -> None:
    there = days.effects >= 0
    assert np.all(days.change[there] != 0.0)
    assert np.all(days.change[~there] == 0.0)
    assert np.all((days.severity[there] > 0.0) & (days.severity[there] <= PRIOR.strongest))


def test_days_of_a_machine_differ_by_little_while_nothing_is_wrong() -> None:
    """With nothing from day to day and no effect, all days of a machine are one; else its parts stay as they are."""
    still = replace(PRIOR, day=0.0, day_shares={}, temperature=0.0, slope=0.0, load=0.0, weights=(1.0, 0.0, 0.0, 0.0))
    same = draw_days(replace(still, day_factor=(1e-12, 1.1e-12)), 8, 2, seed=1)
    each = HEALTHY + 2
    records = same.records.reshape(8, each)
    as_numbers = records.view(np.float32).reshape(8, each, -1)
    np.testing.assert_allclose(as_numbers[:, 1:], as_numbers[:, :1].repeat(each - 1, axis=1), rtol=1e-6)
    assert not np.allclose(as_numbers[0], as_numbers[1], rtol=1e-3)


def test_parts_of_a_machine_change_from_day_to_day_by_scales_of_their_own() -> None:
    """One key of each machine moves on all days by that machine's own scale."""
    key = "joint.friction_torque"
    alone = replace(
        PRIOR, day=0.0, day_shares={key: 0.02}, temperature=0.0, slope=0.0, load=0.0, weights=(1.0, 0.0, 0.0, 0.0),
        day_factor=(1.0, 1.0 + 1e-12),
    )  # fmt: skip
    machine, days = bases()[0].variants(np.zeros(40, dtype=int)), 200
    scales = np.exp(np.random.default_rng(1).uniform(*np.log(alone.share_factor), size=40))
    each = np.repeat(np.arange(40), days)
    some = another_day(
        alone,
        machine.variants(each),
        np.ones(40 * days),
        np.random.default_rng(2),
        np.repeat(scales[None], days, axis=1),
    )
    moved = np.log(some.entries[key].value / float(machine.entries[key].value)).reshape(40, days)
    # a standard deviation of 200 days is known within 5 %, and the cut at 2.5 takes 2 % off it
    np.testing.assert_allclose(moved.std(axis=1), 0.02 * 0.98 * scales, rtol=0.2)


def test_days_are_drawn_by_scales_of_their_own() -> None:
    """Air moves by its share alone: five times the factor, five times the change on every day."""
    alone = replace(
        PRIOR, day_shares={"oil.gas_fraction": 0.02}, temperature=0.0, load=0.0, weights=(1.0, 0.0, 0.0, 0.0)
    )
    changes = []
    for least in (0.5, 2.5):
        days = draw_days(replace(alone, share_factor=(least, least * (1.0 + 1e-12))), 30, 4, seed=3)
        air = days.records["oil"]["gas_fraction"].reshape(30, -1)
        air = np.log(air[air[:, 0] > 0.0])  # some laws know no air
        changes.append(air[:, 1:] - air[:, :1])
    assert np.ptp(changes[0]) > 0.01
    np.testing.assert_allclose(changes[1], 5.0 * changes[0], rtol=1e-3, atol=1e-5)  # records are of single precision


def test_an_effect_that_a_law_knows_nothing_of_is_no_cause() -> None:
    """A static compensator is never late."""
    days = draw_days(replace(PRIOR, weights=(0.0, 1.0, 0.0, 0.0)), 300, 1, seed=2)
    late = np.any(days.effects == IDS.index("compensator_lag"), axis=1)
    static = days.records["steering"]["compensator_law"] == bases()[0].with_laws(compensator="static").laws.compensator
    assert late.any()
    assert not np.any(late & static)


@pytest.mark.parametrize("effect_id", IDS)
def test_magnitudes_stay_in_their_ranges_on_both_sides(effect_id: str) -> None:
    effect = EFFECTS[effect_id]
    drawn, severity = draw_magnitudes(effect, 400, (0.1, 1.0), np.random.default_rng(3))
    for one, values in zip(effect.magnitudes, drawn, strict=True):
        slack = 1e-9 * max(abs(one.low), abs(one.high))
        assert np.all((values >= one.low - slack) & (values <= one.high + slack))
        if one.low < one.none < one.high:
            assert (values < one.none).any() and (values > one.none).any()
    assert severity.min() >= 0.1 and severity.max() <= 1.0


def test_the_measuring_chain_is_given_where_signals_are_sampled(days: Days) -> None:
    for place, name in enumerate(CHAIN):
        has = np.any(days.effects == IDS.index(name), axis=1)
        np.testing.assert_array_equal(days.chain[:, place] != 0.0, has)


def test_outsiders_are_no_effects_of_the_catalogue() -> None:
    """Each moves a parameter of the machine by a factor that is not one, or bends the command within its bounds."""
    machine = bases()[0]
    for factors in outsiders.MACHINE.values():
        assert all(key in machine.entries for key in factors)
        assert all(not low <= 1.0 <= high for low, high in factors.values())
    command = np.concatenate([np.zeros(50), np.full(120, 1.0), np.zeros(80), np.full(100, -0.5), np.zeros(150)])
    for name, deviates in outsiders.COMMAND.items():
        got = deviates(command, np.random.default_rng(4))
        assert got.shape == command.shape and np.all(np.abs(got) <= 1.0), name
        assert not np.array_equal(got, command), name


def test_any_parameters_moves_a_few_that_no_effect_moves() -> None:
    machine = bases()[0].sample(40, laws="any", parameters=0.4, seed=1)
    moved = deviating(machine, "any_parameters", np.random.default_rng(2))
    ratio = np.array([np.log(moved.entries[key].value / machine.entries[key].value) for key in free_parameters()])
    changed = np.abs(ratio) > 1e-9
    assert np.all((changed.sum(axis=0) >= 1) & (changed.sum(axis=0) <= outsiders.MOST_FREE))
    assert np.abs(ratio).max() <= np.log(outsiders.FREE_FACTOR[1]) + 1e-9 and changed.any(axis=1).mean() > 0.5
    others = [key for key in machine.entries if key not in free_parameters()]
    for key in others:
        np.testing.assert_array_equal(moved.entries[key].value, machine.entries[key].value)


def test_another_machine_is_another_one_in_all_its_parameters() -> None:
    machine = bases()[0].sample(5, laws="any", parameters=0.4, seed=1)
    other = deviating(machine, "another_machine", np.random.default_rng(2))
    for key in ("frame.rear.mass", "steering.pump.margin", "oil.bulk_modulus"):
        own, got = machine.entries[key].value, other.entries[key].value
        np.testing.assert_array_equal(np.sort(got), np.sort(own))
        assert np.all(got != own)


def test_broad_kinds_are_drawn_more_often() -> None:
    assert outsiders.SHARES.sum() == pytest.approx(1.0) and len(outsiders.SHARES) == len(outsiders.ALL)
    assert set(outsiders.BROAD) <= set(outsiders.ALL) and len(set(outsiders.ALL)) == len(outsiders.ALL)
