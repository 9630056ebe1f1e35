"""Tables of trainings and of searches for hyper-parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.markup import escape
from rich.table import Table

from aoro_gym.agents.evaluation.metrics import explained, named, shown
from aoro_gym.agents.evaluation.statistics import Interval
from aoro_gym.agents.training.search import Trial
from aoro_gym.reporting.terminal import Comparison


def evaluations_table(evaluations: Sequence[Mapping[str, Any]]) -> Comparison:
    """The first evaluation of a training, that of the best return, and the last one."""
    best = max(evaluations, key=lambda one: one["figures"]["return"]["mean"])
    chosen = {"first": evaluations[0], "best return": best, "last": evaluations[-1]}
    rows = [
        ["steps", "", *(f"{one['steps']:,}" for one in chosen.values())],
        ["after", "s", *(f"{one['elapsed_s']:.0f}" for one in chosen.values())],
    ]
    total = max(metric.get("episodes", 0) for metric in evaluations[0]["figures"].values())
    for name in evaluations[0]["figures"]:
        words, unit = named(name)
        cells = [shown(_interval(one["figures"][name]), unit, total=total) for one in chosen.values()]
        rows.append([words, unit, *cells])
    return Comparison("Evaluations, means over episodes", ["", "unit", *chosen], rows, lead=2, note=explained(rows))


def _interval(metric: Mapping[str, Any]) -> Interval:
    mean = math.nan if metric["mean"] is None else metric["mean"]
    return Interval(mean, math.nan, math.nan, metric.get("episodes"), metric.get("lower_bounds", 0))


def trials_table(trials: Sequence[Trial]) -> Table:
    """The trials of a search, the best first."""
    table = Table(header_style="bold")
    for head in ("trial", "return", "steps", "hyper-parameters"):
        table.add_column(head, justify="right" if head in ("return", "steps") else "left", overflow="fold")
    for one in trials:
        if one.best is None:
            table.add_row(escape(one.folder.name), "-", "0", escape(one.failed or "did not begin"))
        else:
            steps, mean = one.evaluations[-1]["steps"], one.best["figures"]["return"]["mean"]
            table.add_row(escape(one.folder.name), f"{mean:.4g}", f"{steps:,}", escape(", ".join(one.params)))
    return table
