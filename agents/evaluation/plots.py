"""Plots of an evaluation: metrics, errors along the episodes, and where was driven."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.agents.evaluation.metrics import BOUNDED, RATES, display_factor, named
from aoro_gym.agents.evaluation.result import Evaluation
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.execution.files import written_whole
from aoro_gym.reporting.style import AMBER, BLUE, GREEN, INK, PLOT_STYLE, PURPLE, RED, SOFT
from aoro_gym.terrains import Plane
from aoro_gym.terrains.figures import draw_terrain, place_legend
from aoro_gym.terrains.generate.forest import Obstacle

COLOURS = (BLUE, AMBER, GREEN, PURPLE, RED, "#6b4a2b", INK, SOFT)
"""Of the policies, in their order."""
MOST_PLANS = 3
"""Courses that are drawn, those with most episodes."""


@contextmanager
def saved_figure(path: Path, width: float, height: float) -> Iterator[Any]:
    """A figure of this size [inch], which is written to ``path`` once it is drawn."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(PLOT_STYLE):
        figure = Figure(figsize=(width, height), dpi=130, layout="constrained")
        yield figure
        with written_whole(path) as temporary:
            figure.savefig(temporary)


def style_rows(axis: Any, policies: Sequence[str], title: str, *, labelled: bool) -> None:
    """Style a panel that has a row for each policy, the first on top; ``labelled`` ones say which."""
    axis.set_title(title, loc="left", fontsize=10.0, fontweight="bold")
    axis.set_yticks(range(len(policies)), labels=policies if labelled else [""] * len(policies))
    axis.set_ylim(len(policies) - 0.5, -0.5)
    axis.grid(True, axis="x")
    axis.spines[["top", "right", "left"]].set_visible(False)


def write_metrics(result: Evaluation, path: Path) -> None:
    """Draw a panel for each metric: its mean and interval for every policy, single episodes behind."""
    summary, policies = result.summary, result.ranking
    names = list(next(iter(summary.values())))
    columns = 2 if len(names) < 5 else 3
    rows = math.ceil(len(names) / columns)
    with saved_figure(path, 12.0, 0.5 + rows * (0.75 + 0.3 * len(policies))) as figure:
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for index, name in enumerate(names):
            axis, (words, unit) = axes[index], named(name)
            if name in BOUNDED and any(found[name].bounds for found in summary.values()):
                words = f"{words}, at least"
            _draw_metric(axis, result, name, display_factor(unit))
            style_rows(axis, policies, f"{words} [{unit}]" if unit else words, labelled=index % columns == 0)
            if unit == "%" and all(0.0 <= summary[policy][name].mean <= 1.0 for policy in policies):
                axis.set_xlim(-3.0, 103.0)
            axis.locator_params(axis="x", nbins=5)
            axis.tick_params(axis="y", length=0)
        for axis in axes[len(names) :]:
            axis.set_visible(False)


def _draw_metric(axis: Any, result: Evaluation, name: str, scale: float) -> None:
    spread = np.random.default_rng(0).uniform(-0.25, 0.25, result.episodes * result.repeats)
    for height, policy in enumerate(result.ranking):
        value, colour = result.summary[policy][name], COLOURS[height % len(COLOURS)]
        if name not in RATES:
            single = scale * result.runs[policy].metrics[name]
            axis.plot(single, height + spread, "o", color=colour, ms=3.5, alpha=0.25, mew=0, zorder=2)
        if math.isfinite(value.low95):
            ends = [scale * value.low95, scale * value.high95]
            axis.plot(ends, [height, height], color=colour, lw=3.2, solid_capstyle="butt", zorder=3)
        axis.plot([scale * value.mean], [height], "o", color=colour, ms=7.5, mec="white", mew=1.0, zorder=4)


