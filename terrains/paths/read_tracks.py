"""Readers of GPX, KML, KMZ and GeoJSON: the lines in them, as tracks in degrees (GeoJSON: in its own system, too)."""

from __future__ import annotations

import io
import json
import re
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path as File
from typing import Any

import numpy as np

from aoro_gym.terrains.paths.tracks import Track, TrackFile, display_counts, display_text
from aoro_gym.terrains.paths.xml_tree import Element, looks_like_xml, parse

LARGEST_FILE = 50_000_000
"""Bytes of a file, and of what is packed in a KMZ: about 400,000 points of a GPX."""
DEEPEST_COLLECTION = 10
"""GeoJSON collections within one another."""

Place = tuple[float, float, float | None, int | None]
"""Latitude, longitude (or y, x), speed [m/s], line of the file."""


def read_document(file: File) -> TrackFile:
    """The tracks of a GPX, KML, KMZ or GeoJSON file; what it is, its content says.

    Raises ``ValueError`` in one sentence with place and reason, without the file's name; ``OSError`` if it cannot be
    opened.
    """
    with file.open("rb") as opened:
        data = opened.read(LARGEST_FILE + 1)
    if len(data) > LARGEST_FILE:
        raise ValueError(f"it is larger than {LARGEST_FILE / 1e6:.0f} MB; cut it into shorter recordings")
    if not data.strip():
        raise ValueError("the file is empty")
    if data.startswith(b"PK\x03\x04"):
        return _read_kmz(data)
    if looks_like_xml(data):
        return _read_xml(data)
    if file.suffix.lower() in (".geojson", ".json"):
        return _read_geojson(data)
    what = "a zip archive" if file.suffix.lower() == ".kmz" else "XML"
    raise ValueError(f"it is not {what}, as its name says; export it again as GPX, KML, GeoJSON or CSV")


def _read_xml(data: bytes) -> TrackFile:
    root = parse(data)
    if root.tag == "gpx":
        return _read_gpx(root)
    if root.tag in ("kml", "document", "placemark", "folder"):
        return _read_kml(root)
    raise ValueError(f"it is XML of {display_text(root.tag)}, not GPX or KML; export it as one of these, or as CSV")


def _read_gpx(root: Element) -> TrackFile:
    found = TrackFile()
    for track in root.all("trk"):
        segments = [[_gpx_place(point) for point in part.all("trkpt")] for part in track.all("trkseg")]
        _add(found, "GPX track", track.child_text("name"), segments)
    for route in root.all("rte"):
        _add(found, "GPX route", route.child_text("name"), [[_gpx_place(point) for point in route.all("rtept")]])
    _add_marks(found, "GPX waypoints", [_gpx_place(point) for point in root.all("wpt")])
    return _known(found, "track, route or waypoints")


def _gpx_place(point: Element) -> Place:
    latitude, longitude = (_number(point.attributes.get(key, ""), key, point.line) for key in ("lat", "lon"))
    speed = next((inner for inner in point.walk() if inner.tag == "speed"), None)  # GPX 1.0, Garmin's extension: m/s
    known = speed is not None and speed.text
    return latitude, longitude, _number(speed.text, "speed", speed.line) if speed and known else None, point.line


def _read_kml(root: Element) -> TrackFile:
    found = TrackFile()
    marks: list[Place] = []
    inside: set[int] = set()  # geometries that belong to a placemark before
    for placemark in root.walk():
        if placemark.tag == "networklink":
            found.unread["link to another file"] += 1
        if placemark.tag != "placemark" or id(placemark) in inside:
            continue
        name = placemark.child_text("name")
        lines: list[list[Place]] = []
        tracks: list[list[Place]] = []
        for part in placemark.walk():
            inside.add(id(part))
            if part.tag == "linestring":
                lines.append(_kml_coordinates(part))
            elif part.tag == "track":
                tracks.append([_kml_coord(coord) for coord in part.all("coord")])
            elif part.tag == "point":
                marks += _kml_coordinates(part)
            elif part.tag in ("polygon", "model"):
                found.unread[part.tag] += 1
        _add(found, "KML LineString", name, lines)
        _add(found, "KML track", name, tracks)
    _add_marks(found, "KML points", marks)
    return _known(found, "LineString, gx:Track or points")


