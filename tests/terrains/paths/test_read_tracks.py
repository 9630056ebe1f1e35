"""Lines of GPX, KML, KMZ and GeoJSON against the lines that were written, and the choice among several."""

import json

import numpy as np
import pyproj
import pytest

from aoro_gym.terrains import load_path
from aoro_gym.terrains.paths.read_tracks import LARGEST_FILE
from tests.terrains.lines import (
    collection,
    degrees,
    feature,
    gpx,
    gx_track,
    kml,
    kmz,
    line_string,
    placemark,
    positions,
    rte,
    straight,
    trk,
    wpt,
)

ROAD, YARD = straight(115.0, 5.0), straight(12.0, 0.2, start=(60.0, 100.0))


def loaded(tmp_path, name, content, **options):
    data = content.encode() if isinstance(content, str) else content
    (tmp_path / name).write_bytes(data)
    return load_path(tmp_path / name, **options)


def refusal(tmp_path, name, content, **options) -> str:
    """What is said of a file that is not read: one line, not too long."""
    with pytest.raises(ValueError) as caught:
        loaded(tmp_path, name, content, **options)
    message = str(caught.value).removeprefix(str(tmp_path))
    assert "\n" not in message
    assert len(message) < 700
    return message


def is_along(path, points: np.ndarray) -> None:
    """The path leads along a straight line, from its first point on, to the accuracy of `degrees`."""
    wanted = points - points[0]
    assert path.length == pytest.approx(np.hypot(*wanted[-1]), rel=5e-4)
    np.testing.assert_allclose(path.points[-1], wanted[-1], atol=5e-4 * np.hypot(*wanted[-1]))
    np.testing.assert_allclose(path.project(wanted)[1], 0.0, atol=0.05)


# ------------------------------------------------------------------------------------------------------------- reading


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.kml", kml(placemark(line_string(ROAD), "strip road"))),
        ("a.kml", kml(placemark(line_string(ROAD, altitude="")))),
        ("a.kml", kml(placemark(line_string(ROAD, comma=" , ")))),
        ("a.kml", kml(placemark(f"<MultiGeometry>{line_string(ROAD[:12])}{line_string(ROAD[11:])}</MultiGeometry>"))),
        ("a.kml", kml(f"<Folder><Folder>{placemark(gx_track(ROAD), 'drive')}</Folder></Folder>")),
        ("a.kml", kml(placemark(f"<gx:MultiTrack>{gx_track(ROAD[:9])}{gx_track(ROAD[9:])}</gx:MultiTrack>"))),
        ("a.kml", kml(placemark(line_string(ROAD))).replace(' xmlns:gx="http://www.google.com/kml/ext/2.2"', "")),
        ("a.kml", kml(placemark(line_string(ROAD), "Rückegasse")).replace("UTF-8", "ISO-8859-1").encode("latin-1")),
        ("a.kml", kml(placemark(line_string(ROAD))).replace("UTF-8", "UTF-16").encode("utf-16")),
        ("a.kmz", kmz(kml(placemark(line_string(ROAD))))),
        ("a.kmz", kmz(kml(placemark(line_string(ROAD))), **{"files/icon.png": "PNG", "models/x.kml": kml()})),
        ("a.kml", kmz(kml(placemark(line_string(ROAD))))),
        ("a.gpx", kml(placemark(line_string(ROAD)))),
        ("a.csv", gpx(trk(ROAD))),
        ("a.gpx", gpx(trk(ROAD, inside="<ele>3</ele><time>2025-05-01T10:00:00Z</time>"))),
        ("a.gpx", gpx(trk(ROAD[:10], ROAD[10:]))),
        ("a.gpx", gpx(rte(ROAD))),
        ("a.gpx", gpx(wpt(ROAD))),
        ("a.geojson", collection(feature("LineString", positions(ROAD), name="strip road"))),
        ("a.json", json.dumps(feature("LineString", [[*place, 150.0] for place in positions(ROAD)]))),
        ("a.geojson", json.dumps({"type": "LineString", "coordinates": positions(ROAD)})),
        ("a.geojson", collection(feature("MultiLineString", [positions(ROAD[:8]), positions(ROAD[8:])]))),
        ("a.geojson", collection(*(feature("Point", place) for place in positions(ROAD)))),
        ("a.geojson", collection(feature("LineString", positions(ROAD)), crs=None)),
        (
            "a.geojson",
            collection(
                feature("LineString", positions(ROAD)),
                crs={"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}},
            ),
        ),
        (
            "a.geojson",
            json.dumps(
                {"type": "GeometryCollection", "geometries": [{"type": "LineString", "coordinates": positions(ROAD)}]}
            ),
        ),
    ],
)
def test_the_line_is_read(tmp_path, name, content):
    path, report = loaded(tmp_path, name, content)
    is_along(path, ROAD)
    assert not report.warnings
    assert report.points in (len(ROAD), len(ROAD) + 1)  # of two lines that meet, both ends


