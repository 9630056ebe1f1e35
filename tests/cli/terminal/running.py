"""Commands as a person runs them: under a pseudo-terminal of 80 columns, and through a pipe."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from pathlib import Path
from typing import NamedTuple

import aoro_gym

COLUMNS = 80
HERE = {"PYTHONPATH": str(Path(aoro_gym.__file__).parents[1])}
ENVIRONMENT = {
    name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES", "FORCE_COLOR")
} | HERE
ERASED = "\x1b[2K"
"""What a bar is drawn with."""
ESCAPES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]|\x1b\][^\x07]*\x07")


class Shown(NamedTuple):
    """What a command left: its exit code, and all that a terminal got."""

    code: int
    raw: str

    @property
    def text(self) -> str:
        """Without what moves the cursor or colours."""
        return ESCAPES.sub("", self.raw).replace("\r\n", "\n")

    @property
    def lines(self) -> list[str]:
        """As they stood on the screen, with those that were written over."""
        return [line for part in self.text.split("\n") for line in part.split("\r")]


def in_terminal(
    *arguments: object, folder: Path, interrupt: str | None = None, after: float = 0.0, limit: float = 600.0
) -> Shown:
    """Run the command under a pseudo-terminal; Ctrl-C is pressed ``after`` so many seconds once ``interrupt`` stands on the
    screen."""
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, COLUMNS, 0, 0))

    def lead() -> None:
        os.setsid()
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)
        signal.signal(
            signal.SIGINT, signal.SIG_DFL
        )  # tests that run in the background ignore it, and so would the command

    command = [sys.executable, "-m", "aoro_gym", *map(str, arguments)]
    environment = {**ENVIRONMENT, "TERM": "xterm", "NO_COLOR": "1"}
    process = subprocess.Popen(
        command, stdin=slave, stdout=slave, stderr=slave, cwd=folder, env=environment, preexec_fn=lead, close_fds=True
    )
    os.close(slave)
    found, until, press = b"", time.monotonic() + limit, None
    while True:
        ready, _, _ = select.select([master], [], [], max(0.0, min(1.0, until - time.monotonic())))
        if ready:
            try:
                part = os.read(master, 65536)
            except OSError:  # Linux: nobody holds the other end any more
                part = b""
            if not part:
                break
            found += part
            if interrupt is not None and interrupt in found.decode(errors="replace"):
                interrupt, press = None, time.monotonic() + after
        if press is not None and time.monotonic() >= press:
            os.write(master, b"\x03")
            press = None
        if time.monotonic() > until:
            os.killpg(process.pid, signal.SIGKILL)
            break
    os.close(master)
    return Shown(process.wait(), found.decode(errors="replace"))


def in_pipe(*arguments: object, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the command with its outputs in pipes."""
    command = [sys.executable, "-m", "aoro_gym", *map(str, arguments)]
    return subprocess.run(
        command, cwd=folder, env={**ENVIRONMENT, **environment}, capture_output=True, text=True, check=False
    )


TURNING = ("--env", "AORO/Turning-v0")
BOXES = "│┃┏┡└┌╭"


def checked(shown: Shown) -> str:
    """Text of a command that went well: no table is wider than the terminal, or cut."""
    assert shown.code == 0, shown.text
    assert "Traceback" not in shown.text
    tables = [line for line in shown.lines if line[:1] in BOXES and line]
    for line in tables:
        assert len(line) <= COLUMNS, line
        assert "…" not in line, line
    return shown.text


def check_everywhere(*arguments: object, folder: Path, quietly: tuple[str, ...] = ("--quiet",)) -> None:
    """Run the command in a terminal, through a pipe, and in a terminal with ``quietly``: all tell of the same files."""
    text = checked(in_terminal(*arguments, folder=folder))
    piped = in_pipe(*arguments, folder=folder)
    assert (piped.returncode, "\x1b" in piped.stdout + piped.stderr) == (0, False), piped.stderr
    assert "Traceback" not in piped.stderr
    quiet = in_terminal(*arguments, *quietly, folder=folder)
    checked(quiet)
    assert ERASED not in quiet.raw
    for written in re.findall(r"^wrote (.*)$", piped.stdout, re.MULTILINE):
        assert written in text
        assert written in quiet.text
