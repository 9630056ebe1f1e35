"""Tables of a calibration's report."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from rich.markup import escape
from rich.text import Text

from aoro_gym.reporting.page import describe
from aoro_gym.reporting.terminal import Comparison, labelled

NAMED = 5
"""Parameters on a bound that a terminal shows; the report has all."""


def tables(report: dict[str, Any]) -> Iterator[Comparison | str]:
    """The verdict, the errors of figures or intervals of parameters, then what the calibration leaves open."""
    verdict = report["verdict"]
    yield f"[bold {'green' if verdict['fits'] else 'red'}]{escape(verdict['sentence'])}[/]"
    for log in report.get("conditions", []):
        yield f"{escape(log['log'])}: {escape('; '.join(log['used']))}"
        yield from _warnings(log["warnings"])
    yield from _warnings(report.get("warnings", []))
    if report.get("accepted_code_changes"):
        yield labelled("changes of the code that were accepted", report["accepted_code_changes"])
    yield from _misses(report)
    yield from _procedure(report)
    if report.get("grades"):
        yield _grades(report["grades"])
        yield escape(report["graded"])
    if report.get("laws"):
        yield _families(report["laws"])
        yield escape(report["laws"]["sentence"])
    if verdict.get("channels"):
        yield _channels(verdict["channels"])
        yield escape(verdict["serves"])
    if report.get("parameters"):
        yield _parameters(report["parameters"])
    for key, text in (
        ("largest_miss_tolerances", "largest miss: {:.2f} tolerances"),
        ("largest_change_at_half_the_substep_tolerances", "largest change at half the substep: {:.2f} tolerances"),
        ("rms_residual_std", "residuals: {:.2f} standard deviations, root mean square"),
    ):
        if report.get(key) is not None:
            yield text.format(report[key])
    if "leaning_on_a_bound" in report:
        yield _leaning(report)
    if report.get("ensemble_dropped"):
        yield labelled("ensemble members that were dropped", report["ensemble_dropped"])
    if report.get("held"):
        yield labelled("held at what is published", report["held"])
    if "not_felt" in report:
        yield labelled("not identifiable, so left as they were", report["not_felt"])
    if "left_as_they_were" in report:
        yield labelled("not in the logs, so left as they were", report["left_as_they_were"])


def _warnings(texts: Sequence[str]) -> Iterator[str]:
    for text in texts:
        yield f"[yellow]warning:[/] {escape(text)}"


def _misses(report: dict[str, Any]) -> Iterator[Comparison]:
    misses: dict[str, dict[str, float]] = report.get("misses_tolerances", {})
    if misses:
        rows = [
            [describe(name)[0], *(_miss(misses[level][name]) for level in misses)]
            for name in next(iter(misses.values()))
        ]
        head = ["key figure", *(f"{level} % signal" for level in misses)]
        yield Comparison("Misses of left turns, in tolerances", head, rows)
    single: dict[str, float] = report.get("single_misses_tolerances", {})
    if single:
        rows = [[name.replace("_", " "), _miss(miss)] for name, miss in single.items()]
        yield Comparison("Misses of single figures, in tolerances", ("figure", "miss"), rows)


def _channels(channels: dict[str, Any]) -> Comparison:
    """What is left of every measured signal, against its noise and against its movement."""
    rows = []
    for name, match in channels.items():
        mark = Text("met", "green") if match["fits"] else Text("missed", "red")
        shares = (f"{100.0 * match[key]:.2g} %" for key in ("unexplained_share", "largest_share"))
        rows.append([name.replace("_", " "), f"{match['residual_std']:.2f}", *shares, mark])
    head = ("signal", "left, standard deviations of noise", "of its movement", "may be", "")
    return Comparison("What is left of each signal", head, rows)


def _grades(grades: Sequence[dict[str, Any]]) -> Comparison:
    """Key figures beside those of repeated turns."""
    colours = {"excellent": "green", "good": "yellow", "missed": "red"}
    rows = []
    for one in grades:
        name, unit, _ = describe(one["figure"])
        rows.append([
            f"{one['direction']} {one['signal_percent']:g} %", f"{name}, {unit}", f"{one['mean']:.4g}",
            f"{one['run_to_run']:.2g}", f"{one['bound']:.2g}", "-" if one["twin"] is None else f"{one['twin']:.4g}",
            Text(one["grade"], colours[one["grade"]]),
        ])  # fmt: skip
    head = ("turn", "figure", "machine, mean", "run to run, ±", "bound, ±", "twin, mean", "")
    return Comparison("Key figures beside those of repeated turns", head, rows, lead=2)


def _families(laws: dict[str, Any]) -> Comparison:
    """What each family of laws predicts of what it was not fitted to, the best first."""
    rows = []
    for one in laws["families"]:
        interval = one["ratio_to_the_best_95"]
        mark = Text("chosen", "green") if one["family"] == laws["chosen"] else Text("")
        mark = Text("not told apart", "yellow") if one["family"] in laws["alike"] else mark
        mark = Text("not told apart, quick", "yellow") if one["family"] in laws["alike_by_the_screening"] else mark
        rows.append([
            one["family"], str(one["searched"]), f"{one['screening']:.2f}",
            *("-" if one[key] is None else f"{one[key]:.2f}" for key in ("predicted", "fit")),
            "-" if interval is None else f"{interval[0]:.2f} - {interval[1]:.2f}", mark,
        ])  # fmt: skip
    head = ("laws", "searched", "predicted, quick", "predicted", "fit", "times the best, 95 %", "")
    return Comparison("What each family predicts of logs left out, standard deviations of noise", head, rows)


def _leaning(report: dict[str, Any]) -> str:
    """Parameters on a bound in one line: those that the data identify first, no more than :data:`NAMED`."""
    identified = {one["key"] for one in report.get("parameters", []) if one["identified"]}
    ends = sorted(report["leaning_on_a_bound"], key=lambda item: item["key"] not in identified)
    named = [f"{item['key']} ({item['end']} end)" for item in ends[:NAMED]]
    more = [f"and {len(ends) - NAMED} more, in the report"] if len(ends) > NAMED else []
    return labelled("leaning on a bound of its range", named + more)


def _procedure(report: dict[str, Any]) -> Iterator[Comparison]:
    """What the steps of the published procedure found, and the turns beside it."""
    rows = [
        [
            one["key"],
            one["measured"],
            f"{one['before']:.4g}",
            f"{one['after']:.4g}",
            "" if one["unit"] == "1" else one["unit"],
        ]
        for one in report.get("procedure", [])
    ]
    if rows:
        yield Comparison("What the procedure found", ("parameter", "measured", "before", "after", "unit"), rows)
    turns = [
        [one["direction"], f"{one['signal_percent']:g} %", f"{one['measured_s']:.3f}",
         "-" if one["twin_s"] is None else f"{one['twin_s']:.3f}",
         "-" if one["relative"] is None else f"{100.0 * one['relative']:+.1f} %", one["log"]]
        for one in report.get("turns", [])
    ]  # fmt: skip
    if turns:
        head = ("turn", "signal", "measured, s", "machine, s", "error", "log")
        yield Comparison("Times of full turns", head, turns, lead=2)


def _parameters(parameters: Sequence[dict[str, Any]]) -> Comparison:
    rows = []
    for p in parameters:
        mark = Text("identified", "green") if p["identified"] else Text("not identified", "yellow")
        unit = "" if p["unit"] == "1" else p["unit"]
        rows.append([p["key"], f"{p['value']:.4g}", f"{p['low95']:.4g} - {p['high95']:.4g}", unit, mark])
    head = ("key", "value", "95 % interval", "unit", "")
    return Comparison("Parameters that the logs depend on", head, rows)


def _miss(miss: float) -> Text:
    """In tolerances, green where it is within one."""
    return Text(f"{miss:+.2f}", "green" if abs(miss) <= 1 else "red")
