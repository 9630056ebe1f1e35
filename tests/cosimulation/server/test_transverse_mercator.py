"""The projection about a place of one's own, against PROJ's."""

import pyproj
import pytest

from aoro_gym.cosimulation.server.transverse_mercator import TransverseMercator


@pytest.mark.parametrize("origin", [(66.5, 25.7), (0.0, 179.99), (-41.0, 174.5), (88.9, -170.0)])
@pytest.mark.parametrize("place", [(0.0, 0.0), (30.0, -20.0), (-4_000.0, 9_000.0), (60_000.0, -80_000.0)])
def test_places_are_those_of_proj(origin, place):
    system = pyproj.CRS(f"+proj=tmerc +lat_0={origin[0]} +lon_0={origin[1]} +k=1 +datum=WGS84 +units=m")
    longitude, latitude = pyproj.Transformer.from_crs(system, "EPSG:4326", always_xy=True).transform(*place)
    plane = TransverseMercator(*origin)
    # 0.1 µm of the series are 1e-12° of latitude; near the pole longitude is as much less certain
    assert plane.place(*place) == pytest.approx((latitude, longitude), abs=1e-10)
    found = pyproj.Proj(system).get_factors(longitude, latitude).meridian_convergence
    assert plane.convergence(*place) == pytest.approx(found, abs=1e-9)
