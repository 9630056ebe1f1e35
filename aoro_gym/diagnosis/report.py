"""A diagnosis for people: a page that needs no network, and a short summary for the terminal.

Both answer first what anyone asks of a gap, in the same words (:mod:`.words`): where it lies, why, how much, how sure, how
far it shrinks, and what to do next.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import fill

import numpy as np
from markupsafe import Markup
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from aoro_gym.diagnosis.drawing import machine_drawing
from aoro_gym.diagnosis.figures import COLUMNS
from aoro_gym.diagnosis.result import KEY_FIGURES, PHASES, Cause, Curve, Diagnosis, GapClosure, Place
from aoro_gym.diagnosis.words import (
    WITHOUT_CAUSE,
    Conclusions,
    capital,
    conclusions,
    control,
    count,
    gap_closure,
    listed,
    machine_file,
    magnitudes,
    p_value,
    per_cent,
    probability,
    readable,
    signal_unit,
    signed,
    suspected,
    three_digits,
    title,
    total_shares,
    twin_with,
    with_unit,
)
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.effects.effect import Effect
from aoro_gym.reporting.page import block, data_address, describe, joined, show, write_page
from aoro_gym.reporting.style import AMBER, BLUE, GREEN, GRID, INK, PLOT_STYLE, PURPLE, RED, SOFT

COLOURS: Mapping[str, str] = {
    "no_gap": GREEN, "calibration": BLUE, "cause": RED, "ambiguous": AMBER, "unknown": PURPLE, "inconclusive": SOFT,
}  # fmt: skip
"""By verdict."""
BEHIND = ("#4f6b84", "#8fa6b8", "#bccad5")
"""Of the likeliest causes behind the first in the bar of probabilities; all others share what is left."""
MOST_CURVES, MOST_PLACES = 4, 6
"""That are shown, the most telling first."""
BAND = 1.645
"""Standard deviations on either side that hold 90 % of a normal distribution."""
NAME_WIDTH = 26
"""Letters of a line in a curve's legend."""
DARKEST = 0.6
"""Opacity of the largest share's cell: text on it stays easy to read."""

KINDS = (
    "left out of the fit",
    "left out, own clock and zero refitted",
    "fitted",
    "fitted, own clock and zero refitted",
)
"""Of manoeuvres, by how much their gap closure proves."""


def _kind(one: GapClosure) -> int:
    """Place in :data:`KINDS`."""
    return 2 * int(not one.held_out) + int(one.refitted)


def _range(one: GapClosure) -> str:
    """The 90 % interval in per cent."""
    return f"{per_cent(one.low90)} to {per_cent(one.high90)}"


# --- terminal ---


def summary(diagnosis: Diagnosis, *, effects: Mapping[str, Effect] = EFFECTS) -> list[RenderableType]:
    """What to print: the verdict in words, the causes, how much of the gap is gone, and limitations."""
    concluded = conclusions(diagnosis, effects=effects)
    answers = Table(box=None, show_header=False, pad_edge=False)
    answers.add_column(style="bold", no_wrap=True)
    answers.add_column(overflow="fold")
    for question, answer in concluded.answers.items():
        answers.add_row(question, escape(answer))
    items: list[RenderableType] = [f"[bold]{escape(concluded.headline)}[/] ({readable(diagnosis.verdict)})", answers]
    if diagnosis.causes:
        items.append(_cause_summary(diagnosis.causes))
    if diagnosis.shrinkage:
        items.append(_gap_closure_summary(diagnosis.shrinkage))
    if diagnosis.signals == (KEY_FIGURES,):
        items.append(_key_figures_summary(diagnosis))
    return [*items, *(f"[yellow]note:[/] {escape(text)}" for text in diagnosis.limitations)]


def _cause_summary(causes: Sequence[Cause]) -> Table:
    table = Table(title="Causes", title_justify="left", header_style="bold")
    for column in ("cause", "probability", "component", "size against the twin (90 %)", "machine file"):
        table.add_column(column, justify="right" if column == "probability" else "left", overflow="fold")
    for one in causes:
        table.add_row(
            escape(title(one.effects)),
            probability(one.probability),
            ", ".join(readable(name) for name in one.components),
            escape("\n".join(f"{median} ({interval}): {quantity}" for quantity, median, interval in magnitudes(one))),
            escape(one.machine_file),
        )
    return table