def _kml_coordinates(geometry: Element) -> list[Place]:
    places: list[Place] = []
    for coordinates in geometry.all("coordinates"):
        for word in ",".join(part.strip() for part in coordinates.text.split(",")).split():
            places.append(_kml_place(word.split(","), word, coordinates.line))
    return places


def _kml_coord(coord: Element) -> Place:
    return _kml_place(coord.text.split(), coord.text, coord.line)


def _kml_place(numbers: list[str], word: str, line: int) -> Place:
    if not numbers:  # a gx:coord of a time without a fix
        return float("nan"), float("nan"), None, line
    if not 2 <= len(numbers) <= 3:
        raise ValueError(f"line {line}: coordinates {display_text(word)} are not longitude, latitude[, altitude]")
    return _number(numbers[1], "latitude", line), _number(numbers[0], "longitude", line), None, line


def _read_kmz(data: bytes) -> TrackFile:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            inner = [entry for entry in archive.infolist() if entry.filename.lower().endswith(".kml")]
            if not inner:
                raise ValueError("it is a zip archive without a .kml; pack doc.kml in it, or give that")
            # the format: the first .kml at the top is the document, by convention doc.kml
            main = min(inner, key=lambda entry: entry.filename.count("/"))
            with archive.open(main) as opened:
                text = opened.read(LARGEST_FILE + 1)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, OSError) as error:
        raise ValueError(f"it cannot be unpacked: {str(error)[:100]}; export it again") from None
    if len(text) > LARGEST_FILE:
        raise ValueError(f"its {display_text(main.filename)} is larger than {LARGEST_FILE / 1e6:.0f} MB unpacked")
    if not text.strip():
        raise ValueError(f"its {display_text(main.filename)} is empty")
    found = _read_xml(text)
    if len(inner) > 1:
        found.unread["other .kml in the archive"] += len(inner) - 1
        found.other = display_counts(found.unread)
    return found


def _read_geojson(data: bytes) -> TrackFile:
    try:
        # floats throughout: an integer of 400 digits would take quadratic time
        content = json.loads(data.decode("utf-8-sig"), parse_int=float)
    except UnicodeDecodeError as error:
        raise ValueError(f"it is not UTF-8 (byte {error.start}), as GeoJSON has to be") from None
    except json.JSONDecodeError as error:
        raise ValueError(f"line {error.lineno}, column {error.colno}: broken JSON ({error.msg})") from None
    except RecursionError:
        raise ValueError("its JSON is nested too deeply") from None
    if not isinstance(content, dict) or "type" not in content:
        raise ValueError("it is JSON, but no GeoJSON: it has no 'type'")
    crs = _geojson_crs(content)
    found = TrackFile()
    marks: list[Place] = []
    for number, feature in _features(content):
        name = _feature_name(feature)
        where = f"feature {number}"
        lines: dict[str, list[list[Place]]] = {}
        for geometry in _geometries(feature.get("geometry"), where):
            kind, inner = geometry.get("type"), geometry.get("coordinates")
            if kind == "LineString":
                lines.setdefault(kind, []).append(_positions(inner, where))
            elif kind == "MultiLineString":
                lines.setdefault(kind, []).extend(_positions(part, where) for part in _list(inner, where))
            elif kind in ("Point", "MultiPoint"):
                marks += _positions([inner] if kind == "Point" else inner, where)
            elif kind in ("Polygon", "MultiPolygon"):
                found.unread[kind.lower()] += 1
            else:
                raise ValueError(
                    f"{where}: its geometry is of the type {display_text(kind)}, which is none of GeoJSON's"
                )
        for kind, segments in lines.items():
            _add(found, f"GeoJSON {kind}", name, segments, crs)
    _add_marks(found, "GeoJSON points", marks, crs)
    return _known(found, "LineString, MultiLineString or points")


