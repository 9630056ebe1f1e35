"""Worlds that a forwarder meets, by seed: trees, stumps, boulders, logs and branches on made or scanned ground.

Ground, road and trail with its ruts are those of :func:`~aoro_gym.terrains.generate.forest.forest`, whose own boulders,
stumps and trees are left out: here they are objects; strip roads get ruts, too. :func:`populate` puts objects on any
terrain, such as a scan's, whose ground it leaves as it is. Sizes, shapes and positions that are drawn here from numbers
without a source are estimated (E).

>>> made = world(7, size=(40.0, 40.0))
>>> made.counts["tree"] > 50, made.counts["log"] > 10
(True, True)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.checks import check_choice, check_range
from aoro_gym.terrains.generate.forest import ForestSettings, Zone, forest
from aoro_gym.terrains.generate.piles import lying, pile
from aoro_gym.terrains.generate.placing import Places, Site
from aoro_gym.terrains.generate.random_field import RandomField
from aoro_gym.terrains.generate.stand import STANDS, Stand, draw_species, draw_trees
from aoro_gym.terrains.generate.strip_roads import StripRoads
from aoro_gym.terrains.paths.path import Path
from aoro_gym.terrains.terrain import Terrain
from aoro_gym.terrains.world.materials import Surface
from aoro_gym.terrains.world.objects import Boulder, Branch, Log, Object, Stump, Tree, along, upright
from aoro_gym.terrains.world.species import SPECIES
from aoro_gym.terrains.world.world import Undergrowth, World, check_count, plan_area

Array = NDArray[Any]

ZONE_SURFACES = {
    Zone.FOREST: Surface.FOREST_FLOOR,
    Zone.ASPHALT: Surface.ASPHALT,
    Zone.GRAVEL: Surface.GRAVEL,
    Zone.GRASS: Surface.GRASS,
    Zone.WET: Surface.WET_SOIL,
}
"""What the zones of a made forest are covered with."""
STANDING_ZONES = (Surface.FOREST_FLOOR, Surface.WET_SOIL, Surface.LITTER, Surface.SNOW)
"""Ground that trees grow on."""
UNDERGROWTH_CELL = 1.0
"""Distance [m] of the undergrowth's nodes."""
UNDERGROWTH_HEIGHTS = (0.15, 0.55)
"""Least and most [m]: bilberry and heather are 0.1 m to 0.5 m high. (R)"""
UNDERGROWTH_AREA = 1.2
"""Area of leaves on an area of ground where it is densest. (E)"""


@dataclass(frozen=True)
class WorldSettings:
    """What stands on a hectare (10,000 m²) of ground that trees grow on, strip roads included; all numbers (E).

    Raises ``ValueError`` naming the field.
    """

    size: tuple[float, float] = (100.0, 100.0)
    """Of made ground along x and y [m]; of no effect on a scan."""
    stand: str = "mixed"
    """One of :data:`~aoro_gym.terrains.generate.stand.STANDS`."""
    stems: float | None = None
    """Trees; None: the stand's."""
    mean_diameter: float | None = None
    """At breast height [m]; None: the stand's."""
    stumps: float = 350.0
    """Of the last thinning."""
    boulders: float = 120.0
    """0.2 m to 1.1 m in half length."""
    fallen: float = 40.0
    """Dead stems on the ground."""
    piles: float = 6.0
    """Of logs, beside strip roads."""
    logs: int = 10
    """Of one pile."""
    branches: float = 400.0
    """Left by harvesting, half of them on strip roads."""
    strip_roads: float = 20.0
    """Distance [m] of the ways that a forwarder drives on; 0: none."""
    strip_road_width: float = 4.2
    """Without trees and boulders [m]."""
    rut_depth: float = 0.06
    """Of the strip roads' ruts in made ground [m], as of the trail's; of no effect on a scan. Finnish rules call a track
    damaged from 0.1 m on over a metre of mineral soil (Silva Fennica, article 10197)."""
    undergrowth: float = 0.5
    """Share of the forest floor that dwarf shrubs cover."""
    snow: bool = False
    """Whether snow lies, and birches are bare."""

    def __post_init__(self) -> None:
        check_choice("stand", self.stand, STANDS)
        bounds = {
            "stems": (0.0, 4000.0),
            "mean_diameter": (0.06, 0.4),
            "stumps": (0.0, 3000.0),
            "boulders": (0.0, 1000.0),
            "fallen": (0.0, 400.0),
            "piles": (0.0, 60.0),
            "logs": (1, 60),
            "branches": (0.0, 10_000.0),
            "strip_roads": (0.0, 200.0),
            "strip_road_width": (2.0, 8.0),
            "rut_depth": (0.0, 0.3),
            "undergrowth": (0.0, 1.0),
        }
        for name, (low, high) in bounds.items():
            value = getattr(self, name)
            if value is not None:
                check_range(name, value, ge=low, le=high)


