"""Elevation rasters (GeoTIFF, ESRI ASCII grid and more, through GDAL) and plain arrays of heights."""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.terrains.extras import import_extra
from aoro_gym.terrains.georeference import horizontal
from aoro_gym.terrains.heights import Heights
from aoro_gym.terrains.io.ascii_grid import check_ascii_grid
from aoro_gym.terrains.io.bands import SAMPLE, Band, choose_band
from aoro_gym.terrains.io.check import Report, TerrainError
from aoro_gym.terrains.io.elevation_model import ElevationModel
from aoro_gym.terrains.io.frame import CoordinateFrame, LoadOptions, choose_cell, find_frame
from aoro_gym.terrains.io.masking import NodataValues, equals_value, find_nodata, report_nodata
from aoro_gym.terrains.io.plausibility import settle_heights

SUFFIXES = {".tif": "GTiff", ".tiff": "GTiff", ".asc": "AAIGrid", ".img": "HFA", ".dem": "USGSDEM", ".hgt": "SRTMHGT"}
"""GDAL's driver of each suffix: others could open what the file names, even elsewhere."""
MOST_PIXELS = 2_000_000_000
"""Most pixels of the window that is read; beyond, thinning them takes minutes."""
SQUARE = 1e-3
"""Difference of a pixel's sides, by the larger one, up to which it is square."""
SOMEWHERE = "EPSG:32631"
"""The system that GDAL is told on both sides where pixels are set upright, not projected."""

Array = NDArray[np.float64]


def read_raster(path: Path, request: LoadOptions, report: Report) -> ElevationModel:
    """Heights of one band; voids are NaN, pixel centres are nodes."""
    rasterio = import_extra("rasterio", f"the elevation raster {path.name}")
    report.kind = "raster"
    if path.suffix.lower() == ".asc":
        check_ascii_grid(path)
    # Files beside it (mask, world file, metadata) are looked for by name, without a list of the folder.
    with (
        warnings.catch_warnings(),
        _without_undecodable_messages(),
        rasterio.Env(GDAL_DISABLE_READDIR_ON_OPEN="TRUE", CPL_LOG="/dev/null"),
    ):
        warnings.simplefilter("ignore")  # what is not georeferenced is said below
        try:
            with rasterio.open(path, driver=SUFFIXES[path.suffix.lower()]) as data:
                return _read(data, request, report)
        except TerrainError:
            raise
        except Exception as error:  # whatever GDAL finds wrong with a broken file
            text = " ".join(str(error.__cause__ or error).split())[:200] or type(error).__name__
            if any(sign in text for sign in ("Read failed", "IReadBlock", "TIFFRead")):
                text = f"its pixels cannot all be read, so it is cut off or broken; get it again ({text[-60:]})"
            raise TerrainError(f"{path}: cannot be read as a raster: {text}") from None


@contextmanager
def _without_undecodable_messages() -> Iterator[None]:
    """Nothing on the terminal where GDAL quotes bytes of a broken file that rasterio cannot decode for its log."""
    before = sys.unraisablehook, sys.excepthook

    def unraisable(what: Any) -> None:
        if not issubclass(what.exc_type, UnicodeDecodeError):
            before[0](what)

    def uncaught(kind: type[BaseException], value: BaseException, trace: TracebackType | None) -> None:
        if not issubclass(kind, UnicodeDecodeError):
            before[1](kind, value, trace)

    sys.unraisablehook, sys.excepthook = unraisable, uncaught  # rasterio's own code, in C, calls both
    try:
        yield
    finally:
        sys.unraisablehook, sys.excepthook = before


