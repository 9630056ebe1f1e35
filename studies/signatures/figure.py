"""The picture of the signatures: one row an effect, families over one another, and the cosines between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from aoro_gym import Machine
from aoro_gym.diagnosis.noise import Floats
from aoro_gym.sensors.chain import measured_flow
from aoro_gym.units import BAR
from studies.signatures.responses import HOLD, NOISE, REST, TICK, Responses

SHOWN = 1.9
"""Time [s] after the command that is drawn: up to short of the stop, whose bounces are far larger."""
COLOURS = ("#222222", "#1b6ca8", "#e08e0b", "#7a9e3b", "#b0417f")
"""Of the families."""
ABBREVIATED = {"default": "D", "library": "L", "valve_maker": "V", "vehicle": "F", "materials": "M"}
"""Families at the heat map's columns."""
MAPS = {
    "cosines": ("whole", False),
    "turns without sway": ("slow", False),
    "nuisances removed": ("whole", True),
}
"""View, and whether nuisances are removed, by title of a heat map."""
LEAST = 1e-3
"""Largest value [L/min, bar] that is drawn as none."""
LITERS_PER_MINUTE = 60000.0


def full_left_turn(machine: Machine, found: Responses, size: str = "typical") -> tuple[Floats, Floats, Floats]:
    """Instants [s] since the command (T,), and what changes add to flow [L/min] and pressure of port A [bar] (E, T) of the
    left turn at 100 %."""
    begin, end = round(REST / TICK) - 10, round((REST + SHOWN) / TICK)
    left = np.s_[: round((2.0 * REST + HOLD[1.0][0]) / TICK)]
    angle_noise, port_noise = NOISE["joint_angle"], NOISE["pressure_a"]
    angles = np.concatenate([found.nominal[None, 0, left], found.nominal[0, left] + found.sizes[size][:, 0, left]])
    flow = measured_flow(machine.steering.cylinder, angle_noise * angles.T, 1.0, rate=1.0 / TICK).T
    pressure = port_noise / BAR * found.sizes[size][:, 1, begin:end]
    time = TICK * np.arange(begin + 1, end + 1) - REST
    return time, LITERS_PER_MINUTE * (flow[1:] - flow[0])[:, begin:end], pressure


def drawn(result: Mapping[str, Any], machines: Sequence[Machine], found: Sequence[Responses], path: Path) -> None:
    """Small multiples of flow and pressure of port A, each with its own scale, and heat maps of cosines.

    Args:
        result: Of :func:`studies.signatures.__main__.compared`.
        machines: Of the families.
        found: Their responses.
        path: Of the picture.
    """
    import matplotlib.pyplot as plt
    from matplotlib.lines import Line2D

    names = list(dict.fromkeys(row["effect"] for row in result["rows"]))
    curves = [full_left_turn(machine, one) for machine, one in zip(machines, found, strict=True)]
    height = 0.5 * len(names) + 1.6
    fig = plt.figure(figsize=(12.0, height))
    grid = fig.add_gridspec(len(names), 5, width_ratios=(4, 4, 2.2, 2.2, 2.2), hspace=0.12, wspace=0.28)
    grid.update(left=0.145, right=0.985, top=1.0 - 1.0 / height, bottom=0.6 / height)
    for row, name in enumerate(names):
        for column, title in enumerate(("flow [L/min]", "pressure of port A [bar]")):
            ax = fig.add_subplot(grid[row, column])
            for (time, *parts), colour in zip(curves, COLOURS, strict=False):
                ax.plot(time, parts[column][row], color=colour, lw=0.8)
            _bare(ax, max(np.abs(parts[column][row]).max() for _, *parts in curves), last=row == len(names) - 1)
            if column == 0:
                ax.set_ylabel(name.replace(".", "\n."), rotation=0, ha="right", va="center", fontsize=9)
            if row == 0:
                ax.set_title(title, fontsize=10, pad=5)
    images = [_heat_map(fig.add_subplot(grid[:, 2 + at]), result, names, title) for at, title in enumerate(MAPS)]
    bar = fig.add_axes((0.8, 1.0 - 0.25 / height, 0.18, 0.12 / height))
    fig.colorbar(images[0], cax=bar, orientation="horizontal", ticks=[-1, -0.5, 0, 0.5, 1]).ax.tick_params(labelsize=8)
    handles = [
        Line2D([], [], color=colour, lw=2, label=f"{family} ({ABBREVIATED[family]})")
        for family, colour in zip(result["families"], COLOURS, strict=False)
    ]
    fig.legend(handles=handles, loc="upper left", ncols=5, fontsize=9, frameon=False)
    fig.savefig(path, dpi=90)
    plt.close(fig)
    Image.open(path).convert("P", palette=Image.Palette.ADAPTIVE, colors=256).save(path, optimize=True)


def _bare(ax: Any, largest: float, *, last: bool) -> None:
    """Axes without a frame, their scale as a text beside them."""
    ax.axhline(0.0, color="0.8", lw=0.5, zorder=0)
    ax.set(xlim=(-0.1, SHOWN), ylim=np.array([-1.1, 1.1]) * max(largest, LEAST), yticks=[])
    scale = f"±{largest:.0f}" if largest >= 9.5 else f"±{largest:.1g}"
    ax.text(1.01, 0.5, scale if largest > LEAST else "0", transform=ax.transAxes, va="center", fontsize=7, color="0.3")
    for side in ("top", "left", "right"):
        ax.spines[side].set_visible(False)
    ax.spines["bottom"].set_color("0.8")
    if last:
        ax.set_xlabel("time since the command [s]", fontsize=9)
    else:
        ax.set_xticks([])
    ax.tick_params(labelsize=8)


def _heat_map(ax: Any, result: Mapping[str, Any], names: Sequence[str], title: str) -> Any:
    """Cosines of pairs of families, one row an effect, of all channels and the typical size."""
    rows = {
        row["effect"]: row["cosines"]
        for row in result["rows"]
        if (row["size"], row["channels"]) == ("typical", "all")
        and (row["view"], row["nuisances_removed"]) == MAPS[title]
    }
    image = ax.imshow(
        np.array([rows[name] for name in names], dtype=np.float64), aspect="auto", cmap="RdBu", vmin=-1.0, vmax=1.0
    )
    ax.set_facecolor("0.85")
    labels = ["\n".join(ABBREVIATED[name] for name in pair.split(" - ")) for pair in result["pairs"]]
    ax.set_xticks(range(len(labels)), labels, fontsize=8)
    ax.set_yticks([])
    ax.set_title(title, fontsize=10, pad=5)
    return image
