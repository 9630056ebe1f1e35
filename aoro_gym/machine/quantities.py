"""Units of the machine file, and the declaration of one parameter: its SI unit and its physical bounds.

A displacement is volume per RADIAN inside (m³/rad): flow is displacement times rad/s, torque is displacement times
pressure, with no 2π between them.
"""

import math
from dataclasses import dataclass, field
from typing import Any, TypeVar, dataclass_transform

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.units import BAR, DEGREE, LITRE_PER_MINUTE, RPM

Quantity = float | NDArray[np.float64]
"""One value for every twin, or an array of shape (N,) with one value a twin."""

_TURN = 2.0 * math.pi

UNITS: dict[str, tuple[str, float]] = {
    "1": ("1", 1.0),
    "kg": ("kg", 1.0),
    "kg*m^2": ("kg*m^2", 1.0),
    "kg/m^3": ("kg/m^3", 1.0),
    "m": ("m", 1.0),
    "mm": ("m", 1e-3),
    "rad": ("rad", 1.0),
    "deg": ("rad", DEGREE),
    "s": ("s", 1.0),
    "1/s": ("1/s", 1.0),
    "m/s": ("m/s", 1.0),
    "1/m": ("1/m", 1.0),
    "s/m": ("s/m", 1.0),
    "rad/s": ("rad/s", 1.0),
    "rpm": ("rad/s", RPM),
    "V": ("V", 1.0),
    "N": ("N", 1.0),
    "N/m": ("N/m", 1.0),
    "kN/m": ("N/m", 1e3),
    "N*s/m": ("N*s/m", 1.0),
    "kN*s/m": ("N*s/m", 1e3),
    "N*m": ("N*m", 1.0),
    "N*m/s": ("N*m/s", 1.0),
    "N*m/rad": ("N*m/rad", 1.0),
    "rad/N/m": ("rad/N/m", 1.0),
    "N*m*s/rad": ("N*m*s/rad", 1.0),
    "Pa": ("Pa", 1.0),
    "bar": ("Pa", BAR),
    "N/Pa": ("N/Pa", 1.0),
    "m^3": ("m^3", 1.0),
    "L": ("m^3", 1e-3),
    "m^3/s": ("m^3/s", 1.0),
    "L/min": ("m^3/s", LITRE_PER_MINUTE),
    "m^3/rad": ("m^3/rad", 1.0),
    "cm^3/rev": ("m^3/rad", 1e-6 / _TURN),
    "L/rev": ("m^3/rad", 1e-3 / _TURN),
    "m^3/s/Pa": ("m^3/s/Pa", 1.0),
    "kg/m^4": ("kg/m^4", 1.0),
}
"""Unit in a machine file → (its SI unit, factor to it)."""


def as_quantity(value: ArrayLike) -> Quantity:
    """``value`` as a float, or as a read-only array if it has a dimension."""
    if isinstance(value, float):  # most are: an array would take ten times as long
        return float(value)
    array = np.array(value, np.float64)
    array.flags.writeable = False
    return array if array.ndim else float(array)


def with_unit(value: float, unit: str) -> str:
    """``value`` and ``unit`` as a message shows them."""
    return f"{value:.6g}" if unit == "1" else f"{value:.6g} {unit}"


@dataclass(frozen=True, slots=True)
class Declaration:
    """SI unit of a parameter and the interval [SI] outside of which it has no physical meaning."""

    unit: str
    low: float = -math.inf
    high: float = math.inf
    low_open: bool = False
    high_open: bool = False

    def admits(self, value: Quantity) -> NDArray[np.bool_]:
        """Where ``value`` [SI] is finite and within the bounds."""
        above = np.greater(value, self.low) if self.low_open else np.greater_equal(value, self.low)
        below = np.less(value, self.high) if self.high_open else np.less_equal(value, self.high)
        return np.isfinite(value) & above & below

    def admits_number(self, value: float) -> bool:
        """As :meth:`admits`, of one number, in a tenth of the time."""
        above = value > self.low if self.low_open else value >= self.low
        below = value < self.high if self.high_open else value <= self.high
        return math.isfinite(value) and above and below

    def bounds(self, unit: str) -> str:
        """The interval in words, in ``unit``."""
        factor = UNITS[unit][1]
        low = f"{'above' if self.low_open else 'at least'} {with_unit(self.low / factor, unit)}"
        high = f"{'below' if self.high_open else 'at most'} {with_unit(self.high / factor, unit)}"
        parts = [text for text, limit in ((low, self.low), (high, self.high)) if math.isfinite(limit)]
        return " and ".join(parts or ["finite"])


def _parameter(declaration: Declaration) -> Any:
    return field(metadata={"declaration": declaration})


def finite(unit: str) -> Any:
    """Field of a section: any finite value in the SI ``unit``."""
    return _parameter(Declaration(unit))


def positive(unit: str) -> Any:
    """Field of a section: a value > 0."""
    return _parameter(Declaration(unit, low=0.0, low_open=True))


def non_negative(unit: str) -> Any:
    """Field of a section: a value ≥ 0."""
    return _parameter(Declaration(unit, low=0.0))


def fraction() -> Any:
    """Field of a section: a share in [0, 1]."""
    return _parameter(Declaration("1", low=0.0, high=1.0))


def efficiency() -> Any:
    """Field of a section: a share in (0, 1]."""
    return _parameter(Declaration("1", low=0.0, high=1.0, low_open=True))


def within(unit: str, low: float, high: float, *, low_open: bool = False, high_open: bool = False) -> Any:
    """Field of a section: a value in an interval given in the SI ``unit``; an end may be left out (open).

    Args:
        unit: SI unit of the value and its ends.
        low: Lower end.
        high: Upper end.
        low_open: Whether the lower end itself is left out.
        high_open: Whether the upper end itself is left out.
    """
    return _parameter(Declaration(unit, low, high, low_open, high_open))


def same_as(key: str) -> Any:
    """Field of a section that repeats the parameter ``key`` of another one, which its derived values need."""
    return field(metadata={"same_as": key})


_Section = TypeVar("_Section", bound=type)


@dataclass_transform(
    eq_default=False,
    frozen_default=True,
    field_specifiers=(finite, positive, non_negative, fraction, efficiency, within, same_as),
)
def section(cls: _Section) -> _Section:
    """Class decorator: a frozen dataclass of parameters and sub-sections, compared by identity (it may hold arrays)."""
    return dataclass(frozen=True, eq=False)(cls)
