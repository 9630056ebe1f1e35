"""Paths from files and into them: recorded or drawn lines of GPX, KML, KMZ, GeoJSON and CSV.

>>> from aoro_gym.terrains import load_path
>>> path, report = load_path("lap.gpx", terrain)  # doctest: +SKIP
>>> print(report)  # doctest: +SKIP
"""

from __future__ import annotations

import csv
import os
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path as File
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from aoro_gym.checks import check_range, printable
from aoro_gym.execution.files import write_bytes, written_whole
from aoro_gym.terrains.georeference import axis_unit, horizontal, to_geographic
from aoro_gym.terrains.io.check import Change
from aoro_gym.terrains.io.frame import FARTHEST
from aoro_gym.terrains.paths.path import Path
from aoro_gym.terrains.paths.path_placement import check_reading, place
from aoro_gym.terrains.paths.planning import JOINT_RANGE_DEG, turning_radius
from aoro_gym.terrains.paths.read_path_table import read_table_of_places
from aoro_gym.terrains.paths.read_tracks import read_document
from aoro_gym.terrains.paths.track_choice import choose
from aoro_gym.terrains.paths.track_parts import (
    STANDSTILL,
    TURN_REACH,
    Indices,
    TrackParts,
    describe_gaps,
    describe_parts,
    find_parts,
)
from aoro_gym.terrains.paths.tracks import Track, TrackFile, length, metres, plan_points
from aoro_gym.terrains.terrain import Terrain

Array = NDArray[Any]

SPARSE = 1.5
"""Points [m] farther apart than this are waypoints to lead a curve through, not a recording to smooth."""
LAP_GAP = 1.5
"""A recording that ends within this [m] of its start, in about its direction, is a lap."""
MOSTLY = 0.5
"""Share of the points whose coordinates are right from which on the others are damage."""
MANY_TURNS = 5
"""Turns on the spot beyond which they may be noise."""
MOST_BLANK = 0.5
"""Share of the points without a speed up to which it is interpolated."""

READERS: dict[str, Callable[[File], TrackFile]] = {
    **dict.fromkeys((".gpx", ".kml", ".kmz", ".geojson", ".json"), read_document),
    **dict.fromkeys((".csv", ".tsv", ".txt"), read_table_of_places),
}
"""By suffix."""


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
    unread: str = ""
    """What else the file holds, such as columns that a path has no use for."""
    changes: list[Change] = field(default_factory=list)
    """What was changed, and what was assumed where the file does not say."""
    warnings: list[str] = field(default_factory=list)

    def change(self, what: str, count: int, text: str) -> None:
        """Note what was changed; nothing if it concerned nothing."""
        if count:
            self.changes.append(Change(what, count, text))

    @property
    def summary(self) -> str:
        """What was read, not read and changed, without the warnings."""
        lines = [f"{self.source}: {self.points} points, {self.kind}; {self.frame}"]
        lines += [f"  not read: {self.unread}"] if self.unread else []
        lines += [f"  changed: {change.text}" for change in self.changes]
        return "\n".join(lines)

    def __str__(self) -> str:
        return "\n".join([self.summary, *(f"  warning: {warning}" for warning in self.warnings)])


class LoadedPath(NamedTuple):
    """A path, and what was done to get it."""

    path: Path
    report: PathReport


