"""The atlas of what looks alike as JSON, tables and a figure."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from itertools import combinations, permutations
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from aoro_gym.diagnosis_benchmark.atlas import Atlas, classes_of
from aoro_gym.execution.files import write_text, written_whole
from aoro_gym.reporting.style import BLUE, INK, PLOT_STYLE, RED, SHADE, SOFT

CLOSE = 3.0
"""How far apart effects are that a table lists as nearly alike."""
FARTHEST = 30.0
"""How far apart effects are that the figure shows as farthest."""
TITLES = {"angle": "joint angle alone", "full": "joint angle and pressures"}


def write_atlas(atlas: Atlas, folder: Path) -> list[Path]:
    """Write ``atlas.json``, ``classes.json`` and ``atlas.png``; returns their paths."""
    paths = [folder / name for name in ("atlas.json", "classes.json", "atlas.png")]
    content = atlas.as_dict()
    _write(paths[0], content)
    _write(paths[1], classes_of(Atlas.from_dict(content)))  # by the rounded figures, which can be looked up
    _draw(atlas, paths[2])
    return paths


def _write(path: Path, content: Mapping[str, Any]) -> None:
    """As JSON, with a line for each innermost list."""
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
    write_text(path, re.sub(r"\[[^\[\]{}]*\]", lambda found: re.sub(r"\s+", " ", found[0]), text) + "\n")


def tables(atlas: Atlas) -> Iterator[Table]:
    """Classes, and what is nearly alike, by sensors."""
    for sensors in atlas.views:
        classes = atlas.classes(sensors)
        hidden = [name for name in atlas.effects if name not in atlas.seen(sensors)]
        table = Table(title=f"Alike by {TITLES[sensors]}", title_justify="left", header_style="bold")
        for name in ("effects", "apart", "best told by"):
            table.add_column(name, overflow="fold")
        for group in classes:
            table.add_row(" = ".join(group), *_told(atlas, sensors, group))
        own = {name: group for group in classes for name in group}
        apart = atlas.apart(sensors)
        for i, j in combinations(range(len(atlas.effects)), 2):
            a, b = atlas.effects[i], atlas.effects[j]
            if apart[i, j] < CLOSE and b not in own.get(a, ()):
                table.add_row(f"{a}, {b}", *_told(atlas, sensors, [a, b]))
        if hidden:
            table.add_row(", ".join(hidden), "", "nothing: they do not stand out")
        yield table


def _told(atlas: Atlas, sensors: str, group: list[str]) -> tuple[str, str]:
    """How far apart the two of a ``group`` are that are farthest, and by which manoeuvre best."""
    apart = atlas.apart(sensors)
    index = [atlas.effects.index(name) for name in group]
    far, a, b = max((apart[i, j], i, j) for i, j in combinations(index, 2))
    manoeuvre, alone = atlas.best(sensors, atlas.effects[a], atlas.effects[b])
    return f"{far:.2g}", f"{manoeuvre} ({alone:.2g})"


def _draw(atlas: Atlas, path: Path) -> None:
    """How far apart every two effects look, by sensors: a number where that is little, classes framed."""
    import matplotlib
    from matplotlib.colors import LinearSegmentedColormap, LogNorm
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    count = len(atlas.effects)
    # alike in red, else the paler the farther apart; the edge lies at 1, half-way by the logarithm
    shade = LinearSegmentedColormap.from_list("apart", [(0.0, RED), (0.5, "#eeb0a8"), (0.5, BLUE), (1.0, SHADE)])
    shade = shade.with_extremes(bad=SOFT)
    norm = LogNorm(1.0 / FARTHEST, FARTHEST)
    with matplotlib.rc_context(PLOT_STYLE):
        figure = Figure(figsize=(16.0, 9.2), layout="constrained")
        panels = figure.subplots(1, len(atlas.views), sharey=True)
        for axes, sensors in zip(panels, atlas.views, strict=True):
            apart = atlas.apart(sensors)
            np.fill_diagonal(apart, np.nan)
            image = axes.imshow(np.clip(apart, 1.0 / FARTHEST, FARTHEST), cmap=shade, norm=norm)
            for i, j in np.argwhere(apart < CLOSE):
                colour = "white" if apart[i, j] > 1.0 else "black"
                axes.text(j, i, f"{apart[i, j]:.2f}", ha="center", va="center", color=colour, fontsize=6)
            for k in range(count):
                axes.add_patch(Rectangle((k - 0.5, k - 0.5), 1.0, 1.0, facecolor="white", edgecolor="white"))
            for group in atlas.classes(sensors):
                for i, j in permutations(map(atlas.effects.index, group), 2):
                    axes.add_patch(Rectangle((j - 0.5, i - 0.5), 1.0, 1.0, fill=False, edgecolor=INK, zorder=3))
            axes.set_xticks(range(count), atlas.effects, rotation=90)
            axes.set_yticks(range(count), atlas.effects)
            axes.set_xticks(np.arange(count) + 0.5, minor=True)
            axes.set_yticks(np.arange(count) + 0.5, minor=True)
            axes.grid(which="minor", color="white")
            axes.tick_params(which="both", length=0)
            axes.set_title(f"Logged: {TITLES[sensors]}", loc="left")
        ticks = [value for value in (0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0) if 1.0 / FARTHEST <= value <= FARTHEST]
        bar = figure.colorbar(image, ax=panels, shrink=0.6, pad=0.01)
        bar.set_ticks(ticks, labels=[f"{value:g}" for value in ticks], minor=False)
        bar.minorticks_off()
        bar.set_label("how far apart: alike below 1, classes framed; grey: does not stand out")
        with written_whole(path) as temporary:
            figure.savefig(temporary, dpi=120, bbox_inches="tight")
