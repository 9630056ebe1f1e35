"""The front door: a mesh, an elevation raster, a point cloud or heights become a terrain, with a report of what was done.

>>> import numpy as np
>>> from aoro_gym.terrains import load
>>> x = np.arange(0.0, 20.0, 0.5)
>>> terrain, report = load(0.1 * x[:, None] + 0.02 * x[None, :], cell=0.5)
>>> report.triangles, round(report.slope_median_deg, 1)
(3042, 5.8)
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from aoro_gym.checks import printable
from aoro_gym.execution.files import check_writable, write_json, written_whole
from aoro_gym.terrains.georeference import MOST_SCALE_ERROR, axis_unit, horizontal, scale_factors
from aoro_gym.terrains.heights import Heights
from aoro_gym.terrains.io.check import SMALLEST_PIECE, Report, TerrainError, measure
from aoro_gym.terrains.io.elevation_model import ElevationModel
from aoro_gym.terrains.io.frame import FARTHEST, GroundRule, LoadOptions
from aoro_gym.terrains.io.ground_filter import ground_points
from aoro_gym.terrains.io.plausibility import settle_heights
from aoro_gym.terrains.io.read_las import read_las
from aoro_gym.terrains.io.read_mesh import read_mesh
from aoro_gym.terrains.io.read_raster import SUFFIXES as RASTERS
from aoro_gym.terrains.io.read_raster import read_heights, read_raster
from aoro_gym.terrains.io.read_text_cloud import read_text
from aoro_gym.terrains.io.repair import SPIKE_STEEPNESS, fill_holes, remove_small_components, remove_spikes
from aoro_gym.terrains.terrain import LARGEST_COORDINATE, Terrain

CLOUDS = (".las", ".laz")
TEXTS = (".xyz", ".csv", ".txt", ".pts", ".asc_xyz")
MESHES = (".ply", ".obj", ".stl", ".glb", ".gltf", ".off", ".3mf", ".dae")
ARRAYS = (".npy",)
LEAST_COVERAGE = 0.9
"""Share of a cloud's width or length below which ground that a filter found is named as narrower."""
MOST_BYTES_BESIDE = 50_000_000
"""Largest report beside a mesh that is read."""


class Loaded(NamedTuple):
    """A terrain, and what was done to get it."""

    terrain: Terrain
    report: Report


def load(
    source: str | os.PathLike[str] | ArrayLike,
    *,
    units: str | None = None,
    z_units: str | None = None,
    up: str | None = None,
    crs: str | None = None,
    cell: float | None = None,
    window: tuple[float, float, float, float] | None = None,
    hole_limit: float = 5.0,
    spike_limit: float = 0.5,
    ground: GroundRule | None = None,
    nodata: Sequence[float] | float | None = None,
    band: int | None = None,
    friction: float = 1.0,
    rolling_resistance: float = 1.0,
    name: str | None = None,
    progress: Callable[[float], None] | None = None,
) -> Loaded:
    """Load, check and repair ground to drive on. Most of these lines say what the options mean.

    What the caller says wins over what the file says, and that over what is recognised; the report tells which it was.

    Args:
        source: A mesh (.ply .obj .stl .glb .gltf .off .3mf .dae), an elevation raster (.tif .asc .img .dem .hgt), a point
            cloud (.las .laz .xyz .csv .txt .pts, or a mesh without faces), or heights (.npy, or an array (rows, columns)
            with row 0 in the south).
        units: Unit of the source: m, km, dm, cm, mm, ft, us-ft or in.
        z_units: Unit of its heights, where it is another one. What it says is believed.
        up: Its axis that points up: x, y or z.
        crs: Its coordinate reference system, as pyproj reads it, such as ``"EPSG:32633"``. Degrees become metres of their
            UTM zone.
        cell: Distance [m] of heights; by default the raster's own, or after the distance of points. Needed by arrays.
        window: West, south, east, north [m] of what is wanted, in the source's (projected) coordinates.
        hole_limit: Widest gap [m] that is bridged; wider ones stay open and are named in the report.
        spike_limit: Height [m] of spikes that are removed.
        ground: What of a cloud is ground: points of the ground ``class``, what a ``filter`` takes for it, or ``all``;
            by default the class if there is one. ``filter`` also takes vegetation and buildings off rasters and meshes.
        nodata: Values that mean "unknown" in a raster, an array or a cloud, beside those that the file declares. By
            default they are recognised; ``()`` says that there are none.
        band: Which band of a raster holds the heights, from 1; by default the only one, or the one described so.
        friction: Multiplier of the tires' friction; 1 is dry asphalt.
        rolling_resistance: Multiplier of the tires' rolling resistance; 1 is asphalt.
        name: Name of the terrain; the file's by default.
        progress: Told the share that is done, in [0, 1].

    Raises:
        TerrainError: (a ``ValueError``) if the source is broken, or cannot be driven on, in one sentence with the reason.
        OSError: if the file cannot be opened.
    """
    started = time.perf_counter()
    request = LoadOptions(
        units=units,
        z_units=z_units,
        up=up,
        crs=crs,
        cell=cell,
        window=window,
        hole_limit=hole_limit,
        spike_limit=spike_limit,
        ground=ground,
        nodata=_numbers(nodata),
        band=band,
        progress=progress,
    )
    path = Path(source) if isinstance(source, str | os.PathLike) else None
    report = Report(source=str(path) if path else "array of heights")
    found = _found(path, source, request, report)
    called = name or (path.stem if path else "heights")
    terrain = _terrain(found, report, friction, rolling_resistance, called, _sidecar_report(path, report))
    request.tell(1.0)
    report.seconds = time.perf_counter() - started
    return Loaded(terrain, report)