def test_geojson_in_a_projected_system(tmp_path):
    change = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:3067", always_xy=True)
    east, north = change.transform(*degrees(ROAD).T[::-1])
    system = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::3067"}}
    line = feature("LineString", np.stack([east, north], axis=1).tolist())
    path, report = loaded(tmp_path, "a.geojson", collection(line, crs=system))
    is_along(path, ROAD)
    assert "EPSG:3067" in report.frame
    # the user's word wins over the file's, and is needed where it has none
    wrong = {"type": "name", "properties": {"name": "EPSG:3857"}}
    is_along(loaded(tmp_path, "a.geojson", collection(line, crs=wrong), crs="EPSG:3067").path, ROAD)
    is_along(loaded(tmp_path, "a.geojson", collection(line), crs="EPSG:3067").path, ROAD)
    assert "say crs='EPSG:...'" in refusal(tmp_path, "a.geojson", collection(line))
    unknown = {"type": "name", "properties": {"name": "[/EPSG:0]"}}
    assert "crs is '[/EPSG:0]', which is unknown" in refusal(tmp_path, "a.geojson", collection(line, crs=unknown))
    assert "its crs member names no" in refusal(tmp_path, "a.geojson", collection(line, crs={"type": "link"}))


def test_speed_of_a_gpx(tmp_path):
    inner = "<gpxtpx:TrackPointExtension><gpxtpx:speed>2.5</gpxtpx:speed></gpxtpx:TrackPointExtension>"
    garmin = f"<extensions>{inner}</extensions>"
    for inside in ("<speed>2.5</speed>", garmin):
        speed = loaded(tmp_path, "a.gpx", gpx(trk(ROAD, inside=inside))).path.speed
        assert speed is not None
        np.testing.assert_allclose(speed, 2.5)
    assert loaded(tmp_path, "a.gpx", gpx(trk(ROAD))).path.speed is None


# ------------------------------------------------------------------------------------------------- choice among several

TWO = {
    "two.gpx": gpx(trk(ROAD, name="harvester route"), trk(YARD, name="yard")),
    "mixed.gpx": gpx(rte(YARD, "yard"), trk(ROAD, name="harvester route")),
    "two.kml": kml(placemark(line_string(ROAD), "harvester route"), placemark(gx_track(YARD), "yard")),
    "two.kmz": kmz(kml(placemark(line_string(ROAD), "harvester route"), placemark(line_string(YARD), "yard"))),
    "two.geojson": collection(
        feature("LineString", positions(ROAD), name="harvester route"),
        feature("LineString", positions(YARD), NAME="yard"),
    ),
}