def world(
    seed: int = 0, settings: WorldSettings | None = None, *, ground: ForestSettings | None = None, **changes: Any
) -> World:
    """A random world; the same for the same seed and settings.

    Args:
        seed: Of numpy's generators.
        settings: :class:`WorldSettings`.
        ground: Of the ground; its size, boulders, stumps and trees are of no effect.
        changes: Fields of the settings.

    Raises ``ValueError`` naming the field, its bound and the fix.
    """
    chosen = _changed(settings, changes)
    made = forest(seed, ground or ForestSettings(), size=chosen.size, boulders=0.0, stumps=0.0, trees=0.0)
    surfaces = np.array([ZONE_SURFACES[zone] for zone in Zone], dtype=np.uint8)[made.zones]
    low, high = made.terrain.extent
    roads = _strip_roads(int(np.argmin((high - low)[:2])), seed, chosen)
    vertices = made.terrain.vertices.copy()
    driven = np.isin(surfaces, STANDING_ZONES)  # not on the road, the trail and the meadow
    vertices[driven, 2] -= roads.rut_depth(vertices[driven, :2], chosen.rut_depth)
    return populate(replace(made.terrain, vertices=vertices), seed, chosen, clear=made.ways, surfaces=surfaces)


def populate(
    terrain: Terrain,
    seed: int = 0,
    settings: WorldSettings | None = None,
    *,
    clear: Sequence[tuple[Path, float]] = (),
    surfaces: NDArray[np.uint8] | None = None,
    **changes: Any,
) -> World:
    """A world on a terrain, such as a scan's; the same for the same terrain, seed and settings.

    Args:
        terrain: The ground.
        seed: Of numpy's generators.
        settings: :class:`WorldSettings`.
        clear: Paths, and the distance [m] from each within which nothing stands.
        surfaces: (V,) :class:`~aoro_gym.terrains.world.materials.Surface` of each vertex, of which trees grow on forest
            floor, litter, wet soil and snow; None: forest floor.
        changes: Fields of the settings.

    Raises ``ValueError`` naming the field, its bound and the fix.
    """
    chosen = _changed(settings, changes)
    if surfaces is None:
        surfaces = np.full(len(terrain.vertices), Surface.FOREST_FLOOR, dtype=np.uint8)
    if np.shape(surfaces) != (len(terrain.vertices),):
        raise ValueError(
            f"surfaces has the shape {np.shape(surfaces)}, but must have ({len(terrain.vertices)},), one for each vertex"
        )
    most = {**_numbers(chosen), "piles": chosen.piles * chosen.logs}
    check_count(round(sum(most.values()) * plan_area(terrain) / 1e4), "the world asked for")
    site = Site(terrain, np.isin(surfaces, STANDING_ZONES), clear)
    objects, undergrowth = _Populating(site, seed, chosen).everything()
    ground = np.asarray(surfaces, dtype=np.uint8)[terrain.faces[:, 0]]
    if chosen.snow:
        ground = np.full(len(ground), Surface.SNOW, dtype=np.uint8)
    return World(terrain, objects, ground, undergrowth, not chosen.snow, f"{terrain.name}: {STANDS[chosen.stand].text}")


def _changed(settings: WorldSettings | None, changes: dict[str, Any]) -> WorldSettings:
    unknown = set(changes) - {field.name for field in fields(WorldSettings)}
    if unknown:
        known = ", ".join(field.name for field in fields(WorldSettings))
        raise ValueError(f"world has no {', '.join(sorted(unknown))}; choose one of: {known}")
    return replace(settings or WorldSettings(), **changes)


def _strip_roads(axis: int, seed: int, settings: WorldSettings) -> StripRoads:
    """They follow each other along an ``axis``, shifted at random."""
    offset = float(np.random.default_rng(seed).spawn(1)[0].random())
    return StripRoads(axis, settings.strip_roads, settings.strip_road_width, offset)


