"""Elevation rasters (GeoTIFF, ESRI ASCII grid and more, through GDAL) and plain arrays of heights."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.terrains.check import Report, TerrainError
from aoro_gym.terrains.extras import extra
from aoro_gym.terrains.frame import UNITS, Request, choose_cell, find_frame
from aoro_gym.terrains.georeference import horizontal, scale_factors, utm_zone
from aoro_gym.terrains.ground import Ground
from aoro_gym.terrains.heights import Heights

SUFFIXES = {".tif": "GTiff", ".tiff": "GTiff", ".asc": "AAIGrid", ".img": "HFA", ".dem": "USGSDEM", ".hgt": "SRTMHGT"}
"""GDAL's driver of each suffix: others could open what the file names, even elsewhere."""
HIGHEST = 9000.0
"""Largest height [m] either way on Earth's land; beyond lie values for "unknown" that the file does not declare."""
MOST_PIXELS = 2_000_000_000
"""Most pixels of the window that is read; beyond, thinning them takes minutes."""


def read_raster(path: Path, request: Request, report: Report) -> Ground:
    """Heights of the first band; voids are NaN, pixel centres are nodes."""
    rasterio = extra("rasterio", f"the elevation raster {path.name}")
    report.kind = "raster"
    with warnings.catch_warnings(), rasterio.Env(GDAL_DISABLE_READDIR_ON_OPEN="EMPTY_DIR", CPL_LOG="/dev/null"):
        warnings.simplefilter("ignore")  # what is not georeferenced is said below
        try:
            with rasterio.open(path, driver=SUFFIXES[path.suffix.lower()]) as data:
                return _read(rasterio, data, request, report)
        except TerrainError:
            raise
        except Exception as error:  # whatever GDAL finds wrong with a broken file
            raise TerrainError(f"{path}: cannot be read as a raster: {error}") from None


def _read(rasterio: Any, data: Any, request: Request, report: Report) -> Ground:
    if data.count != 1:
        kinds = ", ".join(sorted(set(data.dtypes)))
        raise TerrainError(
            f"{report.source}: it has {data.count} bands ({kinds}), so it is a picture; heights stand in one band"
        )
    if np.dtype(data.dtypes[0]).kind == "c":
        raise TerrainError(f"{report.source}: its values are complex numbers, not heights")
    if min(data.shape) < 2:
        raise TerrainError(f"{report.source}: {data.width} x {data.height} pixels are no ground")
    a = data.transform
    plain = a.b == 0.0 and a.d == 0.0 and a.a > 0.0 and a.e < 0.0 and math.isclose(a.a, -a.e, rel_tol=1e-3)
    crs = data.crs.to_wkt() if data.crs else None
    if request.crs is not None or crs is not None:
        system = horizontal(request.crs if request.crs is not None else crs)
        off = None if system.is_geographic else scale_factors(system, *a @ (data.width / 2.0, data.height / 2.0))
        if (
            system.is_geographic or not plain or _far_off(off)
        ):  # degrees are turned into metres here, so that pixels stay square
            return _read_warped(rasterio, data, system, request, report)
    elif not plain:
        raise TerrainError(
            f"{report.source}: its pixels are turned or oblong and its crs is unknown; give crs='EPSG:...'"
            " to have them set upright"
        )
    if data.transform.is_identity and crs is None:
        report.warnings.append(
            "nothing is said of the size of a pixel: 1 m is taken; give units=... if it is another one"
        )
    return _read_plain(rasterio, data, crs, request, report)


def _read_warped(rasterio: Any, data: Any, system: Any, request: Request, report: Report) -> Ground:
    """Through GDAL's reprojection, where pixels are not square or count in degrees."""
    from rasterio import warp
    from rasterio.enums import Resampling
    from rasterio.vrt import WarpedVRT

    target = system
    if system.is_geographic:
        west, south, east, north = data.bounds
        if max(abs(west), abs(east)) > 360.0 or max(abs(south), abs(north)) > 90.0:
            raise TerrainError(
                f"{report.source}: bounds {tuple(data.bounds)} are no degrees, but its crs ({system.name}) says so"
            )
        target = utm_zone((south + north) / 2.0, (west + east) / 2.0)
    elif _far_off(scale_factors(system, *data.transform @ (data.width / 2.0, data.height / 2.0))):
        place = warp.transform(
            system.to_wkt(), "EPSG:4326", *([v] for v in data.transform @ (data.width / 2.0, data.height / 2.0))
        )
        target = utm_zone(place[1][0], place[0][0])
    nodata = data.nodata if data.nodata is not None else -9999.0
    source = rasterio.crs.CRS.from_wkt(system.to_wkt())
    wanted = rasterio.crs.CRS.from_wkt(target.to_wkt())
    with WarpedVRT(
        data, src_crs=source, crs=wanted, resampling=Resampling.bilinear, nodata=nodata, dtype="float64"
    ) as warped:
        report.change("projected", 1, f"set upright in {target.name}, interpolated bilinearly")
        return _read_plain(rasterio, warped, target.to_wkt(), replace(request, crs=None), report)


def _far_off(factors: tuple[float, float] | None) -> bool:
    return factors is not None and max(abs(f - 1.0) for f in factors) > 0.01


