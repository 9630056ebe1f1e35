"""Parts of a recording that can be driven in one go: it is parted at gaps, and where it turns round on the spot."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from aoro_gym.terrains.paths.tracks import MOST_LISTED, Track, length, metres

Array = NDArray[Any]
Indices = NDArray[np.intp]

STANDSTILL = 0.15
"""Points [m] closer to the last one than this are the same place: several times the noise of RTK."""
FARTHEST_JUMP = 2.0
"""Points farther than this [m], and than five usual steps, from both of their neighbours are wrong ones."""
STRAY = 3
"""Most points in a row that can be wrong ones; more are a part of their own."""
GAP, GAP_STEPS = 5.0, 5.0
"""A step longer than this [m], and than so many of the longer usual ones (nine in ten are shorter), is a gap."""
FEW = 8
"""Steps from which on a usual one is known."""
SEGMENT_STEPS = 2.0
"""The same as ``GAP_STEPS`` between two segments, where the file itself says that something ended."""
TURN_REACH = 1.0
"""Length [m] before and after a place on which directions are compared, to tell whether the recording turns round."""
TURN_COSINES = (-0.9, -0.7)
"""Of the angle between the directions on that length, and on twice of it: 154° and 134° apart."""
NARROW_TURN_COSINE = -0.93
"""Of the same on three times of it alone: a way back beside the way out, about a metre away."""

STRAIGHT = 0.6
"""Share of a length driven by which it leads away where a recording turns round; where it stands and drifts, it does not."""

DENSE = 1.5
"""Usual step [m] up to which neighbouring points tell their noise, rather than the line's bends."""
QUIET = 0.15
"""Noise [m] of a coordinate that does not look like turning round."""
NOISE_OF_BEND = math.sqrt(6.0) * math.sqrt(2.0 * math.log(2.0))
"""Median length of a second difference of points, by the standard deviation of their independent noise."""


@dataclass(frozen=True)
class TrackBreak:
    """Where a recording is parted."""

    after: int
    """Index in the kept points of the last point before it; where it turns round, that point begins the next part, too."""
    gap: float | None
    """Width [m]; None where the recording turns round."""
    new_segment: bool = False
    """Whether the file begins a segment here."""


@dataclass(frozen=True, eq=False)
class TrackParts:
    """What of a track was driven, and how it falls into parts."""

    kept: Indices
    """Points that are neither standstill nor outliers."""
    standstill: int
    """Points left out because nothing moved."""
    outliers: Indices
    """Points left out because they jump away and back."""
    cuts: tuple[TrackBreak, ...]
    """In the order of the recording."""
    joined: tuple[float, ...]
    """Distances [m] between the file's segments where that is no gap."""

    @property
    def parts(self) -> list[Indices]:
        """Indices into the track of each part; those of a single point are no part."""
        return self._parted(self.cuts)

    @property
    def stretches(self) -> list[Indices]:
        """The parts between gaps, turns included."""
        return self._parted([cut for cut in self.cuts if cut.gap is not None])

    @property
    def gaps(self) -> list[TrackBreak]:
        return [cut for cut in self.cuts if cut.gap is not None]

    def turns_in(self, part: Indices) -> Indices:
        """Indices into the track of the points at which a part turns round."""
        turns = [self.kept[cut.after] for cut in self.cuts if cut.gap is None]
        return np.array([turn for turn in turns if part[0] < turn < part[-1]], dtype=np.intp)

    def with_gaps_joined(self) -> TrackParts:
        """The same, parted where it turns round only."""
        return replace(self, cuts=tuple(cut for cut in self.cuts if cut.gap is None))

    def _parted(self, cuts: Iterable[TrackBreak]) -> list[Indices]:
        first, found = 0, []
        for cut in cuts:
            found.append(self.kept[first : cut.after + 1])
            first = cut.after + (1 if cut.gap is not None else 0)
        found.append(self.kept[first:])
        return [part for part in found if len(part) > 1]


def find_parts(track: Track, points: Array, *, reach: float = TURN_REACH) -> TrackParts:
    """How a track with (P, 2) ``points`` [m] falls into parts; points that are not finite must be left out before.

    ``reach`` [m] is the length on which directions are compared.
    """
    moving = _moving(points)
    outliers = _outliers(points[moving])
    kept = moving[~outliers]
    step = np.hypot(*np.diff(points[kept], axis=0).T)
    usual = float(np.quantile(step, 0.9, method="lower")) if len(step) >= FEW else None
    widest = math.inf if usual is None else max(GAP, GAP_STEPS * usual)
    between = max(GAP, SEGMENT_STEPS * (usual or 0.0))
    begins = set(np.searchsorted(kept, track.starts[1:]).tolist())  # index in kept of the first point of a segment
    cuts = [TrackBreak(int(i), float(step[i]), int(i) + 1 in begins) for i in np.flatnonzero(step > widest)]
    cuts += [
        TrackBreak(int(i) - 1, float(step[i - 1]), True)
        for i in sorted(begins)
        if 0 < i < len(kept) and step[i - 1] > between
    ]
    cuts = sorted({cut.after: cut for cut in cuts}.values(), key=lambda cut: cut.after)
    gaps = {cut.after for cut in cuts}
    joined = tuple(float(step[i - 1]) for i in sorted(begins) if 0 < i < len(kept) and i - 1 not in gaps)
    first = 0
    turns: list[TrackBreak] = []
    for last in [*sorted(gaps), len(kept) - 1]:
        turns += [TrackBreak(first + i, None) for i in _turns(points[kept[first : last + 1]], reach)]
        first = last + 1
    whole = tuple(sorted([*cuts, *turns], key=lambda cut: cut.after))
    return TrackParts(kept, len(points) - len(moving), moving[outliers], whole, joined)


