"""Table of what a format cannot say."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.console import RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from aoro_gym.interchange.limitations import Limitation

LEAST_WIDTH = 120
"""Characters from which a limitation has one row of a table."""


def limitation_table(found: Sequence[Limitation], format_: str, width: int) -> Iterator[RenderableType]:
    """A table for a console of ``width`` characters; where that is narrow, two lines a limitation."""
    title = f"What {format_.upper()} cannot say"
    if width < LEAST_WIDTH:
        yield Text(title, "bold")
        for one in found:
            yield Text.assemble((one.part, "cyan"), ": ", one.twin)
            yield Padding(Text(f"here {one.file}", "dim"), (0, 0, 0, 4))
        return
    grid = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False, header_style="bold")
    grid.add_column("part", style="cyan", no_wrap=True)
    grid.add_column("the twin has", ratio=1)
    grid.add_column("the file has", ratio=1)
    for one in found:
        grid.add_row(one.part, one.twin, one.file)
    yield grid
