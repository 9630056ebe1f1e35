"""What surfaces are made of: colour for cameras, roughness, and reflectance at the wavelengths of lidars.

A face of a scene has the number of a :class:`Surface`, which is the row of :func:`material_table`. Reflectances are of a
surface that scatters as Lambert's law has it, over its hemisphere, in [0, 1]. Tags of the numbers:

- (S) from the spectra of the birch stand of Järvselja in winter, Estonia (Kuusk, Lang, Kuusk and others, Tartu Observatory,
  2007), in the file of the RAMI-5 benchmark (Joint Research Centre of the EU): the bands 851 nm to 880 nm for 905 nm,
  1539 nm to 1682 nm for 1550 nm, and 656 nm to 675 nm, 551 nm to 570 nm, 481 nm to 500 nm for red, green and blue;
- (R) recalled from the literature, not looked up; (E) estimated here.

Roughness is that of the Trowbridge-Reitz distribution (1975) in the parametrisation of real-time renderers, all (E).
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Surface(IntEnum):
    """What a face is made of."""

    FOREST_FLOOR = 0
    """Feather mosses and dwarf shrubs."""
    ASPHALT = 1
    GRAVEL = 2
    GRASS = 3
    WET_SOIL = 4
    LITTER = 5
    SNOW = 6
    PINE_BARK = 7
    """Of the lower stem: thick, grey brown."""
    PINE_BARK_UPPER = 8
    """Of the upper stem: thin, orange."""
    SPRUCE_BARK = 9
    BIRCH_BARK = 10
    END_GRAIN = 11
    """Sawn ends of logs and tops of stumps."""
    PINE_NEEDLES = 12
    SPRUCE_NEEDLES = 13
    BIRCH_LEAVES = 14
    ROCK = 15
    MOSSY_ROCK = 16
    DEAD_WOOD = 17
    """Grey, without bark."""
    DWARF_SHRUBS = 18
    """Leaves of the undergrowth: bilberry, lingonberry."""


class Material(NamedTuple):
    """Optical properties, each in [0, 1]."""

    albedo: tuple[float, float, float]
    """Reflectance in red, green and blue, linear (not of a screen)."""
    roughness: float
    reflectance_905nm: float
    reflectance_1550nm: float
    source: str
    """Of albedo; of the two reflectances."""


MATERIALS = {
    Surface.FOREST_FLOOR: Material((0.07, 0.10, 0.04), 1.0, 0.35, 0.18, "E; E: between green plants and litter"),
    Surface.ASPHALT: Material((0.10, 0.10, 0.10), 0.9, 0.14, 0.17, "E; E: worn asphalt"),
    Surface.GRAVEL: Material((0.24, 0.22, 0.19), 1.0, 0.30, 0.34, "E; E: granitic"),
    Surface.GRASS: Material((0.06, 0.12, 0.04), 1.0, 0.48, 0.25, "E; R: green vegetation"),
    Surface.WET_SOIL: Material((0.05, 0.04, 0.03), 0.6, 0.12, 0.05, "E; E: water darkens, most at 1550 nm"),
    Surface.LITTER: Material((0.16, 0.12, 0.08), 1.0, 0.35, 0.38, "E; E: dry needles and leaves"),
    Surface.SNOW: Material((0.91, 0.91, 0.90), 1.0, 0.848, 0.045, "S; S"),
    Surface.PINE_BARK: Material((0.16, 0.12, 0.09), 1.0, 0.36, 0.46, "E; E: as spruce's"),
    Surface.PINE_BARK_UPPER: Material((0.40, 0.22, 0.11), 0.9, 0.48, 0.50, "E; E"),
    Surface.SPRUCE_BARK: Material((0.160, 0.126, 0.086), 1.0, 0.357, 0.461, "S; S"),
    Surface.BIRCH_BARK: Material((0.55, 0.53, 0.48), 0.7, 0.461, 0.472, "E: white; S"),
    Surface.END_GRAIN: Material((0.58, 0.45, 0.28), 0.9, 0.65, 0.45, "E; E: fresh wood, wet"),
    Surface.PINE_NEEDLES: Material((0.05, 0.10, 0.05), 0.7, 0.45, 0.20, "E; E: a little below spruce's"),
    Surface.SPRUCE_NEEDLES: Material((0.052, 0.117, 0.054), 0.7, 0.489, 0.219, "S; S"),
    Surface.BIRCH_LEAVES: Material((0.06, 0.14, 0.05), 0.5, 0.46, 0.27, "E; R: broad leaves"),
    Surface.ROCK: Material((0.26, 0.25, 0.24), 0.9, 0.33, 0.37, "E; E: granite and gneiss with lichen"),
    Surface.MOSSY_ROCK: Material((0.08, 0.11, 0.05), 1.0, 0.36, 0.18, "E; E: as forest floor"),
    Surface.DEAD_WOOD: Material((0.30, 0.28, 0.25), 1.0, 0.50, 0.45, "E; E"),
    Surface.DWARF_SHRUBS: Material((0.06, 0.12, 0.04), 0.7, 0.46, 0.27, "E; E: as birch leaves"),
}
"""By surface; sources are tagged as above. The file's birch stem is dark in visible light (0.10), which may be the bark's
black base; the white above it is estimated."""


class MaterialTable(NamedTuple):
    """The materials as arrays of float32, row k of :class:`Surface` k."""

    albedo: NDArray[np.float32]
    """(K, 3) linear red, green, blue."""
    roughness: NDArray[np.float32]
    """(K,)."""
    reflectance_905nm: NDArray[np.float32]
    """(K,)."""
    reflectance_1550nm: NDArray[np.float32]
    """(K,)."""


def material_table() -> MaterialTable:
    """Materials of all surfaces.

    >>> round(float(material_table().reflectance_1550nm[Surface.SNOW]), 3)
    0.045
    """
    rows = [MATERIALS[surface] for surface in Surface]
    return MaterialTable(*(np.array([row[column] for row in rows], dtype=np.float32) for column in range(4)))
