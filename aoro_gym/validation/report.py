"""A validation as tables, plots and one self-contained page."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray
from rich.console import Console
from rich.markup import escape
from rich.text import Text

from aoro_gym.execution.files import write_json, written_whole
from aoro_gym.reporting.page import Passage, block, describe, interactive_plot, picture, show, write_page
from aoro_gym.reporting.style import AMBER, BLUE, GREEN, INK, PLOT_STYLE, SHADE, SOFT
from aoro_gym.reporting.terminal import Comparison
from aoro_gym.simulation.key_figures import FIGURES, SECOND_PEAK, STEADY, UNDERSHOOT_END
from aoro_gym.validation.published import Row
from aoro_gym.validation.shape import MAXIMA, SHAPE_TURN
from aoro_gym.validation.study import TARGETS, FlowCurve, Validation
from aoro_gym.validation.turns import TURNS, Turn

SOURCES = {"physical": ("machine", INK, "D"), "mevea": ("published twin", AMBER, "o")}
"""Label, colour and marker of what is published."""

SHAPE_TITLE = "Shape of the left turn at 100 % signal, against the published twin"

ZOOM = (-0.15, 1.05)
"""Start of a turn [s] that is drawn large."""
LARGEST_ERROR = 40.0
"""Error [%] beyond which the chart shows an arrow."""

_HEADING: Any = {"x": 0.012, "ha": "left", "fontsize": 15, "fontweight": "bold"}


def write_report(result: Validation, folder: Path, made_by: Mapping[str, Any] | None = None) -> list[Path]:
    """Write ``validation.json``, three plots (PNG) and ``index.html`` into ``folder``; returns what was written.

    What is ``made_by`` stands in the JSON under this name.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written = [folder / "validation.json"]
    write_json(written[0], result.to_json() | ({} if made_by is None else {"made_by": dict(made_by)}))
    for direction in ("left", "right"):
        written.append(folder / f"{direction}_turns.png")
        write_turns(result, direction, written[-1])
    written.append(folder / "errors.png")
    write_errors(result, written[-1])
    written.append(folder / "index.html")
    write_index(result, written[-1], errors_png=folder / "errors.png")
    return written


def passage(result: Validation, folder: Path) -> Passage:
    """The validation's headline and two of the plots that :func:`write_report` wrote into ``folder``."""
    pictures = [folder / "left_turns.png", folder / "errors.png"]
    return Passage("Validation", result.headline(), pictures, more=f"{folder.name}/index.html")


# --- tables ---


@dataclass(frozen=True)
class FigureRow:
    """One key figure of one turn, as text; ``mark`` says whether it is within its bound (None: there is none)."""

    turn: Turn
    figure: str
    unit: str
    published: tuple[str, str]  # machine, published twin
    twin: str
    errors: tuple[str, str]  # of the twin against these
    mark: bool | None
    noise: str
    raw: str
    uncalibrated: str
    ensemble: str


COLUMNS = (
    "key figure",
    "unit",
    "machine",
    "published twin",
    "twin",
    "vs machine",
    "vs published twin",
    "with sensor noise, 90 %",
    "unfiltered",
    "uncalibrated",
    "ensemble",
)


def lines(result: Validation, direction: str) -> Iterator[FigureRow]:
    """The table of all turns to one side."""
    for turn in TURNS:
        if turn.direction != direction:
            continue
        rows = {source: result.row(source, turn) for source in (*SOURCES, "twin", "twin_raw", "twin_uncalibrated")}
        noise, ensemble = result.entry(result.noise, turn), result.entry(result.ensemble, turn)
        against = {name: result.entry(result.errors, turn, source="twin", reference=name) for name in SOURCES}
        for name in FIGURES:
            label, unit, _ = describe(name)
            mevea = against["mevea"]
            yield FigureRow(
                turn=turn,
                figure=label,
                unit=unit,
                published=(_shown(rows["physical"], name), _shown(rows["mevea"], name)),
                twin=_shown(rows["twin"], name),
                errors=(_error(against["physical"], name), _error(mevea, name)),
                mark=None if mevea is None else mevea["reached"][name],
                noise=_range(noise, name, "low90", "high90"),
                raw=_shown(rows["twin_raw"], name, fine=True),
                uncalibrated=_shown(rows["twin_uncalibrated"], name),
                ensemble=_range(ensemble, name, "low", "high"),
            )


