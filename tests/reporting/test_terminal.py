"""Progress: shares never fall, estimates are numbers once two shares are known, lines come where there is no terminal."""

import io
import math
import re
import time
from typing import Any

import pytest
from rich.console import Console
from rich.text import Text

from aoro_gym.agents.training.callbacks import Progress
from aoro_gym.reporting import terminal


class Clock:
    """Time that is set by hand."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def track() -> tuple[terminal.ProgressEstimate, Clock]:
    clock = Clock()
    return terminal.ProgressEstimate("working", clock), clock


@pytest.mark.parametrize(
    ("seconds", "shown"),
    [(None, "--:--"), (math.nan, "--:--"), (math.inf, "--:--"), (-1.0, "0:00"), (0.2, "0:01"), (60.0, "1:00"),
     (3599.0, "59:59"), (3600.0, "1:00:00"), (36_061.0, "10:01:01")],
)  # fmt: skip
def test_clock(seconds, shown):
    assert terminal.clock(seconds) == shown


def test_nothing_known_is_no_number(track):
    track, clock = track
    assert track.remaining() is None
    track.tell("begun", 0.0)
    clock.now += 5.0
    track.tell("still", None)
    assert track.remaining() is None
    assert track.line() == "still: 0 %, --:-- left"


def test_a_steady_pace_is_foreseen(track):
    track, clock = track
    for k in range(11):
        track.tell("half", 0.05 * k)
        clock.now += 6.0
    clock.now -= 6.0
    assert track.remaining() == pytest.approx(60.0)
    clock.now += 30.0  # nothing comes forward: the pace falls
    assert 60.0 < track.remaining() < math.inf


def test_what_an_earlier_run_did_counts_for_nothing(track):
    track, clock = track
    track.tell("resumed", 0.9)
    clock.now += 100.0
    track.tell("resumed", 0.95)
    assert track.remaining() == pytest.approx(100.0)


def test_the_latter_half_counts(track):
    track, clock = track
    track.tell("kept", 0.0)
    clock.now += 1.0
    track.tell("kept", 0.5)
    for k in range(1, 101):
        clock.now += 1.0
        track.tell("slow", 0.5 + 0.001 * k)
    assert track.remaining() == pytest.approx(400.0, rel=0.05)


def test_a_share_never_falls_nor_passes_one(track):
    track, _ = track
    shares = []
    for share in (0.3, 0.1, math.nan, 0.4, 7.0, 0.0):
        track.tell("x", share)
        shares.append(track.share)
    assert shares == [0.3, 0.3, 0.3, 0.4, 1.0, 1.0]


def test_within_is_a_part_of_the_whole():
    told = []
    tell = terminal.within(lambda what, share, detail="": told.append((what, share, detail)), 0.5, 0.75)
    tell("a", 0.0)
    tell("b", 1.0, "c")
    assert told == [("a", 0.5, ""), ("b", 0.75, "c")]


def test_a_training_tells_steps_and_returns():
    told = []
    report = terminal.learning(lambda *what: told.append(what), "turning")
    report(Progress(steps=0, total=0, steps_per_s=0.0, episode_return=math.nan, success=math.nan, doing="learning"))
    report(Progress(steps=500, total=2000, steps_per_s=99.6, episode_return=1.25, success=0.5, doing="learning"))
    assert told[0][1] is None
    assert told[1] == ("turning, learning", 0.25, "500 of 2,000 steps, 100 a second, return 1.25, success 50%")


def test_what_comes_before_the_first_step_has_a_share_of_its_own():
    told: list[Any] = []
    report = terminal.learning(lambda *what: told.append(what), "forests")
    for part in (0.0, 0.25):
        report(Progress(0, 0, 0.0, math.nan, math.nan, "drawing maps", part))
    name, share, detail = told[1]
    assert (name, share) == ("forests, drawing maps", None)
    assert re.fullmatch(r"25 % of that, \d+:\d\d left", detail)


def test_lines_of_a_pipe(capsys, monkeypatch):
    monkeypatch.setattr(terminal, "EVERY", 0.02)
    with terminal.progress("begun") as tell:
        time.sleep(0.1)  # a command that tells nothing for long is alive, too
        tell("[/x] half", 0.5, "12 of 24")
        time.sleep(0.1)
    first, *_, last = capsys.readouterr().err.splitlines()
    assert first == "begun: 0 %, --:-- left"
    assert re.fullmatch(r"\[/x\] half: 50 %, \S+ left, 12 of 24", last)


def test_short_commands_and_quiet_ones_leave_no_line(capsys, monkeypatch):
    with terminal.progress("begun") as tell:
        tell("done", 1.0)
    monkeypatch.setattr(terminal, "EVERY", 0.02)
    monkeypatch.setattr(terminal, "_quiet", True)
    with terminal.progress("begun") as tell:
        time.sleep(0.1)
        tell("done", 1.0)
    assert capsys.readouterr() == ("", "")


NAMES = ("policy", "[/x] $a$", "a/very/long/path/of/a/policy/that/somebody/has/trained/best", "c", "d", "e")


def shown(width: int, **options: Any) -> list[str]:
    rows = [[f"figure {k}, of successes", "m/s", *(f"{k}.123 [0.111, 0.135]" for _ in NAMES)] for k in range(3)]
    console = Console(file=io.StringIO(), width=width)
    console.print(terminal.Comparison("title [/y]", ["mean", "unit", *NAMES], rows, lead=2, **options))
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue().splitlines()


@pytest.mark.parametrize("width", [40, 60, 80, 120, 400])
def test_tables_fit_and_cut_nothing(width):
    lines = shown(width, note="note [/z]")
    assert max(map(len, lines)) <= width
    assert not any("…" in line for line in lines)
    text = "".join(lines)
    assert "title [/y]" in text and "note [/z]" in text
    for name in NAMES:
        letters = [line.split("┃") for line in lines if "┃" in line]
        heads = "".join(part.strip() for cells in letters for part in cells)
        assert set(name.replace(" ", "")) <= set(heads)
    assert text.count("2.123 [0.111, 0.135]") == len(NAMES) or width < 60
    assert sum(line.startswith("┏") for line in lines) == {40: 6, 60: 6, 80: 3, 120: 2, 400: 1}[width]


def test_what_is_styled_and_what_has_lines_fits_too():
    table = terminal.Comparison("t", ["what", "mark"], [], note="")
    table.add("first\nsecond line", Text("missed", style="red"))
    console = Console(file=io.StringIO(), width=30)
    console.print(table)
    assert isinstance(console.file, io.StringIO)
    assert "│ second line │ " in console.file.getvalue() and table.row_count == 1
