"""Rays a second on a lidar's view of a generated forest: on a core, beside Embree through trimesh, or on a GPU.

    python -m studies.ray_speed [--rays N] [--repeats N] [--device cuda:0]

On a GPU, rays and hits stay there, and the median launch counts. On a CPU, both casters take turns in one process; the
best of the repeats counts. Embree is handed arrays by trimesh and takes its rays one by one, as ours does; arrays on
the way into Warp count, too.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
import trimesh
import warp as wp
from numpy.typing import NDArray
from trimesh.ray.ray_pyembree import RayMeshIntersector

from aoro_gym.sensors.raytrace.device import cast_many
from aoro_gym.sensors.raytrace.standing import forest_scene
from aoro_gym.terrains.generate.forest import forest


def main() -> None:
    parser = argparse.ArgumentParser(description="Rays a second on a core, beside Embree")
    parser.add_argument("--rays", type=int, default=262_144)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--device", default="cpu")
    asked = parser.parse_args()
    scene: Any = forest_scene(forest(3), device=asked.device)
    vertices, faces = scene.mesh.points.numpy(), scene.mesh.indices.numpy().reshape(-1, 3)
    origins, directions = lidar_rays(asked.rays)
    print(f"{len(faces)} triangles, {len(directions)} rays")
    if asked.device != "cpu":
        seconds = launch_time(scene, origins, directions, asked.repeats)
        print(f"{asked.device} {len(directions) / seconds / 1e6:.1f} Mray/s")
        return
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
    for name, seconds in best.items():
        print(f"{name:8s} {len(directions) / seconds / 1e6:.2f} Mray/s of CPU time on a core")


def lidar_rays(count: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Origins and directions of rays from a mast, in 128 rings."""
    columns = count // 128
    azimuth, elevation = np.meshgrid(
        2 * np.pi * np.arange(columns) / columns, np.radians(np.linspace(-22.5, 22.5, 128)), indexing="ij"
    )
    a, e = azimuth.ravel(), elevation.ravel()
    directions = np.column_stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]).astype(np.float32)
    return np.tile([0.0, 0.0, 4.0], (len(directions), 1)).astype(np.float32), directions


def launch_time(scene: Any, origins: NDArray[np.float32], directions: NDArray[np.float32], repeats: int) -> float:
    """Median time [s] of a launch with all arrays on the device."""
    count, device = len(directions), scene.device
    inputs = [
        scene.data, wp.array(origins, dtype=wp.vec3, device=device), wp.array(directions, dtype=wp.vec3, device=device),
        120.0, wp.zeros(count, dtype=wp.int32, device=device),
    ]  # fmt: skip
    kinds: Any = (wp.float32, wp.vec3, wp.int32, wp.uint8, wp.int32, wp.bool)
    outputs = [wp.empty(count, dtype=kind, device=device) for kind in kinds]
    times = []
    for _ in range(repeats + 1):  # the first one compiles
        wp.synchronize_device(device)
        begun = time.perf_counter()
        wp.launch(cast_many, dim=count, inputs=inputs, outputs=outputs, device=device)
        wp.synchronize_device(device)
        times.append(time.perf_counter() - begun)
    return float(np.median(times[1:]))


if __name__ == "__main__":
    main()
