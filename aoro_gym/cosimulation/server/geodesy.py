"""Where on the Earth the twin's frame lies: latitude, longitude and true north of its places."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from aoro_gym.checks import check_range
from aoro_gym.cosimulation.server.transverse_mercator import TransverseMercator
from aoro_gym.terrains import Plane, Terrain
from aoro_gym.terrains.extras import import_extra
from aoro_gym.terrains.georeference import GEOGRAPHIC, axis_unit, horizontal


@dataclass(frozen=True)
class Origin:
    """A place on the Earth that a local frame without a coordinate reference system is tangent to, x to its true east."""

    latitude: float = 66.5
    """[deg] WGS 84. E: the Arctic circle, near where the machine stands."""
    longitude: float = 25.7
    """[deg]"""
    height: float = 100.0
    """[m] of z = 0."""

    def __post_init__(self) -> None:
        check_range("latitude of the origin", self.latitude, "deg", ge=-89.0, le=89.0)
        check_range("longitude of the origin", self.longitude, "deg", ge=-180.0, le=180.0)
        check_range("height of the origin", self.height, "m", ge=-1000.0, le=9000.0)


class Geodesy:
    """Places and headings of a local frame on WGS 84.

    Args:
        ground: A terrain with a coordinate reference system lies where that says; any other ground, a transverse Mercator
            projection about the ``origin``.
        origin: Where the ground itself does not say.
    """

    def __init__(self, ground: Terrain | Plane, origin: Origin | None = None):
        origin = Origin() if origin is None else origin
        self.georeferenced = isinstance(ground, Terrain) and ground.crs is not None
        """Whether the ground itself says where it lies."""
        self._projection: TransverseMercator | _Georeferenced
        if isinstance(ground, Terrain) and ground.crs is not None:
            self._projection, self._offset = _Georeferenced(ground.crs), ground.origin
        else:
            self._projection = TransverseMercator(origin.latitude, origin.longitude)
            self._offset = (0.0, 0.0, origin.height)
        self._convergence = self._measured_convergence(0.0, 0.0)

    def place(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        """Latitude and longitude [deg] and height [m] of a local place [m]."""
        latitude, longitude = self._projection.place(x + self._offset[0], y + self._offset[1])
        return latitude, longitude, z + self._offset[2]

    def azimuth(self, x: float, y: float, heading: float) -> float:
        """Direction [deg] in [0, 360), clockwise from true north, of a local ``heading`` [rad], at a local place [m].

        Grid north leans from true north by the meridian convergence there.
        """
        if math.hypot(x - self._convergence[0], y - self._convergence[1]) > REMEASURE:
            self._convergence = self._measured_convergence(x, y)
        return (90.0 - math.degrees(heading) + self._convergence[2]) % 360.0

    def _measured_convergence(self, x: float, y: float) -> tuple[float, float, float]:
        """The place, and the convergence [deg] there."""
        return x, y, self._projection.convergence(x + self._offset[0], y + self._offset[1])


class _Georeferenced:
    """Places in a coordinate reference system, by pyproj."""

    def __init__(self, crs: str):
        pyproj = import_extra("pyproj", "the place of the ground on the Earth")
        system = horizontal(crs)
        self._metre = axis_unit(system)
        self._to_degrees: Any = pyproj.Transformer.from_crs(system, GEOGRAPHIC, always_xy=True)
        self._projection: Any = pyproj.Proj(system)

    def place(self, x: float, y: float) -> tuple[float, float]:
        longitude, latitude = self._to_degrees.transform(x / self._metre, y / self._metre)
        return latitude, longitude

    def convergence(self, x: float, y: float) -> float:
        latitude, longitude = self.place(x, y)
        return float(self._projection.get_factors(longitude, latitude).meridian_convergence)


REMEASURE = 20.0
"""Way [m] after which the meridian convergence is computed anew: it has changed by 0.001° at most, below 78° of latitude."""
