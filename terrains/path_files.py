"""Paths from files and into them: recorded GPX tracks, and CSV with latitude and longitude or metres.

>>> from aoro_gym.terrains import load_path
>>> path, report = load_path("lap.gpx", terrain)  # doctest: +SKIP
>>> print(report)  # doctest: +SKIP
"""

from __future__ import annotations

import csv
import os
import re
from dataclasses import dataclass, field, replace
from pathlib import Path as File
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aoro_gym.terrains.check import Change
from aoro_gym.terrains.extras import extra
from aoro_gym.terrains.georeference import from_world, to_geographic, to_local
from aoro_gym.terrains.path import Path
from aoro_gym.terrains.planning import JOINT_RANGE_DEG, turning_radius
from aoro_gym.terrains.terrain import LARGEST_COORDINATE, Terrain

Array = NDArray[Any]

STANDSTILL = 0.15
"""Points [m] closer to the last one than this are the same place: several times the noise of RTK."""
FARTHEST_JUMP = 2.0
"""A point farther than this [m], and than five usual steps, from both of its neighbours is a wrong one."""
SPARSE = 1.5
"""Points [m] farther apart than this are waypoints to lead a curve through, not a recording to smooth."""
GAP = 1.5
"""A recording that ends within this [m] of its start, in about its direction, is a lap."""

COLUMNS = {
    "latitude": r"(gps|rtk)?lat(itude)?(deg|wgs84)?",
    "longitude": r"(gps|rtk)?(lon|lng|long|longitude)(deg|wgs84)?",
    "x": r"(local|true)?(position)?x(m)?|e|east(ing)?(m)?",
    "y": r"(local|true)?(position)?y(m)?|n|north(ing)?(m)?",
    "speed": r"(target|gps|reference)?(speed|velocity)(mpers|ms|m/s)?|v",
}
"""Headers that are recognised, without regard to case, blanks, underscores and brackets."""


@dataclass
class PathReport:
    """What was read and what was changed; ``str`` shows it."""

    source: str
    kind: str = ""
    """What the file holds."""
    points: int = 0
    """As read."""
    frame: str = ""
    """How its coordinates became local ones."""
    tangent_point: tuple[float, float] | None = None
    """Latitude and longitude [deg] of local (0, 0), where no terrain said."""
    changes: list[Change] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def change(self, what: str, count: int, text: str) -> None:
        """Note what was changed; nothing if it concerned nothing."""
        if count:
            self.changes.append(Change(what, count, text))

    def __str__(self) -> str:
        lines = [f"{self.source}: {self.points} points, {self.kind}; {self.frame}"]
        lines += [f"  changed: {change.text}" for change in self.changes]
        lines += [f"  warning: {warning}" for warning in self.warnings]
        return "\n".join(lines)


class LoadedPath(NamedTuple):
    """A path, and what was done to get it."""

    path: Path
    report: PathReport


def load_path(
    source: str | os.PathLike[str],
    terrain: Terrain | None = None,
    *,
    crs: str | None = None,
    closed: bool | None = None,
    smoothing: float = 3.0,
    spacing: float | None = 0.25,
    name: str | None = None,
) -> LoadedPath:
    """A path from a GPX or CSV file, in the local frame of ``terrain``.

    Latitude and longitude go through the terrain's coordinate reference system; without one, x is east and y north [m]
    from the first point. Metres are local ones, unless ``crs`` says otherwise or they lie as far out as the terrain's
    origin.

    Args:
        source: ``.gpx`` (the longest track, else route, else the waypoints), or ``.csv``, ``.txt``: columns by header,
            parted by commas, semicolons, tabs or blanks.
        terrain: Whose frame the path is brought to.
        crs: Of x and y in the file, as pyproj reads it (``"EPSG:32633"``).
        closed: Whether the last point leads on to the first; None: if the ends meet.
        smoothing: Wiggles of a recording shorter than this [m] are taken out (:meth:`Path.smooth`); 0 for none. Points
            more than ``SPARSE`` apart become waypoints of a spline instead.
        spacing: Of the path's points [m]; None keeps those of the file, unsmoothed.
        name: Of the path; the file's by default.

    Raises ``ValueError`` in one sentence with file, reason and fix; ``OSError`` if the file cannot be opened.
    """
    file = File(source)
    if not 0.0 <= smoothing <= 100.0:
        raise ValueError(f"smoothing is {smoothing:g} m, but must be in [0, 100]")
    report = PathReport(source=str(file))
    columns = _read_gpx(file, report) if file.suffix.lower() == ".gpx" else _read_csv(file, report)
    points, speed = _local(columns, terrain, crs, report)
    report.points = len(points)
    try:
        path = _cleaned(points, speed, closed, spacing is not None, report)
        path = replace(path, name=name or file.stem)
        if spacing is not None:
            path = _smoothed(path, smoothing, spacing, report)
    except ValueError as error:  # what a path itself refuses
        raise ValueError(f"{file}: {error}") from None
    _check(path, terrain, report)
    return LoadedPath(path, report)


