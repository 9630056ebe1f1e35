"""Where a vehicle can drive on a terrain, and smooth random paths there that it can follow.

A path is a chain of clothoids and arcs, found by a randomised search over headings and curvatures towards random places:
its curvature is continuous, bounded, and changes no faster than the joint can turn. Along it the ground is neither too
steep nor too rough under the whole width that the vehicle sweeps.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from aoro_gym.checks import check_range
from aoro_gym.terrains.heights import Heights, grid_shape, sample_triangles
from aoro_gym.terrains.paths.path import Path
from aoro_gym.terrains.plane import Plane
from aoro_gym.terrains.terrain import Terrain

HALF_WHEELBASE = 1.7
"""Hinge to either axle [m]."""
JOINT_RANGE_DEG = 40.0
"""Largest joint angle to either side [deg]."""
TRACK = 1.97
"""Middle of the left to middle of the right tire [m]."""
WIDTH = 2.5
"""Over the tires [m]."""
TURNING_RADIUS = 7.0
"""Of a generated path [m]: 1.5 times the tightest, so a controller has 12° of joint left at each bend."""
SHARPNESS = 0.08
"""Fastest change of a path's curvature [1/m²]: at 1 m/s the joint turns at 2 x 1.7 m x 0.08 = 0.27 rad/s; it can at 0.7."""

FOOTPRINT = 1.0
"""Standard deviation [m] of the weights that mean the ground under the vehicle: about one half of it."""
STEP_WINDOW = 0.5
"""Length [m] over which a step counts as one: a tire's contact."""
CELL = 0.25
"""Distance [m] of the grid's nodes, unless that makes more than ``MOST_NODES``."""
MOST_NODES = 500_000
PLANE_SIZE = 100.0
"""Side [m] of the square around the origin in which paths on a plane lie."""

PIECE = 3.0
"""Length [m] of one piece of a generated path."""
SPACING = 0.25
"""Of a generated path's points [m]."""
LEVELS = 9
"""Curvatures, right to left, that pieces lead to."""
TRIES = 40
"""Random starts before a search is given up."""
APPEAL, LUCK = 4.0, 1.0
"""What a chain's last turn, and chance, count against one piece of length."""
PIECES_A_TRY = 2000
"""From one start."""

Array = NDArray[np.float64]


class NoDrivablePath(ValueError):
    """Ground on which no path was found."""


def turning_radius(joint_angle_deg: float, front: float = HALF_WHEELBASE, rear: float = HALF_WHEELBASE) -> float:
    """Radius [m] that the wider turning axle's middle rolls on at a constant joint angle, without sideslip.

    Both axles' lines meet in the centre of the turn: R_front = (front cos γ + rear) / sin γ, and the other way round.

    Args:
        joint_angle_deg: γ, in (0, 90).
        front: Hinge to front axle [m].
        rear: Hinge to rear axle [m].
    """
    check_range("joint_angle_deg", joint_angle_deg, "deg", gt=0.0, lt=90.0)
    angle = np.radians(joint_angle_deg)
    return float(max(front * np.cos(angle) + rear, rear * np.cos(angle) + front) / np.sin(angle))