def print_tables(console: Console, result: Validation) -> None:
    """Print the key figures of all turns, the checks and the notes."""
    for one in printed(result):
        console.print(one, highlight=False)


def printed(result: Validation) -> Iterator[Comparison | str]:
    """Tables of the key figures of all turns and of the checks, the verdict and the notes, for a terminal."""
    shown = _columns_in_use(result)
    for direction in ("left", "right"):
        table = Comparison(f"Full turns to the {direction}", [COLUMNS[index] for index in shown], [], lead=2)
        for turn in (turn for turn in TURNS if turn.direction == direction):
            blank = [""] * (len(shown) - 1)
            table.add(Text(f"{turn.signal_percent:g} % signal", style="bold"), *blank)
            for line in (line for line in lines(result, direction) if line.turn == turn):
                cells: list[str | Text] = [*_cells(line)]
                cells[0] = f"  {cells[0]}"
                if line.mark is not None:
                    cells[6] = Text(str(cells[6]), style="green" if line.mark else "red")
                table.add(*(cells[index] for index in shown))
        yield table
    for title, checks in ((SHAPE_TITLE, result.shape), ("Checks", result.checks)):
        table = Comparison(title, ("what", "value", "published", "bound", "unit", ""), [])
        for check in checks:
            mark = Text(_word(check["reached"]), style="green" if check["reached"] else "red")
            table.add(*_check_cells(check), mark)
        yield table
    yield _verdict(result)
    for note in result.notes:
        yield f"[yellow]note:[/] {escape(note)}"


def _verdict(result: Validation) -> str:
    filtered, raw = result.misfit(), result.misfit("twin_raw")
    text = result.headline()
    if filtered is None or raw is None:
        return text
    nearer = "filtered" if filtered <= raw else "unfiltered"
    return (
        f"{text} Error over bound against the published twin, root mean square: {filtered:.2f} filtered, {raw:.2f} "
        f"unfiltered: with these parameters its curve agrees better {nearer}."
    )


def _columns_in_use(result: Validation) -> list[int]:
    sources = {row["source"] for row in result.rows}
    unused = set()
    if not result.noise:
        unused.add(7)
    if "twin_uncalibrated" not in sources:
        unused.add(9)
    if not result.ensemble:
        unused.add(10)
    return [index for index in range(len(COLUMNS)) if index not in unused]


def _cells(line: FigureRow) -> list[str]:
    return [
        *(line.figure, line.unit, *line.published, line.twin, *line.errors),
        *(line.noise, line.raw, line.uncalibrated, line.ensemble),
    ]


def _check_cells(check: dict[str, Any]) -> list[str]:
    digits = {"s": 3, "bar": 2, "m/s": 3, "kg": 0, "L/min": 1, "%": 2}.get(check["unit"], 0)
    if check["published"] is None:
        value, bound = (f"{100 * n:.2f}" if n is not None else "-" for n in (check["value"], check["bound"]))
        return [check["what"], value, "-", f"≤\N{NO-BREAK SPACE}{bound}", "%"]
    value, known = (f"{n:.{digits}f}" if n is not None else "-" for n in (check["value"], check["published"]))
    if check["unit"] == "L/min" and check["value"] is not None:
        value += f" ({100.0 * (check['value'] / check['published'] - 1.0):+.1f} %)"
    return [check["what"], value, known, f"±\N{NO-BREAK SPACE}{check['bound']:.{digits}f}", check["unit"]]


def _shown(row: Row | None, name: str, *, fine: bool = False) -> str:
    value = None if row is None else row[name]
    return _digits(name, value, fine=fine) if isinstance(value, float) else "-"


def _digits(name: str, value: float, *, fine: bool = False) -> str:
    """A figure at the resolution of the sensor's clock, or at that of a main step (``fine``)."""
    return f"{value:.2f}" if name.endswith("_s") and not fine else show(name, value)


def _error(entry: dict[str, Any] | None, name: str) -> str:
    if entry is None or entry["relative"][name] is None:
        return "-"
    if TARGETS[name][0] == "difference":
        return f"{entry['difference'][name]:+.2f} s"
    return f"{100 * entry['relative'][name]:+.1f} %"


