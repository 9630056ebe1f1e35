"""A path to follow over a terrain, seen from above: points, and what a vehicle asks of the line through them."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.checks import check_range

CLOSEST = 1e-3
"""Least distance [m] of neighbouring points: below it they say nothing about the path's direction."""
MOST_POINTS = 400_000
"""Points that a path is resampled to: 100 km with one every 0.25 m."""
REACH = 5.0
"""How far [m] along the path to look for the projection of a point whose last one is known."""

_PAIRS_AT_ONCE = 500_000

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Path:
    """Points in a terrain's local frame (x east, y north [m]), joined by straight segments.

    Arc length, positions and projections are those of the segments. Heading and curvature at a point are those of the
    circle through it and its neighbours, and linear in arc length between: a circle's are exact however far apart its
    points are, as long as they are evenly spaced.

    Raises ``ValueError`` naming the value, its bound and the fix.
    """

    points: Array
    """(P, 2) [m], at least two (three if closed), no neighbours closer than ``CLOSEST``."""
    closed: bool = False
    """Whether the last point leads on to the first, which is then not repeated."""
    speed: Array | None = None
    """(P,) speed to drive at [m/s], linear in arc length between the points; None: not said."""
    name: str = "path"

    def __post_init__(self) -> None:
        points = np.array(self.points, dtype=np.float64)
        least = 3 if self.closed else 2
        if points.ndim != 2 or points.shape[1:] != (2,) or len(points) < least:
            kind = "a closed path" if self.closed else "a path"
            raise ValueError(
                f"path points have the shape {points.shape}; give {kind} (P, 2) with at least {least} points"
            )
        if not np.isfinite(points).all():
            bad = int(np.argmin(np.isfinite(points).all(axis=1)))
            raise ValueError(f"path point {bad} is {points[bad].tolist()}, but must be finite; leave it out")
        for apart, what, fix in (
            (1, "repeats", "leave it out"),
            (2, "turns straight back to", "leave it out, or split the path where it turns round"),
        ):
            ahead = np.roll(points, -apart, axis=0)
            gap = np.linalg.norm(ahead - points, axis=1)[: None if self.closed else len(points) - apart]
            if np.any(gap < CLOSEST):
                first = int(np.argmin(gap))
                raise ValueError(
                    f"path point {(first + apart) % len(points)} {what} point {first}: they are {gap[first]:.2g} m apart,"
                    f" but must be at least {CLOSEST:g} m; {fix}"
                )
        points.flags.writeable = False
        object.__setattr__(self, "points", points)
        if self.speed is not None:
            speed = np.array(self.speed, dtype=np.float64)
            if speed.shape != (len(points),):
                raise ValueError(f"path speed has the shape {speed.shape}; give ({len(points)},), one a point")
            bad = ~(np.isfinite(speed) & (speed >= 0.0))
            if bad.any():
                first = int(np.argmax(bad))
                raise ValueError(
                    f"path speed at point {first} is {speed[first]:g} m/s, but must be finite and at least 0"
                )
            speed.flags.writeable = False
            object.__setattr__(self, "speed", speed)

    def __copy__(self) -> Path:
        return self  # immutable

    def __deepcopy__(self, memo: dict[int, Any]) -> Path:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(getattr(self, entry.name) for entry in fields(self))  # read-only again, and checked

    @classmethod
    def spline(
        cls,
        waypoints: ArrayLike,
        *,
        spacing: float = 0.25,
        closed: bool = False,
        speed: ArrayLike | None = None,
        name: str = "path",
    ) -> Path:
        """Through ``waypoints`` (W, 2) [m] along a cubic spline in their chord length: heading and curvature are continuous.

        Args:
            waypoints: Checked as a path's points; two make a straight line.
            spacing: Arc length [m] between the path's points, to the nearest that divides the whole.
            closed: Whether the last waypoint leads on to the first.
            speed: (W,) [m/s] at the waypoints.
            name: Of the path.
        """
        from scipy.interpolate import CubicSpline

        rough = cls(np.asarray(waypoints, dtype=np.float64), closed, None if speed is None else np.asarray(speed), name)
        knots = np.append(rough.stations, rough.length) if closed else rough.stations
        around = np.concatenate([rough.points, rough.points[:1]]) if closed else rough.points
        curve = CubicSpline(knots, around, bc_type="periodic" if closed else "natural")
        # arc length along the curve, from chords 20 times shorter than the points' spacing or the waypoints'
        fine = np.linspace(0.0, rough.length, 20 * max(_pieces(rough.length, spacing), len(knots)) + 1)
        chords = np.linalg.norm(np.diff(curve(fine), axis=0), axis=1)
        arc = np.concatenate([[0.0], np.cumsum(chords)])
        even = np.linspace(0.0, arc[-1], max(_pieces(arc[-1], spacing), _least_pieces(closed)) + 1)
        parameter = np.interp(even[:-1] if closed else even, arc, fine)
        return cls(curve(parameter), closed, rough.speed_at(parameter) if rough.speed is not None else None, name)

    @property
    def num_segments(self) -> int:
        """How many segments join the points."""
        return len(self.points) if self.closed else len(self.points) - 1

    @cached_property
    def stations(self) -> Array:
        """(P,) arc length [m] at the points."""
        return np.concatenate([[0.0], np.cumsum(self._lengths)[: len(self.points) - 1]])

    @cached_property
    def length(self) -> float:
        """Arc length [m] of the whole path; of one lap if it is closed."""
        return float(np.cumsum(self._lengths)[-1])

    @cached_property
    def headings(self) -> Array:
        """(P,) direction [rad] at the points, counter-clockwise from x; continuous, so it may pass ±π."""
        return self._tangents[: len(self.points)]

    @cached_property
    def curvatures(self) -> Array:
        """(P,) curvature [1/m] at the points, positive to the left."""
        if len(self.points) == 2:
            return np.zeros(2)
        before, after = self._neighbours
        back, ahead = self._inner - before, after - self._inner
        sides = np.linalg.norm(back, axis=1) * np.linalg.norm(ahead, axis=1) * np.linalg.norm(after - before, axis=1)
        inner = 2.0 * _cross(back, ahead) / sides
        return inner if self.closed else np.concatenate([inner[:1], inner, inner[-1:]])

    def position(self, s: ArrayLike) -> Array:
        """x, y [m] at arc length ``s`` [m] of any shape (...): (..., 2). Beyond the ends: the end, or the next lap."""
        s = self._on_path(s)
        return np.stack([self._interpolated(s, self.points[:, axis]) for axis in (0, 1)], axis=-1)

    def heading(self, s: ArrayLike) -> Array:
        """Direction [rad] at arc length ``s`` [m], in [-π, π), counter-clockwise from x."""
        s = self._on_path(s)
        turned = np.interp(s, self._knots, self._tangents)
        return (turned + np.pi) % (2.0 * np.pi) - np.pi

    def curvature(self, s: ArrayLike) -> Array:
        """Curvature [1/m] at arc length ``s`` [m], positive to the left."""
        return self._interpolated(self._on_path(s), self.curvatures)

    def speed_at(self, s: ArrayLike) -> Array:
        """Speed [m/s] to drive at at arc length ``s`` [m]; ``ValueError`` if the path does not say."""
        if self.speed is None:
            raise ValueError(f"path {self.name!r} says no speed; give Path(..., speed=...) one a point")
        return self._interpolated(self._on_path(s), self.speed)

    def project(self, xy: ArrayLike, near: ArrayLike | None = None, *, reach: float = REACH) -> tuple[Array, Array]:
        """Arc length and cross-track offset of the path's nearest point.

        Args:
            xy: (..., 2) [m].
            near: (...) arc length [m] of the last known projection: only the path within ``reach`` of it counts, so that
                a vehicle stays on its branch where the path crosses itself. None: the whole path.
            reach: [m].

        Returns:
            ``s`` and ``cross_track``, each of shape (...) [m]. ``cross_track`` is positive where the point is LEFT of the
            path. Beyond the ends of an open path it counts from the end's segment prolonged.
        """
        xy = np.asarray(xy, dtype=np.float64)
        if xy.ndim == 0 or xy.shape[-1] != 2:
            raise ValueError(f"xy has the shape {xy.shape}; give (..., 2)")
        check_range("reach", reach, "m", gt=0.0)
        shape, flat = xy.shape[:-1], xy.reshape(-1, 2)
        if near is None:
            candidates = np.broadcast_to(np.arange(self.num_segments), (len(flat), self.num_segments))
        else:
            candidates = self._segments_around(
                np.broadcast_to(np.asarray(near, dtype=np.float64), shape).ravel(), reach
            )
        s, offset = np.empty(len(flat)), np.empty(len(flat))
        step = max(_PAIRS_AT_ONCE // max(candidates.shape[1], 1), 1)
        for first in range(0, len(flat), step):
            part = slice(first, first + step)
            s[part], offset[part] = self._nearest(flat[part], candidates[part])
        return s.reshape(shape), offset.reshape(shape)

    def resample(self, spacing: float) -> Path:
        """The same line with points every ``spacing`` [m], to the nearest that divides the whole; corners are cut."""
        count = max(_pieces(self.length, spacing), _least_pieces(self.closed))
        s = np.linspace(0.0, self.length, count + 1)
        s = s[:-1] if self.closed else s
        return replace(self, points=self.position(s), speed=None if self.speed is None else self.speed_at(s))

    def smooth(self, wavelength: float = 5.0, *, spacing: float = 0.25) -> Path:
        """Without wiggles shorter than ``wavelength`` [m]: a smoothing spline in arc length, points every ``spacing`` [m].

        A wave of this length is halved, one of twice the length loses 6 %; a circle of a third of it as its radius
        shrinks by 5 %, of its whole as its radius by 0.06 %. An open path ends near where it ended, without curvature.
        """
        from scipy.interpolate import make_smoothing_spline

        check_range("wavelength", wavelength, "m", gt=2.0 * spacing, note=", two spacings")
        even = self.resample(min(spacing, self.length / 8.0))
        step = even.length / even.num_segments
        # closed: the penalty's influence decays within a wavelength; three laps more than cover it
        turns = int(np.ceil(3.0 * wavelength / even.length)) if self.closed else 0
        around = np.tile(even.points, (1 + 2 * turns, 1))
        s = step * (np.arange(len(around)) - turns * len(even.points))
        strength = (wavelength / (2.0 * np.pi)) ** 4 / step  # of |f''|² against one squared distance a point
        curves = [make_smoothing_spline(s, around[:, axis], lam=strength) for axis in (0, 1)]
        smoothed = np.stack([curve(even.stations) for curve in curves], axis=1)
        return replace(even, points=smoothed).resample(spacing)

    @cached_property
    def _vectors(self) -> Array:
        """(S, 2) from each segment's start to its end [m]."""
        return (np.roll(self.points, -1, axis=0) - self.points)[: self.num_segments]

    @cached_property
    def _lengths(self) -> Array:
        return np.linalg.norm(self._vectors, axis=1)

    @cached_property
    def _directions(self) -> Array:
        return self._vectors / self._lengths[:, None]

    @cached_property
    def _corners(self) -> Array:
        """(S + 1, 2) sum of the directions before and after the segments' ends."""
        ahead, back = self._directions[:1], self._directions[-1:]
        before, after = (back, ahead) if self.closed else (ahead, back)
        return np.concatenate([before, self._directions]) + np.concatenate([self._directions, after])

    @cached_property
    def _knots(self) -> Array:
        """(S + 1,) arc length [m] at the segments' ends."""
        return np.append(self.stations, self.length) if self.closed else self.stations

    @property
    def _inner(self) -> Array:
        """The points that have neighbours on both sides."""
        return self.points if self.closed else self.points[1:-1]

    @property
    def _neighbours(self) -> tuple[Array, Array]:
        if self.closed:
            return np.roll(self.points, 1, axis=0), np.roll(self.points, -1, axis=0)
        return self.points[:-2], self.points[2:]

    @cached_property
    def _tangents(self) -> Array:
        """(S + 1,) continuous heading [rad] at the segments' ends."""
        chord = np.unwrap(np.arctan2(self._vectors[:, 1], self._vectors[:, 0]))
        length = self._lengths
        if self.closed:
            turn = (chord[0] - chord[-1] + np.pi) % (2.0 * np.pi) - np.pi
            chord = np.concatenate([[chord[0] - turn], chord, [chord[-1] + turn]])
            length = np.concatenate([length[-1:], length, length[:1]])
        inner = (chord[:-1] * length[1:] + chord[1:] * length[:-1]) / (length[:-1] + length[1:])
        if self.closed:
            return inner
        if len(chord) == 1:
            return np.repeat(chord, 2)
        return np.concatenate([[2.0 * chord[0] - inner[0]], inner, [2.0 * chord[-1] - inner[-1]]])

    def _on_path(self, s: ArrayLike) -> Array:
        s = np.asarray(s, dtype=np.float64)
        return s % self.length if self.closed else np.clip(s, 0.0, self.length)

    def _interpolated(self, s: Array, values: Array) -> Any:
        return np.interp(s, self._knots, np.append(values, values[0]) if self.closed else values)

    def _segments_around(self, near: Array, reach: float) -> NDArray[np.intp]:
        """(N, K) segments within ``reach`` of ``near`` (N,); rows with fewer repeat their last."""
        near = self._on_path(near)
        first, last = self._segment_at(near - reach), self._segment_at(near + reach)
        last = np.minimum(last, first + self.num_segments - 1)
        width = int((last - first).max(initial=0)) + 1
        return np.minimum(first[:, None] + np.arange(width), last[:, None]) % self.num_segments

    def _segment_at(self, s: Array) -> NDArray[np.intp]:
        """Segment at arc length ``s`` [m]: the first or last one beyond an open path's ends, counted on over laps."""
        laps = np.floor(s / self.length).astype(np.intp) if self.closed else 0
        place = s - laps * self.length
        found = np.searchsorted(self._knots[:-1], place, side="right") - 1
        return np.maximum(found, 0) + laps * self.num_segments

    def _nearest(self, xy: Array, candidates: NDArray[np.intp]) -> tuple[Array, Array]:
        """Arc length and cross-track of (N, 2) points on the nearest of their (N, K) candidate segments."""
        apart = xy[:, None] - self.points[candidates]
        along = np.einsum("nkc,nkc->nk", apart, self._directions[candidates])
        foot = np.clip(along, 0.0, self._lengths[candidates])
        left = _cross(self._directions[candidates], apart)
        distance = np.hypot(left, along - foot)
        row, best = np.arange(len(xy)), np.argmin(distance, axis=1)
        segment, along, foot = candidates[row, best], along[row, best], foot[row, best]
        left, distance = left[row, best], distance[row, best]
        # outside a corner sharper than a right angle the two segments may disagree on the side: their mean decides
        corner = np.where(along > foot, segment + 1, segment)
        mean = _cross(self._corners[corner], xy - self.points[corner % len(self.points)])
        side = np.where(along == foot, left, mean)
        cross_track = np.where(side < 0.0, -distance, distance)
        if not self.closed:
            ends = (corner == 0) | (corner == self.num_segments)
            cross_track = np.where(ends & (along != foot), left, cross_track)
        return self._on_path(self._knots[segment] + foot), cross_track


def _least_pieces(closed: bool) -> int:
    """Least segments of a path."""
    return 3 if closed else 1


def _pieces(length: float, spacing: float) -> int:
    """How many segments of about ``spacing`` [m] make ``length``."""
    check_range("spacing", spacing, "m", ge=CLOSEST)
    if length > MOST_POINTS * spacing:
        raise ValueError(
            f"a path of {length / 1e3:.6g} km with a point every {spacing:g} m has more than {MOST_POINTS:,} points; cut it,"
            f" or give a spacing of at least {1.05 * length / MOST_POINTS:.2g} m"  # two digits may be 5 % less
        )
    return max(round(length / spacing), 1)


def _cross(a: Array, b: Array) -> Array:
    """z of the cross product of vectors (..., 2)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
