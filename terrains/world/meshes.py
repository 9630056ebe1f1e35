"""Triangles of objects, in the terrain's local frame; a function of the object alone, so that what is saved looks the same.

Winding is counter-clockwise seen from outside. Needles and leaves are single triangles, seen from both sides: as many square
metres as the tree's foliage has that meets light, at random in its crown, so that a beam is stopped as often as Beer and
Lambert's law says.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.terrains.world.materials import Surface
from aoro_gym.terrains.world.objects import Boulder, Branch, Kind, Log, Object, Stump, Tree, matrix
from aoro_gym.terrains.world.species import SPECIES

Array = NDArray[np.float64]
Faces = NDArray[np.int64]

SIDES = {Kind.TREE: 10, Kind.STUMP: 14, Kind.LOG: 12, Kind.BRANCH: 5}
"""Of the polygons that stand for round wood. (E)"""
BURIED = 0.3
"""Depth [m] to which stems, stumps reach below their origin, so that no gap opens on slopes. (E)"""
MOST_LEAVES = 240
"""Triangles of one crown; each stands for as much foliage as it must. (E)"""
LEAF = 0.12
"""Least area [m²] of a triangle of foliage, the size of a shoot with its twigs. (E)"""
ORANGE_FROM = 0.35
"""Share of a pine's height from which its bark is thin and orange. (E)"""
SWELL = 0.25
"""How much wider a stump is at the ground than at its cut. (E)"""
BUMPS = 0.16
"""Depth of a boulder's bumps as a share of its size. (E)"""
MOSSY = 0.55
"""Upward component of the normal from which moss grows on a boulder. (E)"""
BARKS = {"pine": Surface.PINE_BARK, "spruce": Surface.SPRUCE_BARK, "birch": Surface.BIRCH_BARK}
FOLIAGE = {"pine": Surface.PINE_NEEDLES, "spruce": Surface.SPRUCE_NEEDLES, "birch": Surface.BIRCH_LEAVES}


class Mesh(NamedTuple):
    """Triangles and what each is made of."""

    vertices: Array
    """(V, 3) [m]."""
    faces: Faces
    """(F, 3)."""
    surfaces: NDArray[np.uint8]
    """(F,) :class:`~aoro_gym.terrains.world.materials.Surface`."""


def mesh(thing: Object, *, leaves: bool = True, needles: bool = True) -> Mesh:
    """Triangles of an object; a birch without ``leaves`` is bare, a tree without ``needles`` its stem alone."""
    own = _MAKERS[thing.kind](thing)
    if isinstance(thing, Tree) and needles and (leaves or thing.species != "birch"):
        own = joined([own, foliage(thing)])
    return placed(own, thing)


def placed(own: Mesh, thing: Object) -> Mesh:
    """A mesh in an object's own axes, where the object is."""
    return own._replace(vertices=own.vertices @ matrix(thing.rotation).T + np.asarray(thing.position))


def joined(parts: list[Mesh]) -> Mesh:
    """Several meshes as one."""
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = [part.faces + start for part, start in zip(parts, starts[:-1], strict=True)]
    return Mesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate(faces),
        np.concatenate([part.surfaces for part in parts]),
    )