def _read(data: Any, request: LoadOptions, report: Report) -> ElevationModel:
    band = choose_band(data, request, report)
    if request.up in ("x", "y"):
        report.warnings.append(f"up={request.up!r} is passed over: the heights of a raster are its values")
    if min(data.shape) < 2:
        raise TerrainError(f"{report.source}: {data.width} x {data.height} pixels are no ground")
    place, crs = _placed(data, request, report)
    sides = math.hypot(place.a, place.d), math.hypot(place.b, place.e)
    if not (all(np.isfinite(tuple(place))) and abs(place.determinant) > 1e-9 * sides[0] * sides[1] > 0.0):
        raise TerrainError(
            f"{report.source}: the place or the size of its pixels is no number: {tuple(place)[:6]}; it is broken"
        )
    corners = np.array([place @ (x, y) for x in (0.5, data.width - 0.5) for y in (0.5, data.height - 0.5)])
    low, high = np.array([*corners.min(axis=0), 0.0]), np.array([*corners.max(axis=0), 0.0])
    spacing = math.sqrt(abs(place.determinant))
    frame = find_frame(request, report, low, high, spacing=spacing, crs=crs, z_unit=band.unit)
    straight = (place.b == place.d == 0.0 or place.a == place.e == 0.0) and math.isclose(*sides, rel_tol=SQUARE)
    upright = frame.projection is None and straight
    heights = (_read_axis_aligned if upright else _read_rotated)(band, place, frame, request, report)
    heights = heights.replaced(band.heights(heights.z) * frame.z_scale)
    return settle_heights(ElevationModel(heights, frame), request, report, of_bytes=band.of_bytes)


def _placed(data: Any, request: LoadOptions, report: Report) -> tuple[Any, str | None]:
    """Where pixels lie (``affine.Affine``), and in which system."""
    place, crs = data.transform, data.crs
    if place.is_identity and data.gcps[0]:
        from rasterio.transform import from_gcps

        place, crs = from_gcps(data.gcps[0]), data.gcps[1] or crs
        report.warnings.append(
            f"placed by {len(data.gcps[0])} ground control points, by an affine change; set it upright with gdalwarp for"
            " a closer one"
        )
    elif place.is_identity and not crs:
        report.warnings.append(
            "nothing is said of the size of a pixel: 1 m is taken; give units=... if it is another one"
        )
    wkt = crs.to_wkt() if crs else None
    projection = Path(data.name).with_suffix(".prj")
    if wkt is None and request.crs is None and projection.is_file():
        report.warnings.append(
            f"{projection.name} beside it names no coordinate system that is known, so none is taken; crs=... (--crs) says"
            " which it is"
        )
    if wkt is not None and request.crs is None:
        try:
            horizontal(wkt)
        except ValueError as error:
            report.warnings.append(f"its coordinate system is passed over: {error}")
            wkt = None
    return place, wkt


