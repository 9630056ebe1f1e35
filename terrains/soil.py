"""Soft ground: what a soil is, and presets with their sources."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.checks import check_choice, check_integer, check_range

DEEP = 100.0
"""Depth [m] of a soft layer that has no end."""

LEAST_TILES, MOST_TILES = 64, 65536
"""Bounds of the places for tiles of a twin's ruts."""
TILES_PER_METRE = 5
"""Tiles that a metre of fresh track of both sides takes."""

# field: (lowest, highest, unit)
BOUNDS = {
    "k_c": (0.0, 1e12, "N/m^(n+1)"),
    "k_phi": (1e3, 1e12, "N/m^(n+2)"),
    "exponent": (0.05, 2.0, ""),
    "cohesion": (0.0, 1e9, "Pa"),
    "friction_angle_deg": (0.0, 60.0, "deg"),
    "shear_modulus": (1e-6, 1.0, "m"),
    "mat": (0.0, 1e9, "N/m^3"),
    "layer": (0.01, DEEP, "m"),
    "k_0": (0.0, 1e12, "N/m^3"),
    "a_u": (0.0, 1e12, "N/m^4"),
    "unit_weight": (0.0, 3e4, "N/m^3"),
    "slip_sinkage": (0.0, 1.0, ""),
    "pass_exponent": (0.0, 1.0, ""),
}

PRESETS_FILE = Path(__file__).parent / "soils.toml"


@cache
def _file() -> Mapping[str, Any]:
    return tomllib.loads(PRESETS_FILE.read_text(encoding="utf-8"))


PRESETS: tuple[str, ...] = tuple(_file())
"""Names of the presets; ``soils.toml`` beside this module has their values, sources and tags."""

