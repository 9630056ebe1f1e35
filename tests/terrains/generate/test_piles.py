"""Lying wood touches the ground and each other, and goes through neither."""

import doctest
from itertools import combinations, pairwise

import numpy as np
import pytest

import aoro_gym.terrains.generate.piles as module
from aoro_gym.terrains import Terrain
from aoro_gym.terrains.generate.piles import SUNK, lying, pile, stacked
from aoro_gym.terrains.generate.placing import Site
from aoro_gym.terrains.world.objects import Log, matrix


def site(heights) -> Site:
    x, y = np.meshgrid(np.arange(81) * 0.25 - 10.0, np.arange(81) * 0.25 - 10.0)
    terrain = Terrain.from_heights(heights(x, y), cell=0.25, corner=(-10.0, -10.0))
    return Site(terrain, np.ones(len(terrain.vertices), dtype=bool), [])


def test_circles_touch_and_do_not_overlap():
    radii = sorted(np.random.default_rng(3).uniform(0.05, 0.15, 15), reverse=True)
    places = stacked(radii)
    assert len(places) == 15
    for (a, (ax, az)), (b, (bx, bz)) in combinations(zip(radii, places, strict=True), 2):
        assert np.hypot(ax - bx, az - bz) >= a + b - 1e-9
    for (x, z), radius in zip(places[5:], radii[5:], strict=True):  # five on the floor; the others lie on one or two
        gaps = [np.hypot(x - a, z - b) - radius - r for (a, b), r in zip(places, radii, strict=True) if b < z]
        assert min(gaps) == pytest.approx(0.0, abs=1e-9)
    assert all(z == r for (_, z), r in zip(places[:5], radii[:5], strict=True))
    assert all(a[0] < b[0] for a, b in pairwise(places[:5]))


def test_a_stem_lies_along_a_slope():
    ground = site(lambda x, y: 0.2 * x)
    position, direction, above = lying(ground, (0.0, 0.0, 0.0), 0.0, 4.0, (0.2, 0.1))
    assert direction[2] / direction[0] == pytest.approx(0.2 - 0.1 * (1.0 - SUNK) / 4.0)
    assert position[2] == pytest.approx(0.2 * (1.0 - SUNK))
    assert above == pytest.approx(0.2 * (2.0 - SUNK))


def test_a_stem_rests_on_a_hump():
    ground = site(lambda x, y: 0.5 * np.exp(-((x - 2.0) ** 2 + y**2)))
    position, direction, above = lying(ground, (0.0, 0.0, 0.0), 0.0, 4.0, (0.15, 0.15))
    at = np.linspace(0.0, 4.0, 50)
    low = position[2] + at * direction[2] - 0.15 - ground.height(np.column_stack([at, 0.0 * at]))
    assert low.min() == pytest.approx(-0.15 * SUNK, abs=0.01)  # the samples are 0.3 m apart
    assert above > 0.6


def test_a_pile_lies_on_the_ground():
    ground = site(lambda x, y: 0.1 * x - 0.05 * y)
    wood = [("pine", 4.0, 0.15, 0.12), ("pine", 4.0, 0.12, 0.1), ("birch", 4.0, 0.1, 0.08)]
    found = pile(ground, (1.0, 2.0, 0.0), 0.3, 5, wood)
    assert len(found) == 3
    for log in found:
        assert isinstance(log, Log) and log.pile == 5 and not log.drivable()
        axis = matrix(log.rotation)[:, 2]
        for share in (0.0, 0.5, 1.0):
            middle = np.array(log.position) + share * log.length * axis
            plane = (middle[2] - 0.1 * middle[0] + 0.05 * middle[1]) / np.sqrt(1.0 + 0.1**2 + 0.05**2)
            assert plane >= log.radius - 1e-6  # distance from the ground
    np.testing.assert_allclose(np.mean([log.position for log in found[:2]], axis=0)[:2], [1.0, 2.0], atol=2.2)


def test_example():
    tried = doctest.testmod(module)
    assert (tried.attempted > 0, tried.failed) == (True, 0)
