"""Recordings to test readers with: lines in metres, in degrees, and as GPX, KML, GeoJSON."""

import io
import json
import zipfile

import numpy as np

LATITUDE, LONGITUDE = 60.0, 24.0
NORTH = 1.0 / 111_412.0
"""Degrees of latitude in a metre there, within 0.01 %."""
EAST = 1.0 / 55_800.0
"""Degrees of longitude in a metre there."""


def degrees(points: np.ndarray) -> np.ndarray:
    """(P, 2) latitude, longitude of points east and north [m] of a place in Finland."""
    return np.stack([LATITUDE + points[:, 1] * NORTH, LONGITUDE + points[:, 0] * EAST], axis=1)


def straight(
    length: float, step: float, start: tuple[float, float] = (0.0, 0.0), heading_deg: float = 90.0
) -> np.ndarray:
    """(P, 2) points [m] on a line, northwards by default."""
    s = np.arange(0.0, length + 1e-9, step)
    heading = np.radians(heading_deg)
    return np.asarray(start) + s[:, None] * np.array([np.cos(heading), np.sin(heading)])


def moved(points: np.ndarray, east: float, north: float) -> np.ndarray:
    """The points shifted [m]."""
    return points + np.array([east, north])


def gpx(*bodies: str) -> str:
    start = '<?xml version="1.0"?>\n<gpx version="1.1" creator="t" xmlns="http://www.topografix.com/GPX/1/1">\n'
    return start + "\n".join(bodies) + "</gpx>"


def named(name: str | None) -> str:
    return "" if name is None else f"<name>{name.replace('&', '&amp;').replace('<', '&lt;')}</name>"


def trk(*segments: np.ndarray, name: str | None = None, inside: str = "") -> str:
    """A track of segments of points [m]."""
    parts = ""
    for segment in segments:
        points = "\n".join(f'<trkpt lat="{a:.9f}" lon="{b:.9f}">{inside}</trkpt>' for a, b in degrees(segment))
        parts += f"<trkseg>{points}</trkseg>"
    return f"<trk>{named(name)}{parts}</trk>"


def rte(points: np.ndarray, name: str | None = None) -> str:
    return (
        f"<rte>{named(name)}" + "".join(f'<rtept lat="{a:.9f}" lon="{b:.9f}"/>' for a, b in degrees(points)) + "</rte>"
    )


def wpt(points: np.ndarray) -> str:
    return "".join(f'<wpt lat="{a:.9f}" lon="{b:.9f}"/>' for a, b in degrees(points))


def kml(*placemarks: str) -> str:
    spaces = 'xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2"'
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<kml {spaces}><Document>{"".join(placemarks)}</Document></kml>'


def kmz(text: str, name: str = "doc.kml", **others: str) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for entry, content in {**others, name: text}.items():
            archive.writestr(entry, content)
    return packed.getvalue()


def placemark(geometry: str, name: str | None = None) -> str:
    return f"<Placemark>{named(name)}{geometry}</Placemark>"


def line_string(points: np.ndarray, comma: str = ",", altitude: str = ",150") -> str:
    words = " ".join(f"{b:.9f}{comma}{a:.9f}{altitude}" for a, b in degrees(points))
    return f"<LineString><coordinates>\n{words}\n</coordinates></LineString>"


def gx_track(points: np.ndarray) -> str:
    words = "".join(
        f"<when>2025-05-01T10:00:00Z</when><gx:coord>{b:.9f} {a:.9f} 0</gx:coord>" for a, b in degrees(points)
    )
    return f"<gx:Track>{words}</gx:Track>"


def positions(points: np.ndarray) -> list[list[float]]:
    return [[b, a] for a, b in degrees(points).tolist()]


def feature(kind: str, coordinates: object, **properties: object) -> dict[str, object]:
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}


def collection(*features: dict[str, object], **more: object) -> str:
    return json.dumps({"type": "FeatureCollection", "features": list(features), **more})


def table(points: np.ndarray, header: str = "x_m,y_m") -> str:
    return header + "\n" + "".join(f"{x:.6f},{y:.6f}\n" for x, y in points)
