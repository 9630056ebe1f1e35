"""Rasters: every orientation, projection, band, declared unit and mark of "unknown" gives the ground that was written."""

import math
import warnings

import numpy as np
import pyproj
import pytest
import rasterio
from rasterio import Affine
from rasterio.control import GroundControlPoint
from rasterio.crs import CRS
from rasterio.enums import ColorInterp
from rasterio.errors import NotGeoreferencedWarning

from aoro_gym.terrains import TerrainError, from_world, load, to_geographic

N = 40
CORNER = (500_000.0, 6_650_000.0)
"""North-western corner in EPSG:32635."""
WAVE = 2.0
"""Amplitude of ``height`` [m]."""


def height(x, y):
    """Ground [m] east and north of the north-western corner."""
    return 150.0 + WAVE * np.sin(np.asarray(x) / 7.0) + 1.5 * np.cos(np.asarray(y) / 9.0) + 0.02 * np.asarray(x)


CURVATURE = WAVE / 49.0 + 1.5 / 81.0


def write(path, bands, *, place, crs: str | None = "EPSG:32635", dtype="float32", nodata=None, change=None, **more):
    """A GeoTIFF of ``bands`` (rows, columns) each."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with rasterio.open(
            path,
            "w",
            driver="GTiff",
            height=bands[0].shape[0],
            width=bands[0].shape[1],
            count=len(bands),
            dtype=dtype,
            crs=crs,
            transform=place,
            nodata=nodata,
            **more,
        ) as data:
            for number, band in enumerate(bands, 1):
                data.write(np.asarray(band).astype(dtype), number)
            if change is not None:
                change(data)
    return path


def north_up(pixel=1.0):
    return Affine(pixel, 0.0, CORNER[0], 0.0, -pixel, CORNER[1])


def sampled(place, shape=(N, N)):
    """``height`` at the pixel centres of ``place``."""
    row, column = np.mgrid[0 : shape[0], 0 : shape[1]]
    x, y = place @ (column + 0.5, row + 0.5)
    return height(x - CORNER[0], y - CORNER[1])


def errors(terrain):
    """Heights of the vertices against the true ones at their places."""
    x, y, z = (terrain.vertices + np.asarray(terrain.origin)).T
    return z - height(x - CORNER[0], y - CORNER[1])


def changes(report):
    return {change.what: change.count for change in report.changes}


# --- orientation ---

PLACES = {
    "north-up": north_up(),
    "south-up": Affine(1.0, 0.0, CORNER[0], 0.0, 1.0, CORNER[1] - N),
    "east to west": Affine(-1.0, 0.0, CORNER[0] + N, 0.0, -1.0, CORNER[1]),
    "both": Affine(-1.0, 0.0, CORNER[0] + N, 0.0, 1.0, CORNER[1] - N),
    "rows along x": Affine(0.0, 1.0, CORNER[0], 1.0, 0.0, CORNER[1] - N),
    "rows along x, turned": Affine(0.0, -1.0, CORNER[0] + N, 1.0, 0.0, CORNER[1] - N),
}


@pytest.mark.parametrize("name", PLACES)
@pytest.mark.parametrize("crs", ["EPSG:32635", None])
def test_orientation_keeps_heights_untouched(tmp_path, name, crs):
    shape = (30, N) if "rows" not in name else (N, 30)
    place = PLACES[name]
    z = sampled(place, shape).astype(np.float32)
    terrain, report = load(write(tmp_path / "g.tif", [z], place=place, crs=crs))
    assert terrain.crs == crs
    assert len(terrain.vertices) == z.size
    assert np.abs(errors(terrain)).max() < 1e-5  # single precision
    heights = np.sort(terrain.vertices[:, 2] + terrain.origin[2])
    np.testing.assert_array_equal(heights, np.sort(z.ravel().astype(np.float64)))
    assert "projected" not in changes(report)


@pytest.mark.parametrize("name", ["south-up", "rows along x, turned"])
def test_window_and_cell_of_a_turned_raster(tmp_path, name):
    place = PLACES[name]
    path = write(tmp_path / "g.tif", [sampled(place)], place=place)
    west, south = CORNER[0] + 10.0, CORNER[1] - 31.0
    terrain, report = load(path, window=(west, south, west + 12.0, south + 20.0))
    assert report.extent_m[:2] == pytest.approx((11.0, 19.0))
    low = terrain.extent[0] + terrain.origin
    assert low[:2] == pytest.approx((west + 0.5, south + 0.5))
    assert np.abs(errors(terrain)).max() < 1e-5
    coarse, report = load(path, cell=2.0)
    assert report.cell_m == 2.0
    assert np.abs(errors(coarse)).max() < CURVATURE * 2.0**2 / 4.0  # the mean over a cell


@pytest.mark.parametrize("crs", ["EPSG:32635", None])
@pytest.mark.parametrize(("turn", "sides"), [(30.0, (1.0, 1.0)), (0.0, (1.0, 2.0)), (-70.0, (0.5, 1.0))])
def test_turned_and_oblong_pixels_are_set_upright(tmp_path, crs, turn, sides):
    place = Affine.translation(*CORNER) @ Affine.rotation(turn) @ Affine.scale(sides[0], -sides[1])
    terrain, report = load(write(tmp_path / "g.tif", [sampled(place)], place=place, crs=crs))
    assert terrain.crs == crs
    assert changes(report)["projected"] == 1
    # bilinear within the pixels, beyond their centres by half a pixel
    assert np.abs(errors(terrain)).max() < CURVATURE * max(sides) ** 2 / 4.0 + 0.5 * max(sides) * 0.5
    assert np.median(np.abs(errors(terrain))) < CURVATURE * max(sides) ** 2 / 8.0
    assert report.ground_m2 == pytest.approx((N - 1) ** 2 * math.prod(sides), rel=0.12)


def test_place_by_a_world_file_and_by_ground_control_points(tmp_path):
    z = sampled(north_up())
    write(tmp_path / "g.tif", [z], place=None, crs=None)
    (tmp_path / "g.tfw").write_text(f"1\n0\n0\n-1\n{CORNER[0] + 0.5}\n{CORNER[1] - 0.5}\n")
    terrain, report = load(tmp_path / "g.tif", crs="EPSG:32635")
    assert np.abs(errors(terrain)).max() < 1e-5
    assert report.warnings == []
    points = [GroundControlPoint(r, c, CORNER[0] + c, CORNER[1] - r) for r in (0, N) for c in (0, N)]

    def put(data):
        data.gcps = (points, CRS.from_epsg(32635))

    terrain, report = load(write(tmp_path / "p.tif", [z], place=None, crs=None, change=put))
    assert any("ground control points" in text for text in report.warnings)
    assert np.abs(errors(terrain)).max() < 0.05  # its fit is not exact to the digit, so pixels are interpolated


# --- lengths on the ground ---


def projected_place(crs, longitude, latitude, pixel):
    """North-up pixels of ``pixel`` [m on the ground] around a place."""
    x, y = pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True).transform(
        np.array([longitude, longitude, longitude + 1e-4]), np.array([latitude, latitude + 1e-4, latitude])
    )
    geod = pyproj.Geod(ellps="WGS84")
    along = geod.inv(longitude, latitude, longitude, latitude + 1e-4)[2]
    scale = math.hypot(x[1] - x[0], y[1] - y[0]) / along
    side = pixel * scale
    return Affine(side, 0.0, x[0] - 0.5 * N * side, 0.0, -side, y[0] + 0.5 * N * side), scale


FAR_OFF = {
    "Web Mercator at 60 N": ("EPSG:3857", 24.0, 60.0),
    "Web Mercator at 45 S": ("EPSG:3857", -70.0, -45.0),
    "plate carree at 50 N": ("EPSG:4087", 10.0, 50.0),
    "polar stereographic at 50 N": ("EPSG:3413", -45.0, 50.0),
    "UTM two zones off": ("EPSG:32635", 10.0, 60.0),
    "Lambert of France in Spain": ("EPSG:2154", -5.0, 36.0),
}


@pytest.mark.parametrize("name", FAR_OFF)
def test_lengths_are_those_on_the_ground(tmp_path, name):
    """Against geodesics on the ellipsoid, between corners of the ground."""
    crs, longitude, latitude = FAR_OFF[name]
    place, _ = projected_place(crs, longitude, latitude, 1.0)
    row, column = np.mgrid[0:N, 0:N]
    back = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    lon, lat = back.transform(*(place @ (column + 0.5, row + 0.5)))
    geod = pyproj.Geod(ellps="WGS84")
    azimuth, _, distance = geod.inv(np.full_like(lon, longitude), np.full_like(lat, latitude), lon, lat)
    east, north = distance * np.sin(np.radians(azimuth)), distance * np.cos(np.radians(azimuth))
    slope = 0.2
    z = 100.0 + slope * north
    terrain, report = load(write(tmp_path / "g.tif", [z], place=place, crs=crs))
    zone = pyproj.CRS.from_user_input(terrain.crs)
    assert "UTM zone" in zone.name
    assert changes(report)["projected"] == 1
    assert report.slope_median_deg == pytest.approx(np.degrees(np.arctan(slope)), abs=0.1)
    area = np.ptp(east[N // 2]) * np.ptp(north[:, N // 2])
    assert report.ground_m2 == pytest.approx(area, rel=0.12)  # cells cut by the turned edge
    x, y = terrain.vertices[:, 0], terrain.vertices[:, 1]
    first, last = np.argmin(x + y), np.argmax(x + y)
    la, lo = to_geographic(terrain, x[[first, last]], y[[first, last]])
    true = geod.inv(lo[0], la[0], lo[1], la[1])[2]
    assert math.hypot(x[last] - x[first], y[last] - y[first]) == pytest.approx(true, rel=1.1e-3)  # UTM's own
    la, lo = to_geographic(terrain, x, y)
    azimuth, _, distance = geod.inv(np.full_like(lo, longitude), np.full_like(la, latitude), lo, la)
    inside = distance < 0.4 * N
    wrong = terrain.vertices[:, 2] + terrain.origin[2] - 100.0 - slope * distance * np.cos(np.radians(azimuth))
    assert np.abs(wrong[inside]).max() < 0.01


@pytest.mark.parametrize(
    ("crs", "longitude", "latitude"),
    [("EPSG:32635", 27.0, 60.0), ("EPSG:2154", 3.0, 47.0), ("EPSG:3857", 30.0, 0.2), ("EPSG:25833", 15.0, 62.0)],
)
def test_projections_for_the_place_stay(tmp_path, crs, longitude, latitude):
    place, scale = projected_place(crs, longitude, latitude, 1.0)
    assert abs(scale - 1.0) < 0.01
    z = sampled(north_up()).astype(np.float32)
    terrain, report = load(write(tmp_path / "g.tif", [z], place=place, crs=crs))
    assert terrain.crs == crs
    assert "projected" not in changes(report)
    heights = terrain.vertices[:, 2].reshape(N, N)[::-1] + terrain.origin[2]
    np.testing.assert_allclose(heights, z, rtol=0.0, atol=1e-12)


def test_windows_of_a_projected_raster(tmp_path):
    """Given in the file's coordinates, or in those of the UTM zone."""
    place, scale = projected_place("EPSG:3857", 24.0, 60.0, 1.0)
    path = write(tmp_path / "g.tif", [sampled(north_up())], place=place, crs="EPSG:3857")
    whole, _ = load(path)
    west, north = place @ (10, 8)
    terrain, report = load(path, window=(west, north - 20.0 * scale, west + 15.0 * scale, north))
    turn = np.radians(2.6)  # between grid and true north at 24 E in zone 35
    assert report.extent_m[0] == pytest.approx(15.0 * np.cos(turn) + 20.0 * np.sin(turn), abs=1.1)
    assert report.extent_m[1] == pytest.approx(20.0 * np.cos(turn) + 15.0 * np.sin(turn), abs=1.1)
    x, y = from_world(terrain, west + 7.0 * scale, north - 9.0 * scale, crs="EPSG:3857")
    low, high = terrain.extent
    assert np.all(low[:2] < (x, y))
    assert np.all((x, y) < high[:2])
    middle = np.asarray(whole.origin[:2]) + whole.vertices[:, :2].mean(axis=0)
    _, report = load(path, window=(*(middle - 8.0), *(middle + 8.0)))
    assert report.extent_m[:2] == pytest.approx((16.0, 16.0), abs=1.0)
    with pytest.raises(TerrainError, match="lies outside of its extent"):
        load(path, window=(0.0, 0.0, 1.0, 1.0))


