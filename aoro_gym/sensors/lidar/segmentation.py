"""Ground and trunks told from the rest by geometry alone: a baseline for what is learned.

Ground is what lies near the lowest surface that rises nowhere steeper than a slope (Vosselman 2000, Slope based filtering of
laser altimetry data, International Archives of Photogrammetry and Remote Sensing 33), less the coarse relief. Trunks are
columns: thin in plan, filled from bottom to top, with little beside them.

>>> import numpy as np
>>> x, y = (grid.ravel() for grid in np.meshgrid(np.arange(-5.0, 5.0, 0.1), np.arange(-5.0, 5.0, 0.1)))
>>> ground = np.column_stack([x, y, 0.1 * x])
>>> z = np.arange(0.5, 4.0, 0.05)
>>> trunk = np.column_stack([2.0 + 0.1 * np.cos(20 * z), 0.1 * np.sin(20 * z), 0.2 + z])
>>> labels = segment(np.concatenate([ground, trunk]))
>>> bool((labels[: len(x)] == Label.GROUND).all()), bool((labels[len(x) :] == Label.TRUNK).all())
(True, True)
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from aoro_gym.checks import check_finite, check_range
from aoro_gym.terrains.io.ground_filter import relief
from aoro_gym.terrains.io.repair import interpolate

Array = NDArray[np.float64]
OWN = 5
"""Cells either way that are a column's own."""
MOST_CELLS = 20_000_000
"""Of the grid in plan: with it, points of one far echo do not take all memory."""


class Label(IntEnum):
    """What a point belongs to."""

    OTHER = 0
    GROUND = 1
    TRUNK = 2


@dataclass(frozen=True)
class SegmentationSettings:
    """Chosen on forests of seeds that the scores of ``studies/lidar_segmentation.py`` do not see; lengths in m, all (E)."""

    cell: float = 0.5
    """Of the grid whose lowest points the ground is sought among."""
    slope: float = 0.5
    """Steepest rise [-] of the ground over its coarse relief."""
    reach: float = 4.0
    """Distance over which the slope is looked at: more than half the widest thing that is not ground."""
    tolerance: float = 0.07
    """Height over the surface of the ground up to which points belong to it."""
    column: float = 0.1
    """Of the grid in plan that columns stand on."""
    layer: float = 0.3
    """Height of the layers that a column is filled by."""
    low: float = 0.4
    """Least height over the ground at which columns are looked at."""
    layers: int = 12
    """How many there are above."""
    filled: float = 0.5
    """Least share of them that has points, in a trunk."""
    widest: float = 0.9
    """Of what is a trunk in plan, either way."""
    alone: float = 0.5
    """Least share of the points around a column, within ``around``, that is its own."""
    around: float = 0.6
    """Half the side of the square around a column."""
    beyond: float = 5.0
    """How far along its axis a trunk goes on over the highest layer that it fills."""
    thickness: float = 0.1
    """Distance from a trunk's axis, on top of its own radius, up to which points belong to it."""

    def __post_init__(self) -> None:
        for name in (
            "cell",
            "slope",
            "reach",
            "tolerance",
            "column",
            "layer",
            "widest",
            "around",
            "beyond",
            "thickness",
        ):
            check_range(name, getattr(self, name), gt=0.0, lt=np.inf)
        check_range("layers", self.layers, ge=2, le=100)
        check_range("filled", self.filled, gt=0.0, le=1.0)
        check_range("alone", self.alone, ge=0.0, le=1.0)


def segment(points: ArrayLike, settings: SegmentationSettings | None = None) -> NDArray[np.uint8]:
    """(N,) :class:`Label` of each of ``points`` (N, 3) [m], whose z is up.

    Raises ``ValueError`` naming the shape, the bound or the fix.
    """
    chosen = SegmentationSettings() if settings is None else settings
    cloud = _checked(points, chosen)
    above = height_over_ground(cloud, chosen)
    labels = np.full(len(cloud), Label.OTHER, dtype=np.uint8)
    labels[_trunks(cloud, above, chosen)] = Label.TRUNK
    labels[np.abs(above) <= chosen.tolerance] = Label.GROUND
    return labels


