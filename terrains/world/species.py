"""Trees of the boreal forest by species: stem, height, crown and foliage from published functions.

Where a number comes from is tagged:

- (S) at second hand: from open-source code that names the publication; the publication itself was not at hand;
- (R) recalled from the literature, not looked up;
- (E) estimated here.

Diameters are over bark. The functions take centimetres where their authors do; what is public here is in metres.

- Laasasenaho (1982), Taper curve and volume functions for pine, spruce and birch, Communicationes Instituti Forestalis
  Fenniae 108. (S)
- Pukkala, Lähde, Laiho (2009), Growth and yield models for uneven-sized forest stands in Finland, Forest Ecology and
  Management 258. (S)
- Jakobsons (1970), The correlation between the diameter of tree crown and other tree factors, Royal College of Forestry,
  Stockholm, research note 14: northern Sweden. (S)
- Rautiainen, Mõttus, Stenberg, Ervasti (2008), Crown envelope shape measurements and models, Silva Fennica 42. (S)
- Nilson, Lang, Kuusk, Anniste, Lükk (1999), Forest reflectance model as an interface, IUFRO conference. (S)
- Repola (2008, 2009), Biomass equations for birch, and for Scots pine and Norway spruce in Finland, Silva Fennica 42
  and 43. (S)
- Majasalmi, Rautiainen, Stenberg, Lukeš (2013), An assessment of ground reference methods for estimating LAI of boreal
  forests, Forest Ecology and Management 292: leaf mass by area and shoots by species. (S)

>>> pine = SPECIES["pine"]
>>> round(float(pine.stem_diameter(1.3, 0.24, 21.0)), 9), round(float(pine.stem_volume(0.24, 21.0)), 3)
(0.24, 0.45)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

BREAST = 1.3
"""Height [m] at which a tree's diameter is measured."""
EXPONENTS = (1, 2, 3, 5, 8, 13, 21, 34)
"""Of Laasasenaho's taper curve."""
SHORTEST_CROWN, LONGEST_CROWN = 0.25, 0.92
"""Bounds of the crown's share of the height: the functions of diameter alone leave them for slender trees. (E)"""
SITES = ("mesic", "sub-xeric", "xeric")
"""Fertility of the site, as Cajander's types MT, VT and CT."""
LEAST_HEIGHT, MOST_HEIGHT = 2.0, 40.0
"""Of a tree [m]."""


