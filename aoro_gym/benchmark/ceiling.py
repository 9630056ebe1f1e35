"""What share of a device's ceiling twins reach: a roofline.

``operations.json`` holds what one main step takes on a ground: operations by class on a CPU and on CUDA, and bytes that a
step and a launch move, counted from the kernel's own code with the default machine and substeps. After a change to the laws
``python -m studies.roofline --write`` counts again. Triangles are asked by Warp's own query and are not counted.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from aoro_gym.benchmark.probes import WIDTH, bandwidth, factors, full, multiply_add, probe_time
from aoro_gym.execution import devices

OPERATIONS = Path(__file__).with_name("operations.json")


@cache
def counted() -> dict[str, Any]:
    """What a main step takes, by ground."""
    return json.loads(OPERATIONS.read_text(encoding="utf-8"))


@dataclass(frozen=True)
class Ceiling:
    """What one core of a CPU, or a whole GPU, does at best."""

    operations_per_s: float
    """Instructions of one number each, as every twin issues them: scalar on a CPU; on CUDA a multiplication and the addition
    that takes it up are one."""
    bytes_per_s: float
    """Read and written."""


def measure_ceiling(device: str) -> Ceiling:
    """Ceiling of ``device`` by chains of multiplications and additions, and by a stream; takes below a second, compilation
    excluded."""
    here = devices.find(device)
    threads = full(here)
    pairs = threads * WIDTH / probe_time(multiply_add, factors(here), WIDTH, threads)
    return Ceiling(operations_per_s=(1.0 if here.is_cuda else 2.0) * pairs, bytes_per_s=bandwidth(here))


def beside(case: dict[str, Any], ceiling: Ceiling) -> dict[str, Any]:
    """What the row ``case`` of twins says of ``ceiling``.

    Returns:
        ``operations_per_step``, ``bytes_per_step`` (what a launch of one control step moves, shared by its steps),
        ``ceiling_steps_per_s`` by resource, were it the only one that is short, and ``share_of_ceiling``: steps a core
        second on a CPU, steps a second on CUDA, over the lower of the two.
    """
    on_cpu = case["device"] == "cpu"
    counts = counted()[case["ground"]]
    operations = sum(counts["cpu" if on_cpu else "cuda"].values())
    steps = round(case["control_step_s"] / case["main_step_s"])
    moved = counts["bytes"]["step"] + counts["bytes"]["launch"] / steps
    limits = {"arithmetic": ceiling.operations_per_s / operations, "memory": ceiling.bytes_per_s / moved}
    rate = case["steps_per_core_s" if on_cpu else "steps_per_s"]
    return {
        "operations_per_step": operations,
        "bytes_per_step": moved,
        "ceiling_steps_per_s": limits,
        "share_of_ceiling": rate / min(limits.values()),
    }