@dataclass(frozen=True, eq=False)
class DrivableGround:
    """A grid over a terrain with what bars a vehicle; make one with :func:`drivable_ground`."""

    heights: Heights
    """The ground; its grid is that of the other fields."""
    rolled: Array
    """(rows, columns) height [m] that a tire rolls at: the ground without what is smaller than its contact."""
    clear: Array
    """(rows, columns) distance [m] to the nearest edge of what the swept width must not touch; 0 where no middle can be."""
    turning_radius: float
    max_slope: float
    """[-] along the path."""
    max_cross_slope: float
    """[-] across the path."""
    barred: dict[str, float]
    """Share of the ground that each cause bars to the vehicle's middle."""

    @property
    def open(self) -> NDArray[np.bool_]:
        """(rows, columns) where the vehicle's middle can be, if its heading suits the slope."""
        return self.clear > 0.0

    def passable(self, x: ArrayLike, y: ArrayLike, heading: ArrayLike) -> NDArray[np.bool_]:
        """Whether the vehicle can be at ``x``, ``y`` [m] with ``heading`` [rad], which broadcast.

        Its slope is that of a wheelbase, its cross slope that of an axle, each between the places where tires stand.
        """
        x, y, heading = np.broadcast_arrays(x, y, heading)
        cosine, sine = np.cos(heading), np.sin(heading)
        row, column, inside = self._node(x, y)
        level = np.abs(self._rise(x, y, cosine, sine, HALF_WHEELBASE)) <= self.max_slope
        upright = np.abs(self._rise(x, y, -sine, cosine, 0.5 * TRACK)) <= self.max_cross_slope
        return inside & level & upright & (self.clear[row, column] > 0.0)

    def _rise(self, x: Array, y: Array, ahead_x: Array, ahead_y: Array, reach: float) -> Array:
        """Slope [-] between the places ``reach`` [m] before and behind (x, y) in a direction."""
        after = self._node(x + reach * ahead_x, y + reach * ahead_y)[:2]
        before = self._node(x - reach * ahead_x, y - reach * ahead_y)[:2]
        return (self.rolled[after] - self.rolled[before]) / (2.0 * reach)

    def room(self, x: ArrayLike, y: ArrayLike) -> Array:
        """``clear`` [m] at ``x``, ``y`` [m], which broadcast."""
        row, column, inside = self._node(np.asarray(x), np.asarray(y))
        return self.clear[row, column] * inside

    def path(self, seed: int, *, length: float = 60.0, name: str | None = None) -> Path:
        """A smooth random path; the same for the same seed.

        Args:
            seed: Of numpy's default generator.
            length: [m].
            name: Of the path.

        Raises :class:`NoDrivablePath` that says what bars the ground if no path of this length is found.
        """
        check_range("path length", length, "m", ge=2.0 * PIECE, le=10_000.0)
        rng = np.random.default_rng(seed)
        places = self._places()
        longest = 0.0
        for _ in range(TRIES if len(places) else 0):
            points = _search(self, rng, places, int(np.ceil(length / PIECE)))
            longest = max(longest, SPACING * (len(points) - 1))
            if longest >= length:
                return Path(points[: round(length / SPACING) + 1], name=name or f"drivable path, seed {seed}")
        causes = ", ".join(f"{cause} {share:.0%}" for cause, share in self.barred.items())
        raise NoDrivablePath(
            f"no drivable path of {length:g} m with a turning radius of {self.turning_radius:g} m found; the longest has"
            f" {longest:.0f} m. Of the ground {self.open.mean():.0%} is open to the vehicle's middle (barred: {causes});"
            " shorten length, or relax max_slope_deg, max_cross_slope_deg, obstacle_height, clearance or margin"
        )

    def _node(self, x: Array, y: Array) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.bool_]]:
        column = np.rint((x - self.heights.corner[0]) / self.heights.cell).astype(np.intp)
        row = np.rint((y - self.heights.corner[1]) / self.heights.cell).astype(np.intp)
        rows, columns = self.clear.shape
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        return np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1), inside

    def _places(self) -> Array:
        """(K, 2) x, y [m] of nodes of the largest connected open ground."""
        labels, count = cast(Any, ndimage.label(self.open))
        if count == 0:
            return np.empty((0, 2))
        largest = 1 + int(np.argmax(np.bincount(labels.ravel())[1:]))
        row, column = np.nonzero(labels == largest)
        places = np.stack([column, row], axis=1).astype(np.float64)
        return np.asarray(self.heights.corner) + self.heights.cell * places