def save_path(path: Path, file: str | os.PathLike[str], terrain: Terrain | None = None) -> None:
    """Write ``path`` as CSV (local metres; latitude and longitude too if the terrain knows where it lies) or as GPX.

    Raises ``ValueError`` for another suffix, and for GPX if no terrain with a coordinate reference system is given.
    """
    target = File(file)
    x, y = path.points.T
    placed = terrain is not None and terrain.crs is not None
    if target.suffix.lower() == ".gpx":
        if terrain is None or not placed:
            raise ValueError(f"{target}: GPX needs latitude and longitude; give a terrain with a crs, or write a .csv")
        gpx = extra("gpxpy.gpx", "a GPX file")
        segment = gpx.GPXTrackSegment()
        around = slice(None) if not path.closed else [*range(len(x)), 0]
        for latitude, longitude in zip(*to_geographic(terrain, x[around], y[around]), strict=True):
            segment.points.append(gpx.GPXTrackPoint(round(float(latitude), 9), round(float(longitude), 9)))
        track = gpx.GPXTrack(name=path.name)
        track.segments.append(segment)
        book = gpx.GPX()
        book.tracks.append(track)
        target.write_text(book.to_xml(), encoding="utf-8")
        return
    if target.suffix.lower() != ".csv":
        raise ValueError(f"{target}: paths are written as .csv or .gpx")
    columns = {"x_m": x, "y_m": y}
    if terrain is not None and placed:
        columns["latitude_deg"], columns["longitude_deg"] = to_geographic(terrain, x, y)
    columns |= {"s_m": path.stations, "heading_rad": path.headings, "curvature_per_m": path.curvatures}
    if path.speed is not None:
        columns["speed_m_per_s"] = path.speed
    with target.open("w", newline="", encoding="utf-8") as out:
        writer = csv.writer(out)
        writer.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            writer.writerow([f"{value:.12g}" for value in row])


def _read_gpx(file: File, report: PathReport) -> dict[str, Array]:
    gpxpy = extra("gpxpy", "a GPX file")
    text = _text(file)
    try:
        book = gpxpy.parse(text)
    except Exception as error:  # whatever the library finds wrong with a broken file
        raise ValueError(f"{file}: cannot be read as GPX: {error}") from None
    candidates: list[tuple[str, list[Any]]] = [
        (f"GPX track {track.name or number + 1!r}", [point for part in track.segments for point in part.points])
        for number, track in enumerate(book.tracks)
    ]
    if not any(points for _, points in candidates):
        candidates = [(f"GPX route {route.name or n + 1!r}", route.points) for n, route in enumerate(book.routes)]
    if not any(points for _, points in candidates):
        candidates = [("GPX waypoints", book.waypoints)]
    kind, points = max(candidates, key=lambda item: len(item[1]))
    if not points:
        raise ValueError(f"{file}: it has no track, route or waypoints")
    others = sum(1 for _, other in candidates if other) - 1
    report.change("left_out", others, f"{others} shorter tracks or routes of the file left out")
    report.kind = kind
    return {
        "latitude": np.array([point.latitude for point in points], dtype=np.float64),
        "longitude": np.array([point.longitude for point in points], dtype=np.float64),
    }


