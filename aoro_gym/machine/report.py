"""Tables of a machine's parameters and laws."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from aoro_gym.machine.laws import FAMILIES, LAWS, family
from aoro_gym.machine.machine_file import Parameter
from aoro_gym.machine.parameters import Machine, matching

LEAST_WIDTH = 120
"""Characters from which a parameter has one row of a table."""


def parameter_entries(parameters: Sequence[Parameter]) -> list[dict[str, Any]]:
    """Parameters as JSON objects."""
    return [
        {"key": p.key, "value": p.value, "unit": p.unit, "range": list(p.range), "role": p.role, "source": p.source}
        | ({"note": p.note} if p.note else {})
        | ({} if p.published is None else {"published": p.published, "deviation": p.deviation})
        for p in parameters
    ]


def parameter_table(parameters: Sequence[Parameter], width: int) -> Iterator[RenderableType]:
    """A table for a console of ``width`` characters; where that is narrow, a few lines a parameter.

    What is published stands beside the value, with the value's deviation from it.
    """
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("key", style="cyan", overflow="fold")
    for name in ("value", "unit", "range", "role"):
        table.add_column(name, justify="right" if name == "value" else "left", no_wrap=True)
    some = any(p.published is not None for p in parameters)
    if some:
        table.add_column("published", no_wrap=True)
    table.add_column("source", style="dim", overflow="fold")
    for p in parameters:
        beside = _beside_published(p)
        limits = f"{p.range[0]:.6g} - {p.range[1]:.6g}"
        source = f"{p.source} ({p.note})" if p.note else p.source
        unit = "" if p.unit == "1" else p.unit
        if width < LEAST_WIDTH:
            yield Text.assemble((p.key, "cyan"), " = ", f"{p.value:.6g} {unit}".rstrip(), f"  ({limits}, {p.role})")
            if beside:
                yield Padding(Text(f"published: {beside}"), (0, 0, 0, 4))
            yield Padding(Text(source, "dim"), (0, 0, 0, 4))
        else:
            column = [beside] if some else []
            table.add_row(escape(p.key), f"{p.value:.6g}", escape(unit), limits, p.role, *column, escape(source))
    if width >= LEAST_WIDTH:
        yield table


def _beside_published(parameter: Parameter) -> str:
    """What is published of a parameter and the value's deviation, rounded to 0.1 %; empty where nothing is published."""
    if parameter.published is None:
        return ""
    percent = float(np.round(100.0 * np.asarray(parameter.deviation), 1)) + 0.0  # no "-0.0"
    return f"{parameter.published:.6g} ({percent:+.1f} %)"


def law_entries(machine: Machine, pattern: str | None = None) -> list[dict[str, Any]]:
    """Laws as JSON objects, with what a machine of one variant chooses; ``pattern`` as of ``Machine.parameters``."""
    return [
        {
            "law": name,
            "about": LAWS[name].about,
            "chosen": machine.laws.names[name],
            "options": [
                {
                    "option": option,
                    "parameters": parameter_entries(
                        [machine.entries[key] for key in LAWS[name].parameters.get(option, ())]
                    ),
                }
                for option in LAWS[name].options
            ],
        }
        for name in matching(LAWS, pattern)
    ]


def law_table(entries: Sequence[Mapping[str, Any]]) -> Table:
    """A row an option, from :func:`law_entries`."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("law", style="cyan", no_wrap=True)
    table.add_column("option", no_wrap=True)
    table.add_column("parameters of its own", overflow="fold")
    table.add_column("", style="dim", overflow="fold")
    for entry in entries:
        for number, one in enumerate(entry["options"]):
            parameters = [f"{p['key']} = {p['value']:.6g} {p['unit']}".removesuffix(" 1") for p in one["parameters"]]
            name, about = (entry["law"], entry["about"]) if number == 0 else ("", "")
            mark = "* " if one["option"] == entry["chosen"] else "  "
            table.add_row(name, mark + one["option"], escape("\n".join(parameters)), about)
    return table


def family_table(laws: Sequence[str]) -> Table:
    """What every family chooses of some laws; a row a law, a column a family."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("family", style="cyan", no_wrap=True)
    names = {name: family(name).names for name in FAMILIES}
    for name in names:
        table.add_column(name, overflow="fold")
    for law in laws:
        table.add_row(
            law, *(str(chosen[law]) if chosen[law] != LAWS[law].options[0] else "-" for chosen in names.values())
        )
    return table