def _range(entry: dict[str, Any] | None, name: str, low: str, high: str) -> str:
    if entry is None or entry[name][low] is None:
        return "-"
    return f"{_digits(name, entry[name][low])} – {_digits(name, entry[name][high])}"


# --- plots ---


def write_turns(result: Validation, direction: str, path: Path) -> None:
    """Draw the flow curves of the turns to one side, with what is published of them."""
    import matplotlib
    from matplotlib.figure import Figure

    curves = [curve for curve in result.curves if curve.turn.direction == direction]
    with matplotlib.rc_context(PLOT_STYLE):
        figure = Figure(figsize=(12.5, 1.1 + 3.15 * len(curves)), dpi=140, layout="constrained")
        layout: Any = figure.get_layout_engine()
        layout.set(w_pad=0.08, h_pad=0.08)
        figure.suptitle(f"Joint flow of full turns to the {direction}", **_HEADING)
        if direction == "left":
            text = "points: first peak      bars: level and the period that it belongs to      upright: end of the turn"
            figure.text(0.992, 0.985, text, ha="right", va="top", fontsize=9.5, color="#5f6f7d")
        grid = figure.subplots(len(curves), 2, squeeze=False, width_ratios=(1.15, 1.0))
        handles: dict[str, Any] = {}
        for (start, whole), curve in zip(grid, curves, strict=True):
            for axis, zoomed in ((start, True), (whole, False)):
                _draw_curve(axis, curve, zoomed, handles)
                _draw_published(axis, result, curve.turn, zoomed, handles)
                if zoomed:
                    _draw_shape(axis, result, curve, handles)
                axis.grid(True)
                axis.set_axisbelow(True)
                axis.spines[["top", "right"]].set_visible(False)
                axis.set_ylim(*_flow_limits(result, curve))
            start.set_ylabel("L/min")
            start.set_title(f"{curve.turn.signal_percent:g} % signal: start of the turn", loc="left", fontweight="bold")
            whole.set_title("whole turn", loc="left", fontweight="bold")
        for axis in grid[-1]:
            axis.set_xlabel("time since the joint has moved by 0.1° [s]")
        figure.legend(
            handles.values(),
            handles.keys(),
            loc="outside lower left",
            ncols=min(len(handles), 6),
            frameon=False,
            fontsize=9.5,
        )
        path.parent.mkdir(parents=True, exist_ok=True)
        with written_whole(path) as temporary:
            figure.savefig(temporary)


def _draw_curve(axis: Any, curve: FlowCurve, zoomed: bool, handles: dict[str, Any]) -> None:
    if curve.low.size:
        handles["ensemble"] = axis.fill_between(curve.time, curve.low, curve.high, color=BLUE, alpha=0.18, lw=0)
    if curve.uncalibrated_flow.size:
        (handles["uncalibrated twin"],) = axis.plot(
            curve.uncalibrated_time, curve.uncalibrated_flow, color=SOFT, lw=1.2, ls=(0, (5, 2))
        )
    (handles["twin, unfiltered"],) = axis.plot(curve.raw_time, curve.raw_flow, color=GREEN, lw=0.9)
    (handles["twin, as measured"],) = axis.plot(curve.time, curve.flow, color=BLUE, lw=2.0)
    axis.set_xlim(*(ZOOM if zoomed else (curve.time[0], curve.time[-1])))


def _shape_marks(result: Validation, curve: FlowCurve) -> Iterator[tuple[float, float, float | None, float]]:
    """Published time, bound, and the twin's time and flow of the maxima of the turn whose shape is known."""
    if curve.turn == SHAPE_TURN:
        for figure in result.shape:
            if figure["name"] in MAXIMA:
                time = figure["value"]
                flow = math.nan if time is None else float(np.interp(time, curve.time, curve.flow))
                yield figure["published"], figure["bound"], time, flow


def _draw_shape(axis: Any, result: Validation, curve: FlowCurve, handles: dict[str, Any]) -> None:
    """Bands where the published twin's maxima are, and the twin's maxima."""
    from matplotlib.markers import CARETDOWN

    for known, bound, time, flow in _shape_marks(result, curve):
        band = axis.axvspan(known - bound, known + bound, color=AMBER, alpha=0.16, lw=0, zorder=0)
        handles["published twin's maxima"] = band
        if time is not None:
            (point,) = axis.plot(
                [time], [flow], marker=CARETDOWN, ls="", ms=9, color=BLUE, mec="white", mew=0.9, zorder=7
            )
            handles["twin's maxima"] = point