def load_path(
    source: str | os.PathLike[str],
    terrain: Terrain | None = None,
    *,
    crs: str | None = None,
    track: str | int | None = None,
    join_gaps: bool = False,
    closed: bool | None = None,
    smoothing: float = 3.0,
    spacing: float | None = 0.25,
    name: str | None = None,
) -> LoadedPath:
    """A path from a GPX, KML, KMZ, GeoJSON or CSV file, in the local frame of ``terrain``.

    Latitude and longitude go through the terrain's coordinate reference system; without one, x is east and y north [m]
    from the first point. Metres are local ones, unless ``crs`` says otherwise or they lie as far out as the terrain's
    origin. Of a recording with gaps the longest part is taken, with a warning.

    Args:
        source: ``.gpx``, ``.kml``, ``.kmz``, ``.geojson``, ``.json``; or ``.csv``, ``.tsv``, ``.txt``: columns by header,
            with their units in it.
        terrain: Whose frame the path is brought to.
        crs: Of the file's coordinates, as pyproj reads it (``"EPSG:32633"``); wins over what the file says.
        track: Which of the file's lines is meant, where it holds several: its name, or its number from 1. Parts of a
            line are named as ``NAME.N`` or ``N.N``, of the only line as ``N``, too.
        join_gaps: Whether gaps are bridged by straight lines.
        closed: Whether the last point leads on to the first; None: if the ends meet.
        smoothing: Wiggles of a recording shorter than this [m] are taken out (:meth:`Path.smooth`); 0 for none. Points
            more than ``SPARSE`` apart become waypoints of a spline instead.
        spacing: Of the path's points [m]; None keeps those of the file, unsmoothed.
        name: Of the path; the file's by default.

    Raises ``ValueError`` in one sentence with file, reason and fix: where nothing says which of several lines is meant,
    where the recording turns round on the spot, where another reading of its coordinates fits the terrain better;
    ``OSError`` if the file cannot be opened.
    """
    file = File(source)
    report = PathReport(source=str(file))
    try:
        check_range("smoothing", smoothing, "m", ge=0.0, le=100.0)
        reader = READERS.get(file.suffix.lower())
        if reader is None:
            raise ValueError(f"paths are read from {' '.join(READERS)}; export it as one of these")
        found = reader(file)
        report.warnings += found.warnings
        for text in found.assumed:
            report.change("assumed", 1, text)
        report.unread = found.other
        one, part, number = choose(found, track)
        one = _finite(_in_one_system(one, terrain, crs), report)
        check_reading(one, terrain, crs)
        report.kind, report.points = one.title, one.size
        one = _driven_points(
            one,
            _rough_plan(one, crs),
            part,
            "" if len(found) == 1 else f"{number}.",
            join_gaps,
            smoothing,
            spacing is not None,
            report,
        )
        path = _path(one, terrain, crs, closed, report)
        path = replace(path, name=name or file.stem)
        if spacing is not None:
            path = _smoothed(path, smoothing, spacing, report)
    except ValueError as error:
        raise ValueError(printable(f"{file}: {error}")) from None
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
        around = slice(None) if not path.closed else [*range(len(x)), 0]
        speed = None if path.speed is None else path.speed[around]
        _write_gpx(target, path.name, *to_geographic(terrain, x[around], y[around]), speed)
        return
    if target.suffix.lower() != ".csv":
        raise ValueError(f"{target}: paths are written as .csv or .gpx")
    columns = {"x_m": x, "y_m": y}
    if terrain is not None and placed:
        columns["latitude_deg"], columns["longitude_deg"] = to_geographic(terrain, x, y)
    columns |= {"s_m": path.stations, "heading_rad": path.headings, "curvature_per_m": path.curvatures}
    if path.speed is not None:
        columns["speed_m_per_s"] = path.speed
    with written_whole(target) as temporary, temporary.open("w", newline="", encoding="utf-8") as out:
        writer = csv.writer(out)
        writer.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            writer.writerow([f"{value:.12g}" for value in row])


def _write_gpx(target: File, name: str, latitude: Array, longitude: Array, speed: Array | None) -> None:
    garmin = "http://www.garmin.com/xmlschemas/TrackPointExtension/v2"  # GPX 1.1 itself has no speed
    spaces = {"xmlns": "http://www.topografix.com/GPX/1/1", "xmlns:gpxtpx": garmin}
    book = ElementTree.Element("gpx", version="1.1", creator="aoro-gym", attrib=spaces)
    track = ElementTree.SubElement(book, "trk")
    ElementTree.SubElement(track, "name").text = name
    segment = ElementTree.SubElement(track, "trkseg")
    for number, (north, east) in enumerate(zip(latitude, longitude, strict=True)):
        point = ElementTree.SubElement(segment, "trkpt", lat=f"{north:.9f}", lon=f"{east:.9f}")
        if speed is not None:
            inner = ElementTree.SubElement(point, "extensions")
            inner = ElementTree.SubElement(inner, "gpxtpx:TrackPointExtension")
            ElementTree.SubElement(inner, "gpxtpx:speed").text = f"{speed[number]:.6g}"
    ElementTree.indent(book)
    write_bytes(target, ElementTree.tostring(book, encoding="utf-8", xml_declaration=True))


def _in_one_system(track: Track, terrain: Terrain | None, crs: str | None) -> Track:
    """The track with either degrees or x and y, whichever leads to the terrain."""
    columns = track.columns
    system = crs if crs is not None else track.crs
    in_degrees = system is not None and horizontal(system).is_geographic
    if {"latitude", "x"} <= columns.keys():
        placed = terrain is not None and terrain.crs is not None
        degrees = in_degrees or (placed and system is None)
        unwanted = ("x", "y") if degrees else ("latitude", "longitude")
        columns = {key: values for key, values in columns.items() if key not in unwanted}
    elif "x" in columns and in_degrees:
        names = {"x": "longitude", "y": "latitude"}
        columns = {names.get(key, key): values for key, values in columns.items()}
    elif "latitude" in columns and system is not None and not in_degrees and not track.is_surely_degrees:
        names = {"longitude": "x", "latitude": "y"}
        columns = {names.get(key, key): values for key, values in columns.items()}
    return replace(track, columns=columns)


