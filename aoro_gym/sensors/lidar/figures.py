"""A picture of a sweep: from above by height, and as the rings see it by range and by reflectance."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from aoro_gym.reporting.style import INK, SOFT
from aoro_gym.sensors.lidar.points import Points

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REACH = 40.0
"""Half the side of the view from above [m]."""


def draw_sweep(points: Points, centre: tuple[float, float], *, title: str) -> Figure:
    """Three panels of a sweep; ``savefig`` writes it.

    Args:
        points: At least one.
        centre: x, y [m] of the sensor in the world's axes.
        title: Of the figure.
    """
    from matplotlib.figure import Figure

    if not len(points):
        raise ValueError("the sweep has no points; there is nothing to draw")
    figure = Figure(figsize=(10.0, 8.4), layout="constrained")
    plan, far, bright = figure.subplot_mosaic([["a"], ["b"], ["c"]], height_ratios=[3.4, 1, 1]).values()  # type: ignore[misc]
    figure.suptitle(title, color=INK, fontsize=11)
    off = points.world[:, :2] - np.asarray(centre, dtype=np.float32)
    near = (np.abs(off) < REACH).all(axis=1)
    order = np.argsort(points.world[near, 2], kind="stable")
    place = off[near][order]
    height = points.world[near, 2][order]
    bounds: dict[str, Any] = (
        dict(zip(("vmin", "vmax"), np.quantile(height, [0.02, 0.98]), strict=True)) if len(height) else {}
    )
    shown = plan.scatter(*place.T, c=height, s=0.8, linewidths=0, cmap="viridis", **bounds)
    plan.plot(0.0, 0.0, marker="+", color="#d6322a", markersize=9)
    plan.set(aspect="equal", xlim=(-REACH, REACH), ylim=(-REACH, REACH), xlabel="east [m]", ylabel="north [m]")
    figure.colorbar(shown, ax=plan, label="height [m]", shrink=0.9)
    azimuth = np.degrees(np.arctan2(points.points[:, 1], points.points[:, 0]))
    flat = np.hypot(points.points[:, 0], points.points[:, 1])
    elevation = np.degrees(np.arctan2(points.points[:, 2], flat))
    for axes, values, label, top in (
        (far, points.range, "range [m]", float(np.quantile(points.range, 0.98))),
        (bright, points.reflectance, "ρ cos θ", float(np.quantile(points.reflectance, 0.98))),
    ):
        colours = "viridis_r" if axes is far else "gray"
        seen = axes.scatter(azimuth, elevation, c=values, s=0.8, linewidths=0, cmap=colours, vmin=0.0, vmax=top)
        axes.set(xlim=(180, -180), ylabel="elevation [°]", facecolor="#20242a")
        figure.colorbar(seen, ax=axes, label=label)
    bright.set_xlabel("azimuth [°], left is positive; the middle is straight on")
    for axes in (plan, far, bright):
        axes.tick_params(colors=SOFT, labelsize=8)
    return figure