def _gap_closure_summary(found: Sequence[GapClosure]) -> Table:
    """A row a manoeuvre, a column a signal."""
    signals = list(dict.fromkeys(one.signal for one in found))
    table = Table(
        title="Share of the gap that is gone, with its 90 % interval", title_justify="left", header_style="bold"
    )
    table.add_column("manoeuvre", overflow="fold")
    table.add_column("part", overflow="fold")
    for signal in signals:
        table.add_column(readable(signal), justify="right", overflow="fold")
    rows: dict[tuple[str, str], dict[str, str]] = {}
    for one in sorted(found, key=_kind):
        row = rows.setdefault((one.manoeuvre, KINDS[_kind(one)]), {})
        row[one.signal] = f"{gap_closure(one.S)} ({_range(one)})"
    for (manoeuvre, part), row in rows.items():
        table.add_row(escape(manoeuvre), part, *(row.get(signal, "-") for signal in signals))
    return table


def _key_figures_summary(diagnosis: Diagnosis) -> Table:
    """A row a figure."""
    table = Table(title="Key figures", title_justify="left", header_style="bold")
    head, rows = _key_figures(diagnosis)
    for column in head:
        table.add_column(column, justify="left" if column in head[:2] else "right", overflow="fold")
    for row in rows:
        table.add_row(*(f"[bold]{escape(cell)}[/]" if len(row) == 1 else escape(cell) for cell in row))
    return table


# --- page ---


def write_report(diagnosis: Diagnosis, folder: Path, *, effects: Mapping[str, Effect] = EFFECTS) -> Path:
    """Write ``report.html`` into ``folder``: one page that needs no other file and no network.

    Args:
        diagnosis: Of any verdict; parts may be empty.
        folder: Made if it is not there; machine files are linked relative to it.
        effects: Catalogue that the causes are from.
    """
    sections = [
        ("Where the gap lies", _where_html(diagnosis)),
        ("Curves", _curves_html(diagnosis)),
        ("Causes", _causes_html(diagnosis, effects)),
        ("How far the gap shrinks", _gap_closure_html(diagnosis)),
        ("Key figures", _key_figures_html(diagnosis)),
        ("Next experiments", _experiments_html(diagnosis)),
        ("What calibration moved", _calibration_html(diagnosis)),
        ("Limitations", _limitations_html(diagnosis)),
        ("How to go on", _onward_html(diagnosis, folder)),
    ]
    path = folder / "report.html"
    write_page(
        path,
        "AORO: diagnosis",
        _lead(diagnosis),
        sections,
        top=_verdict_html(diagnosis, conclusions(diagnosis, effects=effects)),
        footer="Intervals hold 90 %. Left is positive; port A is the one under pressure in a left turn.",
        interactive=False,
    )
    return path


def _lead(diagnosis: Diagnosis) -> str:
    what = "turn" if diagnosis.signals == (KEY_FIGURES,) else "log"
    state = (
        f"commissioned on {count(len(diagnosis.healthy), f'healthy {what}')}" if diagnosis.healthy else diagnosis.mode
    )
    compared = f" Compared: {listed([readable(name) for name in diagnosis.signals])}." if diagnosis.signals else ""
    return f"{count(len(diagnosis.logs), what)} against the twin {diagnosis.machine} ({state}).{compared}"


def _explained(text: str, *blocks: Markup) -> Markup:
    """A paragraph and what it explains."""
    return joined([block("paragraph", text=text), *blocks])


def _bars(heading: str, rows: Sequence[tuple[str, float, str]]) -> Markup:
    """Bars on a card: name, share, and how it is written."""
    return block("bars", heading=heading, rows=rows, colour=BLUE)


