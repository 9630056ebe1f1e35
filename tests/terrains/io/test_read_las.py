"""LAS and LAZ: headers are held against the points, z is up, marks are obeyed, and a broken system is no obstacle."""

import struct
from pathlib import Path

import laspy
import numpy as np
import pyproj
import pytest
from laspy.vlrs.known import WktCoordinateSystemVlr

from aoro_gym.terrains import TerrainError, load

SHIFT = np.array([500_000.0, 6_650_000.0, 150.0])
CELL = 1.0


def height(x, y):
    return 0.1 * x - 0.05 * y


def points(width: float = 20.0, depth: float = 20.0, step: float = CELL) -> np.ndarray:
    """A plane, one point a cell, so that every height is known to the millimetre."""
    x, y = np.meshgrid(np.arange(0.0, width + 1e-9, step), np.arange(0.0, depth + 1e-9, step))
    return np.column_stack([x.ravel(), y.ravel(), height(x, y).ravel()])


def write(path: Path, xyz: np.ndarray, *, version="1.4", point_format=6, shift=SHIFT, records=(), **fields) -> Path:
    header = laspy.LasHeader(version=version, point_format=point_format)
    header.scales, header.offsets = np.full(3, 1e-3), np.asarray(shift)
    for record in records:
        header.vlrs.append(record)
    file = laspy.LasData(header)
    file.x, file.y, file.z = (xyz + shift).T
    for name, values in fields.items():
        setattr(file, name, values)
    file.write(str(path))
    return path


def patched(path: Path, at: int, layout: str, *values) -> Path:
    """The file with some of its header's fields overwritten."""
    content = bytearray(path.read_bytes())
    struct.pack_into(layout, content, at, *values)
    path.write_bytes(content)
    return path


def changes(report) -> dict[str, int]:
    return {change.what: change.count for change in report.changes}


def assert_plane(terrain, extent=(20.0, 20.0)) -> None:
    """Every height is that of the plane, and the ground is as wide as the points."""
    x, y, z = (terrain.vertices + np.asarray(terrain.origin) - SHIFT).T
    np.testing.assert_allclose(z, height(x, y), atol=2e-3)
    np.testing.assert_allclose(np.ptp([x, y], axis=1), extent, atol=1e-3)


# --- bounds and counts of the header ---

STALE = {
    "small": [(0.0, 5.0), (0.0, 5.0), (0.0, 1.0)],
    "elsewhere": [(-5e5, -5e5 + 20.0), (-6.65e6, -6.65e6 + 20.0), (0.0, 1.0)],
    "wide": [(-1e5, 1e5), (-1.5e5, 1.5e5), (0.0, 1.0)],
    "one axis": [(0.0, 20.0), (0.0, 20.0), (-500.0, 500.0)],
    "swapped": [(20.0, 0.0), (20.0, 0.0), (2.0, -1.0)],
    "not a number": [(np.nan, np.nan)] * 3,
}


@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize("bounds", STALE.values(), ids=STALE)
def test_bounds_are_those_of_the_points(tmp_path, suffix, bounds):
    path = write(tmp_path / f"cloud{suffix}", points())
    for axis, (low, high) in enumerate(bounds):
        patched(path, 179 + 16 * axis, "<dd", high + SHIFT[axis], low + SHIFT[axis])
    terrain, report = load(path, cell=CELL, ground="all")
    assert_plane(terrain)
    assert changes(report)["stale_bounds"] == 1
    assert "outside_points" not in changes(report)


@pytest.mark.parametrize(("version", "point_format"), [("1.2", 0), ("1.2", 3), ("1.4", 6)])
def test_true_bounds_are_no_change(tmp_path, version, point_format):
    path = write(tmp_path / "cloud.las", points(), version=version, point_format=point_format)
    terrain, report = load(path, cell=CELL, ground="all")
    assert_plane(terrain)
    assert set(changes(report)) == {"shifted"}
    assert report.warnings == []


def test_bounds_that_hold_left_out_points_are_no_change(tmp_path):
    xyz = np.concatenate([points(), [[5.0, 5.0, 900.0]]])
    path = write(tmp_path / "cloud.las", xyz, classification=np.where(xyz[:, 2] > 100.0, 18, 1).astype(np.uint8))
    terrain, report = load(path, cell=CELL, ground="all")
    assert_plane(terrain)
    assert changes(report) == {"noise_points": 1, "shifted": 1}


def test_more_points_than_the_header_declares_are_read(tmp_path):
    path = write(tmp_path / "cloud.las", points(), version="1.2", point_format=0)
    for declared in (0, 100):
        terrain, report = load(patched(path, 107, "<I", declared), cell=CELL, ground="all")
        assert_plane(terrain)
        assert changes(report)["point_count"] == len(points())