def test_local_coordinates_under_a_national_system(tmp_path):
    """(0, 0) of Lambert-93 lies in the Atlantic off Africa: nobody measured there in it."""
    place = Affine(1.0, 0.0, 0.0, 0.0, -1.0, float(N))
    terrain, report = load(write(tmp_path / "g.tif", [sampled(north_up())], place=place, crs="EPSG:2154"))
    assert report.extent_m[:2] == pytest.approx((N - 1.0, N - 1.0))
    assert terrain.crs == "EPSG:2154"
    assert any("local metres" in text for text in report.warnings)


def test_a_window_in_degrees(tmp_path):
    pixel = 1e-5
    place = Affine(pixel, 0.0, 9.0, 0.0, -pixel, 45.0)
    path = write(tmp_path / "g.tif", [sampled(north_up())], place=place, crs="EPSG:4326")
    _, report = load(path, window=(9.0, 45.0 - 20.0 * pixel, 9.0 + 20.0 * pixel, 45.0))
    geod = pyproj.Geod(ellps="WGS84")
    assert report.extent_m[0] == pytest.approx(geod.inv(9.0, 45.0, 9.0 + 19.0 * pixel, 45.0)[2], abs=1.0)
    assert report.extent_m[1] == pytest.approx(geod.inv(9.0, 45.0, 9.0, 45.0 + 19.0 * pixel)[2], abs=1.0)


