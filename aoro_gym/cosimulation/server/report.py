"""What a server tells of its run: a table, a log, JSON."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import IO, Any

from aoro_gym.cosimulation.realtime import PERCENTILES
from aoro_gym.cosimulation.server.server import LogRow
from aoro_gym.reporting.terminal import Comparison

LOG, EVENTS, RESULT = "serve.csv", "events.log", "serve.json"
"""Files in a folder of results."""


def tables(result: Mapping[str, Any]) -> list[Comparison]:
    """Tables of what :meth:`.server.Server.to_json` gives."""
    rows = [
        ("mode", result["mode"]),
        ("ended", result["ended"]),
        ("simulated, wall", f"{result['simulated_s']:.3f} s, {result['wall_s']:.3f} s"),
        ("commands and grants", f"{result['commands_and_grants']}"),
        ("dropped datagrams", ", ".join(f"{count} {reason}" for reason, count in result["dropped"].items()) or "none"),
        ("watchdog", f"{result['watchdog']['trips']} times, {1e3 * result['watchdog']['slowest_s']:.1f} ms at most"),
        ("blocks of sentences", f"{result['sentences']['blocks']} sent, {result['sentences']['missed_blocks']} missed"),
        (
            "resident memory",
            f"{result['resident_MB']['start']:.1f} MB, {result['resident_MB']['end']:.1f} MB at the end",
        ),
    ]
    tracking = result.get("tracking")
    if tracking and tracking["cross_track_rms_m"] is not None:
        rows += [
            (
                "path",
                f"{tracking['driven_m']:.1f} m driven, end {'reached' if tracking['reached_end'] else 'not reached'}",
            ),
            (
                "cross-track error",
                f"{tracking['cross_track_rms_m']:.4f} m rms, {tracking['cross_track_largest_m']:.3f} m at most",
            ),
        ]
    found = [Comparison("session", ("what", "value"), rows)]
    deadlines = result.get("deadlines")
    if deadlines:
        head = ("lateness [µs]", *(f"{percent:g} %" for percent in PERCENTILES), "worst")
        lateness = [
            (name, *(f"{value:.0f}" for value in deadlines[key].values()))
            for name, key in (("start of a step", "start_lateness"), ("end after the next start", "end_lateness"))
        ]
        missed = (
            f"{deadlines['missed_deadlines']} of {deadlines['steps']} deadlines missed ({deadlines['missed_share']:.3%}),"
            f" clock set anew {deadlines['resynchronised']} times"
        )
        found.append(Comparison("deadlines", head, lateness, note=missed))
    return found


class Log:
    """Rows of a log and events, written as they come.

    Args:
        folder: Where to; None: nowhere.
        on_event: Also told each event.
    """

    def __init__(self, folder: Path | None, on_event: Callable[[str], None] = lambda _: None):
        self._on_event = on_event
        self._rows: Any = None
        self._files: list[IO[str]] = []
        self._events: IO[str] | None = None
        if folder is None:
            return
        folder.mkdir(parents=True, exist_ok=True)
        table = open(folder / LOG, "w", encoding="utf-8", newline="")  # noqa: SIM115 (closed by close)
        self._events = open(folder / EVENTS, "w", encoding="utf-8")  # noqa: SIM115
        self._files = [table, self._events]
        self._rows = csv.writer(table, lineterminator="\n")
        self._rows.writerow([one.name for one in fields(LogRow)])

    def row(self, row: LogRow) -> None:
        """Write a row."""
        if self._rows is not None:
            self._rows.writerow(asdict(row).values())
            self._files[0].flush()

    def event(self, text: str) -> None:
        """Write and tell an event."""
        if self._events is not None:
            self._events.write(text + "\n")
            self._events.flush()
        self._on_event(text)

    def close(self) -> None:
        for file in self._files:
            file.close()
