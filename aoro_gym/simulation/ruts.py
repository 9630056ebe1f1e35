"""Ruts that a machine left in soft ground: their figures, and a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.execution.files import written_whole
from aoro_gym.reporting.style import INK, PLOT_STYLE, RED, SOFT
from aoro_gym.reporting.terminal import Comparison
from aoro_gym.simulation.manoeuvres import Trajectory
from aoro_gym.twin.soil_ruts import Ruts

LEAST = 1e-3
"""Depth [m] from which a node counts as a rut."""
MARGIN = 0.5
"""Ground [m] that a picture shows around the ruts."""


def rut_figures(ruts: Ruts) -> dict[str, float]:
    """Mean and largest depth [m] of the nodes in ruts, area [m²] and volume [m³] of the ruts that stay, and where passes
    count the most wheels over a node."""
    counted = {} if ruts.passes is None else {"rut_passes_max": int(ruts.passes.max(initial=0))}
    inside = ruts.depth[ruts.depth > LEAST].astype(np.float64)
    return {
        "rut_depth_mean_m": float(inside.mean()) if len(inside) else 0.0,
        "rut_depth_max_m": float(inside.max(initial=0.0)),
        "rut_area_m2": len(inside) * ruts.cell**2,
        "rut_volume_m3": ruts.volume,
        **counted,
    }


def rut_table(figures: dict[str, float]) -> Comparison:
    """The table of :func:`rut_figures`."""
    rows = [
        ["mean depth", f"{100.0 * figures['rut_depth_mean_m']:.1f}", "cm"],
        ["largest depth", f"{100.0 * figures['rut_depth_max_m']:.1f}", "cm"],
        ["area", f"{figures['rut_area_m2']:.1f}", "m²"],
        ["volume", f"{figures['rut_volume_m3']:.2f}", "m³"],
    ]
    if "rut_passes_max" in figures:
        rows.append(["most wheels over a place", f"{figures['rut_passes_max']}", "1"])
    return Comparison("Ruts", ("of the ruts that stay", "value", "unit"), rows)


def write_ruts(path: Path, ruts: Ruts, recording: Trajectory, soil: str) -> None:
    """Draw the ruts from above with the way of the hinge, and a section across their deepest place.

    Args:
        path: PNG to write.
        ruts: Of the twin that was recorded.
        recording: Its recording.
        soil: What the title calls the soil.
    """
    import matplotlib
    from matplotlib.figure import Figure

    depth = 100.0 * ruts.depth.astype(np.float64)
    rows, columns = np.nonzero(depth > 100.0 * LEAST)
    x, y = (ruts.corner[i] + ruts.cell * np.arange(n) for i, n in enumerate(depth.shape[::-1]))
    with matplotlib.rc_context(PLOT_STYLE | {"font.size": 9.0}):
        figure = Figure(figsize=(11.5, 5.2), dpi=130, layout="constrained")
        figure.suptitle(f"Ruts in {soil}", x=0.012, ha="left", fontsize=14, fontweight="bold")
        plan, across = figure.subplots(1, 2, width_ratios=[2.2, 1.0])
        edges = (x[0] - 0.5 * ruts.cell, x[-1] + 0.5 * ruts.cell, y[0] - 0.5 * ruts.cell, y[-1] + 0.5 * ruts.cell)
        shown: Any = np.ma.masked_less_equal(depth, 100.0 * LEAST)
        picture = plan.imshow(shown, origin="lower", extent=edges, cmap="YlOrBr", vmin=0.0, interpolation="nearest")
        figure.colorbar(picture, ax=plan, label="depth that stays [cm]", orientation="horizontal", aspect=45)
        plan.plot(recording["position_x"], recording["position_y"], color=INK, lw=1.0, label="way of the hinge")
        plan.legend(frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderpad=0.0, borderaxespad=0.3)
        if len(rows):
            plan.set_xlim(x[columns.min()] - MARGIN, x[columns.max()] + MARGIN)
            plan.set_ylim(y[rows.min()] - MARGIN, y[rows.max()] + MARGIN)
            _section(plan, across, depth, x, y)
        plan.set(xlabel="x [m]", ylabel="y [m]")
        plan.set_aspect("equal")
        with written_whole(path) as temporary:
            figure.savefig(temporary)


def _section(plan: Any, across: Any, depth: Any, x: Any, y: Any) -> None:
    """Depth across the deepest place: along y, or along x where the rut there is longer along y."""
    row, column = np.unravel_index(int(np.argmax(depth)), depth.shape)
    inside = depth > 100.0 * LEAST
    along_y = inside[:, column].sum() <= inside[row].sum()
    place, profile = (y, depth[:, column]) if along_y else (x, depth[row])
    (plan.axvline if along_y else plan.axhline)((x[column] if along_y else y[row]), color=RED, lw=1.0, ls=(0, (5, 2)))
    across.plot(place, -profile, color=RED, lw=1.7)
    across.axhline(0.0, color=SOFT, lw=0.8)
    at = f"x = {x[column]:.1f} m" if along_y else f"y = {y[row]:.1f} m"
    across.set_title(f"Section at {at} [cm]", loc="left", fontsize=10, fontweight="bold")
    across.set_xlabel("y [m]" if along_y else "x [m]")
    across.grid(True)
    across.spines[["top", "right"]].set_visible(False)
    within = np.flatnonzero(profile > 100.0 * LEAST)
    across.set_xlim(place[within[0]] - MARGIN, place[within[-1]] + MARGIN)
