"""What tests of commands share: a simulated turn, and a folder with files that commands are refused over."""

from pathlib import Path

import pytest
from typer.testing import Result

from tests.cli.calling import call


@pytest.fixture(scope="session")
def turn(tmp_path_factory) -> tuple[Path, Result]:
    """A short left turn with a parameter changed, and what was printed."""
    path = tmp_path_factory.mktemp("turn") / "log.csv"
    slow = "steering.valve.spool_time_constant=2"
    return path, call("simulate", "--manoeuvre", "left", "--duration", "1.6", "--scale", slow, "--out", path)


@pytest.fixture
def files(tmp_path, monkeypatch) -> None:
    """The current folder: a command file, two broken ones, and an empty folder."""
    monkeypatch.chdir(tmp_path)
    Path("good.csv").write_text("time_s,steering_signal\n0,0\n1,0.5\n")
    Path("bad.csv").write_text("time_s,steering_signal\n0,0\n1,2\n")
    Path("bad.toml").write_text("value = [")
    Path("empty").mkdir()
