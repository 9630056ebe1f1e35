"""Plan views of terrains: hillshade, cover or height in colour, contours, what stands there, and a path."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.reporting.style import INK, SOFT
from aoro_gym.terrains.generate.forest import COVERS, Obstacle, Zone
from aoro_gym.terrains.heights import Heights, sample_triangles
from aoro_gym.terrains.paths.path import Path
from aoro_gym.terrains.terrain import Terrain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PATH = "#d6322a"
ZONE_COLOURS = {
    Zone.ASPHALT: "#8d9299",
    Zone.GRAVEL: "#cbb994",
    Zone.GRASS: "#a9c178",
    Zone.FOREST: "#7f8f5e",
    Zone.WET: "#6f95a8",
}
HEIGHT_COLOURS = ["#5f8a73", "#8fae7f", "#c3c791", "#e2d3a2", "#cfae86", "#b08d74", "#d8cdc6"]
"""From the lowest to the highest ground."""
STANDING_COLOURS = {"tree": "#2f5d3a", "stump": "#6b4a2b", "boulder": "#5b5f66"}

MOST_PIXELS = 800
"""Heights along the longer side of a figure."""
LIGHTS = ((315.0, 42.0, 0.62), (250.0, 50.0, 0.2), (20.0, 55.0, 0.18))
"""Azimuth (clockwise from north) and elevation [deg] of the light, and its share: one in the north-west, two fill in."""
EXAGGERATION = 1.6
"""Of slopes in the hillshade, so that gentle ground shows."""


def draw_terrain(
    terrain: Terrain, path: Path | None = None, *, obstacles: Iterable[Obstacle] = (), title: str | None = None
) -> Figure:
    """A plan view of ``terrain``, with ``path`` and what stands on it; ``savefig`` writes it.

    Ground whose multipliers are those of the generated covers is coloured by cover, other ground by height; what has no
    ground stays white.

    Args:
        terrain: Drawn as its lowest surface.
        path: Drawn with its start and direction.
        obstacles: Such as a generated forest's.
        title: The terrain's name by default.
    """
    from matplotlib.figure import Figure

    low, high = terrain.extent
    size = (high - low)[:2]
    scale = 8.2 / max(size)
    # room for axes and a title, and beside the ground for the legend
    figure = Figure(figsize=(float(max(scale * size[0], 3.0)) + 2.7, float(max(scale * size[1], 3.0)) + 1.1), dpi=150)
    axes = figure.add_subplot()
    cell = float(max(size) / MOST_PIXELS)
    heights = sample_triangles(terrain.vertices, terrain.faces, cell)[0]
    zones = _zones(terrain, heights)
    handles = _draw_ground(figure, axes, heights, zones)
    handles += _draw_obstacles(axes, obstacles)
    if path is not None:
        handles += _draw_path(axes, path, max(size))
    _finish(axes, low, high, handles, title or terrain.name)
    return figure


def _zones(terrain: Terrain, heights: Heights) -> NDArray[np.int64] | None:
    """(rows, columns) :class:`Zone` over the grid; None if the terrain's multipliers are not those of covers."""
    from scipy.ndimage import gaussian_filter
    from scipy.spatial import KDTree

    table = np.array([COVERS[zone] for zone in Zone])
    count = len(terrain.vertices)
    pairs = np.stack([np.broadcast_to(v, count) for v in (terrain.friction, terrain.rolling_resistance)], axis=1)
    matches: Any = np.isclose(pairs[:, None], table, atol=1e-6).all(axis=2)
    if not matches.any(axis=1).all() or np.all(pairs == pairs[0]):
        return None
    rows, columns = heights.z.shape
    x, y = np.meshgrid(*(heights.corner[axis] + heights.cell * np.arange(n) for axis, n in ((0, columns), (1, rows))))
    nearest: Any = KDTree(terrain.vertices[:, :2]).query(np.stack([x, y], axis=-1))[1]
    label = np.argmax(matches, axis=1)[nearest]
    # vertices are steps on a slanting edge: weigh what lies within their distance
    between = np.sqrt(np.prod((terrain.extent[1] - terrain.extent[0])[:2]) / count)
    return np.argmax([gaussian_filter((label == zone) * 1.0, 0.8 * between / heights.cell) for zone in Zone], axis=0)