# --- bands ---


def described(*names, alpha=None):
    def change(data):
        for number, name in enumerate(names, 1):
            if name:
                data.set_band_description(number, name)
        if alpha:
            kinds = [ColorInterp.gray] + [ColorInterp.undefined] * (data.count - 1)
            kinds[alpha - 1] = ColorInterp.alpha
            data.colorinterp = kinds

    return change


@pytest.mark.parametrize(
    ("names", "band"),
    [
        (("elevation", "uncertainty"), 1),
        (("Uncertainty", "DTM"), 2),
        ((None, "std_dev"), 1),
        (("count", "mean height [m]", "intensity"), 2),
    ],
)
def test_the_band_described_as_heights_is_taken(tmp_path, names, band):
    z = sampled(north_up())
    bands = [np.full_like(z, 0.1)] * len(names)
    bands[band - 1] = z
    terrain, report = load(write(tmp_path / "g.tif", bands, place=north_up(), change=described(*names)))
    assert np.abs(errors(terrain)).max() < 1e-5
    text = next(change.text for change in report.changes if change.what == "band")
    assert all((name or "gray") in text for name in names)


def test_bands_that_nobody_describes_are_listed(tmp_path):
    z = sampled(north_up())
    path = write(tmp_path / "g.tif", [z, z + 1.0], place=north_up())
    with pytest.raises(TerrainError, match=r"2 bands: 1 'gray' \(float32\), 2 'undefined'.*--band"):
        load(path)
    terrain, _ = load(path, band=2)
    assert np.median(errors(terrain)) == pytest.approx(1.0, abs=1e-5)
    with pytest.raises(TerrainError, match="band = 3, but it has 2 bands"):
        load(path, band=3)
    with pytest.raises(TerrainError, match="band is 0, but must be a positive integer"):
        load(path, band=0)
    both = write(tmp_path / "h.tif", [z, z + 1.0], place=north_up(), change=described("DTM", "DSM"))
    with pytest.raises(TerrainError, match="several of its bands may be heights"):
        load(both)