def drivable_ground(
    terrain: Terrain | Plane,
    *,
    turning_radius: float = TURNING_RADIUS,
    max_slope_deg: float = 15.0,
    max_cross_slope_deg: float = 10.0,
    obstacle_height: float = 0.2,
    clearance: float = 0.3,
    margin: float = 3.5,
    obstacles: ArrayLike | None = None,
) -> DrivableGround:
    """Where a vehicle can drive.

    Args:
        terrain: Triangles, or a plane with one slope.
        turning_radius: Least radius [m] of a path.
        max_slope_deg: Along the path.
        max_cross_slope_deg: Across it.
        obstacle_height: Step [m] over ``STEP_WINDOW`` that the tires should not take, on top of the slope.
        clearance: Between the swept width and obstacles [m].
        margin: Between the path and the ground's edge [m]; 3.5 m keep the whole vehicle on it.
        obstacles: (K, 3) x, y, radius [m] of what stands on the ground and is not part of it: trees, posts.

    Raises ``ValueError`` naming the value, its bound and the fix.
    """
    tightest = _tightest()
    for key, value, low, high in (
        ("turning_radius", turning_radius, tightest, 1000.0),
        ("max_slope_deg", max_slope_deg, 0.1, 45.0),
        ("max_cross_slope_deg", max_cross_slope_deg, 0.1, 45.0),
        ("obstacle_height", obstacle_height, 0.01, 2.0),
        ("clearance", clearance, 0.0, 20.0),
        ("margin", margin, 0.0, 100.0),
    ):
        hint = f": the joint's {JOINT_RANGE_DEG:g}° turns no tighter" if key == "turning_radius" else ""
        check_range(key, value, "deg" if key.endswith("_deg") else "m", ge=low, le=high, note=hint)
    heights = _heights(terrain)
    known, cell = heights.known, heights.cell
    filled = heights.z
    if not known.all():
        nearest: Any = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
        filled = filled[tuple(nearest)]
    # the mean of a window that the grid's edge cuts leans to its other side: mirror the ground point by point
    pad = int(np.ceil(4.0 * FOOTPRINT / cell))
    inner = (slice(pad, -pad), slice(pad, -pad))
    mirrored = np.pad(filled, pad, mode="reflect", reflect_type="odd")
    mean: Any = ndimage.gaussian_filter(mirrored, FOOTPRINT / cell)
    rolled: Any = ndimage.gaussian_filter(mirrored, 0.5 * STEP_WINDOW / cell)
    steepness = np.hypot(*np.gradient(mean, cell))[inner]
    max_slope, max_cross = np.tan(np.radians([max_slope_deg, max_cross_slope_deg]))

    rough = filled - mean[inner]
    window = 1 + 2 * max(round(0.5 * STEP_WINDOW / cell), 1)
    step = ndimage.maximum_filter(rough, window) - ndimage.minimum_filter(rough, window)
    # the window's corners are farther apart than a tire is long: a step of the limit's steepness is none
    touched = step > obstacle_height * max(1.0, cell * (window - 1) / STEP_WINDOW)
    if obstacles is not None:
        touched |= _nodes_under(np.asarray(obstacles, dtype=np.float64), heights)
    swept = 0.5 * WIDTH + np.hypot(turning_radius, HALF_WHEELBASE) - turning_radius + clearance
    causes = {
        "slope": steepness > np.hypot(max_slope, max_cross),
        "obstacles": _distance(touched, cell) <= swept,
        "edge and holes": _distance(~np.pad(known, 1), cell)[1:-1, 1:-1] <= margin,
    }
    free = known & ~np.logical_or.reduce(list(causes.values()))
    clear = np.where(free, np.minimum(_distance(touched, cell) - swept, _distance(~free, cell)), 0.0)
    barred = {cause: float(np.mean(mask[known])) for cause, mask in causes.items()}
    return DrivableGround(heights, rolled[inner], clear, turning_radius, float(max_slope), float(max_cross), barred)


def drivable_path(terrain: Terrain | Plane, seed: int = 0, *, length: float = 60.0, **limits: Any) -> Path:
    """A smooth random path that the vehicle can follow on ``terrain``; it starts straight, for the vehicle to stand on.

    For many paths on one terrain make its :func:`drivable_ground` once.

    Args:
        terrain: Triangles, or a plane with one slope.
        seed: Another one, another path.
        length: Of the path [m].
        limits: Of slopes, clearance, margin and the like, with ``obstacles``: see :func:`drivable_ground`.

    Raises ``ValueError`` that names a wrong value, or says what bars the ground if no path of this length is found.
    """
    return drivable_ground(terrain, **limits).path(seed, length=length)


