"""Time subjects side by side, in rounds, so that a ratio of two does not depend on what else the computer did meanwhile."""

from __future__ import annotations

import platform
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aoro_gym.benchmark.scene import EPISODE
from aoro_gym.execution import devices
from aoro_gym.execution.device_names import on_cpu
from aoro_gym.twin.recorded import cores

RUNS = 5
"""Timed runs of each subject; the median, the fastest and the slowest are reported."""


@dataclass(frozen=True)
class Subject:
    """So many copies of something that is timed."""

    description: dict[str, Any]
    """What the benchmark file says of it beside its times."""
    copies: int
    steps: int
    """Steps of one copy in one control step: what is counted."""
    step_time: float
    """Simulated time [s] of one such step."""
    restart: Callable[[], None]
    """Put all copies where they start; not timed."""
    advance: Callable[[int], None]
    """Take so many control steps; the device is idle again when it returns."""
    check: Callable[[], dict[str, Any]]
    """What the file says of the state after a run; raises ``SimulationDiverged`` where a twin diverged."""


def measure(
    subjects: Sequence[Subject],
    *,
    seconds: float,
    progress: Callable[[str, float], Any] | None = None,
    save: Callable[[list[dict[str, Any]]], Any] | None = None,
) -> list[dict[str, Any]]:
    """Time each of ``subjects`` in :data:`RUNS` runs, one round after the other.

    Compilation and the first steps are not counted.

    Args:
        subjects: What to time.
        seconds: Time [s] to measure each of them for.
        progress: Called with the subject's description in a word and the share in [0, 1] that is done.
        save: Called after every run with the rows so far, in order: in the first round they are the first few.

    Returns:
        Rows of the benchmark file: ``steps_per_s`` counts the steps of all copies in a second of wall time,
        ``steps_per_core_s`` (on the CPU) in a second of processor time, ``real_time_factor`` is the simulated time of each
        copy in a second; ``runs`` is how many of them are done.
    """
    turns = (RUNS + 1) * len(subjects)
    done = 0

    def say(subject: Subject) -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(f"{subject.copies} x {subject.description['what']}", done / turns)

    counts = []
    for subject in subjects:
        counts.append(_control_steps(subject, seconds / RUNS))
        say(subject)
    wall: list[list[float]] = [[] for _ in subjects]
    processor: list[list[float]] = [[] for _ in subjects]
    rows: list[dict[str, Any]] = [{} for _ in subjects]
    for _ in range(RUNS):
        for i, (subject, count) in enumerate(zip(subjects, counts, strict=True)):
            spent = _run(subject, count)
            steps = count * subject.steps * subject.copies
            wall[i].append(steps / spent[0])
            processor[i].append(steps / spent[1])
            rows[i] = _row(subject, steps, wall[i], processor[i]) | subject.check()
            if save is not None:
                save([row for row in rows if row])
            say(subject)
    return rows


def _row(subject: Subject, steps: int, wall: list[float], processor: list[float]) -> dict[str, Any]:
    """What runs of ``steps`` each, with these rates [steps/s] by wall and processor time, say of ``subject``."""
    median = statistics.median(wall)
    row = {
        **subject.description,
        "steps_per_s": median,
        "min": min(wall),
        "max": max(wall),
        "real_time_factor": median * subject.step_time / subject.copies,
        "runs": len(wall),
        "steps_per_run": steps,
    }
    if on_cpu(row["device"]):
        row["steps_per_core_s"] = statistics.median(processor)
    return row


def _control_steps(subject: Subject, seconds: float) -> int:
    """Control steps that take about ``seconds``."""
    _run(subject, 2)
    count = 1
    while (spent := _run(subject, count)[0]) < 0.1 * seconds:
        count *= 2
    return max(1, round(count * seconds / spent))


def _run(subject: Subject, count: int) -> tuple[float, float]:
    """Wall and processor time [s] of ``count`` control steps."""
    wall = processor = 0.0
    for first in range(0, count, EPISODE):
        subject.restart()
        before = time.perf_counter(), time.process_time()
        subject.advance(min(EPISODE, count - first))
        wall += time.perf_counter() - before[0]
        processor += time.process_time() - before[1]
    return wall, processor


def computer(device: str) -> dict[str, Any]:
    """The computer that a benchmark ran on."""
    import warp

    from aoro_gym.version import VERSION

    names = devices.several(device)
    found = [_cpu_name() if on_cpu(name) else devices.find(name).name for name in names]
    return {
        "device": ", ".join(found),
        "cpu": _cpu_name(),
        "cores": cores(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "warp": warp.__version__,
        "aoro_gym": VERSION,
    }


def _cpu_name() -> str:
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
