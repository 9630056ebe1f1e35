"""Commands as a person runs them: in a terminal of 80 columns, through a pipe, with --quiet, and with Ctrl-C."""

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

import pytest

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


def in_terminal(*arguments: object, folder: Path, interrupt: str | None = None, limit: float = 300.0) -> Shown:
    """Run the command under a pseudo-terminal; Ctrl-C is pressed once ``interrupt`` stands on the screen."""
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, COLUMNS, 0, 0))

    def lead() -> None:
        os.setsid()
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)

    command = [sys.executable, "-m", "aoro_gym", *map(str, arguments)]
    environment = {**ENVIRONMENT, "TERM": "xterm", "NO_COLOR": "1"}
    process = subprocess.Popen(
        command, stdin=slave, stdout=slave, stderr=slave, cwd=folder, env=environment, preexec_fn=lead, close_fds=True
    )
    os.close(slave)
    found, until = b"", time.monotonic() + limit
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
                os.write(master, b"\x03")
                interrupt = None
        elif time.monotonic() > until:
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


TINY = ("--steps", 500, "--n-envs", 2, "--checkpoint-every", 250, "--eval-episodes", 1, "--param", "batch_size=64")
"""A training that is over at once."""


def test_a_training_in_a_terminal(tmp_path):
    pytest.importorskip("stable_baselines3")
    shown = in_terminal("train", *TINY, "--out", "run", folder=tmp_path)
    assert shown.code == 0, shown.text
    assert "--:--" in shown.text  # before anything is known
    assert re.search(r"learning .* \d+ % +\d+:\d\d", shown.text), shown.text
    assert re.search(r"of 500 steps, [\d,]+ a second", shown.text)
    assert "wrote run/best.json" in shown.text
    assert max(map(len, shown.lines)) <= COLUMNS


def test_a_simulation_in_a_terminal(tmp_path):
    shown = in_terminal("simulate", "-m", "left", "--duration", 1, "--out", "log.csv", folder=tmp_path)
    assert shown.code == 0, shown.text
    assert ERASED in shown.raw
    assert "wrote log.csv" in shown.text
    assert max(map(len, shown.lines)) <= COLUMNS
    quiet = in_terminal("simulate", "-m", "left", "--duration", 1, "--out", "log.csv", "--quiet", folder=tmp_path)
    assert quiet.code == 0
    assert ERASED not in quiet.raw
    assert "wrote log.csv" in quiet.text
