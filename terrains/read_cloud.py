"""Point clouds: LAS and LAZ, text (XYZ, CSV) and meshes without faces; read in chunks and thinned onto a grid."""

from __future__ import annotations

import itertools
import logging
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from aoro_gym.terrains.check import Report, TerrainError
from aoro_gym.terrains.extras import extra
from aoro_gym.terrains.frame import Frame, Request, choose_cell, find_frame, sound, turned
from aoro_gym.terrains.ground import Ground
from aoro_gym.terrains.ground_filter import ground_points
from aoro_gym.terrains.heights import Heights, grid_shape
from aoro_gym.terrains.repair import interpolate

CHUNK = 1_000_000
"""Points in memory at once."""
GROUND_CLASSES = (2, 8)
"""Ground, and model key points (ASPRS LAS 1.4)."""
NOISE_CLASSES = (7, 18)
FEWEST = 20
"""Fewest points that make a ground."""
ENOUGH_GROUND = 0.02
"""Least share of the occupied cells that holds points of the ground class, if the class is to be relied on."""
NATURAL_CELL = (0.25, 1.0)
"""Finest and coarsest cell [m] that is chosen unasked; between them, twice the distance of the points."""
OUTLIER_DEPTH = 1.5
"""Depth [m] below the third lowest of 5 x 5 cells of what is no ground but a multiple echo."""
FLAT, TALL = 0.05, 1.0
"""A height-normalised cloud: ground within the first, and points above the second [m]."""

Array = NDArray[np.float64]
Chunk = tuple[Array, NDArray[np.uint8] | None]


@dataclass(frozen=True)
class Cloud:
    """Points that can be read chunk by chunk, as often as wanted."""

    low: Array
    """(3,) lowest raw coordinates, and highest."""
    high: Array
    count: int
    chunks: Callable[[], Iterator[Chunk]]
    """Raw points (n, 3), and their classes (n,) if there are any."""
    crs: Any = None


def read_las(path: Path, request: Request, report: Report) -> Ground:
    """A cloud of LAS or LAZ; noise is left out."""
    laspy = extra("laspy", f"the point cloud {path.name}")
    extra("lazrs", f"the point cloud {path.name}")
    logging.getLogger("laspy").addHandler(logging.NullHandler())  # its errors are raised here, not printed
    with _broken(path, "a point cloud (LAS)"):
        _check_header(path)
        with laspy.open(path) as file:
            header = file.header
            low, high, count = np.array(header.mins), np.array(header.maxs), int(header.point_count)
            crs = header.parse_crs()
            if header.are_points_compressed:
                _check_chunk_table(path, header.offset_to_point_data)

        def chunks() -> Iterator[Chunk]:
            read = 0
            with _broken(path, "a point cloud (LAS)"), laspy.open(path) as file:
                for points in file.chunk_iterator(CHUNK):
                    classes = np.asarray(points.classification, dtype=np.uint8)
                    xyz = np.stack([points.x, points.y, points.z], axis=1)
                    read += len(xyz)
                    if not len(xyz):
                        break
                    yield xyz, classes
            if read < count:
                raise TerrainError(f"{path}: {read:,} of {count:,} points, so it is cut off; get it again")

    return read_cloud(Cloud(low, high, count, chunks, crs), request, report)


def _check_header(path: Path) -> None:
    """``TerrainError`` for a LAS or LAZ file whose header promises more records than the file can hold.

    Fields and offsets: LAS 1.4 R15, table 3. laspy would look for what is not there for hours.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(375)
    if len(head) < 227 or head[:4] != b"LASF":
        raise TerrainError(f"{path}: it does not begin as a point cloud (LAS) does")
    minor, point_format = head[25], head[104]
    offset, records, length, count = struct.unpack_from("<II", head, 96) + struct.unpack_from("<HI", head, 105)
    if minor >= 4 and len(head) >= 255:
        first, extended, wide = struct.unpack_from("<QIQ", head, 235)
        count = max(count, wide)
        if extended and first + 60 * extended > size:
            raise TerrainError(
                f"{path}: its header promises {extended:,} extended records, but it is cut off or broken"
            )
    if offset > size or 54 * records > size:
        raise TerrainError(
            f"{path}: its header promises {records:,} records and points from byte {offset:,} on, but it is broken"
        )
    if not point_format & 0x80 and offset + length * count > size:  # the highest bit marks compression
        held = (size - offset) // max(length, 1)
        raise TerrainError(f"{path}: {held:,} of {count:,} points, so it is cut off or broken; get it again")


def _check_chunk_table(path: Path, start: int) -> None:
    """``TerrainError`` for a LAZ file whose table of chunks cannot be true: lazrs would reserve memory after it, and abort.

    The compressed points begin with the table's position (int64), or -1 if that stands in the last eight bytes; the
    table begins with a version and the number of chunks (uint32 each), and no chunk is shorter than a byte.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        file.seek(start)
        (table,) = struct.unpack("<q", file.read(8))
        if table == -1:
            file.seek(size - 8)
            (table,) = struct.unpack("<q", file.read(8))
        if not start + 8 <= table <= size - 8:
            raise TerrainError(
                f"{path}: its table of chunks is not in the file, so it is cut off or broken; get it again"
            )
        file.seek(table)
        _, chunks = struct.unpack("<II", file.read(8))
    if chunks > size:
        raise TerrainError(f"{path}: it claims {chunks:,} chunks in {size:,} bytes, so it is broken; get it again")