@pytest.mark.parametrize("name", TWO)
def test_several_lines_are_asked_for(tmp_path, name):
    said = refusal(tmp_path, name, TWO[name])
    assert "2 tracks: 1 " in said
    assert "'harvester route' (24 points, 115.0 m)" in said
    assert "'yard' (61 points, 12.0 m)" in said
    assert "--track" in said
    for wanted in ("harvester route", "1", 1):
        is_along(loaded(tmp_path, name, TWO[name], track=wanted).path, ROAD)
    for wanted in ("yard", "2", 2):
        is_along(loaded(tmp_path, name, TWO[name], track=wanted).path, YARD)
    for wanted in ("3", "Yard", 0, "", "9" * 400, "yard.9"):
        said = refusal(tmp_path, name, TWO[name], track=wanted)
        assert "it holds 2 tracks" in said or "part 9 is asked for" in said


def test_names_that_are_hard(tmp_path):
    named = gpx(
        trk(ROAD, name="2"),
        trk(YARD, name="[/x] $a$ <b>"),
        trk(ROAD[:10]),
        trk(YARD, name="day"),
        trk(ROAD, name="day"),
    )
    is_along(loaded(tmp_path, "a.gpx", named, track="2").path, ROAD)  # an exact name wins
    is_along(loaded(tmp_path, "a.gpx", named, track=2).path, YARD)
    is_along(loaded(tmp_path, "a.gpx", named, track="[/x] $a$ <b>").path, YARD)
    is_along(loaded(tmp_path, "a.gpx", named, track="3").path, ROAD[:10])
    assert "2 tracks are called 'day'; say which by its number" in refusal(tmp_path, "a.gpx", named, track="day")
    assert "'[/x] $a$ <b>'" in refusal(tmp_path, "a.gpx", named)
    many = gpx(*(trk(ROAD, name="n" * 5000) for _ in range(50)))
    assert "and 45 more" in refusal(tmp_path, "a.gpx", many).replace("\n", "")


@pytest.mark.parametrize("wrong", ["", "nan", "inf", "9" * 400, "1e300", "-1e9"])
def test_tracks_with_wrong_numbers_are_listed_and_read(tmp_path, wrong):
    broken = trk(ROAD, name="broken").replace('lat="60.0', f'lat="{wrong}" was="60.0', 3)
    listed = refusal(tmp_path, "a.gpx", gpx(broken, trk(ROAD, name="whole")))
    assert "'broken' (24 points" in listed
    assert "'whole' (24 points, 115.0 m)" in listed
    path, report = loaded(tmp_path, "a.gpx", gpx(broken, trk(ROAD)), track="broken")
    is_along(path, ROAD[3:])
    if wrong not in ("", "nan"):
        assert "3 points whose coordinates are no place on Earth left out, such as point 1" in report.warnings[0]
    else:
        assert "3 rows without coordinates left out" in str(report)


def test_what_is_not_read_is_named(tmp_path):
    assert "2 x GPX waypoint" in loaded(tmp_path, "a.gpx", gpx(wpt(YARD[:2]), trk(ROAD))).report.unread
    one = loaded(tmp_path, "a.gpx", gpx(trk(ROAD), trk(YARD[:1]))).report
    assert "1 x GPX track of less than two points" in one.unread
    area = placemark("<Polygon><outerBoundaryIs/></Polygon>")
    assert "1 x polygon" in loaded(tmp_path, "a.kml", kml(area, placemark(line_string(ROAD)))).report.unread
    other = loaded(tmp_path, "a.kmz", kmz(kml(placemark(line_string(ROAD))), **{"b/more.kml": kml()})).report
    assert "1 x other .kml" in str(other)
    assert "what it holds is not read: 1 x polygon" in refusal(tmp_path, "a.kml", kml(area))


# --------------------------------------------------------------------------------------------------------------- broken

