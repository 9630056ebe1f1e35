"""Nuisances: spreads in closed form, and machines within their ranges."""

import numpy as np
import pytest

from aoro_gym.calibration.space import LOG_SPAN
from aoro_gym.diagnosis.nuisances import NORMAL95, SPREADS, Nuisances
from aoro_gym.machine import Machine

MACHINE = Machine.load("aoro")


def half_widths(entry, share: float) -> float:
    """Of ``share`` of an entry's range to either side, cut off at its ends, in the unit cube; the wider side."""
    low, high = entry.range
    value, half = float(entry.value), share * (high - low)
    ends = np.clip([value - half, value + half], low, high)
    if low > 0.0 and high > LOG_SPAN * low:
        ends, value, low, high = np.log(ends), np.log(value), np.log(low), np.log(high)
    return float(np.max(np.abs(ends - value)) / (high - low))


@pytest.mark.parametrize("spread", SPREADS)
def test_standard_deviations_are_shares_of_the_ranges(spread):
    nuisances = Nuisances(MACHINE, spread)
    entries = [MACHINE.entries[key] for key in nuisances.keys]
    assert {entry.role for entry in entries} == {"nuisance", "both"}
    assert len(entries) == sum(entry.role in ("nuisance", "both") for entry in MACHINE.entries.values())
    for entry, std in zip(entries, nuisances.std, strict=True):
        if spread != "day" or entry.role == "nuisance":
            assert std == pytest.approx(half_widths(entry, SPREADS[spread]) / NORMAL95, rel=1e-9), entry.key


def test_in_the_middle_of_a_linear_range_it_is_the_share_itself():
    entry = next(
        e for e in MACHINE.entries.values() if e.role == "nuisance" and e.range[0] > 0.0 and e.range[1] < 2 * e.range[0]
    )
    machine = MACHINE.set({entry.key: float(np.mean(entry.range))})
    for spread, share in SPREADS.items():
        nuisances = Nuisances(machine, spread)
        assert nuisances.std[nuisances.keys.index(entry.key)] == pytest.approx(share / NORMAL95, rel=1e-9)


def test_on_another_day_what_effects_move_stays_as_commissioned():
    """What holds 95 % of them ends at the bounds of ``commissioned``."""
    nuisances = Nuisances(MACHINE, "day")
    both = [key for key in nuisances.keys if MACHINE.entries[key].role == "both"]
    assert both
    for side in (-1.0, 1.0):
        moved = nuisances.machines(np.full((1, len(nuisances.keys)), side * NORMAL95)).entries
        for key in both:
            entry = MACHINE.entries[key]
            low, high = (float(end) for end in entry.commissioned)
            if low == high:
                assert float(moved[key].value) == pytest.approx(float(entry.value), abs=1e-5 * np.ptp(entry.range)), key
                continue
            # on a logarithmic scale 2 % upwards is a step shorter than 2 % downwards, which counts for both: 1/0.98
            slack = 1e-6 + 0.02**2 / (1.0 - 0.02)
            value = float(moved[key].value)
            assert low - slack * abs(low) <= value <= high + slack * abs(high), key
            if min(entry.range) < low and high < max(entry.range):
                assert value == pytest.approx(low if side < 0.0 else high, rel=slack), key


@pytest.mark.parametrize("spread", SPREADS)
def test_steps_stay_within_the_ranges(spread):
    """Half a standard deviation, or a fiftieth of the range where that is less; downwards where there is no room above."""
    nuisances = Nuisances(MACHINE, spread)
    np.testing.assert_allclose(np.abs(nuisances.steps), np.minimum(0.5, 0.02 / nuisances.std))
    reached = nuisances.place + nuisances.steps * nuisances.std
    assert np.all((reached >= 0.0) & (reached <= 1.0))
    above = nuisances.place + np.abs(nuisances.steps) * nuisances.std <= 1.0
    np.testing.assert_array_equal(nuisances.steps > 0.0, above)


def test_the_centre_is_the_machine_itself():
    nuisances = Nuisances(MACHINE, "range")
    moved = nuisances.machines(np.zeros((1, len(nuisances.keys))))
    assert all(moved.entries[key].value == entry.value for key, entry in MACHINE.entries.items())


def test_rows_are_variants_and_stop_at_the_ends_of_their_ranges():
    nuisances = Nuisances(MACHINE, "range")
    key = nuisances.keys[5]
    low, high = MACHINE.entries[key].range
    rows = np.zeros((3, len(nuisances.keys)))
    rows[:, 5] = [-1e3, 0.0, 1e3]
    machine = nuisances.machines(rows)
    np.testing.assert_allclose(machine.entries[key].value, [low, float(MACHINE.entries[key].value), high], rtol=1e-12)
    assert machine.num_variants == 3
    assert all(np.ndim(entry.value) == 0 for other, entry in machine.entries.items() if other != key)


def test_whatever_a_search_tries_is_a_machine():
    """Draws three times as wide as the priors, all parameters at once: the machine's own checks pass."""
    nuisances = Nuisances(MACHINE, "range")
    rng = np.random.default_rng(2)
    machine = nuisances.machines(3.0 * rng.standard_normal((64, len(nuisances.keys))))
    for key in nuisances.keys:
        low, high = MACHINE.entries[key].range
        values = np.asarray(machine.entries[key].value)
        assert np.all(values >= low * (1 - 1e-12) - 1e-12) and np.all(values <= high * (1 + 1e-12) + 1e-12), key


def test_what_is_no_prior_is_named():
    with pytest.raises(ValueError, match=f"spread is 'night'; choose one of: {', '.join(SPREADS)}"):
        Nuisances(MACHINE, "night")
