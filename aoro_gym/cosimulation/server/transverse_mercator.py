"""The transverse Mercator projection on WGS 84, about a place of one's own, at scale 1.

Krüger's series in the third flattening n to the fourth order: Karney (2011), Transverse Mercator with an accuracy of a few
nanometers, Journal of Geodesy 85, 475-485, equations 35 and 36. What is left out is n⁵ of the Earth's radius, 0.1 µm.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

EQUATOR = 6_378_137.0
"""Semi-major axis [m] of WGS 84."""
FLATTENING = 1.0 / 298.257223563
N = FLATTENING / (2.0 - FLATTENING)
ECCENTRICITY = math.sqrt(FLATTENING * (2.0 - FLATTENING))
RADIUS = EQUATOR / (1.0 + N) * (1.0 + N**2 / 4.0 + N**4 / 64.0)
"""Length [m] of a meridian over 2 π."""
ALPHA = (
    N / 2.0 - 2.0 / 3.0 * N**2 + 5.0 / 16.0 * N**3 + 41.0 / 180.0 * N**4,
    13.0 / 48.0 * N**2 - 3.0 / 5.0 * N**3 + 557.0 / 1440.0 * N**4,
    61.0 / 240.0 * N**3 - 103.0 / 140.0 * N**4,
    49561.0 / 161280.0 * N**4,
)
"""From the sphere to the plane."""
BETA = (
    N / 2.0 - 2.0 / 3.0 * N**2 + 37.0 / 96.0 * N**3 - N**4 / 360.0,
    N**2 / 48.0 + N**3 / 15.0 - 437.0 / 1440.0 * N**4,
    17.0 / 480.0 * N**3 - 37.0 / 840.0 * N**4,
    4397.0 / 161280.0 * N**4,
)
"""From the plane to the sphere."""
DELTA = (
    2.0 * N - 2.0 / 3.0 * N**2 - 2.0 * N**3 + 116.0 / 45.0 * N**4,
    7.0 / 3.0 * N**2 - 8.0 / 5.0 * N**3 - 227.0 / 45.0 * N**4,
    56.0 / 15.0 * N**3 - 136.0 / 35.0 * N**4,
    4279.0 / 630.0 * N**4,
)
"""From the conformal latitude to the geographic one."""


class TransverseMercator:
    """Places of the plane that touches the Earth along the meridian of an origin.

    Args:
        latitude: Of x = y = 0 [deg].
        longitude: Of its meridian [deg].
    """

    def __init__(self, latitude: float, longitude: float):
        self.longitude = longitude
        sine = math.sin(math.radians(latitude))
        conformal = math.atan(math.sinh(math.atanh(sine) - ECCENTRICITY * math.atanh(ECCENTRICITY * sine)))
        self._north = conformal + _sum(ALPHA, lambda j: math.sin(2 * j * conformal))

    def place(self, x: float, y: float) -> tuple[float, float]:
        """Latitude and longitude [deg] of a place [m], x to the east and y to the north."""
        xi, eta = self._on_sphere(x, y)
        chi = math.asin(math.sin(xi) / math.cosh(eta))
        latitude = chi + _sum(DELTA, lambda j: math.sin(2 * j * chi))
        longitude = self.longitude + math.degrees(math.atan2(math.sinh(eta), math.cos(xi)))
        return math.degrees(latitude), (longitude + 180.0) % 360.0 - 180.0

    def convergence(self, x: float, y: float) -> float:
        """Angle [deg] from true north to the grid's, clockwise, at a place [m]."""
        xi, eta = self._on_sphere(x, y)
        north, east = self._north + y / RADIUS, x / RADIUS
        sigma = 1.0 - _sum(BETA, lambda j: 2 * j * math.cos(2 * j * north) * math.cosh(2 * j * east))
        tau = _sum(BETA, lambda j: 2 * j * math.sin(2 * j * north) * math.sinh(2 * j * east))
        leaning = math.tan(xi) * math.tanh(eta)
        return math.degrees(math.atan2(tau + sigma * leaning, sigma - tau * leaning))

    def _on_sphere(self, x: float, y: float) -> tuple[float, float]:
        """Coordinates [rad] of Mercator's transverse projection of the conformal sphere."""
        north, east = self._north + y / RADIUS, x / RADIUS
        return (
            north - _sum(BETA, lambda j: math.sin(2 * j * north) * math.cosh(2 * j * east)),
            east - _sum(BETA, lambda j: math.cos(2 * j * north) * math.sinh(2 * j * east)),
        )


def _sum(coefficients: Sequence[float], term: Callable[[int], float]) -> float:
    """Sum of coefficients times the terms 1, 2, ..."""
    return sum(one * term(j) for j, one in enumerate(coefficients, start=1))
