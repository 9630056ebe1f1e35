"""The sensor behind the lens: electrons by exposure, their noise, numbers of the converter, colours of a screen.

A surface of radiance L fills a pixel of area A behind a lens of f-number N with π / 4 L A / N² t of energy (thin lens, on
the axis), and η λ / (h c) electrons a joule (EMVA standard 1288). Noise is Poisson's of the electrons, and normal in the
dark.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from aoro_gym.checks import check_integer, check_range
from aoro_gym.sensors.camera.kernels.film import Film
from aoro_gym.sensors.camera.light import WAVELENGTH, Light

PLANCK_LIGHT = 6.62607015e-34 * 299792458.0
"""h c [J m]."""
GREY = 0.15
"""Share of the scale that automatic exposure brings the geometric mean of a picture to. (E)"""
BRIGHT = 0.75
"""Share of the scale that a quarter of a picture's pixels may exceed, however dark the rest is. (E)"""


@dataclass(frozen=True)
class SensorModel:
    """A colour sensor and its aperture; each pixel has all three colours. Raises ``ValueError`` naming the field.

    The numbers are in the style of a 5-megapixel global-shutter sensor of 3.45 µm (10,400 electrons, 2.3 electrons of dark
    noise, about 0.6 of efficiency), its pixels binned 2 x 2. (R)
    """

    pitch: float = 6.9e-6
    """Edge of a pixel [m]."""
    f_number: float = 4.0
    transmittance: float = 0.9
    """Of the lens. (E)"""
    efficiency: tuple[float, float, float] = (0.50, 0.60, 0.52)
    """Electrons a photon in red, green and blue."""
    full_well: float = 41_600.0
    """Electrons that a pixel holds."""
    dark_noise: float = 4.6
    """Standard deviation [electrons]."""
    bits: int = 12
    black: float = 64.0
    """Number in the dark."""

    def __post_init__(self) -> None:
        for name, unit in (("pitch", "m"), ("f_number", ""), ("full_well", "electrons")):
            check_range(name, getattr(self, name), unit, gt=0.0, lt=math.inf)
        check_range("transmittance", self.transmittance, gt=0.0, le=1.0)
        check_range("efficiency", self.efficiency, gt=0.0, le=1.0)
        check_range("dark_noise", self.dark_noise, "electrons", ge=0.0, lt=math.inf)
        check_integer("bits", self.bits, ge=4, le=16)
        check_range("black", self.black, ge=0.0, le=0.25 * 2**self.bits)

    @property
    def most(self) -> int:
        """Largest number of the converter."""
        return 2**self.bits - 1

    @property
    def step(self) -> float:
        """Electrons of a step of the converter: a full pixel is its largest number."""
        return self.full_well / (self.most - self.black)

    def electrons(self, exposure: float) -> NDArray[np.float64]:
        """(3,) electrons of a radiance of 1 W/(m² sr) in each band over an ``exposure`` [s]."""
        energy = 0.25 * math.pi * self.transmittance * self.pitch**2 / self.f_number**2 * exposure
        return energy * np.asarray(self.efficiency) * WAVELENGTH * 1e-6 / PLANCK_LIGHT

    def on_device(self, exposure: float, noisy: bool) -> Any:
        """As device code has it."""
        film: Any = Film()
        film.electrons = wp.vec3(*map(float, self.electrons(exposure)))
        film.full, film.read, film.step = self.full_well, self.dark_noise, self.step
        film.most, film.black, film.noisy = float(self.most), self.black, noisy
        return film


def metered(sensor: SensorModel, radiance: NDArray[Any], bounds: tuple[float, float]) -> float:
    """Exposure [s] within ``bounds`` by automatic exposure for ``radiance`` (..., 3) [W/(m² sr)].

    The picture's geometric mean becomes :data:`GREY`, unless a quarter of its pixels would then exceed :data:`BRIGHT`.
    """
    electrons = (radiance * sensor.electrons(1.0)).max(axis=-1) / sensor.full_well  # a second
    seen = electrons[electrons > 0.0]
    if not seen.size:
        return bounds[1]
    middle = float(np.exp(np.log(seen).mean()))
    bright = float(np.quantile(seen, 0.75))
    return float(np.clip(min(GREY / middle, BRIGHT / bright), *bounds))


def white_balance(sensor: SensorModel, light: Light) -> NDArray[np.float64]:
    """(3,) gains by which a white surface on open ground becomes white, the largest number staying the largest."""
    gains = 1.0 / (light.total * sensor.electrons(1.0))
    return gains / gains.min()


def developed(sensor: SensorModel, numbers: NDArray[Any], gains: NDArray[np.float64]) -> NDArray[np.uint8]:
    """(..., 3) colours of a screen (sRGB, IEC 61966-2-1) of the converter's numbers, white by ``gains``."""
    linear = np.clip((numbers - sensor.black) / (sensor.most - sensor.black) * gains, 0.0, 1.0)
    curve = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1.0 / 2.4) - 0.055)
    return np.rint(255.0 * curve).astype(np.uint8)
