"""How much faster twins go on several devices than on the first of them: ``python -m studies.device_scaling --device
cuda:all OUT.json``.

The same twins, on the raster of a forest, every one with its own machine, start and commands, are on the first device, and
dealt out to all. Both take turns: ``step`` with commands of the host every 20 ms, and ``advance`` with commands that lie on
the devices. ``python -m studies.device_scaling --device cpu,cpu --twins 64`` shows the form of the table on any computer.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.benchmark.scene import CONTROL_STEP, signals, starts, terrain
from aoro_gym.benchmark.twins import randomised
from aoro_gym.execution.files import write_json
from aoro_gym.machine import Machine
from aoro_gym.twin.sharded import ShardedTwins

WARMING = 2
"""Turns that are not timed."""


def scaling(count: int, device: str, repeats: int, steps: int) -> dict[str, Any]:
    """Twin-steps a second of ``count`` twins on the first device and on all, medians, least and most, and their ratios.

    Args:
        count: Of twins.
        device: Devices, with commas between them.
        repeats: Timed turns.
        steps: Of 20 ms in a turn.
    """
    machine, land = randomised(Machine.load("aoro"), count, 0), terrain()
    many = ShardedTwins(count, device=device, machine=machine, terrain=land)
    twins = {"one": ShardedTwins(count, device=many.devices[0], machine=machine, terrain=land), "all": many}
    position, heading = starts(count, 0)
    told = [{"steering_signal": steering, "drive_signal": drive} for steering, drive in signals(count, 0)]
    for each in twins.values():
        each.reset(position=position, heading=heading)
    rates: dict[str, list[float]] = {}
    for turn in range(WARMING + repeats):
        for how, stepped in (("step", _stepped), ("advance", _advanced)):
            for name, each in twins.items():
                rate = count * steps * round(CONTROL_STEP / 1e-3) / _spent(stepped, each, told, steps)
                if turn >= WARMING:
                    rates.setdefault(f"{how}, {name}", []).append(rate)
    apart = max(float(np.abs(twins["one"].output(name) - many.output(name)).max()) for name in ("joint_angle", "speed"))
    medians = {name: float(np.median(values)) for name, values in rates.items()}
    return {
        "twins": count,
        "devices": list(many.devices),
        "steps_per_s": {name: [min(values), medians[name], max(values)] for name, values in rates.items()},
        "ratios": {how: medians[f"{how}, all"] / medians[f"{how}, one"] for how in ("step", "advance")},
        "apart": apart,
        "diverged": len(many.diverged),
    }


def _stepped(twins: ShardedTwins, commands: dict[str, Any]) -> None:
    twins.step(commands, CONTROL_STEP)


def _advanced(twins: ShardedTwins, commands: dict[str, Any]) -> None:
    twins.advance(CONTROL_STEP)


def _spent(stepped: Callable[..., None], twins: ShardedTwins, told: list[dict[str, Any]], steps: int) -> float:
    """Time [s] of so many steps."""
    twins.synchronize()
    began = time.perf_counter()
    for number in range(steps):
        stepped(twins, told[number % len(told)])
    twins.synchronize()
    return time.perf_counter() - began


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--device", default="cuda:all")
    parser.add_argument("--twins", type=int, nargs="+", default=[4096, 32768, 131072])
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--steps", type=int, default=25, help="of 20 ms in a turn")
    asked = parser.parse_args()
    rows = []
    for count in asked.twins:
        rows.append(row := scaling(count, asked.device, asked.repeats, asked.steps))
        rates = ", ".join(f"{name} {middle:.3g}" for name, (_, middle, _) in row["steps_per_s"].items())
        ratios = ", ".join(f"{how} x {ratio:.2f}" for how, ratio in row["ratios"].items())
        print(
            f"{count} twins, {len(row['devices'])} devices: {rates} steps/s; {ratios}; apart {row['apart']:g}",
            flush=True,
        )
        write_json(asked.out, {"rows": rows})


if __name__ == "__main__":
    main()