def _draw_published(axis: Any, result: Validation, turn: Turn, zoomed: bool, handles: dict[str, Any]) -> None:
    """Points where time and flow are known; a bar where only the period is."""
    for source, (label, colour, marker) in reversed(SOURCES.items()):
        row = result.row(source, turn)
        if row is None:
            continue
        # the machine's lines stay visible on top of the published twin's
        style: Any = {"color": colour, "lw": 1.2 if source == "physical" else 3.0, "solid_capstyle": "butt"}
        style["zorder"] = 5 if source == "physical" else 4
        for name, low, high in _periods(row):
            value = row[name]
            if isinstance(value, float) and zoomed != (name == "steady_flow_L_per_min"):
                axis.plot([low, high], [value, value], marker="|", ms=8, mew=style["lw"], **style)
                above = name == "second_peak_L_per_min"
                other = result.row("mevea" if source == "physical" else "physical", turn)
                rival = None if other is None else other[name]
                if zoomed and (not isinstance(rival, float) or (value > rival) == above):  # of two, label the outer one
                    axis.annotate(
                        describe(name)[0],
                        (high, value),
                        (0, 4 if above else -5),
                        textcoords="offset points",
                        ha="right",
                        va="bottom" if above else "top",
                        fontsize=8.5,
                        color=INK,
                    )
        peak, when, end = row["first_peak_L_per_min"], row["first_peak_time_s"], row["turn_time_s"]
        point: Any = {"marker": marker, "color": colour, "ms": 7, "mec": "white", "mew": 0.9, "zorder": 6, "ls": ""}
        if isinstance(peak, float):
            axis.plot([when], [peak], **point)
        if isinstance(end, float) and not zoomed:
            axis.axvline(end, color=colour, lw=style["lw"], ls=(0, (3, 2)), zorder=style["zorder"] - 3, alpha=0.8)
        mean = row["mean_flow_L_per_min"]
        if peak is None and isinstance(mean, float) and not zoomed:
            axis.plot([0.0, axis.get_xlim()[1]], [mean, mean], **(style | {"lw": 1.4, "ls": (0, (5, 3))}))
            handles["machine's mean flow"] = axis.lines[-1]
        if isinstance(peak, float):
            (handles[label],) = axis.plot([], [], lw=style["lw"], **(point | {"ls": "-"}))


def _periods(row: Row) -> Iterator[tuple[str, float, float]]:
    """Figures that belong to a period: name, begin and end [s]."""
    end, when = row["turn_time_s"], row["first_peak_time_s"]
    if isinstance(when, float):
        yield "lowest_undershoot_L_per_min", when, UNDERSHOOT_END
    yield "second_peak_L_per_min", *SECOND_PEAK
    if isinstance(end, float):
        yield "steady_flow_L_per_min", STEADY[0] * end, STEADY[1] * end


def _flow_limits(result: Validation, curve: FlowCurve) -> tuple[float, float]:
    parts = [part[np.isfinite(part)] for part in (curve.flow, curve.raw_flow, curve.uncalibrated_flow, curve.high)]
    peaks = [row["first_peak_L_per_min"] for row in (result.row(s, curve.turn) for s in SOURCES) if row is not None]
    top = max(
        [float(part.max()) for part in parts if part.size] + [peak for peak in peaks if isinstance(peak, float)] + [1.0]
    )
    return -0.06 * top, 1.08 * top


