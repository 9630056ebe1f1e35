"""Where a track lies: interchanged coordinates, other units and systems, against a terrain and against what Earth allows."""

import json

import numpy as np
import pyproj
import pytest

from aoro_gym.terrains import Terrain, load_path
from tests.terrains.lines import (
    collection,
    degrees,
    feature,
    gpx,
    kml,
    line_string,
    moved,
    placemark,
    straight,
    table,
    trk,
)

CRS, ORIGIN = "EPSG:32635", (332_700.0, 6_655_200.0, 0.0)  # around 60° N, 24° E
LINE = straight(40.0, 0.5, start=(3.0, -20.0), heading_deg=80.0)


def ground(size: tuple[int, int] = (81, 81), crs: str | None = CRS, origin=ORIGIN, name: str = "ground") -> Terrain:
    """A level rectangle around its local origin, with nodes 1 m apart in x and y."""
    corner = (-0.5 * (size[0] - 1), -0.5 * (size[1] - 1))
    return Terrain.from_heights(np.zeros(size[::-1]), cell=1.0, corner=corner, crs=crs, origin=origin, name=name)


def local(places: np.ndarray) -> np.ndarray:
    """Latitude and longitude to the terrain's frame."""
    change = pyproj.Transformer.from_crs("EPSG:4326", CRS, always_xy=True)
    return np.stack(change.transform(*places.T[::-1]), axis=1) - ORIGIN[:2]


@pytest.fixture
def terrain() -> Terrain:
    return ground()


def loaded(tmp_path, text, terrain=None, name="a.csv", **options):
    (tmp_path / name).write_text(text)
    return load_path(tmp_path / name, terrain, **options)


def refusal(tmp_path, text, terrain=None, name="a.csv", **options) -> str:
    with pytest.raises(ValueError) as caught:
        loaded(tmp_path, text, terrain, name, **options)
    return str(caught.value).removeprefix(str(tmp_path))


def of_degrees(points: np.ndarray, header: str = "latitude,longitude") -> str:
    return header + "\n" + "".join(f"{a:.9f},{b:.9f}\n" for a, b in degrees(points))


PLACE = local(degrees(np.zeros((1, 2))))[0]


def test_the_ground_of_these_tests_lies_under_the_lines():
    assert np.abs(PLACE).max() < 30.0
    assert np.abs(local(degrees(LINE))).max() < 40.0


# -------------------------------------------------------------------------------------------- latitude and longitude


@pytest.mark.parametrize("kind", ["csv", "header", "gpx", "kml", "geojson"])
def test_latitude_and_longitude_interchanged(tmp_path, terrain, kind):
    swapped = degrees(LINE)[:, ::-1]
    right, wrong, name = of_degrees(LINE), of_degrees(LINE, "longitude,latitude"), "a.csv"
    if kind == "header":
        wrong = "Breite;lat;lon\n" + "".join(f"x;{a:.9f};{b:.9f}\n" for a, b in swapped)
    if kind == "gpx":
        right, name = gpx(trk(LINE)), "a.gpx"
        wrong = right.replace("lat=", "LON=").replace("lon=", "lat=").replace("LON=", "lon=")
    if kind == "kml":
        right, name = kml(placemark(line_string(LINE))), "a.kml"
        words = " ".join(f"{b:.9f},{a:.9f}" for a, b in swapped)
        wrong = kml(placemark(f"<LineString><coordinates>{words}</coordinates></LineString>"))
    if kind == "geojson":
        right, name = collection(feature("LineString", degrees(LINE)[:, ::-1].tolist())), "a.geojson"
        wrong = collection(feature("LineString", degrees(LINE).tolist()))
    path, report = loaded(tmp_path, right, terrain, name)
    np.testing.assert_allclose(path.points[[0, -1]], local(degrees(LINE[[0, -1]])), atol=1e-3)
    assert not report.warnings
    said = refusal(tmp_path, wrong, terrain, name)
    assert "latitude and longitude look interchanged" in said
    assert "100% of its points lie on the terrain" in said
    # without a terrain nobody can tell these from a place in Oman: nothing is claimed
    assert loaded(tmp_path, wrong, None, name).path.length == pytest.approx(40.0, rel=0.6)


