"""Where a vehicle drives: a terrain with paths over it, and a small library of them that is made once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cache, lru_cache

import numpy as np
import warp as wp
from numpy.typing import NDArray

from aoro_gym.arrays import HOST, Array, Arrays
from aoro_gym.execution import devices
from aoro_gym.terrains import Path, Plane, Terrain
from aoro_gym.terrains.forest import forest
from aoro_gym.terrains.planning import drivable_ground
from aoro_gym.terrains.raster import CELL, Raster, rasterise


@dataclass(frozen=True, eq=False)
class Course:
    """A terrain and the paths that lead over it."""

    terrain: Terrain | Plane
    paths: tuple[Path, ...]
    name: str = "course"
    trees: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 4)))
    """(K, 4) x, y, radius and height [m] of what pictures show beside the ground; the machine does not feel them."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "paths", tuple(self.paths))
        if not self.paths:
            raise ValueError(f"course {self.name!r} has no path; give at least one")
        for path in self.paths:
            if not isinstance(path, Path):
                raise ValueError(f"course {self.name!r} has {path!r} for a path; give aoro_gym.terrains.Path")
        if isinstance(self.terrain, Plane):
            for entry in fields(self.terrain):
                if np.ndim(getattr(self.terrain, entry.name)):
                    raise ValueError(
                        f"course {self.name!r}: the plane's {entry.name} is an array, but must be a number"
                    )


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
        self._heights, self._known = (arrays.asarray(column) for column in np.concatenate(nodes).T)

    def height(self, ground: Array, xy: Array) -> Array:
        """Height [m] (...) at ``xy`` (..., 2) of the grounds whose numbers ``ground`` broadcasts against it."""
        if self._level:
            return self._slope[0] * xy[..., 0] + self._slope[1] * xy[..., 1]
        return self._between(self._heights, ground, xy)

    def known(self, ground: Array, xy: Array) -> Array:
        """Whether there is ground at ``xy`` (..., 2): within the extent, and not over a hole."""
        if self._level:
            return self._arrays.xp.isfinite(xy[..., 0])
        extent = self._extents[ground]
        low, high = extent[..., 2:4], extent[..., 4:6]
        inside = self._arrays.xp.all((xy >= low) & (xy <= high), axis=-1)
        return inside & (self._between(self._known, ground, xy) >= 0.5)

    def _between(self, nodes: Array, ground: Array, xy: Array) -> Array:
        """Values of the nodes of all rasters, bilinear between the nodes."""
        xp, extent, shape = self._arrays.xp, self._extents[ground], self._shapes[ground]
        columns = shape[..., 0]
        place = xp.clip(xp.minimum((xy - extent[..., :2]) / CELL, extent[..., 6:]), 0.0, None)
        before = xp.astype(place, xp.int64)
        share = place - before
        u, v = share[..., 0], share[..., 1]
        node = shape[..., 1] + before[..., 1] * columns + before[..., 0]
        south = (1.0 - u) * nodes[node] + u * nodes[node + 1]
        node = node + columns
        return (1.0 - v) * south + v * ((1.0 - u) * nodes[node] + u * nodes[node + 1])


@cache
def surface(terrain: Terrain, device: str) -> Raster:
    """The terrain's raster, on the host, made once on each ``device`` that needs it."""
    devices.start()
    mesh = wp.Mesh(
        points=wp.array(terrain.vertices, dtype=wp.vec3, device=device),
        indices=wp.array(terrain.faces.ravel(), dtype=int, device=device),
    )
    return rasterise(terrain, mesh)


def as_courses(
    courses: Sequence[Course] | None, terrain: Terrain | Plane | None, path: Path | None
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
                raise ValueError(f"courses holds {course!r}; give aoro_gym.envs.Course(terrain, paths)")
        if len(courses) > 1 and any(isinstance(course.terrain, Plane) for course in courses):
            raise ValueError("courses holds a plane beside others; give one plane with all paths, or terrains")
        return courses
    if terrain is None:
        if path is None:
            return library()
        terrain = Plane()
    paths = (path,) if path is not None else generated_paths(terrain)
    return (Course(terrain, paths, name=getattr(terrain, "name", "plane")),)


@lru_cache(maxsize=16)
def generated_paths(terrain: Terrain | Plane, count: int = 4, length: float = 60.0, first: int = 0) -> tuple[Path, ...]:
    """Drivable paths over ``terrain``, always the same, of the seeds from ``first`` on.

    Raises ValueError if there is no room for them.
    """
    ground = drivable_ground(terrain)
    return tuple(ground.path(seed, length=length) for seed in range(first, first + count))


LIBRARY_SEEDS, LIBRARY_SIZE, LIBRARY_PATHS = (1, 2, 3), (60.0, 60.0), 4
"""Of :func:`library`: the forests' seeds, their size [m], and the paths over each, 60 m long."""


@cache
def library() -> tuple[Course, ...]:
    """The courses that an environment draws from by default: forests with drivable paths between the trees, made once in a
    process and shared by all environments."""
    return tuple(forest_course(seed, size=LIBRARY_SIZE, count=LIBRARY_PATHS) for seed in LIBRARY_SEEDS)


def forest_course(
    seed: int, *, size: tuple[float, float] = LIBRARY_SIZE, count: int = 4, length: float = 60.0
) -> Course:
    """A generated forest of ``size`` [m] with ``count`` drivable paths of ``length`` [m]; the same for the same seed."""
    grown = forest(seed, size=size)
    ground = drivable_ground(grown.terrain, obstacles=grown.circles("tree"))
    paths = tuple(ground.path(number, length=length) for number in range(count))
    return Course(grown.terrain, paths, name=f"forest {seed}", trees=grown.trees)
