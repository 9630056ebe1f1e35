"""Both forms of the kernel that advances twins on a GPU, in turns: one thread a twin, and four warps for 32 twins.

    python -m studies.roles OUT.json [--device cuda:0] [--twins 64 4096]

The file has the form of aoro_gym/twin/forms.json, by which twins choose theirs. Every twin has its own machine, start and
commands on the raster of a forest; a launch is 20 main steps.
"""

from __future__ import annotations

import argparse
import statistics
import time
from pathlib import Path

import warp as wp

from aoro_gym.benchmark.scene import CONTROL_STEP, signals, starts, terrain
from aoro_gym.execution import devices
from aoro_gym.execution.files import write_json
from aoro_gym.twin import Twin

ROUNDS = 7
"""Turns of each form, whose median counts."""
COUNTS = (1, 64, 512, 1024, 2048, 4096, 8192, 12_288, 16_384, 24_576, 32_768, 49_152, 65_536, 131_072)
FORMS = {"one_thread": False, "roles": True}


def rates(count: int, device: str, launches: int, forms: dict[str, bool | None]) -> dict[str, float]:
    """Main steps/s of ``count`` twins, medians of :data:`ROUNDS`.

    Args:
        count: Of twins.
        device: One.
        launches: In a turn.
        forms: What is asked of :class:`~aoro_gym.twin.twin.Twin` as ``roles``, by name.
    """
    position, heading = starts(count, 0)
    steering, driven = signals(count, 0)[0]
    twins = {
        name: Twin(count, terrain=terrain(), own_machines=True, device=device, roles=roles)
        for name, roles in forms.items()
    }
    found: dict[str, list[float]] = {name: [] for name in twins}
    for turn in range(ROUNDS + 1):
        for name, twin in twins.items():
            twin.reset(position=position, heading=heading)
            twin.set_commands({"steering_signal": steering, "drive_signal": driven})
            twin.advance(CONTROL_STEP)
            wp.synchronize_device(twin.device)
            began = time.perf_counter()
            for _ in range(launches):
                twin.advance(CONTROL_STEP)
            wp.synchronize_device(twin.device)
            if turn > 0:
                found[name].append(launches * count * CONTROL_STEP / twin.main_step / (time.perf_counter() - began))
    return {name: float(f"{statistics.median(values):.3g}") for name, values in found.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--twins", type=int, nargs="+", default=COUNTS)
    parser.add_argument("--launches", type=int, default=25, help="of 20 main steps in a turn")
    asked = parser.parse_args()
    card = devices.find(asked.device).name
    table = {"card": card, "scene": "forest's raster, machines of their own, launches of 20 main steps of 30 substeps"}
    measured: dict[str, dict[str, float]] = {}
    for count in asked.twins:
        measured[str(count)] = row = rates(count, asked.device, asked.launches, dict(FORMS))
        shown = ", ".join(f"{name} {rate:.3g}" for name, rate in row.items())
        print(f"{count} twins: {shown} steps/s, x {row['roles'] / row['one_thread']:.2f}", flush=True)
        write_json(asked.out, {**table, "steps_per_s": measured})


if __name__ == "__main__":
    main()