def _tightest() -> float:
    return turning_radius(JOINT_RANGE_DEG)


def _heights(terrain: Terrain | Plane) -> Heights:
    if isinstance(terrain, Plane):
        if np.ndim(terrain.slope_deg) or np.ndim(terrain.direction_deg):
            raise ValueError("a plane with one slope a twin has no one path; make a Plane with a single slope_deg")
        x = np.arange(-0.5 * PLANE_SIZE, 0.5 * PLANE_SIZE + 0.5)
        return Heights(terrain.height(x[None, :], x[:, None]), 1.0, (float(x[0]), float(x[0])))
    low, high = terrain.extent
    rows, columns = grid_shape(low, high, CELL)
    cell = CELL * max(1.0, float(np.sqrt(rows * columns / MOST_NODES)))
    return sample_triangles(terrain.vertices, terrain.faces, cell)[0]


def _nodes_under(obstacles: Array, heights: Heights) -> NDArray[np.bool_]:
    """Nodes nearest to or within the circles (K, 3)."""
    if obstacles.ndim != 2 or obstacles.shape[1] != 3 or not np.isfinite(obstacles).all():
        raise ValueError(f"obstacles have the shape {obstacles.shape}; give (K, 3) finite x, y, radius [m]")
    covered = np.zeros(heights.z.shape, dtype=bool)
    for x, y, radius in obstacles:
        middle = (np.array([y, x]) - heights.corner[::-1]) / heights.cell
        reach = max(radius / heights.cell, 0.71)  # half a cell's diagonal: the smallest covers one node
        low = np.maximum(np.ceil(middle - reach).astype(int), 0)
        high = np.minimum(np.floor(middle + reach).astype(int) + 1, covered.shape)
        if np.all(low < high):
            row, column = np.ogrid[low[0] : high[0], low[1] : high[1]]
            within = (row - middle[0]) ** 2 + (column - middle[1]) ** 2 <= reach**2
            covered[low[0] : high[0], low[1] : high[1]] |= within
    return covered


def _distance(mask: NDArray[np.bool_], cell: float) -> Array:
    """Distance [m] of every node to the nearest one of the mask."""
    if not mask.any():
        return np.full(mask.shape, np.inf)
    return cell * np.asarray(ndimage.distance_transform_edt(~mask))


def _motion_primitives(radius: float) -> dict[int, tuple[NDArray[np.intp], Array]]:
    """For each level of curvature: the levels it can lead to, and the poses (K, M, 3) along the pieces from (0, 0, 0)."""
    curvature = np.linspace(-1.0, 1.0, LEVELS) / radius
    fine = np.linspace(0.0, PIECE, 10 * round(PIECE / SPACING) + 1)
    pieces = {}
    for level, start in enumerate(curvature):
        ends = np.flatnonzero(np.abs(curvature - start) <= SHARPNESS * PIECE + 1e-9)
        change = curvature[ends] - start
        # as fast as the joint, at least over half of the piece
        ramp = np.maximum(np.abs(change) / SHARPNESS, 0.5 * PIECE)[:, None]
        bend = np.where(fine < ramp, 0.5 * fine**2 / ramp, fine - 0.5 * ramp)
        heading = start * fine + change[:, None] * bend
        steps = np.diff(fine) * np.exp(0.5j * (heading[:, 1:] + heading[:, :-1]))
        plan = np.concatenate([np.zeros((len(ends), 1)), np.cumsum(steps, axis=1)], axis=1)
        pieces[level] = (ends, np.stack([plan.real, plan.imag, heading], axis=-1)[:, 10::10])
    return pieces