def write_errors(result: Validation, path: Path) -> None:
    """Draw the relative errors of the left turns' figures: against the published twin, and against the machine."""
    import matplotlib
    from matplotlib.figure import Figure

    turns = [turn for turn in TURNS if turn.direction == "left"]
    with matplotlib.rc_context(PLOT_STYLE):
        figure = Figure(figsize=(12.5, 6.2), dpi=140, layout="constrained")
        layout: Any = figure.get_layout_engine()
        layout.set(w_pad=0.1, h_pad=0.08)
        figure.suptitle("Errors of the twin, left turns", **_HEADING)
        axes = figure.subplots(1, len(turns), sharey=True)
        handles: dict[str, Any] = {}
        for axis, turn in zip(axes, turns, strict=True):
            for place, name in enumerate(FIGURES):
                _draw_errors(axis, result, turn, name, place, handles)
            axis.axvline(0.0, color=INK, lw=0.8, zorder=1)
            axis.set_title(f"{turn.signal_percent:g} % signal", loc="left", fontweight="bold")
            axis.set_xlim(-1.08 * LARGEST_ERROR, 1.08 * LARGEST_ERROR)
            axis.set_ylim(len(FIGURES) - 0.45, -0.55)
            axis.set_xlabel("relative error [%]")
            axis.grid(True, axis="x")
            axis.set_axisbelow(True)
            axis.spines[["top", "right", "left"]].set_visible(False)
            axis.tick_params(axis="y", length=0)
            axis.set_yticks(range(len(FIGURES)), [describe(name)[0] for name in FIGURES], fontsize=10.5)
        figure.legend(handles.values(), handles.keys(), loc="outside lower left", ncols=4, frameon=False, fontsize=9.5)
        path.parent.mkdir(parents=True, exist_ok=True)
        with written_whole(path) as temporary:
            figure.savefig(temporary)


def _draw_errors(axis: Any, result: Validation, turn: Turn, name: str, place: int, handles: dict[str, Any]) -> None:
    mevea, machine = result.row("mevea", turn), result.row("physical", turn)
    if mevea is None or machine is None:
        return
    upper, lower = place - 0.17, place + 0.2
    if place % 2:
        axis.axhspan(place - 0.5, place + 0.5, color=SHADE, lw=0, zorder=0)
    kind, bound = TARGETS[name]
    reference = _value(mevea, name)
    half = 100 * (bound / reference if kind == "difference" else bound)
    handles["asked for"] = axis.barh(upper, 2 * half, left=-half, height=0.3, color=GREEN, alpha=0.22, lw=0, zorder=1)

    def dot(label: str, source: str, against: str, height: float, **style: Any) -> None:
        entry = result.entry(result.errors, turn, source=source, reference=against)
        error = None if entry is None else entry["relative"][name]
        if error is None:
            return
        beyond = abs(100 * error) > LARGEST_ERROR
        where = math.copysign(LARGEST_ERROR, error) if beyond else 100 * error
        (line,) = axis.plot([where], [height], ls="", zorder=4, **style)
        handles.setdefault(label, line)
        if beyond:
            axis.annotate(
                f"{100 * error:+.0f} % →" if error > 0 else f"← −{-100 * error:.0f} %",
                (where, height),
                (6 if error > 0 else -6, 5),
                textcoords="offset points",
                ha="right" if error > 0 else "left",
                va="bottom",
                fontsize=8.5,
            )

    ensemble, noise = result.entry(result.ensemble, turn), result.entry(result.noise, turn)
    if ensemble is not None:
        _bar(axis, ensemble[name], ("low", "high"), reference, upper, BLUE, "ensemble", handles)
    if noise is not None:
        label = "with sensor noise, 90 %"
        _bar(axis, noise[name], ("low90", "high90"), _value(machine, name), lower, SOFT, label, handles)
    if result.uncalibrated is not None:
        dot("uncalibrated vs published twin", "twin_uncalibrated", "mevea", upper, marker="X", color=SOFT, ms=7, mew=0)
    dot("unfiltered vs published twin", "twin_raw", "mevea", upper, marker="o", mfc="white", mec=GREEN, mew=1.5, ms=7)
    dot("twin vs published twin", "twin", "mevea", upper, marker="o", color=BLUE, ms=8, mec="white", mew=0.8)
    dot("twin vs machine", "twin", "physical", lower, marker="D", color=INK, ms=6, mec="white", mew=0.8)


def _bar(
    axis: Any,
    entry: dict[str, float | None],
    ends: tuple[str, str],
    reference: float,
    height: float,
    colour: str,
    label: str,
    handles: dict[str, Any],
) -> None:
    low, high = entry[ends[0]], entry[ends[1]]
    if low is None or high is None:
        return
    span = np.clip([100 * (low / reference - 1), 100 * (high / reference - 1)], -LARGEST_ERROR, LARGEST_ERROR)
    (line,) = axis.plot(span, [height, height], color=colour, lw=3.0, alpha=0.55, solid_capstyle="butt", zorder=3)
    handles.setdefault(label, line)


def _value(row: Row, name: str) -> float:
    value = row[name]
    return value if isinstance(value, float) else math.nan


# --- page ---


