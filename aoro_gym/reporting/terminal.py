"""What a person sees of a command: consoles, progress, warnings.

In a terminal progress is one bar. Elsewhere it is a line after two seconds and then every ten, so that a log file tells a
run that goes on from one that hangs; what is over sooner leaves none. With ``--quiet`` there is neither.
"""

from __future__ import annotations

import math
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.markup import escape
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
from rich.table import Column, Table
from rich.text import Text

SOON, EVERY = 2.0, 10.0
"""Times [s] to the first line of progress, and between two of them, where there is no terminal."""
BAR_WIDTH = 20
"""Of a bar [characters]: the rest of 80 columns is for words."""
PIPE_WIDTH = 200
"""Least width [characters] of tables where there is no terminal: nothing is folded for a file."""
LEAST_WINDOW = 20.0
"""Least time [s] of the past that an estimate of the rest goes by."""

Tell = Callable[..., None]
"""``tell(what, share, detail="")``: what is being done, the share of everything that is done, and figures of it."""

_quiet = False


def set_quiet(quiet: bool) -> bool:
    """Show no progress from here on, or show it; returns ``quiet``, as a callback of an option has to."""
    global _quiet
    _quiet = quiet
    return quiet


def is_quiet() -> bool:
    """Whether no progress is shown."""
    return _quiet


def out() -> Console:
    """Standard output; wide where it is no terminal."""
    if sys.stdout.isatty():
        return Console()
    return Console(width=max(PIPE_WIDTH, shutil.get_terminal_size().columns))


def err() -> Console:
    """Standard error."""
    return Console(stderr=True)


def warn(text: str) -> None:
    """A warning of one line."""
    err().print(f"[yellow]warning:[/] {escape(' '.join(text.split()))}", soft_wrap=True, highlight=False)


def labelled(what: str, items: Sequence[str]) -> str:
    """A line of markup that names ``items``, or says that there are none."""
    return escape(f"{what}: {', '.join(items) if items else 'none'}")