def read_text(path: Path, request: Request, report: Report) -> Ground:
    """A cloud of lines ``x y z``, separated by spaces, tabs, commas or semicolons; the first lines may be names."""
    skip, separator, columns = _layout(path)

    def chunks() -> Iterator[Chunk]:
        with _broken(path, "lines of x, y, z"), path.open(encoding="utf-8", errors="replace") as file:
            for _ in range(skip):
                next(file)
            while lines := list(itertools.islice(file, CHUNK)):
                lines = [line for line in lines if line.strip() and not line.lstrip().startswith(("#", "//"))]
                if lines:
                    values = np.loadtxt(lines, delimiter=separator, usecols=columns, ndmin=2, comments=None)
                    classes = values[:, 3].astype(np.uint8) if values.shape[1] > 3 else None
                    yield values[:, :3], classes

    low, high, count = np.full(3, np.inf), np.full(3, -np.inf), 0
    for points, _ in chunks():
        finite = points[sound(points)]
        if len(finite):
            low, high = np.minimum(low, finite.min(axis=0)), np.maximum(high, finite.max(axis=0))
        count += len(points)
    return read_cloud(Cloud(low, high, count, chunks), request, report)


def read_points(points: Array, request: Request, report: Report) -> Ground:
    """A cloud in memory: (N, 3)."""
    finite = points[sound(points)]
    low, high = (finite.min(axis=0), finite.max(axis=0)) if len(finite) else (np.full(3, np.inf), np.full(3, -np.inf))

    def chunks() -> Iterator[Chunk]:
        for start in range(0, len(points), CHUNK):
            yield points[start : start + CHUNK], None

    return read_cloud(Cloud(low, high, len(points), chunks), request, report)


def read_cloud(cloud: Cloud, request: Request, report: Report) -> Ground:
    """Heights of the cloud's ground: by its ground class, or else by a filter, as ``request.ground`` says."""
    report.kind = "points"
    report.points_read = cloud.count
    if not sound(np.stack([cloud.low, cloud.high])).all() and cloud.count >= FEWEST:
        reach = f"from {cloud.low.tolist()} to {cloud.high.tolist()}"
        raise TerrainError(f"{report.source}: its coordinates reach {reach}; it is broken")
    if cloud.count < FEWEST:
        raise TerrainError(f"{report.source}: {cloud.count} points are no ground; it takes {FEWEST}")
    up = request.up or _guess_up(cloud, report)
    corners = turned(np.stack([cloud.low, cloud.high]), up)
    plan = np.ptp(corners, axis=0)[:2]
    spacing = float(np.sqrt(max(float(np.prod(plan)), 1e-12) / cloud.count))
    frame = find_frame(request, report, cloud.low, cloud.high, spacing=spacing, up=up, crs=cloud.crs)
    low, high = frame.low, frame.high
    if frame.projection is None:
        spacing *= frame.scale
    else:
        spacing = float(np.sqrt(np.prod(high - low) / cloud.count))
    natural = float(np.clip(round(2.0 * spacing, 2), *NATURAL_CELL))
    cell = choose_cell(request, report, low, high, natural)
    thin = _thin(cloud, frame, cell, low, high, request, report)
    ground = _pick_ground(thin, cell, request, report)
    if len(ground) < FEWEST:
        raise TerrainError(
            f"{report.source}: {len(ground)} of its {cloud.count:,} points look like ground, so there is none to drive on;"
            " ground='all' takes every point"
        )
    _note_normalised(ground, thin, report)
    return Ground(_gridded(ground, thin, cell), frame)


@dataclass(frozen=True)
class Thinned:
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


def _thin(
    cloud: Cloud, frame: Frame, cell: float, low: Array, high: Array, request: Request, report: Report
) -> Thinned:
    rows, columns = grid_shape(low, high, cell)
    nodes = rows * columns
    lowest = np.full((nodes, 3), np.inf)
    total, number = np.zeros((0, 3)), np.zeros(0)
    done = broken = outside = noise = ground_count = 0
    top = -np.inf
    for raw, classes in cloud.chunks():
        done += len(raw)
        request.tell(min(0.7, 0.7 * done / cloud.count))
        keep = sound(raw)
        broken += int((~keep).sum())
        if classes is not None:
            noisy = np.isin(classes, NOISE_CLASSES)
            noise += int(noisy.sum())
            keep &= ~noisy
            classes = classes[keep]
        points = frame.local(raw[keep])
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
    report.change("broken_points", broken, f"{broken:,} points without finite coordinates left out")
    report.change("noise_points", noise, f"{noise:,} points of the noise classes left out")
    report.change("outside_points", outside, f"{outside:,} points outside of the window left out")
    if broken + noise + outside >= done:
        raise TerrainError(
            f"{report.source}: none of its {done:,} points is usable; is the window, or the file, the right one?"
        )
    held = number > 0
    return Thinned(
        low=low,
        shape=(rows, columns),
        lowest=lowest[np.isfinite(lowest[:, 2])],
        mean_ground=total[held] / number[held, None],
        ground_count=ground_count,
        top=top,
    )


