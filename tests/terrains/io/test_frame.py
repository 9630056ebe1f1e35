"""Meshes and clouds in a projection that is off the ground are brought to lengths on it, as rasters are."""

import numpy as np
import pyproj
import pytest
import trimesh

from aoro_gym.terrains import Terrain, TerrainError, load, to_geographic
from aoro_gym.terrains.io.check import Report
from aoro_gym.terrains.io.frame import LoadOptions, find_frame

N = 30
GEOD = pyproj.Geod(ellps="WGS84")


def mercator(longitude, latitude):
    """Web Mercator coordinates of (N, N) points a metre apart on the ground, and their heights [m]."""
    east, north = np.meshgrid(np.arange(N), np.arange(N))
    azimuth, distance = np.degrees(np.arctan2(east, north)), np.hypot(east, north)
    lon, lat, _ = GEOD.fwd(np.full(azimuth.shape, longitude), np.full(azimuth.shape, latitude), azimuth, distance)
    x, y = pyproj.Transformer.from_crs(4326, 3857, always_xy=True).transform(lon, lat)
    return x, y, 100.0 + 0.1 * east + 0.05 * north


def test_mesh(tmp_path):
    x, y, z = mercator(24.0, 60.0)
    local = Terrain.from_heights(z, cell=1.0)
    vertices = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    trimesh.Trimesh(vertices, local.faces.copy(), process=False).export(tmp_path / "g.obj", digits=12)
    terrain, report = load(tmp_path / "g.obj", crs="EPSG:3857")
    assert terrain.crs == "EPSG:32635"
    assert report.ground_m2 == pytest.approx((N - 1) ** 2, rel=0.1)
    assert report.slope_median_deg == pytest.approx(np.degrees(np.arctan(np.hypot(0.1, 0.05))), abs=0.05)
    low, high = np.argmin(terrain.vertices[:, 2]), np.argmax(terrain.vertices[:, 2])
    latitude, longitude = to_geographic(terrain, *terrain.vertices[[low, high], :2].T)
    true = GEOD.inv(longitude[0], latitude[0], longitude[1], latitude[1])[2]
    assert true == pytest.approx(np.hypot(N - 1, N - 1), abs=0.01)
    grid = np.linalg.norm(np.subtract(*terrain.vertices[[low, high], :2]))
    assert grid == pytest.approx(true, rel=1.1e-3)  # UTM's own scale


def test_cloud(tmp_path):
    x, y, z = mercator(24.0, 60.0)
    np.savetxt(tmp_path / "g.xyz", np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1), fmt="%.4f")
    terrain, report = load(tmp_path / "g.xyz", crs="EPSG:3857", ground="all")
    assert terrain.crs == "EPSG:32635"
    assert report.slope_median_deg == pytest.approx(np.degrees(np.arctan(np.hypot(0.1, 0.05))), abs=0.3)
    assert report.ground_m2 == pytest.approx((N - 1) ** 2, rel=0.15)


@pytest.mark.parametrize(
    ("options", "known", "metres"),
    [
        ({}, "assumed", 1.0),
        ({"crs": "EPSG:32635"}, "assumed", 1.0),
        ({"crs": "EPSG:32635+5773"}, "declared", 1.0),
        ({"crs": "EPSG:32635+6360"}, "declared", 1200.0 / 3937.0),
        ({"crs": "EPSG:2227"}, "assumed", 1200.0 / 3937.0),
        ({"units": "dm"}, "asked", 0.1),
        ({"z_units": "Decimetres"}, "asked", 0.1),
    ],
)
def test_how_the_unit_of_heights_is_known(options, known, metres):
    corner = (
        np.array([6_100_000.0, 2_000_000.0, 0.0]) if options.get("crs") == "EPSG:2227" else np.array([5e5, 6.6e6, 0.0])
    )
    report = Report("g", kind="points")
    frame = find_frame(LoadOptions(**options), report, corner, corner + 100.0, spacing=0.5)
    assert (frame.z_known, frame.z_scale) == (known, pytest.approx(metres))


def test_a_vertical_unit_of_the_file_holds_beside_the_callers_plan():
    corner = np.array([5e5, 6.6e6, 0.0])
    frame = find_frame(
        LoadOptions(crs="EPSG:32635"),
        Report("g", kind="points"),
        corner,
        corner + 100.0,
        spacing=0.5,
        crs="EPSG:32634+6360",
    )
    assert frame.z_scale == pytest.approx(1200.0 / 3937.0)
    assert frame.crs == "EPSG:32635"


def rolling():
    i, j = np.mgrid[0:60, 0:60]
    return j.ravel() + 5e5, i.ravel() + 6.65e6, (150.0 + 4.0 * np.sin(j / 5.0) + 3.0 * np.cos(i / 6.0)).ravel()


@pytest.mark.parametrize(("unit", "metres"), [("m", 1.0), ("dm", 0.1), ("cm", 0.01), ("mm", 0.001)])
def test_the_unit_of_a_clouds_heights_is_settled_before_its_ground_is_told(tmp_path, unit, metres):
    x, y, z = rolling()
    np.savetxt(tmp_path / "g.xyz", np.stack([x, y, z / metres], axis=1), fmt="%.2f")
    if unit in ("dm", "cm"):  # 33 degrees, or a tenth of it
        with pytest.raises(TerrainError, match=rf"unit of its heights.*{unit} \(.*--z-units"):
            load(tmp_path / "g.xyz")
        terrain, report = load(tmp_path / "g.xyz", z_units=unit)
    else:
        terrain, report = load(tmp_path / "g.xyz")
        assert ("z_units" in {change.what for change in report.changes}) == (unit == "mm")
    assert report.extent_m[2] == pytest.approx(np.ptp(z), rel=0.02)
    assert len(terrain.vertices) > 2000


@pytest.mark.parametrize("relief", [0.0, 0.5, 2.5, 40.0, 400.0])
def test_kilometres_are_recognised_unless_heights_tower_over_them(relief):
    """4 units wide: a steep flank in km may be as high as the tenfold, 400 m beside degrees may not."""
    high = np.array([4.0, 3.0, relief])
    request, report = LoadOptions(), Report("g", kind="points")
    if relief <= 10.0 * 4.0:
        assert find_frame(request, report, np.zeros(3), high, spacing=0.005).scale == 1000.0
    else:
        with pytest.raises(TerrainError, match="as if in degrees and metres"):
            find_frame(request, report, np.zeros(3), high, spacing=0.005)
