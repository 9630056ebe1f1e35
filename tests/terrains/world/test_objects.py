"""Objects: poses as rotations have them, bounds that are named, what a machine gets over."""

import doctest
import math
from typing import Any

import numpy as np
import pytest

import aoro_gym.terrains.world.objects as module
from aoro_gym.terrains.world.objects import Boulder, Branch, Log, Stump, Tree, along, matrix, upright

ORIGIN = (0.0, 0.0, 0.0)
TREE: dict[str, Any] = {
    "species": "pine",
    "diameter": 0.2,
    "height": 15.0,
    "crown_base": 8.0,
    "crown_radius": 1.7,
    "shape": 3,
}


def test_rotations():
    leaning = matrix(upright(0.1, 0.7, 1.2))
    np.testing.assert_allclose(leaning @ leaning.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(leaning) == pytest.approx(1.0)
    np.testing.assert_allclose(
        leaning[:, 2], [math.sin(0.1) * math.cos(0.7), math.sin(0.1) * math.sin(0.7), math.cos(0.1)]
    )
    for direction in ((1.0, 0.0, 0.0), (-0.3, 0.4, 0.1), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)):
        np.testing.assert_allclose(
            matrix(along(direction))[:, 2], np.array(direction) / np.linalg.norm(direction), atol=1e-15
        )
    np.testing.assert_allclose(matrix(upright(0.0, 0.0, 0.5))[:2, 0], [math.cos(0.5), math.sin(0.5)])


def test_what_a_machine_gets_over():
    assert Stump(ORIGIN, upright(), "pine", 0.1, 0.3).drivable()
    assert not Stump(ORIGIN, upright(), "pine", 0.1, 0.3).drivable(0.25)
    assert not Tree(ORIGIN, upright(), **TREE).drivable()
    assert Tree(ORIGIN, upright(), **{**TREE, "diameter": 0.04}).drivable()
    assert Boulder(ORIGIN, upright(), (0.5, 0.4, 0.3), 0.2, 1).drivable()
    assert not Boulder(ORIGIN, upright(), (1.5, 1.4, 1.3), 1.2, 1).drivable()
    log = (ORIGIN, along((1.0, 0.0, 0.0)), "spruce", 4.0, 0.15, 0.1, 0.3)
    assert Log(*log, 0).drivable() and not Log(*log, 2).drivable()
    assert Branch(ORIGIN, along((1.0, 0.0, 0.0)), "birch", 2.0, 0.02).drivable(0.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"height": math.nan}, r"tree height is nan m, but must be in \[2, 40\] m"),
        ({"diameter": -0.1}, r"tree diameter is -0.1 m, but must be in \[0.02, 1\] m"),
        ({"crown_base": 16.0}, "tree crown_base is 16 m, but must be below 15 m, the tree's height"),
        ({"species": "oak"}, "tree species is 'oak'; choose one of: pine, spruce, birch"),
        ({"rotation": (0.0, 0.0, 0.0, 2.0)}, r"tree length of rotation is 2, but must be in \[0.999, 1.001\]"),
        ({"position": (0.0, 6000.0, 0.0)}, r"tree position\[1\] is 6000 m, but must be in \[-5000, 5000\] m"),
        ({"rotation": (0.0, 0.0, 1.0)}, "give 3 and 4 numbers"),
    ],
)
def test_refuses(changes, message):
    with pytest.raises(ValueError, match=message):
        Tree(**{"position": ORIGIN, "rotation": upright(), **TREE, **changes})


def test_example():
    tried = doctest.testmod(module)
    assert (tried.attempted > 0, tried.failed) == (True, 0)
