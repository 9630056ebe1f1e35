"""Table of the catalogue of effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.markup import escape
from rich.table import Table


def effects_table(effects: Sequence[Mapping[str, Any]]) -> Table:
    """A row an effect, from descriptions as ``Effect.describe`` gives them."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("effect", style="cyan", overflow="fold")
    table.add_column("component", overflow="fold")
    table.add_column("magnitude and range", overflow="fold")
    table.add_column("what is measured: without, at the ends", overflow="fold")
    table.add_column("physics", style="dim", overflow="fold")
    for effect in effects:
        magnitudes = [
            f"{one['name']} {one['range'][0]:g} - {one['range'][1]:g}{_unit(one)}" for one in effect["magnitudes"]
        ]
        measured = [
            f"{one['quantity']}: {one['none']:.4g}, {one['low']:.4g} - {one['high']:.4g}{_unit(one)}"
            for one in effect["operational"]
        ]
        cells = (escape(text) for text in ("\n".join(magnitudes), "\n".join(measured), effect["physics"]))
        table.add_row(effect["id"], effect["component"], *cells)
    return table


def _unit(entry: Mapping[str, Any]) -> str:
    return "" if entry["unit"] == "1" else f" {entry['unit']}"
