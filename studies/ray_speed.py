"""Rays a second on a core, beside Embree through trimesh, on a lidar's view of a generated forest.

    python -m studies.ray_speed [--rays N] [--repeats N]

Both casters take turns in one process; the best of the repeats counts. Embree is handed arrays by trimesh and takes its
rays one by one, as ours does; arrays on the way into Warp count, too.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
import trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

from aoro_gym.sensors.raytrace.standing import forest_scene
from aoro_gym.terrains.generate.forest import forest


def main() -> None:
    parser = argparse.ArgumentParser(description="Rays a second on a core, beside Embree")
    parser.add_argument("--rays", type=int, default=262_144)
    parser.add_argument("--repeats", type=int, default=5)
    asked = parser.parse_args()
    scene: Any = forest_scene(forest(3))
    vertices, faces = scene.mesh.points.numpy(), scene.mesh.indices.numpy().reshape(-1, 3)
    columns = asked.rays // 128
    azimuth, elevation = np.meshgrid(
        2 * np.pi * np.arange(columns) / columns, np.radians(np.linspace(-22.5, 22.5, 128)), indexing="ij"
    )
    a, e = azimuth.ravel(), elevation.ravel()
    directions = np.column_stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]).astype(np.float32)
    origins = np.tile([0.0, 0.0, 4.0], (len(directions), 1)).astype(np.float32)
    embree = RayMeshIntersector(trimesh.Trimesh(vertices, faces, process=False), scale_to_box=False)
    calls = {
        "Warp": lambda: scene.cast(origins, directions, max_range=120.0),
        "Embree": lambda: embree.intersects_first(origins, directions),
    }
    best = dict.fromkeys(calls, np.inf)
    for _ in range(asked.repeats + 1):  # the first one builds
        for name, call in calls.items():
            begun = time.thread_time()
            call()
            best[name] = min(best[name], time.thread_time() - begun)
    print(f"{len(faces)} triangles, {len(directions)} rays")
    for name, seconds in best.items():
        print(f"{name:8s} {len(directions) / seconds / 1e6:.2f} Mray/s of CPU time on a core")


if __name__ == "__main__":
    main()
