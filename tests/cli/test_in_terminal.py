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

import numpy as np
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


TINY = ("--steps", 500, "--n-envs", 2, "--checkpoint-every", 250, "--eval-episodes", 1, "--param", "batch_size=64")
"""A training that is over at once."""
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


@pytest.fixture(scope="module")
def trained(tmp_path_factory) -> Path:
    """A folder in which a policy was trained in ``run``, in a terminal."""
    pytest.importorskip("stable_baselines3")
    folder = tmp_path_factory.mktemp("trained")
    (folder / "shown.txt").write_text(checked(in_terminal("train", *TINY, "--out", "run", folder=folder)))
    return folder


@pytest.mark.slow
def test_a_training_in_a_terminal(trained):
    text = (trained / "shown.txt").read_text()
    assert "--:--" in text  # before anything is known
    assert re.search(r"(learning|evaluating) .* \d+ % +\d+:\d\d", text), text
    assert re.search(r"of 500 steps, [\d,]+ a second", text)
    assert "success rate" in text
    assert "wrote run/best.json" in text


def test_a_simulation_in_a_terminal(tmp_path):
    shown = in_terminal("simulate", "-m", "left", "--duration", 1, "--out", "log.csv", folder=tmp_path)
    assert "wrote log.csv" in checked(shown)
    assert ERASED in shown.raw
    assert max(map(len, shown.lines)) <= COLUMNS
    quiet = in_terminal("simulate", "-m", "left", "--duration", 1, "--out", "log.csv", "--quiet", folder=tmp_path)
    assert "wrote log.csv" in checked(quiet)
    assert ERASED not in quiet.raw


COMMANDS: list[tuple[str, tuple[object, ...]]] = [
    ("parameters", ("parameters", "steering")),
    ("effects", ("parameters", "--effects")),
    ("drive", ("simulate", "-m", "drive", "--duration", 1, "--out", "[/x] $a$.csv")),
    ("demo", ("demo",)),
    ("validate", ("validate", "--ensemble", "none")),
    ("calibrate", ("calibrate", "--logs", "log.csv", "--starts", 1, "--population", 2, "--force")),
    ("terrain", ("terrain", "ground.npy", "--cell", 1)),
    ("evaluate", ("evaluate", *TURNING, "--episodes", 2)),
    (
        "evaluate a drive",
        ("evaluate", "--terrain", "ground.ply", "--policy", "stanley", "--policy", "preview", "--episodes", 1),
    ),
    ("leaderboard", ("leaderboard", *TURNING, "--episodes", 2)),
    ("curves", ("curves", "run")),
    (
        "gap",
        ("gap", *TURNING, "--policy", "bang-bang", "--effect", "spool_lag=0.05", "--improved", "aoro", "--episodes", 2),
    ),
    (
        "gap that retrains",
        (
            *("gap", *TURNING, "--policy", "run/best.json", "--effect", "spool_lag=0.05", "--improved", "aoro"),
            *("--episodes", 1, "--retrain", 300),
        ),
    ),
    ("export policy", ("export", "policy", "run/best.json")),
    ("export twin", ("export", "twin", "--format", "fmi2", "--out", "twin.fmu")),
    ("serve", ("serve", "--udp-port", 0, "--tcp-port", 0, "--duration", 2)),
    ("laboratory", ("laboratory", "-m", "park")),
    ("bench", ("bench", "--twins", "1,2", "--seconds", 0.02)),
    ("doctor", ("doctor",)),
]


@pytest.fixture(scope="module")
def inputs(trained) -> Path:
    """What commands are given, beside the training."""
    heights = np.add.outer(np.zeros(121), 0.02 * np.arange(121.0))
    np.save(trained / "ground.npy", heights)
    for command in (
        ("simulate", "-m", "left", "--duration", 2.5, "--out", "log.csv"),
        ("terrain", "ground.npy", "--cell", 1, "--out", "ground.ply"),
    ):
        made = in_pipe(*command, folder=trained)
        assert made.returncode == 0, made.stderr
    return trained