def write_errors(result: Evaluation, path: Path) -> None:
    """Error along the episodes: median, half and nine tenths of them, a panel for each policy."""
    count = len(result.runs)
    columns = min(count, 2)
    rows = math.ceil(count / columns)
    with saved_figure(path, 12.0, 0.6 + 2.9 * rows) as figure:
        axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
        highest = 0.0
        for index, (policy, run) in enumerate(result.runs.items()):
            axis, colour = axes[index], COLOURS[index % len(COLOURS)]
            known = np.isfinite(run.errors)
            there = known.sum(axis=0)
            errors = run.errors[:, there > 0]
            along = result.task.interval * np.flatnonzero(there)
            bands = np.nanquantile(errors, [0.05, 0.25, 0.5, 0.75, 0.95], axis=0)
            axis.fill_between(along, bands[0], bands[4], color=colour, alpha=0.16, lw=0, label="nine tenths")
            axis.fill_between(along, bands[1], bands[3], color=colour, alpha=0.32, lw=0, label="half")
            axis.plot(along, bands[2], color=colour, lw=1.8, label="median")
            few = np.flatnonzero(there[there > 0] < len(run.endings))
            # paths end within a step or two of one another: not worth a word
            note = f"fewer episodes from {along[few[0]]:.3g} on" if few.size > 2 else ""
            axis.set_title(policy, loc="left", fontsize=10.5, fontweight="bold")
            axis.set_title(note, loc="right", fontsize=8.5, color=SOFT)
            axis.grid(True)
            axis.set_axisbelow(True)
            axis.spines[["top", "right"]].set_visible(False)
            highest = max(highest, float(bands[4].max()))
            if index % columns == 0:
                axis.set_ylabel(result.task.error)
            if index >= count - columns:
                axis.set_xlabel(result.task.along)
                axis.tick_params(labelbottom=True)
        axes[0].set_ylim(0.0, 1.08 * highest if highest > 0.0 else 1.0)
        axes[0].set_xlim(left=0.0)
        axes[0].legend(frameon=False, fontsize=8.5, ncols=3, loc="upper right")
        for axis in axes[count:]:
            axis.set_visible(False)


def write_plans(result: Evaluation, folder: Path) -> list[Path]:
    """Plan views of the courses that were driven most: ground, paths and where every policy drove; returns the files."""
    if not result.courses:
        return []
    episodes = next(iter(result.runs.values())).course[:, 0]
    driven, times = np.unique(episodes, return_counts=True)
    written = []
    for number in driven[np.argsort(-times, kind="stable")][:MOST_PLANS]:
        written.append(folder / f"plan_{number + 1}.png")
        _write_plan(result, int(number), written[-1])
    return written


def _write_plan(result: Evaluation, number: int, path: Path) -> None:
    import matplotlib
    from matplotlib.lines import Line2D

    course = result.courses[number]
    with matplotlib.rc_context(PLOT_STYLE):
        figure = _ground(course)
        axis = figure.axes[0]
        old = axis.get_legend()
        handles = [] if old is None else list(old.legend_handles)
        rows = next(iter(result.runs.values())).course
        used = np.unique(rows[rows[:, 0] == number, 1])
        for row in used:
            way = course.paths[row]
            around = np.concatenate([way.points, way.points[:1]]) if way.closed else way.points
            axis.plot(*around.T, color="white", lw=5.0, alpha=0.75, solid_capstyle="round", zorder=5)
            axis.plot(*around.T, color=INK, lw=1.0, ls=(0, (4, 3)), zorder=6)
        handles.append(Line2D([], [], color=INK, lw=1.0, ls=(0, (4, 3)), label="path"))
        for index, (policy, run) in enumerate(result.runs.items()):
            colour = COLOURS[index % len(COLOURS)]
            width = 1.2 + 1.3 * (len(result.runs) - 1 - index)  # good ones drive in each other's tracks: all shall show
            for i in np.flatnonzero(run.course[:, 0] == number):
                trace = run.places[i][np.isfinite(run.places[i, :, 0])]
                axis.plot(*trace.T, color=colour, lw=width, zorder=7 + index)
                if not run.metrics["success_rate"][i]:
                    axis.plot(*trace[-1], "X", color=colour, ms=8, mec="white", mew=0.8, zorder=30)
            handles.append(Line2D([], [], color=colour, lw=1.8, label=policy))
        place_legend(axis, handles)
        with written_whole(path) as temporary:
            figure.savefig(temporary, dpi=110, bbox_inches="tight")


def _ground(course: Course) -> Any:
    """The course's ground without its paths."""
    from matplotlib.figure import Figure

    if isinstance(course.terrain, Plane):
        figure = Figure(figsize=(10.0, 6.0), dpi=130, layout="constrained")
        axis = figure.add_subplot()
        axis.set_aspect("equal", adjustable="datalim")
        axis.grid(True)
        axis.set_xlabel("x, east [m]")
        axis.set_ylabel("y, north [m]")
        axis.set_title(course.name, loc="left", fontsize=11, fontweight="bold")
        return figure
    trees = [Obstacle("tree", *(float(value) for value in tree)) for tree in course.trees]
    return draw_terrain(course.terrain, obstacles=trees, title=course.name)