def check_output(path: Path, source: Path) -> None:
    """ValueError unless a terrain can be written to ``path`` (.ply), its report (.json) and plan (.png) beside it, none of
    them over ``source``."""
    if path.suffix != ".ply":
        raise ValueError(f"--out {path} must end in .ply")
    for file in (path, path.with_suffix(".json"), path.with_suffix(".png")):
        if file.resolve() == source.resolve():
            raise ValueError(f"--out {path} would overwrite {source}; choose another name")
        check_writable(file)


def save(loaded: Loaded, path: Path) -> list[Path]:
    """Write the terrain as a mesh (``path``, .ply) and its report beside it (.json); returns both paths.

    :func:`load` finds the origin and the coordinate system again in the report.
    """
    import trimesh

    terrain, report = loaded
    with written_whole(path) as temporary:
        trimesh.Trimesh(np.array(terrain.vertices), np.array(terrain.faces), process=False).export(temporary)
    beside = path.with_suffix(".json")
    write_json(beside, report.to_json())
    return [path, beside]


def _numbers(nodata: Sequence[float] | float | None) -> tuple[float, ...] | None:
    try:
        return None if nodata is None else tuple(float(value) for value in np.atleast_1d(nodata))
    except (TypeError, ValueError):
        raise TerrainError(f"nodata is {f'{nodata!r}'[:80]}, but must be a number, or several") from None


def _found(path: Path | None, source: Any, request: LoadOptions, report: Report) -> ElevationModel:
    """Ground of the source, in metres and repaired; what is doubtful of a broken one stands in its error."""
    if request.crs is not None:
        try:
            horizontal(request.crs)
        except ValueError as error:
            raise TerrainError(str(error)) from None
    if request.up is not None:
        report.up = f"{request.up} (as asked)"
    try:
        return _repaired(settle_heights(_read(path, source, request, report), request, report), request, report)
    except TerrainError as error:
        text = printable(f"{error}{report.doubts()}")
        raise TerrainError(text) from None


def _read(path: Path | None, source: Any, request: LoadOptions, report: Report) -> ElevationModel:
    if path is None:
        return read_heights(source, request, report)
    suffix = path.suffix.lower()
    readers = {
        **dict.fromkeys(RASTERS, read_raster),
        **dict.fromkeys(CLOUDS, read_las),
        **dict.fromkeys(TEXTS, read_text),
        **dict.fromkeys(MESHES, read_mesh),
        **dict.fromkeys(ARRAYS, _read_array),
    }
    if suffix not in readers:
        raise TerrainError(f"{path}: terrains end in one of {' '.join(readers)}")
    with path.open("rb") as file:  # one clear OSError, before any library meets the name
        if not file.read(1):
            raise TerrainError(f"{path}: the file is empty")
    if request.band is not None and suffix not in (*RASTERS, *ARRAYS):
        raise TerrainError(f"{path}: only a raster has bands; drop band=... (--band)")
    ground = readers[suffix](path, request, report)
    if request.nodata and report.kind == "mesh":
        report.warnings.append("nodata is passed over: a mesh with faces has no value that means unknown")
    return ground


