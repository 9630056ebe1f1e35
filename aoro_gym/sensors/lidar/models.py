"""Lidars by their makers' published figures: where they look at when, how far and how exactly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from aoro_gym.checks import check_range

Array = NDArray[np.float64]
SPEED_OF_LIGHT = 299_792_458.0


@dataclass(frozen=True, eq=False)
class Firings:
    """One sweep: F pulses in the order of time, in the sensor's axes x forward, y left, z up."""

    time: Array
    """(F,) [s] since the sweep began."""
    azimuth: Array
    """(F,) [rad] from x, positive left."""
    elevation: Array
    """(F,) [rad] above the sensor's xy plane."""
    ring: NDArray[np.int32]
    """(F,) number of the laser, from 0, in the order that the maker gives."""


@dataclass(frozen=True, eq=False)
class LidarModel:
    """What a maker publishes of a lidar; estimates are marked by (E) where models are listed.

    Raises ``ValueError`` naming the field and its bound.
    """

    name: str
    elevation_deg: tuple[float, ...]
    """Of each ring [deg]; of a ``rosette``: least and greatest."""
    columns: int
    """Firings of each laser a sweep."""
    rate: float
    """Sweeps a second [Hz]."""
    range_10: float
    """Distance [m] at which a Lambertian surface of 10 % reflectance, met at right angles, is seen nine times of ten."""
    max_range: float
    """[m] beyond which nothing is reported."""
    min_range: float
    """[m] below which nothing is reported."""
    noise: tuple[tuple[float, float], ...]
    """Standard deviation [m] of a range at ranges [m]: pairs (range, deviation), at most four, linear in between."""
    divergence_deg: tuple[float, float]
    """Full width at half maximum [deg] of the beam, horizontally and vertically."""
    wavelength_nm: float
    overlap: tuple[float, float] = (0.0, 0.0)
    """Ranges [m] from which on the receiver sees some and all of the beam: less reaches the detector from nearer, linearly
    (:mod:`aoro_gym.sensors.lidar.device`). (0, 0): transmitter and receiver share an axis."""
    pulse: float = 5e-9
    """Duration [s] of a pulse: echoes closer than its length c t / 2 are one."""
    resolution: float = 0.001
    """Of a reported range [m]."""
    ring_delay: float = 0.0
    """Time [s] from one laser's pulse to the next one's."""
    azimuth_offset_deg: tuple[float, ...] = (0.0,)
    """Of the rings [deg], repeated as often as needed."""
    pattern: Literal["rings", "rosette"] = "rings"
    source: str = ""

    def __post_init__(self) -> None:
        for name in ("rate", "range_10", "max_range", "min_range", "wavelength_nm", "pulse"):
            check_range(name, getattr(self, name), gt=0.0, lt=np.inf)
        check_range("elevation_deg", self.elevation_deg, "deg", ge=-90.0, le=90.0)
        check_range("noise", self.noise, "m", ge=0.0, lt=np.inf)
        check_range("overlap", self.overlap, "m", ge=0.0, lt=np.inf)
        if len(self.overlap) != 2 or self.overlap[0] > self.overlap[1]:
            raise ValueError(f"overlap is {self.overlap} m, but must be two ranges, the nearer one first")
        check_range("columns", self.columns, ge=1, le=1_000_000)
        check_range("number of pairs in noise", len(self.noise), ge=1, le=4)

    @property
    def band(self) -> int:
        """Column of a scene's reflectances: 0 below 1.2 µm (905 nm), 1 above (1550 nm)."""
        return int(self.wavelength_nm > 1200.0)

    @property
    def gate(self) -> float:
        """Length c t / 2 of a pulse [m]."""
        return 0.5 * SPEED_OF_LIGHT * self.pulse

    def firings(self, number: int = 0) -> Firings:
        """Pulses of the sweep ``number``; of rings every sweep is like the first."""
        return _rosette(self, number) if self.pattern == "rosette" else _rings(self)


def _rings(model: LidarModel) -> Firings:
    """A mirror or head that turns clockwise seen from above, its sweep beginning behind."""
    rings = len(model.elevation_deg)
    offset = np.resize(np.radians(model.azimuth_offset_deg), rings)
    column, ring = np.meshgrid(np.arange(model.columns), np.arange(rings), indexing="ij")
    time = column / (model.columns * model.rate) + model.ring_delay * ring
    azimuth = np.pi - 2.0 * np.pi * model.rate * time + offset[ring]
    elevation = np.radians(model.elevation_deg)[ring]
    azimuth = (azimuth + np.pi) % (2.0 * np.pi) - np.pi
    return Firings(time.ravel(), azimuth.ravel(), elevation.ravel(), ring.ravel().astype(np.int32))


