"""The score of a diagnosis as JSON, tables and a confusion matrix."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.markup import escape
from rich.table import Table

from aoro_gym.diagnosis.result import CALIBRATION
from aoro_gym.diagnosis_benchmark.plants.effects import EFFECTS
from aoro_gym.diagnosis_benchmark.scoring import FAILED, TWO, Estimate, Outcome, Score, ScoredCase
from aoro_gym.execution.files import write_json, write_text, written_whole
from aoro_gym.reporting.style import BLUE, PLOT_STYLE, RED

ORDER = ("nothing", CALIBRATION, *EFFECTS, TWO, "unknown", "inconclusive", FAILED)
"""Of rows and columns of the confusion matrix."""
WITHOUT_CAUSE = ("nothing", CALIBRATION)
"""Either is right where only nuisances differ."""


@dataclass(frozen=True)
class Sheet:
    """A table: ``rows`` of text under ``head``."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]


def write_score(score: Score, folder: Path) -> list[Path]:
    """Write ``score.json``, ``score.md`` and ``confusion.png``; returns their paths."""
    paths = [folder / name for name in ("score.json", "score.md", "confusion.png")]
    write_json(paths[0], score.as_dict())
    write_text(paths[1], _markdown(score) + "\n")
    _draw_confusion(score, paths[2])
    return paths


# ------------------------------------------------------------------------------------------------------------------- tables
def sheets(score: Score) -> list[Sheet]:
    """All tables: figures, by level, by effect, what no oracle sees, failures by case."""
    shown = [outcome for outcome in score.outcomes.values() if outcome.all.count]
    levels = sorted({level for outcome in shown for level in outcome.levels})
    listed = [(case, score.failures(case)) for case in score.cases]
    failed = [(case, failures) for case, failures in listed if failures]
    return [
        Sheet(
            "Figures",
            ["figure", "asked", "all", "detectable", ""],
            [
                [
                    outcome.figure.title,
                    _asked(outcome),
                    _shown(outcome.all, outcome.figure.statistic),
                    _shown(outcome.detectable, outcome.figure.statistic),
                    {None: "", True: "met", False: "missed"}[outcome.met],
                ]
                for outcome in shown
            ],
        ),
        Sheet(
            "By level of the plants' laws",
            ["figure", *(f"level {level}" for level in levels)],
            [
                [
                    outcome.figure.title,
                    *(
                        _shown(outcome.levels[level], outcome.figure.statistic) if level in outcome.levels else "-"
                        for level in levels
                    ),
                ]
                for outcome in shown
            ],
        ),
        _by_effect(score),
        Sheet(
            f"Detectable by no oracle: {len(score.undetectable)} of "
            f"{sum(case.oracle is not None for case in score.cases)} cases with a deviation",
            ["case", "kind", "level", "truth", "evidence", "in noise alone"],
            [
                [
                    case.name,
                    case.kind,
                    str(case.level),
                    _truth(case),
                    f"{case.oracle.evidence:.2g}",
                    f"{case.oracle.noise:.2g}",
                ]
                for case in score.undetectable
                if case.oracle is not None
            ],
        ),
        Sheet(
            f"Failures: {len(failed)} of {len(score.cases)} cases",
            ["case", "kind", "level", "truth", "detectable", "said", "counts against"],
            [
                [
                    case.name,
                    case.kind,
                    str(case.level),
                    _truth(case),
                    {True: "yes", False: "no"}[case.detectable] if case.truth else "",
                    _said(case),
                    ", ".join(failures),
                ]
                for case, failures in failed
            ],
        ),
    ]


def tables(score: Score) -> list[Table]:
    """The same for a terminal."""
    drawn = []
    for sheet in sheets(score):
        table = Table(title=sheet.title, title_justify="left", header_style="bold")
        for name in sheet.head:
            table.add_column(escape(name), overflow="fold")
        colours = {"met": "green", "missed": "red"}
        for row in sheet.rows:
            table.add_row(*(f"[{colours[cell]}]{cell}[/]" if cell in colours else escape(cell) for cell in row))
        drawn.append(table)
    return drawn


def _by_effect(score: Score) -> Sheet:
    names = ("named_first", "declared", "component", "coverage", "outside_recognised")
    outcomes = [score.outcomes[name] for name in names]
    present = {effect for outcome in outcomes for effect in outcome.effects}
    return Sheet(
        "By effect",
        ["effect", *(name.replace("_", " ") for name in names)],
        [
            [
                effect,
                *(
                    _shown(outcome.effects[effect], outcome.figure.statistic) if effect in outcome.effects else "-"
                    for outcome in outcomes
                ),
            ]
            for effect in EFFECTS
            if effect in present
        ],
    )


def _shown(found: Estimate, statistic: str) -> str:
    """``value [low, high] (count)``, shares in per cent."""
    if found.value is None:
        return "-"
    scale, form = (100.0, "{:.0f} %") if statistic == "share" else (1.0, "{:.2f}")
    text = form.format(scale * found.value)
    if found.low95 is not None and found.high95 is not None:
        ends = (form.format(scale * end).removesuffix(" %") for end in (found.low95, found.high95))
        text += f" [{', '.join(ends)}]"
    return f"{text} ({found.count})"


