"""Daylight by place, season, hour and clouds: the sun's and the sky's light in red, green and blue.

Irradiance of the sun and what molecules and aerosol scatter follow the simple spectral model of Bird and Riordan (1986, J.
Climate Appl. Meteor. 25) at 620, 550 and 460 nm, without ozone, water vapour and light from the ground (R). Clouds dim all
light by 1 - 0.75 N^3.4 (Kasten and Czeplak 1980, Solar Energy 24) (R) and the sun's by 1 - N; the sun's declination is
Cooper's (1969, Solar Energy 12). Hours are solar time.

>>> noon = daylight(day=172, hour=12.0)
>>> round(noon.elevation_deg, 1), bool(noon.sunlight[0] > noon.diffuse[0])
(49.5, True)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from aoro_gym.checks import check_choice, check_range
from aoro_gym.sensors.camera.kernels.sky import Sky
from aoro_gym.sensors.lidar.weather import Weather

Array = NDArray[np.float64]

WAVELENGTH = np.array([0.62, 0.55, 0.46])
"""Of red, green and blue [µm]."""
BAND = 90.0
"""Width [nm] of each, as of a sensor's colour filters. (E)"""
ABOVE_AIR = np.array([1.68, 1.86, 2.05])
"""Irradiance [W/(m² nm)] of the sun above the atmosphere, ASTM E490. (R)"""
ALPHA, ASYMMETRY = 1.14, 0.65
"""Of the aerosol: exponent of its optical depth by wavelength, and g; Bird and Riordan's rural aerosol. (R)"""
DISC_DEG = 0.2666
"""The sun's angular radius."""
SEASONS = {"spring": 130, "summer": 190, "autumn": 275, "winter": 60}
"""Days of the year."""
LATITUDE = 63.8
"""[deg] of Umeå, in the boreal forest."""
FAR_TREES, HAZE = (0.022, 0.032, 0.018), 0.03
"""Of a tree line on the horizon: albedo, and share of the air's own light before it. (E)"""
LOWEST = 2.0
"""Least elevation [deg] of the sun: the model knows no twilight."""


@dataclass(frozen=True, eq=False)
class Light:
    """Sun and sky; three numbers are red, green and blue."""

    towards_sun: Array
    """(3,) unit: x east, y north, z up."""
    sunlight: Array
    """(3,) [W/m²] in a band at right angles to it, clouds taken off."""
    molecules: Array
    """(3,) [W/m²] that molecules scatter on to level ground."""
    aerosol: Array
    """(3,) likewise aerosol."""
    overcast: Array
    """(3,) likewise clouds."""
    molecule_depth: Array
    """(3,) optical depth [-] of the molecules, straight up."""
    aerosol_depth: Array

    @property
    def diffuse(self) -> Array:
        """(3,) [W/m²] of the whole sky on level ground."""
        return self.molecules + self.aerosol + self.overcast

    @property
    def total(self) -> Array:
        """(3,) [W/m²] of sun and sky on level ground."""
        return self.diffuse + self.sunlight * max(float(self.towards_sun[2]), 0.0)

    @property
    def elevation_deg(self) -> float:
        """Of the sun."""
        return math.degrees(math.asin(float(self.towards_sun[2])))

    def on_device(self, weather: Weather, *, trees_deg: float | None = None) -> Any:
        """As device code has it.

        Args:
            weather: In the way.
            trees_deg: Mean elevation of a far tree line [deg]; None: a bare horizon.
        """
        sky: Any = Sky()
        sky.sun, sky.sunlight = _vec3(self.towards_sun), _vec3(self.sunlight)
        sky.disc = math.cos(math.radians(DISC_DEG))
        sky.asymmetry, sky.diffuse = ASYMMETRY, _vec3(self.diffuse)
        sky.molecule_depth, sky.aerosol_depth = _vec3(self.molecule_depth), _vec3(self.aerosol_depth)
        molecules, aerosol = self._patterns(*_directions())
        weight = _weights()
        sky.molecules = _vec3(self.molecules / (molecules * weight).sum(axis=(1, 2)))
        sky.aerosol = _vec3(self.aerosol / (aerosol * weight).sum(axis=(1, 2)))
        sky.overcast = _vec3(self.overcast * 9.0 / (7.0 * math.pi))  # ∫ (1 + 2 cos Z) / 3 cos Z dω = 7 π / 9
        sky.extinction = weather.extinction
        horizon = self._horizon()
        sky.airlight = _vec3(horizon)
        sky.trees = -3.0 if trees_deg is None else math.radians(trees_deg)
        sky.trees_radiance = _vec3(np.array(FAR_TREES) * self.total / math.pi + HAZE * horizon)
        return sky

    def _patterns(self, cosine: Array, around: Array) -> tuple[Array, Array]:
        """(3, ...) radiance of molecules and of aerosol by direction, not scaled yet."""
        level = np.sqrt(1.0 - cosine**2)
        towards = np.stack([level * np.cos(around), level * np.sin(around), cosine])
        angle = np.tensordot(self.towards_sun, towards, axes=1)
        mass = air_mass(np.degrees(np.arccos(cosine)))
        base = 1.0 + ASYMMETRY**2 - 2.0 * ASYMMETRY * angle
        scattered = [1.0 - np.exp(-depth[:, None, None] * mass) for depth in (self.molecule_depth, self.aerosol_depth)]
        return 0.75 * (1.0 + angle**2) * scattered[0], (1.0 - ASYMMETRY**2) / base**1.5 * scattered[1]

    def _horizon(self) -> Array:
        """(3,) mean radiance [W/(m² sr)] 3° above the horizon, which air has in the end (Koschmieder)."""
        weight = _weights()
        cosine, around = _directions()
        scale = [
            part / (pattern * weight).sum(axis=(1, 2))
            for part, pattern in zip((self.molecules, self.aerosol), self._patterns(cosine, around), strict=True)
        ]
        low = np.full((1, around.shape[1]), math.sin(math.radians(3.0)))
        near = self._patterns(low, around[:1])
        clear = sum(s * pattern.mean(axis=(1, 2)) for s, pattern in zip(scale, near, strict=True))
        return clear + self.overcast * 3.0 / (7.0 * math.pi)


