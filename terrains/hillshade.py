"""A terrain from above: lit from the north-west, coloured by height, with places without ground marked."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.terrains.check import Report
from aoro_gym.terrains.heights import Heights, sample_triangles
from aoro_gym.terrains.terrain import Terrain

MOST_PIXELS = 1_000_000
"""Of the drawn grid; wider terrains are drawn coarser."""
OPEN = "#c8423b"
"""Colour of what has no ground."""
INK, SOFT = "#22303c", "#8795a1"


def write_hillshade(terrain: Terrain, report: Report, path: Path) -> None:
    """Write the picture (PNG) of ``terrain``; coordinates are local metres."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LightSource, Normalize
    from matplotlib.figure import Figure

    heights = _drawn(terrain)
    z = heights.z
    low, high = (float(v) for v in np.nanpercentile(z, [0.0, 100.0]))
    norm = Normalize(low, high if high > low else low + 1.0)
    colours: Any = colormaps["gist_earth"]
    light = LightSource(azdeg=315.0, altdeg=45.0)
    # Unknown heights must not cast slopes on their neighbours: they take the nearest height and are painted over.
    shade = light.shade_rgb(
        colours(0.15 + 0.75 * norm(_closed(heights)))[..., :3],
        _closed(heights),
        dx=heights.cell,
        dy=heights.cell,
        blend_mode="soft",
    )
    west, south = heights.corner
    east, north = west + heights.cell * (z.shape[1] - 1), south + heights.cell * (z.shape[0] - 1)
    width = 7.0
    figure = Figure(
        figsize=(width + 1.4, float(np.clip(width * (north - south) / (east - west), 2.5, 12.0)) + 1.0),
        layout="constrained",
    )
    axes = figure.add_subplot()
    axes.imshow(shade, origin="lower", extent=(west, east, south, north), interpolation="nearest")
    gaps = np.zeros((*z.shape, 4))
    gaps[~heights.known] = (*(int(OPEN[i : i + 2], 16) / 255.0 for i in (1, 3, 5)), 0.75)
    axes.imshow(gaps, origin="lower", extent=(west, east, south, north), interpolation="nearest")
    axes.set_xlabel("x east [m]", color=INK)
    axes.set_ylabel("y north [m]", color=INK)
    axes.tick_params(colors=SOFT, labelcolor=INK)
    size = f"{report.extent_m[0]:.4g} m x {report.extent_m[1]:.4g} m"
    title = f"{terrain.name}: {size}, median slope {report.slope_median_deg:.1f}°"
    if not heights.known.all():
        title += ", red: no ground"
    axes.set_title(title, loc="left", fontsize=10.5, color=INK)
    bar = figure.colorbar(ScalarMappable(norm, _part(colours)), ax=axes, shrink=0.8)
    bar.set_label("height z [m]", color=INK)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130)


def _drawn(terrain: Terrain) -> Heights:
    low, high = terrain.extent
    area = float(np.prod((high - low)[:2]))
    finest = float(np.sqrt(area / MOST_PIXELS))
    longest = float((high - low)[:2].max())
    return sample_triangles(terrain.vertices, terrain.faces, max(finest, longest / 700.0))[0]


def _closed(heights: Heights) -> Any:
    from scipy.ndimage import distance_transform_edt

    nearest: Any = distance_transform_edt(~heights.known, return_distances=False, return_indices=True)
    return heights.z[tuple(nearest)]


def _part(colours: Any) -> Any:
    """The part of the colour map that the picture uses."""
    from matplotlib.colors import ListedColormap

    return ListedColormap(colours(np.linspace(0.15, 0.9, 256)))
