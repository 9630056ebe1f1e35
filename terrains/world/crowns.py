"""Crowns for cameras: branches, and twigs as triangles whose gaps between needles or leaves a camera knows of.

:func:`~aoro_gym.terrains.world.meshes.foliage` spreads a crown's area evenly, as Beer and Lambert's law has it, by triangles
that are as large as shoots together; a picture shows them. Here the same area hangs on branches, by twigs of their own
size. Numbers of branches, their angles and where needles are on them are estimated by eye (E).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aoro_gym.terrains.world.materials import Surface
from aoro_gym.terrains.world.meshes import BARKS, FOLIAGE, Mesh, crown_profile, joined, mesh, placed
from aoro_gym.terrains.world.objects import Object, Tree
from aoro_gym.terrains.world.species import SPECIES

Array = NDArray[np.float64]

FILLED = {"pine": 0.64, "spruce": 0.64, "birch": 0.53}
"""Share of a twig's triangle that is needles or leaves; see ``is_gap`` of the camera's surfaces."""
MOST_TWIGS = 2600
"""Of one crown; each is as large as it must be."""
LEAST_TWIG = 0.008
"""Least area [m²] of a twig's triangle."""


class Habit(NamedTuple):
    """How a species grows."""

    whorl: float
    """Distance [m] of branches that begin at one height."""
    branches: int
    """Of them."""
    lowest_deg: float
    """Elevation of the lowest living branch; dead ones hang lower."""
    highest_deg: float
    droop: float
    """By which the tip hangs, as a share of the branch's length."""
    bare: float
    """Share of a branch, from the stem, without twigs."""
    width: float
    """Half width of a twig over its length."""
    spread_deg: float
    """Between a twig and its branch."""
    dead: int
    """Dead branches below the crown."""


HABITS = {
    "pine": Habit(0.45, 4, 5.0, 50.0, 0.0, 0.45, 0.42, 35.0, 14),
    "spruce": Habit(0.30, 5, -18.0, 35.0, 0.12, 0.1, 0.3, 45.0, 26),
    "birch": Habit(0.30, 2, 25.0, 60.0, 0.25, 0.25, 0.45, 60.0, 4),
}


def fine_mesh(thing: Object, *, leaves: bool = True) -> Mesh:
    """Triangles of an object, as of :func:`~aoro_gym.terrains.world.meshes.mesh`; a crown is branches and twigs."""
    if not isinstance(thing, Tree):
        return mesh(thing)
    stem = mesh(thing, needles=False)
    return joined([stem, placed(crown(thing, leaves=leaves or thing.species != "birch"), thing)])


def crown(tree: Tree, *, leaves: bool = True) -> Mesh:
    """Branches and twigs in the tree's own axes; the twigs' area, gaps taken off, is that of ``foliage``."""
    habit = HABITS[tree.species]
    rng = np.random.default_rng(tree.shape)
    start, bend, tip = _branches(tree, habit, rng)
    dead = _dead_branches(tree, habit, rng)
    radius = 0.006 + 0.011 * np.linalg.norm(tip - start, axis=1)
    bark = Surface.PINE_BARK_UPPER if tree.species == "pine" else BARKS[tree.species]
    if tree.species == "birch":
        bark = Surface.DEAD_WOOD  # thin branches are dark
    parts = [_tapers(start, bend, tip, radius, bark)]
    if len(dead[0]):
        parts.append(_tapers(*dead, np.full(len(dead[0]), 0.007), bark))
    if leaves:
        parts.append(_twigs(tree, habit, rng, start, bend, tip))
    return joined(parts)


