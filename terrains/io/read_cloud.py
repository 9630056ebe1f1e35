"""The ground of a point cloud: its points are surveyed, brought to local metres, and thinned onto a grid.

Points are read in chunks, as often as needed, so that memory does not grow with the cloud.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from aoro_gym.terrains.heights import Heights, grid_shape
from aoro_gym.terrains.io.check import Report, TerrainError
from aoro_gym.terrains.io.cloud_survey import Chunk, Cloud, Survey, survey
from aoro_gym.terrains.io.elevation_model import ElevationModel
from aoro_gym.terrains.io.frame import CoordinateFrame, LoadOptions, choose_cell, find_frame, z_up
from aoro_gym.terrains.io.ground_filter import ground_points
from aoro_gym.terrains.io.plausibility import settle_heights
from aoro_gym.terrains.io.precision import note_lost_precision
from aoro_gym.terrains.io.repair import interpolate

CHUNK = 1_000_000
"""Points in memory at once."""
GROUND_CLASSES = (2, 8)
"""Ground, and model key points (ASPRS LAS 1.4)."""
FEWEST = 20
"""Fewest points that make a ground."""
ENVELOPE = 4.0
"""Width [m] of the window whose lowest point tells the unit of heights."""
ENOUGH_GROUND = 0.02
"""Least share of the occupied cells that holds points of the ground class, if the class is to be relied on."""
NATURAL_CELL = (0.25, 1.0)
"""Finest and coarsest cell [m] that is chosen unasked; between them, twice the distance of the points."""
OUTLIER_DEPTH = 1.5
"""Depth [m] below the third lowest of 5 x 5 cells of what is no ground but a multiple echo."""
FLAT, TALL = 0.05, 1.0
"""A height-normalised cloud: ground within the first, and points above the second [m]."""
DEGREES = 0.5
"""Width of a cloud up to which its coordinates may be degrees."""
PLAN = {"x": "zy", "y": "xz", "z": "xy"}
"""Axes of the plan by the axis that is up."""
BOUNDS_TOLERANCE = 2.0
"""Steps of the coordinates by which declared bounds may miss those of the points."""

Array = NDArray[np.float64]


def read_points(
    points: Array, request: LoadOptions, report: Report, unit: str | None = None, rule: str = "z"
) -> ElevationModel:
    """A cloud in memory: (N, 3); ``unit`` and ``rule``, the axis that is up, as its format has them.

    Args:
        points: The cloud (N, 3), in the source's unit.
        request: What the caller asks for.
        report: Takes what is found and changed.
        unit: Unit that the format declares.
        rule: Axis that is up by the format.
    """

    def chunks() -> Iterator[Chunk]:
        for start in range(0, len(points), CHUNK):
            yield Chunk(points[start : start + CHUNK])

    return read_cloud(Cloud(len(points), chunks, rule=rule, unit=unit), request, report)


def read_cloud(cloud: Cloud, request: LoadOptions, report: Report) -> ElevationModel:
    """Heights of the cloud's ground: by its ground class, or else by a filter, as ``request.ground`` says."""
    report.kind = "points"
    found = survey(cloud, request, report)
    if found.count < FEWEST:
        left = "" if found.count == report.points_read else f" of its {report.points_read:,} points are left, which"
        raise TerrainError(f"{report.source}: {found.count}{left or ' points'} are no ground; it takes {FEWEST}")
    _note_bounds(cloud, found, report)
    corners = z_up(np.stack([found.low, found.high]), found.up)
    plan = np.ptp(corners, axis=0)[:2]
    _check_flat(found, plan, report)
    if cloud.crs is None and cloud.unit is None and request.crs is None and request.units is None:
        _check_degrees(found, plan, report)
    spacing = float(np.sqrt(float(np.prod(plan)) / found.count))
    frame = find_frame(
        request,
        report,
        found.low,
        found.high,
        spacing=spacing,
        up=found.up,
        crs=cloud.crs,
        unit=cloud.unit,
        z_unit=cloud.z_unit,
    )
    if frame.projection is None:
        axes = ["xyz".index(name) for name in PLAN[found.up] + found.up]
        steps = None if cloud.steps is None else cloud.steps[axes[:2]]
        note_lost_precision(found.neighbours[:, axes], spacing, frame.scale, report, steps, PLAN[found.up])
    low, high = frame.low, frame.high
    if frame.projection is None:
        spacing *= frame.scale
    else:
        spacing = float(np.sqrt(np.prod(high - low) / found.count))
    natural = float(np.clip(round(2.0 * spacing, 2), *NATURAL_CELL))
    cell = choose_cell(request, report, low, high, natural)
    thin, frame = _settled(_summarise_cells(cloud, found, frame, cell, request, report), cell, frame, request, report)
    ground = _pick_ground(thin, cell, request, report)
    if len(ground) < FEWEST:
        raise TerrainError(
            f"{report.source}: {len(ground)} of its {found.count:,} points look like ground, so there is none to drive on;"
            " ground='all' takes every point"
        )
    _note_normalised(ground, thin, report)
    return ElevationModel(_gridded(ground, thin, cell), frame)