def clock(seconds: float | None) -> str:
    """A time as ``m:ss`` or ``h:mm:ss``; ``--:--`` where it is not known."""
    if seconds is None or not math.isfinite(seconds):
        return "--:--"
    minutes, rest = divmod(math.ceil(max(seconds, 0.0)), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


class Comparison:
    """A table that fits the console: where its columns don't stand beside each other, some stand below, after the leading
    ones again. Names are shown as they are, whatever markup they hold.

    Args:
        title: Above it.
        head: Of the columns.
        rows: As many cells each, strings or styled text.
        lead: Leading columns that say what a row is; the others hold values.
        note: Below it.
    """

    LEAD_SHARE, HEAD_WORD = 0.4, 14
    """Most of a narrow console that leading columns take, and characters of a head's words before they are folded."""

    def __init__(
        self,
        title: str,
        head: Sequence[str],
        rows: Sequence[Sequence[str | Text]],
        *,
        lead: int = 1,
        note: str = "",
    ):
        self.title, self.head, self.rows, self.lead, self.note = title, head, list(rows), lead, note

    def add(self, *cells: str | Text) -> None:
        """A further row."""
        self.rows.append(cells)

    @property
    def row_count(self) -> int:
        """Rows below the head."""
        return len(self.rows)

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        columns = range(len(self.head))
        widths = [max([cell_len(self.head[k]), *self._lengths(k)]) for k in columns]
        if sum(widths) + _borders(len(widths)) <= options.max_width:
            yield self._table(list(columns), widths, self.title)
        else:
            for k, (group, narrow) in enumerate(self._groups(widths, options.max_width)):
                yield self._table(group, narrow, self.title if k == 0 else "")
        if self.note:
            yield Text(self.note, style="dim")

    def _lengths(self, column: int) -> list[int]:
        return [cell_len(line) for row in self.rows for line in str(row[column]).split("\n")]

    def _groups(self, widths: Sequence[int], room: int) -> Iterator[tuple[list[int], list[int]]]:
        """Columns that stand beside each other, and their widths."""
        lead = list(range(self.lead))
        spare = int(self.LEAD_SHARE * room) - sum(widths[k] for k in lead[1:])
        narrow = [max(min(widths[0], spare), 8), *(widths[k] for k in lead[1:])]
        left = room - sum(narrow) - _borders(self.lead)
        group: list[int] = []
        sizes: list[int] = []
        for k in range(self.lead, len(widths)):
            words = [min(cell_len(word), self.HEAD_WORD) for word in self.head[k].split()]
            size = min(max([1, *words, *self._lengths(k)]), left - 3)
            if group and sum(sizes) + size + 3 * (len(sizes) + 1) > left:
                yield [*lead, *group], [*narrow, *sizes]
                group, sizes = [], []
            group.append(k)
            sizes.append(size)
        yield [*lead, *group], [*narrow, *sizes]

    def _table(self, columns: Sequence[int], widths: Sequence[int], title: str) -> Table:
        drawn = Table(title=Text(title) if title else None, title_justify="left", header_style="bold")
        for k, width in zip(columns, widths, strict=True):
            side = "left" if k < self.lead else "right"
            drawn.add_column(Text(self.head[k]), justify=side, overflow="fold", width=width)
        for row in self.rows:
            drawn.add_row(*(cell if isinstance(cell := row[k], Text) else Text(cell) for k in columns))
        return drawn


def _borders(count: int) -> int:
    """Characters around so many columns."""
    return 3 * count + 1


class ProgressEstimate:
    """How far a command has come, and how long the rest may take.

    Args:
        what: What is being done at first.
        now: The clock [s].
    """

    def __init__(self, what: str, now: Callable[[], float] = time.monotonic):
        self.what, self.detail, self.share = what, "", 0.0
        self._now = now
        self._known: list[tuple[float, float]] = []

    def tell(self, what: str, share: float | None, detail: str = "") -> None:
        """Take note of what is being done and of the share [-] of everything that is done: it never falls; None leaves it
        as it was. ``detail`` are figures to show beside."""
        self.what, self.detail = what, detail
        if share is None or not math.isfinite(share):
            return
        self.share = min(max(share, self.share), 1.0)
        if not self._known or self.share >= self._known[-1][1] + 1e-3:
            self._known.append((self._now(), self.share))

    def remaining(self) -> float | None:
        """Time [s] that the rest takes at the pace of the latter half of the time so far, or of all of it where nothing came
        forward since; None before two shares are known. What an earlier run did counts for nothing."""
        if len(self._known) < 2:
            return None
        now = self._now()
        began = self._known[0][0]
        window = max(0.5 * (now - began), LEAST_WINDOW)
        before = [one for one in self._known if one[0] <= now - window]
        for since, share in (before[-1] if before else self._known[0], self._known[0]):
            if self.share > share and now > since:
                return (1.0 - self.share) * (now - since) / (self.share - share)
        return None

    def line(self) -> str:
        """Of a log."""
        text = f"{self.what}: {100.0 * self.share:.0f} %, {clock(self.remaining())} left"
        return f"{text}, {self.detail}" if self.detail else text


@contextmanager
def progress(what: str) -> Iterator[Tell]:
    """Progress of a command: a bar in a terminal, lines elsewhere, nothing if quiet. Gives whom to tell how far it is."""
    track = ProgressEstimate(what)
    if _quiet:
        yield track.tell
        return
    console = err()
    shown = _bar(console, track) if sys.stderr.isatty() and not console.is_dumb_terminal else _lines(track)
    with shown as tell:
        yield tell


@contextmanager
def _bar(console: Console, track: ProgressEstimate) -> Iterator[Tell]:
    words = Column(overflow="fold", no_wrap=False)
    columns = (
        TextColumn("{task.description}", markup=False, table_column=words),
        BarColumn(bar_width=BAR_WIDTH),
        _RemainingColumn(track),
    )
    both = {"redirect_stdout": sys.stdout.isatty(), "redirect_stderr": True}
    with Progress(*columns, console=console, transient=True, **both) as bar:
        task = bar.add_task(track.what, total=1.0)

        def tell(what: str, share: float | None, detail: str = "") -> None:
            track.tell(what, share, detail)
            bar.update(task, description=f"{what}\n{detail}" if detail else what, completed=track.share)

        yield tell


class _RemainingColumn(ProgressColumn):
    """Share done and time left."""

    def __init__(self, track: ProgressEstimate):
        super().__init__(table_column=Column(no_wrap=True, justify="right"))
        self._track = track

    def render(self, task: Task) -> Text:
        return Text(f"{100.0 * self._track.share:3.0f} % {clock(self._track.remaining()):>7}")


@contextmanager
def _lines(track: ProgressEstimate) -> Iterator[Tell]:
    over = threading.Event()

    def write() -> None:
        wait = min(SOON, EVERY)
        while not over.wait(wait):
            wait = EVERY
            try:
                print(track.line(), file=sys.stderr, flush=True)
            except (OSError, ValueError):  # nobody reads any more
                return

    writer = threading.Thread(target=write, name="progress", daemon=True)
    writer.start()
    try:
        yield track.tell
    finally:
        over.set()
        writer.join()


def within(tell: Tell, begin: float, end: float) -> Tell:
    """Tells of a part that is from the share ``begin`` to ``end`` of the whole."""
    return lambda what, share, detail="": tell(what, begin + (end - begin) * share, detail)


def learning(tell: Tell, what: str) -> Callable[[Any], None]:
    """Takes reports of a training (:class:`aoro_gym.agents.training.callbacks.Progress`) and tells them on."""
    parts: dict[str, ProgressEstimate] = {}

    def report(now: Any) -> None:
        if now.part is not None:
            part = parts.setdefault(now.doing, ProgressEstimate(now.doing))
            part.tell(now.doing, now.part)
            detail = f"{100.0 * part.share:.0f} % of that, {clock(part.remaining())} left" if now.part else ""
            tell(f"{what}, {now.doing}", None, detail)
            return
        detail = f"{now.steps:,} of {now.total:,} steps, {now.steps_per_s:,.0f} a second"
        if math.isfinite(now.episode_return):
            detail += f", return {now.episode_return:.4g}, success {now.success:.0%}"
        tell(f"{what}, {now.doing}", now.steps / now.total if now.total else None, detail)

    return report
