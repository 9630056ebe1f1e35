"""The study of chosen manoeuvres: its shares, its interval, and that plants are told what twins are told."""

import numpy as np
import pytest

from aoro_gym.diagnosis.next_experiments import catalogue
from aoro_gym.machine import Machine
from studies.next_experiments import TITLES, excitations_of, summary, text


def test_shares_and_what_choice_gains() -> None:
    """Of 40 cases, choice names all, chance half of them in all: the bootstrap has nothing to vary."""
    keys = ("first", "alone", "probability", "entropy")
    values = {"now": 0.25, "random": 0.5}
    answer = {way: dict.fromkeys(keys, values.get(way, 1.0)) for way in TITLES} | {"best": 1.0}
    found = summary([answer] * 40, seed=0)
    assert found["cases"] == 40
    assert found["means"]["now"]["first"] == 0.25
    assert found["over_random"]["chosen"]["first"] == pytest.approx({"value": 0.5, "low95": 0.5, "high95": 0.5})
    assert "+0.500 (+0.500 to +0.500)" in text({**found, "worlds": 4})


def test_interval_is_that_of_a_mean() -> None:
    """Differences ±1 as often: the mean of n has the deviation 1/√n, and 95 % lie within 1.96 of them."""
    count, keys = 400, ("first", "alone", "probability", "entropy")
    answers = [
        {way: dict.fromkeys(keys, float(way == "chosen") * 2.0 * (i % 2)) for way in TITLES} | {"best": 1.0}
        for i in range(count)
    ]
    one = summary(answers, seed=0)["over_random"]["chosen"]["first"]
    assert one["value"] == pytest.approx(1.0)
    assert one["high95"] - one["low95"] == pytest.approx(2 * 1.96 / np.sqrt(count), rel=0.1)


def test_plants_do_what_the_catalogue_says() -> None:
    machine = Machine.load("aoro")
    told = excitations_of(machine)
    for one in catalogue(machine):
        np.testing.assert_array_equal(told[one.name].steering, one.commands[:, 0])
        assert told[one.name].start * float(np.asarray(machine.joint.range)) == pytest.approx(one.start_angle)
