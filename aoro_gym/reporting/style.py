"""Colours and lines that figures have in common."""

from __future__ import annotations

from typing import Any

RED, BLUE, GREEN, AMBER, PURPLE = "#c8423b", "#1f77b4", "#2a9d6f", "#e0962b", "#7b5ea7"
INK, SOFT, GRID, SHADE = "#22303c", "#8795a1", "#e3e8ec", "#eef3f7"
"""Of text, of what steps back, of grids, and of shaded periods."""

PLOT_STYLE: Any = {
    "font.size": 9.5,
    "axes.edgecolor": SOFT,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.titlecolor": INK,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "text.color": INK,
    "text.parse_math": False,  # names hold dollars
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
}
"""Settings of matplotlib for plots on a page, as ``matplotlib.rc_context`` takes them."""
