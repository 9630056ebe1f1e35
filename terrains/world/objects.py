"""What stands and lies on the ground: trees, stumps, boulders, logs and branches, each with its pose and dimensions.

A pose is a position [m] and a rotation as a unit quaternion (x, y, z, w), from the object's own axes to the terrain's local
frame. The z axis of trees, stumps, logs and branches runs along the wood from the thick end, where the origin lies.

>>> stump = Stump((1.0, 2.0, 0.0), upright(), species="pine", radius=0.15, height=0.2)
>>> stump.kind.name, stump.drivable()
('STUMP', True)
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.checks import check_choice, check_range
from aoro_gym.terrains.terrain import LARGEST_COORDINATE
from aoro_gym.terrains.world.species import BREAST, LEAST_HEIGHT, MOST_HEIGHT, SPECIES

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

CLEARANCE = 0.6
"""Ground clearance [m] of the machine: the parameter ``frame.ground_clearance`` of its file."""
CAN_BE_BENT = 0.05
"""Diameter [m] of the thickest tree that a machine of 10 t bends over. (E)"""


class Kind(IntEnum):
    """Class of an object."""

    GROUND = 0
    TREE = 1
    STUMP = 2
    BOULDER = 3
    LOG = 4
    BRANCH = 5


@dataclass(frozen=True, slots=True)
class _Placed:
    position: Vector
    """Of the origin [m] in the terrain's local frame."""
    rotation: Quaternion
    """x, y, z, w."""

    kind: ClassVar[Kind]
    bounds: ClassVar[dict[str, tuple[float, float]]]

    def __post_init__(self) -> None:
        name = self.kind.name.lower()
        check_range(f"{name} position", self.position, "m", ge=-LARGEST_COORDINATE, le=LARGEST_COORDINATE)
        if len(self.position) != 3 or len(self.rotation) != 4:
            raise ValueError(f"{name} has position {self.position} and rotation {self.rotation}; give 3 and 4 numbers")
        check_range(f"{name} length of rotation", float(np.linalg.norm(self.rotation)), ge=0.999, le=1.001)
        for key, (low, high) in self.bounds.items():
            unit = "" if key == "shape" else "m"
            check_range(f"{name} {key}", getattr(self, key), unit, ge=low, le=high)
        if hasattr(self, "species"):
            check_choice(f"{name} species", getattr(self, "species"), SPECIES)  # noqa: B009


@dataclass(frozen=True, slots=True)
class Tree(_Placed):
    """A living tree; the origin lies on the ground in the middle of its stem."""

    species: str
    diameter: float
    """At breast height [m]."""
    height: float
    """Along the stem [m]."""
    crown_base: float
    """Height [m] of the lowest living branch."""
    crown_radius: float
    """Where the crown is widest [m]."""
    shape: int
    """Seed of what no dimension says: where branches point."""

    kind = Kind.TREE
    bounds = {  # noqa: RUF012
        "diameter": (0.02, 1.0),
        "height": (LEAST_HEIGHT, MOST_HEIGHT),
        "crown_base": (0.0, MOST_HEIGHT),
        "crown_radius": (0.1, 8.0),
        "shape": (0, 2**32 - 1),
    }

    def __post_init__(self) -> None:
        _Placed.__post_init__(self)  # slots make another class, which super() does not know
        check_range("tree crown_base", self.crown_base, "m", lt=self.height, note=", the tree's height")

    def diameter_at(self, heights: ArrayLike) -> NDArray[np.float64]:
        """Diameter [m] of the stem at ``heights`` [m] along it."""
        return SPECIES[self.species].stem_diameter(heights, self.diameter, self.height)

    def drivable(self, clearance: float = CLEARANCE) -> bool:
        """Whether a machine gets over it: only saplings bend."""
        return self.diameter <= CAN_BE_BENT


@dataclass(frozen=True, slots=True)
class Stump(_Placed):
    """What a felled tree left; the origin lies on the ground."""

    species: str
    radius: float
    """Of the cut [m]."""
    height: float
    """Of the cut above the ground [m]."""

    kind = Kind.STUMP
    bounds = {"radius": (0.02, 0.6), "height": (0.02, 1.5)}  # noqa: RUF012

    def drivable(self, clearance: float = CLEARANCE) -> bool:
        """Whether it is lower than the machine's ``clearance`` [m]."""
        return self.height <= clearance