def _read_axis_aligned(band: Band, place: Any, frame: CoordinateFrame, request: LoadOptions, report: Report) -> Heights:
    """Square pixels along the axes, as they are: the window, thinned where it is finer than the cell asked for."""
    from rasterio.windows import Window

    data = band.data
    turned = place.a == 0.0  # rows run along x
    along = (
        [(place.b, data.height), (place.d, data.width)] if turned else [(place.a, data.width), (place.e, data.height)]
    )
    corner = np.array([place @ (0.5, 0.5), place @ (data.width - 0.5, data.height - 0.5)]).min(axis=0)
    pixel = abs(along[0][0])
    world = pixel * frame.scale  # m
    first = [math.ceil(((frame.low[i] + frame.origin[i]) / frame.scale - corner[i]) / pixel - 1e-6) for i in (0, 1)]
    last = [math.floor(((frame.high[i] + frame.origin[i]) / frame.scale - corner[i]) / pixel + 1e-6) for i in (0, 1)]
    number = [last[i] - first[i] + 1 for i in (0, 1)]
    _check_size(report, number, world)
    # Whole blocks of pixels become one height, so that cells stay square and lie where they say.
    cell = choose_cell(request, report, frame.low, frame.high, world)
    block = max(1, round(cell / world) if request.cell is not None else math.ceil(cell / world - 1e-6))
    columns, rows = (n // block for n in number)
    if min(rows, columns) < 2:
        raise TerrainError(f"{report.source}: cell = {cell:g} m leaves {columns} x {rows} heights; it takes 2 x 2")
    if request.cell is not None and not math.isclose(block * world, request.cell, rel_tol=1e-3):
        report.change("cell", 1, f"cell of {block * world:.3g} m, the multiple of the pixel next to {request.cell:g} m")
    _note_blocks(report, block, rows * columns, world)
    # From the west and the south to the file's own rows and columns.
    start = [
        first[i] if step > 0.0 else whole - first[i] - n * block
        for i, ((step, whole), n) in enumerate(zip(along, (columns, rows), strict=True))
    ]
    if turned:
        window: Any = Window(start[1], start[0], rows * block, columns * block)  # pyright: ignore[reportCallIssue]
    else:
        window = Window(start[0], start[1], columns * block, rows * block)  # pyright: ignore[reportCallIssue]
    z = _values(band, window, block, frame.z_scale, report)
    z = z.T if turned else z
    z = z[:: 1 if along[1][0] > 0.0 else -1, :: 1 if along[0][0] > 0.0 else -1]
    offset = 0.5 * (block - 1)  # of the middle of the south-western block
    x, y = ((corner[i] + (first[i] + offset) * pixel) * frame.scale - frame.origin[i] for i in (0, 1))
    return Heights(np.ascontiguousarray(z), block * world, (float(x), float(y)))


def _read_rotated(band: Band, place: Any, frame: CoordinateFrame, request: LoadOptions, report: Report) -> Heights:
    """Heights interpolated bilinearly in ``frame``, where pixels are turned, oblong or in another projection."""
    from rasterio.crs import CRS
    from rasterio.enums import Resampling
    from rasterio.warp import reproject
    from rasterio.windows import Window

    data = band.data
    grid = _PixelTransform(place, frame)
    natural = grid.pixel(data.width, data.height)
    cell = choose_cell(request, report, frame.low, frame.high, natural)
    columns, rows = (int(n) for n in np.floor((frame.high - frame.low) / cell + 1e-6).astype(int) + 1)
    west, north, east, south = grid.window(frame.low, frame.high, data.width, data.height)
    if min(rows, columns) < 2 or east - west < 2 or south - north < 2:
        raise TerrainError(
            f"{report.source}: the window holds {columns} x {rows} heights of {cell:.3g} m; it takes 2 x 2"
        )
    _check_size(report, [east - west, south - north], natural)
    block = max(1, math.floor(cell / natural + 1e-6))
    _note_blocks(report, block, rows * columns, natural)
    window: Any = Window(west, north, east - west, south - north)  # pyright: ignore[reportCallIssue]
    z = _values(band, window, block, frame.z_scale, report)
    out = np.full((rows, columns), np.nan)
    affine = type(place)
    source = frame.source.to_wkt() if frame.projection is not None else SOMEWHERE
    top = frame.low[1] + frame.origin[1] + (rows - 0.5) * cell
    reproject(
        z,
        out,
        src_transform=grid.world @ affine.translation(west, north) @ affine.scale(block),
        src_crs=CRS.from_user_input(source),
        src_nodata=np.nan,
        dst_transform=affine(cell, 0.0, frame.low[0] + frame.origin[0] - 0.5 * cell, 0.0, -cell, top),
        dst_crs=CRS.from_user_input(frame.crs if frame.projection is not None else SOMEWHERE),
        dst_nodata=np.nan,
        resampling=Resampling.bilinear,
        tolerance=0.0,
    )
    if frame.projection is None:
        report.change("projected", 1, "pixels are turned or oblong: set upright, interpolated bilinearly")
    else:
        report.change("interpolated", rows * columns, f"heights every {cell:.3g} m interpolated bilinearly")
    return Heights(out[::-1].copy(), cell, (float(frame.low[0]), float(frame.low[1])))


@dataclass(frozen=True)
class _PixelTransform:
    """Between rows and columns of a raster and metres of its frame."""

    place: Any
    frame: CoordinateFrame

    @property
    def world(self) -> Any:
        """Pixels to the coordinates that are projected, or to metres where none are."""
        factor = self.frame.before if self.frame.projection is not None else self.frame.scale
        return type(self.place).scale(factor) @ self.place

    def pixel(self, width: int, height: int) -> float:
        """Side [m] of a square as large as a pixel in the middle."""
        x, y = np.array([self.world @ (width / 2.0 + i, height / 2.0 + j) for i, j in ((0, 0), (1, 0), (0, 1))]).T
        if self.frame.projection is not None:
            x, y = self.frame.projection.transform(x, y)
        area = abs((x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]))
        return float(np.sqrt(area))

    def window(self, low: Array, high: Array, width: int, height: int) -> tuple[int, int, int, int]:
        """First column and row, and those after the last, of what ``low`` and ``high`` [m, local] need."""
        share = np.linspace(0.0, 1.0, 21)
        x, y = np.meshgrid(*(low[i] + share * (high[i] - low[i]) + self.frame.origin[i] for i in (0, 1)))
        x, y = x.ravel(), y.ravel()
        if self.frame.projection is not None:
            x, y = self.frame.projection.transform(x, y, direction="INVERSE")
        there = np.isfinite(x) & np.isfinite(y)
        if not there.any():
            return 0, 0, width, height
        column, row = np.array(~self.world @ (x[there], y[there]))
        return (
            int(np.clip(np.floor(column.min()) - 2, 0, width)),
            int(np.clip(np.floor(row.min()) - 2, 0, height)),
            int(np.clip(np.ceil(column.max()) + 2, 0, width)),
            int(np.clip(np.ceil(row.max()) + 2, 0, height)),
        )


