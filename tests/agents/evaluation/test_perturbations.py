"""Machines that policies were not made for: within ranges, repeatable, and with one effect each."""

import numpy as np
import pytest

from aoro_gym.agents.evaluation.perturbations import (
    SWITCHABLE,
    drawn_machines,
    magnitude_at,
    perturbed,
    unperturbed,
    with_effect,
)
from aoro_gym.agents.evaluation.tasks import TASKS
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.machine import Machine
from aoro_gym.machine.laws import FAMILIES, family
from aoro_gym.machine.vehicle_crane import VehicleCrane

MACHINE = Machine.load("aoro")
SEEDS = [7, 8, 9, 10]


def values_of(machine):
    return {key: np.broadcast_to(entry.value, machine.num_variants) for key, entry in machine.entries.items()}


def test_every_uncertain_parameter_is_drawn_within_its_range():
    found = values_of(perturbed(MACHINE, SEEDS))
    moved = 0
    for key, entry in MACHINE.entries.items():
        if entry.role in ("nuisance", "both"):
            low, high = entry.range
            slack = 1e-9 * (high - low)
            assert np.all((found[key] >= low - slack) & (found[key] <= high + slack)), key
            moved += len(np.unique(found[key])) > 1
        elif entry.role == "fixed":
            np.testing.assert_array_equal(found[key], entry.value, err_msg=key)
    # some lean on an end of their range, where half of the draws end
    assert moved > 0.9 * sum(entry.role in ("nuisance", "both") for entry in MACHINE.entries.values())


def test_what_a_seed_draws_does_not_depend_on_its_neighbours():
    for draw in (perturbed, with_effect):
        together, alone = values_of(draw(MACHINE, SEEDS)), values_of(draw(MACHINE, [SEEDS[2]]))
        for key, value in together.items():
            assert value[2] == alone[key][0], key


def test_each_machine_has_one_effect():
    plain, with_one = values_of(perturbed(MACHINE, SEEDS)), values_of(with_effect(MACHINE, SEEDS))
    changed = [{key for key in plain if plain[key][i] != with_one[key][i]} for i in range(len(SEEDS))]
    assert all(changed)
    # an effect moves a few parameters that belong together
    assert all(len(keys) <= 12 for keys in changed)
    assert len({frozenset(keys) for keys in changed}) > 1


def test_severity_spans_a_magnitude():
    for effect in SWITCHABLE.values():
        for magnitude in effect.magnitudes:
            assert magnitude_at(magnitude, 0.0) == magnitude.none
            ends = sorted({magnitude_at(magnitude, -1.0), magnitude_at(magnitude, 1.0)})
            assert ends == pytest.approx(sorted({magnitude.low, magnitude.high} - {magnitude.none}))
            assert magnitude.low <= magnitude_at(magnitude, -0.5) <= magnitude.high
    factor = EFFECTS["pump_response"].magnitudes[0]
    assert magnitude_at(factor, 0.5) == pytest.approx(np.sqrt(3.0))


def test_as_given_is_the_machine_itself():
    assert unperturbed(MACHINE, SEEDS) is MACHINE


@pytest.mark.parametrize("perturbation", [None, "perturbed"])
def test_laws_are_drawn_by_seed_over_what_else_differs(perturbation):
    draw = drawn_machines("families", perturbation)
    found, alone = draw(MACHINE, SEEDS), draw(MACHINE, [SEEDS[2]])
    assert found.num_variants == len(SEEDS)
    assert found.variant(2).laws.names == alone.variant(0).laws.names
    many = [drawn_machines("families")(MACHINE, [seed]).variant(0).laws.names for seed in range(60)]
    # of 60 draws from 5, one is missing with a probability below 5 × 0.8^60 = 8e-6
    assert {str(names) for names in many} == {str(family(name).names) for name in FAMILIES}
    values, others = values_of(found), values_of(drawn_machines(None, perturbation)(MACHINE, SEEDS))
    for key, entry in MACHINE.entries.items():
        if entry.role != "law" or perturbation is None:
            np.testing.assert_array_equal(values[key], np.broadcast_to(others[key], len(SEEDS)), err_msg=key)
        else:
            low, high = entry.range
            half = [entry.value + 0.5 * (end - entry.value) for end in (low, high)]
            assert np.all((values[key] >= half[0]) & (values[key] <= half[1])), key
            assert len(np.unique(values[key])) > 1 or low == high == entry.value, key


def test_one_family_is_no_draw_and_unknown_names_are_named():
    assert drawn_machines("library") is unperturbed
    assert drawn_machines(None, "perturbed") is perturbed
    with pytest.raises(ValueError, match="perturbation is 'odd'"):
        drawn_machines(None, "odd")
    with pytest.raises(ValueError, match="no family of laws 'libary'"):
        drawn_machines("libary")


def test_a_machine_that_cannot_carry_a_crane_is_drawn_again_and_the_others_stay():
    """Of whom the front frame's masses leave no moment of inertia beside the folded crane's."""
    fits, drawing = VehicleCrane().check_fits, TASKS["AORO/Loading-v0"].drawing(perturbed)
    unfit = [seed for seed in range(30) if not can_carry_a_crane(perturbed(MACHINE, [seed]))]
    assert 0 < len(unfit) <= 27  # some fit, others do not
    seeds = [unfit[0], *(seed for seed in range(30) if seed not in unfit)][:4]
    before, drawn = values_of(perturbed(MACHINE, seeds)), drawing(MACHINE, seeds)
    fits(drawn)
    stays = [all(before[key][k] == values[k] for key, values in values_of(drawn).items()) for k in range(4)]
    assert stays == [False, True, True, True]
    alone = values_of(drawing(MACHINE, seeds[:1]))
    assert all(values[0] == values_of(drawn)[key][0] for key, values in alone.items())
    assert TASKS["AORO/Turning-v0"].drawing(perturbed) is perturbed


def test_a_machine_that_no_draw_helps_is_refused_with_the_reason():
    light = MACHINE.set({"frame.front.mass": 300.0}, check_ranges=False)
    with pytest.raises(ValueError, match="must be above the crane's"):
        TASKS["AORO/Loading-v0"].drawing(unperturbed)(light, [1, 2])


def can_carry_a_crane(machine):
    try:
        VehicleCrane().check_fits(machine)
    except ValueError:
        return False
    return True
