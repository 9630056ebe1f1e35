"""Procedural forest ground: a road with ditches and banks, a trail with ruts, hummocks, boulders, stumps, wet hollows.

Everything is a function of seed and place, not of the grid that samples it: another ``cell`` shows the same ground
coarser or finer.

>>> from aoro_gym.terrains.generate.forest import PUBLISHED_SIZE, forest
>>> ground = forest(7, PUBLISHED_SIZE)
>>> len(ground.terrain.faces), [round(float(v)) for v in ground.terrain.extent[1][:2]]
(25536, [29, 52])
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import KDTree

from aoro_gym.checks import check_range
from aoro_gym.terrains.generate.random_field import RandomField
from aoro_gym.terrains.paths.path import Path
from aoro_gym.terrains.terrain import Terrain

Array = NDArray[Any]


class Zone(IntEnum):
    """What the ground is covered with."""

    FOREST = 0
    ASPHALT = 1
    GRAVEL = 2
    GRASS = 3
    WET = 4


class Cover(NamedTuple):
    """Multipliers against dry asphalt."""

    friction: float
    rolling_resistance: float


COVERS = {
    Zone.ASPHALT: Cover(1.0, 1.0),
    Zone.GRAVEL: Cover(0.75, 1.7),
    Zone.GRASS: Cover(0.7, 4.0),
    Zone.FOREST: Cover(0.65, 5.3),
    Zone.WET: Cover(0.4, 8.0),
}
"""By zone. Friction: estimated tire coefficients of 0.8 on asphalt, 0.6 on gravel, 0.55 on grass, 0.5 on the forest's
humus, 0.3 on wet ground. Rolling resistance: Carvill, Mechanical Engineer's Data Handbook (1993), pneumatic tires: asphalt
0.01 to 0.02, gravel 0.01 to 0.04, medium hard soil 0.08, whose means count here; grass 0.06 and wet 0.12 are estimates."""


@dataclass(frozen=True)
class ForestSettings:
    """What a forest has; lengths in m, numbers a hectare (10,000 m²), all (E). Raises ``ValueError`` naming the field."""

    size: tuple[float, float] = (57.0, 103.0)
    """Along x and y [m], in whole cells; the ground lies around the local origin."""
    cell: float = 0.25
    """Distance of neighbouring heights [m]."""
    tilt_deg: float = 2.0
    """Inclination of the whole, in a random direction."""
    relief: float = 1.1
    """Root mean square [m] of the hills, whose waves are 14 m to 90 m long."""
    roughness: float = 0.02
    """Root mean square [m] of the forest floor's waves, 0.8 m to 4 m long."""
    road_width: float = 4.0
    """Asphalt [m]; 0 for no road. A shoulder of gravel, ditches and banks follow on both sides."""
    ditch_depth: float = 0.45
    """Below the road's edge [m]."""
    trail: bool = True
    """Whether a grassed trail with ruts leaves the road into the forest and comes back."""
    rut_depth: float = 0.06
    """Of the trail's two ruts [m]."""
    meadow: bool = True
    """Whether there is a clearing of grass across the road from the trail."""
    wet_share: float = 0.06
    """Share of the ground that is wet, in the hollows."""
    hummocks: float = 500.0
    """Rounded, 0.1 m to 0.35 m high."""
    boulders: float = 120.0
    """0.3 m to 0.9 m high."""
    stumps: float = 220.0
    """0.15 m to 0.45 m high."""
    trees: float = 350.0
    """Not part of the triangles: a path has to keep clear of them, and a scan sees them."""

    def __post_init__(self) -> None:
        bounds = {
            "cell": (0.05, 2.0),
            "tilt_deg": (0.0, 20.0),
            "relief": (0.0, 5.0),
            "roughness": (0.0, 0.2),
            "road_width": (0.0, 8.0),
            "ditch_depth": (0.0, 1.5),
            "rut_depth": (0.0, 0.3),
            "wet_share": (0.0, 0.5),
            "hummocks": (0.0, 3000.0),
            "boulders": (0.0, 1000.0),
            "stumps": (0.0, 2000.0),
            "trees": (0.0, 2500.0),
        }
        for name, (low, high) in bounds.items():
            check_range(name, getattr(self, name), ge=low, le=high)
        if len(self.size) != 2:
            raise ValueError(f"size is {self.size} m, but must be two sides")
        check_range("size", self.size, "m", ge=30.0, le=500.0)