def _numbers(settings: WorldSettings) -> dict[str, float]:
    """Objects a hectare, piles as one each."""
    stems = STANDS[settings.stand].stems if settings.stems is None else settings.stems
    rest = ("stumps", "boulders", "fallen", "branches", "piles")
    return {"trees": stems, **{name: getattr(settings, name) for name in rest}}


class _Populating:
    """Places one kind after the other, each from its own stream, largest first."""

    def __init__(self, site: Site, seed: int, settings: WorldSettings):
        names = ("strips", "piles", "boulders", "fallen", "stumps", "trees", "branches", "undergrowth")
        self.streams = dict(zip(names, np.random.default_rng(seed).spawn(len(names)), strict=True))
        self.site, self.settings = site, settings
        self.stand: Stand = STANDS[settings.stand]
        self.mean = self.stand.mean_diameter if settings.mean_diameter is None else settings.mean_diameter
        self.places = Places(site)
        self.roads = _strip_roads(site.short_side, seed, settings)

    def everything(self) -> tuple[tuple[Object, ...], Undergrowth]:
        hectares = self.site.hectares
        counts = {name: round(number * hectares) for name, number in _numbers(self.settings).items()}
        piles = self._piles(counts["piles"])
        boulders = self._boulders(counts["boulders"])
        fallen = self._fallen(counts["fallen"])
        stumps = self._stumps(counts["stumps"])
        trees = self._trees(counts["trees"])
        branches = self._branches(counts["branches"])
        return (*trees, *stumps, *boulders, *fallen, *piles, *branches), self._undergrowth()

    def _off_strip(self, points: Array, room: Array | float = 0.0) -> NDArray[np.bool_]:
        """Whether points (N, 2) lie farther than ``room`` [m] beside the strip roads."""
        return self.roads.distance(points) > 0.5 * self.roads.width + room

    def _trees(self, count: int) -> list[Object]:
        rng = self.streams["trees"]
        drawn = draw_trees(self.stand, self.mean, count, rng)
        radii = np.array([0.5 * tree.diameter for tree in drawn])
        found: list[Object] = []
        for i, (x, y, z) in self.places.scatter(rng, radii, 1.2, self._off_strip):
            tree = drawn[i]
            turn = upright(tree.lean, tree.towards)
            found.append(
                Tree(
                    (x, y, z),
                    turn,
                    tree.species,
                    tree.diameter,
                    tree.height,
                    tree.crown_base,
                    tree.crown_radius,
                    tree.shape,
                )
            )
        return found

    def _stumps(self, count: int) -> list[Object]:
        rng = self.streams["stumps"]
        trees = draw_trees(self.stand, 0.85 * self.mean, count, rng)  # thinnings take the thinner ones
        radii = np.array([0.6 * tree.diameter for tree in trees])  # the stump is wider than the stem at breast height
        heights = 0.1 + 0.25 * rng.random(count) ** 2
        return [
            Stump(place, upright(), trees[i].species, float(radii[i]), float(heights[i]))
            for i, place in self.places.scatter(rng, radii, 0.4, None)
        ]

    def _boulders(self, count: int) -> list[Object]:
        rng = self.streams["boulders"]
        longest = 0.2 + 0.9 * rng.random(count) ** 2.5
        flat, buried = rng.uniform(0.55, 0.95, (count, 2)), rng.uniform(0.15, 0.5, count)
        turns, shapes = rng.uniform(0.0, 2.0 * np.pi, (count, 2)), rng.integers(0, 2**32, count)
        found: list[Object] = []
        for i, (x, y, z) in self.places.scatter(rng, longest, 0.3, self._off_strip):
            long, (wide, high) = float(longest[i]), (float(longest[i] * share) for share in flat[i])
            above = 2.0 * high * (1.0 - float(buried[i]))
            rotation = upright(0.0, 0.0, float(turns[i, 0]))
            found.append(Boulder((x, y, z + above - high), rotation, (long, wide, high), above, int(shapes[i])))
        return found

    def _fallen(self, count: int) -> list[Object]:
        rng = self.streams["fallen"]
        trees = draw_trees(self.stand, self.mean, count, rng)
        headings = rng.uniform(0.0, 2.0 * np.pi, count)
        lengths = np.array([tree.height for tree in trees]) * rng.uniform(0.4, 0.9, count)
        found: list[Object] = []
        for i, start in self.places.scatter_lines(
            rng, lengths, headings, [0.5 * t.diameter for t in trees], self._off_strip
        ):
            tree, length = trees[i], float(lengths[i])
            radius = 0.55 * tree.diameter
            top = max(0.5 * float(_stem(tree, 0.2 + length)), 0.015)
            position, direction, above = lying(self.site, start, float(headings[i]), length, (radius, top))
            found.append(Log(position, along(direction), tree.species, length, radius, top, above, 0))
        return found

    def _piles(self, count: int) -> list[Object]:
        rng = self.streams["piles"]
        heading = 0.0 if self.site.short_side == 0 else 0.5 * np.pi  # logs lie across the strip roads

        def beside(points: Array, room: Array | float) -> NDArray[np.bool_]:
            apart = self.roads.distance(points)
            return self._off_strip(points, 2.0) & ((apart < 8.0) | np.isinf(apart))

        found: list[Object] = []
        for number, (_, place) in enumerate(self.places.scatter(rng, np.full(count, 3.2), 0.5, beside), start=1):
            found += pile(self.site, place, heading, number, self._bolts(rng))
        return found

    def _bolts(self, rng: np.random.Generator) -> list[tuple[str, float, float, float]]:
        """Species, length and radii [m] of a pile's logs: saw logs or pulpwood, cut from stems of the stand."""
        saw = rng.random() < 0.5
        length = float(rng.choice([4.3, 4.9, 5.5])) if saw else float(rng.choice([3.0, 4.0]))
        logs = []
        for tree in draw_trees(self.stand, (1.5 if saw else 1.0) * self.mean, self.settings.logs, rng):
            tree = tree._replace(diameter=max(tree.diameter, 0.16 if saw else 0.1), height=max(tree.height, 10.0))
            low = 0.3 if saw or rng.random() < 0.5 else 0.25 * tree.height
            radii = (max(0.5 * float(_stem(tree, at)), 0.03) for at in (low, low + length))
            logs.append((tree.species, length, *radii))
        return sorted(logs, key=lambda log: -log[2])

    def _branches(self, count: int) -> list[Object]:
        rng = self.streams["branches"]
        species = draw_species(self.stand, count, rng)
        lengths, headings = rng.uniform(0.6, 2.8, count), rng.uniform(0.0, 2.0 * np.pi, count)
        on_strip = np.arange(count) % 2 == 0
        found: list[Object] = []
        for i, start in self.places.loose(rng, count, lambda at: ~self._off_strip(at), on_strip):
            length = float(lengths[i])
            radius = 0.004 + 0.006 * length
            position, direction, _ = lying(self.site, start, float(headings[i]), length, (radius, 0.3 * radius))
            found.append(Branch(position, along(direction), species[i], length, radius))
        return found

    def _undergrowth(self) -> Undergrowth:
        rng = self.streams["undergrowth"]
        low, high = self.site.low, self.site.high
        x, y = (np.arange(low[k], high[k] + 0.5 * UNDERGROWTH_CELL, UNDERGROWTH_CELL) for k in (0, 1))
        patches, tall = (RandomField(rng, 40, 3.0, 25.0).grid(x, y) for _ in range(2))
        limit = np.quantile(patches, 1.0 - self.settings.undergrowth) if self.settings.undergrowth else np.inf
        cover = np.clip(0.5 + 1.5 * (patches - limit), 0.0, 1.0) * (patches > limit)
        nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        cover = cover * self.site.free(nodes).reshape(cover.shape)
        shortest, tallest = UNDERGROWTH_HEIGHTS
        height = np.where(cover > 0.0, shortest + (tallest - shortest) * np.clip(0.5 + 0.35 * tall, 0.0, 1.0), 0.0)
        density = np.where(cover > 0.0, cover * UNDERGROWTH_AREA / np.maximum(height, shortest), 0.0)
        corner = (float(x[0]), float(y[0]))
        return Undergrowth(corner, UNDERGROWTH_CELL, height.astype(np.float32), density.astype(np.float32))


def _stem(tree: Any, at: float) -> Array:
    """Diameter [m] of a drawn tree's stem ``at`` a height [m], 0 beyond its top."""
    return SPECIES[tree.species].stem_diameter(min(at, tree.height), tree.diameter, tree.height)
