"""What a cloud holds, from its points alone: bounds, marks of "unknown" and "do not use", and which axis is up."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.terrains.io.check import Report, TerrainError
from aoro_gym.terrains.io.frame import LoadOptions, are_plausible
from aoro_gym.terrains.io.masking import CERTAIN, USUAL
from aoro_gym.terrains.length_units import LengthUnit

NOISE_CLASSES = (7, 18)
"""Low and high noise (ASPRS LAS 1.4)."""
FEW = 0.2
"""Share of the points up to which usual marks are few."""
APART = 10.0
"""Distance of a usual mark from all other heights, at least."""
MANY_ZEROS = 10
"""Points at exactly (0, 0, 0) from which these are missed echoes: a corner of a grid is at most eight triangles' own."""
STRAY_RANGE, STRAY_SHARE, FEW_STRAYS = 10.0, 1e-3, 3
"""Points beyond this many times the range of nearly all others are stray, if they are this few."""
SAMPLE = 20_000
"""Points by which the up axis and stray points are told, about."""
NEIGHBOURS = 50_000
"""Points one after another by which lost digits are told."""
THINNER = 3.0
"""How many times thinner a cloud is along the axis that is taken as up against z."""

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Chunk:
    """Some of a cloud's points."""

    points: Array
    """(n, 3) raw coordinates."""
    classes: NDArray[np.uint8] | None = None
    flags: dict[str, Mask] = field(default_factory=dict)
    """``withheld``, ``synthetic`` and ``overlap`` (n,), where a format has them."""


@dataclass(frozen=True)
class Cloud:
    """Points that can be read chunk by chunk, as often as wanted, and what is said of them."""

    count: int
    """As declared; 0 if nothing is."""
    chunks: Callable[[], Iterator[Chunk]]
    up: str | None = None
    """Axis that is up beyond doubt, by the specification of LAS or the names of columns."""
    rule: str = "z"
    """Axis that is up unless the points clearly say otherwise."""
    crs: Any = None
    unit: str | None = None
    """Of the plan, where no ``crs`` tells it."""
    z_unit: LengthUnit | None = None
    """Of heights, where it is declared beside the coordinate system."""
    steps: Array | None = None
    """(3,) steps of the coordinates, where the format declares them."""
    bounds: tuple[Array, Array] | None = None
    """Lowest and highest coordinates as the file declares them; never relied on."""


@dataclass(frozen=True)
class Survey:
    """Usable points of a cloud."""

    low: Array
    """(3,) lowest raw coordinates, and highest."""
    high: Array
    count: int
    up: str
    neighbours: Array
    """(k, 3) usable points that follow each other."""
    usable: Callable[[Chunk], Mask]
    """(n,) which points of a chunk count."""


@dataclass
class _PassStatistics:
    """What one pass over the points gives."""

    low: Array = field(default_factory=lambda: np.full(3, np.inf))
    high: Array = field(default_factory=lambda: np.full(3, -np.inf))
    read: int = 0
    count: int = 0
    doubtful: dict[float | None, tuple[int, Array, Array]] = field(default_factory=dict)
    """Points by the height that may mean "unknown" (None: at exactly 0, 0, 0): number, lowest and highest coordinates."""
    sample: list[Array] = field(default_factory=list)
    neighbours: list[Array] = field(default_factory=list)
    reasons: dict[str, int] = field(default_factory=dict)

    def reach(self, points: Array) -> None:
        """Extend the bounds."""
        if len(points):
            self.low = np.minimum(self.low, points.min(axis=0))
            self.high = np.maximum(self.high, points.max(axis=0))
            self.count += len(points)

    def doubt(self, key: float | None, points: Array) -> None:
        """Keep apart what may be no point at all."""
        if len(points):
            number, low, high = self.doubtful.get(key, (0, np.full(3, np.inf), np.full(3, -np.inf)))
            low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
            self.doubtful[key] = number + len(points), low, high


