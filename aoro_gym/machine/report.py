"""Tables of a machine's parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from rich.console import RenderableType
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from aoro_gym.machine.machine_file import Parameter

LEAST_WIDTH = 120
"""Characters from which a parameter has one row of a table."""


def parameter_entries(parameters: Sequence[Parameter]) -> list[dict[str, Any]]:
    """Parameters as JSON objects."""
    return [
        {"key": p.key, "value": p.value, "unit": p.unit, "range": list(p.range), "role": p.role, "source": p.source}
        | ({"note": p.note} if p.note else {})
        for p in parameters
    ]


def parameter_table(parameters: Sequence[Parameter], width: int) -> Iterator[RenderableType]:
    """A table for a console of ``width`` characters; where that is narrow, two lines a parameter."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("key", style="cyan", overflow="fold")
    for name in ("value", "unit", "range", "role"):
        table.add_column(name, justify="right" if name == "value" else "left", no_wrap=True)
    table.add_column("source", style="dim", overflow="fold")
    for p in parameters:
        limits = f"{p.range[0]:.6g} - {p.range[1]:.6g}"
        source = f"{p.source} ({p.note})" if p.note else p.source
        unit = "" if p.unit == "1" else p.unit
        if width < LEAST_WIDTH:
            yield Text.assemble((p.key, "cyan"), " = ", f"{p.value:.6g} {unit}".rstrip(), f"  ({limits}, {p.role})")
            yield Padding(Text(source, "dim"), (0, 0, 0, 4))
        else:
            table.add_row(escape(p.key), f"{p.value:.6g}", escape(unit), limits, p.role, escape(source))
    if width >= LEAST_WIDTH:
        yield table
