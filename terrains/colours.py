"""Colours of a ground: those of a scan, of its cover, or of its height, in the light of its slopes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.terrains import Terrain
from aoro_gym.terrains.figures import HEIGHT_COLOURS
from aoro_gym.terrains.world.world import Scene

FARTHEST_COLOUR = 1.0
"""Distance [m] up to which a point of the ground takes the colour of the scan's nearest point."""
BRIGHTER = 2.0
"""By which a world's albedo is multiplied: forests are dark."""
SCANS = (".ply", ".obj", ".glb", ".gltf", ".off", ".stl")
"""Meshes that may hold colours."""


def ground_colours(terrain: Terrain) -> NDArray[np.float64]:
    """(V, 3) from 0 to 1: by height, and the darker the poorer the grip."""
    z = terrain.vertices[:, 2]
    share = (z - z.min()) / max(float(np.ptp(z)), 0.01)
    stops = np.array([[int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)] for colour in HEIGHT_COLOURS])
    places = np.linspace(0.0, 1.0, len(stops))
    colours = np.stack([np.interp(share, places, stops[:, i]) for i in range(3)], axis=1)
    grip = np.broadcast_to(terrain.friction, len(z))
    return colours * (0.6 + 0.4 * np.clip(grip, 0.0, 1.0))[:, None]


def world_colours(scene: Scene) -> NDArray[np.float64]:
    """(V, 3) from 0 to 1: albedo of the material at each vertex of a world, linear as vertex colours are, brightened."""
    albedo = np.zeros((len(scene.vertices), 3))
    albedo[scene.faces] = scene.materials.albedo[scene.face_class][:, None]
    return np.minimum(BRIGHTER * albedo, 1.0)


def scan_colours(file: Path, terrain: Terrain) -> NDArray[np.float64] | None:
    """(V, 3) from 0 to 1: colours of the points of a mesh ``file`` that ``terrain`` was read from; None if it has none.

    A vertex takes the colour of the scan's nearest point; if half of them have none near, the scan was moved or scaled as
    it was read, and its colours cannot be told.
    """
    if file.suffix.lower() not in SCANS:
        return None
    import trimesh
    from scipy.spatial import KDTree

    scan: Any = trimesh.load(file, process=False, force="mesh")
    kind = getattr(scan.visual, "kind", None)
    if kind not in ("vertex", "face", "texture"):
        return None
    points = np.asarray(scan.vertices) - np.asarray(terrain.origin)
    visual = scan.visual.to_color() if kind == "texture" else scan.visual
    distance, nearest = KDTree(points).query(terrain.vertices)
    if np.mean(np.asarray(distance) > FARTHEST_COLOUR) > 0.5:
        return None
    return np.asarray(visual.vertex_colors, dtype=np.float64)[np.asarray(nearest), :3] / 255.0