def test_fewer_points_than_the_header_declares_are_named(tmp_path):
    path = write(tmp_path / "cloud.las", points(), version="1.2", point_format=0)
    patched(path, 107, "<I", 5000)
    terrain, report = load(path, cell=CELL, ground="all")
    assert_plane(terrain)
    assert any("5,000" in text and "441" in text for text in report.warnings)
    path.write_bytes(path.read_bytes()[:-7])  # within a record: cut off
    with pytest.raises(TerrainError, match=r"cloud\.las: 440 of 5,000 points, so it is cut off"):
        load(path)


def test_what_follows_the_points_is_no_point(tmp_path):
    path = write(tmp_path / "cloud.las", points(), version="1.2", point_format=0)
    for tail in (b"\0" * 200, b"end"):
        path.write_bytes(write(path, points(), version="1.2", point_format=0).read_bytes() + tail)
        terrain, report = load(path, cell=CELL, ground="all")
        assert_plane(terrain)
        assert report.points_read == len(points())
        assert any(f"{len(tail)} bytes" in text for text in report.warnings)


def test_a_huge_count_reserves_no_memory(tmp_path):
    path = patched(write(tmp_path / "cloud.las", points()), 247, "<Q", 10**12)
    terrain, report = load(path, cell=CELL, ground="all")
    assert_plane(terrain)
    assert any("1,000,000,000,000" in text for text in report.warnings)
    path = patched(write(tmp_path / "cloud.laz", points()), 247, "<Q", 10**12)
    with pytest.raises(TerrainError, match="1,000,000,000,000"):
        load(path)


def test_chunks_that_the_header_does_not_count_are_named(tmp_path):
    many = np.tile(points(), (114, 1))  # more than the 50,000 points of one chunk
    path = patched(write(tmp_path / "cloud.laz", many), 247, "<Q", 50_000)
    assert any("is not read" in text for text in load(path, cell=CELL, ground="all").report.warnings)


@pytest.mark.parametrize("value", [0.0, -0.001, np.nan, np.inf])
def test_impossible_scales_are_refused(tmp_path, value):
    path = patched(write(tmp_path / "cloud.las", points()), 139, "<d", value)
    with pytest.raises(TerrainError, match=f"scales y by {value:g}"):
        load(path)


# --- the up axis ---


@pytest.mark.parametrize("size", [(60.0, 8.0), (8.0, 60.0), (20.0, 20.0)])
def test_z_is_up_whatever_the_shape(tmp_path, size):
    xyz = points(*size)
    xyz[:, 2] = 0.6 * (xyz[:, 0] + xyz[:, 1])  # a hill far higher than the cloud is wide
    terrain, report = load(write(tmp_path / "corridor.las", xyz), cell=CELL, ground="all")
    np.testing.assert_allclose(terrain.extent[1] - terrain.extent[0], [*size, 0.6 * sum(size)], atol=1e-3)
    assert report.up == "z"


def test_the_users_axis_wins(tmp_path):
    xyz = points()[:, [0, 2, 1]] * [1.0, 1.0, -1.0]
    terrain, report = load(write(tmp_path / "y.las", xyz, shift=np.zeros(3)), cell=CELL, ground="all", up="y")
    x, y, z = terrain.vertices.T
    np.testing.assert_allclose(z, height(x, y), atol=2e-3)
    assert report.up == "y (as asked)"


# --- marks ---


def test_noise_and_withheld_points_are_left_out_and_counted(tmp_path):
    xyz = np.concatenate([points(), points()[:30] - [0.0, 0.0, 40.0]])
    bad = np.arange(len(xyz)) >= len(xyz) - 30
    classes, withheld = np.ones(len(xyz), dtype=np.uint8), np.zeros(len(xyz), dtype=bool)
    classes[bad] = np.repeat([7, 18, 1], 10)
    withheld[np.flatnonzero(bad)[20:]] = True
    for suffix in (".las", ".laz"):
        path = write(tmp_path / f"marks{suffix}", xyz, classification=classes, withheld=withheld)
        terrain, report = load(path, cell=CELL, ground="all")
        assert_plane(terrain)
        assert changes(report) == {"noise_points": 20, "withheld_points": 10, "shifted": 1}


def test_flags_of_old_formats_are_obeyed(tmp_path):
    xyz = np.concatenate([points(), [[3.0, 3.0, -20.0]]])
    withheld = xyz[:, 2] < -10.0
    path = write(tmp_path / "old.las", xyz, version="1.2", point_format=1, withheld=withheld)
    terrain, report = load(path, cell=CELL, ground="all")
    assert_plane(terrain)
    assert changes(report)["withheld_points"] == 1


def test_synthetic_and_overlap_points_stay_and_are_named(tmp_path):
    half = np.arange(len(points())) % 2
    path = write(tmp_path / "swaths.las", points(), synthetic=half, overlap=1 - half)
    terrain, report = load(path, cell=CELL, ground="all")
    assert_plane(terrain)
    assert changes(report)["synthetic_points"] == half.sum()
    assert changes(report)["overlap_points"] == (1 - half).sum()