def test_what_no_latitude_can_be(tmp_path):
    far_east = np.array([[65.0, 150.0 + 1e-5 * i] for i in range(20)])
    text = "lat,lon\n" + "".join(f"{b},{a}\n" for a, b in far_east)
    assert "must be in [-90, 90] deg: latitude and longitude look interchanged" in refusal(tmp_path, text)
    one = "lat,lon\n" + "".join(f"{a},{b}\n" for a, b in far_east) + "97,150\n"
    said = loaded(tmp_path, one).report.warnings
    assert "1 points whose coordinates are no place on Earth left out, such as point 21 (line 22): 97, 150" in said[0]
    some = "lat,lon\n" + "".join(f"{a + 25 + 1e-3 * i},150\n" for i, (a, _) in enumerate(far_east))
    said = refusal(tmp_path, some)
    assert "latitude at point 20 (line 21) is 90.019 deg, but must be in" in said
    assert "interchanged" not in said
    packed = "lat,lon\n" + "".join(f"{a * 1e7:.0f},{b * 1e7:.0f}\n" for a, b in far_east)
    assert "degrees times ten million?" in refusal(tmp_path, packed)


def test_across_the_date_line(tmp_path):
    text = "lat,lon\n" + "".join(f"65,{(179.9995 + 1e-5 * i + 180) % 360 - 180:.6f}\n" for i in range(101))
    path, report = loaded(tmp_path, text)
    geod = pyproj.Geod(ellps="WGS84")
    assert path.length == pytest.approx(geod.inv(179.9995, 65, -179.9995, 65)[2], rel=1e-4)
    assert not report.warnings


def test_another_place(tmp_path, terrain):
    assert "it lies 9" in refusal(tmp_path, of_degrees(moved(LINE, 0.0, 1000.0)), terrain)  # 1 km less half the ground
    said = refusal(tmp_path, of_degrees(moved(LINE, 0.0, 300_000.0)), terrain)
    assert "km from terrain 'ground'; is it another place" in said
    half = loaded(tmp_path, of_degrees(moved(LINE, 0.0, 45.0)), terrain).report
    assert "of it lies outside of terrain 'ground'" in half.warnings[0]
    assert "%" in half.warnings[0]


# --------------------------------------------------------------------------------------------------------------- metres


@pytest.mark.parametrize("crs", [CRS, "EPSG:3067", "EPSG:3857"])
def test_easting_and_northing_in_any_system(tmp_path, terrain, crs):
    change = pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    places = np.stack(change.transform(*degrees(LINE).T[::-1]), axis=1)
    path, _ = loaded(tmp_path, table(places, "easting,northing"), terrain, crs=crs)
    np.testing.assert_allclose(path.points[[0, -1]], local(degrees(LINE[[0, -1]])), atol=1e-3)
    swapped = table(places[:, ::-1], "easting,northing")
    assert "easting and northing look interchanged" in refusal(tmp_path, swapped, terrain, crs=crs)
    alone, report = loaded(tmp_path, table(places, "easting,northing"), crs=crs)
    assert alone.length == pytest.approx(40.0, rel=1e-3)  # on the ground, not in the projection
    assert report.tangent_point == pytest.approx(tuple(degrees(LINE)[0]), abs=1e-8)
    if crs != "EPSG:3857":  # which reaches around the Earth
        assert "easting and northing look interchanged" in refusal(tmp_path, swapped, crs=crs)


def test_world_metres_by_the_origin(tmp_path, terrain):
    world = local(degrees(LINE)) + ORIGIN[:2]
    path, report = loaded(tmp_path, table(world, "E,N"), terrain)
    np.testing.assert_allclose(path.points[0], world[0] - ORIGIN[:2], atol=1e-3)
    assert "world coordinates" in str(report)
    said = refusal(tmp_path, table(world[:, ::-1], "E,N"), terrain)
    assert "km from terrain 'ground': x and y look interchanged" in said
    in_km = "\n".join(f"{x / 1e3:.6f},{y / 1e3:.6f}" for x, y in world)
    assert "they look like km: name the columns x_km and y_km" in refusal(tmp_path, "E,N\n" + in_km, terrain)
    path, _ = loaded(tmp_path, "x_km,y_km\n" + in_km, terrain)
    np.testing.assert_allclose(path.points[0], world[0] - ORIGIN[:2], atol=1e-2)
    for crs in ("EPSG:32634", "EPSG:32636", "EPSG:3857", "EPSG:4326"):
        other = pyproj.Transformer.from_crs(CRS, crs, always_xy=True).transform(*world.T)
        text = "E,N\n" + "".join(f"{x:.9f},{y:.9f}\n" for x, y in zip(*other, strict=True))
        said = refusal(tmp_path, text, terrain)
        what = "longitude and latitude" if crs == "EPSG:4326" else crs
        assert f"they look like {what}: say crs='{crs}'" in said
        path, _ = loaded(tmp_path, text, terrain, crs=crs)
        np.testing.assert_allclose(path.points[0], world[0] - ORIGIN[:2], atol=1e-3)
    other = pyproj.Transformer.from_crs(CRS, "EPSG:25830", always_xy=True).transform(*world.T)
    said = refusal(tmp_path, table(np.stack(other, axis=1), "E,N"), terrain)
    assert "if its coordinates are in another system or unit, say crs='EPSG:...'" in said


