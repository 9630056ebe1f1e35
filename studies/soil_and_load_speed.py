"""How many steps a second twins take on soil, with logs in their bunks, with a crane, and among solid objects, beside empty
ones on hard ground: ``python -m studies.soil_and_load_speed OUT.json``; ``--device cuda:0 --twins 64 4096`` on a GPU.

All take turns, so that a busy machine slows all alike; medians of ``--repeats`` turns. The twins drive apart, each with
another steering signal, so that every one presses ruts of its own; cranes move by all of their sections meanwhile. Objects
are a made forest's, in which the twins start side by side; beside them the same ground without its objects is measured.
Where roles or lanes could run the plain twins, they do not here: one form is compared.
"""

import argparse
import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from aoro_gym import Machine, Twin
from aoro_gym.terrains.generate.world import world
from aoro_gym.terrains.world.places import free_place

TWIN_STEPS = 20_000
"""Steps of 1 ms of all twins together in a turn, at least 20 of each."""
LOGS = 30.0
"""In the bunk of those that carry some."""
WORLD_SIZE = (40.0, 40.0)
"""Edges [m] of the forest."""
BESIDE: dict[str, str] = {"soil": "hard", "load": "hard", "crane": "hard", "all": "hard", "objects": "raster"}
"""What each kind of twins is compared with."""
SIGNALS = {"crane_slew": 0.4, "crane_lift": 0.5, "crane_fold": -0.5, "crane_telescope": 0.4}
"""Of the cranes that move."""


def _laden() -> Machine:
    return Machine.load("aoro").set({"payload.count": LOGS})


def makers(soil: str, device: str) -> dict[str, Callable[[int], Twin]]:
    """How to make a number of twins of each kind; ``soil``: a preset."""
    forest, plain = world(1, size=WORLD_SIZE), {"device": device, "roles": False if device.startswith("cuda") else None}

    def in_forest(twin: Twin) -> Twin:
        x, y, heading = free_place(forest)
        twin.reset(position=(x, y), heading=heading)
        return twin

    return {
        "hard": lambda count: Twin(count, **plain),
        "soil": lambda count: Twin(count, soil=soil, device=device),
        "load": lambda count: Twin(count, machine=_laden(), device=device),
        "crane": lambda count: Twin(count, crane=True, device=device),
        "all": lambda count: Twin(count, machine=_laden(), crane=True, soil=soil, device=device),
        "raster": lambda count: in_forest(Twin(count, terrain=forest.terrain, **plain)),
        "objects": lambda count: in_forest(Twin(count, terrain=forest, device=device)),
    }


def measured(count: int, soil: str, device: str, repeats: int, kinds: Sequence[str]) -> dict[str, float]:
    """Steps a second of ``count`` twins of each of the ``kinds``, and ratios of their times to those of what they are
    compared with.

    Args:
        count: Of twins.
        soil: Preset.
        device: Of all.
        repeats: Turns.
        kinds: Keys of :func:`makers`.
    """
    known = makers(soil, device)
    needed = dict.fromkeys(one for kind in kinds for one in (BESIDE.get(kind, kind), kind))
    twins = {kind: known[kind](count) for kind in needed}
    steering = np.linspace(-0.4, 0.4, count) if count > 1 else 0.0
    for twin in twins.values():
        commands = {"drive_signal": 0.5, "steering_signal": steering}
        twin.step({**commands, **(SIGNALS if twin.has_crane else {})}, 0.5)
    duration = 1e-3 * max(TWIN_STEPS // count, 20)
    times: dict[str, list[float]] = {name: [] for name in twins}
    for turn in range(repeats + 1):
        for name, twin in twins.items():
            start = time.perf_counter()
            twin.advance(duration)
            twin.output("speed")  # waits for the device
            if turn:  # the first one warms up
                times[name].append(time.perf_counter() - start)
    steps = count * duration / 1e-3
    medians = {name: float(np.median(values)) for name, values in times.items()}
    rates = {f"{name}_steps_per_s": steps / median for name, median in medians.items()}
    ratios = {f"{name}_ratio": medians[name] / medians[BESIDE[name]] for name in twins if name in BESIDE}
    return {"twins": count, **rates, **ratios}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--soil", default="peat")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--twins", type=int, nargs="+", default=[1, 64, 4096])
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--kinds", nargs="+", default=list(BESIDE), choices=list(BESIDE))
    asked = parser.parse_args()
    rows = []
    for count in asked.twins:
        row = measured(count, asked.soil, asked.device, asked.repeats, asked.kinds)
        rows.append(row)
        rates = ", ".join(
            f"{name.removesuffix('_steps_per_s')} {rate:.3g}" for name, rate in row.items() if name.endswith("per_s")
        )
        ratios = ", ".join(
            f"{name.removesuffix('_ratio')} x {ratio:.2f}" for name, ratio in row.items() if name.endswith("_ratio")
        )
        print(f"{count:5d} twins, steps/s: {rates}; as long: {ratios}", flush=True)
        asked.out.write_text(json.dumps({"soil": asked.soil, "device": asked.device, "rows": rows}, indent=2) + "\n")


if __name__ == "__main__":
    main()