_UNITS = {"shear_modulus": 1e-2, "friction_angle": 1.0, "n": 1.0, "layer": 1.0}
"""SI units of a value in the file; kilo where it is not listed."""
_NAMES = {"n": "exponent", "friction_angle": "friction_angle_deg"}
LAWS = ("passes", "slip_sinkage")
"""Laws that a soil may have further, as :meth:`Soil.named` knows them."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Soil:
    """A soil by Bekker's, Wong's and Janosi's parameters; every field but the last three is a scalar, or an (N,) array
    with one value a twin.

    The laws stand in ``aoro_gym/twin/physics/soil.py``. Raises ``ValueError`` naming the field, its value and its bound.
    """

    k_c: ArrayLike
    """Cohesive modulus of pressure and sinkage [N/m^(n+1)]."""
    k_phi: ArrayLike
    """Frictional modulus [N/m^(n+2)]."""
    exponent: ArrayLike
    """n [-], in [0.05, 2]."""
    cohesion: ArrayLike
    """c [Pa]."""
    friction_angle_deg: ArrayLike
    """Angle φ of internal friction [deg]."""
    shear_modulus: ArrayLike
    """Shear displacement K [m] at which 63 % of the strength are there."""
    mat: ArrayLike = 0.0
    """m [N/m³] of the surface mat of peat, p = k z + 4 m z²/D_h."""
    layer: ArrayLike = DEEP
    """Depth [m] of the soft layer; firm ground below."""
    k_0: ArrayLike = 0.0
    """Unloading modulus at the surface [N/m³]."""
    a_u: ArrayLike = 5.03e8
    """Its rise with the sinkage [N/m⁴]."""
    unit_weight: ArrayLike = 17e3
    """γ [N/m³], for the push on a tire's flank."""
    slip_sinkage: ArrayLike = 0.0
    """Part [-] of Lyasko's slip sinkage: 0 none, 1 all of it, by which a wheel that slips by 20 % sinks 1.33 times as
    deep."""
    pass_exponent: ArrayLike = 0.0
    """m [-]: the wheel that is the n-th over a place sinks n^m times as deep there as in virgin soil; 0: passes do not
    count. Forestry's z_n = z_1 n^(1/a) has m = 1/a."""
    cell: float = 0.1
    """Distance [m] of the nodes that remember the ruts, in [0.05, 0.2]."""
    name: str = "soil"
    """What tables and pictures call it."""
    tiles: int = 1024
    """Places for tiles of 8 × 8 nodes that each twin has, a power of two in [64, 65536]; three quarters of them can be
    taken. Each costs 260 bytes, 516 where passes count, and 5 of them last for a metre of fresh track of both sides."""

    def __post_init__(self) -> None:
        lengths: dict[str, int] = {}
        for name, (low, high, unit) in BOUNDS.items():
            try:
                array = np.array(getattr(self, name), dtype=np.float64)
            except (TypeError, ValueError):
                given = getattr(self, name)
                raise ValueError(f"soil {name} is {given!r}, but must be a number, or one number a twin") from None
            if array.ndim > 1 or array.size == 0:
                raise ValueError(f"soil {name} has the shape {array.shape}; give a number, or one number a twin")
            check_range(f"soil {name}", array, unit, ge=low, le=high)
            if array.ndim:
                array.flags.writeable = False
                lengths[name] = len(array)
            object.__setattr__(self, name, array if array.ndim else float(array))
        if len(set(lengths.values())) > 1:
            listed = ", ".join(f"{name} has {length}" for name, length in lengths.items())
            raise ValueError(f"soil fields differ in length: {listed}; give each one value, or one a twin")
        check_range("soil cell", self.cell, "m", ge=0.05, le=0.2)
        check_integer("soil tiles", self.tiles, ge=LEAST_TILES, le=MOST_TILES)
        if self.tiles & (self.tiles - 1):
            raise ValueError(f"soil tiles is {self.tiles}, but must be a power of two in [{LEAST_TILES}, {MOST_TILES}]")

    def __reduce__(self) -> tuple[Any, ...]:
        return _again, ({entry.name: getattr(self, entry.name) for entry in fields(self)},)

    @property
    def num_variants(self) -> int:
        """Twins that it has values for; 1 if they are the same for all."""
        return max(np.size(getattr(self, name)) for name in BOUNDS)

    def variants(self, indices: NDArray[np.intp]) -> Soil:
        """The soils of some twins (K,), a soil each; this one if it is the same for all."""
        values: dict[str, Any] = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        values |= {name: value[indices] for name, value in values.items() if isinstance(value, np.ndarray)}
        return Soil(**values)

    @property
    def bytes_per_twin(self) -> int:
        """Memory [bytes] that each twin takes for its ruts."""
        return self.tiles * 4 * (64 * (1 + self.has_passes) + 1)

    @property
    def has_passes(self) -> bool:
        """Whether passes count, in any twin."""
        return bool(np.any(np.asarray(self.pass_exponent) > 0.0))

    @classmethod
    def preset(cls, name: str, moisture: float | None = None, *, passes: bool = False, **others: Any) -> Soil:
        """A soil of :data:`PRESETS`.

        Args:
            name: Of the preset.
            moisture: Water by mass of the dry soil [-], where the preset was measured at several: between them its
                values are
                interpolated (E), moduli logarithmically. By default the first of them.
            passes: Whether passes count, by the preset's ``pass_exponent``.
            others: Fields that differ from the preset.

        Raises:
            ValueError: there is no such preset or field, or a moisture is out of what was measured.
        """
        check_choice("soil", name, PRESETS)
        known = [entry.name for entry in fields(cls)]
        for field in others:
            check_choice("field of a soil", field, known)
        states = _file()[name]["states"]
        values = states[0] if moisture is None else _between(name, states, moisture)
        si: dict[str, Any] = {"name": name} | {
            _NAMES.get(key, key): value * _UNITS.get(key, 1e3)
            for key, value in values.items()
            if key not in ("moisture", "a", "pass_exponent")
        }
        if passes:
            if "pass_exponent" not in values:
                raise ValueError(
                    f"soil {name} has no known pass_exponent; drop passes, or give a pass_exponent of your own"
                )
            si["pass_exponent"] = values["pass_exponent"]
        return cls(**(si | others))

    @classmethod
    def named(cls, text: str) -> Soil:
        """The preset that a ``text`` names, as ``"clay"``, with its moisture as ``"clay:0.3"``, with further :data:`LAWS` as
        ``"clay:0.3+passes"`` or ``"clay+passes+slip_sinkage"``.

        Raises ValueError if there is none.
        """
        preset, *laws = text.split("+")
        for law in laws:
            check_choice("soil law", law, LAWS)
        name, _, water = preset.partition(":")
        try:
            moisture = float(water) if water else None
        except ValueError:
            raise ValueError(f"soil is {text!r}, but its moisture {water!r} must be a number, as in clay:0.3") from None
        return cls.preset(name, moisture, passes="passes" in laws, slip_sinkage=1.0 if "slip_sinkage" in laws else 0.0)

    def to_json(self) -> dict[str, Any]:
        """Its fields, arrays as lists."""
        values = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values.items()}

    @property
    def tan_phi(self) -> NDArray[np.float64] | float:
        """tan φ [-]."""
        return np.tan(np.radians(self.friction_angle_deg))


def _again(values: dict[str, Any]) -> Soil:
    return Soil(**values)


def preset_table() -> list[dict[str, Any]]:
    """Presets as they are in the file: name, about, source, and the values of each state."""
    return [{"name": name, **entry} for name, entry in _file().items()]


def _between(name: str, states: Sequence[Mapping[str, float]], moisture: float) -> dict[str, float]:
    """Values of a preset at a ``moisture`` between two that were measured."""
    if len(states) < 2:
        raise ValueError(f"soil moisture is {moisture:g}, but {name} was measured at one only; drop it")
    check_range("soil moisture", moisture, ge=states[0]["moisture"], le=states[-1]["moisture"], note=f" for {name}")
    at = [state["moisture"] for state in states]
    out = {}
    for key in states[0]:
        column = [state[key] for state in states]
        logarithmic = key in ("k_c", "k_phi")
        value = np.interp(moisture, at, np.log(column) if logarithmic else column)
        out[key] = float(np.exp(value) if logarithmic else value)
    return out
