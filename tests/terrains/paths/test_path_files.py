"""Paths from files: coordinates against pyproj, noise and standstill against the line that was driven."""

import numpy as np
import pyproj
import pytest

from aoro_gym.terrains import Path, Terrain, load_path, save_path

CRS, ORIGIN = "EPSG:32634", (460_000.0, 7_278_000.0, 30.0)  # northern Sweden
RADIUS = 10.0


@pytest.fixture
def terrain() -> Terrain:
    return Terrain.from_heights(np.zeros((61, 61)), cell=1.0, corner=(-30.0, -30.0), crs=CRS, origin=ORIGIN)


@pytest.fixture
def nowhere() -> Terrain:
    return Terrain.from_heights(np.zeros((61, 61)), cell=1.0, name="nowhere")


def degrees(points: np.ndarray) -> np.ndarray:
    """(P, 2) latitude, longitude of local points."""
    back = pyproj.Transformer.from_crs(CRS, "EPSG:4326", always_xy=True)
    longitude, latitude = back.transform(points[:, 0] + ORIGIN[0], points[:, 1] + ORIGIN[1])
    return np.stack([latitude, longitude], axis=1)


def arc(step: float = 0.3, turn: float = 4.0) -> np.ndarray:
    """(P, 2) along a circle around (0, 0)."""
    angle = np.arange(0.0, turn, step / RADIUS)
    return RADIUS * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def gpx_of(places: np.ndarray, kind: str = "trk") -> str:
    tags = {"trk": ("<trk><name>lap</name><trkseg>", "trkpt", "</trkseg></trk>"), "rte": ("<rte>", "rtept", "</rte>")}
    start, tag, end = tags.get(kind, ("", "wpt", ""))
    points = "".join(f'<{tag} lat="{a:.9f}" lon="{b:.9f}"/>' for a, b in places)
    return f'<gpx version="1.1" creator="t" xmlns="http://www.topografix.com/GPX/1/1">{start}{points}{end}</gpx>'


@pytest.mark.parametrize("kind", ["trk", "rte", "wpt"])
def test_gpx_meets_the_terrain(tmp_path, terrain, kind):
    (tmp_path / "lap.gpx").write_text(gpx_of(degrees(arc()), kind))
    path, report = load_path(tmp_path / "lap.gpx", terrain)
    radius = np.hypot(*path.points.T)
    # smoothing over 3 m shrinks the radius by its (3 / 2π R)⁴ and bends the ends, where it leaves no curvature
    np.testing.assert_allclose(radius[20:-20], RADIUS, atol=0.01)
    np.testing.assert_allclose(radius, RADIUS, atol=0.05)
    assert path.length == pytest.approx(RADIUS * 4.0, abs=0.5)
    assert path.name == "lap"
    assert report.points == len(arc())
    assert not report.warnings
    assert "EPSG:32634" in report.frame


def test_gpx_with_two_tracks_asks(tmp_path, terrain):
    short, long = gpx_of(degrees(arc(turn=0.5))), gpx_of(degrees(arc()))
    body = [text[text.index("<trk>") : text.index("</gpx>")] for text in (short, long)]
    (tmp_path / "two.gpx").write_text(long[: long.index("<trk>")] + "".join(body) + "</gpx>")
    with pytest.raises(ValueError, match="it holds 2 tracks: 1 GPX track 'lap'"):
        load_path(tmp_path / "two.gpx", terrain)
    assert load_path(tmp_path / "two.gpx", terrain, track=2).path.length > 30.0