def _read_plain(rasterio: Any, data: Any, crs: str | None, request: Request, report: Report) -> Ground:
    """North up, square pixels: the window, thinned where it is finer than the cell asked for."""
    from rasterio.enums import Resampling
    from rasterio.windows import Window

    pixel = data.transform.a
    left, top = data.transform.c, data.transform.f
    low = np.array([left + 0.5 * pixel, top - (data.height - 0.5) * pixel, 0.0])
    high = np.array([left + (data.width - 0.5) * pixel, top - 0.5 * pixel, 0.0])
    frame = find_frame(request, report, low, high, spacing=pixel, crs=crs)
    world = pixel * frame.scale  # m
    wanted_low, wanted_high = (np.asarray(v) + frame.origin for v in (frame.low, frame.high))
    start = math.ceil((wanted_low[0] / frame.scale - low[0]) / pixel - 1e-6)
    stop = math.floor((wanted_high[0] / frame.scale - low[0]) / pixel + 1e-6) + 1
    upper = math.ceil((high[1] - wanted_high[1] / frame.scale) / pixel - 1e-6)
    lower = math.floor((high[1] - wanted_low[1] / frame.scale) / pixel + 1e-6) + 1
    columns, rows = stop - start, lower - upper
    if columns < 2 or rows < 2:
        raise TerrainError(
            f"{report.source}: the window holds {columns} x {rows} pixels of {world:.3g} m; it takes 2 x 2"
        )
    if columns * rows > MOST_PIXELS:
        raise TerrainError(f"{report.source}: {columns:,} x {rows:,} pixels; give a window=(west, south, east, north)")
    # Whole blocks of pixels become one height, so that cells stay square and lie where they say.
    cell = choose_cell(request, report, frame.low, frame.high, world)
    block = max(1, round(cell / world) if request.cell is not None else math.ceil(cell / world - 1e-6))
    rows, columns = rows // block, columns // block
    if min(rows, columns) < 2:
        raise TerrainError(f"{report.source}: cell = {cell:g} m leaves {columns} x {rows} heights; it takes 2 x 2")
    if request.cell is not None and not math.isclose(block * world, request.cell, rel_tol=1e-3):
        report.change("cell", 1, f"cell of {block * world:.3g} m, the multiple of the pixel next to {request.cell:g} m")
    if block > 1:
        report.change("averaged", rows * columns, f"blocks of {block} x {block} pixels of {world:.3g} m averaged")
    top = lower - rows * block
    z = data.read(
        1,
        window=Window(start, top, columns * block, rows * block),  # pyright: ignore[reportCallIssue]
        out_shape=(rows, columns),
        masked=True,
        out_dtype="float64",
        resampling=Resampling.average if block > 1 else Resampling.nearest,
    )
    z = np.ma.filled(z, np.nan)[::-1] * data.scales[0] + data.offsets[0]
    report.points_read = rows * columns * block**2
    # The middle of the south-western block; `lower` counts pixels from the north to the southern edge of the window.
    offset = 0.5 * (block - 1)
    corner_x = (low[0] + (start + offset) * pixel) * frame.scale - frame.origin[0]
    corner_y = (high[1] - (lower - 1 - offset) * pixel) * frame.scale - frame.origin[1]
    z_scale = UNITS.get(_band_unit(data), None) if request.z_units is None else None
    if z_scale is not None and z_scale != frame.z_scale:
        report.units += f"; heights in {_band_unit(data)} (of its band)"
    z = _known(z * (frame.z_scale if z_scale is None else z_scale), report)
    return Ground(Heights(z, block * world, (float(corner_x), float(corner_y))), frame)


def _band_unit(data: Any) -> str:
    said = (data.units[0] or "").strip().lower()
    names = {
        "metre": "m",
        "meter": "m",
        "meters": "m",
        "metres": "m",
        "foot": "ft",
        "feet": "ft",
        "us survey foot": "us-ft",
    }
    return names.get(said, said)


def _known(z: NDArray[np.float64], report: Report) -> NDArray[np.float64]:
    """``z`` with NaN for what cannot be a height."""
    with np.errstate(invalid="ignore"):
        wild = np.isinf(z) | (np.abs(z) > HIGHEST * 1e3)  # in millimetres still
    z = np.where(wild, np.nan, z)
    report.change("wild_heights", int(wild.sum()), f"{int(wild.sum())} heights beyond any on Earth taken as unknown")
    voids = int(np.isnan(z).sum())
    if voids == z.size:
        raise TerrainError(f"{report.source}: none of its {z.size} heights is known; there is no ground in it")
    return np.ascontiguousarray(z)


def read_heights(array: Any, request: Request, report: Report) -> Ground:
    """An array of heights, row 0 in the south; its cell is ``request.cell``."""
    report.kind = "heights"
    try:
        z = np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError):
        raise TerrainError(f"{report.source}: heights must be numbers") from None
    if z.ndim != 2 or min(z.shape) < 2:
        raise TerrainError(f"{report.source}: heights have the shape {z.shape}; give at least 2 rows and 2 columns")
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
    return Ground(Heights(_known(z * frame.z_scale, report), request.cell), frame)
