"""Stands of trees: species, diameters and heights as forestry tables have them, by seed.

Sources are tagged as in :mod:`aoro_gym.terrains.world.species`: (S) second hand, (R) recalled, (E) estimated.

- Mixes: three quarters and more of a stand's volume are of its main species, by the definition of pure stands in Finnish
  inventories; pine leads in North Finland, spruce and birch follow (Korhonen and others 2024, Forests of Finland 2019-2023,
  Silva Fennica 58). (R) The numbers below are (E).
- Stems a hectare: about 900 to 1,100 after a first thinning (Äijälä and others 2014, Metsänhoidon suositukset, Tapio). (R)
- Diameters: Weibull's distribution, as Finnish stand models use since Siipilehto (1999), Improving the accuracy of predicted
  basal-area diameter distribution, Silva Fennica 33. (R) Its shape and the means are (E).
- Strip roads: 4 m to 4.5 m wide, 20 m and more apart (Äijälä and others 2014). (R)
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aoro_gym.terrains.world.species import SPECIES

Array = NDArray[Any]


class Stand(NamedTuple):
    """What grows together."""

    text: str
    mix: Mapping[str, float]
    """Share of the stems of each species; they sum up to 1."""
    stems: float
    """A hectare."""
    mean_diameter: float
    """Arithmetic mean at breast height [m], before thin and thick ones are cut off."""
    shape: float
    """Of Weibull's distribution: 1 for many thin trees, 3.6 for a symmetrical one."""
    site: str
    """One of :data:`~aoro_gym.terrains.world.species.SITES`."""


STANDS = {
    "pine": Stand("thinned pine heath", {"pine": 0.86, "spruce": 0.04, "birch": 0.10}, 900.0, 0.16, 3.2, "sub-xeric"),
    "spruce": Stand("spruce forest", {"pine": 0.08, "spruce": 0.77, "birch": 0.15}, 850.0, 0.17, 2.2, "mesic"),
    "birch": Stand("birch with spruce below", {"pine": 0.05, "spruce": 0.20, "birch": 0.75}, 950.0, 0.13, 2.4, "mesic"),
    "mixed": Stand("mixed forest", {"pine": 0.50, "spruce": 0.28, "birch": 0.22}, 950.0, 0.145, 2.4, "mesic"),
}
"""By name."""
THINNEST, THICKEST = 0.05, 0.50
"""Diameters [m] of trees that are placed: inventories call thinner ones saplings."""
LEANS = {"pine": 1.5, "spruce": 1.0, "birch": 3.0}
"""Standard deviation [deg] of each of two components of a stem's lean. (E)"""
LEAST_OF_MEAN = 0.6
"""Height of a suppressed tree over the mean of its diameter. (E)"""
CROWN_SPREAD = 0.12
"""Relative standard deviation of crown radii. (E)"""


class DrawnTree(NamedTuple):
    """Dimensions of one tree [m]."""

    species: str
    diameter: float
    height: float
    crown_base: float
    crown_radius: float
    lean: float
    """[rad]."""
    towards: float
    """Direction of the lean [rad]."""
    shape: int


def draw_diameters(stand: Stand, mean: float, count: int, rng: np.random.Generator) -> Array:
    """(count,) diameters at breast height [m]: Weibull's between ``THINNEST`` and ``THICKEST``.

    Args:
        stand: Its shape.
        mean: Of the whole distribution [m].
        count: How many.
        rng: Generator.
    """
    scale = mean / math.gamma(1.0 + 1.0 / stand.shape)
    low, high = (1.0 - np.exp(-((limit / scale) ** stand.shape)) for limit in (THINNEST, THICKEST))
    share = low + (high - low) * rng.random(count)
    return np.asarray(scale * (-np.log1p(-share)) ** (1.0 / stand.shape))


def draw_species(stand: Stand, count: int, rng: np.random.Generator) -> list[str]:
    """Names of ``count`` trees' species."""
    ends = np.cumsum(list(stand.mix.values()))
    names = list(stand.mix)
    return [names[i] for i in np.searchsorted(ends, rng.random(count) * ends[-1], side="right")]


def draw_trees(stand: Stand, mean: float, count: int, rng: np.random.Generator) -> list[DrawnTree]:
    """``count`` trees, whose heights scatter about their species' function as its authors say.

    Args:
        stand: What grows together.
        mean: Diameter [m].
        count: How many.
        rng: Generator.
    """
    kinds = draw_species(stand, count, rng)
    diameters = draw_diameters(stand, mean, count, rng)
    scatter, wide = rng.normal(size=count), rng.normal(size=count)
    leans, shapes = rng.normal(size=(count, 2)), rng.integers(0, 2**32, count)
    trees = []
    for i, name in enumerate(kinds):
        species, diameter = SPECIES[name], float(diameters[i])
        usual = float(species.mean_height(diameter, stand.site))
        height = max(usual + species.height_error * float(scatter[i]), LEAST_OF_MEAN * usual)
        base = height - float(species.crown_length(diameter, height))
        radius = float(species.crown_radius(diameter)) * math.exp(CROWN_SPREAD * float(wide[i]))
        along, across = np.radians(LEANS[name]) * leans[i]
        lean = float(np.hypot(along, across)), float(np.arctan2(across, along))
        trees.append(DrawnTree(name, diameter, height, base, radius, *lean, int(shapes[i])))
    return trees
