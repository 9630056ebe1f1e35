"""What the tests share: the twin's recordings of two short manoeuvres, run once; which may be skipped; slowest files."""

import os

# Workers share the cores: threads of linear algebra within each would spin for most of the suite's time.
os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1")

import gc
from collections import defaultdict
from collections.abc import Generator, Iterator
from functools import cache
from pathlib import Path

import pytest
import typer.main
import warp

from aoro_gym import Machine, Twin
from aoro_gym.calibration.procedure import measured_curve
from aoro_gym.reporting import terminal
from aoro_gym.simulation.manoeuvres import Trajectory, run, standing_turn, straight_drive

warp.config.log_level = warp.LOG_ERROR

ROOT = Path(__file__).parents[1]
MAY_SKIP = tuple(
    line.split(" # ")[0]
    for line in (ROOT / "tests" / "may_skip.txt").read_text(encoding="utf-8").splitlines()
    if not line.startswith("#")
)
"""Tests and files that may be skipped."""


def _refuse(report: pytest.TestReport | pytest.CollectReport) -> None:
    """Turn a skip that is not listed into a failure."""
    if report.skipped and not hasattr(report, "wasxfail") and not report.nodeid.startswith(MAY_SKIP):
        report.outcome = "failed"
        report.longrepr = f"{report.nodeid} is not in tests/may_skip.txt, but was skipped: {report.longreprtext}"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    _refuse(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    report = yield
    _refuse(report)
    return report


GARBAGE = 50_000
"""Objects made since garbage was last looked for, until it is looked for again (E): by default 700, for programs that run on
little memory."""


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Imports make a million objects that stay to the end: garbage is looked for among those of the tests alone."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(GARBAGE)
        gc.enable()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Name the slowest files: seconds of their tests and fixtures, without imports."""
    seconds: defaultdict[str, float] = defaultdict(float)
    for reports in terminalreporter.stats.values():
        for report in reports:
            if isinstance(report, pytest.TestReport):
                seconds[report.nodeid.split("::")[0]] += report.duration
    terminalreporter.section(f"slowest files of {sum(seconds.values()):.0f} s")
    for name in sorted(seconds, key=seconds.__getitem__, reverse=True)[:20]:
        terminalreporter.write_line(f"{seconds[name]:7.1f} s  {name}")


@pytest.fixture(autouse=True)
def _nobody_stays_quiet() -> Iterator[None]:
    """A command that a test runs with ``--quiet`` is quiet alone: the tests after it see progress again."""
    yield
    terminal.set_quiet(False)


@pytest.fixture(scope="session", autouse=True)
def _command_line_is_built_once() -> Iterator[None]:
    """Typer's runner builds all commands anew for every call, which takes longer than most calls that are refused."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("typer.testing._get_command", cache(typer.main.get_command))
        yield


@pytest.fixture(scope="session")
def machine() -> Machine:
    """The nominal machine: data sheets, derived figures and estimates, with the measured valve curve.

    Tests of laws mean its round numbers; the calibrated machine that is the default has tests of its own in
    ``validation/test_shipped_machine.py``.
    """
    return measured_curve(Machine.load("aoro_datasheet"))


@pytest.fixture(scope="session")
def left_turn(machine: Machine) -> Trajectory:
    """A full turn to the left at full signal."""
    return run(Twin(machine=machine), standing_turn(1, 1.0, float(machine.joint.range)))


@pytest.fixture(scope="session")
def right_turn(machine: Machine) -> Trajectory:
    """A full turn to the right at full signal."""
    return run(Twin(machine=machine), standing_turn(-1, 1.0, float(machine.joint.range)))


@pytest.fixture(scope="session")
def drive(machine: Machine) -> Trajectory:
    """Three seconds straight on at half the drive signal."""
    return run(Twin(machine=machine), straight_drive(0.5, duration=3.0))
