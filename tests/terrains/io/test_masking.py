"""What means "unknown" is left out, declared or not, and counted; lakes, the sea and ledges stay."""

import numpy as np
import pytest
import rasterio

from aoro_gym.terrains import TerrainError, load
from aoro_gym.terrains.io.masking import find_nodata

N = 60
LAKE = (slice(20, 32), slice(25, 37))


def ground(base=150.0):
    i, j = np.mgrid[0:N, 0:N]
    return base + 1.5 * np.sin(j / 5.0) + 1.0 * np.cos(i / 6.0)


def with_lake(value, base=150.0):
    z = ground(base)
    z[LAKE] = value
    return z


def write(path, z, dtype="float32", nodata=None, pixel=1.0):
    with (
        rasterio.open(
            path,
            "w",
            driver="GTiff",
            height=z.shape[0],
            width=z.shape[1],
            count=1,
            dtype=dtype,
            crs="EPSG:32635",
            transform=rasterio.Affine(pixel, 0.0, 5e5, 0.0, -pixel, 6.65e6),
            nodata=nodata,
        ) as data,
        np.errstate(invalid="ignore"),
    ):
        data.write(z.astype(dtype), 1)
    return path


def changes(report):
    return {change.what: change.count for change in report.changes}


MARKS = [
    (-9999.0, "float32"),
    (-32768.0, "float32"),
    (-32768.0, "int16"),
    (-32767.0, "int16"),
    (-99999.0, "int32"),
    (65535.0, "uint16"),
    (32767.0, "int16"),
    (-999.0, "float32"),
    (9999.0, "float32"),
    (0.0, "float32"),
    (0.0, "uint16"),
    (-3.4028234663852886e38, "float32"),
    (3.4028234663852886e38, "float32"),
    (-1.7e308, "float64"),
    (1e20, "float32"),
    (9.969209968386869e36, "float32"),
    (float("nan"), "float32"),
    (float("-inf"), "float32"),
    (-2147483648.0, "int32"),
    (-1234.5, "float32"),
]


@pytest.mark.parametrize(("value", "dtype"), MARKS)
@pytest.mark.parametrize("declared", [False, True])
def test_a_lake_without_heights(tmp_path, value, dtype, declared):
    z = np.rint(with_lake(value)) if dtype[0] in "iu" else with_lake(value)
    path = write(tmp_path / "g.tif", z, dtype, nodata=value if declared else None)
    terrain, report = load(path, hole_limit=0.0)
    found = changes(report)
    assert sum(found.get(key, 0) for key in ("unknown", "undeclared_nodata", "wild_heights")) == 144
    assert len(terrain.vertices) == N * N - 144
    assert report.extent_m[2] < 6.0
    if not declared and value in (0.0, -999.0, 9999.0, -1234.5):
        text = next(text for text in report.warnings if "--nodata" in text)
        assert "144 pixels" in text
        assert f"{value:.10g}" in text
    else:
        assert not any("--nodata" in text for text in report.warnings if value not in (65535.0, 32767.0))


def test_the_callers_word_on_nodata(tmp_path):
    path = write(tmp_path / "g.tif", with_lake(0.0))
    terrain, report = load(path, nodata=(), spike_limit=1000.0)
    assert report.extent_m[2] > 150.0
    assert len(terrain.vertices) == N * N
    for given in (0.0, (0.0,), [-5.0, 0.0]):
        _, report = load(path, nodata=given, hole_limit=0.0)
        assert changes(report)["unknown"] == 144
        assert not report.warnings
    value = float(ground()[5, 5].astype(np.float32))
    _, report = load(write(tmp_path / "h.tif", ground()), nodata=value, hole_limit=0.0)
    assert changes(report)["unknown"] >= 1
    with pytest.raises(TerrainError, match="none of its 3,600 heights is known"):
        load(write(tmp_path / "i.tif", np.full((N, N), 7.0)), nodata=7.0)


def shore(seed=1):
    """Flat water at exactly 0 m, and ground that rises from it."""
    z = ground(0.5) + 0.05 * np.arange(N)[None, :]
    return np.maximum(z - 1.0, 0.0)


KEPT = {
    "sea at 0 m": shore(),
    "sea at 0 m in whole metres": np.rint(2.0 * shore()),
    "lake at 148 m": np.maximum(ground(), 148.0),
    "ledge of 3 m": np.where(np.arange(N) > 30, 3.0, 0.0) * np.ones((N, 1)),
    "platform of 20 m": np.where(np.arange(N) > 30, 20.0, 0.0) * np.ones((N, 1)),
    "below the sea": ground(-300.0),
    "about 9999 mm": 9999.0 + np.rint(1000.0 * (ground() - 150.0)),
    "about -999": ground(-999.0),
    "mountain": 1000.0 + 40.0 * (ground() - 150.0) + 10.0 * np.arange(N)[:, None],
    "plain": np.full((N, N), 100.0),
    "through 0": np.rint(3.0 * ground(0.0)),
}