@pytest.mark.parametrize("dtype", ["float32", "uint16", "uint8"])
def test_alpha_is_no_height(tmp_path, dtype):
    z = np.rint(sampled(north_up()))
    alpha = np.full_like(z, 255.0)
    alpha[:10, :10], alpha[20, 20] = 0.0, 1.0
    path = write(tmp_path / "g.tif", [z, alpha], place=north_up(), dtype=dtype, change=described(alpha=2))
    _, report = load(path, hole_limit=0.0)
    assert changes(report)["unknown"] == 100
    assert report.holes[0].area_m2 == pytest.approx(10 * 10)


def test_masks_inside_and_beside_the_file(tmp_path):
    z = sampled(north_up())
    mask = np.full(z.shape, 255, dtype=np.uint8)
    mask[5:9, 5:9] = 0
    for inside in (True, False):
        with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=inside):
            path = write(tmp_path / f"{inside}.tif", [z], place=north_up(), change=lambda data: data.write_mask(mask))
        assert (tmp_path / f"{inside}.tif.msk").exists() != inside
        _, report = load(path, hole_limit=0.0)
        assert changes(report)["unknown"] == 16


def test_a_palette_is_a_picture(tmp_path):
    def colour(data):
        data.write_colormap(1, {value: (value, 0, 0, 255) for value in range(256)})

    path = write(tmp_path / "g.tif", [np.rint(sampled(north_up()))], place=north_up(), dtype="uint8", change=colour)
    with pytest.raises(TerrainError, match="values are colours"):
        load(path)
    terrain, _ = load(path, band=1)
    assert np.abs(errors(terrain)).max() <= 0.5