def _verdict_html(diagnosis: Diagnosis, concluded: Conclusions) -> Markup:
    """What one reads first."""
    found = dict.fromkeys(size for one in suspected(diagnosis) for size in magnitudes(one))
    above = {"Why", "How much"} if found else {"Why"}
    answers = [
        block("card", contents=[block("paragraph", text=answer)], heading=question)
        for question, answer in concluded.answers.items()
        if question not in above
    ]
    colour = COLOURS[diagnosis.verdict]
    verdict = block(
        "verdict",
        tag=readable(diagnosis.verdict),
        headline=concluded.headline,
        text=concluded.why,
        sizes=[(median, f"{quantity}, against the twin (90 %: {interval})") for quantity, median, interval in found],
        colour=colour,
        below=_probabilities_html(diagnosis.causes, colour),
    )
    return joined([verdict, block("grid", cards=answers, kind="answers")])


def _probabilities_html(causes: Sequence[Cause], first: str) -> Markup:
    """One bar of the likeliest hypotheses and of all others together."""
    if not causes:
        return Markup("")
    shares = [
        (title(one.effects), one.probability, colour) for one, colour in zip(causes, (first, *BEHIND), strict=False)
    ]
    rest = 1.0 - sum(p for _, p, _ in shares)
    if rest >= 0.001:
        shares.append(("everything else", rest, GRID))
    parts = [(name, p, probability(p), colour) for name, p, colour in shares]
    return block("parted_bar", what="Probabilities", parts=parts)


def _where_html(diagnosis: Diagnosis) -> Markup:
    """Heat maps of the gap, over all manoeuvres and one by one."""
    if diagnosis.verdict in WITHOUT_CAUSE or not diagnosis.where:
        return Markup("")  # shares of what noise leaves say nothing
    places = sorted(diagnosis.where, key=lambda place: -place.share)
    signals = list(dict.fromkeys(place.signal for place in diagnosis.where))
    text = (
        "Share [%] of the gap, weighed by noise, by the time since the command last changed; a dot is less than half a per "
        "cent."
    )
    if diagnosis.where_p is not None:
        text += f" Without any cause a gap as large as this comes with {p_value(diagnosis.where_p)}."
    manoeuvres = dict.fromkeys(place.manoeuvre for place in diagnosis.where)
    overall = total_shares(diagnosis.where)
    cards = [_heat_html("All manoeuvres" if len(manoeuvres) > 1 else places[0].manoeuvre, overall, signals, overall)]
    rows = [
        (probability(p.share), readable(p.signal), readable(p.phase), p.manoeuvre, readable(p.component) or "-")
        for p in places[:MOST_PLACES]
    ]
    cards.append(
        block(
            "table",
            head=("share", "signal", "phase", "manoeuvre", "component"),
            rows=rows,
            text=range(1, 5),
            heading="Largest parts",
        )
    )
    if len(manoeuvres) > 1:
        single = {(place.manoeuvre, place.signal, place.phase): place.share for place in diagnosis.where}
        for name in manoeuvres:
            shares = {(s, phase): share for (manoeuvre, s, phase), share in single.items() if manoeuvre == name}
            cards.append(_heat_html(name, shares, signals, single))
    return joined([_drawing_html(diagnosis), _explained(text, block("grid", cards=cards))])


def _drawing_html(diagnosis: Diagnosis) -> Markup:
    """Machine with the components that a cause may lie in."""
    if not suspected(diagnosis) or not diagnosis.components:
        return Markup("")
    drawing = machine_drawing(diagnosis.components)
    return block("card", contents=[drawing], heading="Component that a cause lies in")


def _heat_html(
    name: str, shares: Mapping[tuple[str, str], float], signals: Sequence[str], scale: Mapping[tuple[str, ...], float]
) -> Markup:
    """Shares by signal and phase, on a card; the colour is full at the largest of ``scale``."""
    most = max(scale.values())

    def cell(share: float) -> tuple[str, float]:
        return f"{100.0 * share:.0f}" if share >= 0.005 else "·", DARKEST * share / most if most > 0.0 else 0.0

    return block(
        "heat_map",
        heading=name,
        head=[readable(phase).replace("undershoot", "under\N{SOFT HYPHEN}shoot") for phase in PHASES],
        rows=[(readable(s), [cell(shares.get((s, phase), 0.0)) for phase in PHASES]) for s in signals],
        colour=", ".join(str(int(RED[i : i + 2], 16)) for i in (1, 3, 5)),
    )


