"""Stands: shares, distributions and heights of what is drawn against what was asked for."""

import math

import numpy as np
import pytest
from scipy.stats import kstest, weibull_min

from aoro_gym.terrains.generate.stand import STANDS, THICKEST, THINNEST, draw_diameters, draw_species, draw_trees
from aoro_gym.terrains.world.species import SITES, SPECIES


@pytest.mark.parametrize("name", STANDS)
def test_mixes_are_whole(name):
    stand = STANDS[name]
    assert sum(stand.mix.values()) == pytest.approx(1.0)
    assert set(stand.mix) <= set(SPECIES)
    assert stand.site in SITES


def test_diameters_are_weibulls():
    stand = STANDS["mixed"]
    drawn = draw_diameters(stand, 0.15, 4000, np.random.default_rng(1))
    whole = weibull_min(stand.shape, scale=0.15 / math.gamma(1.0 + 1.0 / stand.shape))
    low, high = whole.cdf([THINNEST, THICKEST])
    assert drawn.min() >= THINNEST and drawn.max() <= THICKEST
    assert kstest(drawn, lambda d: (whole.cdf(d) - low) / (high - low)).pvalue > 0.001


def test_species_come_in_their_shares():
    stand = STANDS["mixed"]
    drawn = draw_species(stand, 4000, np.random.default_rng(2))
    for name, share in stand.mix.items():
        deviation = math.sqrt(share * (1.0 - share) / 4000.0)
        assert drawn.count(name) / 4000.0 == pytest.approx(share, abs=4.0 * deviation)


def test_heights_scatter_as_their_function_says():
    stand = STANDS["pine"]
    trees = [t for t in draw_trees(stand, 0.2, 3000, np.random.default_rng(3)) if t.species == "pine"]
    off = np.array([t.height - float(SPECIES["pine"].mean_height(t.diameter, stand.site)) for t in trees])
    error = SPECIES["pine"].height_error
    assert off.mean() == pytest.approx(0.0, abs=4.0 * error / math.sqrt(len(off)) + 0.02)  # the lowest are cut off
    assert off.std() == pytest.approx(error, rel=0.05)
    for tree in trees:
        assert 0.0 < tree.crown_base < tree.height
        assert tree.lean < math.radians(10.0)


def test_by_seed():
    one, same, other = (draw_trees(STANDS["spruce"], 0.17, 20, np.random.default_rng(seed)) for seed in (5, 5, 6))
    assert one == same
    assert one != other