def _pick_ground(thin: Thinned, cell: float, request: Request, report: Report) -> Array:
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


def _without_low_outliers(thin: Thinned, cell: float) -> Array:
    """The lowest points less those far below all but one of their neighbours, on which the cloth would hang."""
    column, row = np.rint((thin.lowest[:, :2] - thin.low) / cell).astype(np.int64).T
    grid = np.full(thin.shape, np.inf)
    row, column = np.clip(row, 0, thin.shape[0] - 1), np.clip(column, 0, thin.shape[1] - 1)
    grid[row, column] = thin.lowest[:, 2]
    third = ndimage.rank_filter(grid, rank=2, size=5, mode="constant", cval=np.inf)[row, column]
    return thin.lowest[~(np.isfinite(third) & (thin.lowest[:, 2] < third - OUTLIER_DEPTH))]


def _gridded(ground: Array, thin: Thinned, cell: float) -> Heights:
    """Heights at the nodes next to points of the ground."""
    column, row = np.rint((ground[:, :2] - thin.low) / cell).astype(np.int64).T
    held = np.zeros(thin.shape, dtype=bool)
    held[np.clip(row, 0, thin.shape[0] - 1), np.clip(column, 0, thin.shape[1] - 1)] = True
    z = np.full(thin.shape, np.nan)
    nodes = np.argwhere(held)[:, ::-1] * cell + thin.low
    z[held] = interpolate(ground[:, :2], ground[:, 2], nodes)
    return Heights(z, cell, (float(thin.low[0]), float(thin.low[1])))


def _note_normalised(ground: Array, thin: Thinned, report: Report) -> None:
    """Say so if the ground is zero everywhere while something stands on it."""
    if float(np.subtract(*np.percentile(ground[:, 2], [99, 1]))) < FLAT and thin.top > ground[:, 2].max() + TALL:
        report.warnings.append(
            f"height-normalised cloud: the ground is {np.median(ground[:, 2]):.2f} m everywhere and points stand up to"
            f" {thin.top:.1f} m above; the shape of the ground was taken out, get the cloud with its true heights"
        )


def _guess_up(cloud: Cloud, report: Report) -> str:
    """z, unless the cloud has a coordinate system or is clearly thinnest along y."""
    size = cloud.high - cloud.low
    if cloud.crs is None and size[1] < 0.3 * min(size[0], size[2]):
        report.up = "y (thinnest along it)"
        report.change(
            "up", 1, f"y taken as up: the cloud is {size[0]:.4g} x {size[1]:.4g} x {size[2]:.4g} along x, y, z"
        )
        return "y"
    return "z"


def _layout(path: Path) -> tuple[int, str | None, tuple[int, ...]]:
    """Lines to skip, separator, and columns of x, y, z and, if named, the class."""
    names: list[str] = []
    with path.open(encoding="utf-8", errors="replace") as file:
        for skip, line in enumerate(itertools.islice(file, 50)):
            text = line.strip()
            separator = next((mark for mark in (";", ",", "\t") if mark in text), None)
            parts = [part.strip().strip('"') for part in (text.split(separator) if separator else text.split())]
            if not text or text.startswith(("//", "#")) or not all(_is_number(part) for part in parts):
                names = [part.lower() for part in parts] or names
                continue
            if len(parts) < 3:
                raise TerrainError(f"{path}, line {skip + 1}: {len(parts)} numbers; a point has x, y and z")
            if len(names) != len(parts) or not {"x", "y", "z"} <= set(names):
                return skip, separator, (0, 1, 2)
            classes = next((names.index(name) for name in ("classification", "class") if name in names), None)
            plan = tuple(names.index(name) for name in ("x", "y", "z"))
            return skip, separator, plan if classes is None else (*plan, classes)
    raise TerrainError(f"{path}: no line of numbers x, y, z among the first 50")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


@contextmanager
def _broken(path: Path, what: str) -> Iterator[None]:
    """Turn whatever a library finds wrong with a broken file into one error."""
    try:
        yield
    except TerrainError:
        raise
    except BaseException as error:
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":  # lazrs panics in Rust's way
            raise
        text = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise TerrainError(f"{path}: cannot be read as {what}: {text}") from None