def survey(cloud: Cloud, request: LoadOptions, report: Report) -> Survey:
    """Bounds, count and up axis of the points that count; the others are counted in ``report`` by their reason."""
    up = request.up or cloud.up
    given = request.crs is not None or cloud.crs is not None
    tally = _pass_statistics(cloud, request, "xyz".index(up or "z"))
    if up is None:
        up = "z" if given else _guess_up(tally, cloud.rule, report)
        if up == "y":
            tally = _pass_statistics(cloud, request, 1)
    axis = "xyz".index(up)
    unknown = _unknown(tally, axis, request)
    box = _plan_bounds(tally, axis) if request.window is None else None
    strays = 0
    if box is not None and tally.count and (np.any(tally.low < box[0]) or np.any(tally.high > box[1])):
        inside = _pass_statistics(cloud, request, axis, box)
        strays = inside.reasons.get("stray", 0)
        if 0 < strays <= max(FEW_STRAYS, STRAY_SHARE * tally.count):
            tally = inside
            unknown = _unknown(tally, axis, request)
        else:
            box, strays = None, 0
    else:
        box = None
    _report_omitted(tally, unknown, strays, report)
    neighbours = np.concatenate([np.zeros((0, 3)), *tally.neighbours])

    def usable(chunk: Chunk) -> Mask:
        keep, _ = _marked(chunk)
        for key in unknown:
            keep &= ~_at_height(chunk.points, axis, key)
        if box is not None:
            keep &= np.all((chunk.points >= box[0]) & (chunk.points <= box[1]), axis=1)
        return keep

    return Survey(tally.low, tally.high, tally.count, up, neighbours, usable)