def _read_array(path: Path, request: LoadOptions, report: Report) -> ElevationModel:
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)  # holds what the header claims against the file's size
    except OSError:
        raise
    except Exception as error:  # whatever numpy finds wrong with a broken file
        text = " ".join(str(error).split())[:200] or type(error).__name__
        raise TerrainError(f"{path}: cannot be read as an array: {text}") from None
    if not isinstance(array, np.ndarray):
        names = ", ".join(array.files[:8])
        array.close()
        raise TerrainError(
            f"{path}: it is an archive of arrays ({names[:150]}), not one; save the heights with numpy.save"
        )
    return read_heights(array, request, report)


def _repaired(found: ElevationModel, request: LoadOptions, report: Report) -> ElevationModel:
    """Spikes, small pieces and holes of heights; what keeps its own triangles is whole already."""
    if found.mesh is not None and request.ground != "filter":
        measure(found.heights, report)
        return found
    heights = found.heights
    if request.ground == "filter" and report.kind != "points":
        heights, taken = _without_obstacles(heights, request)
        report.change(
            "obstacles_removed", taken, f"{taken:,} heights of vegetation and buildings removed (cloth simulation)"
        )
    heights, spikes = remove_spikes(heights, request.spike_limit)
    limit = max(request.spike_limit, SPIKE_STEEPNESS * heights.cell)
    report.change("spikes_removed", spikes, f"{spikes:,} heights that stuck out by more than {limit:.3g} m removed")
    before = int(heights.known.sum())
    heights, filled = fill_holes(heights, request.hole_limit)
    share = filled / max(before + filled, 1)
    report.change(
        "holes_filled",
        filled,
        f"{filled:,} heights ({share:.1%}) bridged over gaps up to {request.hole_limit:g} m wide",
    )
    if share > 0.5:
        report.warnings.append(
            f"{share:.0%} of the heights are bridged over gaps; a larger cell, or more points, say more"
        )
    heights, dropped = remove_small_components(heights, SMALLEST_PIECE)
    report.change(
        "pieces_removed", len(dropped), f"pieces of ground below {SMALLEST_PIECE:g} m² removed: {len(dropped):,}"
    )
    _warn_of_filtered_ground(heights, report)
    measure(heights, report)
    return ElevationModel(heights, found.frame)


def _warn_of_filtered_ground(heights: Heights, report: Report) -> None:
    """A warning where the filter left much of what a cloud covers without ground."""
    if not any(change.what == "ground_by_filter" for change in report.changes):
        return
    held = [np.flatnonzero(heights.known.any(axis=axis)) for axis in (0, 1)]
    whole = [(count - 1) * heights.cell for count in heights.z.shape[::-1]]
    left = [(one[-1] - one[0]) * heights.cell if len(one) else 0.0 for one in held]
    if any(a < LEAST_COVERAGE * b for a, b in zip(left, whole, strict=True)):
        report.warnings.append(
            f"ground is found on {left[0]:.3g} m x {left[1]:.3g} m of the {whole[0]:.3g} m x {whole[1]:.3g} m that the"
            " points cover; the rest is taken for vegetation and buildings: ground='all' keeps it"
        )


def _without_obstacles(heights: Heights, request: LoadOptions) -> tuple[Heights, int]:
    """What the filter of clouds leaves, and how many heights it took."""
    mask = ground_points(heights.points, progress=request.tell)
    z = heights.z.copy()
    z[heights.known] = np.where(mask, z[heights.known], np.nan)
    return heights.replaced(z), int((~mask).sum())