PUBLISHED_SIZE = ForestSettings(cell=0.679)
"""As large and as coarse as the published scan of a test track: 57 m x 103 m, about 25,600 triangles."""


class Obstacle(NamedTuple):
    """Something that stands on the ground."""

    kind: str
    """``boulder``, ``stump`` or ``tree``; trees are not part of the terrain's triangles."""
    x: float
    y: float
    radius: float
    """At the ground [m]."""
    height: float
    """Above the ground [m]."""


@dataclass(frozen=True, eq=False)
class Forest:
    """A generated ground, and what is known of it."""

    terrain: Terrain
    zones: NDArray[np.int8]
    """(V,) the :class:`Zone` of each of the terrain's vertices."""
    obstacles: tuple[Obstacle, ...]
    road: Path | None
    """The middle of the road, from edge to edge."""
    trail: Path | None
    """The middle of the trail."""
    settings: ForestSettings
    seed: int

    @property
    def ways(self) -> list[tuple[Path, float]]:
        """Trail and road, and the distance [m] from their middles within which nothing stands."""
        return _ways(self.settings, self.trail, self.road)

    def circles(self, *kinds: str) -> Array:
        """(K, 3) x, y, radius [m] of the obstacles of ``kinds``; of all without."""
        chosen = [(o.x, o.y, o.radius) for o in self.obstacles if not kinds or o.kind in kinds]
        return np.array(chosen, dtype=np.float64).reshape(-1, 3)

    @property
    def trees(self) -> Array:
        """(K, 4) x, y, radius and height [m] of the trees."""
        return np.array([o[1:] for o in self.obstacles if o.kind == "tree"], dtype=np.float64).reshape(-1, 4)


def forest(seed: int = 0, settings: ForestSettings | None = None, **changes: Any) -> Forest:
    """A random forest; the same for the same seed and settings, up to rounding on every platform.

    Args:
        seed: Of numpy's generators.
        settings: :class:`ForestSettings`.
        changes: Fields of the settings.

    Raises ``ValueError`` naming the field, its bound and the fix.
    """
    unknown = set(changes) - {field.name for field in fields(ForestSettings)}
    if unknown:
        known = ", ".join(field.name for field in fields(ForestSettings))
        raise ValueError(f"forest has no {', '.join(sorted(unknown))}; choose one of: {known}")
    chosen = replace(settings or ForestSettings(), **changes)
    return _ForestBuilder(seed, chosen).forest()


SHOULDER = 0.75
"""Width [m] of the gravel beside the asphalt."""
CROWN, SHOULDER_FALL = 0.025, 0.05
"""Fall [-] of the asphalt and of its shoulders to either side."""
DITCH_INNER, DITCH_BOTTOM, DITCH_OUTER = 3.0, 0.4, 2.0
"""Run over rise of the ditch's sides, and the width [m] between them."""
BANK = 1.0 / 1.75
"""Steepest rise or fall [-] from the ditch's outer edge to the natural ground."""
CROSSING = 5.0
"""Half the length [m] along the road over which a ditch is filled where the trail or the meadow is reached."""
TIGHTEST_BEND = 20.0
"""Of the road [m]."""
TIGHTEST_TRAIL = 8.0
"""Bend of the trail [m]."""
TRAIL_HALF = 1.7
"""Half the width [m] of the trail, where nothing stands."""
RUT_APART, RUT_WIDTH = 1.97, 0.5
"""Of the trail's ruts [m]: the track and the width of the machine's tires."""