def _branches(tree: Tree, habit: Habit, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Beginnings, bends and tips (B, 3) [m] of the living branches."""
    length = tree.height - tree.crown_base
    whorls = max(int(length / habit.whorl), 3)
    share = np.repeat((np.arange(whorls) + 0.5) / whorls, habit.branches)
    share = np.clip(share + rng.normal(0.0, 0.25 / whorls, len(share)), 0.0, 0.985)
    turn = np.tile(2.0 * np.pi * np.arange(habit.branches) / habit.branches, whorls) + np.repeat(
        rng.uniform(0.0, 2.0 * np.pi, whorls), habit.branches
    )
    turn += rng.normal(0.0, 0.3, len(turn))
    reach = tree.crown_radius * crown_profile(tree.species, share) * rng.uniform(0.65, 1.1, len(share))
    reach = np.maximum(reach, 0.12)
    up = np.radians(
        habit.lowest_deg + share * (habit.highest_deg - habit.lowest_deg) + rng.normal(0.0, 7.0, len(share))
    )
    outward = np.stack([np.cos(turn), np.sin(turn), np.zeros(len(turn))], axis=1)
    rise = np.minimum(np.tan(up), 1.7) * reach
    height = tree.crown_base + share * length
    foot = np.maximum(height - np.maximum(rise, 0.0), 0.6 * tree.crown_base)  # so that tips fill the crown's outline
    start = np.stack([0.0 * foot, 0.0 * foot, foot], axis=1)
    tip = start + outward * reach[:, None]
    tip[:, 2] += rise
    bend = start + 0.55 * (tip - start) + rng.normal(0.0, 0.04, tip.shape) * reach[:, None]
    tip[:, 2] -= habit.droop * reach
    return start, bend, tip


def _dead_branches(tree: Tree, habit: Habit, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """The same of those that died below the crown."""
    count = rng.poisson(habit.dead)
    height = tree.crown_base * np.sqrt(rng.uniform(0.04, 1.0, count))
    turn = rng.uniform(0.0, 2.0 * np.pi, count)
    reach = rng.uniform(0.15, 0.6, count) * tree.crown_radius
    start = np.stack([0.0 * height, 0.0 * height, height], axis=1)
    tip = start + np.stack([reach * np.cos(turn), reach * np.sin(turn), reach * rng.uniform(-0.5, 0.1, count)], axis=1)
    return start, 0.5 * (start + tip) + rng.normal(0.0, 0.03, tip.shape), tip


def _tapers(start: Array, bend: Array, tip: Array, radius: Array, bark: Surface) -> Mesh:
    """Three-sided wood from ``start`` over ``bend`` to a point at ``tip``: nine triangles each."""
    count = len(start)
    axis = (bend - start) / np.maximum(np.linalg.norm(bend - start, axis=1, keepdims=True), 1e-6)
    side = np.cross(axis, np.where(np.abs(axis[:, 2:]) > 0.9, [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(axis, side)
    angle = 2.0 * np.pi * np.arange(3) / 3.0
    ring = np.cos(angle)[:, None] * side[:, None] + np.sin(angle)[:, None] * other[:, None]  # (B, 3, 3)
    low = start[:, None] + radius[:, None, None] * ring
    middle = bend[:, None] + 0.6 * radius[:, None, None] * ring
    vertices = np.concatenate([low, middle, tip[:, None]], axis=1).reshape(-1, 3)
    k = np.arange(3)
    n = (k + 1) % 3
    pattern = np.concatenate(
        [
            np.stack([k, n, n + 3], axis=1),
            np.stack([k, n + 3, k + 3], axis=1),
            np.stack([k + 3, n + 3, np.full(3, 6)], axis=1),
        ]
    )
    faces = (7 * np.arange(count))[:, None, None] + pattern
    return Mesh(vertices, faces.reshape(-1, 3), np.full(9 * count, bark, dtype=np.uint8))


def _twigs(tree: Tree, habit: Habit, rng: np.random.Generator, start: Array, bend: Array, tip: Array) -> Mesh:
    """Triangles on the branches; the first corner is where a twig begins."""
    area = SPECIES[tree.species].foliage_area(tree.diameter, tree.height) / FILLED[tree.species]
    count = int(np.clip(area / LEAST_TWIG, 40, MOST_TWIGS))
    length = np.sqrt(area / count / habit.width)
    reach = np.linalg.norm(tip - start, axis=1)
    branch = rng.choice(len(start), size=count, p=reach / reach.sum())
    along = habit.bare + (1.0 - habit.bare) * np.sqrt(rng.random(count))
    a, b, c = start[branch], bend[branch], tip[branch]
    share = along[:, None]
    root = np.where(share < 0.55, a + share / 0.55 * (b - a), b + (share - 0.55) / 0.45 * (c - b))
    forward = (c - a) / np.maximum(reach[branch], 1e-6)[:, None]
    level = np.cross([0.0, 0.0, 1.0], forward)
    level /= np.maximum(np.linalg.norm(level, axis=1, keepdims=True), 1e-6)
    spread = np.radians(habit.spread_deg) * rng.choice([-1.0, 1.0], count) * rng.uniform(0.2, 1.3, count)
    way = np.cos(spread)[:, None] * forward + np.sin(spread)[:, None] * level
    way += rng.normal(0.0, 0.28, way.shape)
    if tree.species == "birch":
        way[:, 2] -= rng.uniform(0.2, 1.4, count)  # thin twigs hang
    if tree.species == "pine":
        way[:, 2] += rng.uniform(0.0, 0.7, count)
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    normal = rng.normal(0.0, 0.6, way.shape)
    normal[:, 2] += 0.9 if tree.species == "spruce" else 0.2
    across = np.cross(way, normal)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-6)
    size = length * np.sqrt(rng.uniform(0.5, 1.5, count))[:, None]
    far = root + size * way
    corners = np.stack([root, far - size * habit.width * across, far + size * habit.width * across], axis=1)
    surfaces = np.full(count, FOLIAGE[tree.species], dtype=np.uint8)
    return Mesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), surfaces)