def test_scale_and_offset_of_a_band(tmp_path):
    def put(data):
        data.scales, data.offsets = (0.01,), (100.0,)

    z = sampled(north_up())
    raw = np.rint((z - 100.0) / 0.01)
    raw[3, 3] = -32768
    path = write(tmp_path / "g.tif", [raw], place=north_up(), dtype="int16", nodata=-32768, change=put)
    terrain, report = load(path, hole_limit=0.0)
    assert np.abs(errors(terrain)).max() < 0.0051
    assert changes(report)["unknown"] == 1


# --- declared units ---


@pytest.mark.parametrize(
    ("said", "metres"),
    [
        ("metre", 1.0),
        ("m above sea level", 1.0),
        ("Decimetre", 0.1),
        ("centimetre", 0.01),
        ("MM", 0.001),
        ("Foot_US", 1200.0 / 3937.0),
        ("US survey foot", 1200.0 / 3937.0),
        ("ftUS", 1200.0 / 3937.0),
        ("international foot", 0.3048),
        ("ft", 0.3048),
        ("fathom", 1.8288),
    ],
)
def test_the_unit_of_a_band(tmp_path, said, metres):
    z = sampled(north_up())
    path = write(
        tmp_path / "g.tif", [z / metres], place=north_up(), dtype="float64", change=lambda d: d.set_band_unit(1, said)
    )
    terrain, report = load(path)
    assert np.abs(errors(terrain)).max() < 1e-9 / metres
    assert metres == 1.0 or "as its heights declare" in report.units
    assert "z_units" not in changes(report)
    terrain, _ = load(path, z_units="mm")  # the caller's word comes first
    assert np.ptp(terrain.vertices[:, 2]) == pytest.approx(np.ptp(z) / metres * 0.001, rel=1e-6)


@pytest.mark.parametrize("said", ["furlong", "dB", "m/s", "degC"])
def test_a_unit_that_nobody_knows_is_named(tmp_path, said):
    path = write(tmp_path / "g.tif", [sampled(north_up())], place=north_up(), change=lambda d: d.set_band_unit(1, said))
    with pytest.raises(TerrainError, match=f"'{said}'.*--z-units") as caught:
        load(path)
    assert "\n" not in str(caught.value)
    assert np.abs(errors(load(path, z_units="m").terrain)).max() < 1e-5


@pytest.mark.parametrize("place", [north_up(), PLACES["south-up"], Affine(1e-5, 0, -93, 0, -1e-5, 45)])
def test_the_unit_of_a_compound_system_is_said_once(tmp_path, place):
    foot = 1200.0 / 3937.0
    z = sampled(north_up())
    crs = "EPSG:4269+6360" if place.a < 0.1 else "EPSG:32635+6360"
    _, report = load(write(tmp_path / "g.tif", [z / foot], place=place, crs=crs))
    assert report.extent_m[2] == pytest.approx(np.ptp(z), abs=0.1)
    assert report.units.count("us-ft") + report.units.count("US survey foot") == 1


def test_a_declared_unit_that_makes_no_ground_is_refused(tmp_path):
    z = sampled(north_up())
    path = write(tmp_path / "g.tif", [z * 1e3], place=north_up(), change=lambda d: d.set_band_unit(1, "metre"))
    with pytest.raises(TerrainError, match=r"declared as m.*mm.*--z-units"):
        load(path)
    assert np.abs(errors(load(path, z_units="mm").terrain)).max() < 1e-5


def test_a_declared_unit_that_makes_the_ground_level_is_doubted(tmp_path):
    z = sampled(north_up())
    path = write(tmp_path / "g.tif", [z], place=north_up(), change=lambda d: d.set_band_unit(1, "millimetre"))
    _, report = load(path)
    assert report.extent_m[2] == pytest.approx(np.ptp(z) * 1e-3, rel=1e-3)
    assert any("declared as mm" in text and "m (" in text for text in report.warnings)