def _geojson_crs(content: dict[str, Any]) -> str | None:
    """The system that a ``crs`` member names, as older GeoJSON has it; None for longitude and latitude."""
    member = content.get("crs")
    if member is None:
        return None
    properties = member.get("properties") if isinstance(member, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if not isinstance(name, str) or not name:
        raise ValueError("its crs member names no coordinate reference system; take it out, or name one")
    short = re.fullmatch(r"urn:ogc:def:crs:(EPSG|OGC):[^:]*:(\w+)", name.strip(), re.IGNORECASE)
    code = ":".join(short.groups()).upper() if short else name.strip()
    return None if code in ("OGC:CRS84", "EPSG:4326", "CRS84") else code


def _features(content: dict[str, Any]) -> Iterator[tuple[int, dict[str, Any]]]:
    kind = content.get("type")
    if kind == "FeatureCollection":
        features = _list(content.get("features"), "its FeatureCollection")
    else:
        features = [content if kind == "Feature" else {"geometry": content, "properties": None}]
    for number, feature in enumerate(features, 1):
        if not isinstance(feature, dict):
            raise ValueError(f"feature {number} is {display_text(feature)}, but must be an object")
        yield number, feature


def _feature_name(feature: dict[str, Any]) -> str:
    properties = feature.get("properties")
    named = properties if isinstance(properties, dict) else {}
    by_key = {str(key).lower(): value for key, value in named.items()}
    for value in (by_key.get("name"), by_key.get("title"), by_key.get("id"), feature.get("id")):
        if isinstance(value, float):
            return f"{value:.15g}"
        if isinstance(value, str) and value.strip():
            return value.strip()
    return ""


def _geometries(geometry: Any, where: str, depth: int = 0) -> Iterator[dict[str, Any]]:
    """The simple geometries in one; none for null."""
    if geometry is None:
        return
    if not isinstance(geometry, dict):
        raise ValueError(f"{where}: its geometry is {display_text(geometry)}, but must be an object")
    if geometry.get("type") != "GeometryCollection":
        yield geometry
        return
    if depth == DEEPEST_COLLECTION:
        raise ValueError(f"{where}: more than {DEEPEST_COLLECTION} collections within one another are not read")
    for part in _list(geometry.get("geometries"), where):
        yield from _geometries(part, where, depth + 1)


def _positions(coordinates: Any, where: str) -> list[Place]:
    places: list[Place] = []
    for number, position in enumerate(_list(coordinates, where), 1):
        plain = isinstance(position, list) and len(position) >= 2 and all(type(v) is float for v in position[:2])
        if not plain:
            raise ValueError(
                f"{where}, position {number} is {display_text(position)}, but must be [longitude, latitude, ...]"
            )
        places.append((position[1], position[0], None, None))
    return places


def _list(value: Any, where: str) -> list[Any]:
    if not isinstance(value, list):
        raise ValueError(f"{where} holds {display_text(value)} where a list must be")
    return value


def _number(text: str, name: str, line: int) -> float:
    """The number of an attribute or element; NaN where it is empty."""
    word = text.strip()
    if not word:
        return float("nan")
    try:
        if "_" in word:
            raise ValueError
        return float(word)
    except ValueError:
        raise ValueError(f"line {line}: {name} is {display_text(text)}, but must be a number") from None


def _add(found: TrackFile, kind: str, name: str, segments: Sequence[Sequence[Place]], crs: str | None = None) -> None:
    """One more track, if its segments have at least two points in all."""
    segments = [segment for segment in segments if segment]
    places = [place for segment in segments for place in segment]
    if len(places) < 2:
        found.unread[f"{kind} of less than two points"] += bool(segments)
        return
    starts = np.cumsum([0, *(len(segment) for segment in segments[:-1])])
    found.append(_track(kind, name, places, tuple(int(start) for start in starts), crs))


def _add_marks(found: TrackFile, kind: str, places: Sequence[Place], crs: str | None = None) -> None:
    """Single places: a line through them only where the file has no other."""
    if len(places) >= 2 and not found:
        found.append(_track(kind, "", places, (0,), crs))
    elif places:
        found.unread[kind.removesuffix("s")] += len(places)


def _track(kind: str, name: str, places: Sequence[Place], starts: tuple[int, ...], crs: str | None) -> Track:
    y, x, speed, lines = zip(*places, strict=True)
    keys = ("latitude", "longitude") if crs is None else ("y", "x")
    columns = {key: np.array(values, dtype=np.float64) for key, values in zip(keys, (y, x), strict=True)}
    if any(value is not None for value in speed):
        columns["speed"] = np.array(speed, dtype=np.float64)
    numbered = None if len(set(lines)) == 1 else np.array(lines, dtype=np.intp)
    return Track(kind, name, columns, starts, numbered, crs=crs, is_surely_degrees=not kind.startswith("GeoJSON"))


def _known(found: TrackFile, wanted: str) -> TrackFile:
    if not found:
        held = f"; what it holds is not read: {display_counts(found.unread)}" if found.unread else ""
        raise ValueError(f"it has no {wanted} of at least two points{held}")
    found.other = display_counts(found.unread)
    return found
