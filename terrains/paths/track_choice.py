"""The choice of one of the tracks of a file: by name or number, never silently."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aoro_gym.terrains.io.frame import FARTHEST
from aoro_gym.terrains.paths.track_parts import find_parts
from aoro_gym.terrains.paths.tracks import MOST_LISTED, Track, display_text, length, metres, plan_points


def choose(tracks: Sequence[Track], wanted: str | int | None) -> tuple[Track, int | None, int]:
    """The track that is meant, which of its parts (None: not said), and its number from 1.

    Args:
        tracks: At least one.
        wanted: A name, a number from 1, or either with ``.N`` for a part of the track; of a single track, N is its part.
            None where there is no choice.

    Raises ``ValueError`` with the list of candidates where nothing says which one, or no one is called so.
    """
    if wanted is None:
        if len(tracks) == 1:
            return tracks[0], None, 1
        raise ValueError(f"it holds {_listed(tracks)}; say which with track=NAME or N (--track)")
    for word, part in _readings(wanted):
        found = [number for number, track in enumerate(tracks, 1) if isinstance(wanted, str) and track.name == word]
        if len(found) > 1:
            raise ValueError(
                f"{len(found)} tracks are called {display_text(word)}; say which by its number: {_listed(tracks)}"
            )
        if found:
            return tracks[found[0] - 1], part, found[0]
        if word.isdecimal() and len(word) < 10:
            number = int(word)
            if len(tracks) == 1 and part is None:
                return tracks[0], number, 1  # a part of the only track
            if 1 <= number <= len(tracks):
                return tracks[number - 1], part, number
    raise ValueError(f"no track is called {display_text(wanted)}; it holds {_listed(tracks)}")


def _readings(wanted: str | int) -> list[tuple[str, int | None]]:
    """The word whole, then as track and part."""
    word = str(wanted)
    track, dot, part = word.rpartition(".")
    readings: list[tuple[str, int | None]] = [(word, None)]
    if dot and part.isdecimal() and len(part) < 10:
        readings.append((track, int(part)))
    return readings


def _listed(tracks: Sequence[Track]) -> str:
    items = [f"{number} {_description(track)}" for number, track in enumerate(tracks[:MOST_LISTED], 1)]
    more = f" and {len(tracks) - MOST_LISTED} more" if len(tracks) > MOST_LISTED else ""
    return f"{_counted('track', len(tracks))}: {', '.join(items)}{more}"


def _description(track: Track) -> str:
    """Name, kind, points and length of a track, and what parts it."""
    points = plan_points(track)
    valid = np.flatnonzero(np.all(np.abs(points) <= FARTHEST, axis=1))
    said = [f"{track.size} points", metres(length(points[valid]))]
    if len(valid) > 1:
        cuts = find_parts(track.taken(valid), points[valid]).cuts
        gaps = [cut.gap for cut in cuts if cut.gap is not None]
        turns = len(cuts) - len(gaps)
        said += [f"{_counted('gap', len(gaps))} up to {metres(max(gaps))}"] if gaps else []
        said += [f"{_counted('turn', turns)} on the spot"] if turns else []
    return f"{track.title} ({', '.join(said)})"


def _counted(what: str, count: int) -> str:
    """A number of things in words."""
    return f"{count} {what}" if count == 1 else f"{count} {what}s"
