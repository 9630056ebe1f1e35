"""What a world holds, as a table and as JSON."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from aoro_gym.terrains.world.objects import Object, Tree
from aoro_gym.terrains.world.world import World


def summary(world: World) -> dict[str, Any]:
    """Figures of a world as JSON's types; of trees by species."""
    over = world.drivable()
    kinds: dict[str, list[tuple[Object, bool]]] = {}
    for one, passable in zip(world.objects, over, strict=True):
        name = f"tree, {one.species}" if isinstance(one, Tree) else one.kind.name.lower()
        kinds.setdefault(name, []).append((one, bool(passable)))
    hectares = world.area / 1e4
    rows = {
        name: {
            "count": len(found),
            "per_hectare": len(found) / hectares,
            "drivable": sum(passable for _, passable in found),
            "mean_diameter_m": float(np.mean([one.diameter for one, _ in found if isinstance(one, Tree)]))
            if name.startswith("tree")
            else None,
        }
        for name, found in kinds.items()
    }
    return {
        "name": world.name,
        "area_m2": world.area,
        "objects": len(world.objects),
        "stem_volume_m3_per_hectare": world.stem_volume / hectares,
        "drivable_ground_share": float(np.mean(world.drivable_ground())),
        "classes": rows,
    }


def table(figures: dict[str, Any]) -> Table:
    """The table of :func:`summary`."""
    made = Table(title=escape(figures["name"]), title_justify="left", header_style="bold")
    made.add_column("class")
    for head in ("number", "a hectare", "driven over", "mean diameter"):
        made.add_column(head, justify="right")
    for name, row in figures["classes"].items():
        diameter = row["mean_diameter_m"]
        size = "" if diameter is None else f"{100.0 * diameter:.1f} cm"
        made.add_row(name, f"{row['count']:,}", f"{row['per_hectare']:,.0f}", f"{row['drivable']:,}", size)
    return made
