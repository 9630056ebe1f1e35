"""From a file's coordinates to local metres: up axis, units, coordinate system, window and origin, told or recognised."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from aoro_gym.terrains.check import Report, TerrainError
from aoro_gym.terrains.extras import extra
from aoro_gym.terrains.georeference import axis_unit, horizontal, utm_zone
from aoro_gym.terrains.heights import MOST_NODES, grid_shape
from aoro_gym.terrains.terrain import LARGEST_COORDINATE

UNITS = {"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3, "ft": 0.3048, "us-ft": 1200.0 / 3937.0, "in": 0.0254}
"""Size [m] of the units that a file may count in."""
UP = ("x", "y", "z")

SMALLEST_EXTENT, LARGEST_EXTENT = 5.0, 20_000.0
"""Size [m] of what can be meant to be driven on."""
COARSEST = {"mesh": 10.0, "points": 10.0, "raster": 100.0, "heights": 100.0}
"""Distance [m] of neighbouring points beyond which ground does not tell a vehicle anything."""
ANY_SPACING = 1000.0
"""Extent [m] up to which even few, large triangles are ground: a plane to try things on."""

FARTHEST = 1e12
"""Coordinate, in any unit, beyond which a number is damage: the Earth is 1.3e10 mm wide."""

Array = NDArray[np.float64]
Window = tuple[float, float, float, float]
GroundRule = Literal["class", "filter", "all"]


@dataclass(frozen=True)
class Request:
    """What the caller of ``load`` asks for; see there."""

    units: str | None = None
    z_units: str | None = None
    up: str | None = None
    crs: str | None = None
    cell: float | None = None
    window: Window | None = None
    hole_limit: float = 5.0
    spike_limit: float = 0.5
    ground: GroundRule | None = None
    progress: Callable[[float], None] | None = None

    def __post_init__(self) -> None:
        for key in ("units", "z_units"):
            value = getattr(self, key)
            if value is not None and value not in UNITS:
                raise TerrainError(f"{key} = {value!r} is none of {', '.join(UNITS)}")
        if self.up is not None and self.up not in UP:
            raise TerrainError(f"up = {self.up!r} is none of {', '.join(UP)}")
        if self.ground not in (None, "class", "filter", "all"):
            raise TerrainError(f"ground = {self.ground!r} is none of class, filter, all")
        if self.cell is not None and not 0.01 <= self.cell <= 100.0:
            raise TerrainError(f"cell = {self.cell:g} is outside [0.01, 100] m")
        for key in ("hole_limit", "spike_limit"):
            value = getattr(self, key)
            if not 0.0 <= value <= 1000.0:
                raise TerrainError(f"{key} = {value:g} is outside [0, 1000] m")
        if self.window is not None:
            if len(self.window) != 4 or not np.isfinite(self.window).all():
                raise TerrainError(f"window = {self.window} must be four numbers: west, south, east, north [m]")
            west, south, east, north = self.window
            if not (west < east and south < north):
                raise TerrainError(
                    f"window = {self.window} must be west, south, east, north with west < east, south < north"
                )

    def tell(self, share: float) -> None:
        """Report progress."""
        if self.progress is not None:
            self.progress(share)


@dataclass(frozen=True, eq=False)
class Frame:
    """Takes raw points to local x, y and world z [m]."""

    up: str
    scale: float
    z_scale: float
    origin: tuple[float, float]
    """World x, y [m] of the local origin."""
    low: Array
    """(2,) lowest local x, y that is wanted."""
    high: Array
    crs: str | None
    projection: Any = None
    """``pyproj.Transformer`` from degrees to ``crs``; None where the source is in metres or feet already."""

    def local(self, raw: Array) -> Array:
        """(N, 3) raw points in local coordinates."""
        points = turned(np.asarray(raw, dtype=np.float64), self.up)
        x, y = points[:, 0], points[:, 1]
        if self.projection is not None:
            x, y = self.projection.transform(x, y)
        plan = np.stack([x, y], axis=1) * self.scale - np.asarray(self.origin)
        return np.column_stack([plan, points[:, 2] * self.z_scale])


def turned(points: Array, up: str) -> Array:
    """(N, 3) ``points`` with the axis ``up`` turned into z, right-handed."""
    if up == "y":
        return np.stack([points[:, 0], -points[:, 2], points[:, 1]], axis=1)
    if up == "x":
        return np.stack([-points[:, 2], points[:, 1], points[:, 0]], axis=1)
    return points


def find_frame(
    request: Request,
    report: Report,
    raw_low: Array,
    raw_high: Array,
    *,
    spacing: float,
    up: str = "z",
    crs: Any = None,
    unit: str | None = None,
) -> Frame:
    """The frame of points between ``raw_low`` and ``raw_high`` (3,); notes in ``report`` how each part is known.

    Args:
        request: What the caller says wins over what the file says.
        report: Its ``kind`` is read.
        raw_low: Lowest raw coordinates.
        raw_high: Highest raw coordinates.
        spacing: Typical distance of neighbouring points, in the raw unit.
        up: Raw axis that points up.
        crs: What the file says of its coordinate system, as pyproj reads it.
        unit: Unit that the format fixes.
    """
    corners = turned(np.stack([raw_low, raw_high]), up)
    low, high = corners.min(axis=0), corners.max(axis=0)
    if not (np.isfinite(low).all() and np.isfinite(high).all()) or np.abs(corners).max() > FARTHEST:
        raise TerrainError(
            f"{report.source}: its coordinates reach from {low.tolist()} to {high.tolist()}; it is broken"
        )
    given = request.crs if request.crs is not None else crs
    system = horizontal(given) if given is not None else None
    projection = None
    if system is not None and system.is_geographic:
        projection, system, low, high = _into_utm(report, system, low, high)
        scale, plan_unit = 1.0, "degrees"
        if request.units is not None:
            raise TerrainError(
                f"{report.source}: units = {request.units!r}, but its crs counts in degrees; drop one of the two"
            )
    elif request.units is not None:
        scale, plan_unit = UNITS[request.units], f"{request.units} (as asked)"
    elif system is not None:
        scale = axis_unit(system)
        plan_unit = f"{system.axis_info[0].unit_name} (of its crs)"
    elif unit is not None:
        scale, plan_unit = UNITS[unit], f"{unit} (of its format)"
    else:
        scale, plan_unit = _guess_scale(report, high - low, spacing)
    z_scale, z_unit = _z_scale(request, report, given, scale, plan_unit)
    report.units = plan_unit if z_unit == plan_unit else f"{plan_unit}; heights in {z_unit}"
    low, high = low[:2] * scale, high[:2] * scale
    low, high = _crop(request, report, low, high)
    if max(np.abs(low).max(), np.abs(high).max()) > LARGEST_COORDINATE:
        middle = np.floor((low + high) / 2.0)
        origin = float(middle[0]), float(middle[1])
    else:
        origin = 0.0, 0.0
    name = None
    if system is not None:
        authority = system.to_authority(min_confidence=70)
        name = ":".join(authority) if authority else system.to_wkt()
    return Frame(up, scale, z_scale, origin, low - origin, high - origin, name, projection)


def sound(points: Array) -> NDArray[np.bool_]:
    """(N,) whether all coordinates of each of ``points`` (N, 3) are numbers of this world."""
    return np.asarray(np.all(np.abs(points) <= FARTHEST, axis=1))  # False for NaN


def choose_cell(request: Request, report: Report, low: Array, high: Array, natural: float) -> float:
    """Distance [m] of heights over the rectangle: as asked, or ``natural`` unless that takes too many."""
    area = float(np.prod(np.maximum(high[:2] - low[:2], 1e-3)))
    if request.cell is not None:
        rows, columns = grid_shape(low, high, request.cell)
        if rows * columns > MOST_NODES:
            raise TerrainError(
                f"{report.source}: {rows} x {columns} heights of cell = {request.cell:g} m are more than"
                f" {MOST_NODES:,}; give a window=(west, south, east, north) or a cell of at"
                f" least {np.sqrt(area / MOST_NODES):.2g} m"
            )
        return request.cell
    finest = np.sqrt(area / MOST_NODES) * 1.001
    if finest > natural:
        report.change(
            "coarsened",
            1,
            f"heights every {finest:.2g} m instead of {natural:.2g} m: no more than {MOST_NODES:,} are taken",
        )
        return float(finest)
    return natural


def _into_utm(report: Report, system: Any, low: Array, high: Array) -> tuple[Any, Any, Array, Array]:
    """The change of degrees into their UTM zone, that zone, and the bounds [m] in it."""
    if np.abs([low[0], high[0]]).max() > 360.0 or np.abs([low[1], high[1]]).max() > 90.0:
        raise TerrainError(
            f"{report.source}: coordinates from {low[:2].tolist()} to {high[:2].tolist()} are no degrees, but its crs"
            f" ({system.name}) says so; give the right crs=..."
        )
    pyproj = extra("pyproj", "a terrain in degrees")
    longitude, latitude = (low[:2] + high[:2]) / 2.0
    target = utm_zone(float(latitude), float(longitude))
    projection = pyproj.Transformer.from_crs(system, target, always_xy=True)
    report.change("projected", 1, f"from degrees ({system.name}) into {target.name}, so that lengths are in metres")
    xy = np.array(projection.transform_bounds(low[0], low[1], high[0], high[1]))
    if not np.isfinite(xy).all():
        raise TerrainError(
            f"{report.source}: degrees from {low[:2].tolist()} to {high[:2].tolist()} do not fit a UTM zone"
        )
    return projection, target, np.array([*xy[:2], low[2]]), np.array([*xy[2:], high[2]])


def _guess_scale(report: Report, size: Array, spacing: float) -> tuple[float, str]:
    """Metres unless only millimetres or kilometres make a ground to drive on; ``TerrainError`` where nothing does."""
    extent = float(size[:2].max())
    if report.kind == "raster" and extent < 1.0:
        raise TerrainError(
            f"{report.source}: it is {extent:.3g} units wide, as if in degrees, and nothing is said of its coordinate"
            " system; give crs='EPSG:4326', or units=..."
        )
    for scale, unit in ((1.0, "m"), (1e-3, "mm"), (1e3, "km")):
        fine = spacing * scale <= COARSEST[report.kind] or extent * scale <= ANY_SPACING
        if not (fine and SMALLEST_EXTENT <= extent * scale <= LARGEST_EXTENT):
            continue
        if unit == "m":
            return scale, "m (nothing said)"
        if unit == "km" and size[2] > 10.0 * extent:
            raise TerrainError(
                f"{report.source}: it is {extent:.3g} units wide but {size[2]:.3g} high, as if in degrees and metres;"
                " give crs='EPSG:4326', or the right units=... and z_units=..."
            )
        size_text = f"{extent:.4g} units wide with {spacing:.3g} between points"
        report.change("units", 1, f"read as {unit}: {size_text}, which a vehicle can drive on as {unit} only")
        return scale, f"{unit} (recognised by its size)"
    if extent > LARGEST_EXTENT and spacing <= COARSEST[report.kind]:
        return 1.0, "m (nothing said)"
    raise TerrainError(
        f"{report.source}: it is {extent:.3g} units wide with {spacing:.3g} between points, which is no ground"
        " to drive on in m, mm or km; say units=... (m, km, cm, mm, ft, us-ft or in)"
    )


def _z_scale(request: Request, report: Report, crs: Any, scale: float, plan_unit: str) -> tuple[float, str]:
    """Metres a unit of height, and how that is known."""
    if request.z_units is not None:
        return UNITS[request.z_units], f"{request.z_units} (as asked)"
    if crs is not None:
        pyproj = extra("pyproj", "a coordinate reference system")
        system = pyproj.CRS.from_user_input(crs)
        upright = [axis for axis in system.axis_info if axis.direction == "up"]
        if upright:
            return float(upright[0].unit_conversion_factor), f"{upright[0].unit_name} (of its crs)"
    if plan_unit == "degrees":
        return 1.0, "m (nothing said)"
    if np.isclose(scale, UNITS["ft"], rtol=1e-5) and request.units is None:
        report.warnings.append(
            "nothing is said of the unit of heights: feet, as in the plan; give z_units='m' if they are metres"
        )
    return scale, plan_unit


def _crop(request: Request, report: Report, low: Array, high: Array) -> tuple[Array, Array]:
    """Bounds [m] less what lies outside of the window, and what float32 cannot hold."""
    if request.window is not None:
        west, south, east, north = request.window
        cut = np.maximum(low, [west, south]), np.minimum(high, [east, north])
        if not np.all(cut[0] < cut[1]):
            raise TerrainError(
                f"{report.source}: window = {request.window} lies outside of its extent,"
                f" {low[0]:.0f}, {low[1]:.0f}, {high[0]:.0f}, {high[1]:.0f} m"
            )
        low, high = cut
    if np.any(high - low > 2.0 * LARGEST_COORDINATE):
        centre = (low + high) / 2.0
        size = high - low
        low, high = np.maximum(low, centre - LARGEST_COORDINATE), np.minimum(high, centre + LARGEST_COORDINATE)
        report.change(
            "cropped",
            1,
            f"of {size[0] / 1e3:.1f} km x {size[1] / 1e3:.1f} km, the middle {(high - low)[0] / 1e3:.1f} km x"
            f" {(high - low)[1] / 1e3:.1f} km are taken; window=(west, south, east, north) [m] picks another part",
        )
    return low, high