def _finite(track: Track, report: PathReport) -> Track:
    """The track without points that have no coordinates, or none of this world."""
    places = np.stack([values for key, values in track.columns.items() if key != "speed"])
    known = ~np.isnan(places).any(axis=0)
    valid = np.all(np.abs(np.where(np.isnan(places), 0.0, places)) <= FARTHEST, axis=0)
    report.change("incomplete", int((~known).sum()), f"{int((~known).sum())} rows without coordinates left out")
    if "latitude" in track.columns:
        on_earth = (np.abs(track.columns["latitude"]) <= 90.0) & (np.abs(track.columns["longitude"]) <= 180.0)
        if np.sum(on_earth & known & valid) >= MOSTLY * np.sum(known & valid):  # else all of them are something else
            valid &= on_earth
    broken = np.flatnonzero(known & ~valid)
    if len(broken):
        worst = places[:, broken[0]]
        report.warnings.append(
            f"{len(broken)} points whose coordinates are no place on Earth left out, such as {track.place(int(broken[0]))}:"
            f" {worst[0]:g}, {worst[1]:g}"
        )
    whole = np.flatnonzero(known & valid)
    if len(whole) < 2:
        raise ValueError(f"it has {len(whole)} points with coordinates; a path needs at least 2")
    return track.taken(whole)


def _rough_plan(track: Track, crs: str | None) -> Array:
    """(P, 2) about where its points are [m], in any frame."""
    system = crs if crs is not None else track.crs
    unit = axis_unit(horizontal(system)) if system is not None and "x" in track.columns else 1.0
    return plan_points(track) * unit


def _driven_points(
    track: Track,
    points: Array,
    part: int | None,
    label: str,
    join_gaps: bool,
    smoothing: float,
    thin: bool,
    report: PathReport,
) -> Track:
    """What of a track is driven in one go, without standstill and outliers.

    Args:
        track: Of finite coordinates.
        points: (P, 2) about where they are [m].
        part: Its part that is meant, from 1; None: not said.
        label: What stands before the number of a part where it is asked for.
        join_gaps: Whether gaps are bridged.
        smoothing: Wiggles shorter than this [m] are no turns.
        thin: Whether standstill and outliers are left out.
        report: Gets what was left out.
    """
    parts = find_parts(track, points, reach=max(TURN_REACH, smoothing / 3.0))
    if len(parts.kept) < 2:
        raise ValueError(
            f"its points all lie within {STANDSTILL:g} m: the vehicle stood still, or they are in a larger unit than m"
        )
    if join_gaps and parts.gaps:
        wide = sum(cut.gap or 0.0 for cut in parts.gaps)
        report.warnings.append(
            f"{describe_gaps(track, parts)}: {metres(wide)} that were not recorded are bridged straight"
        )
        parts = parts.with_gaps_joined()
    if parts.joined:
        report.change(
            "segments",
            len(parts.joined),
            f"{len(parts.joined) + 1} segments joined, at most {max(parts.joined):.1f} m apart",
        )
    chosen = _part(track, points, parts, part, label, report)
    first = 0 if chosen[0] == parts.kept[0] else int(chosen[0])
    last = len(points) if chosen[-1] == parts.kept[-1] else int(chosen[-1]) + 1
    if not thin:
        return track.taken(np.arange(first, last))
    outliers = int(((first <= parts.outliers) & (parts.outliers < last)).sum())
    standing = last - first - len(chosen) - outliers
    report.change(
        "standstill", standing, f"{standing} points within {STANDSTILL:g} m of the one before (standstill) left out"
    )
    if outliers:
        wrong = parts.outliers[(first <= parts.outliers) & (parts.outliers < last)]
        report.change(
            "jumps",
            outliers,
            f"{outliers} points that jump away and back left out, such as {track.place(int(wrong[0]))}",
        )
    return track.taken(chosen)