@dataclass(frozen=True, slots=True)
class Boulder(_Placed):
    """A rounded stone; the origin lies in its middle."""

    half_axes: Vector
    """Along its own x, y and z [m]; no part reaches farther."""
    above: float
    """Height [m] of its top above the ground."""
    shape: int
    """Seed of its bumps."""

    kind = Kind.BOULDER
    bounds = {"half_axes": (0.05, 5.0), "above": (0.0, 10.0), "shape": (0, 2**32 - 1)}  # noqa: RUF012

    def drivable(self, clearance: float = CLEARANCE) -> bool:
        """Whether it is lower than the machine's ``clearance`` [m]."""
        return self.above <= clearance


@dataclass(frozen=True, slots=True)
class Log(_Placed):
    """A felled or fallen stem, or a piece of one; the origin lies in the middle of its thick end."""

    species: str
    length: float
    radius: float
    """Of the thick end [m]."""
    top_radius: float
    """Of the thin end [m]."""
    above: float
    """Height [m] of its highest point above the ground."""
    pile: int
    """Number of the pile that it lies in, from 1; 0: alone."""

    kind = Kind.LOG
    bounds = {  # noqa: RUF012
        "length": (0.3, MOST_HEIGHT),
        "radius": (0.02, 0.6),
        "top_radius": (0.005, 0.6),
        "above": (0.0, 10.0),
        "pile": (0, 1_000_000),
    }

    def drivable(self, clearance: float = CLEARANCE) -> bool:
        """Whether it lies alone and lower than the machine's ``clearance`` [m]."""
        return self.pile == 0 and self.above <= clearance


@dataclass(frozen=True, slots=True)
class Branch(_Placed):
    """A branch on the ground, as harvesting leaves it; the origin lies in the middle of its thick end."""

    species: str
    length: float
    radius: float
    """Of the thick end [m]."""

    kind = Kind.BRANCH
    bounds = {"length": (0.1, 8.0), "radius": (0.002, 0.1)}  # noqa: RUF012

    def drivable(self, clearance: float = CLEARANCE) -> bool:
        """Always."""
        return True


Object = Tree | Stump | Boulder | Log | Branch
CLASSES: dict[str, type[Any]] = {one.kind.name.lower(): one for one in (Tree, Stump, Boulder, Log, Branch)}
"""By the names of their kinds."""


def is_solid(one: Object) -> bool:
    """Whether an object pushes back: all but branches, and trees that a machine bends over."""
    return not isinstance(one, Branch) and not (isinstance(one, Tree) and one.drivable())


def dimensions(kind: type[Any]) -> list[str]:
    """Names of the fields of a class of objects, position and rotation first."""
    return [field.name for field in fields(kind)]


def upright(lean: float = 0.0, towards: float = 0.0, turn: float = 0.0) -> Quaternion:
    """Rotation of what stands, ``lean`` [rad] from the vertical ``towards`` a direction and turned about itself.

    Args:
        lean: Angle [rad] between its z axis and the vertical.
        towards: Direction [rad] in plan, from x to y.
        turn: Angle [rad] about its own z axis.
    """
    tilted = (-np.sin(towards) * np.sin(lean / 2.0), np.cos(towards) * np.sin(lean / 2.0), 0.0, np.cos(lean / 2.0))
    return _product(tilted, (0.0, 0.0, np.sin(turn / 2.0), np.cos(turn / 2.0)))


def along(direction: ArrayLike) -> Quaternion:
    """Rotation whose z axis points in a ``direction`` (3,)."""
    x, y, z = np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)
    return upright(float(np.arctan2(np.hypot(x, y), z)), float(np.arctan2(y, x)))


def matrix(rotation: Quaternion) -> NDArray[np.float64]:
    """(3, 3) matrix of a unit quaternion; its columns are the object's axes."""
    x, y, z, w = rotation
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def _product(a: tuple[Any, ...], b: tuple[Any, ...]) -> Quaternion:
    ax, ay, az, aw = (float(v) for v in a)
    bx, by, bz, bw = (float(v) for v in b)
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


__all__ = [
    "BREAST",
    "CLASSES",
    "CLEARANCE",
    "Boulder",
    "Branch",
    "Kind",
    "Log",
    "Object",
    "Quaternion",
    "Stump",
    "Tree",
    "Vector",
    "along",
    "dimensions",
    "is_solid",
    "matrix",
    "upright",
]