ROSETTE_TURNS, ROSETTE_NODS = 33.73, 611.9
"""Turns and nods a second of :func:`_rosette`: numbers whose ratio is none of small integers, so that sweeps differ. E."""
ROSETTE_LASERS = 4


def _rosette(model: LidarModel, number: int) -> Firings:
    """Lasers that nod while they turn, a quarter of a nod apart, at rates that do not repeat from sweep to sweep.

    In the style of Livox's non-repetitive scanning, whose exact angles are not published in closed form.
    """
    count = model.columns * ROSETTE_LASERS
    time = np.arange(count) / (count * model.rate)
    ring = np.arange(count) % ROSETTE_LASERS
    clock = time + number / model.rate
    azimuth = (np.pi - 2.0 * np.pi * ROSETTE_TURNS * clock) % (2.0 * np.pi) - np.pi
    phase = (ROSETTE_NODS * clock + ring / ROSETTE_LASERS) % 1.0
    low, high = np.radians(model.elevation_deg)
    elevation = low + (high - low) * np.abs(2.0 * phase - 1.0)
    return Firings(time, azimuth, elevation, ring.astype(np.int32))


FULL_OVERLAP = 5.0
"""Range [m] from which on receivers are taken to see all of the beam. E: no maker publishes it; the code of Hahner et al.
(2021) puts it below 10 m for most systems, and takes 1 m in its example. It is taken to begin at the least range."""


def _os1(rings: int, reach: float, divergence: float) -> LidarModel:
    return LidarModel(
        name=f"os1-{rings}",
        elevation_deg=tuple(np.linspace(reach, -reach, rings).tolist()),
        columns=1024,
        rate=10.0,
        range_10=40.0,
        max_range=120.0,
        min_range=0.8,
        noise=((0.0, 0.015), (40.0, 0.03), (120.0, 0.10)),
        overlap=(0.8, FULL_OVERLAP),
        divergence_deg=(divergence, divergence),
        wavelength_nm=850.0,
        resolution=0.012,
        azimuth_offset_deg=(3.164, 1.055, -1.055, -3.164) if rings == 64 else (0.0,),
        source="Ouster, OS1 data sheet of the 850 nm generation: field of view ±16.6° (64) and ±22.5° (128), 40 m at 10 %,"
        " 0.8 m to 120 m, 1.5 cm to 10 cm by signal-to-noise ratio (placed at ranges: E), 1.2 cm, beam 0.13° and 0.18°."
        " Rings evenly spaced, staggered in four columns: nominal, units are calibrated one by one (E). Pulse 5 ns: E",
    )


MODELS: Mapping[str, LidarModel] = {
    "os1-64": _os1(64, 16.6, 0.13),
    "os1-128": _os1(128, 22.5, 0.18),
    "vlp-16": LidarModel(
        name="vlp-16",
        elevation_deg=(-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15),
        columns=1808,
        rate=10.0,
        range_10=50.0,
        max_range=100.0,
        min_range=0.5,
        noise=((0.0, 0.015), (100.0, 0.015)),
        overlap=(0.5, FULL_OVERLAP),
        divergence_deg=(0.18, 0.07),
        wavelength_nm=903.0,
        pulse=6e-9,
        resolution=0.002,
        ring_delay=2.304e-6,
        source="Velodyne, VLP-16 User Manual: elevation by laser, a pulse every 2.304 µs and a sequence every 55.296 µs"
        " (1808 a turn at 10 Hz), 903 nm, 2 mm, 100 m, ±3 cm typical (taken for two deviations: E), beam 3.0 mrad x"
        " 1.2 mrad, 6 ns; range at 10 %: E",
    ),
    "mid-360": LidarModel(
        name="mid-360",
        elevation_deg=(-7.0, 52.0),
        columns=5000,
        rate=10.0,
        range_10=40.0,
        max_range=70.0,
        min_range=0.1,
        noise=((0.0, 0.02), (70.0, 0.02)),
        overlap=(0.1, FULL_OVERLAP),
        divergence_deg=(0.03, 0.28),
        wavelength_nm=905.0,
        pattern="rosette",
        source="Livox, Mid-360 specifications: 40 m at 10 %, 70 m at 80 %, from 0.1 m, -7° to 52°, 200,000 points/s, 10 Hz,"
        " 2 cm at 10 m, 905 nm. Beam: that of the maker's HAP (E). Pattern in its style (E)",
    ),
}
"""By name."""
