"""How fast a twin steps: many copies under changing commands, timed over several runs."""

from __future__ import annotations

import os
import platform
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aoro_gym.manoeuvres import TwinLost

if TYPE_CHECKING:
    from aoro_gym.twin import Machine

CONTROL_STEP = 0.02
"""Simulated time [s] between two changes of the commands."""
RUNS = 5
"""Timed runs of each case; the median, the fastest and the slowest are reported."""


def time_twin(
    num_twins: int,
    *,
    machine: Machine | str = "aoro",
    device: str = "cpu",
    seconds: float = 5.0,
    seed: int = 0,
    progress: Callable[[float], Any] | None = None,
) -> dict[str, Any]:
    """Time ``Twin.step`` for ``num_twins`` copies that steer and drive at random.

    Compilation and the first steps are not counted. Commands change every :data:`CONTROL_STEP` and are uploaded within
    the timed span; the device is drained before each clock reading.

    Args:
        num_twins: Copies stepped together.
        machine: What to copy.
        device: ``cpu`` or ``cuda:N``.
        seconds: Time [s] to measure for, shared by :data:`RUNS` runs.
        seed: Seed of the commands.
        progress: Called with the share in [0, 1] that is done.

    Raises:
        TwinLost: a state stopped being finite.

    Returns:
        A case of the benchmark file. ``steps_per_s`` counts main steps of all twins; ``real_time_factor`` is the
        simulated time of each twin per wall time.
    """
    import warp

    from aoro_gym.twin import Twin

    twin = Twin(num_twins=num_twins, machine=machine, device=device)
    rng = np.random.default_rng(seed)
    schedule = [
        {
            "steering_signal": rng.uniform(-1.0, 1.0, num_twins).astype(np.float32),
            "drive_signal": rng.uniform(-0.5, 0.5, num_twins).astype(np.float32),
        }
        for _ in range(16)
    ]
    twin.reset()

    def step(count: int) -> float:
        """Wall time [s] of ``count`` control steps."""
        warp.synchronize_device(device)
        start = time.perf_counter()
        for index in range(count):
            twin.step(schedule[index % len(schedule)], duration=CONTROL_STEP)
        warp.synchronize_device(device)
        return time.perf_counter() - start

    step(2)
    count = 1
    while (spent := step(count)) < 0.1 * seconds / RUNS:
        count *= 2
    count = max(1, round(count * seconds / RUNS / spent))

    main_steps = count * round(CONTROL_STEP / twin.main_step)
    rates = []
    for run in range(RUNS):
        twin.reset()
        rates.append(main_steps * num_twins / step(count))
        if progress is not None:
            progress((run + 1) / RUNS)
    if twin.lost:
        index, reason = twin.lost[0]
        raise TwinLost(f"{len(twin.lost)} of {num_twins} twins were lost, first {index}: {reason}")
    median = statistics.median(rates)
    return {
        "what": "twin",
        "device": device,
        "twins": num_twins,
        "steps_per_s": median,
        "min": min(rates),
        "max": max(rates),
        "real_time_factor": median * twin.main_step / num_twins,
        "main_step_s": twin.main_step,
        "substeps": twin.substeps,
        "control_step_s": CONTROL_STEP,
        "runs": RUNS,
        "steps_per_run": main_steps * num_twins,
    }


def computer(device: str) -> dict[str, Any]:
    """The computer that a benchmark ran on."""
    import warp

    from aoro_gym import __version__

    name = warp.get_device(device).name
    return {
        "device": _cpu_name() if device == "cpu" else name,
        "cpu": _cpu_name(),
        "cores": _cores(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "warp": warp.__version__,
        "aoro_gym": __version__,
    }


def _cpu_name() -> str:
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
