"""The machine that ships agrees with the published twin, and says where every value comes from."""

import pytest

from aoro_gym.calibration.procedure import motor_pressure, turn_time
from aoro_gym.twin import Machine
from aoro_gym.validation.key_figures import FIGURES
from aoro_gym.validation.published import published
from aoro_gym.validation.study import validate


@pytest.fixture(scope="module")
def result():
    return validate("aoro", noise_runs=2)


def test_all_figures_of_the_left_turns_are_within_the_targets(result):
    reached, count = result.reached("twin")
    assert count == 3 * len(FIGURES)
    assert reached == count, result.errors


def test_full_turns_take_the_measured_times_both_ways():
    machine = Machine.load("aoro")
    assert turn_time("left")(machine)[0] == pytest.approx(1.98, abs=0.01)
    assert turn_time("right")(machine)[0] == pytest.approx(published("turn_time_right"), abs=0.01)


def test_driving_needs_the_measured_pressure():
    machine = Machine.load("aoro")
    assert motor_pressure(machine)[0] == pytest.approx(published("motor_pressure"), rel=0.01)


def test_every_value_is_within_its_range_and_fitted_ones_say_so():
    fitted = 0
    for parameter in Machine.load("aoro").parameters():
        low, high = parameter.range
        slack = 1e-9 * max(abs(low), abs(high))
        assert low - slack <= float(parameter.value) <= high + slack, parameter.key
        fitted += parameter.source.startswith("C: published key figures")
    assert fitted > 20
