"""The ground: its colour, and the cells of it that a camera sees."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from aoro_gym.envs.path_tracking.courses import HeightMap
from aoro_gym.envs.path_tracking.rendering.camera import FAR, FOCAL, SUN, Camera, hazed
from aoro_gym.machine.solid import Points

LEVELS = ((0.25, 13.0), (0.6, 28.0), (1.5, 60.0), (4.0, FAR))
"""Cells of the ground [m], each up to a distance [m]."""
MOSS, GRASS, SOIL = np.array([0.30, 0.38, 0.18]), np.array([0.47, 0.52, 0.26]), np.array([0.45, 0.37, 0.27])


def smooth_noise(x: Points, y: Points, cell: float) -> Points:
    """Smooth random numbers in [0, 1] over the plan, the same at the same place."""
    u, v = np.asarray(x) / cell, np.asarray(y) / cell
    i, j = np.floor(u), np.floor(v)
    fu, fv = u - i, v - j
    fu, fv = fu * fu * (3.0 - 2.0 * fu), fv * fv * (3.0 - 2.0 * fv)

    def corner(di: float, dj: float) -> Points:
        value = np.sin((i + di) * 12.9898 + (j + dj) * 78.233) * 43758.5453
        return value - np.floor(value)

    low = corner(0, 0) * (1 - fu) + corner(1, 0) * fu
    high = corner(0, 1) * (1 - fu) + corner(1, 1) * fu
    return low * (1 - fv) + high * fv


def ground_colour(x: Points, y: Points, slope_x: Any, slope_y: Any) -> Points:
    """Colours (..., 3) of the ground at a place with its slopes [-], in the sun: moss, grass, and soil where it is steep."""
    patches = 0.6 * smooth_noise(x, y, 4.0) + 0.4 * smooth_noise(x + 31.0, y, 1.1)
    colour = MOSS + (GRASS - MOSS) * np.clip(1.6 * patches - 0.3, 0.0, 1.0)[..., None]
    steep = np.hypot(slope_x, slope_y)
    bare = np.clip((steep - 0.18) / 0.3 + 0.25 * (smooth_noise(x, y + 57.0, 2.3) - 0.5), 0.0, 1.0)
    colour = colour + (SOIL - colour) * bare[..., None]
    length = np.sqrt(1.0 + slope_x**2 + slope_y**2)
    light = (SUN[2] - SUN[0] * slope_x - SUN[1] * slope_y) / length
    # steeper relief than true: gentle slopes should be seen
    exaggerated = (SUN[2] - 2.0 * (SUN[0] * slope_x + SUN[1] * slope_y)) / np.sqrt(1.0 + 4.0 * steep**2)
    grain = 0.94 + 0.12 * smooth_noise(x, y, 0.37)
    return np.clip(colour * ((0.45 + 0.5 * light + 0.4 * (exaggerated - SUN[2])) * grain)[..., None] * 1.25, 0.0, 1.0)


def ground_cells(camera: Camera, height_map: HeightMap, course: int) -> tuple[Points, Points]:
    """Squares (K, 4, 2) of the picture and their colours (K, 3), from the far to the near."""
    squares, colours, depths = [], [], []
    for level, (cell, reach) in enumerate(LEVELS):
        nearest = LEVELS[level - 1][1] - 1.5 * cell if level else 0.0
        middle = _cells_in_view(camera, cell, nearest, reach)
        middle = middle[height_map.known(np.full(len(middle), course), middle)]
        corners = middle[:, None] + 0.5 * cell * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        z = height_map.height(np.full(4 * len(middle), course), corners.reshape(-1, 2)).reshape(-1, 4)
        slope_x = (z[:, 1] + z[:, 2] - z[:, 0] - z[:, 3]) / (2.0 * cell)
        slope_y = (z[:, 2] + z[:, 3] - z[:, 0] - z[:, 1]) / (2.0 * cell)
        seen, depth = camera.seen(np.concatenate([corners, z[..., None]], axis=-1))
        kept = (depth.min(axis=1) > 0.4) & (np.abs(seen[..., 0]).min(axis=1) < 1.05) & (seen[..., 1].max(axis=1) > -1.0)
        distance = depth.mean(axis=1)[kept]
        colour = ground_colour(middle[:, 0], middle[:, 1], slope_x, slope_y)[kept]
        squares.append(seen[kept])
        colours.append(hazed(colour, distance[:, None]))
        depths.append(distance)
    order = np.argsort(-np.concatenate(depths), kind="stable")
    return np.concatenate(squares)[order], np.concatenate(colours)[order]


def _cells_in_view(camera: Camera, cell: float, nearest: float, reach: float) -> Points:
    """Middles (K, 2) of the cells between two distances [m] that the camera may see."""
    eye = camera.eye
    number = np.arange(-math.ceil(reach / cell), math.ceil(reach / cell) + 1)
    x = (np.floor(eye[0] / cell) + number) * cell
    y = (np.floor(eye[1] / cell) + number) * cell
    middle = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2) + 0.5 * cell
    apart = middle - eye[:2]
    distance = np.hypot(apart[:, 0], apart[:, 1])
    off = np.abs((np.arctan2(apart[:, 1], apart[:, 0]) - camera.heading + np.pi) % (2.0 * np.pi) - np.pi)
    wide = math.atan(1.0 / FOCAL) + np.minimum(1.5 * cell / np.maximum(distance, 0.1), 1.0) + 0.1
    return middle[(distance >= nearest) & (distance < reach) & ((off < wide) | (distance < 8.0))]