def _draw_ground(figure: Figure, axes: Axes, heights: Heights, zones: NDArray[np.int64] | None) -> list[Any]:
    from matplotlib.colors import LinearSegmentedColormap, Normalize, to_rgb
    from matplotlib.patches import Patch

    z = heights.z
    rows, columns = z.shape
    x, y = (heights.corner[axis] + heights.cell * np.arange(n) for axis, n in ((0, columns), (1, rows)))
    lowest, highest = float(np.nanmin(z)), float(np.nanmax(z))
    handles: list[Any] = []
    if zones is None:
        tint = LinearSegmentedColormap.from_list("heights", HEIGHT_COLOURS)
        span = Normalize(lowest, max(highest, lowest + 0.01))
        colour = tint(span(np.nan_to_num(z, nan=lowest)))[..., :3]
    else:
        palette = np.array([to_rgb(ZONE_COLOURS[zone]) for zone in Zone])
        colour = palette[zones]
        present = [zone for zone in ZONE_COLOURS if np.any(zones == zone)]
        handles = [Patch(facecolor=ZONE_COLOURS[zone], label=zone.name.lower()) for zone in present]
    if not heights.known.all():
        handles.append(Patch(facecolor="white", edgecolor=SOFT, linewidth=0.7, label="no ground"))
    image = np.concatenate([_shaded(colour, heights), heights.known[..., None]], axis=2)
    edge = 0.5 * heights.cell
    extent = (x[0] - edge, x[-1] + edge, y[0] - edge, y[-1] + edge)
    axes.imshow(np.clip(image, 0.0, 1.0), origin="lower", extent=extent, interpolation="bilinear")
    if highest - lowest > 0.1:
        step = _round_step((highest - lowest) / 14.0)
        levels = step * np.arange(np.ceil(lowest / step), np.floor(highest / step) + 1)
        thick = np.where(np.round(levels / step) % 5 == 0, 0.8, 0.35)
        smooth = np.ma.masked_invalid(_smoothed(z, heights.cell))
        axes.contour(x, y, smooth, levels=levels, colors=INK, alpha=0.35, linewidths=thick, linestyles="solid")
    if zones is None:
        from matplotlib.cm import ScalarMappable

        bar = figure.colorbar(ScalarMappable(span, tint), ax=axes, fraction=0.035, pad=0.03, aspect=30)
        bar.set_label("height [m]", color=INK)
        bar.outline.set_visible(False)  # type: ignore[union-attr]
    return handles


def _shaded(colour: NDArray[np.float64], heights: Heights) -> NDArray[np.float64]:
    """(rows, columns, 3) colours in the light."""
    z = heights.z
    filled = np.where(np.isfinite(z), z, np.nanmean(z))
    north, east = np.gradient(EXAGGERATION * filled, heights.cell)
    up = 1.0 / np.sqrt(1.0 + north**2 + east**2)
    light = np.zeros(z.shape)
    for azimuth, elevation, share in LIGHTS:
        a, e = np.radians(azimuth), np.radians(elevation)
        towards = np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), np.sin(e)
        light += share * np.clip((towards[2] - towards[0] * east - towards[1] * north) * up / np.sin(e), 0.0, None)
    # level ground keeps its colour; shadows are cool, lit slopes warm
    dark, bright = np.clip(1.0 - light, 0.0, 1.0)[..., None], np.clip(light - 1.0, 0.0, 0.5)[..., None]
    return colour * (1.0 - dark * np.array([0.95, 0.9, 0.78])) + (1.0 - colour) * bright * np.array([0.95, 0.9, 0.75])


def _smoothed(z: NDArray[np.float64], cell: float) -> Any:
    """Heights without what is smaller than a vehicle, for contours that can be read."""
    from scipy.ndimage import gaussian_filter

    known = np.isfinite(z)
    sigma = min(max(1.0 / cell, 0.5), 12.0)
    weight: Any = gaussian_filter(known.astype(np.float64), sigma)
    total: Any = gaussian_filter(np.where(known, z, 0.0), sigma)
    return np.where(known, total / np.maximum(weight, 1e-9), np.nan)


