"""Tracks: the lines that a file of recorded or drawn places holds."""

from __future__ import annotations

import reprlib
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

LONGEST_NAME = 40
"""Characters of a file's word that a message repeats."""
MOST_LISTED = 5
"""Candidates that a message lists."""
EQUATOR_RADIUS, ECCENTRICITY_SQUARED = 6_378_137.0, 6.694_38e-3
"""Of WGS 84 [m], [-]."""


@dataclass(frozen=True, eq=False)
class Track:
    """One line of a file, as it stands there."""

    kind: str
    """Such as ``GPX track``."""
    name: str
    """Empty if the file gives none."""
    columns: dict[str, Array]
    """(P,) each: ``latitude`` and ``longitude`` [deg], or ``x`` and ``y`` [m, or the unit of ``crs``]; ``speed`` [m/s]."""
    starts: tuple[int, ...] = (0,)
    """Indices at which its segments begin."""
    lines: NDArray[np.intp] | None = None
    """(P,) lines of the file; None where it has none."""
    numbers: NDArray[np.intp] | None = None
    """(P,) numbers of the points in the file, from 1; None where all are here."""
    crs: str | None = None
    """Coordinate reference system of ``x`` and ``y``, where the file tells."""
    is_surely_degrees: bool = True
    """Whether latitude and longitude are what a header or the format says, rather than what GeoJSON has by default."""

    @property
    def title(self) -> str:
        """How messages call it."""
        return f"{self.kind} {display_text(self.name)}" if self.name else self.kind

    @property
    def size(self) -> int:
        """Number of points."""
        return len(next(iter(self.columns.values())))

    def place(self, index: int) -> str:
        """How messages call one of its points."""
        line = "" if self.lines is None else f" (line {self.lines[index]})"
        return f"point {self.number(index)}{line}"

    def number(self, index: int) -> int:
        """Number of a point in the file, from 1."""
        return index + 1 if self.numbers is None else int(self.numbers[index])

    def taken(self, chosen: NDArray[np.intp], keys: Sequence[str] | None = None) -> Track:
        """The same with the points at ``chosen`` (in their order) only, and with these columns only."""
        numbers = np.arange(1, self.size + 1) if self.numbers is None else self.numbers
        starts = np.unique(np.searchsorted(chosen, self.starts))
        return replace(
            self,
            columns={key: values[chosen] for key, values in self.columns.items() if keys is None or key in keys},
            starts=(0, *(int(start) for start in starts if 0 < start < len(chosen))),
            lines=None if self.lines is None else self.lines[chosen],
            numbers=numbers[chosen],
        )


class TrackFile(list[Track]):
    """The tracks of a file, and what there is to say of its reading."""

    def __init__(self, tracks: Iterable[Track] = ()) -> None:
        super().__init__(tracks)
        self.unread: Counter[str] = Counter()
        """What else the file holds, by its kind."""
        self.other = ""
        """The same in words."""
        self.assumed: list[str] = []
        """What the file does not say."""
        self.warnings: list[str] = []


def display_counts(kinds: Counter[str]) -> str:
    """Kinds with their numbers, for a message."""
    return ", ".join(f"{count} x {kind}" for kind, count in kinds.items() if count)


def display_text(text: object) -> str:
    """A word or value of the file for a message: on one line, not too long."""
    word = repr(text) if isinstance(text, str) else reprlib.repr(text)
    return word if len(word) <= LONGEST_NAME + 2 else f"{word[:LONGEST_NAME]}…{word[-1]}"


def plan_points(track: Track) -> Array:
    """(P, 2) about east and north [m] of its points, from their middle: good for lengths and gaps, not for driving."""
    if "latitude" not in track.columns:
        return np.stack([track.columns["x"], track.columns["y"]], axis=1).astype(np.float64)
    degrees = np.stack([track.columns["latitude"], track.columns["longitude"]])
    latitude, longitude = np.radians(np.where(np.isfinite(degrees), degrees, np.nan))
    whole = np.flatnonzero(np.isfinite(latitude + longitude))
    if not len(whole):
        return np.full((track.size, 2), np.nan)
    middle, first = float(np.median(latitude[whole])), longitude[whole[0]]
    east = (longitude - first + np.pi) % (2.0 * np.pi) - np.pi  # across the date line, too
    flat = 1.0 - ECCENTRICITY_SQUARED * np.sin(middle) ** 2
    across = EQUATOR_RADIUS / np.sqrt(flat)  # radii of curvature there, along the parallel and along the meridian
    along = across * (1.0 - ECCENTRICITY_SQUARED) / flat
    return np.stack([across * np.cos(middle) * east, along * (latitude - middle)], axis=1)


def length(points: Array) -> float:
    """Length [m] of a line through (P, 2) points, of the finite ones."""
    whole = points[np.isfinite(points).all(axis=1)]
    return float(np.hypot(*np.diff(whole, axis=0).T).sum())


def metres(value: float) -> str:
    """A length for a message."""
    return f"{value:.1f} m" if value < 1000.0 else f"{value / 1000.0:,.1f} km"