def height_over_ground(points: ArrayLike, settings: SegmentationSettings | None = None) -> Array:
    """(N,) height [m] of each of ``points`` (N, 3) over the surface of the ground."""
    chosen = SegmentationSettings() if settings is None else settings
    cloud = _checked(points, chosen)
    level: Any = cloud[:, 2] - relief(cloud)
    place = (cloud[:, :2] - cloud[:, :2].min(axis=0)) / chosen.cell
    shape = tuple(np.floor(place.max(axis=0)).astype(int) + 1)
    cell: Any = np.ravel_multi_index(tuple(np.floor(place).astype(int).T), shape)
    order: Any = np.lexsort((level, cell))
    lowest: Any = order[np.unique(cell[order], return_index=True)[1]]
    grid: Any = np.full(shape, np.inf)
    grid.ravel()[cell[lowest]] = level[lowest]
    steps = np.arange(-int(chosen.reach / chosen.cell), int(chosen.reach / chosen.cell) + 1)
    cone = -chosen.slope * chosen.cell * np.hypot(*np.meshgrid(steps, steps, indexing="ij"))
    envelope = ndimage.grey_erosion(grid, structure=cone, mode="constant", cval=np.inf)
    lying = lowest[level[lowest] <= envelope.ravel()[cell[lowest]] + chosen.tolerance]
    return level - interpolate(cloud[lying, :2], level[lying], cloud[:, :2])


def _checked(points: ArrayLike, settings: SegmentationSettings) -> Array:
    cloud = np.asarray(points, dtype=np.float64)
    if cloud.ndim != 2 or cloud.shape[1] != 3 or len(cloud) < 10:
        raise ValueError(f"points have the shape {cloud.shape}, but must be (N, 3) with at least 10 points")
    check_finite("points", cloud, "m")
    cells = float(np.prod(np.ptp(cloud[:, :2], axis=0) / settings.column + 1.0))
    note = "; leave out far points, or make SegmentationSettings.column larger"
    check_range("number of cells below the points", cells, le=MOST_CELLS, note=note)
    return cloud


def _trunks(cloud: Array, above: Array, settings: SegmentationSettings) -> NDArray[np.bool_]:
    """(N,) which points lie in columns that are trunks."""
    layer = np.floor((above - settings.low) / settings.layer).astype(int)
    middle = (layer >= 0) & (layer < settings.layers)
    mask = np.zeros(len(cloud), dtype=bool)
    if not middle.any():
        return mask
    place = np.floor((cloud[:, :2] - cloud[:, :2].min(axis=0)) / settings.column).astype(int)
    shape = tuple(place.max(axis=0) + 1)
    where = tuple(place[middle].T)
    filled = np.zeros(shape, dtype=np.uint8)
    counts = np.zeros(shape, dtype=np.float32)
    np.add.at(counts, where, 1.0)
    for number in range(settings.layers):
        one = np.zeros(shape, dtype=bool)
        one[tuple(place[layer == number].T)] = True
        filled += ndimage.binary_dilation(one, np.ones((3, 3), dtype=bool))
    side = 2 * round(settings.around / settings.column) + 1
    own = ndimage.uniform_filter(counts, OWN, mode="constant") * OWN**2
    near = ndimage.uniform_filter(counts, side, mode="constant") * side**2
    core = (counts > 0) & (filled >= settings.filled * settings.layers) & (own >= settings.alone * near)
    parts, count = cast(Any, ndimage.label(core, np.ones((3, 3), dtype=int)))
    part = parts[tuple(place.T)]
    for number, box in enumerate(ndimage.find_objects(parts, count), start=1):
        if max(edge.stop - edge.start for edge in box) * settings.column <= settings.widest:
            _mark(mask, cloud, above, middle & (part == number), settings)
    return mask


def _mark(
    mask: NDArray[np.bool_], cloud: Array, above: Array, column: NDArray[np.bool_], settings: SegmentationSettings
) -> None:
    """Set what lies along the straight axis of a column."""
    height = above[column]
    design: Any = np.column_stack([np.ones(len(height)), height])
    axis, *_ = np.linalg.lstsq(design, cloud[column, :2], rcond=None)
    off = np.linalg.norm(cloud[:, :2] - (axis[0] + above[:, None] * axis[1]), axis=1)
    radius = float(np.quantile(off[column], 0.8))
    top = float(height.max()) + settings.beyond
    mask |= (off <= radius + settings.thickness) & (above > settings.tolerance) & (above <= top)
