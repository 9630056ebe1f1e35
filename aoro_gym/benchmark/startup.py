"""How long a fresh process takes to its first step, with compiled kernels at hand and without.

``python -m aoro_gym.benchmark.startup DEVICE GROUND`` is that process: it prints its times as JSON.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from typing import Any

STARTS = 3
"""Processes whose median counts, where kernels are at hand."""


def time_startup(
    device: str, ground: str, progress: Callable[[str, float], Any] | None = None
) -> dict[str, float | str]:
    """Times [s] of fresh processes that step one twin once.

    Returns:
        ``import_s`` of Twin; ``first_twin_s``, to build one on level ground of that kind and step it; ``warm_s``, the
        whole process from its launch to that step; ``cold_first_twin_s`` and ``cold_s``, the same with an empty kernel
        cache, compilation included.
    """

    def say(what: str, share: float) -> None:
        if progress is not None:
            progress(what, share)

    say("start-up, kernels compiled", 0.0)
    _first_step(device, ground, os.environ)  # fills the cache if need be
    warm = [_first_step(device, ground, os.environ) for _ in range(STARTS)]
    say("start-up, compiling", 0.2)
    with tempfile.TemporaryDirectory(prefix="aoro-gym-kernels-") as empty:
        cold = _first_step(device, ground, {**os.environ, "WARP_CACHE_PATH": empty, "CUDA_CACHE_DISABLE": "1"})
    say("start-up", 1.0)
    return {
        "device": device,
        "ground": ground,
        "import_s": statistics.median(run["import_s"] for run in warm),
        "first_twin_s": statistics.median(run["first_twin_s"] for run in warm),
        "warm_s": statistics.median(run["process_s"] for run in warm),
        "cold_first_twin_s": cold["first_twin_s"],
        "cold_s": cold["process_s"],
    }


def _first_step(device: str, ground: str, environment: Any) -> dict[str, float]:
    """Times of one process, and ``process_s`` from its launch to its step; raises ``RuntimeError`` if it fails."""
    launched = time.time()
    ran = subprocess.run(
        [sys.executable, "-m", __name__, device, ground], env=environment, capture_output=True, text=True, check=False
    )
    if ran.returncode:
        raise RuntimeError(f"a process that steps one twin ended with {ran.returncode}: {ran.stderr.strip()[-500:]}")
    times = json.loads(ran.stdout.splitlines()[-1])
    return {**times, "process_s": times.pop("stepped_at") - launched}


def _main(device: str, ground: str) -> None:
    began = time.perf_counter()
    import warp

    warp.config.log_level = warp.LOG_ERROR
    from aoro_gym.twin import Twin

    imported = time.perf_counter()
    if ground == "plane":
        twin = Twin(device=device)
    else:
        from aoro_gym.terrains import Terrain

        twin = Twin(terrain=Terrain.from_heights([[0.0] * 200] * 200, cell=0.25), ground=ground, device=device)
    twin.step()
    warp.synchronize_device(device)
    times = {"import_s": imported - began, "first_twin_s": time.perf_counter() - imported, "stepped_at": time.time()}
    print(json.dumps(times))


if __name__ == "__main__":
    _main(*sys.argv[1:])
