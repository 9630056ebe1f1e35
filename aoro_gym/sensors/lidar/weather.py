"""Rain, fog and snow as a lidar meets them: extinction on the way, and echoes of drops and flakes."""

from __future__ import annotations

import math
from dataclasses import dataclass

from aoro_gym.checks import check_choice, check_range

DECIBEL_PER_KM = math.log(10.0) / 10.0 / 1000.0
"""Extinction coefficient [1/m] of 1 dB/km."""
FOG_RATIO, RAIN_RATIO, SNOW_RATIO = 18.2, 18.8, 29.0
"""Extinction over backscatter [sr]: droplets of fog (Pinnick et al. 1983, Appl. Opt. 22); drops (O'Connor, Illingworth and
Hogan 2004, J. Atmos. Oceanic Technol. 21, for drizzle; taken for rain: E); ice (Chen, Chiang and Nee 2002, Appl. Opt. 41,
for cirrus; taken for snow: E)."""
FOG_NUMBER, SNOW_NUMBER = 1e8, 5e3
"""Droplets and flakes a cubic metre (E): so many droplets that fog is smooth in a beam; flakes by the order of size
distributions (Gunn and Marshall 1958, J. Meteor. 15)."""


@dataclass(frozen=True)
class Weather:
    """A homogeneous air with what floats or falls in it. Raises ``ValueError`` naming the field and its bound."""

    extinction: float = 0.0
    """α [1/m] in the lidar's band: power falls with exp(-2 α R)."""
    backscatter: float = 0.0
    """β [1/(m sr)]."""
    number: float = 1.0
    """Particles a cubic metre: the fewer, the more their echoes scatter."""

    def __post_init__(self) -> None:
        check_range("extinction", self.extinction, "1/m", ge=0.0, lt=math.inf)
        check_range("backscatter", self.backscatter, "1/(m sr)", ge=0.0, lt=math.inf)
        check_range("number", self.number, "1/m³", gt=0.0, lt=math.inf)

    @classmethod
    def rain(cls, rate: float) -> Weather:
        """Rain of ``rate`` [mm/h], 0 to 200.

        Extinction 1.076 R^0.67 dB/km (Carbonneau and Wisely 1998, in Recommendation ITU-R P.1814); drops by Marshall and
        Palmer 1948: 8000 / (4.1 R^-0.21) a cubic metre.
        """
        check_range("rain", rate, "mm/h", ge=0.0, le=200.0)
        if rate == 0.0:
            return cls()
        extinction = 1.076 * rate**0.67 * DECIBEL_PER_KM
        return cls(extinction, extinction / RAIN_RATIO, 8000.0 / (4.1 * rate**-0.21))

    @classmethod
    def fog(cls, visibility: float, wavelength_nm: float = 905.0) -> Weather:
        """Fog or haze of a meteorological ``visibility`` [m], from 10 m.

        Extinction 3.912 / V (λ / 550 nm)^-q with q by Kim, McArthur and Korevaar 2001 (Proc. SPIE 4214): none below 500 m.
        """
        check_range("visibility", visibility, "m", ge=10.0, lt=math.inf)
        check_range("wavelength_nm", wavelength_nm, "nm", ge=300.0, le=2000.0)
        v = visibility / 1000.0
        if v < 0.5:
            q = 0.0
        elif v < 1.0:
            q = v - 0.5
        elif v < 6.0:
            q = 0.16 * v + 0.34
        else:
            q = 1.3 if v < 50.0 else 1.6
        extinction = 3.912 / visibility * (wavelength_nm / 550.0) ** -q
        return cls(extinction, extinction / FOG_RATIO, FOG_NUMBER)

    @classmethod
    def snow(cls, rate: float, *, wet: bool = False, wavelength_nm: float = 905.0) -> Weather:
        """Snow of ``rate`` [mm/h of water], 0 to 20, dry or wet.

        Extinction a S^b dB/km with a = 5.42e-5 λ + 5.496, b = 1.38 (dry) or a = 1.023e-4 λ + 3.786, b = 0.72 (wet), λ in nm
        (Recommendation ITU-R P.1814).
        """
        check_range("snow", rate, "mm/h", ge=0.0, le=20.0)
        if rate == 0.0:
            return cls()
        scale, power = (
            (1.023e-4 * wavelength_nm + 3.7855466, 0.72) if wet else (5.42e-5 * wavelength_nm + 5.4958776, 1.38)
        )
        extinction = scale * rate**power * DECIBEL_PER_KM
        return cls(extinction, extinction / SNOW_RATIO, SNOW_NUMBER)

    @classmethod
    def named(cls, kind: str, amount: float, *, wavelength_nm: float = 905.0) -> Weather:
        """``rain`` [mm/h], ``fog`` [m of visibility] or ``snow`` [mm/h]."""
        check_choice("weather", kind, ("rain", "fog", "snow"))
        if kind == "rain":
            return cls.rain(amount)
        if kind == "fog":
            return cls.fog(amount, wavelength_nm)
        return cls.snow(amount, wavelength_nm=wavelength_nm)


CLEAR = Weather()
"""No extinction, no echoes."""
