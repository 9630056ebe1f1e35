"""Places and headings against geodesics on the ellipsoid."""

import math

import numpy as np
import pyproj
import pytest

from aoro_gym.cosimulation.server.geodesy import Geodesy, Origin
from aoro_gym.terrains import Plane, Terrain, to_geographic

ELLIPSOID = pyproj.Geod(ellps="WGS84")
GROUND = Terrain.from_heights(
    np.zeros((3, 3)), cell=40.0, origin=(410_000.0, 7_375_000.0, 120.0), crs="EPSG:32635", name="ground"
)


@pytest.mark.parametrize("ground", [Plane(), GROUND], ids=["plane", "terrain"])
@pytest.mark.parametrize("heading", [0.0, 1.0, -2.5])
def test_a_heading_is_the_azimuth_of_the_geodesic_there(ground, heading):
    geodesy = Geodesy(ground, Origin(66.5, 25.7, 100.0))
    x, y, way = 30.0, -20.0, 5.0
    (first, east, height), (second, further, _) = (
        geodesy.place(x + share * way * math.cos(heading), y + share * way * math.sin(heading), 1.0)
        for share in (0.0, 1.0)
    )
    azimuth, _, distance = ELLIPSOID.inv(east, first, further, second)
    # within 20 m of where the convergence was computed it changes by 20 m tan(latitude) / 6,371 km = 0.0004°
    assert (geodesy.azimuth(x, y, heading) - azimuth + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1e-3)
    assert distance == pytest.approx(way, rel=5e-4)  # the scale of UTM is off by 0.4 ‰ at most
    assert height == (121.0 if ground is GROUND else 101.0)


def test_a_georeferenced_ground_says_where_it_lies():
    geodesy = Geodesy(GROUND, Origin(0.0, 0.0))
    assert geodesy.georeferenced and not Geodesy(Plane()).georeferenced
    latitude, longitude = to_geographic(GROUND, 12.0, 34.0)
    assert geodesy.place(12.0, 34.0, 0.0)[:2] == pytest.approx((float(latitude), float(longitude)), abs=1e-11)


def test_the_origin_lies_where_it_is_said():
    assert Geodesy(Plane(), Origin(-41.0, 174.5, 7.0)).place(0.0, 0.0, 0.0) == pytest.approx(
        (-41.0, 174.5, 7.0), abs=1e-9
    )
    with pytest.raises(ValueError, match="latitude of the origin is 95"):
        Origin(95.0, 0.0)


def test_a_plane_needs_no_pyproj(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "pyproj", None)  # an import of it fails
    assert Geodesy(Plane()).place(0.0, 0.0, 0.0) == pytest.approx((66.5, 25.7, 100.0), abs=1e-9)
    with pytest.raises(ValueError, match=r"needs pyproj: pip install 'aoro-gym\[terrain\]'"):
        Geodesy(Terrain.from_heights(np.zeros((3, 3)), cell=1.0, crs="EPSG:32634", name="ground"))
