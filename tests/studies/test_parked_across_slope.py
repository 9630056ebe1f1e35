"""Rocking across a slope: the linear model is that of a body on springs, and says what the twin does and why."""

import numpy as np
import pytest

from aoro_gym import Machine
from studies.parked_across_slope import growth, modes


@pytest.fixture(scope="module")
def aoro() -> Machine:
    return Machine.load("aoro")


def test_on_level_ground_it_heaves_on_four_springs_and_both_laws_are_one(aoro):
    found = modes(aoro, 0.0, load_now=True)
    stiffness, damping, mass = 4.0 * float(aoro.tire.stiffness), 4.0 * float(aoro.tire.damping), float(aoro.mass)
    rate = 0.5 * damping / mass
    frequency = np.sqrt(stiffness / mass - rate**2) / (2.0 * np.pi)
    # its centre is 9 cm off the wheels' middle, so that heaving pitches, too: a hundredth of the frequency
    nearest = min(found, key=lambda mode: abs(mode.frequency - frequency) + abs(mode.growth + rate))
    assert nearest.frequency == pytest.approx(frequency, rel=0.02)
    assert nearest.growth == pytest.approx(-rate, rel=0.05)
    for one, other in zip(found, modes(aoro, 0.0, load_now=False), strict=True):
        assert (one.growth, one.frequency) == pytest.approx((other.growth, other.frequency))


def test_a_force_that_follows_the_load_feeds_the_rocking(aoro):
    """Without it nothing grows on any slope; with it the steeper the faster."""
    slopes = np.arange(0.0, 35.0, 2.0)
    assert max(modes(aoro, slope, load_now=False)[0].growth for slope in slopes) < -0.3
    growing = [modes(aoro, slope, load_now=True)[0].growth for slope in slopes]
    assert growing[8] < 0.0 < growing[13]
    assert (np.diff(growing[10:]) > 0.0).all()


def test_the_twin_rocks_as_the_model_says(aoro):
    """Its arms and its joint damp it, too: it grows slower by up to a third, at a frequency within a tenth."""
    wanted, found = modes(aoro, 30.0, load_now=True)[0], growth(aoro, 30.0)
    assert found is not None
    assert found.frequency == pytest.approx(wanted.frequency, rel=0.1)
    assert 0.67 * wanted.growth < found.growth < wanted.growth
    assert growth(aoro, 20.0) is None