def _asked(outcome: Outcome) -> str:
    if outcome.bounds is None:
        return ""
    low, high = outcome.bounds
    scale, unit = (100.0, " %") if outcome.figure.statistic == "share" else (1.0, "")
    of = " of detectable" if outcome.figure.detectable else ""
    if not np.isfinite(high):
        return f"≥ {scale * low:g}{unit}{of}"
    return f"≤ {scale * high:g}{unit}{of}" if low == 0.0 else f"{scale * low:g} to {scale * high:g}{unit}{of}"


def _truth(case: ScoredCase) -> str:
    """Effects with their sizes and severities."""
    texts = []
    for effect, one in case.truth.items():
        unit = "" if one["unit"] == "1" else f" {one['unit']}"
        sizes = ", ".join(f"{size:.3g}" for size in one["magnitude"])
        texts.append(f"{effect} {sizes}{unit} (severity {one['severity']:.2f})")
    return "; ".join(texts)


def _said(case: ScoredCase) -> str:
    if case.failed:
        return f"{FAILED}: {case.diagnosis['error']}"
    first = " + ".join(case.first["effects"]) or "nothing"
    return f"{case.verdict}: {first}, {case.first['probability']:.2f}"


def _markdown(score: Score) -> str:
    about = score.about
    head = (
        f"# Blind check: suite {about['suite']}, {about['mode']}, sensors {about['sensors']}\n\n"
        f"{len(score.cases)} cases of the family {about['family']}"
        + ("" if about["blind"] else ", **not blind** (their seed was given)")
        + ". Figures with 95 % intervals (shares: Wilson; others: bootstrap over cases) and, in brackets, how many values "
        "they are of. What is asked holds for the standard suite of commissioned machines. A deviation is detectable where "
        'an oracle that knows it rejects "nothing", in whose stead another day may do all it can, at p < 0.01; where both '
        "of two effects are asked for, only if each is, beside the other at any strength.\n"
    )
    if about["classes"]:
        head += f"\nCounted as one: {'; '.join(', '.join(one) for one in about['classes'])}.\n"
    parts = [head]
    for sheet in sheets(score):
        rows = [sheet.head, ["---"] * len(sheet.head), *sheet.rows] if sheet.rows else []
        lines = ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
        parts.append(f"## {sheet.title}\n\n" + "\n".join(lines or ["None."]) + "\n")
    parts.append("## Confusion\n\n![What is true, and what was said](confusion.png)")
    return "\n".join(parts)


# -------------------------------------------------------------------------------------------------------------------- figure
def _draw_confusion(score: Score, path: Path) -> None:
    """What was said (columns) by what is true (rows): counts, shaded by their share of the row; right ones framed."""
    import matplotlib
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    counts = score.confusion
    said = {name for row in counts.values() for name in row}
    rows = [name for name in ORDER if name in counts]
    columns = [name for name in ORDER if name in said or name in rows]
    columns = [name for name in columns if not name.startswith("x_")]  # a diagnosis has no name for them
    table = np.array([[counts[true][name] for name in columns] for true in rows], dtype=np.float64)
    shares = table / np.maximum(table.sum(axis=1, keepdims=True), 1.0)
    with matplotlib.rc_context(PLOT_STYLE):
        figure = Figure(figsize=(2.6 + 0.3 * len(columns), 2.2 + 0.26 * len(rows)), layout="constrained")
        axes = figure.subplots()
        shade = LinearSegmentedColormap.from_list("share", ["white", BLUE])
        axes.imshow(shares, cmap=shade, vmin=0.0, vmax=1.0, aspect="auto")
        for i, true in enumerate(rows):
            right = WITHOUT_CAUSE if true in WITHOUT_CAUSE else ("unknown",) if true.startswith("x_") else (true,)
            for j, name in enumerate(columns):
                if name in right:
                    axes.add_patch(Rectangle((j - 0.5, i - 0.5), 1.0, 1.0, fill=False, edgecolor=RED, linewidth=0.8))
                if table[i, j]:
                    colour = "white" if shares[i, j] > 0.6 else "black"
                    axes.text(j, i, f"{table[i, j]:.0f}", ha="center", va="center", color=colour, fontsize=8)
        axes.set_xticks(range(len(columns)), [_words(name) for name in columns], rotation=90)
        axes.set_yticks(range(len(rows)), ["nuisances only" if name == CALIBRATION else _words(name) for name in rows])
        axes.set_xticks(np.arange(len(columns)) + 0.5, minor=True)
        axes.set_yticks(np.arange(len(rows)) + 0.5, minor=True)
        axes.grid(which="minor")
        axes.tick_params(which="minor", length=0)
        axes.set_xlabel("said first")
        axes.set_ylabel("true")
        pairs = sum(case.kind == "pair" for case in score.cases)
        without = f"\nwithout {pairs} cases with two effects" if pairs else ""
        axes.set_title(f"Number of cases; right is framed{without}", loc="left")
        path.parent.mkdir(parents=True, exist_ok=True)
        with written_whole(path) as temporary:
            figure.savefig(temporary, dpi=150)


def _words(name: str) -> str:
    return name.removeprefix("x_").replace("_", " ") + (" (not in catalogue)" if name.startswith("x_") else "")