def round_wood(
    heights: ArrayLike, radii: ArrayLike, sides: int, bark: ArrayLike, ends: tuple[Surface | None, Surface | None]
) -> Mesh:
    """A stack of rings about the z axis.

    The polygons have the area of the circles that they stand for.

    Args:
        heights: (R,) of the rings [m], rising.
        radii: (R,) [m].
        sides: Corners of a ring.
        bark: Surface of the sides, one or (R - 1,) one a band.
        ends: Surfaces of the caps below and above; None: open.
    """
    z, r = np.asarray(heights, dtype=np.float64), np.asarray(radii, dtype=np.float64)
    cosine, sine = _corners(sides)
    swollen = r * np.sqrt(2.0 * np.pi / sides / np.sin(2.0 * np.pi / sides))
    rings = np.stack(
        [
            np.outer(swollen, cosine),
            np.outer(swollen, sine),
            np.broadcast_to(z[:, None], (len(z), sides)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    kinds = np.repeat(np.broadcast_to(np.asarray(bark), len(z) - 1), sides)
    surfaces, vertices = [kinds, kinds], [rings]
    for end, middle in zip(ends, (z[0], z[-1]), strict=True):
        if end is not None:
            vertices.append(np.array([[0.0, 0.0, middle]]))
            surfaces.append(np.full(sides, end))
    faces = _wood_faces(len(z), sides, ends[0] is not None, ends[1] is not None)
    return Mesh(np.concatenate(vertices), faces, np.concatenate(surfaces).astype(np.uint8))


@cache
def _corners(sides: int) -> tuple[Array, Array]:
    """Cosines and sines (sides,) of a ring's corners."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    return np.cos(angle), np.sin(angle)


@cache
def _wood_faces(rings: int, sides: int, below: bool, above: bool) -> Faces:
    """Triangles (F, 3) of so many rings of corners, numbered from the lowest on, and of caps about the hubs after them."""
    band, side = np.meshgrid(np.arange(rings - 1), np.arange(sides), indexing="ij")
    a, b = (band * sides + side).ravel(), (band * sides + (side + 1) % sides).ravel()
    faces = [np.stack([a, b, b + sides], axis=1), np.stack([a, b + sides, a + sides], axis=1)]
    around, hub = np.stack([np.arange(sides), (np.arange(sides) + 1) % sides], axis=1), rings * sides
    if below:
        faces.append(np.column_stack([np.full(sides, hub), around[:, ::-1]]))
    if above:
        faces.append(np.column_stack([np.full(sides, hub + below), around + (rings - 1) * sides]))
    found = np.concatenate(faces)
    found.flags.writeable = False  # shared by all objects of this kind
    return found


def stem_rings(tree: Tree) -> tuple[Array, Array]:
    """Heights [m] and radii [m] of the rings of a tree's stem, closest where the taper curve bends."""
    share = np.array([0.0, 0.01, 0.03, 0.07, 0.15, 0.3, 0.45, 0.6, 0.75, 0.88, 1.0])
    heights = share * tree.height
    return heights, np.maximum(0.5 * tree.diameter_at(heights), 0.003)


def foliage(tree: Tree) -> Mesh:
    """Needles or leaves: (F,) triangles at random in the crown, of the area that its species' functions give."""
    area = SPECIES[tree.species].foliage_area(tree.diameter, tree.height)
    count = int(np.clip(np.ceil(area / LEAF), 12, MOST_LEAVES))
    rng = np.random.default_rng(tree.shape)
    length = tree.height - tree.crown_base
    # evenly over the crown's volume: share of the crown above, by the square of its radius
    height = np.interp(rng.random(count), *_crown_volume(tree.species))
    reach = tree.crown_radius * crown_profile(tree.species, height) * np.sqrt(rng.random(count))
    turn = rng.uniform(0.0, 2.0 * np.pi, count)
    middle = np.stack([reach * np.cos(turn), reach * np.sin(turn), tree.crown_base + length * height], axis=1)
    # an equilateral triangle in a plane of random direction
    side = np.sqrt(4.0 * area / count / np.sqrt(3.0))
    u, v = _random_planes(rng, count)
    corners = [side / np.sqrt(3.0) * (np.cos(a) * u + np.sin(a) * v) for a in 2.0 * np.pi / 3.0 * np.arange(3)]
    vertices = (middle[:, None, :] + np.stack(corners, axis=1)).reshape(-1, 3)
    return Mesh(vertices, np.arange(3 * count).reshape(-1, 3), np.full(count, FOLIAGE[tree.species], dtype=np.uint8))


@cache
def _crown_volume(species: str) -> tuple[Array, Array]:
    """Shares of a crown's volume below heights, and these heights as shares of its length above its base (65,)."""
    fine = np.linspace(0.0, 1.0, 65)
    volume = np.cumsum(crown_profile(species, fine) ** 2)
    return volume / volume[-1], fine


def crown_profile(species: str, share: ArrayLike) -> Array:
    """Radius of the crown over its widest, by the ``share`` of its length above its base: a cone for spruce, half an
    ellipsoid for pine, an ellipsoid for birch; after the envelopes of Rautiainen and others (2008). (R)"""
    s = np.asarray(share, dtype=np.float64)
    if species == "spruce":
        return np.where(s < 0.1, 0.6 + 4.0 * s, (1.0 - s) / 0.9)
    if species == "pine":
        return np.where(s < 0.25, 0.5 + 2.0 * s, np.sqrt(np.maximum(1.0 - ((s - 0.25) / 0.75) ** 2, 0.0)))
    return np.sqrt(np.maximum(1.0 - ((s - 0.4) / np.where(s < 0.4, 0.45, 0.6)) ** 2, 0.0))


def _random_planes(rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    """Two perpendicular unit vectors (N, 3) in each of ``count`` planes, whose normals point evenly over the sphere."""
    z, turn = rng.uniform(-1.0, 1.0, count), rng.uniform(0.0, 2.0 * np.pi, count)
    level = np.sqrt(1.0 - z**2)
    normal = np.stack([level * np.cos(turn), level * np.sin(turn), z], axis=1)
    u = np.stack([-np.sin(turn), np.cos(turn), np.zeros(count)], axis=1)
    return u, np.cross(normal, u)


def _tree(tree: Tree) -> Mesh:
    heights, radii = stem_rings(tree)
    bark = np.full(len(heights), BARKS[tree.species])
    if tree.species == "pine":
        bark[heights > ORANGE_FROM * tree.height] = Surface.PINE_BARK_UPPER
    heights, radii = np.insert(heights, 0, -BURIED), np.insert(radii, 0, radii[0])
    return round_wood(heights, radii, SIDES[Kind.TREE], bark, (None, None))


def _stump(stump: Stump) -> Mesh:
    heights = np.array([-BURIED, 0.0, 0.4 * stump.height, stump.height])
    radii = stump.radius * (1.0 + SWELL * np.array([1.2, 1.0, 0.3, 0.0]))
    return round_wood(heights, radii, SIDES[Kind.STUMP], BARKS[stump.species], (None, Surface.END_GRAIN))


def _log(log: Log) -> Mesh:
    ends = (Surface.END_GRAIN, Surface.END_GRAIN) if log.pile else (Surface.DEAD_WOOD, Surface.DEAD_WOOD)
    bark = BARKS[log.species] if log.pile else Surface.DEAD_WOOD
    bands = np.linspace(0.0, 1.0, 4)
    radii = log.radius + bands * (log.top_radius - log.radius)
    return round_wood(log.length * bands, radii, SIDES[Kind.LOG], bark, ends)


def _branch(branch: Branch) -> Mesh:
    radii = branch.radius * np.array([1.0, 0.75, 0.3])
    heights = branch.length * np.array([0.0, 0.5, 1.0])
    return round_wood(heights, radii, SIDES[Kind.BRANCH], BARKS[branch.species], (Surface.END_GRAIN, None))


def _boulder(boulder: Boulder) -> Mesh:
    vertices, faces = SPHERE
    rng = np.random.default_rng(boulder.shape)
    waves = rng.normal(0.0, 2.2, (6, 3))
    bumps = np.mean(np.cos(vertices @ waves.T + rng.uniform(0.0, 2.0 * np.pi, 6)), axis=1)
    lumpy = vertices * (1.0 - BUMPS * (1.0 - bumps))[:, None] * np.asarray(boulder.half_axes)
    corners = (lumpy @ matrix(boulder.rotation).T)[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    mossy = normal[:, 2] > MOSSY * np.linalg.norm(normal, axis=1)
    return Mesh(lumpy, faces, np.where(mossy, Surface.MOSSY_ROCK, Surface.ROCK).astype(np.uint8))


def _sphere(times: int) -> tuple[Array, Faces]:
    """An icosahedron whose faces are split ``times`` times, on the unit sphere."""
    g = (1.0 + np.sqrt(5.0)) / 2.0
    corners = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g)]
    corners += [(0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]
    rows = "0 11 5,0 5 1,0 1 7,0 7 10,0 10 11,1 5 9,5 11 4,11 10 2,10 7 6,7 1 8,3 9 4,3 4 2,3 2 6,3 6 8,3 8 9,4 9 5"
    rows += ",2 4 11,6 2 10,8 6 7,9 8 1"
    faces = np.array([[int(word) for word in row.split()] for row in rows.split(",")])
    vertices = np.array(corners, dtype=np.float64)
    for _ in range(times):
        edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        unique, number = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
        ab, bc, ca = (number.reshape(3, -1) + len(vertices)).astype(np.int64)
        vertices = np.concatenate([vertices, vertices[unique].mean(axis=1)])
        a, b, c = faces.T
        faces = np.concatenate(
            [np.stack(three, axis=1) for three in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        )
    return vertices / np.linalg.norm(vertices, axis=1)[:, None], faces


SPHERE = _sphere(2)
"""(162, 3) vertices and (320, 3) faces of a ball, which boulders are made of."""
_MAKERS: dict[Kind, Callable[..., Mesh]] = {
    Kind.TREE: _tree,
    Kind.STUMP: _stump,
    Kind.BOULDER: _boulder,
    Kind.LOG: _log,
    Kind.BRANCH: _branch,
}