class _ForestBuilder:
    """Builds one forest. Each part draws from its own stream, so that settings of one leave the others in place."""

    def __init__(self, seed: int, settings: ForestSettings):
        self.seed, self.settings = seed, settings
        names: list[str] = ["relief", "floor", "road", "meadow", "hummocks", "boulders", "stumps", "trees"]
        self.streams: dict[str, np.random.Generator] = dict(
            zip(names, np.random.default_rng(seed).spawn(len(names)), strict=True)
        )
        columns, rows = (round(side / settings.cell) + 1 for side in settings.size)
        self.x = settings.cell * (np.arange(columns) - 0.5 * (columns - 1))
        self.y = settings.cell * (np.arange(rows) - 0.5 * (rows - 1))
        self.nodes = np.stack(np.meshgrid(self.x, self.y), axis=-1).reshape(-1, 2)

        rng = self.streams["relief"]
        self.hills = RandomField(rng, 60, 14.0, 90.0)
        direction = rng.uniform(0.0, 2.0 * np.pi)
        self.fall = np.tan(np.radians(settings.tilt_deg)) * np.array([np.cos(direction), np.sin(direction)])
        self.road = self._road() if settings.road_width > 0.0 else None
        self.side = 1.0 if self.streams["road"].random() < 0.5 else -1.0
        """Left or right of the road, where the trail is."""
        self.trail = self._trail() if settings.trail else None
        self.meadow_edge = RandomField(self.streams["meadow"], 12, 8.0, 30.0)

    def forest(self) -> Forest:
        rows, columns = len(self.y), len(self.x)
        settings = self.settings
        z = settings.relief * self.hills.grid(self.x, self.y).ravel() + self.nodes @ self.fall
        natural = z
        wild = np.ones(len(z))  # where the forest floor is left as it is
        zones = np.full(len(z), Zone.FOREST, dtype=np.int8)
        zones[natural - self._mean(natural) < np.quantile(natural - self._mean(natural), settings.wet_share)] = Zone.WET
        clearing = self._meadow(self.nodes)
        wild *= 1.0 - 0.85 * clearing
        zones[clearing > 0.5] = Zone.GRASS
        if self.trail is not None:
            s, offset = _path_coordinates(self.trail, self.nodes, 12.0)
            strip = 1.0 - _smoothstep(np.abs(offset), TRAIL_HALF, TRAIL_HALF + 2.0)
            z = z + strip * (np.interp(s, self.trail.stations, self._profile(self.trail, 4.0)) - z)
            ruts = np.exp(-(((np.abs(offset) - 0.5 * RUT_APART) / (0.6 * RUT_WIDTH)) ** 2))
            z = z - settings.rut_depth * ruts
            wild *= 1.0 - strip
            zones[np.abs(offset) < TRAIL_HALF + 0.3] = Zone.GRASS
        if self.road is not None:
            z, wild, zones = self._with_road(z, wild, zones)
        floor = RandomField(self.streams["floor"], 160, 0.8, 4.0).grid(self.x, self.y).ravel()
        z = z + settings.roughness * wild * floor
        z = z + wild * self._hummocks()
        obstacles: list[Obstacle] = []
        for kind in ("boulder", "stump", "tree"):
            found = self._standing(kind, obstacles)
            obstacles += found
            if kind != "tree":
                z = z + self._shapes(found)
        covers = np.array([COVERS[zone] for zone in Zone])[zones]
        terrain = Terrain.from_heights(
            z.reshape(rows, columns),
            cell=settings.cell,
            corner=(float(self.x[0]), float(self.y[0])),
            friction=covers[:, 0].reshape(rows, columns),
            rolling_resistance=covers[:, 1].reshape(rows, columns),
            name=f"forest, seed {self.seed}",
        )
        return Forest(terrain, zones, tuple(obstacles), self._inside(self.road), self.trail, settings, self.seed)

    def _mean(self, z: Array) -> Array:
        """The ground without its hollows: its tilt, which wetness does not follow."""
        plane = np.column_stack([self.nodes, np.ones(len(z))])
        return plane @ np.linalg.lstsq(plane, z, rcond=None)[0]

    def _natural(self, points: Array) -> Array:
        return self.settings.relief * self.hills.at(points) + points @ self.fall

    def _profile(self, path: Path, smoothing: float) -> Array:
        """(P,) heights of the natural ground along the path, levelled over ``smoothing`` [m]."""
        step = path.length / path.num_segments
        return gaussian_filter1d(self._natural(path.points), smoothing / step, mode="nearest")

    def _to_plan(self, along: Array, across: Array) -> Array:
        """Points from coordinates along the longer side and, to its left, across."""
        width, depth = self.settings.size
        return np.stack([-across, along] if depth >= width else [along, across], axis=-1)

    def _road(self) -> Path:
        rng = self.streams["road"]
        short, long = sorted(self.settings.size)
        along = np.linspace(-0.5 * long - 15.0, 0.5 * long + 15.0, 400)
        lengths = long * rng.uniform([0.45, 0.9], [0.7, 1.6])
        across = sum(length**2 * np.sin(2.0 * np.pi * along / length + rng.uniform(0, 2 * np.pi)) for length in lengths)
        across = across - np.mean(across)
        bend = np.abs(np.gradient(np.gradient(across, along), along)).max()
        room = max(0.5 * short - 16.0, 0.05 * short)
        across = across * min(1.0 / (TIGHTEST_BEND * bend), room / np.abs(across).max())
        return Path(self._to_plan(along, across), name="road").resample(0.5)

    def _trail(self) -> Path:
        """From the road into the forest and back to it; without a road, a winding way along the longer side."""
        rng = self.streams["road"]
        short, long = sorted(self.settings.size)
        if self.road is None:
            along = np.linspace(-0.5 * long, 0.5 * long, 7)
            across = 0.15 * short * rng.uniform(-1.0, 1.0, 7)
            return Path.spline(self._to_plan(along, across), spacing=0.5, name="trail")
        out, wobble = rng.uniform(0.85, 1.0), rng.uniform(-1.0, 1.0, 7)
        trail = self._loop(0.36 * long, out, wobble)
        for share in (0.85, 0.7, 0.55, 0.4):  # less far out until its bends can be driven
            if np.abs(trail.curvatures).max() <= 1.0 / TIGHTEST_TRAIL:
                break
            trail = self._loop((0.5 - 0.14 * share) * long, share * out, share * wobble)
        return trail

    def _loop(self, reach: float, out: float, wobble: Array) -> Path:
        """From ``reach`` [m] before the road's middle to as far behind it, ``out`` of the way to the ground's edge."""
        assert self.road is not None
        short, _ = sorted(self.settings.size)
        s = self.road.length / 2.0 + reach * np.array([-1.0, -0.86, -0.45, 0.0, 0.45, 0.86, 1.0]) + wobble
        outward = np.array([0.0, 0.04, 0.75, 1.0, 0.75, 0.04, 0.0])
        here, heading = self.road.position(s), self.road.heading(s)
        left = np.stack([-np.sin(heading), np.cos(heading)], axis=1)
        # how far away the road's side of the ground ends, along the short side
        across = self._to_plan(np.zeros(7), np.ones(7))
        far = 0.5 * short - 6.0 - self.side * np.sum(here * across, axis=1)
        edge = self.side * (outward * np.maximum(out * far, 7.0))[:, None]
        blend = outward[:, None]
        rough = Path.spline(here + edge * (blend * across + (1.0 - blend) * left), spacing=0.5)
        return replace(rough.smooth(16.0, spacing=0.5), name="trail")

    def _crossings(self) -> list[tuple[float, float]]:
        """Station on the road and side (±1) where its ditch is filled."""
        assert self.road is not None
        found = []
        if self.trail is not None:
            s, offset = self.road.project(self.trail.points)
            edge = np.abs(offset) - _ditch_middle(self.settings)
            for i in np.flatnonzero(edge[1:] * edge[:-1] < 0.0):
                found.append((float(s[i]), self.side))
        if self.settings.meadow:
            found.append((float(self.road.project(self._meadow_middle())[0]), -self.side))
        return found

    def _with_road(self, z: Array, wild: Array, zones: NDArray[np.int8]) -> tuple[Array, Array, NDArray[np.int8]]:
        """Road, shoulders, ditches and banks cut into or filled onto the ground."""
        assert self.road is not None
        settings, half = self.settings, 0.5 * self.settings.road_width
        s, offset = _path_coordinates(self.road, self.nodes, np.inf)
        apart = np.abs(offset)
        depth = np.ones(len(z))
        for station, side in self._crossings():
            near = 1.0 - _smoothstep(np.abs(s - station), 0.6 * CROSSING, 1.4 * CROSSING)
            depth = np.where(offset * side > 0.0, np.minimum(depth, 1.0 - near), depth)
        edge = half + SHOULDER
        bottom = edge + DITCH_INNER * settings.ditch_depth
        outer = bottom + DITCH_BOTTOM + DITCH_OUTER * settings.ditch_depth
        knots = [0.0, half, edge, bottom, bottom + DITCH_BOTTOM, outer]
        table = -CROWN * half - SHOULDER_FALL * SHOULDER
        fine = np.arange(0.0, outer + 2.0, 0.02)
        bed = _rounded(np.interp(fine, knots[:3], [0.0, -CROWN * half, table]))
        ditch = _rounded(np.interp(fine, knots[2:], [0.0, -1.0, -1.0, 0.0]))
        level = np.interp(s, self.road.stations, self._profile(self.road, 9.0))
        road = level + np.interp(apart, fine, bed) + settings.ditch_depth * depth * np.interp(apart, fine, ditch)
        # from the outer edge the bank rises or falls to the natural ground
        run = BANK * np.maximum(apart - outer, 0.0)
        ground = _soft_min(_soft_max(z, road - run), road + run)
        beside = _smoothstep(apart, outer - 0.8, outer + 0.4)
        z = road + beside * (ground - road)
        wild = wild * _smoothstep(apart, outer, outer + 2.5)
        zones = zones.copy()
        verge = outer + 0.6 + 0.4 * np.sin(0.9 * s) * np.sin(0.23 * s + 1.0)
        zones[(apart < verge) & (zones != Zone.GRASS)] = Zone.GRASS
        wet = (apart > bottom - 0.15) & (apart < bottom + DITCH_BOTTOM + 0.15) & (depth > 0.7)
        zones[wet & (settings.ditch_depth > 0.2)] = Zone.WET
        zones[apart < edge] = Zone.GRAVEL
        zones[(depth < 0.5) & (apart < outer) & (apart >= edge)] = Zone.GRAVEL
        zones[apart < half] = Zone.ASPHALT
        return z, wild, zones

    def _meadow_middle(self) -> Array:
        short, long = sorted(self.settings.size)
        along = 0.18 * long * (1.0 if self.side > 0.0 else -1.0)
        if self.road is None:
            return self._to_plan(np.array(along), np.array(-self.side * 0.25 * short))
        s = self.road.length / 2.0 + along
        heading = self.road.heading(s)
        left = np.array([-np.sin(heading), np.cos(heading)])
        return self.road.position(s) - self.side * 0.28 * short * left

    def _meadow(self, points: Array) -> Array:
        """(K,) 1 in the clearing, 0 in the forest."""
        if not self.settings.meadow:
            return np.zeros(len(points))
        short, long = sorted(self.settings.size)
        from_middle = points - self._meadow_middle()
        axes = self._to_plan(np.array(0.2 * long), np.array(0.28 * short))
        ring = np.hypot(*(from_middle / axes).T) + 0.12 * self.meadow_edge.at(points)
        return 1.0 - _smoothstep(ring, 0.85, 1.15)

    def _hummocks(self) -> Array:
        rng = self.streams["hummocks"]
        places = self._scattered(rng, self.settings.hummocks)
        radius, height = rng.uniform(0.6, 1.5, len(places)), rng.uniform(0.1, 0.35, len(places))
        z = np.zeros(len(self.nodes))
        for place, r, h in zip(places, radius, height, strict=True):
            part, near = self._window(place, 2.5 * r)
            z[part] += h * np.exp(-np.sum(near**2, axis=1) / r**2)
        return z

    def _standing(self, kind: str, before: list[Obstacle]) -> list[Obstacle]:
        """Boulders, stumps or trees, off the road, the trail and (mostly) the meadow, and apart from those before."""
        rng = self.streams[f"{kind}s"]
        places = self._scattered(rng, getattr(self.settings, f"{kind}s"))
        low, high = {"boulder": (0.4, 1.1), "stump": (0.14, 0.3), "tree": (0.08, 0.25)}[kind]
        radius = low + (high - low) * rng.random(len(places)) ** 2
        tall = rng.random(len(places))
        height = {"boulder": radius * (0.65 + 0.25 * tall), "stump": 0.15 + 0.3 * tall, "tree": radius * 80.0}[kind]
        keep = rng.random(len(places)) > self._meadow(places) * (0.8 if kind == "boulder" else 1.0)
        for path, room in _ways(self.settings, self.trail, self.road):
            if len(places):
                keep &= np.abs(path.project(places)[1]) > room + radius
        found: list[Obstacle] = []
        for i in np.flatnonzero(keep):
            x, y = places[i]
            apart = 1.5 if kind == "tree" else 0.3
            if all(np.hypot(o.x - x, o.y - y) > o.radius + radius[i] + apart for o in (*before, *found)):
                found.append(Obstacle(kind, float(x), float(y), float(radius[i]), float(height[i])))
        return found

    def _shapes(self, obstacles: list[Obstacle]) -> Array:
        """(V,) heights that boulders and stumps add."""
        z = np.zeros(len(self.nodes))
        for i, obstacle in enumerate(obstacles):
            part, near = self._window(np.array([obstacle.x, obstacle.y]), obstacle.radius + 1.0)
            apart, angle = np.hypot(*near.T), np.arctan2(near[:, 1], near[:, 0])
            if obstacle.kind == "boulder":
                # no boulder is round; the phases follow from its number
                lobes = 1.0 + 0.12 * np.sin(2.0 * angle + 2.4 * i) + 0.08 * np.sin(3.0 * angle + 1.7 * i)
                inside = np.clip(1.0 - (apart * lobes / obstacle.radius) ** 3, 0.0, None)
                shape = np.sqrt(inside)
            else:
                # upright sides over one cell, and roots around
                steep = max(0.05, 0.5 * self.settings.cell)
                side = np.clip((obstacle.radius + steep - apart) / (2.0 * steep), 0.0, 1.0)
                shape = np.maximum(side, 0.3 * np.exp(-np.maximum(apart - obstacle.radius, 0.0) / 0.2))
            z[part] = np.maximum(z[part], obstacle.height * shape)
        return z

    def _scattered(self, rng: np.random.Generator, per_hectare: float) -> Array:
        """(K, 2) places about evenly spread: one somewhere in each square of a lattice."""
        if per_hectare == 0.0:
            return np.empty((0, 2))
        side = 100.0 / np.sqrt(per_hectare)
        columns, rows = (max(round(size / side), 1) for size in self.settings.size)
        lattice = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
        share = (lattice + rng.random(lattice.shape)) / [columns, rows]
        return (share - 0.5) * self.settings.size

    def _window(self, place: Array, reach: float) -> tuple[NDArray[np.intp], Array]:
        """Indices of the nodes in the square around a place, and (K, 2) where they lie from it."""
        columns = np.flatnonzero(np.abs(self.x - place[0]) <= reach)
        rows = np.flatnonzero(np.abs(self.y - place[1]) <= reach)
        part = (rows[:, None] * len(self.x) + columns).ravel()
        return part, self.nodes[part] - place

    def _inside(self, path: Path | None) -> Path | None:
        if path is None:
            return None
        kept = np.all(np.abs(path.points) <= 0.5 * np.asarray(self.settings.size), axis=1)
        return Path(path.points[kept], name=path.name)


