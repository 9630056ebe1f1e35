"""Policies and reference controllers on seeds, grounds and machines that none of them saw.

Every policy drives the same episodes, on the machine of the file, on machines with all parameters drawn within their ranges,
and on such machines with an effect of the catalogue switched on. Policies are made for the machine of the file: of another
one's parameters they know nothing. The seeds, the forests and the machines are neither those of tuning nor of training, nor
of the evaluations that choose a training's best policy.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from aoro_gym.agents.controllers.reference import REFERENCE_POLICIES, Factory
from aoro_gym.agents.evaluation.evaluate import evaluate
from aoro_gym.agents.evaluation.metrics import (
    SUCCESS,
    describe,
    display_factor,
    explained,
    named,
    ranked,
    shown,
    titled,
)
from aoro_gym.agents.evaluation.perturbations import PERTURBATIONS
from aoro_gym.agents.evaluation.plots import COLOURS, saved_figure, style_rows
from aoro_gym.agents.evaluation.report import counted
from aoro_gym.agents.evaluation.result import Evaluation
from aoro_gym.agents.evaluation.statistics import Interval, interquartile_mean, interval, plain
from aoro_gym.envs.path_tracking.courses import Course, forest_course
from aoro_gym.execution.files import write_json, write_text
from aoro_gym.machine import Machine
from aoro_gym.reporting.terminal import Comparison

SEED = 40_000
"""Of the first episode."""
FORESTS = (201, 202, 203, 204)
"""Seeds of the forests: other ones than those of training, tuning and the evaluations in between."""


@dataclass(frozen=True)
class Leaderboard:
    """Evaluations of the same policies on ever stranger machines."""

    found: Mapping[str, Evaluation]
    """By the name of the perturbation."""

    @property
    def any(self) -> Evaluation:
        """One of them, for what all have in common."""
        return next(iter(self.found.values()))

    @cached_property
    def policies(self) -> list[str]:
        """From the best to the worst on the strangest machines: by success, then by the first decisive metric."""
        return ranked(self.middle[list(self.found)[-1]], self.any.task.decisive[0])

    @cached_property
    def middle(self) -> dict[str, dict[str, dict[str, Interval]]]:
        """Interquartile means of the decisive metrics, and success, by perturbation, policy and metric."""
        metrics = self.any.task.decisive
        return {
            name: {
                policy: {
                    SUCCESS: interval(run.metrics[SUCCESS], rate=True),
                    **{metric: result.of(run, metric, interquartile_mean) for metric in metrics},
                }
                for policy, run in result.runs.items()
            }
            for name, result in self.found.items()
        }

    @cached_property
    def stratified(self) -> dict[str, dict[str, dict[str, Interval]]]:
        """Decisive metrics likewise, of all that was driven, with intervals over repeats of these episodes; empty where each
        was driven once."""
        return {name: result.stratified for name, result in self.found.items() if result.repeats > 1}

    @property
    def best_reference(self) -> str | None:
        """The reference controller that comes first; None if none drove."""
        controllers = REFERENCE_POLICIES[self.any.env]
        return next((policy for policy in self.policies if policy in controllers), None)

    @cached_property
    def differences(self) -> dict[str, dict[str, dict[str, Interval]]]:
        """Mean of the decisive metrics of every other policy less those of the best reference controller, episode by
        episode, over those in which both have them."""
        best = self.best_reference
        if best is None:
            return {}
        return {
            name: {
                policy: result.less(policy, best, self.any.task.decisive) for policy in result.runs if policy != best
            }
            for name, result in self.found.items()
        }

    def to_json(self) -> dict[str, Any]:
        """Content of ``leaderboard.json``."""
        return self.any.asked | {
            "policies": self.policies,
            "interquartile_means": {name: plain(values) for name, values in self.middle.items()},
            "stratified_interquartile_means": {name: plain(values) for name, values in self.stratified.items()},
            "best_reference": self.best_reference,
            "differences": {name: plain(values) for name, values in self.differences.items()},
            "evaluations": {name: result.to_json() for name, result in self.found.items()},
        }


def compare(
    env: str,
    policies: Mapping[str, Factory],
    *,
    episodes: int = 100,
    repeats: int = 1,
    seed: int = SEED,
    courses: Sequence[Course] | None = None,
    machine: str | Machine = "aoro",
    device: str = "cpu",
    ray: str | None = None,
    kept: Path | None = None,
    progress: Callable[[str, float], Any] = lambda what, share: None,
) -> Leaderboard:
    """Evaluate policies under every perturbation.

    Args:
        env: Id of the environment.
        policies: What makes each policy, by name.
        episodes: Under each perturbation.
        repeats: How often each is driven.
        seed: Of the first episode.
        courses: Where to drive; :func:`forests` by default.
        machine: That policies are made for.
        device: Of the twins.
        ray: Address of a cluster to drive on.
        kept: Folder to keep episodes in.
        progress: Called with what is driven and the share of everything that is done.

    Raises as :func:`~aoro_gym.agents.evaluation.evaluate.evaluate`.
    """
    machine = machine if isinstance(machine, Machine) else Machine.load(machine)
    if courses is None and env == "AORO/PathTracking-v0":
        courses = forests()
    found = {}
    for done, (name, perturb) in enumerate(PERTURBATIONS.items()):

        def tell(policy: str, share: float, name: str = name, before: int = done) -> None:
            progress(f"{name}: {policy}", (before + share) / len(PERTURBATIONS))

        found[name] = evaluate(
            env,
            policies,
            episodes=episodes,
            repeats=repeats,
            seed=seed,
            courses=courses,
            machine=machine,
            drawn=perturb,
            device=device,
            ray=ray,
            kept=kept,
            progress=tell,
        )
    return Leaderboard(found)


@cache
def forests() -> tuple[Course, ...]:
    """Where paths are driven."""
    return tuple(forest_course(seed) for seed in FORESTS)


# ---- reports ---------------------------------------------------------------------------------------------------------


def write(
    result: Leaderboard, folder: Path, *, readme: Path | None = None, made_by: Mapping[str, Any] | None = None
) -> list[Path]:
    """Write ``leaderboard.json``, ``leaderboard.md`` and ``leaderboard.png``, and put the table between the marks of
    ``readme``; returns the files.

    Raises ValueError if the readme lacks the marks.
    """
    summary, text, picture = (folder / f"leaderboard.{end}" for end in ("json", "md", "png"))
    content = result.to_json() | ({} if made_by is None else {"made_by": dict(made_by)})
    write_json(summary, content)
    lines = markdown(result)
    write_text(text, lines)
    write_figure(result, picture)
    if readme is None:
        return [summary, text, picture]
    write_text(readme, lines.join(around_table(readme, result.any.env)))
    return [summary, text, picture, readme]


def rows(result: Leaderboard) -> list[list[str]]:
    """A row for each policy, the first is the head: success and decisive metrics under every perturbation."""
    metrics = (SUCCESS, *result.any.task.decisive)
    head = ["policy"]
    for name in result.found:
        for metric in metrics:
            words, unit = named(metric)
            head.append(f"{words} [{unit}], {name}")
    return [
        head,
        *(
            [
                policy,
                *(cell(result, name, policy, metric) for name in result.found for metric in metrics),
            ]
            for policy in result.policies
        ),
    ]


def cell(result: Leaderboard, name: str, policy: str, metric: str) -> str:
    """A metric with its interval over episodes; where each was driven more than once, that over repeats comes before it."""
    unit, value = describe(metric)[1], result.middle[name][policy][metric]
    total = result.any.episodes * result.any.repeats
    if name not in result.stratified or metric == SUCCESS:
        return shown(value, unit, total=total)
    before = shown(result.stratified[name][policy][metric], unit, finer=1)
    _, bracket, interval = shown(value, unit, total=total).partition("[")
    return f"{before}, {bracket}{interval}" if bracket else before


def markdown(result: Leaderboard) -> str:
    """The table with a sentence on how it came about: metrics down, policies across."""
    head, *body = rows(result)
    episodes = f"{result.any.episodes} episodes a cell"
    meaning = "mean of the middle half of the episodes [95 %]"
    if result.stratified:
        episodes += f", each driven {result.any.repeats} times"
        meaning = (
            "mean of the middle half [95 %, noise and machines drawn anew for these episodes], [95 %, other episodes]"
        )
    lines = [
        f"`{result.any.env}`, {episodes}; {meaning}, of success the share of all; the best first, by success, then by "
        f"{describe(result.any.task.decisive[0])[0]}:",
        "",
        "| " + " | ".join(["", *(row[0] for row in body)]) + " |",
        "|---" * (1 + len(body)) + "|",
    ]
    lines += ["| " + " | ".join([name, *(row[k] for row in body)]) + " |" for k, name in enumerate(head) if k]
    if note := explained(body):
        lines += ["", note]
    best = result.best_reference
    for policy in result.policies:
        if best is None or policy in REFERENCE_POLICIES[result.any.env]:
            continue
        said = []
        for metric in result.any.task.decisive:
            words, unit = describe(metric)
            values = ", ".join(shown(found[policy][metric], unit) for found in result.differences.values())
            said.append(f"{words} {values} {unit}")
        lines += ["", f"`{policy}` less `{best}`, episode by episode ({', '.join(result.found)}): {'; '.join(said)}."]
    return "\n".join(lines) + "\n"


def around_table(readme: Path, env: str) -> tuple[str, str]:
    """What stands before and after the environment's table, marks included.

    Raises ValueError if the file lacks the marks, OSError if there is none.
    """
    begin, end = (f"<!-- leaderboard {env}{side} -->" for side in ("", " end"))
    before, found, rest = readme.read_text(encoding="utf-8").partition(f"{begin}\n")
    _, closed, after = rest.partition(end)
    if not (found and closed):
        raise ValueError(f"{readme} lacks the lines {begin} and {end}, between which the table belongs")
    return before + found, closed + after


def table(result: Leaderboard) -> Comparison:
    """The same for a terminal: metrics down, policies across."""
    head, *body = rows(result)
    cells = [[name, *(row[k] for row in body)] for k, name in enumerate(head) if k]
    title = f"{result.any.env}: {counted(result.any)}, middle half, the best first"
    return Comparison(title, ["", *(row[0] for row in body)], cells, note=explained(cells))


def write_figure(result: Leaderboard, path: Path) -> None:
    """A panel for each decisive metric: its interquartile mean and interval, by policy and perturbation. Where episodes were
    driven more than once, a broad bar is the interval over repeats."""
    from matplotlib.lines import Line2D

    metrics, policies = result.any.task.decisive, result.policies
    with saved_figure(path, 4.2 * len(metrics), 1.5 + 0.5 * len(policies)) as figure:
        axes = figure.subplots(1, len(metrics), squeeze=False)[0]
        for column, (axis, what) in enumerate(zip(axes, metrics, strict=True)):
            _draw_intervals(axis, result, what)
            style_rows(axis, policies, titled(what), labelled=column == 0)
            axis.locator_params(axis="x", nbins=6)
        handles = axes[0].get_legend_handles_labels()[0]
        if result.stratified:
            handles += [
                Line2D([], [], color="grey", lw=6.0, label="95 %, noise and machines drawn anew"),
                Line2D([], [], color="grey", lw=1.3, label="95 %, other episodes"),
            ]
        figure.legend(handles=handles, loc="outside upper left", ncols=len(handles), frameon=False, fontsize=8.5)


def _draw_intervals(axis: Any, result: Leaderboard, what: str) -> None:
    """Draw a metric's mean and intervals for every policy, one above the other by perturbation."""
    scale, names = display_factor(describe(what)[1]), list(result.found)
    for k, name in enumerate(names):
        heights = [height + 0.22 * (k - 0.5 * (len(names) - 1)) for height in range(len(result.policies))]
        colour = COLOURS[k % len(COLOURS)]
        drawn = [(result.middle[name], 1.3 if result.stratified else 2.6)]
        if result.stratified:
            drawn.append((result.stratified[name], 6.0))
        for found, width in drawn:
            for height, policy in zip(heights, result.policies, strict=True):
                value = found[policy][what]
                axis.hlines(height, scale * value.low95, scale * value.high95, color=colour, lw=width)
        means = [scale * result.middle[name][policy][what].mean for policy in result.policies]
        axis.plot(means, heights, "o", color=colour, mec="white", ms=6.0, label=name, zorder=3)
