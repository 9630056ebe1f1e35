"""Terrains for the twin's tests: planes cut into triangles, rough ground, single features."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter

from aoro_gym.terrains.terrain import Terrain

MIDDLE = 20.0
"""x and y [m] of the middle of :func:`landscape`."""


def landscape(height: Callable[[Any, Any], Any], *, cell: float = 0.1, **options: Any) -> Terrain:
    """Terrain of ``height(x, y)``, x and y counted from its middle, 40 m x 40 m."""
    x = cell * np.arange(round(2.0 * MIDDLE / cell) + 1)
    z = np.broadcast_to(height(x[None, :] - MIDDLE, x[:, None] - MIDDLE), (len(x), len(x)))
    return Terrain.from_heights(z, cell=cell, **options)


def inclined(slope: float, direction: float = 0.0, **options: Any) -> Terrain:
    """Plane that rises by ``slope`` [rad] towards ``direction`` [rad], in triangles of 1 m."""
    rise = np.tan(slope) * np.array([np.cos(direction), np.sin(direction)])
    return landscape(lambda x, y: rise[0] * x + rise[1] * y, cell=1.0, **options)


def rough(seed: int, *, bumps: float, hills: float, cell: float = 0.5) -> Terrain:
    """Bumps of 1 m and hills of 8 m: standard deviation of the bumps [m], and of the hills' heights over 8 m [-]."""
    rng = np.random.default_rng(seed)
    count = round(2.0 * MIDDLE / cell) + 1
    z = np.zeros((count, count))
    for length, deviation in ((1.0, bumps), (8.0, 8.0 * hills)):
        noise = gaussian_filter(rng.standard_normal((count, count)), length / cell, mode="wrap")
        z += deviation / noise.std() * noise
    return Terrain.from_heights(z, cell=cell)


def raised(where: Any, height: float, *, radius: float, shoulder: float = 0.3) -> Callable[[Any, Any], Any]:
    """A table (or, negative, a pit) around ``where`` (x, y) [m], flat up to ``radius``, down over ``shoulder`` [m]."""

    def shape(x: Any, y: Any) -> Any:
        away = np.hypot(x - where[0], y - where[1])
        return height * np.clip(1.0 - (away - radius) / shoulder, 0.0, 1.0)

    return shape