def _values(band: Band, window: Any, block: int, metre: float, report: Report) -> Array:
    """Raw values of the window, NaN where they are unknown; what was left out is noted."""
    band.recognise(window, metre)
    z = band.read(window, block)
    total = int(window.width) * int(window.height)
    report.points_read = total
    band.note(report, total)
    return z


def _check_size(report: Report, number: list[int], pixel: float) -> None:
    columns, rows = number
    if columns < 2 or rows < 2:
        raise TerrainError(
            f"{report.source}: the window holds {columns} x {rows} pixels of {pixel:.3g} m; it takes 2 x 2"
        )
    if columns * rows > MOST_PIXELS:
        raise TerrainError(f"{report.source}: {columns:,} x {rows:,} pixels; give a window=(west, south, east, north)")


def _note_blocks(report: Report, block: int, count: int, pixel: float) -> None:
    if block > 1:
        report.change("averaged", count, f"blocks of {block} x {block} pixels of {pixel:.3g} m averaged")


def read_heights(array: Any, request: LoadOptions, report: Report) -> ElevationModel:
    """An array of heights, row 0 in the south; its cell is ``request.cell``."""
    report.kind = "heights"
    try:
        values = np.asarray(array)
    except (TypeError, ValueError):
        raise TerrainError(f"{report.source}: heights must be numbers") from None
    if values.ndim != 2 or min(values.shape) < 2:
        raise TerrainError(
            f"{report.source}: heights have the shape {values.shape}; give at least 2 rows and 2 columns"
        )
    if values.dtype.kind not in "iuf":
        raise TerrainError(f"{report.source}: heights must be numbers, but are of the type {str(values.dtype)[:40]}")
    z = values.astype(np.float64)
    if request.band is not None:
        raise TerrainError(f"{report.source}: an array has no bands; drop band=...")
    if request.cell is None:
        raise TerrainError(f"{report.source}: an array says nothing of the distance of its heights; give cell=... [m]")
    if request.window is not None:
        raise TerrainError(f"{report.source}: an array has no window; slice it")
    size = np.array([(z.shape[1] - 1) * request.cell, (z.shape[0] - 1) * request.cell, 0.0])
    choose_cell(request, report, np.zeros(3), size, request.cell)
    in_metres = replace(request, units="m", z_units=request.z_units or request.units or "m")
    frame = find_frame(in_metres, report, np.zeros(3), size, spacing=request.cell)
    if request.z_units is None and request.units is None:
        frame = replace(frame, z_known="assumed")
    report.points_read = z.size
    z = _masked(z, values.dtype, frame.z_scale, request, report)
    return ElevationModel(Heights(z * frame.z_scale, request.cell), frame)


def _masked(z: Array, dtype: np.dtype[Any], metre: float, request: LoadOptions, report: Report) -> Array:
    """``z`` with NaN for what is unknown."""
    marks, declared = NodataValues(), np.zeros(z.shape, dtype=bool)
    if request.nodata is None:
        thin = 1 + z.size // SAMPLE
        limits = (float(np.iinfo(dtype).min), float(np.iinfo(dtype).max)) if dtype.kind in "iu" else None
        marks = find_nodata(z[::thin], metre, limits)
    for value in request.nodata or ():
        declared |= equals_value(z, value)
    report.change("unknown", int(declared.sum()), f"{int(declared.sum()):,} heights unknown (nodata as asked)")
    z[declared] = np.nan
    counts = {value: int(equals_value(z, value).sum()) for value in (*marks.values, *dict(marks.suspects))}
    for value in marks.values:
        z[equals_value(z, value)] = np.nan
    beyond = marks.unknown(z) & ~np.isnan(z)
    report_nodata(marks, counts, int(beyond.sum()), report)
    z[beyond] = np.nan
    if not np.isfinite(z).any():
        raise TerrainError(f"{report.source}: none of its {z.size:,} heights is known; there is no ground in it")
    return z
