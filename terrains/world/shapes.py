"""Simple shapes that enclose what blocks a machine, as arrays for a broad phase and for contacts.

Branches are left out: a machine drives over them.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aoro_gym.terrains.world.meshes import BURIED, SWELL
from aoro_gym.terrains.world.objects import Boulder, Branch, Log, Object, Stump, Tree, matrix
from aoro_gym.terrains.world.world import World

REACH = 4.0
"""Height [m] up to which stems are enclosed: that of the machine. (E)"""


class ShapeKind(IntEnum):
    """What a shape is; its z axis is a cylinder's axis."""

    CYLINDER = 0
    BOX = 1


class Shapes(NamedTuple):
    """One row a shape."""

    kind: NDArray[np.uint8]
    """(S,) :class:`ShapeKind`."""
    instance: NDArray[np.int32]
    """(S,) number of the object in the scene, from 1."""
    position: NDArray[np.float32]
    """(S, 3) middle [m]."""
    rotation: NDArray[np.float32]
    """(S, 4) quaternion x, y, z, w."""
    half_size: NDArray[np.float32]
    """(S, 3) [m] along its axes; of a cylinder radius, radius, half length."""


def collision_shapes(world: World) -> Shapes:
    """Shapes of the trees up to 4 m, stumps, logs and boulders of a world.

    Round wood reaches at least to its shape's surface at the thick end, and stays inside by the taper elsewhere: up to a
    log's ``radius`` - ``top_radius``. A boulder stays inside its box by up to the box's half diagonal less its own reach.
    """
    found = [
        (number, one, _shape(one)) for number, one in enumerate(world.objects, start=1) if not isinstance(one, Branch)
    ]
    middles = [np.asarray(one.position) + matrix(one.rotation)[:, 2] * offset for _, one, (_, offset, _) in found]
    return Shapes(
        np.array([kind for _, _, (kind, _, _) in found], dtype=np.uint8),
        np.array([number for number, _, _ in found], dtype=np.int32),
        np.array(middles, dtype=np.float32).reshape(-1, 3),
        np.array([one.rotation for _, one, _ in found], dtype=np.float32).reshape(-1, 4),
        np.array([size for _, _, (_, _, size) in found], dtype=np.float32).reshape(-1, 3),
    )


def _shape(one: Object) -> tuple[ShapeKind, float, tuple[float, float, float]]:
    """Kind, offset [m] of its middle along the object's z axis, half sizes [m]."""
    if isinstance(one, Boulder):
        return ShapeKind.BOX, 0.0, one.half_axes
    if isinstance(one, Tree):
        low, high, radius = -BURIED, min(REACH, one.height), 0.5 * float(one.diameter_at(0.0))
    elif isinstance(one, Stump):
        low, high, radius = -BURIED, one.height, one.radius * (1.0 + 1.2 * SWELL)
    else:
        assert isinstance(one, Log)
        low, high, radius = 0.0, one.length, one.radius
    return ShapeKind.CYLINDER, 0.5 * (low + high), (radius, radius, 0.5 * (high - low))