def _search(ground: DrivableGround, rng: np.random.Generator, places: Array, count: int) -> Array:
    """(P, 2) points [m] of the longest chain found from a random start, of at most ``count`` pieces.

    Best first, where the best is the longest give or take some random pieces: out of a dead end the search goes on from
    a little or a lot before it.
    """
    start = _start(ground, rng, places)
    if start is None:
        return np.empty((1, 2))
    pieces = _motion_primitives(ground.turning_radius)
    straight = LEVELS // 2
    chain = [_SearchNode(start[None], straight, None, 0, _goal(rng, places, start[None, :2]))]
    longest = chain[0]
    waiting: list[tuple[float, int]] = [(0.0, 0)]
    seen: set[tuple[int, ...]] = set()
    for _ in range(PIECES_A_TRY):
        if not waiting or longest.count == count:
            break
        here = chain[heapq.heappop(waiting)[1]]
        x, y, heading = here.piece[-1]
        key = (round(x), round(y), round(heading / (np.pi / 12.0)) % 24, here.level)
        if key in seen:
            continue
        seen.add(key)
        if here.count > longest.count:
            longest = here
        ends, shapes = pieces[here.level]
        if here.count == 0:
            ends, shapes = ends[ends == straight], shapes[ends == straight]
        cosine, sine = np.cos(heading), np.sin(heading)
        poses = np.empty_like(shapes)
        poses[..., 0] = x + cosine * shapes[..., 0] - sine * shapes[..., 1]
        poses[..., 1] = y + sine * shapes[..., 0] + cosine * shapes[..., 1]
        poses[..., 2] = heading + shapes[..., 2]
        good = ground.passable(poses[..., 0], poses[..., 1], poses[..., 2]).all(axis=1)
        if not good.any():
            continue
        ends, poses = ends[good], poses[good]
        goal = here.goal
        if np.hypot(*(goal - (x, y))) < 1.5 * ground.turning_radius or here.count % 15 == 14:
            goal = _goal(rng, places, here.places())
        last = poses[:, -1]
        bearing = np.arctan2(goal[1] - last[:, 1], goal[0] - last[:, 0])
        appeal = (
            np.cos(bearing - last[:, 2])
            + 0.3 * np.minimum(ground.room(last[:, 0], last[:, 1]), 3.0)
            - 0.1 * np.abs(ends - here.level)
        )
        luck = rng.gumbel(size=len(ends))
        for level, piece, value in zip(ends, poses, here.count + APPEAL * appeal + LUCK * luck, strict=True):
            chain.append(_SearchNode(piece, int(level), here, here.count + 1, goal))
            heapq.heappush(waiting, (-float(value), len(chain) - 1))
    parts: list[Array] = []
    link: _SearchNode | None = longest
    while link is not None:
        parts.append(link.piece[:, :2])
        link = link.before
    return np.concatenate(parts[::-1])


@dataclass(frozen=True, eq=False)
class _SearchNode:
    """A piece, (M, 3) poses, and all pieces before it."""

    piece: Array
    level: int
    before: _SearchNode | None
    count: int
    goal: Array

    def places(self) -> Array:
        """(K, 2) ends of its pieces."""
        link: _SearchNode | None = self
        ends = []
        while link is not None:
            ends.append(link.piece[-1, :2])
            link = link.before
        return np.array(ends)


def _start(ground: DrivableGround, rng: np.random.Generator, places: Array) -> Array | None:
    """x, y, heading where the whole vehicle can stand straight: with a piece before and behind it."""
    along = np.arange(-PIECE, PIECE + SPACING, SPACING)
    for x, y in places[rng.integers(len(places), size=100)]:
        heading = rng.uniform(-np.pi, np.pi) + np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
        direction = np.exp(1j * heading)[:, None]
        line = x + 1j * y + along * direction
        good = ground.passable(line.real, line.imag, heading[:, None]).all(axis=1)
        if good.any():
            return np.array([x, y, heading[np.argmax(good)]])
    return None


def _goal(rng: np.random.Generator, places: Array, driven: Array) -> Array:
    """A place to head for: of a few random ones that which is farthest away from all those (K, 2) driven over."""
    few = places[rng.integers(len(places), size=12)]
    apart = np.linalg.norm(few[:, None] - driven, axis=2).min(axis=1)
    return few[np.argmax(apart)]
