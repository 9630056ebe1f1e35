"""An evaluation as a table, plots, films and one self-contained page."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from aoro_gym.agents.evaluation.films import film_caption, write_film
from aoro_gym.agents.evaluation.logs import write_episode
from aoro_gym.agents.evaluation.metrics import describe, explained, named, shown, verdict
from aoro_gym.agents.evaluation.plots import write_errors, write_metrics, write_plans
from aoro_gym.agents.evaluation.result import Evaluation
from aoro_gym.execution.files import write_json
from aoro_gym.reporting.page import Passage, block, write_page
from aoro_gym.reporting.terminal import Comparison


def write_report(
    result: Evaluation,
    folder: Path,
    *,
    films: bool = True,
    logs: str | None = None,
    lead: str | None = None,
    made_by: Mapping[str, Any] | None = None,
    progress: Callable[[str, float], Any] = lambda what, share: None,
) -> list[Path]:
    """Write ``evaluation.json``, plots (PNG), films and ``index.html``.

    Args:
        result: What to report on.
        folder: Made if it is not there.
        films: Whether to draw each policy's first episode, which takes most of the time.
        logs: Suffix of a log of that episode, ``csv``, ``parquet``, ``mcap`` or ``rosbag2``; by default none is written.
        lead: What the page says of the machine; its name by default.
        made_by: Put into the JSON under this name.
        progress: Called with what is drawn and the share of it that is done.

    Returns what was written.
    """
    progress("plots", 0.0)
    summary, metrics, errors, page = (
        folder / name for name in ("evaluation.json", "figures.png", "errors.png", "index.html")
    )
    content = result.to_json() | ({} if made_by is None else {"made_by": dict(made_by)})
    write_json(summary, content)
    write_metrics(result, metrics)
    write_errors(result, errors)
    plans = write_plans(result, folder)
    passages = [
        Passage("Metrics", _explained(result), [metrics], table=metric_rows(result)),
        Passage("Errors", f"Of all episodes: {result.task.error} against the {result.task.along}.", [errors]),
    ]
    if len(result.runs) > 1:
        text = (
            f"Each policy less {next(iter(result.runs))}, episode by episode, over those in which both have the metric and "
            "neither is a lower bound: what the episodes share cancels, so these intervals tell policies apart whose own "
            "overlap. Those that leave out 0 are beyond chance, and say whether the policy is better or worse."
        )
        passages.insert(1, Passage("Differences", text, table=difference_rows(result)))
    if plans:
        text = "Where each policy drove; the paths are dashed, a cross marks an episode that ended badly."
        passages.append(Passage("From above", text, plans))
    logged = []
    for policy in result.runs if logs else ():
        logged += write_episode(result, policy, folder / f"{_file_name(policy)}.{logs}")
    drawn = []
    for policy, run in result.runs.items() if films else ():
        stem, before = folder / _file_name(policy), len(drawn) / len(result.runs)

        def told(share: float, name: str = policy, before: float = before) -> None:
            progress(f"film: {name}", before + share / len(result.runs))

        drawn.append(write_film(result, run, stem, progress=told))
        passages.append(Passage(policy, film_caption(result, run), [drawn[-1]]))
    about = f"{result.env}, {counted(result)} a policy from seed {result.seed}."
    lead = f"{about} {lead or f'Machine {result.machine.name}.'}"
    write_page(page, "AORO: evaluation", lead, (one.section for one in passages), interactive=False)
    return [summary, metrics, errors, *plans, *logged, *drawn, page]


def metric_rows(result: Evaluation) -> list[list[str]]:
    """The metrics and endings, a column for each policy, the best first; the first row is the head."""
    summary, middle, endings, policies = result.summary, result.interquartile, result.endings, result.ranking
    total = result.episodes * result.repeats
    rows = [["mean [95 % interval]", "unit", *policies]]
    for name in next(iter(summary.values())):
        words, unit = named(name)
        rows.append([words, unit, *(shown(summary[policy][name], unit, total=total) for policy in policies)])
    for name in result.task.decisive:
        words, unit = named(name)
        values = [shown(middle[policy][name], unit, total=total) for policy in policies]
        rows.append([f"{words}, middle half", unit, *values])
    for name in result.task.decisive if result.stratified else ():
        words, unit = named(name)
        values = [shown(result.stratified[policy][name], unit, finer=1, total=total) for policy in policies]
        rows.append([f"{words}, middle half, over repeats", unit, *values])
    if len(next(iter(endings.values()))) > 1 or result.courses:
        for ending in next(iter(endings.values())):
            rows.append([f"ended: {ending}", "%", *(shown(endings[policy][ending], "%") for policy in policies)])
    return rows


def difference_rows(result: Evaluation) -> list[list[str]]:
    """Every metric of the other policies less that of the first one, a column for each; the first row is the head. A
    difference beyond chance is coloured, and says whether it is better or worse."""
    differences = result.differences
    total = result.episodes * result.repeats
    rows = [["mean difference [95 % interval]", "unit", *differences]]
    for name in next(iter(result.runs.values())).metrics:
        words, unit = named(name)
        cells = []
        for found in differences.values():
            text, said = shown(found[name], unit, total=total), verdict(name, found[name])
            kind = "yes" if said == "better" else "no"
            cells.append(block("marked", text=f"{text} {said}", kind=kind) if said else text)
        rows.append([words, unit, *cells])
    return rows


def table(result: Evaluation) -> Comparison:
    """The same for a terminal."""
    head, *rows = metric_rows(result)
    return Comparison(
        f"{result.env}: {counted(result)} a policy, the best first", head, rows, lead=2, note=explained(rows)
    )


def _explained(result: Evaluation) -> str:
    text = (
        "Every policy drove the same episodes: same seeds, courses, starts and noise. Means over the episodes with 95 % "
        "intervals: bootstrap over the episodes, of rates exact (Clopper and Pearson). Policies stand by their success, "
        f"then by {describe(result.task.decisive[0])[0]}."
    )
    if marks := explained(metric_rows(result)):
        text += f" {marks}"
    if result.repeats > 1:
        text += (
            f" Each episode was driven {result.repeats} times with other noise; intervals over repeats are of these "
            "episodes, by a stratified bootstrap."
        )
    if result.courses:
        text += " Errors are true ones of the front axle's middle."
        names = [course.name for course in result.courses]
        text += f" Driven on: {', '.join(names)}."
    return text


def _file_name(policy: str) -> str:
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in policy)


def counted(result: Evaluation) -> str:
    """How much was driven."""
    text = f"{result.episodes} episode{'' if result.episodes == 1 else 's'}"
    return text if result.repeats == 1 else f"{text}, {result.repeats} times each"
