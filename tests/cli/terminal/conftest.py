"""What the tests of commands in a terminal share."""

from pathlib import Path

import numpy as np
import pytest

from tests.cli.terminal.running import in_pipe


@pytest.fixture(scope="module")
def inputs(tmp_path_factory) -> Path:
    """A folder with what commands are given: a log and two grounds."""
    folder = tmp_path_factory.mktemp("inputs")
    heights = np.add.outer(np.zeros(121), 0.02 * np.arange(121.0))
    np.save(folder / "ground.npy", heights)
    for command in (
        ("simulate", "-m", "left", "--duration", 2.5, "--out", "log.csv"),
        ("terrain", "ground.npy", "--cell", 1, "--out", "ground.ply"),
    ):
        made = in_pipe(*command, folder=folder)
        assert made.returncode == 0, made.stderr
    return folder