def test_csv_of_degrees_is_the_same_path(tmp_path, terrain):
    places = degrees(arc())
    (tmp_path / "a.gpx").write_text(gpx_of(places))
    wanted = load_path(tmp_path / "a.gpx", terrain).path
    forms = {
        "comma": "time,Latitude,Longitude\n" + "".join(f"{i},{a:.9f},{b:.9f}\n" for i, (a, b) in enumerate(places)),
        "semicolon": "lon;lat\n" + "".join(f"{b:.9f};{a:.9f}\n".replace(".", ",") for a, b in places),
        "tab": "GPS_Lat [deg]\tGPS_Lon [deg]\n" + "".join(f"{a:.9f}\t{b:.9f}\n" for a, b in places),
        "blank": "# recorded\nlatitude longitude\n" + "".join(f"{a:.9f} {b:.9f}\n" for a, b in places),
        "marked": "\ufefflatitude,longitude\n" + "".join(f"{a:.9f},{b:.9f}\n" for a, b in places),
    }
    for name, text in forms.items():
        (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
        np.testing.assert_allclose(load_path(tmp_path / f"{name}.csv", terrain).path.points, wanted.points, atol=1e-9)


def test_without_a_crs_from_the_first_point(tmp_path, nowhere):
    places = degrees(arc())
    (tmp_path / "a.gpx").write_text(gpx_of(places))
    path, report = load_path(tmp_path / "a.gpx", nowhere, smoothing=0.0)
    assert report.tangent_point == pytest.approx(tuple(places[0]))
    np.testing.assert_allclose(path.points[0], 0.0, atol=1e-6)
    assert "terrain 'nowhere' has no coordinate reference system" in report.warnings[0]
    # UTM shrinks the ground by 0.04 % and turns it by the meridians' convergence
    assert path.length == pytest.approx(RADIUS * 4.0, abs=0.4)
    # 30 m further the plane still gives the distance on the ellipsoid
    geod = pyproj.Geod(ellps="WGS84")
    apart = geod.inv(*places[0][::-1], *places[-1][::-1])[2]
    assert np.hypot(*path.points[-1]) == pytest.approx(apart, abs=1e-3)
    alone, same = load_path(tmp_path / "a.gpx", smoothing=0.0)
    np.testing.assert_array_equal(alone.points, path.points)
    assert not same.warnings


def test_metres(tmp_path, terrain):
    (tmp_path / "local.csv").write_text("x_m,y_m\n" + "".join(f"{x},{y}\n" for x, y in arc()))
    local = load_path(tmp_path / "local.csv", terrain).path
    np.testing.assert_allclose(np.hypot(*local.points.T), RADIUS, atol=0.05)
    world = arc() + ORIGIN[:2]
    (tmp_path / "world.csv").write_text("easting;northing\n" + "".join(f"{x};{y}\n" for x, y in world))
    shifted, report = load_path(tmp_path / "world.csv", terrain)
    np.testing.assert_allclose(shifted.points, local.points, atol=1e-6)
    assert "world coordinates" in str(report)
    other = pyproj.Transformer.from_crs(CRS, "EPSG:3006", always_xy=True)
    x, y = other.transform(*world.T)
    (tmp_path / "other.csv").write_text("E,N\n" + "".join(f"{a},{b}\n" for a, b in zip(x, y, strict=True)))
    np.testing.assert_allclose(
        load_path(tmp_path / "other.csv", terrain, crs="EPSG:3006").path.points, local.points, atol=1e-3
    )
    (tmp_path / "bare.csv").write_text("".join(f"{x},{y}\n" for x, y in arc()))
    # without a terrain, on the ellipsoid around the first point: UTM's grid is turned against it, and 0.04 % shorter
    alone, report = load_path(tmp_path / "world.csv", crs=CRS)
    assert report.tangent_point == pytest.approx(tuple(degrees(arc())[0]))
    assert alone.length == pytest.approx(local.length, rel=5e-4)
    np.testing.assert_allclose(np.hypot(*alone.points[-1]), np.hypot(*(local.points[-1] - local.points[0])), rtol=2e-3)
    bare, report = load_path(tmp_path / "bare.csv")
    np.testing.assert_allclose(bare.points, local.points, atol=1e-9)
    assert "without a header" in report.kind


def test_standstill_noise_and_jumps_are_taken_out(tmp_path):
    rng = np.random.default_rng(2)
    driven = arc(step=0.2)
    noise = 0.02
    waits = np.repeat(driven[[40, 120]], 200, axis=0)
    log = np.concatenate([driven[:40], waits[:200], driven[40:120], waits[200:], driven[120:]])
    log = log + rng.normal(0.0, noise, log.shape)
    log[450] += [9.0, -4.0]
    text = "x,y\n" + "".join(f"{x},{y}\n" for x, y in log) + "3.0,\n"
    (tmp_path / "log.csv").write_text(text)
    path, report = load_path(tmp_path / "log.csv")
    radius = np.hypot(*path.points.T)
    assert np.sqrt(np.mean((radius - RADIUS) ** 2)) < noise
    assert np.abs(path.curvatures - 1.0 / RADIUS).max() < 0.15
    assert path.length == pytest.approx(RADIUS * 4.0, rel=0.01)
    changes = {change.what: change.count for change in report.changes}
    assert changes["incomplete"] == 1
    assert changes["jumps"] == 1
    assert 380 <= changes["standstill"] <= 420
    assert "smoothed" in changes


def test_lap_is_recognised(tmp_path):
    # on past its start by 1 m
    lap = arc(step=0.3, turn=2.0 * np.pi + 0.1)
    (tmp_path / "lap.csv").write_text("x,y\n" + "".join(f"{x},{y}\n" for x, y in lap))
    path, report = load_path(tmp_path / "lap.csv")
    assert path.closed
    assert path.length == pytest.approx(2.0 * np.pi * RADIUS, rel=1e-3)
    np.testing.assert_allclose(path.curvatures, 1.0 / RADIUS, rtol=0.1)
    assert {"closed", "overlap", "smoothed"} <= {change.what for change in report.changes}
    assert not load_path(tmp_path / "lap.csv", closed=False).path.closed
    (tmp_path / "arc.csv").write_text("x,y\n" + "".join(f"{x},{y}\n" for x, y in arc()))
    assert not load_path(tmp_path / "arc.csv").path.closed


def test_there_and_back_is_no_lap(tmp_path):
    there = np.stack([np.arange(0.0, 20.0, 0.3), np.zeros(67)], axis=1)
    turn = np.array([[20.5, 0.5], [20.5, 1.0], [20.0, 1.4]])
    back = there[::-1] + np.array([0.0, 1.4])
    both = np.concatenate([there, turn, back])
    (tmp_path / "both.csv").write_text("x,y\n" + "".join(f"{x},{y}\n" for x, y in both))
    path, report = load_path(tmp_path / "both.csv")
    assert not path.closed
    assert any("the joint turns no tighter than 4.7 m" in warning for warning in report.warnings)


def test_waypoints_become_a_spline(tmp_path):
    waypoints = np.array([[0.0, 0.0], [15.0, 0.0], [25.0, 10.0], [25.0, 25.0]])
    (tmp_path / "few.csv").write_text("x,y,speed\n" + "".join(f"{x},{y},1.5\n" for x, y in waypoints))
    path, report = load_path(tmp_path / "few.csv")
    assert np.abs(path.project(waypoints)[1]).max() < 0.01
    assert "4 waypoints" in str(report)
    np.testing.assert_allclose(path.speed_at([0.0, 10.0]), 1.5)


@pytest.mark.parametrize("suffix", [".csv", ".gpx"])
@pytest.mark.parametrize("closed", [False, True])
def test_saved_and_loaded(tmp_path, terrain, suffix, closed):
    angle = np.linspace(0.0, 2.0 * np.pi if closed else 4.0, 160, endpoint=False)
    path = Path(RADIUS * np.stack([np.cos(angle), np.sin(angle)], axis=1), closed, speed=np.linspace(1.0, 2.0, 160))
    save_path(path, tmp_path / f"p{suffix}", terrain)
    again, report = load_path(tmp_path / f"p{suffix}", terrain, spacing=None)
    assert again.closed == closed
    np.testing.assert_allclose(again.points, path.points, atol=2e-4)  # 1e-9 deg is 0.1 mm
    assert again.speed is not None and path.speed is not None
    np.testing.assert_allclose(again.speed, path.speed, rtol=1e-5)
    assert report.points == 160 + (closed and suffix == ".gpx")


def test_warns_of_a_path_beyond_the_terrain(tmp_path, nowhere):
    (tmp_path / "far.csv").write_text("x,y\n" + "".join(f"{x},10\n" for x in range(30, 91)))
    report = load_path(tmp_path / "far.csv", nowhere).report
    assert "50% of it lies outside of terrain 'nowhere'" in report.warnings[0]


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.csv", "", "a.csv: it has no lines"),
        ("a.csv", "time,speed\n1,2\n", "its header is time, speed, but must name latitude and longitude"),
        ("a.csv", "latitude,longitude\n65.1,20.1\n,\n", "it has 1 points with coordinates; a path needs at least 2"),
        (
            "a.csv",
            "lat,lon\n95,20\n96,20\n",
            r"latitude at point 2 \(line 3\) is 96 deg, but must be in \[-90, 90\] deg",
        ),
        ("a.csv", "65.60001,22.1\n65.60002,22.1\n65.6,22.1\n", "no header and look like degrees"),
        ("a.csv", "x,y\n1,1\n1,1.01\n1.01,1\n", "a.csv: its points all lie within 0.15 m"),
        ("a.csv", "x,y\n460000,7278000\n460010,7278000\n", "which are no local ones; give the terrain"),
        ("a.gpx", "<gpx", "a.gpx: line 1, column 1: broken XML"),
        ("a.gpx", gpx_of(np.empty((0, 2))), "it has no track, route or waypoints"),
    ],
)
def test_refuses(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=message):
        load_path(tmp_path / name)


def test_refuses_what_it_cannot_do(tmp_path, terrain):
    (tmp_path / "a.csv").write_text("x,y\n0,0\n1,0\n2,0\n")
    with pytest.raises(ValueError, match=r"a\.csv: crs is 'EPSG:no', which is unknown; give a code such as"):
        load_path(tmp_path / "a.csv", crs="EPSG:no")
    with pytest.raises(ValueError, match="smoothing is -1 m"):
        load_path(tmp_path / "a.csv", smoothing=-1.0)
    with pytest.raises(OSError, match=r"missing.csv"):
        load_path(tmp_path / "missing.csv")
    path = Path(arc())
    with pytest.raises(ValueError, match="GPX needs latitude and longitude"):
        save_path(path, tmp_path / "a.gpx")
    with pytest.raises(ValueError, match=r"paths are written as .csv or .gpx"):
        save_path(path, tmp_path / "a.json", terrain)