@pytest.mark.parametrize("name", KEPT)
def test_heights_stay(name):
    z = KEPT[name]
    marks = find_nodata(z)
    assert not marks.unknown(z).any()
    assert marks.suspects == []


def test_level_ground_and_values_of_a_picture():
    z = np.full((N, N), 150.0)
    z[:9, :9] = 0.0
    assert find_nodata(z).values == [0.0]
    checkered = 255.0 * (np.indices((N, N)).sum(axis=0) % 2)
    assert find_nodata(checkered).values == []


def test_more_than_one_mark_and_blends_between_mark_and_ground(tmp_path):
    z = with_lake(-9999.0)
    z[:8, :10] = 0.0
    z[19, 25:37] = np.linspace(-8000.0, -310.0, 12)  # interpolated over the edge by some other program
    terrain, report = load(write(tmp_path / "g.tif", z), hole_limit=0.0)
    found = [change.count for change in report.changes if change.what == "undeclared_nodata"]
    assert sorted(found) == [80, 144]
    assert changes(report)["wild_heights"] == 12
    assert report.extent_m[2] < 6.0
    assert len(terrain.vertices) == N * N - 236


def test_marks_are_left_out_before_pixels_are_averaged(tmp_path):
    i, j = np.mgrid[0:180, 0:180]
    z = 150.0 + 0.05 * i + 0.02 * j
    whole, _ = load(write(tmp_path / "whole.tif", z), cell=3.0)
    z[61:91, 31:60] = -9999.0
    terrain, report = load(write(tmp_path / "g.tif", z), cell=3.0, hole_limit=0.0)
    assert changes(report)["undeclared_nodata"] == 30 * 29
    assert report.extent_m[2] == pytest.approx(whole.extent[1][2] - whole.extent[0][2])
    x, y, height = (terrain.vertices + np.asarray(terrain.origin) - [5e5, 6.65e6, 0.0]).T
    # blocks half of whose pixels are known hold their mean: up to a cell off its middle
    assert np.abs(height - (150.0 + 0.05 * (-y - 0.5) + 0.02 * (x - 0.5))).max() < 1.5 * (0.05 + 0.02)


def test_marks_are_left_out_before_pixels_are_projected(tmp_path):
    z = with_lake(-9999.0)
    path = tmp_path / "g.tif"
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        height=N,
        width=N,
        count=1,
        dtype="float32",
        crs="EPSG:3857",
        transform=rasterio.Affine(2.0, 0.0, 2_671_667.0, 0.0, -2.0, 8_399_737.0),
    ) as data:
        data.write(z.astype("float32"), 1)
    _, report = load(path, hole_limit=0.0)
    assert changes(report)["undeclared_nodata"] == 144
    assert report.extent_m[2] < 5.1
    hole = next(hole for hole in report.holes if not hole.at_edge)
    assert hole.area_m2 == pytest.approx(13.0**2, rel=0.2)


def test_arrays(tmp_path):
    z = with_lake(-9999.0)
    for source in (z, z.tolist()):
        _, report = load(source, cell=1.0, hole_limit=0.0)
        assert changes(report)["undeclared_nodata"] == 144
    np.save(tmp_path / "g.npy", np.where(z == -9999.0, np.float32(1e20), z).astype(np.float32))
    _, report = load(tmp_path / "g.npy", cell=1.0, hole_limit=0.0)
    assert changes(report)["wild_heights"] == 144
    _, report = load(with_lake(150.25), cell=1.0, hole_limit=0.0, nodata=150.25)
    assert changes(report)["unknown"] == 144


def test_the_sea_below_a_cliff_stays_and_is_named(tmp_path):
    z = np.where(np.arange(N) < 30, 0.0, ground(20.0))
    terrain, report = load(write(tmp_path / "g.tif", z))
    assert len(terrain.vertices) == N * N
    text = next(text for text in report.warnings if "--nodata 0" in text)
    assert "1,800 pixels are exactly 0" in text


def test_a_doubtful_value_that_is_kept_is_named():
    """Nearer to the ground than voids are, farther than shores."""
    marks = find_nodata(with_lake(0.0, base=9.0))
    assert marks.values == []
    ((value, step),) = set(marks.suspects)
    assert value == 0.0
    assert 5.0 < step < 10.0


def test_blends_are_told_in_any_unit():
    z = with_lake(-9999.0)
    z[19, 25:37] = np.linspace(-8000.0, -310.0, 12)
    metres = find_nodata(z)
    assert np.isfinite(metres.low)
    for metre in (0.3048, 0.01):
        # the quotient, two percentiles and their difference are each rounded once
        assert find_nodata(np.where(z == -9999.0, z, z / metre), metre).low * metre == pytest.approx(
            metres.low, rel=1e-12
        )
