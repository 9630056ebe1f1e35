"""Logs of a diagnosis: which there are, and which of them take part in the fit."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import Path

from aoro_gym.diagnosis.recording import SUFFIXES, Recording, logs_in
from aoro_gym.diagnosis.tables import Row, selected
from aoro_gym.recording.bags import is_bag


def log_files(paths: Sequence[Path] | None) -> list[Path]:
    """Logs of ``paths``, each a log or a folder of logs; ValueError if a folder holds none."""
    found: list[Path] = []
    for path in paths or []:
        logs = logs_in(path) if path.is_dir() and not is_bag(path) else [path]
        if not logs:
            raise ValueError(f"--healthy {path} holds no log: none that ends in {', '.join(SUFFIXES)}")
        found += logs
    return found


def split_recordings(
    recordings: Sequence[Recording], *, fit: Sequence[str] | None = None, holdout: Sequence[str] | None = None
) -> tuple[list[Recording], list[Recording]]:
    """Recordings to fit, and those that are held out.

    Args:
        recordings: All of them.
        fit: Names or globs of those to fit; the others are held out.
        holdout: Names or globs of those that are held out, without ``fit``; the others are fitted.

    Raises ValueError if a name is no recording's, or none is left to fit.
    """
    held_out = _matching("--holdout", holdout, recordings)
    if fit:
        chosen = _matching("--fit", fit, recordings)
        held_out = [one for one in recordings if not _contains(chosen, one)]
    used = [one for one in recordings if not _contains(held_out, one)]
    if not used:
        raise ValueError(f"--holdout {', '.join(holdout or [])} leaves no log to fit; leave one at least")
    return used, held_out


def split_rows(
    rows: Sequence[Row], *, fit: Sequence[str] | None = None, holdout: Sequence[str] | None = None
) -> tuple[list[Row], list[Row]]:
    """Rows of a table to fit, and those that are held out; as :func:`split_recordings`, with selections such as
    ``signal=100``."""
    held_out = selected("--holdout", holdout or [], rows)
    if fit:
        chosen = selected("--fit", fit, rows)
        held_out = [row for row in rows if row not in chosen]
    used = [row for row in rows if row not in held_out]
    if not used:
        raise ValueError(f"--holdout {', '.join(holdout or [])} leaves no row to fit; leave one at least")
    return used, held_out


def _matching(option: str, patterns: Sequence[str] | None, recordings: Sequence[Recording]) -> list[Recording]:
    """Recordings whose name matches any of ``patterns``, in the order of these."""
    chosen: list[Recording] = []
    for pattern in patterns or []:
        matching = [one for one in recordings if fnmatch(one.name, pattern)]
        if not matching:
            names = ", ".join(one.name for one in recordings)
            raise ValueError(f"{option} {pattern}: no log has that name; choose one of: {names}")
        chosen += [one for one in matching if not _contains(chosen, one)]
    return chosen


def _contains(recordings: Sequence[Recording], one: Recording) -> bool:
    """Whether ``one`` itself is among ``recordings``: equal names do not make two logs the same."""
    return any(one is other for other in recordings)
