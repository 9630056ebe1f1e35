"""From a file's coordinates to local metres: up axis, units, coordinate system, window and origin, told or recognised."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from aoro_gym.checks import check_choice, check_range
from aoro_gym.terrains.extras import import_extra
from aoro_gym.terrains.georeference import MOST_SCALE_ERROR, axis_unit, horizontal, scale_factors, utm_zone
from aoro_gym.terrains.heights import MOST_NODES, grid_shape
from aoro_gym.terrains.io.check import Report, TerrainError
from aoro_gym.terrains.length_units import UNITS, LengthUnit, listed, unit_named
from aoro_gym.terrains.terrain import LARGEST_COORDINATE

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
Known = Literal["asked", "declared", "format", "assumed", "settled"]
"""How the unit of heights is known: said by the caller, by the file, fixed by the file's format, taken as that of the
plan, or settled since by :mod:`~aoro_gym.terrains.io.plausibility`."""


@dataclass(frozen=True)
class LoadOptions:
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
    nodata: tuple[float, ...] | None = None
    """Values that mean "unknown" beside those that the file declares; None: they are recognised."""
    band: int | None = None
    progress: Callable[[float], None] | None = None

    def __post_init__(self) -> None:
        for key in ("units", "z_units"):
            value = getattr(self, key)
            if value is not None and value not in UNITS:
                named = unit_named(value) if isinstance(value, str) else None
                if named is None or named.name not in UNITS:
                    raise TerrainError(f"{key} is {value!r}; choose one of: {', '.join(UNITS)}")
                object.__setattr__(self, key, named.name)
        if self.band is not None and not (isinstance(self.band, int) and self.band >= 1):
            raise TerrainError(f"band is {self.band!r}, but must be a positive integer: bands are counted from 1")
        if self.up is not None:
            check_choice("up", self.up, UP, TerrainError)
        if self.ground is not None:
            check_choice("ground", self.ground, ("class", "filter", "all"), TerrainError)
        if self.cell is not None:
            check_range("cell", self.cell, "m", ge=0.01, le=100.0, error=TerrainError)
        for key in ("hole_limit", "spike_limit"):
            check_range(key, getattr(self, key), "m", ge=0.0, le=1000.0, error=TerrainError)
        if self.window is not None:
            if len(self.window) != 4 or not np.isfinite(self.window).all():
                raise TerrainError(f"window is {self.window}, but must be four numbers: west, south, east, north [m]")
            west, south, east, north = self.window
            if not (west < east and south < north):
                raise TerrainError(f"window is {self.window}, but must have west < east and south < north [m]")

    def tell(self, share: float) -> None:
        """Report progress."""
        if self.progress is not None:
            self.progress(share)


@dataclass(frozen=True, eq=False)
class CoordinateFrame:
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
    """``pyproj.Transformer`` from the source's system (degrees, or lengths that are not those of the ground) to ``crs``;
    None where the source's lengths are those of the ground."""
    source: Any = None
    """The source's system (``pyproj.CRS``) where ``projection`` is one."""
    before: float = 1.0
    """Raw coordinates times this are in the unit of ``source``."""
    z_known: Known = "assumed"
    z_unit: str = "m"
    """Name of the unit of heights."""

    def local(self, raw: Array) -> Array:
        """(N, 3) raw points in local coordinates."""
        points = z_up(np.asarray(raw, dtype=np.float64), self.up)
        x, y = points[:, 0], points[:, 1]
        if self.projection is not None:
            x, y = self.projection.transform(x * self.before, y * self.before)
        plan = np.stack([x, y], axis=1) * self.scale - np.asarray(self.origin)
        return np.column_stack([plan, points[:, 2] * self.z_scale])


def z_up(points: Array, up: str) -> Array:
    """(N, 3) ``points`` with the axis ``up`` turned into z, right-handed."""
    if up == "y":
        return np.stack([points[:, 0], -points[:, 2], points[:, 1]], axis=1)
    if up == "x":
        return np.stack([-points[:, 2], points[:, 1], points[:, 0]], axis=1)
    return points


@dataclass(frozen=True)
class _PlanTransform:
    """How raw x and y become metres, and the bounds [m] of the source."""

    scale: float
    text: str
    low: Array
    high: Array
    system: Any = None
    projection: Any = None
    source: Any = None
    before: float = 1.0
    window: Window | None = None
    """What is wanted, in the coordinates of ``low`` and ``high``."""