def _ditch_middle(settings: ForestSettings) -> float:
    """Distance [m] of the ditches from the road's middle."""
    return 0.5 * settings.road_width + SHOULDER + DITCH_INNER * settings.ditch_depth + 0.5 * DITCH_BOTTOM


def _ways(settings: ForestSettings, trail: Path | None, road: Path | None) -> list[tuple[Path, float]]:
    ways = ((trail, TRAIL_HALF + 0.4), (road, _ditch_middle(settings) + 1.5))
    return [(path, room) for path, room in ways if path is not None]


def _path_coordinates(path: Path, points: Array, reach: float) -> tuple[Array, Array]:
    """Station and cross-track offset [m] of (K, 2) points; beyond ``reach`` of the path only roughly."""
    apart, nearest = KDTree(path.points).query(points)
    s, offset = path.stations[nearest], np.asarray(apart, dtype=np.float64).copy()
    close = offset < reach
    s[close], offset[close] = path.project(points[close], s[close], reach=1.0)
    return s, offset


def _rounded(section: Array) -> Array:
    """A cross-section sampled every 0.02 m from the middle outward, its edges rounded as earth is."""
    return gaussian_filter1d(section, 0.18 / 0.02, mode="nearest")


def _smoothstep(value: Array, low: float, high: float) -> Array:
    """0 below ``low``, 1 above ``high``, smooth between."""
    share = np.clip((value - low) / (high - low), 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


def _soft_max(a: Array, b: Array, width: float = 0.25) -> Array:
    return 0.5 * (a + b + np.sqrt((a - b) ** 2 + width**2))


def _soft_min(a: Array, b: Array, width: float = 0.25) -> Array:
    return -_soft_max(-a, -b, width)
