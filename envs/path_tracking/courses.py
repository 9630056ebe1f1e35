"""Where a vehicle drives: a terrain with paths over it, and a small library of them that is made once a computer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cache
from pathlib import Path as Folder
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from aoro_gym import terrains
from aoro_gym.envs.core.randomisation import Draws
from aoro_gym.execution.array_api import HOST, Array, Arrays, namespace
from aoro_gym.execution.cache import cached, computed_with
from aoro_gym.execution.digest import digest
from aoro_gym.terrains import Path, Plane, Terrain
from aoro_gym.terrains.raster import CELL, surface
from aoro_gym.terrains.world.places import circles, stems
from aoro_gym.terrains.world.world import World

if TYPE_CHECKING:
    from aoro_gym.envs.core.ray_scenes import Ground


@dataclass(frozen=True, eq=False)
class Course:
    """A terrain and the paths that lead over it."""

    terrain: Terrain | Plane
    paths: tuple[Path, ...]
    name: str = "course"
    trees: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 4)))
    """(K, 4) x, y, radius and height [m] that pictures and rays show beside the ground; the machine does not feel them. In a
    world pictures show its trees."""
    world: World | None = None
    """The objects on ``terrain``, which is this world's: machines feel what is solid, rays meet all of it."""

    @classmethod
    def over(cls, ground: Terrain | Plane | World, paths: Sequence[Path], name: str = "course") -> Course:
        """A course over a ``ground`` that may be a world."""
        if isinstance(ground, World):
            return cls(ground.terrain, tuple(paths), name, world=ground)
        return cls(ground, tuple(paths), name)

    def __post_init__(self) -> None:
        object.__setattr__(self, "paths", tuple(self.paths))
        if isinstance(self.terrain, World):
            raise ValueError(f"course {self.name!r} has a world for its terrain; make it by Course.over(world, paths)")
        if not self.paths:
            raise ValueError(f"course {self.name!r} has no path; give at least one")
        for path in self.paths:
            if not isinstance(path, Path):
                raise ValueError(f"course {self.name!r} has {path!r} for a path; give aoro_gym.terrains.Path")
        if self.world is not None and self.world.terrain is not self.terrain:
            raise ValueError(f"course {self.name!r}: its world stands on another terrain; give terrain=world.terrain")
        if isinstance(self.terrain, Plane):
            for entry in fields(self.terrain):
                if np.ndim(getattr(self.terrain, entry.name)):
                    raise ValueError(
                        f"course {self.name!r}: the plane's {entry.name} is an array, but must be a number"
                    )
        if self.world is not None and not len(self.trees):
            object.__setattr__(self, "trees", stems(self.world))

    @property
    def ground(self) -> Terrain | Plane | World:
        """What the machine stands on."""
        return self.terrain if self.world is None else self.world

    @property
    def surroundings(self) -> Ground:
        """What rays meet."""
        if self.world is not None:
            return self.world
        return self.terrain if isinstance(self.terrain, Plane) else (self.terrain, self.trees)