def _note_bounds(cloud: Cloud, found: Survey, report: Report) -> None:
    """Say so if the file declares other bounds than those of its points, which are taken."""
    if cloud.bounds is None:
        return
    slack = BOUNDS_TOLERANCE * (np.zeros(3) if cloud.steps is None else cloud.steps)
    low, high = cloud.bounds
    with np.errstate(invalid="ignore"):
        same = np.all(np.abs(low - found.low) <= slack) and np.all(np.abs(high - found.high) <= slack)
        wider = np.all(low <= found.low + slack) and np.all(high >= found.high - slack)
    left_out = report.points_read > found.count
    if same or (left_out and wider and np.all(np.isfinite([low, high]))):  # those of points that are left out, too
        return
    told = [f"{a:.2f} to {b:.2f}" for a, b in zip(low, high, strict=True)]
    text = f"the header's bounds ({', '.join(told)}) are not those of the points, which are taken"
    report.change("stale_bounds", 1, text)


def _check_flat(found: Survey, plan: Array, report: Report) -> None:
    """``TerrainError`` for points that all lie on one upright plane."""
    for size, name in zip(plan, PLAN[found.up], strict=True):
        if not size > 0.0:
            value = found.low["xyz".index(name)]
            raise TerrainError(
                f"{report.source}: all of its {found.count:,} points lie at {name} = {value:.10g}, which is no ground;"
                " was it written with too few digits, or is another axis up (up=...)?"
            )


def _check_degrees(found: Survey, plan: Array, report: Report) -> None:
    """``TerrainError`` for coordinates that are degrees by all appearances, of which nothing is said."""
    low, high = found.low[:2], found.high[:2]
    earthly = np.all(np.abs([low, high]) <= 180.0) and found.up == "z"
    if earthly and plan.max() < DEGREES and plan.max() < 0.01 * (found.high[2] - found.low[2]):
        raise TerrainError(
            f"{report.source}: x from {low[0]:.10g} to {high[0]:.10g} and y from {low[1]:.10g} to {high[1]:.10g} are as if"
            " in degrees, and nothing is said of their coordinate system; give crs='EPSG:4326' (--crs) if x is the"
            " longitude and y the latitude, or units=... (--units)"
        )


@dataclass(frozen=True)
class CellSummary:
    """A cloud by cells: the lowest point of each, and the mean of its points of the ground class."""

    low: Array
    shape: tuple[int, int]
    lowest: Array
    """(N, 3) local points."""
    mean_ground: Array
    """(M, 3) local points; none without classes."""
    ground_count: int
    top: float
    """Height of the highest point [m]."""


def _summarise_cells(
    cloud: Cloud, found: Survey, frame: CoordinateFrame, cell: float, request: LoadOptions, report: Report
) -> CellSummary:
    low, high = frame.low, frame.high
    rows, columns = grid_shape(low, high, cell)
    nodes = rows * columns
    lowest = np.full((nodes, 3), np.inf)
    total, number = np.zeros((0, 3)), np.zeros(0)
    done = outside = ground_count = 0
    top = -np.inf
    for chunk in cloud.chunks():
        done += len(chunk.points)
        request.tell(0.3 + 0.4 * min(1.0, done / report.points_read))
        keep = found.usable(chunk)
        classes = None if chunk.classes is None else chunk.classes[keep]
        points = frame.local(chunk.points[keep])
        inside = np.all((points[:, :2] >= low - 0.5 * cell) & (points[:, :2] <= high + 0.5 * cell), axis=1)
        outside += int((~inside).sum())
        points = points[inside]
        if not len(points):
            continue
        column, row = np.rint((points[:, :2] - low) / cell).astype(np.int64).T
        node = np.clip(row, 0, rows - 1) * columns + np.clip(column, 0, columns - 1)
        top = max(top, float(points[:, 2].max()))
        order = np.lexsort((points[:, 2], node))
        first = order[np.concatenate([[True], np.diff(node[order]) > 0])]
        better = first[points[first, 2] < lowest[node[first], 2]]
        lowest[node[better]] = points[better]
        if classes is not None:
            classed = np.isin(classes[inside], GROUND_CLASSES)
            ground_count += int(classed.sum())
            if classed.any():
                if not len(number):
                    total, number = np.zeros((nodes, 3)), np.zeros(nodes)
                number += np.bincount(node[classed], minlength=nodes)
                for axis in range(3):
                    total[:, axis] += np.bincount(node[classed], weights=points[classed, axis], minlength=nodes)
    report.change("outside_points", outside, f"{outside:,} points outside of the window left out")
    if outside >= found.count:
        raise TerrainError(f"{report.source}: none of its {found.count:,} points lies in the window")
    held = number > 0
    return CellSummary(
        low=low,
        shape=(rows, columns),
        lowest=lowest[np.isfinite(lowest[:, 2])],
        mean_ground=total[held] / number[held, None],
        ground_count=ground_count,
        top=top,
    )