def describe_parts(track: Track, parts: TrackParts, points: Array) -> str:
    """The parts of a track by number, points and length, for a message."""
    found = parts.parts
    items = []
    for number, part in enumerate(found[:MOST_LISTED], 1):
        span = f"{track.number(int(part[0]))} to {track.number(int(part[-1]))}"
        items.append(f"{number} (points {span}, {metres(length(points[part]))})")
    more = f" and {len(found) - MOST_LISTED} more" if len(found) > MOST_LISTED else ""
    return ", ".join(items) + more


def describe_gaps(track: Track, parts: TrackParts) -> str:
    """Where the gaps are and how wide, for a message."""
    items = []
    gaps = parts.gaps
    for cut in gaps[:MOST_LISTED]:
        before, after = parts.kept[cut.after], parts.kept[cut.after + 1]
        if cut.new_segment:
            number = int(np.searchsorted(track.starts, after, side="right"))
            text = f"segment {number} begins {metres(cut.gap or 0.0)} from the end of segment {number - 1}"
        else:
            text = f"a gap of {metres(cut.gap or 0.0)}"
        items.append(f"{text} (after {track.place(int(before))})")
    more = f" and {len(gaps) - MOST_LISTED} more" if len(gaps) > MOST_LISTED else ""
    return ", ".join(items) + more


def _moving(points: Array) -> Indices:
    """Indices of the points that lie apart from the last one taken."""
    kept = [0]
    last_x, last_y = points[0].tolist()
    for i, (x, y) in enumerate(points.tolist()):
        if math.hypot(x - last_x, y - last_y) >= STANDSTILL:
            kept.append(i)
            last_x, last_y = x, y
    return np.array(kept, dtype=np.intp)


def _outliers(points: Array) -> NDArray[np.bool_]:
    """Few points in a row, far from those before and after, which are near to each other."""
    stray = np.zeros(len(points), dtype=bool)
    if len(points) < 5:
        return stray
    step = np.hypot(*np.diff(points, axis=0).T)
    far = step > max(FARTHEST_JUMP, 5.0 * float(np.median(step)))
    away = np.flatnonzero(far)
    for first, last in pairwise(away):
        if last - first > STRAY or stray[first]:
            continue
        across = np.hypot(*(points[last + 1] - points[first]))
        if across < 0.5 * min(step[first], step[last]):
            stray[first + 1 : last + 1] = True
    return stray


def _without_noise(points: Array) -> Array:
    """Dense points with their noise averaged down to ``QUIET``, so that its back and forth is no turning round."""
    step = np.hypot(*np.diff(points, axis=0).T)
    if len(points) < FEW or np.median(step) > DENSE:
        return points
    bend = np.hypot(*np.diff(points, 2, axis=0).T)
    noise = float(np.median(bend)) / NOISE_OF_BEND
    count = min(math.ceil((noise / QUIET) ** 2), len(points) // 4)
    return uniform_filter1d(points, count, axis=0, mode="nearest") if count > 1 else points


def _turns(points: Array, reach: float) -> list[int]:
    """Indices at which a line of moving points goes back the way it came."""
    if len(points) < 3:
        return []
    points = _without_noise(points)
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    inner = s[1:-1]

    def chords(length: float) -> tuple[Array, Array, Array]:
        """Cosines between the directions before and after each inner point, and the chords' lengths."""
        before, after = (
            np.stack([np.interp(np.clip(inner + side, 0.0, s[-1]), s, axis) for axis in points.T], axis=1)
            for side in (-length, length)
        )
        back, ahead = points[1:-1] - before, after - points[1:-1]
        sizes = np.hypot(*back.T), np.hypot(*ahead.T)
        product = np.maximum(sizes[0] * sizes[1], 1e-12)
        return np.sum(back * ahead, axis=1) / product, *sizes

    def leads_away(length: float, back: Array, ahead: Array) -> NDArray[np.bool_]:
        """Where something is driven on both sides, and goes somewhere."""
        sides = ((inner, back), (s[-1] - inner, ahead))
        return np.all(
            [(left >= 0.5 * reach) & (gone >= STRAIGHT * np.minimum(left, length)) for left, gone in sides], axis=0
        )

    near, _, _ = chords(reach)
    wide, back, ahead = chords(2.0 * reach)
    sharp = (near < TURN_COSINES[0]) & (wide < TURN_COSINES[1]) & leads_away(2.0 * reach, back, ahead)
    widest, back, ahead = chords(3.0 * reach)
    narrow = (widest < NARROW_TURN_COSINE) & leads_away(3.0 * reach, back, ahead)
    turning = np.flatnonzero(sharp | narrow)
    found: list[int] = []
    for group in np.split(turning, np.flatnonzero(np.diff(inner[turning]) > reach) + 1):
        if len(group):
            found.append(1 + int(group[np.argmax(np.minimum(back[group], ahead[group]))]))
    return found