def write_index(result: Validation, path: Path, *, errors_png: Path) -> None:
    """Write one page with tables and plots."""
    sections = [
        ("Left turns", block("card", contents=[_plotly(result, "left")])),
        ("Errors", block("card", contents=[picture(errors_png)])),
        ("Key figures, left", _html_table(result, "left")),
        (SHAPE_TITLE, _shape_table(result)),
        ("Right turns", block("card", contents=[_plotly(result, "right")])),
        ("Key figures, right", _html_table(result, "right")),
        ("How to read this", _explained(result)),
    ]
    write_page(
        path,
        "AORO twin: validation",
        f"Machine {result.machine}. {_verdict(result)}",
        sections,
        top=_tiles(result),
        footer="Published figures: Lehto et al., Machines 2026, 14, 128.",
    )


def _tiles(result: Validation) -> Markup:
    figures = []
    for check in result.checks:
        what, value, known, bound, unit = _check_cells(check)
        beside = bound if known == "-" else f"published {known}, {bound}"
        figures.append((value, unit, f"{what} ({beside}): {_word(check['reached'])}", _mark(check["reached"])))
    return block("tiles", figures=figures)


def _mark(reached: bool) -> str:
    return "yes" if reached else "no"


def _word(reached: bool) -> str:
    """The same in words."""
    return "reached" if reached else "missed"


def _html_table(result: Validation, direction: str) -> Markup:
    shown = _columns_in_use(result)
    rows: list[list[str]] = []
    for turn, of_turn in groupby(lines(result, direction), key=lambda line: line.turn):
        rows.append([f"{turn.signal_percent:g} % signal"])
        for line in of_turn:
            cells = _cells(line)
            cells[4] = block("marked", text=cells[4], kind="twin")
            if line.mark is not None:
                cells[6] = block("marked", text=f"{cells[6]} {_word(line.mark)}", kind=_mark(line.mark))
            rows.append([cells[index] for index in shown])
    return block("table", head=[COLUMNS[index] for index in shown], rows=rows)


def _shape_table(result: Validation) -> Markup:
    rows = []
    for figure in result.shape:
        cells = _check_cells(figure)
        cells[1] = block("marked", text=f"{cells[1]} {_word(figure['reached'])}", kind=_mark(figure["reached"]))
        rows.append(cells)
    return block("table", head=["figure", "twin", "published twin", "bound", "unit"], rows=rows)


def _explained(result: Validation) -> Markup:
    sentences = [
        "Every figure of the twin goes through the machine's measuring chain: the joint angle at 100 samples a second, "
        "a 4th-order Butterworth low-pass of 7 Hz forward and backward, the cylinders' strokes by geometry, and the oil "
        "that they draw. “Unfiltered” is the simulated flow itself, at every millisecond.",
        "Figures are without sensor noise. “With sensor noise” is where nine of ten recordings of this same twin would "
        f"stand ({result.noise_runs} simulated recordings a turn, noise of the published kind, any phase of the "
        "sensor's clock): peaks are read high and undershoots low, so the machine's single recordings are, too.",
        "Colours tell whether the twin is as near to the published twin as asked for. The machine's mean flows at 75 and "
        "50 % are the valve curve that either twin is made with, so times and mean flows there are no independent test.",
        "The shape is what the text of the publication says of its twin's curve. A maximum stands out by 2 % of the steady "
        "flow on both sides, before 0.8 s. That the pressures lie mainly in a range is read as four fifths of the time from "
        "the first maximum to 0.8 s, of each port on its own: a choice, since the text gives no share.",
        *result.notes,
    ]
    return block("card", contents=[block("paragraph", text=text) for text in sentences])


