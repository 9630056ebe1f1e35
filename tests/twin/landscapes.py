"""Terrains for the twin's tests: planes cut into triangles, rough ground, single features."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter

from aoro_gym.terrains.terrain import Terrain

AVERAGED = ("raster", "mesh")
"""Kinds of ground that tires feel as an averaged plane."""

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


def noise(rng: np.random.Generator, shape: tuple[int, ...], length: float) -> np.ndarray:
    """Smooth noise of unit standard deviation and a correlation ``length`` in cells."""
    smooth = gaussian_filter(rng.standard_normal(shape), length, mode="wrap")
    return smooth / smooth.std()


def rough(seed: int, *, bumps: float, hills: float, cell: float = 0.5) -> Terrain:
    """Bumps of 1 m and hills of 8 m: standard deviation of the bumps [m], and of the hills' heights over 8 m [-]."""
    rng = np.random.default_rng(seed)
    shape = (round(2.0 * MIDDLE / cell) + 1,) * 2
    return Terrain.from_heights(
        bumps * noise(rng, shape, 1.0 / cell) + 8.0 * hills * noise(rng, shape, 8.0 / cell), cell=cell
    )


def raised(where: Any, height: float, *, radius: float, shoulder: float = 0.3) -> Callable[[Any, Any], Any]:
    """A table (or, negative, a pit) around ``where`` (x, y) [m], flat up to ``radius``, down over ``shoulder`` [m]."""

    def shape(x: Any, y: Any) -> Any:
        away = np.hypot(x - where[0], y - where[1])
        return height * np.clip(1.0 - (away - radius) / shoulder, 0.0, 1.0)

    return shape