class HeightMap:
    """Heights of several grounds, as the wheels feel them: rasters of the terrains, or one plane.

    Args:
        grounds: Terrains, or one plane without arrays.
        arrays: Where the heights live, and what is asked for.
    """

    def __init__(self, grounds: Sequence[Terrain | Plane], arrays: Arrays = HOST):
        self._arrays = arrays
        self._slope = arrays.zeros(2)  # of a plane
        # of each terrain: corner, lowest and highest place [m], last place between nodes [cells]; columns, first node
        extents, shapes, nodes = [], [], [np.zeros((0, 2), dtype=np.float32)]
        for ground in grounds:
            if isinstance(ground, Plane):
                normal = ground.normal
                self._slope = arrays.asarray(-normal[:2] / normal[2])
                continue
            raster = surface(ground, str(arrays.device))
            low, high = ground.extent
            rows, columns = raster.nodes.shape[:2]
            extents.append([*raster.corner, *low[:2], *high[:2], columns - 1.001, rows - 1.001])
            shapes.append([columns, sum(map(len, nodes))])
            nodes.append(raster.nodes[..., [0, 3]].reshape(-1, 2))
        self._level = not shapes
        self._extents, self._shapes = arrays.asarray(extents), arrays.asarray(shapes, arrays.xp.int64)
        heights, known = (HOST.asarray(column) for column in np.concatenate(nodes).T)
        self._heights, self._known = arrays.asarray(heights), arrays.asarray(known)
        self._on_host = HOST.asarray(extents), HOST.asarray(shapes, np.int64), known

    def height(self, ground: Array, xy: Array) -> Array:
        """Height [m] (...) at ``xy`` (..., 2) of the grounds whose numbers ``ground`` broadcasts against it."""
        if self._level:
            return self._slope[0] * xy[..., 0] + self._slope[1] * xy[..., 1]
        return self._between(self._heights, self._extents[ground], self._shapes[ground], xy)

    def known(self, ground: Array, xy: Array) -> Array:
        """Whether there is ground at ``xy`` (..., 2): within the extent, and not over a hole. On the host for arrays of the
        host."""
        xp = namespace(xy)
        if self._level:
            return xp.isfinite(xy[..., 0])
        extents, shapes, known = self._on_host if xp is np else (self._extents, self._shapes, self._known)
        extent = extents[ground]
        low, high = extent[..., 2:4], extent[..., 4:6]
        inside = xp.all((xy >= low) & (xy <= high), axis=-1)
        return inside & (self._between(known, extent, shapes[ground], xy) >= 0.5)

    def _between(self, nodes: Array, extent: Array, shape: Array, xy: Array) -> Array:
        """Values of the nodes of all rasters, bilinear between the nodes, at ``xy`` of those of ``extent`` and ``shape``."""
        xp = namespace(xy)
        columns = shape[..., 0]
        place = xp.clip(xp.minimum((xy - extent[..., :2]) / CELL, extent[..., 6:]), 0.0, None)
        before = xp.astype(place, xp.int64)
        share = place - before
        u, v = share[..., 0], share[..., 1]
        node = shape[..., 1] + before[..., 1] * columns + before[..., 0]
        south = (1.0 - u) * nodes[node] + u * nodes[node + 1]
        node = node + columns
        return (1.0 - v) * south + v * ((1.0 - u) * nodes[node] + u * nodes[node + 1])


def as_courses(
    courses: Sequence[Course] | None, terrain: Terrain | Plane | World | None, path: Path | None
) -> tuple[Course, ...]:
    """What an environment's arguments ask for: ``courses``, or one ``terrain`` with ``path`` or with generated ones.

    Raises ValueError if they contradict each other.
    """
    if courses is not None:
        if terrain is not None or path is not None:
            raise ValueError("courses is given, and terrain or path, too; put them into a Course of their own")
        courses = tuple(courses)
        if not courses:
            raise ValueError("courses is empty; give at least one Course")
        for course in courses:
            if not isinstance(course, Course):
                raise ValueError(f"courses holds {course!r}; give aoro_gym.envs.Course.over(ground, paths)")
        if len(courses) > 1 and any(isinstance(course.terrain, Plane) for course in courses):
            raise ValueError("courses holds a plane beside others; give one plane with all paths, or terrains")
        return courses
    if terrain is None:
        if path is None:
            return library()
        terrain = Plane()
    paths = (path,) if path is not None else generated_paths(terrain)
    return (Course.over(terrain, paths, name=getattr(terrain, "name", "plane")),)


def ground_of(courses: Sequence[Course]) -> Plane | list[Terrain | World]:
    """What a twin stands on to drive on ``courses``: the terrains and worlds of all of them, or their plane."""
    grounds = [course.ground for course in courses]
    terrains = [ground for ground in grounds if not isinstance(ground, Plane)]
    if terrains:
        return terrains
    assert isinstance(grounds[0], Plane)
    return grounds[0]


def drawn_by_difficulty(
    options: Mapping[str, Any], draws: Draws, where: NDArray[np.intp], num_envs: int, count: int
) -> Mapping[str, Any]:
    """``options`` of a reset, with a terrain for the sub-environments ``where`` by the difficulty that they drew, unless one
    is asked for.

    Args:
        options: Of the reset.
        draws: Of a randomisation with a ``difficulty``, the share [-] of the courses that are easier.
        where: Sub-environments (K,).
        num_envs: Number of all of them.
        count: Courses, from easy to difficult.
    """
    if options.get("terrain") is not None:
        return options
    chosen = np.zeros(num_envs, dtype=np.intp)
    chosen[where] = np.minimum((draws.task["difficulty"] * count).astype(np.intp), count - 1)
    return {**options, "terrain": chosen}


PATHS_KEPT = 16
"""Sets of generated paths that are remembered for one terrain."""
_generated: WeakKeyDictionary[Terrain | Plane | World, dict[tuple[int, float, int], tuple[Path, ...]]] = (
    WeakKeyDictionary()
)