def _read_csv(file: File, report: PathReport) -> dict[str, Array]:
    lines = [line for line in _text(file).splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        raise ValueError(f"{file}: it has no lines")
    mark = next((mark for mark in (";", "\t", ",") if mark in lines[0]), None)
    rows = [line.split() for line in lines] if mark is None else list(csv.reader(lines, delimiter=mark))
    first = [_number(cell) for cell in rows[0]]
    if len(first) >= 2 and None not in first[:2]:
        found = {"x": 0, "y": 1}
        report.kind = "two columns without a header, taken for x and y [m]"
        degrees = [(a, b) for a, b, *_ in ([_number(cell) for cell in row] for row in rows if len(row) > 1)]
        spread = np.ptp(np.array(degrees, dtype=np.float64), axis=0)
        if np.all(spread < 0.5) and len(rows) > 2:
            raise ValueError(f"{file}: its columns have no header and look like degrees; add latitude,longitude or x,y")
    else:
        bare = [re.sub(r"[\s_\-\[\]()°.]", "", cell.lower()) for cell in rows[0]]
        found = {}
        for key, pattern in COLUMNS.items():
            fitting = [i for i, cell in enumerate(bare) if re.fullmatch(pattern, cell)]
            if fitting:
                found[key] = fitting[0]
        header, rows = ", ".join(rows[0]), rows[1:]
        if not ({"latitude", "longitude"} <= found.keys() or {"x", "y"} <= found.keys()):
            raise ValueError(
                f"{file}: its header is {header}, but must name latitude and longitude [deg], or x and y [m]"
            )
    geographic, plane = {"latitude", "longitude"} <= found.keys(), {"x", "y"} <= found.keys()
    columns = {
        key: np.array([_number(row[i]) if i < len(row) else None for row in rows], dtype=np.float64)
        for key, i in found.items()
    }
    if not report.kind:
        report.kind = " and ".join(["latitude, longitude"] * geographic + ["x, y"] * plane)
    return columns


def _text(file: File) -> str:
    data = file.read_bytes()
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _number(cell: str) -> float | None:
    """The number in a cell, with a decimal point or comma; None if there is none."""
    try:
        return float(cell.strip().replace(",", "."))
    except ValueError:
        return None


def _local(
    columns: dict[str, Array], terrain: Terrain | None, crs: str | None, report: PathReport
) -> tuple[Array, Array | None]:
    """(P, 2) local points and (P,) speeds of the finite rows."""
    whole = np.all([np.isfinite(columns[key]) for key in columns if key != "speed"], axis=0)
    report.change("incomplete", int((~whole).sum()), f"{int((~whole).sum())} rows without coordinates left out")
    columns = {key: values[whole] for key, values in columns.items()}
    if whole.sum() < 2:
        raise ValueError(f"{report.source}: it has {int(whole.sum())} points with coordinates; a path needs at least 2")
    placed = terrain is not None and terrain.crs is not None
    if "latitude" in columns and (placed or "x" not in columns):
        points = _from_degrees(columns["latitude"], columns["longitude"], terrain, report)
    else:
        points = _from_metres(columns["x"], columns["y"], terrain, crs, report)
    speed = columns.get("speed")
    if speed is not None and not np.isfinite(speed).all():
        report.change("speed", 1, "the speed is not given at every point and left out")
        speed = None
    return points, speed


def _from_degrees(latitude: Array, longitude: Array, terrain: Terrain | None, report: PathReport) -> Array:
    if terrain is not None and terrain.crs is not None:
        report.frame = f"brought to {terrain.name!r} through {terrain.crs.splitlines()[0][:60]}"
        return np.stack(to_local(terrain, latitude, longitude), axis=1)
    for key, values, bound in (("latitude", latitude, 90.0), ("longitude", longitude, 180.0)):
        if np.abs(values).max() > bound:
            worst = values[np.argmax(np.abs(values))]
            raise ValueError(f"{report.source}: {key} = {worst:g} is outside [-{bound:g}, {bound:g}] deg")
    pyproj = extra("pyproj", "a path in latitude and longitude")
    first = (float(latitude[0]), float(longitude[0]))
    plane = pyproj.Proj(proj="aeqd", lat_0=first[0], lon_0=first[1], datum="WGS84")
    report.tangent_point = first
    report.frame = f"x east, y north [m] from its first point at {first[0]:.7f}°, {first[1]:.7f}°"
    if terrain is not None:
        report.warnings.append(
            f"terrain {terrain.name!r} has no coordinate reference system: the path starts at its local origin;"
            " load the terrain with crs='EPSG:...' to lay it where it was driven"
        )
    return np.stack(plane(longitude, latitude), axis=1)


def _from_metres(x: Array, y: Array, terrain: Terrain | None, crs: str | None, report: PathReport) -> Array:
    if crs is not None:
        if terrain is None:
            raise ValueError(
                f"{report.source}: crs = {crs!r} places the path on Earth; give the terrain to bring it to"
            )
        report.frame = f"brought from {crs} to {terrain.name!r}"
        return np.stack(from_world(terrain, x, y, crs=crs), axis=1)
    points = np.stack([x, y], axis=1)
    report.frame = "local x, y [m]"
    if np.abs(points).max() <= LARGEST_COORDINATE:
        return points
    if terrain is None or not any(terrain.origin[:2]):
        raise ValueError(
            f"{report.source}: its coordinates reach {np.abs(points).max():.0f} m, which are no local ones; give the terrain"
            " they belong to, or crs='EPSG:...'"
        )
    points = points - np.asarray(terrain.origin[:2])
    report.change("shifted", 1, f"world coordinates, brought to {terrain.name!r} by its origin")
    if np.abs(points).max() > LARGEST_COORDINATE:
        raise ValueError(
            f"{report.source}: its coordinates lie {np.abs(points).max():.0f} m from the terrain; give crs=..."
        )
    return points


def _cleaned(points: Array, speed: Array | None, closed: bool | None, thin: bool, report: PathReport) -> Path:
    """A path without standstill, wrong points and the end of a lap that overlaps its start."""
    kept = np.arange(len(points))
    if thin:
        kept = _moving(points)
        report.change(
            "standstill",
            len(points) - len(kept),
            f"{len(points) - len(kept)} points within {STANDSTILL:g} m of the one before (standstill) left out",
        )
        wrong = _jumps(points[kept])
        report.change("jumps", int(wrong.sum()), f"{int(wrong.sum())} points that jump away and back left out")
        kept = kept[~wrong]
        if len(kept) < 2:
            raise ValueError(f"its points all lie within {STANDSTILL:g} m: the vehicle stood still")
    points, speed = points[kept], None if speed is None else speed[kept]
    ends = _lap(points)
    if closed is None:
        closed = ends is not None
        report.change("closed", int(closed), "its ends meet: taken for a lap (closed=False keeps it open)")
    if closed:
        last = len(points) if ends is None else ends
        report.change("overlap", len(points) - last, f"{len(points) - last} points beyond the lap's start left out")
        points, speed = points[:last], None if speed is None else speed[:last]
    return Path(points, closed, speed)


def _moving(points: Array) -> NDArray[np.intp]:
    """Indices of the points that lie apart from the last one taken."""
    kept = [0]
    for i in range(1, len(points)):
        if np.hypot(*(points[i] - points[kept[-1]])) >= STANDSTILL:
            kept.append(i)
    return np.array(kept)


def _jumps(points: Array) -> NDArray[np.bool_]:
    """Inner points far from both neighbours, which are near to each other."""
    wrong = np.zeros(len(points), dtype=bool)
    if len(points) < 5:
        return wrong
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    far = step > max(FARTHEST_JUMP, 5.0 * float(np.median(step)))
    back = np.linalg.norm(points[2:] - points[:-2], axis=1) < 0.5 * (step[:-1] + step[1:])
    wrong[1:-1] = far[:-1] & far[1:] & back
    return wrong


def _lap(points: Array) -> int | None:
    """How many points make the lap if the ends meet; None if they do not."""
    if len(points) < 8:
        return None
    start = points[1] - points[0]
    start = start / np.hypot(*start)
    last = len(points)
    # from the end back: what lies beyond the start, beside its first metres, was driven twice
    while last > 3:
        to_start = points[0] - points[last - 1]
        if np.hypot(*to_start) > GAP or to_start @ start >= STANDSTILL / 2.0:
            break
        last -= 1
    apart = points[0] - points[last - 1]
    usual = float(np.median(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    arrives = points[last - 1] - points[last - 2]
    if np.hypot(*apart) > max(GAP, 1.5 * usual) or arrives @ start < 0.7 * np.hypot(*arrives):
        return None
    return last


def _smoothed(path: Path, smoothing: float, spacing: float, report: PathReport) -> Path:
    step = path.length / path.num_segments
    if step > SPARSE:
        curve = Path.spline(path.points, spacing=spacing, closed=path.closed, speed=path.speed, name=path.name)
        report.change(
            "spline", len(path.points), f"{len(path.points)} waypoints {step:.1f} m apart led through by a spline"
        )
        return curve
    if smoothing == 0.0:
        return path.resample(spacing)
    curve = path.smooth(smoothing, spacing=min(spacing, 0.4 * smoothing)).resample(spacing)
    moved = np.abs(curve.project(path.points)[1])
    report.change(
        "smoothed",
        len(path.points),
        f"smoothed over {smoothing:g} m: points moved by {np.sqrt(np.mean(moved**2)) * 100:.1f} cm in the mean,"
        f" {moved.max() * 100:.1f} cm at most",
    )
    return curve


def _check(path: Path, terrain: Terrain | None, report: PathReport) -> None:
    radius = 1.0 / max(float(np.abs(path.curvatures).max()), 1e-9)
    tightest = turning_radius(JOINT_RANGE_DEG)
    if radius < tightest:
        report.warnings.append(
            f"its tightest bend has a radius of {radius:.1f} m, but the joint turns no tighter than {tightest:.1f} m;"
            " a larger smoothing=... may help"
        )
    if terrain is not None:
        low, high = terrain.extent
        outside = np.any((path.points < low[:2]) | (path.points > high[:2]), axis=1)
        if outside.any():
            report.warnings.append(f"{outside.mean():.0%} of it lies outside of terrain {terrain.name!r}")