def test_degrees_under_a_system_of_metres(tmp_path):
    place = Affine(1e-5, 0.0, 24.0, 0.0, -1e-5, 60.0)
    path = write(tmp_path / "g.tif", [sampled(north_up())], place=place)
    with pytest.raises(TerrainError, match=r"look like degrees, but its crs .*EPSG:4326"):
        load(path)
    _, report = load(path, crs="EPSG:4326")
    assert report.extent_m[1] == pytest.approx(N * 1e-5 * 111_412.0, rel=0.05)


def test_a_broken_or_local_system_of_the_file(tmp_path):
    """The caller's comes first; without it, the ground is local, and it is said."""
    path = write(tmp_path / "g.tif", [sampled(north_up())], place=north_up(), crs='LOCAL_CS["site",UNIT["metre",1]]')
    terrain, report = load(path)
    assert terrain.crs is None
    assert any("coordinate system is passed over" in text for text in report.warnings)
    terrain, report = load(path, crs="EPSG:32635")
    assert terrain.crs == "EPSG:32635"
    assert report.warnings == []
    with pytest.raises(TerrainError, match="crs is 'EPSG:0', which is unknown"):
        load(path, crs="EPSG:0")


def test_bytes_are_doubted(tmp_path):
    path = write(tmp_path / "g.tif", [np.rint(sampled(north_up()))], place=north_up(), dtype="uint8")
    terrain, report = load(path)
    assert np.abs(errors(terrain)).max() <= 0.5
    assert any("bytes" in text for text in report.warnings)
    assert load(path, z_units="m").report.warnings == []


def test_declarations_that_contradict_each_other(tmp_path):
    z = sampled(north_up())
    path = write(
        tmp_path / "g.tif", [z], place=north_up(), crs="EPSG:32635+6360", change=lambda d: d.set_band_unit(1, "m")
    )
    terrain, report = load(path)
    assert np.abs(errors(terrain)).max() < 1e-5
    assert any("its crs US survey foot" in text for text in report.warnings)


# --- pictures ---


def pictures():
    rng = np.random.default_rng(1)
    return {
        "grey noise": (np.clip(110.0 + 25.0 * rng.standard_normal((N, N)), 0, 255), "uint8"),
        "speckle": (900.0 * rng.gamma(4.0, 0.25, (N, N)), "uint16"),
        "single look in dB": (10.0 * np.log10(rng.exponential(1.0, (N, N))), "float32"),
        "checkerboard": (255.0 * (np.indices((N, N)).sum(axis=0) % 2), "uint8"),
        "noise over a gradient": (
            np.clip(np.linspace(60, 190, N) + 25.0 * rng.standard_normal((N, N)), 0, 255),
            "uint8",
        ),
    }


@pytest.mark.parametrize("name", pictures())
def test_pictures_are_refused(tmp_path, name):
    z, dtype = pictures()[name]
    path = write(tmp_path / "g.tif", [z], place=north_up(), dtype=dtype)
    with pytest.raises(TerrainError, match="neighbouring pixels have nothing to do with each other"):
        load(path)


def test_coarse_noisy_ground_is_none(tmp_path):
    """The plain of a satellite's radar: whole metres, 2 m of noise every 30 m."""
    z = np.rint(100.0 + np.random.default_rng(2).normal(0.0, 2.0, (N, N)))
    terrain, _ = load(write(tmp_path / "g.tif", [z], place=north_up(30.0), dtype="int16"), spike_limit=1000.0)
    np.testing.assert_array_equal(terrain.vertices[:, 2].reshape(N, N)[::-1] + terrain.origin[2], z)