@dataclass(frozen=True)
class Species:
    """Functions of one species; lengths in m."""

    name: str
    latin: str
    taper: tuple[float, ...]
    """Laasasenaho's coefficients of the relative diameter, by :data:`EXPONENTS`."""
    volume: tuple[float, float, float, float, float]
    """Laasasenaho's coefficients of the stem volume by diameter and height."""
    volume_error: float
    """Relative standard error of the volume function as he gives it: scatter of trees, not of means."""
    height: tuple[float, float, float]
    """Pukkala's a1 [m], b1, b2."""
    height_by_site: tuple[float, float, float]
    """What a1 gains [m] on each of :data:`SITES`."""
    height_error: float
    """Standard deviation [m] of heights about the function."""
    crown_diameter: tuple[float, float]
    """Jakobsons: slope, and intercept [dm], by the diameter at the stump [cm]."""
    leaf_mass_by_area: float
    """Of needles or leaves [kg/m²]."""
    shoot_factor: float
    """Share of the foliage's area that meets light, the rest being shaded within its shoot: 4 STAR."""

    def relative_diameter(self, share: ArrayLike) -> Array:
        """Diameter relative to that at a fifth of the height, at a ``share`` of the height below the top in [0, 1]."""
        x = np.asarray(share, dtype=np.float64)
        return np.sum([c * x**n for c, n in zip(self.taper, EXPONENTS, strict=True)], axis=0)

    def stem_diameter(self, at: ArrayLike, diameter: float, height: float) -> Array:
        """Diameter [m] of the stem ``at`` a height above the ground [m].

        Args:
            at: In [0, ``height``].
            diameter: At breast height [m].
            height: Of the tree [m], above breast height.
        """
        share = 1.0 - np.asarray(at, dtype=np.float64) / height
        return diameter * self.relative_diameter(share) / self.relative_diameter(1.0 - BREAST / height)

    def stem_volume(self, diameter: ArrayLike, height: ArrayLike) -> Array:
        """Volume [m³] of the stem by the volume function, which was fitted beside the taper curve, not from it."""
        d, h = 100.0 * np.asarray(diameter, dtype=np.float64), np.asarray(height, dtype=np.float64)
        a, b, c, e, f = self.volume
        return 1e-3 * a * d**b * c**d * h**e * (h - BREAST) ** f

    def mean_height(self, diameter: ArrayLike, site: str) -> Array:
        """Height [m] of trees of a ``diameter`` at breast height [m]."""
        d = 100.0 * np.asarray(diameter, dtype=np.float64)
        a, b, c = self.height
        return (a + self.height_by_site[SITES.index(site)]) / (1.0 + b / d + c / d**2)

    def crown_radius(self, diameter: ArrayLike) -> Array:
        """Radius [m] of the crown where it is widest."""
        slope, intercept = self.crown_diameter
        return (slope * _stump_diameter(diameter) + intercept) / 20.0

    def crown_length(self, diameter: ArrayLike, height: ArrayLike) -> Array:
        """Length [m] of the crown: Rautiainen (2008) for pine and spruce, Nilson (1999) for birch."""
        d, h = 100.0 * np.asarray(diameter, dtype=np.float64), np.asarray(height, dtype=np.float64)
        if self.name == "birch":
            length = 0.5525 * h / d + d**0.7032
        else:
            base, slope = {"pine": (2.653, 0.26), "spruce": (2.686, 0.52)}[self.name]
            length = base + slope * d
        return np.clip(length, SHORTEST_CROWN * h, LONGEST_CROWN * h)

    def foliage_area(self, diameter: float, height: float) -> float:
        """Area [m²], one side counted, of needles or leaves that meets light."""
        d, h = _stump_diameter(diameter), height
        if self.name == "pine":
            mass = np.exp(-6.303 + 14.472 * d / (d + 6.0) - 3.976 * h / (h + 1.0) + 0.1135)
        elif self.name == "spruce":
            mass = np.exp(-2.994 + 12.251 * d / (d + 10.0) - 3.415 * h / (h + 1.0) + 0.098)
        elif diameter > SMALL_BIRCH:
            mass = np.exp(-29.566 + 33.372 * d / (d + 2.0) + 0.0385)
        else:
            mass = 0.00371 * (10.0 * d) ** 1.11993
        return float(mass / self.leaf_mass_by_area * self.shoot_factor)


SMALL_BIRCH = 0.11
"""Diameter [m] up to which Johansson (1999) holds for birch's leaves in place of Repola. (S)"""


def _stump_diameter(diameter: ArrayLike) -> Array:
    """Diameter [cm] at the stump of trees of a ``diameter`` at breast height [m]: Repola's 2 + 1.25 d."""
    return 2.0 + 125.0 * np.asarray(diameter, dtype=np.float64)


SPECIES = {
    one.name: one
    for one in (
        Species(
            name="pine",
            latin="Pinus sylvestris",
            taper=(2.1288, -0.63157, -1.6082, 2.4886, -2.4147, 2.3619, -1.7539, 1.0817),
            volume=(0.036089, 2.01395, 0.99676, 2.07025, -1.07209),
            volume_error=0.071,
            height=(25.014, 19.260, 31.721),
            height_by_site=(7.680, 6.376, -1.787),
            height_error=2.360,
            crown_diameter=(1.19, 8.0),
            leaf_mass_by_area=0.1613,
            shoot_factor=4.0 * 0.147,
        ),
        Species(
            name="spruce",
            latin="Picea abies",
            taper=(2.3366, -3.2684, 3.6513, -2.2608, 0.0, 2.1501, -2.7412, 1.8876),
            volume=(0.022927, 1.91505, 0.99146, 2.82541, -1.53547),
            volume_error=0.0747,
            height=(33.726, 25.683, 37.785),
            height_by_site=(5.965, 2.178, -1.399),
            height_error=2.104,
            crown_diameter=(0.96, 13.3),
            leaf_mass_by_area=0.202,
            shoot_factor=4.0 * 0.161,
        ),
        Species(
            name="birch",
            latin="Betula pendula, B. pubescens",
            taper=(0.93838, 4.1060, -7.8517, 7.8993, -7.5018, 6.3863, -4.3918, 2.1604),
            volume=(0.011197, 2.10253, 0.98600, 3.98519, -2.65900),
            volume_error=0.0823,
            height=(29.375, 22.640, -8.0),
            height_by_site=(7.714, 3.059, -2.870),
            height_error=2.001,
            crown_diameter=(1.40, 12.2),
            leaf_mass_by_area=0.07407,
            shoot_factor=1.0,
        ),
    )
}
"""By name."""
