"""Where a machine can stand in a world without standing in an object."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aoro_gym.terrains.world.objects import Boulder, Log, Tree, is_solid, matrix
from aoro_gym.terrains.world.world import World

HALF_LENGTH = 2.5
"""From the hinge to either end of the machine [m]."""
HALF_WIDTH = 1.3
"""[m], tires and all."""
ROOM = 0.2
"""Least distance [m] from what is solid."""
SPACING = 0.5
"""Distance [m] of the places that are tried, and of the points that stand for a log."""
HEADINGS = 16
"""Directions that are tried at each place."""


class Place(NamedTuple):
    """Of a machine's hinge in plan."""

    x: float
    """[m]"""
    y: float
    """[m]"""
    heading: float
    """[rad] from x to y."""


def free_place(world: World, near: tuple[float, float] | None = None, *, ahead: float = 0.0) -> Place:
    """The nearest place where a machine stands in no object, heading where it is free farthest of 16 directions.

    Args:
        world: Its solid objects and its ground.
        near: x, y [m]; by default the middle of the ground.
        ahead: Length [m] before the machine that must be free, too.

    Raises:
        ValueError: there is no such place.
    """
    low, high = world.terrain.extent
    middle = 0.5 * (low[:2] + high[:2]) if near is None else np.asarray(near, dtype=np.float64)
    margin = np.hypot(HALF_LENGTH, HALF_WIDTH)
    axes = [np.arange(low[i] + margin, high[i] - margin + 1e-9, SPACING) for i in (0, 1)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    points, radii = _points(world)
    for place in places[np.argsort(np.linalg.norm(places - middle, axis=1), kind="stable")]:
        edges = [_to_edge(place - low[:2], high[:2] - place, heading) for heading in _headings()]
        free = [min(_free_ahead(points - place, radii, at), to) for at, to in zip(_headings(), edges, strict=True)]
        best = int(np.argmax(free))
        if free[best] >= ahead:
            return Place(float(place[0]), float(place[1]), float(_headings()[best]))
    raise ValueError(
        f"{world.name} has no place of {2.0 * HALF_LENGTH:g} m x {2.0 * HALF_WIDTH:g} m without objects and {ahead:g} m"
        " ahead of it; take a sparser world, or less ahead"
    )


def open_place(world: World) -> tuple[float, float]:
    """x, y [m] nearest to the middle of the ground where no object is within reach of a machine that stands there, whatever
    its heading and its joint angle.

    Raises ValueError if there is no such place.
    """
    low, high = world.terrain.extent
    reach = float(np.hypot(HALF_LENGTH, HALF_WIDTH))
    axes = [np.arange(low[i] + reach, high[i] - reach + 1e-9, SPACING) for i in (0, 1)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    solid = circles(world)
    for place in places[np.argsort(np.linalg.norm(places - 0.5 * (low[:2] + high[:2]), axis=1), kind="stable")]:
        if np.all(np.linalg.norm(solid[:, :2] - place, axis=1) > solid[:, 2] + reach + ROOM):
            return float(place[0]), float(place[1])
    raise ValueError(
        f"{world.name} has no place with {reach + ROOM:.1f} m to the next solid object around it; take a sparser world, or"
        " give a position"
    )


def circles(world: World) -> NDArray[np.float64]:
    """(K, 3) x, y, radius [m] in plan of what stands for the solid objects."""
    points, radii = _points(world)
    return np.column_stack([points, radii])


def stems(world: World) -> NDArray[np.float64]:
    """(K, 4) x, y, radius at breast height and height [m] of the trees that a machine does not bend."""
    trees = [one for one in world.objects if isinstance(one, Tree) and is_solid(one)]
    return np.array([(*one.position[:2], 0.5 * one.diameter, one.height) for one in trees]).reshape(-1, 4)


def stands_free(
    solid: NDArray[np.float64],
    hinge: NDArray[np.float64],
    heading: NDArray[np.float64],
    joint_angle: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Whether machines stand in none of the circles, (P,), nor nearer to one than :data:`ROOM`.

    Args:
        solid: Circles (K, 3), see :func:`circles`.
        hinge: x, y [m] (P, 2).
        heading: Of the front frame [rad] (P,).
        joint_angle: [rad] (P,), positive left: the rear frame's heading is the front one's less this.
    """
    apart = solid[:, :2] - hinge[:, None]
    free = np.ones(len(hinge), dtype=bool)
    for direction in (heading, heading - joint_angle + np.pi):  # from the hinge along either frame
        cosine, sine = np.cos(direction)[:, None], np.sin(direction)[:, None]
        along, across = apart[..., 0] * cosine + apart[..., 1] * sine, apart[..., 1] * cosine - apart[..., 0] * sine
        beyond = np.maximum(np.abs(along - 0.5 * HALF_LENGTH) - 0.5 * HALF_LENGTH, 0.0)
        outside = np.hypot(beyond, np.maximum(np.abs(across) - HALF_WIDTH, 0.0))
        free &= np.all(outside > solid[:, 2] + ROOM, axis=1)
    return free


def _headings() -> NDArray[np.float64]:
    """0 first, so that it is taken where several are as free."""
    return 2.0 * np.pi * np.arange(HEADINGS) / HEADINGS


def _free_ahead(apart: NDArray[Any], radii: NDArray[Any], heading: float) -> float:
    """How far [m] a machine gets straight on; negative where it stands in something. ``apart`` (N, 2) of its hinge."""
    along = apart @ np.array([np.cos(heading), np.sin(heading)])
    across = np.abs(apart @ np.array([-np.sin(heading), np.cos(heading)]))
    in_way = (across < HALF_WIDTH + ROOM + radii) & (along > -HALF_LENGTH - ROOM - radii)
    return float(np.min((along - radii - ROOM)[in_way], initial=np.inf)) - HALF_LENGTH


def _to_edge(below: NDArray[Any], above: NDArray[Any], heading: float) -> float:
    """Way [m] from a place straight on to the end of the ground, which lies ``below`` and ``above`` it along x and y [m]."""
    direction = np.array([np.cos(heading), np.sin(heading)])
    room = np.where(direction > 0.0, above, below)
    return float(np.min(room / np.maximum(np.abs(direction), 1e-9))) - HALF_LENGTH


def _points(world: World) -> tuple[NDArray[Any], NDArray[Any]]:
    """Circles that stand for the solid objects in plan: middles (N, 2) and radii (N,) [m]."""
    points, radii = [np.zeros((0, 2))], [np.zeros(0)]
    for one in filter(is_solid, world.objects):
        start = np.asarray(one.position)[:2]
        if isinstance(one, Log):
            shares = np.linspace(0.0, 1.0, int(one.length / SPACING) + 2)
            points.append(start + np.outer(shares * one.length, matrix(one.rotation)[:2, 2]))
            radii.append(np.full(len(shares), one.radius + 0.25 * SPACING))
            continue
        radius = max(one.half_axes) if isinstance(one, Boulder) else getattr(one, "radius", None)
        points.append(start[None])
        radii.append(np.array([0.5 * getattr(one, "diameter", 0.0) * 1.5 if radius is None else radius]))
    return np.concatenate(points), np.concatenate(radii)
