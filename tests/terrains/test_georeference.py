"""A terrain on the Earth: latitude and longitude meet its local frame, in any unit, and errors name the fix."""

import numpy as np
import pyproj
import pytest

from aoro_gym.terrains import Terrain
from aoro_gym.terrains.georeference import from_world, scale_factors, to_geographic, to_local

CHABLAIS = (46.2, 6.8)  # latitude, longitude [deg], UTM zone 32


def ground(crs: str | None, origin=(0.0, 0.0, 0.0)) -> Terrain:
    return Terrain.from_heights(np.zeros((3, 3)), cell=1.0, crs=crs, origin=origin)


def test_central_meridian_meets_the_false_easting():
    # By definition of UTM: its central meridian (9° E in zone 32) has the easting 500 km, the equator the northing 0.
    x, y = to_local(ground("EPSG:32632", (499_000.0, -250.0, 0.0)), 0.0, 9.0)
    assert (float(x), float(y)) == pytest.approx((1000.0, 250.0), abs=1e-6)


def test_one_arc_second_north_is_a_meridian_arc():
    terrain = ground("EPSG:32632")
    _, y = to_local(terrain, np.array([45.0, 45.0 + 1 / 3600]), 9.0)
    # radius of curvature in the meridian at 45° on WGS 84, times the scale 0.9996 of the central meridian
    a, e2 = 6378137.0, 0.00669437999014
    radius = a * (1 - e2) / (1 - e2 / 2) ** 1.5
    assert float(np.diff(y)[0]) == pytest.approx(0.9996 * radius * np.radians(1 / 3600), abs=1e-4)


@pytest.mark.parametrize("crs", ["EPSG:32632", "EPSG:2056+5728", "EPSG:2227", "EPSG:25832"])
def test_there_and_back(crs):
    latitude, longitude = (37.7, -121.0) if crs == "EPSG:2227" else CHABLAIS
    terrain = ground(crs, origin=(12_345.0, -6_789.0, 5.0))
    x, y = to_local(terrain, latitude + np.linspace(0, 1e-3, 5), longitude)
    again = to_geographic(terrain, x, y)
    # a nanodegree is 0.1 mm; the inverse projections of PROJ close to better than that
    np.testing.assert_allclose(again[0], latitude + np.linspace(0, 1e-3, 5), atol=1e-9)
    np.testing.assert_allclose(again[1], longitude, atol=1e-9)


def test_feet_become_metres():
    in_feet, in_metres = ground("EPSG:2227"), ground("EPSG:26943")  # California zone 3, ftUS and m
    feet = np.array(to_local(in_feet, 37.7, -121.0)) + 0.0
    metres = np.array(to_local(in_metres, 37.7, -121.0))
    np.testing.assert_allclose(feet, metres, atol=2e-3)  # the false origin is rounded to a thousandth of a foot


def test_world_coordinates_of_another_system():
    terrain = ground("EPSG:32632", (330_000.0, 5_118_000.0, 0.0))
    lambert = pyproj.Transformer.from_crs("EPSG:32632", "EPSG:2154", always_xy=True)
    x, y = from_world(terrain, *lambert.transform(330_010.0, 5_118_020.0), crs="EPSG:2154")
    assert (float(x), float(y)) == pytest.approx((10.0, 20.0), abs=1e-3)
    assert from_world(terrain, 330_010.0, 5_118_020.0) == (10.0, 20.0)


def test_shapes_broadcast():
    x, y = to_local(ground("EPSG:32632"), np.full((2, 3), 46.0), 6.8)
    assert x.shape == y.shape == (2, 3)


@pytest.mark.parametrize(
    ("crs", "latitude", "longitude", "message"),
    [
        (None, 46.0, 6.8, "terrain 'terrain' has no coordinate reference system"),
        ("EPSG:99999", 46.0, 6.8, "crs is 'EPSG:99999', which is unknown"),
        ("EPSG:4326", 46.0, 6.8, "counts in degrees"),
        ("EPSG:5773", 46.0, 6.8, "neither projected nor geographic"),
        ("EPSG:32632", 91.0, 6.8, r"latitude is 91 deg, but must be in \[-90, 90\] deg"),
        ("EPSG:32632", 46.0, np.nan, "longitude is nan deg, but"),
        ("EPSG:32632", 0.0, 99.0, "1 of 1 points of WGS 84 lie outside of WGS 84 / UTM zone 32N"),
    ],
)
def test_refuses(crs, latitude, longitude, message):
    with pytest.raises(ValueError, match=message):
        to_local(ground(crs), latitude, longitude)


@pytest.mark.parametrize(
    ("crs", "longitude", "latitude"),
    [
        ("EPSG:32635", 27.0, 60.0),
        ("EPSG:32635", 10.0, 60.0),
        ("EPSG:2154", 3.0, 60.0),
        ("EPSG:3413", -45.0, 50.0),
        ("EPSG:4087", 10.0, 60.0),
        ("EPSG:2227", -121.0, 37.7),
    ],
)
def test_scale_factors(crs, longitude, latitude):
    """Against PROJ's derivatives of the projection; ours are of geodesics 100 m long."""
    system = pyproj.CRS.from_user_input(crs)
    x, y = pyproj.Transformer.from_crs(system.geodetic_crs, system, always_xy=True).transform(longitude, latitude)
    found = scale_factors(system, x, y)
    assert found is not None
    factors = pyproj.Proj(system).get_factors(longitude, latitude)
    # between Tissot's axes, at most 11.25 degrees off them
    assert found[0] == pytest.approx(
        factors.tissot_semiminor, rel=0.04 * (1.0 - factors.tissot_semiminor / factors.tissot_semimajor) + 1e-4
    )
    assert found[1] == pytest.approx(
        factors.tissot_semimajor, rel=0.04 * (factors.tissot_semimajor / factors.tissot_semiminor - 1.0) + 1e-4
    )


def test_scale_of_web_mercator():
    """The sphere of its formulas on the ellipsoid: secant of the latitude, within 0.7 %."""
    system = pyproj.CRS.from_epsg(3857)
    x, y = pyproj.Transformer.from_crs(4326, 3857, always_xy=True).transform(24.0, 60.0)
    found = scale_factors(system, x, y)
    assert found == pytest.approx((2.0, 2.0), rel=7e-3)
    assert scale_factors(pyproj.CRS.from_epsg(32635), 1e9, 1e9) is None