@pytest.mark.parametrize(
    ("unit", "size"), [("cm", 0.01), ("mm", 0.001), ("ft", 0.3048), ("km", 1000.0), ("in", 0.0254)]
)
def test_local_coordinates_in_another_unit(tmp_path, unit, size):
    flat = ground(crs=None, origin=(0.0, 0.0, 0.0))
    line = straight(30.0, 0.5, start=(30.0, 5.0))
    right = f"x_{unit},y_{unit}\n" + "".join(f"{x / size:.9g},{y / size:.9g}\n" for x, y in line)
    path, _ = loaded(tmp_path, right, flat)
    np.testing.assert_allclose(path.points[[0, -1]], line[[0, -1]], atol=1e-3)
    wrong = right.replace(f"x_{unit},y_{unit}", "x,y")
    if unit == "km":
        assert "or they are in a larger unit than m" in refusal(tmp_path, wrong, flat)
        return
    said = refusal(tmp_path, wrong, flat)
    assert f"they look like {unit}: name the columns x_{unit} and y_{unit}" in said


def test_local_x_and_y_interchanged(tmp_path):
    strip = ground((21, 201), crs=None, origin=(0.0, 0.0, 0.0))
    line = straight(40.0, 0.5, start=(0.0, 20.0))
    assert loaded(tmp_path, table(line), strip).path.length == pytest.approx(40.0, rel=1e-3)
    assert "x and y look interchanged" in refusal(tmp_path, table(line[:, ::-1]), strip)


def test_lengths_of_a_stretched_system_are_named(tmp_path):
    change = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:3857", always_xy=True)
    x, y = change.transform(24.0, 60.0)
    stretched = ground((201, 201), "EPSG:3857", (float(x), float(y), 0.0), "web")
    path, report = loaded(tmp_path, gpx(trk(straight(20.0, 0.5))), stretched, "a.gpx")
    assert path.length == pytest.approx(40.0, rel=0.01)  # of its own metres
    assert "lengths in EPSG:3857 are 1.99 to 2.01 times" in report.warnings[0] or "2.00" in report.warnings[0]


def test_the_users_crs_and_degrees(tmp_path, terrain):
    assert loaded(tmp_path, of_degrees(LINE), terrain, crs="EPSG:4258").path.length == pytest.approx(40.0, rel=1e-3)
    said = refusal(tmp_path, of_degrees(LINE), terrain, crs="EPSG:3067")
    assert "crs = 'EPSG:3067' counts in metres, but the file is in degrees" in said
    bare = "".join(f"{b:.9f},{a:.9f}\n" for a, b in degrees(LINE))
    assert "look like degrees" in refusal(tmp_path, bare)
    as_said = loaded(tmp_path, "x,y\n" + bare, terrain, crs="EPSG:4326").path
    np.testing.assert_allclose(as_said.points[0], local(degrees(LINE[:1]))[0], atol=1e-3)
    geo = json.dumps({"type": "LineString", "coordinates": degrees(LINE)[:, ::-1].tolist()})
    assert loaded(tmp_path, geo, terrain, "a.geojson", crs="EPSG:4326").path.length == pytest.approx(40.0, rel=1e-3)


@pytest.mark.parametrize("zone", [33, 34, 36, 37])
def test_utm_of_two_zones_around_is_recognised(tmp_path, zone):
    middle = (500_000.0, 6_655_200.0, 0.0)  # of zone 35
    other = pyproj.Transformer.from_crs(CRS, f"EPSG:326{zone}", always_xy=True).transform(*(LINE + middle[:2]).T)
    said = refusal(tmp_path, table(np.stack(other, axis=1), "E,N"), ground(origin=middle))
    assert f"they look like EPSG:326{zone}: say crs='EPSG:326{zone}'" in said