def _part(track: Track, points: Array, parts: TrackParts, part: int | None, label: str, report: PathReport) -> Indices:
    """The part that is meant, or the longest between gaps; ``ValueError`` where the recording turns round."""
    every = parts.parts
    list_ = f"{len(every)} parts: {describe_parts(track, parts, points)}"
    if not every:
        raise ValueError(f"it has no two points in a row without a gap: {describe_gaps(track, parts)}")
    ask = f"track={label}N (--track)"
    if part is not None:
        if not 1 <= part <= len(every):
            raise ValueError(f"part {part} is asked for, but it has {list_}")
        if len(every) > 1:
            report.change("part", 1, f"part {part} of {list_}")
        return every[part - 1]
    longest = max(parts.stretches, key=lambda stretch: length(points[stretch]))
    turns = parts.turns_in(longest)
    if len(turns):
        inside = longest[longest <= turns[0]]
        more = f" and {len(turns) - 1} more times" if len(turns) > 1 else ""
        more += ", unless that is noise (then give a larger smoothing=...)" if len(turns) > MANY_TURNS else ""
        raise ValueError(
            f"the recording turns round on the spot at {metres(length(points[inside]))}"
            f" ({track.place(int(turns[0]))}){more}, which no path can; split it there, or take one with {ask} of its"
            f" {list_}"
        )
    if parts.gaps:
        number = 1 + next(i for i, one in enumerate(every) if one[0] == longest[0])
        taken = f"part {number}, the longest, is taken of {list_}; {ask} takes another"
        if len(every) == 1:
            taken = f"only {describe_parts(track, parts, points).removeprefix('1 ').strip('()')} are taken"
        report.warnings.append(
            f"{describe_gaps(track, parts)}: not bridged; {taken}, join_gaps=True (--join-gaps) bridges the gaps"
        )
    return longest


def _path(track: Track, terrain: Terrain | None, crs: str | None, closed: bool | None, report: PathReport) -> Path:
    """The path through a track's points, without the end of a lap that overlaps its start."""
    points, speed = place(track, terrain, crs, report), _speed(track, report)
    ends = _points_of_lap(points)
    if closed is None:
        closed = ends is not None
        report.change("closed", int(closed), "its ends meet: taken for a lap (closed=False keeps it open)")
    if closed:
        last = len(points) if ends is None else ends
        report.change("overlap", len(points) - last, f"{len(points) - last} points beyond the lap's start left out")
        points, speed = points[:last], None if speed is None else speed[:last]
    return Path(points, closed, speed)


def _speed(track: Track, report: PathReport) -> Array | None:
    """(P,) speed [m/s], between its values where some are missing."""
    speed = track.columns.get("speed")
    if speed is None:
        return None
    wrong = np.flatnonzero((speed < 0.0) | np.isinf(speed))
    if len(wrong):
        raise ValueError(
            f"its speed at {track.place(int(wrong[0]))} is {speed[wrong[0]]:g} m/s, but must be finite and at least 0; leave"
            " the speeds out, or split the recording where it goes backwards"
        )
    blank = np.isnan(speed)
    count = int(blank.sum())
    if count > MOST_BLANK * len(speed):
        report.warnings.append(f"no speed is read: {count} of {len(speed)} points have none")
        return None
    if count:
        index = np.arange(len(speed))
        speed = np.interp(index, index[~blank], speed[~blank])
        report.change("speed", count, f"{count} of {len(speed)} points have no speed: interpolated")
    return speed


def _points_of_lap(points: Array) -> int | None:
    """How many points make the lap if the ends meet; None if they do not."""
    if len(points) < 8:
        return None
    start = points[1] - points[0]
    start = start / np.hypot(*start)
    last = len(points)
    # from the end back: what lies beyond the start, beside its first metres, was driven twice
    while last > 3:
        to_start = points[0] - points[last - 1]
        if np.hypot(*to_start) > LAP_GAP or to_start @ start >= STANDSTILL / 2.0:
            break
        last -= 1
    apart = points[0] - points[last - 1]
    usual = float(np.median(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    arrives = points[last - 1] - points[last - 2]
    if np.hypot(*apart) > max(LAP_GAP, 1.5 * usual) or arrives @ start < 0.7 * np.hypot(*arrives):
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
    moved = _distance(path.points, curve)
    report.change(
        "smoothed",
        len(path.points),
        f"smoothed over {smoothing:g} m: points moved by {np.sqrt(np.mean(moved**2)) * 100:.1f} cm in the mean,"
        f" {moved.max() * 100:.1f} cm at most",
    )
    return curve


def _distance(points: Array, curve: Path) -> Array:
    """(P,) distance [m] of points from a curve whose points lie close to one another."""
    nearest = np.asarray(KDTree(curve.points).query(points)[1])
    return np.abs(curve.project(points, curve.stations[nearest])[1])


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