def test_a_unit_told_by_a_description_or_a_tag(tmp_path):
    heights = height(*np.meshgrid(np.arange(N), np.arange(N)))
    plain = load(write(tmp_path / "m.tif", [heights], place=north_up())).terrain.vertices
    for description, tags, factor, unit in (
        ("elevation (dm)", {}, 10.0, "dm"),
        ("Height [cm]", {}, 100.0, "cm"),
        ("dtm_ft", {}, 1 / 0.3048, "ft"),
        (None, {"VERTICAL_UNITS": "cm"}, 100.0, "cm"),
        (None, {"UNITS": "US survey feet"}, 3937 / 1200, "us-ft"),
        ("elevation (NAVD88)", {"AREA": "m2"}, 1.0, None),
        ("heights", {"UNITS": "see readme"}, 1.0, None),
    ):

        def change(data, description=description, tags=tags):
            data.update_tags(**tags)
            if description:
                data.set_band_description(1, description)

        file = write(tmp_path / "u.tif", [heights * factor], place=north_up(), dtype="float64", change=change)
        terrain, report = load(file)
        np.testing.assert_allclose(terrain.vertices, plain, atol=2e-5)
        assert [change.text.split(", as")[0] for change in report.changes if change.what == "z_units"] == (
            [f"heights in {unit}"] if unit else []
        )


def test_a_declared_mark_amid_the_heights_is_doubtful(tmp_path):
    heights = np.round(height(*np.meshgrid(np.arange(N), np.arange(N))))
    report = load(write(tmp_path / "a.tif", [heights], place=north_up(), nodata=150)).report
    assert any(
        f"{int((heights == 150).sum()):,} heights are unknown, as the file declares 150" in w for w in report.warnings
    )
    for mark in (-9999, 0, 9999):
        voids = heights.copy()
        voids[5:9, 5:9] = mark
        report = load(write(tmp_path / "b.tif", [voids], place=north_up(), nodata=mark)).report
        assert not any("heights are unknown" in warning for warning in report.warnings)


@pytest.mark.parametrize(
    ("pixel", "step", "told"), [(1.0, 1.0, True), (2.0, 0.5, True), (30.0, 1.0, False), (1.0, 0.1, False)]
)
def test_steps_of_rounded_heights_are_named_where_they_are_obstacles(tmp_path, pixel, step, told):
    heights = np.round(height(*np.meshgrid(np.arange(N), np.arange(N))) / step) * step
    report = load(write(tmp_path / "a.tif", [heights], place=north_up(pixel), dtype="float64")).report
    assert any(f"rounded to {step:g} m, on cells of {pixel:g} m" in warning for warning in report.warnings) == told


def test_an_up_axis_of_a_raster_is_passed_over_with_a_word(tmp_path):
    heights = height(*np.meshgrid(np.arange(N), np.arange(N)))
    file = write(tmp_path / "a.tif", [heights], place=north_up())
    terrain, report = load(file, up="y")
    np.testing.assert_array_equal(terrain.vertices, load(file, up="z").terrain.vertices)
    assert any("up='y' is passed over" in warning for warning in report.warnings)
    assert not any("passed over" in warning for warning in load(file, up="z").report.warnings)


@pytest.mark.parametrize(("text", "told"), [('PROJCS["broken', True), ("", True), (None, False), ("EPSG:32635", False)])
def test_a_projection_beside_it_that_says_nothing_is_named(tmp_path, text, told):
    heights = height(*np.meshgrid(np.arange(N), np.arange(N)))
    head = f"ncols {N}\nnrows {N}\nxllcorner {CORNER[0]}\nyllcorner {CORNER[1]}\ncellsize 1\n"
    (tmp_path / "a.asc").write_text(head + "\n".join(" ".join(f"{v:.3f}" for v in row) for row in heights) + "\n")
    if text is not None:
        wkt = CRS.from_user_input(text).to_wkt() if text.startswith("EPSG") else text
        (tmp_path / "a.prj").write_text(wkt)
    terrain, report = load(tmp_path / "a.asc")
    assert any("a.prj beside it names no coordinate system" in warning for warning in report.warnings) == told
    said, answer = load(tmp_path / "a.asc", crs="EPSG:32635")
    np.testing.assert_array_equal(said.vertices, terrain.vertices)
    assert not any("a.prj" in warning for warning in answer.warnings)


@pytest.mark.parametrize(("cell", "told"), [(2.0, False), (2.3, True)])
def test_a_cell_beside_the_multiples_of_the_pixel_is_told(tmp_path, cell, told):
    path = write(tmp_path / "g.tif", [sampled(north_up())], place=north_up())
    report = load(path, cell=cell)[1]
    assert [change.text for change in report.changes if change.what == "cell"] == told * [
        "cell of 2 m, the multiple of the pixel next to 2.3 m"
    ]
