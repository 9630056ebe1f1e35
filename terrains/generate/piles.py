"""Wood that lies: single stems on uneven ground, and logs stacked on each other. Numbers without a source are (E)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.terrains.generate.placing import Place, Site
from aoro_gym.terrains.world.objects import Log, Object, Vector, along

Array = NDArray[Any]

Circle = tuple[float, float, float]
"""Aside, up and radius [m]."""

SUNK = 0.25
"""Share of its radius that lying wood sinks into moss. (E)"""


def lying(
    site: Site, start: Place, heading: float, length: float, radii: tuple[float, float]
) -> tuple[Vector, Array, float]:
    """Position and direction of wood whose ends follow the ground and that rests on what is highest between them.

    Args:
        site: The ground.
        start: Place [m] of the thick end.
        heading: Direction [rad] in plan.
        length: In plan and, to the slope's cosine, of the wood [m].
        radii: At the thick and the thin end [m].

    Returns:
        The middle of the thick end, the unit vector along the axis, and the height [m] of the highest point above the
        ground below it.
    """
    share = np.linspace(0.0, 1.0, max(int(np.ceil(length / 0.3)), 2) + 1)
    plan = np.array([np.cos(heading), np.sin(heading)])
    points = np.array(start[:2]) + length * share[:, None] * plan
    ground = site.height(points)
    ground = np.where(np.isfinite(ground), ground, start[2])
    radius = radii[0] + share * (radii[1] - radii[0])
    line = ground[0] + share * (ground[-1] - ground[0])
    line = line + float(np.max(ground - line))
    axis = line + radius * (1.0 - SUNK)
    direction = np.array([*(length * plan), axis[-1] - axis[0]])
    direction /= np.linalg.norm(direction)
    above = float(np.max(axis + radius - ground))
    return (start[0], start[1], float(axis[0])), direction, above


def pile(
    site: Site, place: Place, heading: float, number: int, logs: Sequence[tuple[str, float, float, float]]
) -> list[Object]:
    """Logs in layers, each in the hollow between two below it, thick ends together.

    Args:
        site: The ground.
        place: Middle of the pile [m].
        heading: Of the logs [rad] in plan.
        number: Of the pile, from 1.
        logs: Species, length, radius of the thick and of the thin end [m] of each, thickest first.
    """
    length = logs[0][1]
    forth = np.array([np.cos(heading), np.sin(heading)])
    left = np.array([-forth[1], forth[0]])
    middle = np.array(place[:2])
    # a plane through the ground below the pile, lifted to its highest point
    reach = 0.5 * sum(log[2] for log in logs[:4])
    samples = np.array([(a, b) for a in np.linspace(-0.5, 0.5, 7) * length for b in np.linspace(-1.0, 1.0, 5) * reach])
    ground = site.height(middle + samples[:, :1] * forth + samples[:, 1:] * left)
    ground = np.where(np.isfinite(ground), ground, place[2])
    plane = np.linalg.lstsq(np.column_stack([samples, np.ones(len(samples))]), ground, rcond=None)[0]
    lift = float(np.max(ground - samples @ plane[:2] - plane[2]))
    axis = np.array([*forth, plane[0]]) / np.hypot(1.0, plane[0])
    across = np.array([*left, plane[1]]) / np.hypot(1.0, plane[1])
    up = np.cross(axis, across)
    up /= np.linalg.norm(up)
    origin = np.array([*middle, plane[2] + lift]) - 0.5 * length * axis
    rotation = along(axis)
    found: list[Object] = []
    for (species, long, radius, top), (aside, height) in zip(logs, stacked([log[2] for log in logs]), strict=True):
        x, y, z = (float(v) for v in origin + aside * across + height * up)
        above = float(height + radius + lift)
        found.append(Log((x, y, z), rotation, species, long, radius, top, above, number))
    return found


def stacked(radii: Sequence[float]) -> list[tuple[float, float]]:
    """Middles (aside, up) [m] of circles in layers on a floor at 0, none overlapping another, the floor's first.

    A layer has one circle less than that below it.

    >>> [(round(x, 3), round(z, 3)) for x, z in stacked([1.0, 1.0, 1.0])]
    [(-1.0, 1.0), (1.0, 1.0), (0.0, 2.732)]
    """
    base = 1
    while base * (base + 1) // 2 < len(radii):
        base += 1
    floor: list[Circle] = []
    aside = 0.0  # of the last
    for k, radius in enumerate(radii[:base]):
        if k:  # touches the one before it
            aside += float(2.0 * np.sqrt(radius * radii[k - 1]))
        floor.append((aside, radius, radius))
    shift = 0.5 * aside
    found = [(x - shift, z) for x, z, _ in floor]
    layer, placed, rest = floor, list(floor), list(radii[base:])
    while rest:
        following: list[Circle] = []
        for a, b in pairwise(layer):
            if not rest:
                break
            radius = rest.pop(0)
            x = _upon(a, b, radius)
            below = [(z, r + radius, x - c) for c, z, r in (*placed, *following)]
            z = max(z + float(np.sqrt(sum_of**2 - off**2)) for z, sum_of, off in below if abs(off) < sum_of)
            following.append((x, z, radius))
            found.append((x - shift, z))
        layer = following
        placed += following
    return found


def _upon(a: Circle, b: Circle, radius: float) -> float:
    """Aside of a circle that lies on two others from above."""
    (ax, az, ar), (bx, bz, br) = a, b
    p, q, d = ar + radius, br + radius, float(np.hypot(bx - ax, bz - az))
    between = (p**2 - q**2 + d**2) / (2.0 * d)
    off = np.sqrt(max(p**2 - between**2, 0.0))
    return float(ax + (between * (bx - ax) - off * (bz - az)) / d)