def generated_paths(
    terrain: Terrain | Plane | World, count: int = 4, length: float = 60.0, first: int = 0
) -> tuple[Path, ...]:
    """Drivable paths over ``terrain``, always the same, of the seeds from ``first`` on; kept on disk, and remembered while
    the terrain lives. In a world they keep clear of all that is solid, that a machine could drive over, too.

    Raises ValueError if there is no room for them.
    """
    known = _generated.setdefault(terrain, {})
    key = (count, length, first)
    if key not in known:

        def make() -> tuple[Path, ...]:
            from aoro_gym.terrains.paths.planning import drivable_ground

            ground = drivable_ground(bare, obstacles=solid)
            return tuple(ground.path(seed, length=length) for seed in range(first, first + count))

        bare, solid = (terrain.terrain, circles(terrain)) if isinstance(terrain, World) else (terrain, None)
        shape = bare if isinstance(bare, Plane) else (bare.vertices, bare.faces)
        shape = shape if solid is None else (shape, solid)
        known[key] = cached("paths", (shape, key, _code()), make, _packed_paths, _unpacked_paths)
        if len(known) > PATHS_KEPT:
            del known[next(iter(known))]
    return known[key]


LIBRARY_SEEDS, LIBRARY_SIZE, LIBRARY_PATHS = (1, 2, 3), (60.0, 60.0), 4
"""Of :func:`library`: the forests' seeds, their size [m], and the paths over each, 60 m long."""


@cache
def library() -> tuple[Course, ...]:
    """The courses that an environment draws from by default: forests with drivable paths between the trees, made once on a
    computer and shared by all environments of a process."""
    return tuple(forest_course(seed, size=LIBRARY_SIZE, count=LIBRARY_PATHS) for seed in LIBRARY_SEEDS)


def forest_course(
    seed: int, *, size: tuple[float, float] = LIBRARY_SIZE, count: int = 4, length: float = 60.0
) -> Course:
    """A generated forest of ``size`` [m] with ``count`` drivable paths of ``length`` [m]; the same for the same seed, and
    kept on disk."""

    def make() -> Course:
        from aoro_gym.terrains.generate.forest import forest
        from aoro_gym.terrains.paths.planning import drivable_ground

        grown = forest(seed, size=size)
        ground = drivable_ground(grown.terrain, obstacles=grown.circles("tree"))
        paths = tuple(ground.path(number, length=length) for number in range(count))
        return Course(grown.terrain, paths, name=f"forest {seed}", trees=grown.trees)

    return cached("courses", (seed, size, count, length, _code()), make, _packed, _unpacked)


# ---- on disk ---------------------------------------------------------------------------------------------------------


@cache
def _code() -> str:
    """Digest of what a course depends on beside its arguments."""
    return digest(*computed_with(Folder(__file__).resolve(), Folder(terrains.__file__).parent))


def _packed(course: Course) -> dict[str, Any]:
    """Arrays that hold a course over triangles."""
    ground = course.terrain
    assert isinstance(ground, Terrain)
    arrays = {
        **{f"terrain.{entry.name}": getattr(ground, entry.name) for entry in fields(Terrain)},
        **_packed_paths(course.paths),
        "name": course.name,
        "trees": course.trees,
    }
    return {name: value for name, value in arrays.items() if value is not None}


def _unpacked(arrays: Mapping[str, Any]) -> Course:
    ground = {name.removeprefix("terrain."): value for name, value in arrays.items() if name.startswith("terrain.")}
    ground |= {name: str(ground[name]) for name in ("name", "crs") if name in ground}
    ground["origin"] = tuple(ground["origin"].tolist())
    return Course(Terrain(**ground), _unpacked_paths(arrays), name=str(arrays["name"]), trees=arrays["trees"])


def _packed_paths(paths: tuple[Path, ...]) -> dict[str, Any]:
    arrays: dict[str, Any] = {"paths": len(paths)}
    for number, path in enumerate(paths):
        arrays |= {f"path.{number}.{entry.name}": getattr(path, entry.name) for entry in fields(Path)}
    return {name: value for name, value in arrays.items() if value is not None}


def _unpacked_paths(arrays: Mapping[str, Any]) -> tuple[Path, ...]:
    return tuple(
        Path(
            arrays[f"path.{number}.points"],
            bool(arrays[f"path.{number}.closed"]),
            arrays.get(f"path.{number}.speed"),
            str(arrays[f"path.{number}.name"]),
        )
        for number in range(int(arrays["paths"]))
    )