def _sidecar_report(path: Path | None, report: Report) -> dict[str, Any] | None:
    """Origin and coordinate system in the report that ``save`` wrote beside a mesh.

    None without one, or, with a warning, if it says nothing of use. Some other program's file is no report.
    """
    if path is None or path.suffix.lower() != ".ply":
        return None
    beside = path.with_suffix(".json")
    if not beside.exists():
        return None
    ignored = f"{beside} is passed over, so the place on Earth is unknown:"
    try:
        if beside.stat().st_size > MOST_BYTES_BESIDE:
            report.warnings.append(f"{ignored} it is larger than {MOST_BYTES_BESIDE / 1e6:.0f} MB")
            return None
        content = json.loads(beside.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        text = "too deep" if isinstance(error, RecursionError) else " ".join(str(error).split())[:150]
        report.warnings.append(f"{ignored} it cannot be read as JSON ({text})")
        return None
    if not isinstance(content, dict) or "origin_m" not in content or content.get("crs") is None:
        return None  # some other file, or of a terrain without a place
    return _origin_and_crs(content, ignored, report)


def _origin_and_crs(content: dict[str, Any], ignored: str, report: Report) -> dict[str, Any] | None:
    """``origin`` and ``crs`` of a report, if they are."""
    origin, crs = content["origin_m"], content["crs"]
    numbers = isinstance(origin, list) and len(origin) == 3
    numbers = numbers and all(isinstance(v, int | float) and not isinstance(v, bool) for v in origin)
    if not numbers or not all(abs(value) <= FARTHEST for value in origin):  # False for NaN
        text = f"{origin!r}"[:80]
        report.warnings.append(f"{ignored} origin_m is {text}, but must be three finite numbers")
        return None
    try:
        system = horizontal(crs) if isinstance(crs, str) else None
    except ValueError as error:
        report.warnings.append(f"{ignored} {error}")
        return None
    if system is None or not system.is_projected:
        report.warnings.append(f"{ignored} crs is {f'{crs!r}'[:80]}, but must be the name of a projected system")
        return None
    x, y, z = (float(value) for value in origin)
    metre = axis_unit(system)
    factors = scale_factors(system, x / metre, y / metre)
    if factors is None or max(abs(factor - 1.0) for factor in factors) > MOST_SCALE_ERROR:
        far = (
            "no place on Earth"
            if factors is None
            else f"where its lengths are {factors[1]:.3g} times those on the ground"
        )
        report.warnings.append(
            f"{report.source} lies in {system.name} at ({x:.0f}, {y:.0f}) m, {far}; load its source again"
        )
    return {"origin": (x, y, z), "crs": crs}


def _terrain(
    found: ElevationModel,
    report: Report,
    friction: float,
    rolling_resistance: float,
    name: str,
    beside: dict[str, Any] | None,
) -> Terrain:
    """The terrain, and its figures in ``report``."""
    heights, frame = found.heights, found.frame
    lowest, highest = float(np.nanmin(heights.z)), float(np.nanmax(heights.z))
    moved = any(frame.origin) or max(abs(lowest), abs(highest)) > LARGEST_COORDINATE
    base = float(np.floor(lowest)) if moved else 0.0
    rest: dict[str, Any] = {
        "friction": friction,
        "rolling_resistance": rolling_resistance,
        "origin": (*frame.origin, base),
        "crs": frame.crs,
        "name": name,
    }
    if beside is not None and not moved and frame.crs is None:
        rest |= beside
        report.change("georeferenced", 1, "origin and coordinate system taken from the report beside the mesh")
    try:
        if found.mesh is not None:
            vertices, faces = found.mesh
            terrain = Terrain(vertices=vertices - [0.0, 0.0, base], faces=faces, **rest)
        else:
            terrain = Terrain.from_heights(heights.z - base, cell=heights.cell, corner=heights.corner, **rest)
            report.cell_m = heights.cell
    except TerrainError:
        raise
    except ValueError as error:  # what a terrain itself refuses
        raise TerrainError(f"{report.source}: {error}") from None
    low, high = terrain.extent
    report.crs, report.origin_m = terrain.crs, terrain.origin
    report.triangles, report.vertices = len(terrain.faces), len(terrain.vertices)
    x, y, z = (float(value) for value in high - low)
    report.extent_m = (x, y, z)
    if moved:
        x, y, z = terrain.origin
        text = f"the local origin lies at ({x:.0f}, {y:.0f}, {z:.0f}) m, so that float32 keeps millimetres"
        report.change("shifted", 1, text)
    return terrain
