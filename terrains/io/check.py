"""What a loaded terrain is, what was changed on the way, and what no vehicle could drive on."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any, cast

import numpy as np
from scipy import ndimage

from aoro_gym.terrains.heights import Heights
from aoro_gym.terrains.io.repair import EIGHT
from aoro_gym.terrains.length_units import listed

STEEPEST_DEG = 45.0
"""Steepest ground [deg] that counts as drivable: the bound of :class:`~aoro_gym.terrains.Plane`."""
LEAST_DRIVABLE = 0.1
"""Least share of the ground that must be drivable."""
SMALLEST_PIECE = 25.0
"""Smallest ground [m²] that is one: a vehicle of 6 m x 2.5 m, and a little to move."""
LEVEL = 0.05
"""Relief [m] below which ground is suspiciously level."""
ROUGHNESS_WINDOW = 2.0
"""Side [m] of the square whose mean height roughness is measured from."""


GUESSES = ("up", "units", "z_units", "crs", "columns")
"""Changes that are an interpretation, so that an error after them may come of it."""


class TerrainError(ValueError):
    """A file that is no terrain, or a terrain that cannot be driven on; the message says why and what to do."""


@dataclass(frozen=True)
class Hole:
    """A place within the rectangle of the extent where there is no ground."""

    west: float
    """Local coordinates [m] of the smallest rectangle around it."""
    south: float
    east: float
    north: float
    area_m2: float
    at_edge: bool
    """Whether it reaches the edge of the extent: then it lies outside of the surveyed ground, or cuts into it."""


@dataclass(frozen=True)
class Change:
    """One repair or interpretation."""

    what: str
    """Short key, such as ``holes_filled``."""
    count: int
    """How many triangles, points or heights it concerned."""
    text: str
    """The sentence to show."""


@dataclass
class Report:
    """What was read and what became of it; lengths in m, local coordinates (see ``origin``)."""

    source: str
    kind: str = ""
    """``mesh``, ``raster``, ``points`` or ``heights``."""
    units: str = ""
    """Unit of the source, and how it is known."""
    up: str = "z"
    """Axis of the source that points up, and how it is known."""
    crs: str | None = None
    origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    cell_m: float | None = None
    """Distance of heights; None where the source's own triangles are kept."""
    points_read: int = 0
    """Points, vertices or heights in the source."""
    triangles: int = 0
    vertices: int = 0
    extent_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Size along x, y, z."""
    ground_m2: float = 0.0
    """Area with ground, in plan."""
    ground_share: float = 0.0
    """Share of the extent's rectangle with ground."""
    slope_median_deg: float = 0.0
    slope_95_deg: float = 0.0
    slope_max_deg: float = 0.0
    drivable_share: float = 0.0
    """Share of the ground that is at most 45° steep."""
    roughness_m: float = 0.0
    """Root mean square deviation of the heights from their mean within a square of 2 m."""
    changes: list[Change] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    holes: list[Hole] = field(default_factory=list)
    seconds: float = 0.0

    def change(self, what: str, count: int, text: str) -> None:
        """Note a change, unless it concerned nothing."""
        if count:
            self.changes.append(Change(what, count, text))

    def doubts(self) -> str:
        """What was taken for granted or is in doubt already, to follow an error that may come of it; blank if nothing is."""
        told = [change.text for change in self.changes if change.what in GUESSES]
        told += [text for text in self.warnings if text.startswith("coordinates ")]
        return f" (before that: {'; '.join(told)})" if told else ""

    def to_json(self) -> dict[str, Any]:
        """All of it as JSON's types."""
        return asdict(self)


def measure(heights: Heights, report: Report) -> None:
    """Fill in the figures and holes of ``heights``; ``TerrainError`` where no vehicle could drive on it."""
    covered = heights.covered
    area = float(covered.sum()) * heights.cell**2
    if area < SMALLEST_PIECE:
        filtered = any(change.what == "ground_by_filter" for change in report.changes)
        hint = "; ground='all' keeps what the filter took for vegetation and buildings" if filtered else ""
        raise TerrainError(
            f"{report.source}: its ground covers {area:.3g} m², but the vehicle needs at least {SMALLEST_PIECE:g} m²;"
            f" if the unit is another one ({report.units}), say units=... or z_units=... ({listed()}){hint}"
        )
    slope = np.degrees(np.arctan(heights.gradient()[covered]))
    report.ground_m2, report.ground_share = area, float(covered.mean())
    report.slope_median_deg, report.slope_95_deg = (float(v) for v in np.percentile(slope, [50, 95]))
    report.slope_max_deg = float(slope.max())
    report.drivable_share = float(np.mean(slope <= STEEPEST_DEG))
    report.roughness_m = roughness(heights)
    report.holes = find_holes(heights)
    if report.drivable_share < LEAST_DRIVABLE:
        raise TerrainError(
            f"{report.source}: only {report.drivable_share:.1%} of the ground is at most {STEEPEST_DEG:g}° steep"
            f" (median {report.slope_median_deg:.0f}°), so nothing can drive on it; is another axis up (up=...), are"
            " heights in another unit (z_units=...), or are trees and buildings left in (ground='filter')?"
        )
    steep = 1.0 - report.drivable_share
    if steep > 0.02:
        report.warnings.append(
            f"{steep:.1%} of the ground is steeper than {STEEPEST_DEG:g}°: cliffs, or vegetation and buildings that"
            " ground='filter' takes off"
        )
    z = heights.z[heights.known]
    spread = float(np.subtract(*np.percentile(z, [99.5, 0.5])))
    if spread < LEVEL:
        report.warnings.append(
            f"the ground is level within {spread * 100:.1f} cm: a height-normalised file (ground at zero"
            " everywhere), heights in a larger unit (z_units=...), or a test plane"
        )


def roughness(heights: Heights) -> float:
    """Root mean square deviation [m] of the heights from the mean of the 2 m square around each; 0 on any plane."""
    width = 2 * max(1, round(0.5 * ROUGHNESS_WINDOW / heights.cell)) + 1
    known = heights.known.astype(np.float64)
    whole = ndimage.minimum_filter(known, width, mode="constant") > 0.0
    if not whole.any():
        return 0.0
    mean = ndimage.uniform_filter(np.where(heights.known, heights.z, 0.0), width, mode="constant")
    return float(np.sqrt(np.mean((heights.z - mean)[whole] ** 2)))


def find_holes(heights: Heights) -> list[Hole]:
    """The places without ground, largest first."""
    labels, count = cast(Any, ndimage.label(~heights.covered, EIGHT))
    area = np.bincount(labels.ravel(), minlength=count + 1) * heights.cell**2
    rows, columns = labels.shape
    holes = []
    for label, box in enumerate(ndimage.find_objects(labels), start=1):
        row, column = box
        holes.append(
            Hole(
                west=heights.corner[0] + heights.cell * column.start,
                south=heights.corner[1] + heights.cell * row.start,
                east=heights.corner[0] + heights.cell * column.stop,
                north=heights.corner[1] + heights.cell * row.stop,
                area_m2=float(area[label]),
                at_edge=row.start == 0 or column.start == 0 or row.stop == rows or column.stop == columns,
            )
        )
    return sorted(holes, key=lambda hole: -hole.area_m2)
