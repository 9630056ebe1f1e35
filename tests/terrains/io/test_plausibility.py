"""Heights are read in the unit that makes a ground; where several do the caller is asked, and pictures are refused."""

import numpy as np
import pytest

from aoro_gym.terrains import TerrainError, load
from aoro_gym.terrains.io.frame import UNITS
from aoro_gym.terrains.io.plausibility import neighbour_statistics, plausible_units

SIZE = 60


def ground(slope=1.0, base=150.0):
    """Heights [m] every metre, at most about 38° steep by 0.8 x ``slope``."""
    i, j = np.mgrid[0:SIZE, 0:SIZE]
    return base + slope * (4.0 * np.sin(j / 5.0) + 3.0 * np.cos(i / 6.0))


@pytest.mark.parametrize(
    ("unit", "fits", "not_fit"), [("cm", "cm (33°) and mm (3.7°)", "dm ("), ("dm", "dm (33°), cm (3.7°)", " ft (")]
)
def test_several_units_that_fit_are_named(unit, fits, not_fit):
    with pytest.raises(TerrainError, match="--z-units") as caught:
        load(np.rint(ground() / UNITS[unit]), cell=1.0)
    assert fits in str(caught.value)
    assert not_fit not in str(caught.value)


@pytest.mark.parametrize("unit", list(UNITS))
def test_the_callers_word_is_believed(unit):
    terrain, report = load(ground() / UNITS[unit], cell=1.0, z_units=unit)
    np.testing.assert_allclose(terrain.vertices[:, 2].reshape(SIZE, SIZE), ground(), rtol=1e-12)
    assert "as asked" in report.units


def test_full_names_are_understood():
    terrain, _ = load(ground() / 0.1, cell=1.0, z_units="decimetres")
    assert np.ptp(terrain.vertices[:, 2]) == pytest.approx(np.ptp(ground()))


def test_the_only_unit_that_fits_is_taken_and_said():
    terrain, report = load(ground() / UNITS["mm"], cell=1.0)
    assert [change.what for change in report.changes] == ["z_units"]
    assert any("recognised by their slope: mm" in text for text in report.warnings)
    np.testing.assert_allclose(terrain.vertices[:, 2].reshape(SIZE, SIZE), ground(), rtol=1e-12)


def test_readings():
    steepness = np.tan(np.radians(33.0))
    found = plausible_units(steepness / UNITS["cm"])
    assert [reading.unit for reading in found] == ["cm", "mm"]
    assert found[0].slope_deg == pytest.approx(33.0)


NEIGHBOURS = {
    "level": np.zeros((SIZE, SIZE)),
    "slope": np.add.outer(np.zeros(SIZE), 0.6 * np.arange(SIZE)),
    "flat ground under 3 cm of noise": 100.0 + np.random.default_rng(1).normal(0.0, 0.03, (SIZE, SIZE)),
    "noise of 20 cm": ground(0.3) + np.random.default_rng(2).normal(0.0, 0.2, (SIZE, SIZE)),
    "whole metres": np.rint(ground()),
    "gentle whole metres": np.rint(ground(0.1)),
    "a wall": np.where(np.arange(SIZE) > 30, 10.0, 0.0) * np.ones((SIZE, 1)),
    "steep parts": ground() + 8.0 * np.sin(np.add.outer(np.arange(SIZE), np.arange(SIZE)) / 12.0),
    "random walk": np.random.default_rng(3).normal(0.0, 0.15, (SIZE, SIZE)).cumsum(axis=0).cumsum(axis=1) / 6.0,
}


@pytest.mark.parametrize("name", NEIGHBOURS)
def test_ground_in_metres_stays(name):
    z = NEIGHBOURS[name]
    terrain, report = load(z, cell=1.0, spike_limit=1000.0)
    np.testing.assert_array_equal(terrain.vertices[:, 2].reshape(z.shape), z)
    assert not any("z_units" in text and "nothing is said" in text for text in report.warnings)
    assert not any("nothing to do with each other" in text for text in report.warnings)


def test_likeness_of_processes():
    """1 for white noise, sqrt(2) for a random walk, 2 for a plane: by their definitions."""
    rng = np.random.default_rng(4)
    noise = rng.normal(size=(300, 300))
    walk = rng.normal(size=(300, 300)).cumsum(axis=1)
    plane = np.add.outer(np.arange(300.0), np.arange(300.0))
    found = neighbour_statistics(noise), neighbour_statistics(walk[::7]), neighbour_statistics(plane)
    assert None not in found
    (ratio, difference), *others = (pair for pair in found if pair is not None)
    assert ratio == pytest.approx(1.0, abs=0.02)
    assert difference == pytest.approx(2.0 / np.sqrt(np.pi), rel=0.03)  # the cut takes a little
    assert others[0][0] < others[1][0] == pytest.approx(2.0)
    assert neighbour_statistics(np.zeros((20, 20))) is None


def test_levels_that_differ_by_next_to_nothing_are_no_steps():
    heights = 100.0 + np.add.outer(np.arange(30.0), np.arange(30.0)) * 0.05
    heights[3, 3] = np.nextafter(heights[3, 3], 200.0)
    heights[:2] = 0.0
    heights[0, 0] = 5e-324
    assert not any("rounded" in warning for warning in load(heights, cell=1.0, nodata=()).report.warnings)