@pytest.mark.slow
@pytest.mark.parametrize(("name", "arguments"), [pytest.param(*one, id=one[0]) for one in COMMANDS])
def test_commands_in_a_terminal_in_a_pipe_and_quiet(name, arguments, inputs):
    if name == "export policy":
        pytest.importorskip("onnx")
    text = checked(in_terminal(*arguments, folder=inputs))
    again = () if name in ("parameters", "effects") else ("--quiet",)
    piped = in_pipe(*arguments, folder=inputs)
    assert (piped.returncode, "\x1b" in piped.stdout + piped.stderr) == (0, False), piped.stderr
    assert "Traceback" not in piped.stderr
    quiet = in_terminal(*arguments, *again, folder=inputs)
    checked(quiet)
    assert ERASED not in quiet.raw
    for written in re.findall(r"^wrote (.*)$", piped.stdout, re.MULTILINE):
        assert written in text
        assert written in quiet.text


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "goes_on"),
    [
        (("calibrate", "--logs", "log.csv", "--out", "c.toml"), "the same command goes on from where it stopped"),
        (("diagnose", "log.csv", "--out", "d"), "the same command begins anew"),
        (("evaluate", *TURNING, "--episodes", 64, "--out", "e"), "the same command goes on from where it stopped"),
        (("leaderboard", *TURNING, "--episodes", 64, "--out", "l"), "the same command goes on from where it stopped"),
        (("blind", "seal", "--workers", 2, "--seed", 1, "suite"), "the same command goes on from where it stopped"),
        (("train", "--steps", 100_000, "--n-envs", 2, "--out", "t"), "aoro-gym train --resume t goes on"),
        (("validate", "--out", "v"), "the same command begins anew"),
        (("bench", "--twins", 1), "the same command begins anew"),
        (("laboratory", "-m", "kerb"), "the same command begins anew"),
    ],
)
@pytest.mark.parametrize("after", [0.0, 4.0])
def test_ctrl_c_ends_with_one_line(arguments, goes_on, after, inputs):
    shown = in_terminal(*arguments, folder=inputs, interrupt="%", after=after)
    if shown.code == 0:
        pytest.skip("it was done before")
    assert shown.code == 130, shown.text
    assert "Traceback" not in shown.text and "Error" not in shown.text, shown.text
    assert [line for line in shown.lines if line.strip()][-1] == f"interrupted: {goes_on}"


def test_ctrl_c_ends_a_server(tmp_path):
    shown = in_terminal("serve", "--udp-port", 0, "--tcp-port", 0, folder=tmp_path, interrupt="serving", after=0.5)
    assert shown.code == 130, shown.text
    assert "Traceback" not in shown.text
    last = [line for line in shown.lines if line.strip()][-1]
    assert last == "interrupted: the twin stands still; the same command begins anew"


@pytest.mark.slow
def test_lines_of_a_calibration_in_a_pipe(inputs):
    """One soon and then at least one every 15 s, each with an estimate that is a number once two shares are known."""
    began, times, lines = time.monotonic(), [], []
    command = [sys.executable, "-m", "aoro_gym", "calibrate", "--logs", "log.csv", "--out", "c2.toml"]
    with subprocess.Popen(
        command, cwd=inputs, env=ENVIRONMENT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        for line in process.stderr:
            times.append(time.monotonic() - began)
            lines.append(line.strip())
            if len(lines) == 5:
                process.send_signal(signal.SIGINT)
    assert process.returncode == 130, lines
    assert lines[-1] == "interrupted: the same command goes on from where it stopped"
    assert max(np.diff([0.0, *times[:5]])) < 15.0
    assert all(re.fullmatch(r".+: \d+ %, (--:--|[\d:]+) left", line) for line in lines[:5]), lines
    assert re.search(r"\d:\d\d left", lines[4])