def telling(curves: Sequence[Curve], where: Sequence[Place] = ()) -> list[Curve]:
    """The curves that show most of the gap; one that took no part in the fit is among them if there is any.

    A sensor that is off by a constant parts measured from simulated more than most causes do, and is none: what has the
    larger share of ``where`` comes first. The plain difference ranks what has none."""
    shares = total_shares(where, lambda place: (place.manoeuvre, place.signal))

    def gap(curve: Curve) -> tuple[float, float]:
        difference = float(np.nanmean(((curve.measured - curve.before) / curve.spread) ** 2))
        return shares.get((curve.manoeuvre, curve.signal), 0.0), difference

    ranked = sorted(curves, key=gap, reverse=True)
    chosen, rest = ranked[:MOST_CURVES], ranked[MOST_CURVES:]
    if not any(curve.held_out for curve in chosen):
        chosen[-1:] = next(([curve] for curve in rest if curve.held_out), chosen[-1:])
    return chosen


def _curves_html(diagnosis: Diagnosis) -> Markup:
    curves = telling(diagnosis.curves, diagnosis.where)
    if not curves:
        return Markup("")
    after = twin_with(diagnosis.causes)
    text = (
        f"Above: what was measured, {_before(diagnosis)}, and the {after}. Below: what was measured less either of them, "
        "with the band that noise stays in for 90 % of the time."
    )
    if len(diagnosis.curves) > len(curves):
        text += f" Shown are the {len(curves)} of {len(diagnosis.curves)} signals with most of the gap."
    cards = [block("card", contents=[_curve_html(curve, after)]) for curve in curves]
    return _explained(text, block("grid", cards=cards))


def _before(diagnosis: Diagnosis) -> str:
    """What the gap is measured from."""
    if diagnosis.healthy:
        return "the healthy log of the same commands (the twin where there is none)"
    return "the twin as it was given"


