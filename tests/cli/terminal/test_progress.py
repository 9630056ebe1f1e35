"""What a command shows of its progress, in a terminal and through a pipe."""

import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from tests.cli.terminal.running import COLUMNS, ENVIRONMENT, ERASED, checked, in_terminal


def test_a_simulation_in_a_terminal(tmp_path):
    shown = in_terminal("simulate", "-m", "left", "--duration", 1, "--out", "log.csv", folder=tmp_path)
    assert "wrote log.csv" in checked(shown)
    assert ERASED in shown.raw
    assert max(map(len, shown.lines)) <= COLUMNS


@pytest.mark.slow
def test_a_quiet_simulation_in_a_terminal(tmp_path):
    quiet = in_terminal("simulate", "-m", "left", "--duration", 1, "--out", "log.csv", "--quiet", folder=tmp_path)
    assert "wrote log.csv" in checked(quiet)
    assert ERASED not in quiet.raw


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
