"""Microseconds of a twin's step on a plane, and on a terrain as large as the published scan as a raster, as triangles, and
with discs that ask the triangles.

57 m x 103 m in about 25 600 triangles. One core: `taskset -c 0 python -m studies.terrain_speed`.
"""

import argparse
import json
import os
import statistics
import time

import numpy as np
import warp as wp

from aoro_gym.terrains.plane import Plane
from aoro_gym.terrains.terrain import Terrain
from aoro_gym.twin.twin import Twin
from tests.twin.landscapes import noise

WIDTH, LENGTH, TRIANGLES = 57.0, 103.0, 25_633
"""Of the published scan [m]."""


def scan(seed: int = 0) -> Terrain:
    """Hilly ground of the published scan's size."""
    cell = float(np.sqrt(2.0 * WIDTH * LENGTH / TRIANGLES))
    shape = round(LENGTH / cell) + 1, round(WIDTH / cell) + 1
    rng = np.random.default_rng(seed)
    heights = 0.05 * noise(rng, shape, 1.0 / cell) + 0.6 * noise(rng, shape, 8.0 / cell)
    return Terrain.from_heights(heights, cell=cell)


def measure(name: str, twins: int, device: str, seconds: float, runs: int) -> dict:
    """One row: median, fastest and slowest of ``runs``; commands change every 20 ms."""
    began = time.perf_counter()
    level = name == "plane"
    twin = Twin(twins, terrain=Plane() if level else scan(), ground="raster" if level else name, device=device)
    built = time.perf_counter() - began
    rng = np.random.default_rng(0)
    pose = {
        "position": rng.uniform((10.0, 10.0), (WIDTH - 10.0, LENGTH - 10.0), (twins, 2)),
        "heading": rng.uniform(-np.pi, np.pi, twins),
    }
    schedule = [
        {
            "steering_signal": rng.uniform(-1.0, 1.0, twins).astype(np.float32),
            "drive_signal": rng.uniform(-0.5, 0.5, twins).astype(np.float32),
        }
        for _ in range(16)
    ]

    def run(count: int) -> float:
        twin.reset(**pose)
        wp.synchronize_device(device)
        start = time.perf_counter()
        for index in range(count):
            twin.step(schedule[index % len(schedule)], duration=0.02)
        wp.synchronize_device(device)
        return time.perf_counter() - start

    count = 4
    while (spent := run(count)) < 0.2 * seconds / runs:
        count *= 2
    count = max(1, round(count * seconds / runs / spent))
    steps = count * round(0.02 / twin.main_step)
    cost = [run(count) / steps / twins * 1e6 for _ in range(runs)]
    diverged = len(twin.diverged)
    median = statistics.median(cost)
    return {
        "ground": name,
        "device": device,
        "twins": twins,
        "us_per_step": median,
        "min": min(cost),
        "max": max(cost),
        "steps_per_s": 1e6 / median,
        "real_time_factor": twin.main_step * 1e6 / (median * twins),
        "build_s": built,
        "lost": diverged,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--twins", type=int, nargs="+", default=[1, 64])
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--runs", type=int, default=5)
    asked = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    cores = len(os.sched_getaffinity(0))
    for twins in asked.twins:
        for name in ("plane", "raster", "mesh", "discs"):
            row = measure(name, twins, asked.device, asked.seconds, asked.runs)
            print(
                json.dumps({"cores": cores, **{k: round(v, 4) if isinstance(v, float) else v for k, v in row.items()}})
            )


if __name__ == "__main__":
    main()