def daylight(
    season: str = "summer",
    *,
    hour: float = 10.0,
    day: int | None = None,
    latitude_deg: float = LATITUDE,
    cloud: float = 0.0,
    turbidity: float = 0.06,
) -> Light:
    """Light of a time and place.

    Args:
        season: One of :data:`SEASONS`; of no effect beside ``day``.
        hour: Solar time, 12 is noon.
        day: Of the year, 1 to 366.
        latitude_deg: North is positive.
        cloud: Cover N, 0 to 1.
        turbidity: Ångström's β: optical depth of the aerosol at 1 µm; 0.05 clear, 0.2 hazy.

    Raises ``ValueError`` naming the argument, or where the sun is lower than :data:`LOWEST`.
    """
    check_choice("season", season, SEASONS)
    check_range("hour", hour, "h", ge=0.0, le=24.0)
    number = SEASONS[season] if day is None else day
    check_range("day", number, ge=1, le=366)
    check_range("latitude_deg", latitude_deg, "deg", ge=-90.0, le=90.0)
    check_range("cloud", cloud, ge=0.0, le=1.0)
    check_range("turbidity", turbidity, ge=0.01, le=0.5)
    towards = _sun(number, hour, math.radians(latitude_deg))
    up = float(towards[2])
    if up < math.sin(math.radians(LOWEST)):
        raise ValueError(
            f"hour is {hour:g} h, when the sun stands at {math.degrees(math.asin(up)):.0f}° on day {number} at latitude"
            f" {latitude_deg:g}°; it must be at {LOWEST:g}° at least: choose another hour or season"
        )
    mass = float(air_mass(math.degrees(math.acos(up))))
    ray, tau = _molecule_depth(), turbidity * WAVELENGTH**-ALPHA
    single = 0.945 * np.exp(-0.095 * np.log(WAVELENGTH / 0.4) ** 2)  # share that aerosol scatters and does not absorb
    through_molecules, through_aerosol = np.exp(-ray * mass), np.exp(-tau * mass)
    absorbed, scattered = np.exp(-(1.0 - single) * tau * mass), np.exp(-single * tau * mass)
    beam: Any = BAND * ABOVE_AIR
    direct = beam * through_molecules * through_aerosol
    molecules = beam * up * absorbed * (1.0 - through_molecules**0.95) * 0.5
    aerosol = beam * up * through_molecules**1.5 * absorbed * (1.0 - scattered) * _forward(up)
    clear = direct * up + molecules + aerosol
    sun, sky = 1.0 - cloud, 1.0 - cloud
    overcast = np.maximum((1.0 - 0.75 * cloud**3.4) * clear - sun * direct * up - sky * (molecules + aerosol), 0.0)
    grey = overcast.mean() / clear.mean() * clear  # clouds scatter all colours alike
    return Light(towards, sun * direct, sky * molecules, sky * aerosol, grey, ray, tau)


def air_mass(zenith_deg: Any) -> Any:
    """Kasten's (1965) air mass at a zenith angle [deg] up to 90."""
    return 1.0 / (np.cos(np.radians(zenith_deg)) + 0.15 * (93.885 - np.asarray(zenith_deg)) ** -1.253)


def _sun(day: int, hour: float, latitude: float) -> Array:
    """(3,) unit vector towards the sun: east, north, up."""
    declination = math.radians(23.45) * math.sin(2.0 * math.pi * (284 + day) / 365.0)
    angle = math.radians(15.0 * (hour - 12.0))
    east = -math.cos(declination) * math.sin(angle)
    north = math.cos(latitude) * math.sin(declination) - math.sin(latitude) * math.cos(declination) * math.cos(angle)
    up = math.sin(latitude) * math.sin(declination) + math.cos(latitude) * math.cos(declination) * math.cos(angle)
    return np.array([east, north, up])


def _molecule_depth() -> Array:
    """(3,) optical depth of Rayleigh scattering, straight up."""
    return 1.0 / (WAVELENGTH**4 * (115.6406 - 1.335 / WAVELENGTH**2))


def _forward(up: float) -> float:
    """Share of the light that aerosol scatters that goes on downward."""
    log = math.log(1.0 - ASYMMETRY)
    a = log * (1.459 + log * (0.1595 + log * 0.4129))
    b = log * (0.0783 + log * (-0.3824 - log * 0.5874))
    return 1.0 - 0.5 * math.exp((a + b * up) * up)


def _directions() -> tuple[Array, Array]:
    """Cosines of the zenith and directions around [rad] of a grid over the sky, both (64, 128)."""
    cosine, around = (np.arange(64) + 0.5) / 64.0, 2.0 * math.pi * (np.arange(128) + 0.5) / 128.0
    grid: Any = np.meshgrid(cosine, around, indexing="ij")
    return grid[0], grid[1]


def _weights() -> Array:
    """(64, 128) cosine times solid angle of the grid's cells."""
    return _directions()[0] * 2.0 * math.pi / (64.0 * 128.0)


def _vec3(values: Array) -> Any:
    return wp.vec3(*map(float, values))