def _draw_obstacles(axes: Axes, obstacles: Iterable[Obstacle]) -> list[Any]:
    from matplotlib.collections import PatchCollection
    from matplotlib.lines import Line2D
    from matplotlib.patches import Circle

    handles = []
    found = list(obstacles)
    for kind, colour in STANDING_COLOURS.items():
        chosen = [o for o in found if o.kind == kind]
        if not chosen:
            continue
        if kind == "tree":  # crowns as wide as a spruce's, about a sixth of its height
            crowns = [Circle((o.x, o.y), 0.08 * o.height) for o in chosen]
            shadows = [Circle((o.x + 0.3, o.y - 0.3), 0.08 * o.height) for o in chosen]
            axes.add_collection(PatchCollection(shadows, facecolor="black", alpha=0.16, linewidth=0.0))
            axes.add_collection(
                PatchCollection(crowns, facecolor=colour, alpha=0.6, edgecolor="#1d3d26", linewidth=0.4)
            )
        feet = [Circle((o.x, o.y), max(o.radius, 0.15)) for o in chosen]
        axes.add_collection(PatchCollection(feet, facecolor=colour, edgecolor="none", alpha=0.85))
        handles.append(Line2D([], [], linestyle="none", marker="o", markersize=6, color=colour, label=kind))
    return handles


def _draw_path(axes: Axes, path: Path, size: float) -> list[Any]:
    from matplotlib.lines import Line2D

    around = np.concatenate([path.points, path.points[:1]]) if path.closed else path.points
    axes.plot(*around.T, color="white", linewidth=3.6, alpha=0.9, solid_capstyle="round", zorder=5)
    axes.plot(*around.T, color=PATH, linewidth=1.9, solid_capstyle="round", zorder=6)
    spacing = size / 6.0
    for s in np.arange(0.5 * spacing, path.length, spacing):
        (x, y), heading = path.position(s), float(path.heading(s))
        axes.plot(
            x, y, marker=(3, 0, np.degrees(heading) - 90.0), markersize=7, color=PATH, mec="white", mew=0.8, zorder=7
        )
    axes.plot(*path.points[0], marker="o", markersize=8, color="white", mec=PATH, mew=2.2, zorder=8)
    return [
        Line2D(
            [], [], color=PATH, linewidth=1.9, marker="o", markerfacecolor="white", label=f"path, {path.length:.0f} m"
        )
    ]


def _finish(axes: Axes, low: NDArray[np.float64], high: NDArray[np.float64], handles: list[Any], title: str) -> None:
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    axes.set_xlabel("x, east [m]", color=INK)
    axes.set_ylabel("y, north [m]", color=INK)
    axes.tick_params(colors=INK, labelsize=8, length=3)
    for spine in axes.spines.values():
        spine.set_color(SOFT)
    relief = high[2] - low[2]
    axes.set_title(title, loc="left", color=INK, fontsize=11, fontweight="bold", pad=8, parse_math=False)
    note = f"{high[0] - low[0]:.0f} m x {high[1] - low[1]:.0f} m, relief {relief:.1f} m"
    if handles:
        place_legend(axes, handles)
    if handles and len(axes.figure.axes) == 1:
        axes.annotate(
            note.replace(", ", "\n"), (1.05, 0.0), xycoords="axes fraction", fontsize=8, color=SOFT, va="bottom"
        )
    else:
        axes.annotate(note, (1.0, 1.01), xycoords="axes fraction", fontsize=8, color=SOFT, ha="right")


def place_legend(axes: Axes, handles: list[Any]) -> None:
    """Right of the ground, or below it where a bar of heights stands there; it replaces the one before."""
    if len(axes.figure.axes) == 1:
        place: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (1.02, 1.0)}
    else:
        place = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.07), "ncols": 4}
    axes.legend(handles=handles, frameon=False, fontsize=8.5, labelcolor=INK, **place)


def _round_step(step: float) -> float:
    """The smallest of 1, 2, 5 times a power of ten that is at least ``step``."""
    power = 10.0 ** np.floor(np.log10(step))
    return float(next(power * factor for factor in (1.0, 2.0, 5.0, 10.0) if power * factor >= step * (1.0 - 1e-9)))