def test_ground_class_with_noise_is_read_value_for_value(tmp_path):
    xyz = np.concatenate([points(), points() + np.array([0.0, 0.0, 8.0])])
    classes = np.repeat([2, 5], len(points())).astype(np.uint8)
    terrain, report = load(write(tmp_path / "forest.las", xyz, classification=classes), cell=CELL)
    assert_plane(terrain)
    assert changes(report)["ground_by_class"] == len(points())


# --- the coordinate system ---

UTM = pyproj.CRS.from_epsg(32635)
BROKEN = {
    "cut off": UTM.to_wkt("WKT1_GDAL")[:150],
    "words": "unknown",
    "local": 'LOCAL_CS["site",UNIT["metre",1]]',
    "empty local": "LOCAL_CS[]",
    "nested": "PROJCS[" * 300,
    "vertical only": 'VERT_CS["h",VERT_DATUM["d",2005],UNIT["metre",1],AXIS["Up",UP]]',
}


@pytest.mark.parametrize("text", BROKEN.values(), ids=BROKEN)
def test_a_broken_system_is_a_warning_and_the_users_word_wins(tmp_path, text):
    path = write(tmp_path / "cloud.las", points(), records=[WktCoordinateSystemVlr(text)])
    terrain, report = load(path, cell=CELL, ground="all")
    assert_plane(terrain)
    assert terrain.crs is None
    (warning,) = report.warnings
    assert "--crs" in warning
    assert "\n" not in warning
    assert len(warning) < 300
    terrain, report = load(path, cell=CELL, ground="all", crs="EPSG:32635")
    assert_plane(terrain)
    assert (terrain.crs, report.warnings) == ("EPSG:32635", [])


def geo_keys(*keys: tuple[int, int]) -> laspy.VLR:
    """GeoTIFF keys whose values stand in the directory itself."""
    words = [1, 1, 0, len(keys)] + [word for key, value in keys for word in (key, 0, 1, value)]
    return laspy.VLR("LASF_Projection", 34735, "", struct.pack(f"<{len(words)}H", *words))


@pytest.mark.parametrize("code", [32767, 9999, 4])
def test_keys_without_a_known_code_are_a_warning(tmp_path, code):
    path = write(tmp_path / "cloud.las", points(), version="1.2", point_format=0, records=[geo_keys((3072, code))])
    terrain, report = load(path, cell=CELL, ground="all")
    assert_plane(terrain)
    assert terrain.crs is None
    assert any("--crs" in text for text in report.warnings)


def test_whole_systems_are_taken(tmp_path):
    for name, record in (
        ("wkt1", WktCoordinateSystemVlr(UTM.to_wkt("WKT1_GDAL"))),
        ("wkt2", WktCoordinateSystemVlr(UTM.to_wkt())),
        ("keys", geo_keys((1024, 1), (3072, 32635))),
    ):
        path = write(tmp_path / f"{name}.las", points(), version="1.2", point_format=0, records=[record])
        terrain, report = load(path, cell=CELL, ground="all")
        assert_plane(terrain)
        assert (terrain.crs, report.warnings) == ("EPSG:32635", [])


def test_whole_keys_stand_in_for_a_broken_wkt(tmp_path):
    records = [WktCoordinateSystemVlr(BROKEN["cut off"]), geo_keys((3072, 32635))]
    path = write(tmp_path / "both.las", points(), records=records)
    terrain, report = load(path, cell=CELL, ground="all")
    assert_plane(terrain)
    assert terrain.crs == "EPSG:32635"
    assert any("taken from the other record" in text for text in report.warnings)


def test_declared_units_of_heights_are_taken(tmp_path):
    xyz = points()
    xyz[:, 2] /= 0.3048
    keys = geo_keys((3072, 32635), (4099, 9002))
    path = write(
        tmp_path / "feet.las", xyz, version="1.2", point_format=0, shift=np.array([*SHIFT[:2], 0.0]), records=[keys]
    )
    terrain, report = load(path, cell=CELL, ground="all")
    assert_plane_above_zero(terrain)
    assert "ft" in report.units


def assert_plane_above_zero(terrain) -> None:
    x, y, z = (terrain.vertices + np.asarray(terrain.origin) - [*SHIFT[:2], 0.0]).T
    np.testing.assert_allclose(z, height(x, y), atol=2e-3)


def test_geocentric_coordinates_are_refused_in_one_line(tmp_path):
    record = WktCoordinateSystemVlr(pyproj.CRS.from_epsg(4978).to_wkt())
    with pytest.raises(TerrainError, match="geocentric") as caught:
        load(write(tmp_path / "earth.las", points(), records=[record]))
    assert "\n" not in str(caught.value)
