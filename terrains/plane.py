"""The inclined plane: a ground with one slope, one friction and one rolling resistance."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.checks import check_range

# field: (lowest, highest, unit)
BOUNDS = {
    "slope_deg": (-45.0, 45.0, "deg"),
    "direction_deg": (-360.0, 360.0, "deg"),
    "friction": (0.01, 2.0, "x asphalt"),
    "rolling_resistance": (0.0, 50.0, "x asphalt"),
}


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane through the world's origin; every field is a scalar, or an (N,) array with one value a twin.

    Raises ``ValueError`` naming the field, its value and its bound.
    """

    slope_deg: ArrayLike = 0.0
    """Inclination [deg]: positive rises towards ``direction_deg``."""
    direction_deg: ArrayLike = 0.0
    """Direction of ascent [deg], counter-clockwise from world x, seen from above."""
    friction: ArrayLike = 1.0
    """Multiplier [-] of the tires' friction; 1 is dry asphalt."""
    rolling_resistance: ArrayLike = 1.0
    """Multiplier [-] of the tires' rolling resistance; 1 is asphalt."""

    def __post_init__(self) -> None:
        lengths: dict[str, int] = {}
        for field in fields(self):
            value = _checked(field.name, getattr(self, field.name))
            object.__setattr__(self, field.name, value)
            if isinstance(value, np.ndarray):
                lengths[field.name] = len(value)
        if len(set(lengths.values())) > 1:
            listed = ", ".join(f"{name} has {length}" for name, length in lengths.items())
            raise ValueError(f"terrain fields differ in length: {listed}; give each one value, or one a twin")

    def __copy__(self) -> Plane:
        return self  # immutable

    def __deepcopy__(self, memo: dict[int, Any]) -> Plane:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(getattr(self, entry.name) for entry in fields(self))  # read-only again, and checked

    @property
    def normal(self) -> NDArray[np.float64]:
        """Upward unit normal in the world's frame: (3,), or (N, 3) where slope or direction is an array."""
        slope, direction = np.broadcast_arrays(np.radians(self.slope_deg), np.radians(self.direction_deg))
        horizontal = -np.sin(slope)
        return np.stack([horizontal * np.cos(direction), horizontal * np.sin(direction), np.cos(slope)], axis=-1)

    def height(self, x: ArrayLike, y: ArrayLike) -> Any:
        """Height [m] of the ground at the plan position ``x``, ``y`` [m]; broadcasts against the fields."""
        direction = np.radians(self.direction_deg)
        along = np.asarray(x) * np.cos(direction) + np.asarray(y) * np.sin(direction)
        return np.tan(np.radians(self.slope_deg)) * along


def _checked(name: str, value: ArrayLike) -> float | NDArray[np.float64]:
    """``value`` as a float or a read-only (N,) array within the field's bounds."""
    low, high, unit = BOUNDS[name]
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"terrain {name} is {value!r}, but must be a number, or one number a twin") from None
    if array.ndim > 1 or array.size == 0:
        raise ValueError(f"terrain {name} has the shape {array.shape}; give a number, or one number a twin")
    check_range(f"terrain {name}", array, unit, ge=low, le=high)
    if array.ndim == 0:
        return float(array)
    array.flags.writeable = False
    return array
