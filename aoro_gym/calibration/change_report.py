"""Tables and curves of a change of parameters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from aoro_gym.calibration.change import Change
from aoro_gym.calibration.procedure import SIDES
from aoro_gym.execution.files import write_json, written_whole
from aoro_gym.reporting.page import block, describe, picture, show, write_page
from aoro_gym.reporting.style import AMBER, BLUE, PLOT_STYLE
from aoro_gym.reporting.terminal import Comparison
from aoro_gym.simulation.key_figures import FIGURES
from aoro_gym.validation.published import published


def write_change(change: Change, folder: Path, made_by: Mapping[str, Any]) -> list[Path]:
    """Write ``study.json``, the curves of both sides (PNG) and ``index.html`` into ``folder``; returns what was written."""
    folder.mkdir(parents=True, exist_ok=True)
    written = [folder / "study.json"]
    write_json(written[0], change.to_json() | {"made_by": dict(made_by)})
    for side in SIDES:
        written.append(folder / f"{side}_turns.png")
        write_curves(change, side, written[-1])
    written.append(folder / "index.html")
    sections = [
        (f"Turns to the {side}", block("card", contents=[picture(folder / f"{side}_turns.png")])) for side in SIDES
    ]
    sections += [
        (table.title, block("table", head=table.head, rows=[[str(cell) for cell in row] for row in table.rows]))
        for table in tables(change)
    ]
    write_page(written[-1], "AORO twin: a change of parameters", sentence(change), sections, interactive=False)
    return written


def sentence(change: Change) -> str:
    """What was changed."""
    found = [f"{key} {before:.5g} to {after:.5g}" for key, (before, after) in change.changed.items()]
    restored = " The turn time at full signal is restored by the valve's edges." if change.recalibrated else ""
    return f"Machine {change.machines[0].name}: {'; '.join(found) or 'nothing differs'}.{restored}"


def tables(change: Change) -> Iterator[Comparison]:
    """What was changed, the key figures of the turns to either side, the drive."""
    units = change.machines[0].entries
    rows = [[key, f"{a:.5g}", f"{b:.5g}", _percent(100.0 * (b / a - 1.0) if a else None), units[key].unit,
             "found anew" if key in change.recalibrated else "given"]
            for key, (a, b) in change.changed.items()]  # fmt: skip
    yield Comparison("Parameters", ("parameter", "before", "after", "change", "unit", ""), rows)
    for side in SIDES:
        rows = [
            [f"{one.turn.signal_percent:g} %", *describe(name)[:2], show(name, one.figures[0][name]),
             show(name, one.figures[1][name]), _percent(one.percent(name))]
            for one in change.turns if one.turn.direction == side for name in FIGURES
        ]  # fmt: skip
        head = ("signal", "key figure", "unit", "before", "after", "change")
        yield Comparison(f"Full turns to the {side}", head, rows, lead=3)
    before, after = change.motor_pressure
    rows = [[f"motor pressure at {published('drive_speed'):g} m/s", f"{before:.2f}", f"{after:.2f}",
             _percent(100.0 * (after / before - 1.0)), "bar"]]  # fmt: skip
    yield Comparison("Straight drive", ("what", "before", "after", "change", "unit"), rows)


def write_curves(change: Change, side: str, path: Path) -> None:
    """Draw the joint flow of full turns to one side, before and after, a level beside the other."""
    import matplotlib
    from matplotlib.figure import Figure

    turns = [one for one in change.turns if one.turn.direction == side]
    with matplotlib.rc_context(PLOT_STYLE):
        figure = Figure(figsize=(12.5, 3.8), dpi=140, layout="constrained")
        for axis, one in zip(figure.subplots(1, len(turns), squeeze=False)[0], turns, strict=True):
            for flow, colour, label, width in zip(
                one.flow, (AMBER, BLUE), ("before", "after"), (2.2, 1.4), strict=True
            ):
                axis.plot(one.time, flow, color=colour, lw=width, label=label)
            axis.set_title(f"{one.turn.signal_percent:g} % signal", loc="left", fontweight="bold")
            axis.set_xlabel("time since the joint has moved by 0.1° [s]")
            axis.grid(True)
            axis.spines[["top", "right"]].set_visible(False)
            axis.set_ylim(bottom=0.0)
            if one is turns[0]:
                axis.set_ylabel("joint flow [L/min]")
                axis.legend(frameon=False)
        path.parent.mkdir(parents=True, exist_ok=True)
        with written_whole(path) as temporary:
            figure.savefig(temporary)


def _percent(change: float | None) -> str:
    return "-" if change is None else f"{change:+.1f} %"
