"""Tables of key figures (:mod:`aoro_gym.simulation.key_figures`): what was published of full turns, a row each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from aoro_gym.calibration.procedure import CURVE_SOURCE
from aoro_gym.calibration.published import FIGURES_SOURCE
from aoro_gym.machine import Machine
from aoro_gym.recording.cells import listed, parse_number, shown
from aoro_gym.recording.tables import read_table
from aoro_gym.simulation.key_figures import FIGURES
from aoro_gym.validation.published import published_rows
from aoro_gym.validation.turns import Turn

STD = "std_"
"""What a column of standard deviations is called before the figure's own name."""


@dataclass(frozen=True)
class Row:
    """One full turn in a table.

    Attributes:
        figures: Those that are known, by their names in :data:`~aoro_gym.simulation.key_figures.FIGURES`.
        std: Their standard deviations, where the table has them.
    """

    turn: Turn
    figures: Mapping[str, float]
    std: Mapping[str, float] = field(default_factory=dict)

    @property
    def title(self) -> str:
        return f"{self.turn.direction}, {self.turn.signal_percent:.3g} %"

    @property
    def compared(self) -> tuple[str, ...]:
        """Figures that say something: the mean flow is the oil of a turn over its time, and so is the time once more."""
        return tuple(
            name for name in self.figures if name != "mean_flow_L_per_min" or "turn_time_s" not in self.figures
        )


def read_rows(path: Path, source: str | None = None) -> list[Row]:
    """Rows of ``source`` in a table (CSV); by default of the only source that it has.

    The table may be of any dialect (:mod:`aoro_gym.recording.tables`). Columns: ``signal_percent``, ``source``, figures,
    ``direction`` (``left`` where there is none), and ``std_*`` of figures. Empty cells are figures that are not known;
    lines that begin with ``#`` are no rows.

    Raises:
        ValueError: the table cannot be used; names the line and column, the value, and what is needed.
    """
    table = read_table(path)
    head = table.names
    missing = [name for name in ("signal_percent", "source") if name not in head]
    if missing or not set(head) & set(FIGURES):
        lacking = missing or [f"a figure (one at least of {', '.join(FIGURES)})"]
        raise ValueError(f"{path} has no column {' and '.join(lacking)}; its columns are {listed(head)}")
    allowed = {"signal_percent", "source", "direction", *FIGURES, *(STD + name for name in FIGURES)}
    strange = [name for name in head if name not in allowed]
    if strange:
        raise ValueError(
            f"{path}: unknown column {shown(strange[0])}; figures are {', '.join(FIGURES)}, or {STD} before one"
        )
    columns = {name: table.texts(name) for name in head}
    cells = {int(line): {name: columns[name][row] for name in head} for row, line in enumerate(table.lines)}
    sources = list(dict.fromkeys(one["source"] for one in cells.values()))
    source = sources[0] if source is None and len(sources) == 1 else source
    if source not in sources:
        asked = "--source is needed" if source is None else f"no row of source {source!r}"
        raise ValueError(f"{path}: {asked}; choose one of {listed(sources)}")
    rows = [
        _parsed(f"{path}, line {number}", one, table.dialect.decimal)
        for number, one in cells.items()
        if one["source"] == source
    ]
    turns = [row.turn for row in rows]
    for row in rows:
        if turns.count(row.turn) > 1:
            raise ValueError(f"{path}: {row.title} stands there twice; give means of repeats, and {STD} columns")
    return rows


def _parsed(where: str, cells: Mapping[str, str], decimal: str) -> Row:
    def number(name: str, least: float, most: float) -> float:
        text = cells[name]
        value = parse_number(text, decimal)
        if value is None:
            raise ValueError(f"{where}: {name} is {shown(text)}, but must be a number")
        if not least < value <= most:
            raise ValueError(f"{where}: {name} is {text}, but must be above {least:g} and at most {most:g}")
        return value

    direction = cells.get("direction") or "left"
    if direction not in ("left", "right"):
        raise ValueError(f"{where}: direction is {direction!r}, but must be left or right")
    percent = number("signal_percent", 0.0, 100.0)
    if percent <= 1.0:  # no machine turns at so little
        raise ValueError(f"{where}: signal_percent is {percent:g}, a share; did you mean {100.0 * percent:g}?")
    turn = Turn(direction, percent)
    figures = {name: number(name, 0.0, 1e3) for name in FIGURES if cells.get(name)}
    std = {name: number(STD + name, 0.0, 1e3) for name in figures if cells.get(STD + name)}
    if not figures:
        raise ValueError(f"{where}: no figure is known; give one at least, or leave the row out")
    return Row(turn, figures, std)


def selected(option: str, selections: Sequence[str], rows: Sequence[Row]) -> list[Row]:
    """Rows that any of ``selections`` names: ``signal=100`` or ``direction=left``, several values with commas between.

    Raises:
        ValueError: a selection is none, or names no row.
    """
    columns = {"signal": lambda row: f"{row.turn.signal_percent:g}", "direction": lambda row: row.turn.direction}
    chosen = []
    for selection in selections:
        key, equals, values = selection.partition("=")
        if not equals or key not in columns:
            raise ValueError(f"{option} {selection!r} selects no rows; write {option} signal=100 or direction=left")
        wanted = values.split(",")
        known = [columns[key](row) for row in rows]
        absent = [value for value in wanted if value not in known]
        if absent:
            raise ValueError(
                f"{option} {selection}: no row has {key}={absent[0]}; choose of {', '.join(dict.fromkeys(known))}"
            )
        chosen += [row for row, value in zip(rows, known, strict=True) if value in wanted]
    return [row for row in rows if row in chosen]


def built_in(machine: Machine, row: Row) -> set[str]:
    """Figures of ``row`` that the machine file was made with, so that agreement with them proves nothing: the published
    ones that its sources name. Mean flow and time of a turn are one figure."""
    sources = {entry.source for entry in machine.entries.values()}
    flow = {"turn_time_s", "mean_flow_L_per_min"}
    # a fit of the published twin's figures begins with the procedure that takes the machine's mean flows
    used = {"physical": flow if sources & {CURVE_SOURCE, FIGURES_SOURCE} else set()}
    used["mevea"] = set(FIGURES) if FIGURES_SOURCE in sources else set()
    turn = (row.turn.direction, row.turn.signal_percent)
    for one in published_rows():
        if (one["direction"], one["signal_percent"]) == turn and all(
            one[name] == row.figures[name] for name in row.figures
        ):
            return used[str(one["source"])] & set(row.figures)
    return set()