def _curve_html(curve: Curve, after: str) -> Markup:
    """An image that stands in the page itself."""
    import matplotlib
    from matplotlib.figure import Figure

    unit, size = signal_unit(curve.signal)
    name = f"{curve.manoeuvre}: {readable(curve.signal)}"
    part = KINDS[0 if curve.held_out else 2]
    named = fill(after, NAME_WIDTH)
    legend = {"frameon": False, "fontsize": 8.5, "loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "borderpad": 0.0}
    legend |= {"borderaxespad": 0.3, "handlelength": 1.5, "handletextpad": 0.5, "columnspacing": 1.2}
    with matplotlib.rc_context(PLOT_STYLE | {"svg.hashsalt": "aoro-gym"}):
        figure = Figure(figsize=(4.6, 4.0), layout="constrained")
        over, under = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        over.plot(curve.time, curve.measured / size, color=INK, lw=2.4, label="measured")
        band = BAND * curve.spread / size
        under.fill_between(curve.time, -band, band, color=SOFT, alpha=0.3, lw=0, label="noise, 90 %")
        for label, values, colour in (("twin", curve.before, RED), (named, curve.after, BLUE)):
            over.plot(curve.time, values / size, color=colour, lw=1.2, label=label)
            under.plot(curve.time, (curve.measured - values) / size, color=colour, lw=1.0)
        above = 20 + 10 * named.count("\n")  # [pt]
        over.set_title(name, loc="left", fontsize=10, fontweight="bold", pad=above)
        over.set_title(part, loc="right", fontsize=8.5, pad=above)
        over.set_ylabel(f"[{unit}]")
        over.legend(ncols=3, **legend)
        under.set_ylabel(f"measured − twin [{unit}]")
        under.set_xlabel("time [s]")
        under.legend(**legend)
        for axis in (over, under):
            axis.grid(True)
            axis.set_axisbelow(True)
            axis.spines[["top", "right"]].set_visible(False)
            axis.set_xlim(float(curve.time[0]), float(curve.time[-1]))
        content = io.BytesIO()
        figure.savefig(content, format="svg", metadata={"Date": None})
    before, left = (
        with_unit(three_digits(float(np.sqrt(np.mean((curve.measured - values) ** 2))) / size), unit)
        for values in (curve.before, curve.after)
    )
    alt = f"{name}, {part}: the twin is off by {before}, the {after} by {left} (root mean square)"
    source = data_address(content.getvalue(), "image/svg+xml")
    return block("image", source=source, alt=alt, kind="curve")


def _causes_html(diagnosis: Diagnosis, effects: Mapping[str, Effect]) -> Markup:
    if not diagnosis.causes:
        return Markup("")
    rows = [
        (
            capital(title(one.effects)),
            probability(one.probability),
            [Markup("{}: <b>{}</b> ({})").format(*size) for size in magnitudes(one)],
            _settings(one, effects),
            [readable(name) for name in one.components],
            block("link", file=one.machine_file) if one.machine_file else "-",
        )
        for one in diagnosis.causes
    ]
    head = (
        "cause",
        "probability",
        "size against the twin (90 %)",
        "magnitude in the twin (SI)",
        "component",
        "machine file",
    )
    text = []
    if diagnosis.declared_set:
        names = listed([title([name]) for name in diagnosis.declared_set])
        if diagnosis.verdict == "no_gap":
            text.append(f"A gap is not ruled out; should there be one, its cause is among: {names}.")
        else:
            text.append(f"The least set of effects that should hold the truth: {names}.")
    if diagnosis.alike:
        pairs = [f"{title([one])} and {title([other])}" for one, other in diagnosis.alike]
        text.append(f"The data cannot tell apart: {'; '.join(pairs)}.")
    table = block("table", head=head, rows=rows, text=(3, 4, 5), long=(0, 2))
    return joined([table, *(block("paragraph", text=sentence) for sentence in text)])


def _settings(cause: Cause, effects: Mapping[str, Effect]) -> list[str]:
    """Name and value of every magnitude that the twin takes."""
    lines = []
    for name, values in cause.settings.items():
        known = effects[name].magnitudes if name in effects else ()
        for index, value in enumerate(values):
            what = known[index] if index < len(known) else None
            text = f"{readable(what.name if what else name)} {value:.4g}"
            lines.append(text if what is None or what.unit == "1" else f"{text} {what.unit}")
    return lines


def _gap_closure_html(diagnosis: Diagnosis) -> Markup:
    if diagnosis.verdict == "no_gap" or not diagnosis.shrinkage:
        return Markup("")
    text = (
        "100 %: nothing but noise is left; 0 %: nothing is gained; below: the gap has grown. What proves something are "
        "manoeuvres that took no part in the fit."
    )
    rows: list[Sequence[str]] = []
    for index, kind in enumerate(KINDS):
        found = [one for one in diagnosis.shrinkage if _kind(one) == index]
        rows += [[capital(kind)]] if found else []
        rows += [_gap_closure_row(one) for one in found]
    head = ("manoeuvre", "signal", "gap gone", "90 %", "error before, rms", "after", "noise", "unit")
    compared = [
        (capital(control(name)), value or 0.0, "not tried" if value is None else gap_closure(value))
        for name, value in diagnosis.controls.items()
    ]
    bars = [_bars("Gone on manoeuvres left out, median", compared)] if compared else []
    return _explained(text, *bars, block("table", head=head, rows=rows, text=(1, 7)))


def _gap_closure_row(one: GapClosure) -> list[str]:
    unit, size = signal_unit(one.signal)
    errors = (three_digits(value / size) for value in (one.before, one.after, one.noise))
    mark = "yes" if one.low90 > 0.0 else "no" if one.high90 < 0.0 else ""
    part = block("marked", text=gap_closure(one.S), kind=mark)
    return [one.manoeuvre, readable(one.signal), part, _range(one), *errors, unit]


def _key_figures_html(diagnosis: Diagnosis) -> Markup:
    head, rows = _key_figures(diagnosis)
    return block("table", head=head, rows=rows, text=(1, 6)) if rows else Markup("")


def _key_figures(diagnosis: Diagnosis) -> tuple[Sequence[str], list[Sequence[str]]]:
    """Head and rows of a table; a row of one cell heads a turn's. Where figures are all that was compared, with those of the
    healthy machine, with their standard deviations and what became of them."""
    alone = diagnosis.signals == (KEY_FIGURES,)
    every = [values for figures in diagnosis.key_figures.values() for values in figures.values()]
    columns = {"measured": "measured", "healthy": "healthy", "before": "twin", "after": twin_with(diagnosis.causes)}
    shown = [of for of in columns if any(values.get(of) is not None for values in every)] if alone else list(COLUMNS)
    rows: list[Sequence[str]] = []
    for turn, figures in diagnosis.key_figures.items():
        rows.append([turn])
        for name, values in figures.items():
            found, unit, _ = describe(name)
            row = [found, unit, *(show(name, values.get(of)) for of in shown)]
            rows.append([*row, show(name, values["std"]), _use(values)] if alone else row)
    head = ("key figure", "unit", *(columns[of] for of in shown))
    return (*head, "σ", "used") if alone else head, rows


def _use(figure: Mapping[str, float | None]) -> str:
    """What became of a figure in a table."""
    if figure["measured"] is None:
        return ""
    if figure["held_out"]:
        return "left out"
    return "built in" if figure["built_in"] and figure["healthy"] is None else "yes"


def _experiments_html(diagnosis: Diagnosis) -> Markup:
    if not diagnosis.next_experiments:
        return Markup("")
    rows = [
        (
            capital(readable(one.name)),
            one.description,
            f"{one.gain:.2f}",
            [" from ".join(readable(name) for name in pair) for pair in one.apart],
        )
        for one in diagnosis.next_experiments
    ]
    head = ("manoeuvre", "what to do", "expected gain [bit]", "tells")
    text = "Manoeuvres by how much they should tell. One bit settles two equally likely causes."
    return _explained(text, block("table", head=head, rows=rows, text=(3,), long=(1,)))


def _calibration_html(diagnosis: Diagnosis) -> Markup:
    if not diagnosis.calibration:
        return Markup("")
    rows = [
        (
            one["key"],
            f"{one['before']:.4g}",
            f"{one['after']:.4g}",
            "" if one["unit"] == "1" else one["unit"],
            signed(one["deviations"], 1),
        )
        for one in diagnosis.calibration
    ]
    text = (
        "Every hypothesis may move uncertain parameters. Under the first one these moved most; the last column counts "
        "standard deviations of what was known of each before."
    )
    head = ("parameter", "before", "after", "unit", "moved [σ]")
    return _explained(text, block("table", head=head, rows=rows, text=(3,)))


def _limitations_html(diagnosis: Diagnosis) -> Markup:
    texts = diagnosis.limitations or ("None was noted.",)
    logs = {"Compared": diagnosis.logs, "Healthy logs": diagnosis.healthy}
    read = [f"{name}: {', '.join(files)}" for name, files in logs.items() if files]
    said = [block("paragraph", text=text) for text in (*read, f"Found in {diagnosis.seconds:.0f} s.")]
    return block("card", contents=[block("listing", items=texts), *said])


def _onward_html(diagnosis: Diagnosis, folder: Path) -> Markup:
    file = machine_file(diagnosis)
    machine = str(folder / file) if file else diagnosis.machine
    if diagnosis.verdict == "ambiguous" and file:
        text = "Nothing is settled yet. The likeliest machine file can be used like any other:"
    elif file:
        text = "This machine file can be used like any other, by the twin, its environments and training:"
    elif diagnosis.verdict == "no_gap":
        text = "No other machine file is called for than the one that you have:"
    else:
        text = "No machine file is better founded than the one that you have:"
    shell = f"aoro-gym simulate --manoeuvre left --machine {machine}\naoro-gym evaluate --machine {machine}"
    python = (
        "import gymnasium as gym\n\nimport aoro_gym  # registers the environments\n\n"
        f'envs = gym.make_vec("AORO/PathTracking-v0", num_envs=64, machine="{machine}")'
    )
    contents = [block("paragraph", text=text), *(block("code", text=code) for code in (shell, python))]
    return block("card", contents=contents)
