"""What the solid objects of a world cost: steps of twins in a forest against those on its bare ground, by turns.

``python -m studies.objects_speed OUT.json [--device cuda:0] [--twins 64,4096]`` prints each figure when it is known.
"""

from __future__ import annotations

import argparse
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from aoro_gym.execution.files import write_json
from aoro_gym.terrains.generate.world import world
from aoro_gym.terrains.world.world import World
from aoro_gym.twin import Twin
from aoro_gym.twin.records import OBJECT_PARTS

ROUNDS = 8
"""Timed turns of each, after one that is not."""
DURATION = 0.2
"""Simulated time [s] of a turn."""
CLEAR = 0.02
"""Depth [m] in an object up to which a place counts as free."""
DRAWS = 80
"""Times that places are drawn anew for twins in objects."""


def put(twin: Twin, made: World, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Put twins at random free places; returns positions (N, 2) [m] and headings (N,) [rad]."""
    low, high = (corner[:2] for corner in made.terrain.extent)
    n = twin.num_twins
    position, heading, taken = np.zeros((n, 2)), np.zeros(n), np.ones(n, dtype=bool)
    objects = twin._grounds.objects
    assert objects is not None
    for _ in range(DRAWS):
        position[taken] = rng.uniform(low + 5.0, high - 5.0, (taken.sum(), 2))
        heading[taken] = rng.uniform(-np.pi, np.pi, taken.sum())
        with suppress(ValueError):  # while some stand in objects
            twin.reset(position=position, heading=heading)
        taken = objects.overlaps(twin.machines, twin.state)[1].max(axis=0) > CLEAR
        if not taken.any():
            return position, heading
    raise ValueError(f"{int(taken.sum())} of {n} twins found no free place in {made.name}")


def cost(made: World, count: int, device: str) -> dict[str, Any]:
    """Ratio of the times of the same steps with and without objects, and twin-steps a second."""
    rng = np.random.default_rng(1)
    twins = {
        ground: Twin(count, terrain=land, device=device) for ground, land in (("bare", made.terrain), ("objects", made))
    }
    position, heading = put(twins["objects"], made, rng)
    twins["bare"].reset(position=position, heading=heading)
    commands = {"drive_signal": rng.uniform(0.3, 0.6, count), "steering_signal": rng.uniform(-0.3, 0.3, count)}
    times: dict[str, list[float]] = {ground: [] for ground in twins}
    touching = []
    for number in range(ROUNDS + 1):
        for ground, twin in twins.items():
            twin.set_commands(commands)
            wp.synchronize()
            begin = time.perf_counter()
            twin.advance(DURATION)
            wp.synchronize()
            if number:
                times[ground].append(time.perf_counter() - begin)
        touched = [twins["objects"].output(f"touched_object_{part}") > 0 for part in OBJECT_PARTS]
        touching.append(float(np.mean(np.any(touched, axis=0))))
    ratio = np.divide(times["objects"], times["bare"])
    steps = count * DURATION / twins["bare"].main_step
    return {
        "ratio": dict(zip(("least", "median", "most"), np.quantile(ratio, (0.0, 0.5, 1.0)).tolist(), strict=True)),
        "twin_steps_per_s": {ground: steps / float(np.median(found)) for ground, found in times.items()},
        "share_touching": [touching[0], touching[-1]],
        "diverged": len(twins["objects"].diverged),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--twins", default="64")
    options = parser.parse_args()
    made = world(3, size=(80.0, 80.0))
    found: dict[str, Any] = {"device": str(wp.get_device(options.device).name), "objects": len(made.objects)}
    for count in map(int, options.twins.split(",")):
        found[f"{count}_twins"] = cost(made, count, options.device)
        print(count, found[f"{count}_twins"], flush=True)
        write_json(options.out, found)


if __name__ == "__main__":
    main()