def _plotly(result: Validation, direction: str) -> Markup:
    """Flow curves of the turns to one side, to zoom into."""
    import plotly.graph_objects as go
    from plotly.subplots import make_subplots

    curves = [curve for curve in result.curves if curve.turn.direction == direction]
    titles = []
    for curve in curves:
        titles += [f"<b>{curve.turn.signal_percent:g} % signal</b>: start of the turn [L/min]", "whole turn [L/min]"]
    figure: Any = make_subplots(
        rows=len(curves),
        cols=2,
        subplot_titles=titles,
        column_widths=[0.53, 0.47],
        horizontal_spacing=0.06,
        vertical_spacing=0.09,
    )
    known: set[str] = set()  # in the legend

    def line(row: int, column: int, label: str, x: Any, y: Any, **style: Any) -> None:
        figure.add_trace(
            go.Scatter(
                x=np.asarray(x, dtype=np.float32),
                y=np.asarray(y, dtype=np.float32),
                name=label,
                legendgroup=label,
                showlegend=label not in known,
                hovertemplate="%{y:.1f}",
                **({"mode": "lines"} | style),
            ),
            row=row,
            col=column,
        )
        known.add(label)

    for row, curve in enumerate(curves, start=1):
        for column in (1, 2):
            zoomed = column == 1
            if curve.low.size:
                both = np.concatenate([curve.time, curve.time[::-1]])
                edge = np.concatenate([curve.high, curve.low[::-1]])
                filled: Any = {"fill": "toself", "fillcolor": "rgba(31,119,180,0.18)", "line": {"width": 0}}
                line(row, column, "ensemble", both, edge, hoverinfo="skip", **filled)
            if curve.uncalibrated_flow.size:
                dashed = {"color": SOFT, "width": 1.5, "dash": "dash"}
                line(row, column, "uncalibrated twin", curve.uncalibrated_time, curve.uncalibrated_flow, line=dashed)
            time, flow = _thinned(curve)
            line(row, column, "twin, unfiltered", time, flow, line={"color": GREEN, "width": 1.2})
            line(row, column, "twin, as measured", curve.time, curve.flow, line={"color": BLUE, "width": 2.4})
            _plotly_published(line, result, curve.turn, row, column)
            if zoomed:
                _plotly_shape(figure, line, result, curve, row)
            limits = ZOOM if zoomed else (float(curve.time[0]), float(curve.time[-1]))
            figure.update_xaxes(range=limits, row=row, col=column)
            figure.update_yaxes(range=_flow_limits(result, curve), row=row, col=column)
    for column in (1, 2):
        figure.update_xaxes(title_text="time since the joint has moved by 0.1° [s]", row=len(curves), col=column)
    return interactive_plot(
        figure,
        height=110 + 290 * len(curves),
        margin={"l": 45, "r": 15, "t": 70, "b": 45},
        legend={"orientation": "h", "x": 0.0, "y": 1.0 + 60 / (290 * len(curves)), "yanchor": "bottom"},
    )


def _plotly_published(line: Any, result: Validation, turn: Turn, row: int, column: int) -> None:
    for source, (label, colour, marker) in reversed(SOURCES.items()):
        figures = result.row(source, turn)
        if figures is None:
            continue
        stroke = {"color": colour, "width": 1.6 if source == "physical" else 4}
        for name, low, high in _periods(figures):
            value = figures[name]
            if isinstance(value, float) and (column == 1) != (name == "steady_flow_L_per_min"):
                line(row, column, label, [low, high], [value, value], line=stroke)
        mean = figures["mean_flow_L_per_min"]
        if turn.direction == "right" and column == 2 and isinstance(mean, float):
            line(row, column, f"{label}, mean flow", [0.0, 100.0], [mean, mean], line=stroke | {"dash": "dash"})
        if isinstance(figures["first_peak_L_per_min"], float):
            point = {"color": colour, "size": 10, "symbol": "diamond" if marker == "D" else "circle"}
            point |= {"line": {"color": "white", "width": 1}}
            peak = [figures["first_peak_time_s"]], [figures["first_peak_L_per_min"]]
            line(row, column, label, *peak, mode="markers", marker=point)


def _plotly_shape(figure: Any, line: Any, result: Validation, curve: FlowCurve, row: int) -> None:
    for known, bound, time, flow in _shape_marks(result, curve):
        figure.add_vrect(known - bound, known + bound, fillcolor=AMBER, opacity=0.16, line_width=0, row=row, col=1)
        if time is not None:
            marker = {"color": BLUE, "size": 11, "symbol": "triangle-down", "line": {"color": "white", "width": 1}}
            line(row, 1, "twin's maxima", [time], [flow], mode="markers", marker=marker)


def _thinned(curve: FlowCurve) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The unfiltered curve: every millisecond at its start, every tenth later."""
    kept = (curve.raw_time < ZOOM[1]) | (np.arange(len(curve.raw_time)) % 10 == 0)
    return curve.raw_time[kept], curve.raw_flow[kept]
