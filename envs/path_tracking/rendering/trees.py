"""Trees: spruces as flat shapes that face the camera."""

from __future__ import annotations

import math

import numpy as np

from aoro_gym.envs.path_tracking.rendering.camera import SUN, Camera, hazed
from aoro_gym.envs.path_tracking.rendering.ground import smooth_noise
from aoro_gym.machine.solid import Points

TRUNK, SHADE, LIT = np.array([0.27, 0.20, 0.15]), np.array([0.11, 0.21, 0.12]), np.array([0.17, 0.30, 0.15])
TIERS = ((0.12, 0.56, 1.0), (0.36, 0.78, 0.74), (0.58, 1.0, 0.48))
"""Lower and upper end of each, as shares of the height, and its width as a share of the lowest one's."""

Shapes = tuple[list[Points], list[Points]]
"""Outlines (P, 2) in the picture and their colours with opacity (4,)."""


def tree_shapes(camera: Camera, trees: Points, base: Points, apart: float) -> tuple[Shapes, Shapes]:
    """Trees behind the machine and before it, from the far to the near.

    Args:
        camera: What sees them.
        trees: Place, radius of the trunk and height of each [m] (T, 4).
        base: Height of the ground there [m] (T,).
        apart: Distance of the machine from the camera [m].
    """
    aside = np.array([math.sin(camera.heading), -math.cos(camera.heading)])
    lit = 1.0 if SUN[:2] @ aside > 0.0 else -1.0
    distances = np.hypot(*(trees[:, :2] - camera.eye[:2]).T)
    behind, before = shapes = (([], []), ([], []))
    for i in np.argsort(-distances):
        distance = distances[i]
        if distance <= 6.0:
            continue
        outlines, colours = behind if distance > apart else before
        for flat, paint in _spruce(trees[i], lit):
            points = np.column_stack([trees[i, :2] + flat[:, :1] * aside, base[i] + flat[:, 1]])
            seen, depth = camera.seen(points)
            if depth.min() < 1.0 or np.abs(seen[:, 0]).min() > 1.1:
                break
            outlines.append(seen)
            opacity = 0.2 if distance < apart else 1.0  # see the machine through what stands before it
            colours.append(np.append(hazed(paint, distance), opacity))
    return shapes


def _spruce(tree: Points, lit: float) -> list[tuple[Points, Points]]:
    """Outlines (P, 2), aside and up [m], and colours of a trunk and three tiers, lit from the sun's side."""
    x, y, radius, height = tree
    spread = 0.17 * height
    trunk = np.array([(-radius, 0.0), (radius, 0.0), (radius, 0.25 * height), (-radius, 0.25 * height)])
    brightness = 0.85 + 0.25 * smooth_noise(x, y, 0.7)
    parts = [(trunk, TRUNK)]
    for low, high, wide in TIERS:
        tip, edge = (0.0, high * height), wide * spread
        parts.append((np.array([(-edge, low * height), (edge, low * height), tip]), SHADE * brightness))
        parts.append((np.array([(0.0, low * height), (lit * edge, low * height), tip]), LIT * brightness))
    return parts