def _settled(
    thin: CellSummary, cell: float, frame: CoordinateFrame, request: LoadOptions, report: Report
) -> tuple[CellSummary, CoordinateFrame]:
    """``thin`` in metres of height, told by its lower envelope, in which trees and buildings are few.

    The filter that tells ground from them compares heights with metres, so this comes first. Where the unit stays, it is
    looked at again with the ground that was found.
    """
    points = thin.mean_ground if len(thin.mean_ground) >= ENOUGH_GROUND * len(thin.lowest) else thin.lowest
    column, row = np.rint((points[:, :2] - thin.low) / cell).astype(np.int64).T
    grid = np.full(thin.shape, np.inf)
    row, column = np.clip(row, 0, thin.shape[0] - 1), np.clip(column, 0, thin.shape[1] - 1)
    np.minimum.at(grid, (row, column), points[:, 2])
    width = min(max(5, round(ENVELOPE / cell)), max(1, min(thin.shape) // 4))
    grid = ndimage.minimum_filter(grid, size=width, mode="constant", cval=np.inf)
    heights = Heights(np.where(np.isfinite(grid), grid, np.nan), cell)
    told = Report(report.source, kind=report.kind, units=report.units)
    settled = settle_heights(ElevationModel(heights, frame), request, told).frame
    factor = settled.z_scale / frame.z_scale
    if factor == 1.0:
        return thin, frame
    report.changes += told.changes
    report.warnings += told.warnings
    report.units = told.units
    scale = np.array([1.0, 1.0, factor])
    lowest, mean = thin.lowest * scale, thin.mean_ground.reshape(-1, 3) * scale
    return replace(thin, lowest=lowest, mean_ground=mean, top=thin.top * factor), settled


def _pick_ground(thin: CellSummary, cell: float, request: LoadOptions, report: Report) -> Array:
    """Local points of the ground."""
    by_class = len(thin.mean_ground) >= max(FEWEST, ENOUGH_GROUND * len(thin.lowest))
    if request.ground == "class" and not len(thin.mean_ground):
        raise TerrainError(f"{report.source}: no point has the ground class (2); ground='filter' tells it by its shape")
    if request.ground == "class" or (request.ground is None and by_class):
        text = f"ground by its class: {thin.ground_count:,} points in {len(thin.mean_ground):,} cells"
        report.change("ground_by_class", thin.ground_count, text)
        return thin.mean_ground
    if request.ground == "all":
        return thin.lowest
    calm = _without_low_outliers(thin, cell)
    mask = ground_points(calm, progress=lambda share: request.tell(0.7 + 0.2 * share))
    text = f"ground by its shape (cloth simulation): {int(mask.sum()):,} of the lowest points of {len(calm):,} cells"
    report.change("ground_by_filter", int(mask.sum()), text)
    return calm[mask]


def _without_low_outliers(thin: CellSummary, cell: float) -> Array:
    """The lowest points less those far below all but one of their neighbours, on which the cloth would hang."""
    column, row = np.rint((thin.lowest[:, :2] - thin.low) / cell).astype(np.int64).T
    grid = np.full(thin.shape, np.inf)
    row, column = np.clip(row, 0, thin.shape[0] - 1), np.clip(column, 0, thin.shape[1] - 1)
    grid[row, column] = thin.lowest[:, 2]
    third = ndimage.rank_filter(grid, rank=2, size=5, mode="constant", cval=np.inf)[row, column]
    return thin.lowest[~(np.isfinite(third) & (thin.lowest[:, 2] < third - OUTLIER_DEPTH))]


def _gridded(ground: Array, thin: CellSummary, cell: float) -> Heights:
    """Heights at the nodes next to points of the ground."""
    column, row = np.rint((ground[:, :2] - thin.low) / cell).astype(np.int64).T
    held = np.zeros(thin.shape, dtype=bool)
    held[np.clip(row, 0, thin.shape[0] - 1), np.clip(column, 0, thin.shape[1] - 1)] = True
    z = np.full(thin.shape, np.nan)
    nodes = np.argwhere(held)[:, ::-1] * cell + thin.low
    z[held] = interpolate(ground[:, :2], ground[:, 2], nodes)
    return Heights(z, cell, (float(thin.low[0]), float(thin.low[1])))


def _note_normalised(ground: Array, thin: CellSummary, report: Report) -> None:
    """Say so if the ground is zero everywhere while something stands on it."""
    if float(np.subtract(*np.percentile(ground[:, 2], [99, 1]))) < FLAT and thin.top > ground[:, 2].max() + TALL:
        report.warnings.append(
            f"height-normalised cloud: the ground is {np.median(ground[:, 2]):.2f} m everywhere and points stand up to"
            f" {thin.top:.1f} m above; the shape of the ground was taken out, get the cloud with its true heights"
        )


@contextmanager
def reading_errors(path: Path, what: str) -> Iterator[None]:
    """Turn whatever a library finds wrong with a broken file into one error."""
    try:
        yield
    except TerrainError:
        raise
    except BaseException as error:
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":  # lazrs panics in Rust's way
            raise
        text = str(error).splitlines()[0] if str(error) else type(error).__name__
        if isinstance(error, ValueError) and text.startswith(str(path)):  # it says so itself
            raise TerrainError(text) from None
        raise TerrainError(f"{path}: cannot be read as {what}: {text[:200]}") from None