POSITIONS = positions(ROAD)
BOMB = '<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]><gpx><trk><name>&b;</name></trk></gpx>'


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.shp", "x", "paths are read from .gpx .kml .kmz .geojson .json .csv .tsv .txt"),
        ("a", "x", "paths are read from"),
        ("a.gpx", " \n", "the file is empty"),
        ("a.gpx", "lat,lon\n60,24\n", "it is not XML, as its name says"),
        ("a.kmz", "lat,lon\n60,24\n", "it is not a zip archive"),
        ("a.kmz", b"PK\x03\x04" + bytes(50), "it cannot be unpacked"),
        ("a.kmz", kmz("x", "readme.txt"), "zip archive without a .kml"),
        ("a.kmz", kmz(" "), "its 'doc.kml' is empty"),
        ("a.kmz", kmz(" " * (LARGEST_FILE + 1)), "larger than 50 MB unpacked"),
        ("a.gpx", b" " * (LARGEST_FILE + 1), "it is larger than 50 MB"),
        ("a.gpx", "<gpx><trk>\n<trkseg></trk></gpx>", "line 2, column 11: broken XML (mismatched tag)"),
        ("a.gpx", BOMB, "line 1: it declares the entity 'a', which is not read"),
        ("a.gpx", "<gpx>" + "<a>" * 100_000, "more than 100 elements within one another"),
        ("a.gpx", "<TrainingCenterDatabase/>", "it is XML of 'trainingcenterdatabase', not GPX or KML"),
        (
            "a.gpx",
            gpx('<trk><trkseg>\n<trkpt lat="6x" lon="2"/></trkseg></trk>'),
            "line 4: lat is '6x', but must be a number",
        ),
        ("a.gpx", gpx('<trk><trkseg><trkpt lat="1_0" lon="2"/></trkseg></trk>'), "lat is '1_0'"),
        ("a.gpx", gpx(trk(ROAD).replace('lat="60.0', f'lat="{"6" * 400}')), "it has 0 points with coordinates"),
        ("a.gpx", gpx(trk(ROAD, inside="<speed>fast</speed>")), "speed is 'fast', but must be a number"),
        ("a.gpx", gpx(trk(ROAD, inside="<speed>-1</speed>")), "its speed at point 1 (line 3) is -1 m/s"),
        ("a.gpx", gpx(), "it has no track, route or waypoints"),
        (
            "a.kml",
            kml(placemark("<LineString><coordinates>1,2,3,4</coordinates></LineString>")),
            "'1,2,3,4' are not long",
        ),
        ("a.kml", kml(placemark("<LineString><coordinates>7 8</coordinates></LineString>")), "coordinates '7' are not"),
        ("a.geojson", "{", "line 1, column 2: broken JSON"),
        ("a.geojson", "[" * 100_000, "nested too deeply"),
        ("a.geojson", "[1]", "no GeoJSON: it has no 'type'"),
        ("a.geojson", b'{"type": "\xff"}', "it is not UTF-8"),
        (
            "a.geojson",
            '{"type": "FeatureCollection", "features": 3}',
            "its FeatureCollection holds 3.0 where a list must be",
        ),
        (
            "a.geojson",
            collection(feature("LineString", [[24.0, "60"], [24.0, 60.1]])),
            "feature 1, position 1 is [24.0, '60']",
        ),
        ("a.geojson", collection(feature("LineString", [[True, 60.0]])), "position 1 is [True, 60.0]"),
        ("a.geojson", collection(feature("LineString", [POSITIONS])), "must be [longitude, latitude, ...]"),
        ("a.geojson", collection(feature("Curve", POSITIONS)), "of the type 'Curve'"),
        ("a.geojson", collection({"type": "Feature", "geometry": [1]}), "its geometry is [1.0]"),
        ("a.geojson", collection({"type": "Feature", "geometry": None}), "it has no LineString"),
        ("a.geojson", f'{{"type": "LineString", "coordinates": [[{"9" * 400}, 1], [1, 1]]}}', "it has 1 points with"),
    ],
)
def test_broken_files_are_refused_in_a_line(tmp_path, name, content, message):
    assert message in refusal(tmp_path, name, content)