def find_frame(
    request: LoadOptions,
    report: Report,
    raw_low: Array,
    raw_high: Array,
    *,
    spacing: float,
    up: str = "z",
    crs: Any = None,
    unit: str | None = None,
    z_unit: LengthUnit | None = None,
) -> CoordinateFrame:
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
        z_unit: Unit of the heights that the file declares beside its coordinate system.
    """
    corners = z_up(np.stack([raw_low, raw_high]), up)
    low, high = corners.min(axis=0), corners.max(axis=0)
    if not (np.isfinite(low).all() and np.isfinite(high).all()) or np.abs(corners).max() > FARTHEST:
        raise TerrainError(
            f"{report.source}: its coordinates reach from {low.tolist()} to {high.tolist()}; it is broken"
        )
    plan = _find_plan(request, report, low, high, spacing, crs, unit)
    z_scale, z_name, known = _z_scale(request, report, crs, plan, unit, z_unit)
    report.units = plan.text if z_name == plan.text else f"{plan.text}; heights in {z_name}"
    low, high = _crop(request, report, plan)
    if max(np.abs(low).max(), np.abs(high).max()) > LARGEST_COORDINATE:
        middle = np.floor((low + high) / 2.0)
        origin = float(middle[0]), float(middle[1])
    else:
        origin = 0.0, 0.0
    name = None
    if plan.system is not None:
        authority = plan.system.to_authority(min_confidence=70)
        name = ":".join(authority) if authority else plan.system.to_wkt()
    return CoordinateFrame(
        up,
        plan.scale,
        z_scale,
        origin,
        low - origin,
        high - origin,
        name,
        plan.projection,
        plan.source,
        plan.before,
        known,
        z_name.split(" (")[0],
    )


def _find_plan(
    request: LoadOptions, report: Report, low: Array, high: Array, spacing: float, crs: Any, unit: str | None
) -> _PlanTransform:
    given = request.crs if request.crs is not None else crs
    system = horizontal(given) if given is not None else None
    if system is not None and system.is_geographic:
        if request.units is not None:
            raise TerrainError(
                f"{report.source}: units = {request.units!r}, but its crs counts in degrees; drop one of the two"
            )
        return _into_utm(request, report, system, low, high)
    if system is not None and max(high[:2] - low[:2]) < 1.0 and np.all(np.abs([low[:2], high[:2]]) <= (180.0, 90.0)):
        raise TerrainError(
            f"{report.source}: coordinates from {low[:2].tolist()} to {high[:2].tolist()} look like degrees, but its crs"
            f" ({system.name}) counts in {system.axis_info[0].unit_name}; give the right one, such as crs='EPSG:4326'"
            " (--crs)"
        )
    if request.units is not None:
        scale, text = UNITS[request.units], f"{request.units} (as asked)"
    elif system is not None:
        scale = axis_unit(system)
        text = f"{system.axis_info[0].unit_name} (of its crs)"
    elif unit is not None:
        scale, text = UNITS[unit], f"{unit} (of its format)"
    else:
        scale, text = _guess_scale(report, high - low, spacing)
    plan = _PlanTransform(scale, text, low[:2] * scale, high[:2] * scale, system, window=request.window)
    return plan if system is None else _on_the_ground(request, report, plan, high[:2] - low[:2])


def _on_the_ground(request: LoadOptions, report: Report, plan: _PlanTransform, size: Array) -> _PlanTransform:
    """``plan``, or the UTM zone of its place where lengths of its projection are not those of the ground."""
    metre = axis_unit(plan.system)
    inside = plan
    if plan.window is not None and (cut := _intersection(plan.low, plan.high, plan.window)) is not None:
        inside = replace(plan, low=cut[0], high=cut[1])
    middle = (inside.low + inside.high) / 2.0 / metre
    factors = scale_factors(plan.system, *middle)
    if factors is None:
        report.warnings.append(
            f"({middle[0]:.6g}, {middle[1]:.6g}) is no place in {plan.system.name}: are the coordinates local ones, or"
            " is it another crs (crs=..., --crs)?"
        )
        return plan
    worst = max(factors, key=lambda factor: abs(np.log(factor)))
    if abs(worst - 1.0) <= MOST_SCALE_ERROR:
        return plan
    pyproj = import_extra("pyproj", "a change of coordinates")
    place = pyproj.Transformer.from_crs(plan.system, "EPSG:4326", always_xy=True).transform(*middle)
    if max(np.abs(plan.low).max(), np.abs(plan.high).max()) < 2.0 * LARGEST_COORDINATE and not _in_area_of_use(
        plan.system, *place
    ):
        report.warnings.append(
            f"coordinates near zero lie outside of the area of {plan.system.name}, so they are taken as local metres;"
            " its lengths would be"
            f" {worst:.3g} times those on the ground there"
        )
        return plan
    why = f"lengths of {plan.system.name} are {worst:.3g} times those on the ground here"
    before = plan.scale / metre
    return _projected(report, plan.system, inside, plan, place, why, before)


def _in_area_of_use(system: Any, longitude: float, latitude: float) -> bool:
    """Whether the place lies within the area for which the system is meant."""
    authority = system.to_authority(min_confidence=70)  # what files say of a system leaves out where it is meant for
    area = import_extra("pyproj", "an area of use").CRS.from_authority(*authority).area_of_use if authority else None
    if area is None:
        return True
    wide = (longitude - area.west) % 360.0 <= (area.east - area.west) % 360.0 or area.east - area.west >= 360.0
    return wide and area.south <= latitude <= area.north


def _projected(
    report: Report,
    source: Any,
    inside: _PlanTransform,
    plan: _PlanTransform,
    place: tuple[float, float],
    why: str,
    before: float,
) -> _PlanTransform:
    """``plan`` in the UTM zone of ``place`` (longitude, latitude); a window in coordinates of the source goes along."""
    pyproj = import_extra("pyproj", "a change of coordinates")
    metre = 1.0 if source.is_geographic else axis_unit(source)
    longitude, latitude = place
    target = utm_zone(latitude, longitude)
    projection = pyproj.Transformer.from_crs(source, target, always_xy=True)

    def bounds(part: _PlanTransform) -> tuple[Array, Array]:
        xy = np.array(projection.transform_bounds(*part.low / metre, *part.high / metre))
        if not np.isfinite(xy).all():
            raise TerrainError(
                f"{report.source}: coordinates from {(part.low / metre).tolist()} to {(part.high / metre).tolist()} in"
                f" {source.name} do not fit a UTM zone"
            )
        return xy[:2], xy[2:]

    low, high = bounds(plan)
    window = plan.window
    if window is not None and inside is not plan:  # it was given in the source's coordinates
        first, last = bounds(inside)
        window = float(first[0]), float(first[1]), float(last[0]), float(last[1])
    report.change("projected", 1, f"into {target.name}, so that lengths are those on the ground: {why}")
    text = "degrees" if source.is_geographic else plan.text
    return _PlanTransform(1.0, text, low, high, target, projection, source, before, window)


def are_plausible(points: Array) -> NDArray[np.bool_]:
    """(N,) whether all coordinates of each of ``points`` (N, 3) are numbers of this world."""
    return np.asarray(np.all(np.abs(points) <= FARTHEST, axis=1))  # False for NaN


def choose_cell(request: LoadOptions, report: Report, low: Array, high: Array, natural: float) -> float:
    """Distance [m] of heights over the rectangle: as asked, or ``natural`` unless that takes too many.

    Args:
        request: What the caller asks for.
        report: Takes a warning where the cell is another one.
        low: South-west corner (3,) [m].
        high: North-east corner (3,) [m].
        natural: The cell [m] of the source itself.
    """
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


def _into_utm(request: LoadOptions, report: Report, system: Any, low: Array, high: Array) -> _PlanTransform:
    """Degrees in the UTM zone of their middle."""
    degree = float(np.degrees(system.axis_info[0].unit_conversion_factor))
    if np.abs([low[0], high[0]]).max() * degree > 360.0 or np.abs([low[1], high[1]]).max() * degree > 90.0:
        raise TerrainError(
            f"{report.source}: coordinates from {low[:2].tolist()} to {high[:2].tolist()} are no degrees, but its crs"
            f" ({system.name}) says so; give the right crs=... (--crs)"
        )
    plan = _PlanTransform(1.0, "degrees", low[:2], high[:2], system, window=request.window)
    inside = plan
    if plan.window is not None and (cut := _intersection(plan.low, plan.high, plan.window)) is not None:
        inside = replace(plan, low=cut[0], high=cut[1])
    pyproj = import_extra("pyproj", "a terrain in degrees")
    middle = (inside.low + inside.high) / 2.0
    place = pyproj.Transformer.from_crs(system, "EPSG:4326", always_xy=True).transform(*middle)
    return _projected(report, system, inside, plan, place, f"it counts in degrees ({system.name})", 1.0)


def _intersection(low: Array, high: Array, window: Window) -> tuple[Array, Array] | None:
    """The part of the rectangle within ``window``; None where there is none."""
    first, last = np.maximum(low, window[:2]), np.minimum(high, window[2:])
    return (first, last) if np.all(first < last) else None


def _guess_scale(report: Report, size: Array, spacing: float) -> tuple[float, str]:
    """Metres unless only millimetres or kilometres make a ground to drive on; ``TerrainError`` where nothing does."""
    extent = float(size[:2].max())
    if report.kind == "raster" and extent < 1.0:
        raise TerrainError(
            f"{report.source}: it is {extent:.3g} units wide, as if in degrees, and nothing is said of its coordinate"
            " system; give crs='EPSG:4326' (--crs), or units=... (--units)"
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
                " give crs='EPSG:4326' (--crs), or the right units=... (--units) and z_units=... (--z-units)"
            )
        size_text = f"{extent:.4g} units wide with {spacing:.3g} between points"
        report.change("units", 1, f"read as {unit}: {size_text}, which a vehicle can drive on as {unit} only")
        return scale, f"{unit} (recognised by its size)"
    if extent > LARGEST_EXTENT and spacing <= COARSEST[report.kind]:
        return 1.0, "m (nothing said)"
    raise TerrainError(
        f"{report.source}: it is {extent:.3g} units wide with {spacing:.3g} between points, which is no ground"
        f" to drive on in m, mm or km; say units=... ({listed()})"
    )


def _z_scale(
    request: LoadOptions, report: Report, crs: Any, plan: _PlanTransform, unit: str | None, declared: LengthUnit | None
) -> tuple[float, str, Known]:
    """Metres a unit of height, its name, and how that is known: what is said first in this order."""
    if request.z_units is not None:
        return UNITS[request.z_units], f"{request.z_units} (as asked)", "asked"
    upright = _vertical(request.crs) or _vertical(crs)
    if declared is not None:
        if upright is None or np.isclose(upright.metres, declared.metres, rtol=1e-9):
            return declared.metres, f"{declared.name} (as its heights declare)", "declared"
        report.warnings.append(
            f"its heights declare {declared.name}, its crs {upright.name}: {declared.name} is taken; z_units=... decides"
        )
        return declared.metres, f"{declared.name} (as its heights declare)", "declared"
    if upright is not None:
        return upright.metres, f"{upright.name} (of its crs)", "declared"
    if request.units is not None:
        return plan.scale if plan.projection is None else UNITS[request.units], plan.text, "asked"
    if plan.text == "degrees":
        return 1.0, "m (nothing said)", "assumed"
    scale = plan.scale if plan.projection is None else axis_unit(plan.source)
    if np.isclose(scale, UNITS["ft"], rtol=1e-5):
        report.warnings.append(
            "nothing is said of the unit of heights: feet, as in the plan; give z_units='m' if they are metres"
        )
    return scale, plan.text, "format" if unit is not None and plan.text.endswith("(of its format)") else "assumed"


def _vertical(crs: Any) -> LengthUnit | None:
    """The unit of a coordinate system's vertical axis; None if it has none, or nobody can read it."""
    if crs is None:
        return None
    pyproj = import_extra("pyproj", "a coordinate reference system")
    try:
        system = pyproj.CRS.from_user_input(crs)
    except pyproj.exceptions.CRSError:
        return None
    axis = next((axis for axis in system.axis_info if axis.direction == "up"), None)
    return None if axis is None else LengthUnit(axis.unit_name, float(axis.unit_conversion_factor))


def _crop(request: LoadOptions, report: Report, plan: _PlanTransform) -> tuple[Array, Array]:
    """Bounds [m] less what lies outside of the window, and what float32 cannot hold."""
    low, high = plan.low, plan.high
    if plan.window is not None:
        cut = _intersection(low, high, plan.window)
        if cut is None:
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