def _pass_statistics(
    cloud: Cloud, request: LoadOptions, axis: int, box: tuple[Array, Array] | None = None
) -> _PassStatistics:
    tally = _PassStatistics()
    marks = (None, *CERTAIN, *USUAL) if request.nodata is None else request.nodata
    for chunk in cloud.chunks():
        start = tally.read
        tally.read += len(chunk.points)
        request.tell(0.3 * min(1.0, tally.read / max(cloud.count, tally.read)))
        keep, reasons = _marked(chunk)
        for reason, number in reasons.items():
            tally.reasons[reason] = tally.reasons.get(reason, 0) + number
        points = chunk.points[keep]
        if box is not None:
            inside = np.all((points >= box[0]) & (points <= box[1]), axis=1)
            tally.reasons["stray"] = tally.reasons.get("stray", 0) + int((~inside).sum())
            points = points[inside]
        for key in marks:
            like = _at_height(points, axis, key)
            tally.doubt(key, points[like])
            points = points[~like]
        tally.reach(points)
        stride = max(1, cloud.count // SAMPLE)
        tally.sample.append(points[(-start) % stride :: stride].copy())
        lacking = NEIGHBOURS - sum(len(part) for part in tally.neighbours)
        if lacking > 0:
            tally.neighbours.append(points[:lacking].copy())
    return tally


def _marked(chunk: Chunk) -> tuple[Mask, dict[str, int]]:
    """Which points the file itself does not mark as unusable, and how many it does, by reason.

    Synthetic points and those where swaths overlap stay: the standard defines these flags as a description (of points not
    measured directly, and of where two swaths lie over each other), while withheld means deleted.
    """
    keep = are_plausible(chunk.points)
    reasons = {"broken": int((~keep).sum())}
    if chunk.classes is not None:
        noise = np.isin(chunk.classes, NOISE_CLASSES)
        reasons["noise"] = int((noise & keep).sum())
        keep &= ~noise
    for name, flag in chunk.flags.items():
        reasons[name] = int((flag & keep).sum())
        if name == "withheld":
            keep &= ~flag
    return keep, reasons


def _at_height(points: Array, axis: int, key: float | None) -> Mask:
    """(n,) which points stand at the height ``key``, or at exactly (0, 0, 0)."""
    if key is None:
        return np.asarray(np.all(np.abs(points) < 1e-6, axis=1))
    return np.abs(points[:, axis] - key) < 1e-6 * max(1.0, abs(key))


def _unknown(tally: _PassStatistics, axis: int, request: LoadOptions) -> list[float | None]:
    """The heights that mean "unknown", and None for points at (0, 0, 0) that are none; others extend the bounds."""
    if request.nodata is not None:
        return list(tally.doubtful)
    meant: list[float | None] = []
    low, high = tally.low.copy(), tally.high.copy()
    size = high - low
    for key, (number, lowest, highest) in tally.doubtful.items():
        if not tally.count:
            apart = True
        elif key is None:
            outside = np.maximum(np.maximum(low, -high), 0.0)
            apart = number >= MANY_ZEROS or float(np.linalg.norm(outside)) > 0.5 * float(np.linalg.norm(size))
        else:
            gap = max(low[axis] - key, key - high[axis])
            few = key in CERTAIN or number <= FEW * tally.count
            apart = few and gap > max(size[axis], 0.0 if key in CERTAIN else APART)
        if apart:
            meant.append(key)
        else:
            tally.low, tally.high = np.minimum(tally.low, lowest), np.maximum(tally.high, highest)
            tally.count += number
    return meant


def _plan_bounds(tally: _PassStatistics, axis: int) -> tuple[Array, Array] | None:
    """Lowest and highest coordinates in plan beyond which points are stray; heights have no bound."""
    sample = np.concatenate([np.zeros((0, 3)), *tally.sample])
    if len(sample) < 100:
        return None
    low, high = np.percentile(sample, [1, 99], axis=0)
    reach = STRAY_RANGE * np.maximum(high - low, 1e-9)
    low, high = low - reach, high + reach
    low[axis], high[axis] = -np.inf, np.inf
    return low, high


def _guess_up(tally: _PassStatistics, rule: str, report: Report) -> str:
    """``rule`` (y or z), unless points of a patch seen along the other lie much closer together."""
    points = np.concatenate([np.zeros((0, 3)), *tally.sample])
    if len(points) < 100:
        return rule
    other = "y" if rule == "z" else "z"
    thick = {axis: _thickness(points, "xyz".index(axis)) for axis in "yz"}
    size = dict(zip("xyz", np.subtract(*np.percentile(points, [99, 1], axis=0)), strict=True))
    if not (THINNER * thick[other] < thick[rule] and size[other] < 0.5 * min(size["x"], size[rule])):
        return rule
    report.up = f"{other} (thinnest along it)"
    text = f"{other} taken as up: patches are {thick[other]:.3g} thick along {other} and {thick[rule]:.3g} along {rule}"
    report.change("up", 1, f"{text}; up='{rule}' keeps {rule}")
    return other


def _thickness(points: Array, axis: int) -> float:
    """Median range along ``axis`` of the points in patches of about ten."""
    plan = np.delete(points, axis, axis=1)
    low, high = np.percentile(plan, [1, 99], axis=0)
    side = np.sqrt(max(float(np.prod(high - low)), 1e-30) * 10.0 / len(points))
    patch = np.unique(np.floor((np.clip(plan, low, high) - low) / side), axis=0, return_inverse=True)[1].reshape(-1)
    order = np.lexsort((points[:, axis], patch))
    first = np.flatnonzero(np.concatenate([[True], np.diff(patch[order]) > 0]))
    last = np.append(first[1:], len(order)) - 1
    enough = last - first >= 2
    if not enough.any():
        return float("inf")
    heights = points[order, axis]
    return float(np.median((heights[last] - heights[first])[enough]))


def _report_omitted(tally: _PassStatistics, unknown: list[float | None], strays: int, report: Report) -> None:
    """Count in ``report`` what was left out, and what was kept though it is marked."""
    report.points_read = tally.read
    reasons = tally.reasons
    zeros = tally.doubtful[None][0] if None in unknown else 0
    heights = {key: tally.doubtful[key][0] for key in unknown if key is not None}
    number, values = sum(heights.values()), ", ".join(f"{key:g}" for key in heights)
    for what, count, text in (
        ("broken_points", reasons.get("broken", 0), "points without finite coordinates left out"),
        ("noise_points", reasons.get("noise", 0), "points of the noise classes (7, 18) left out"),
        ("withheld_points", reasons.get("withheld", 0), "points marked as withheld left out"),
        ("unknown_heights", number, f"points of height {values}, which stands for unknown, left out"),
        ("zero_points", zeros, "points at exactly (0, 0, 0), which stand for missed echoes, left out"),
        ("stray_points", strays, "points far away from all others left out"),
        ("synthetic_points", reasons.get("synthetic", 0), "points marked as synthetic kept"),
        ("overlap_points", reasons.get("overlap", 0), "points marked as overlap of swaths kept"),
    ):
        report.change(what, count, f"{count:,} {text}")
    if not tally.count and tally.read:
        lost = f"{reasons.get('broken', 0):,} have no finite coordinates, {reasons.get('noise', 0):,} are noise,"
        lost += f" {reasons.get('withheld', 0):,} are withheld, {number + zeros:,} stand for unknown"
        raise TerrainError(f"{report.source}: none of its {tally.read:,} points is usable: {lost}")
