"""Learning curves: what the evaluations of several trainings found, beside the reference controllers on the same episodes.

Trainings that differ by their seed alone make one curve: the interquartile mean over the seeds with its 95 % interval, by
the stratified bootstrap of R. Agarwal et al., "Deep reinforcement learning at the edge of the statistical precipice",
NeurIPS 2021, whose strata are tasks. Here there is one, so all seeds are of one stratum.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.agents.controllers.reference import REFERENCE_POLICIES
from aoro_gym.agents.evaluation.evaluate import asked_of, evaluate, localised
from aoro_gym.agents.evaluation.metrics import (
    BOUNDED,
    MORE_IS_BETTER,
    OVER,
    SUCCESS,
    describe,
    display_factor,
    named,
    titled,
)
from aoro_gym.agents.evaluation.plots import COLOURS, saved_figure
from aoro_gym.agents.evaluation.result import Evaluation
from aoro_gym.agents.evaluation.statistics import Interval, interquartile_mean, plain, stratified_interval
from aoro_gym.agents.evaluation.tasks import TASKS
from aoro_gym.agents.training.plan import TrainingPlan
from aoro_gym.agents.training.run_folder import EVALUATIONS, load_run
from aoro_gym.agents.training.train import EVALUATION_SEED, evaluation_inputs
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.execution.files import read_json
from aoro_gym.execution.provenance import PROVENANCE, changed_inputs, listed
from aoro_gym.machine import Machine
from aoro_gym.reporting.style import INK, SOFT
from aoro_gym.reporting.terminal import Comparison

JUDGED_BY = (
    "env", "eval_episodes", "terrain", "path", "path_length", "soil", "machine", "set", "scale", "localisation",
)  # fmt: skip
"""Fields of a plan that evaluations depend on."""


@dataclass(frozen=True)
class LearningCurve:
    """Trainings that differ by their seed alone, K of them, evaluated M times each."""

    plan: TrainingPlan
    """Of the first one."""
    seeds: tuple[int, ...]
    steps: Sequence[int]
    """(M,)"""
    minutes: Sequence[float]
    """Wall-clock time of the slowest seed at each evaluation [min] (M,), evaluations included."""
    metrics: Mapping[str, np.ndarray]
    """Mean of each metric over an evaluation's episodes, by name (K, M); NaN where no episode had one."""
    bounds: Mapping[str, np.ndarray]
    """Whether the mean is a lower bound, likewise; see :data:`~aoro_gym.agents.evaluation.metrics.BOUNDED`."""

    @property
    def name(self) -> str:
        """Of the algorithm, and where it learned on from, if it did."""
        return self.plan.algo if self.plan.start is None else f"{self.plan.algo}, from {Path(self.plan.start).stem}"

    def over_seeds(self, name: str) -> list[Interval]:
        """Interquartile mean of a metric over the seeds that have it, at each evaluation, and the 95 % interval of that of
        other seeds; no interval of one seed. Of fewer than four seeds it is the mean."""
        strata = np.zeros(len(self.seeds), dtype=np.intp)
        found = (stratified_interval(each, strata, statistic=interquartile_mean) for each in self.metrics[name].T)
        return [one._replace(episodes=None) for one in found]


def read(folders: Sequence[Path]) -> list[LearningCurve]:
    """Curves of the trainings in ``folders``, in their order; of one that is not done, those evaluations that there are.

    Raises ValueError if there is none, or if they are not of one environment and judged alike.
    """
    groups: dict[str, list[tuple[TrainingPlan, list[dict[str, Any]]]]] = {}
    for folder in folders:
        plan, _ = load_run(folder)
        if not (folder / EVALUATIONS).exists():
            raise ValueError(f"{folder} holds no {EVALUATIONS} yet; let its training reach the first evaluation")
        found = _evaluations(folder)
        groups.setdefault(replace(plan, seed=0).command, []).append((plan, found))
    if not groups:
        raise ValueError("there is no training; give folders that 'aoro-gym train' wrote")
    first, *others = (members[0][0] for members in groups.values())
    for other in others:
        for name in JUDGED_BY:
            if getattr(other, name) != getattr(first, name):
                raise ValueError(
                    f"{name} is {getattr(first, name)!r} in one training and {getattr(other, name)!r} in another; "
                    "give trainings that are judged alike"
                )
    return [_curve(members) for members in groups.values()]


def _evaluations(folder: Path) -> list[dict[str, Any]]:
    """What a training found; ValueError if its file is damaged."""
    file, again = folder / EVALUATIONS, f"aoro-gym train --resume {folder} writes it again"
    try:
        found = read_json(file).get("evaluations")
        if not found:
            raise ValueError(f"{file} holds no evaluations")
        for one in found:
            if not (
                _are_numbers(one["steps"], one["elapsed_s"]) and one["figures"].keys() == found[0]["figures"].keys()
            ):
                raise ValueError(f"{file} holds an evaluation without its numbers")
            for metric in one["figures"].values():
                if metric["mean"] is not None and not _are_numbers(metric["mean"]):
                    raise ValueError(f"{file} holds an evaluation without its numbers")
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        reason = error if isinstance(error, ValueError) else f"{file} is damaged"
        raise ValueError(f"{reason}; {again}") from None
    return found


def _are_numbers(*values: Any) -> bool:
    return all(isinstance(value, int | float) and np.isfinite(value) for value in values)


def _curve(members: Sequence[tuple[TrainingPlan, list[dict[str, Any]]]]) -> LearningCurve:
    plan, seeds = members[0][0], tuple(one.seed for one, _ in members)
    if len(set(seeds)) < len(seeds):
        raise ValueError(f"the seeds of {plan.command} are {seeds}; give each training once")
    count = min(len(found) for _, found in members)
    names = list(members[0][1][0]["figures"])
    means = [[[_mean_of(one["figures"], name) for one in found[:count]] for _, found in members] for name in names]
    bounds = [
        [[bool(one["figures"][name].get("lower_bounds")) for one in found[:count]] for _, found in members]
        for name in names
    ]
    return LearningCurve(
        plan,
        seeds,
        steps=[one["steps"] for one in members[0][1][:count]],
        minutes=[max(found[k]["elapsed_s"] for _, found in members) / 60.0 for k in range(count)],
        metrics={name: np.array(values, dtype=np.float64) for name, values in zip(names, means, strict=True)},
        bounds={name: np.array(values, dtype=bool) for name, values in zip(names, bounds, strict=True)},
    )


def _mean_of(metrics: Mapping[str, Mapping[str, Any]], name: str) -> float | None:
    """Mean of a metric. Evaluations that don't say over how many episodes it is are of versions in which those that failed
    counted: where some did, nothing is known."""
    metric = metrics[name]
    if name in (*OVER, *BOUNDED) and "episodes" not in metric and metrics[SUCCESS]["mean"] != 1.0:
        return None
    return metric["mean"]


def check_inputs(folders: Sequence[Path], machine: Machine, held_out: Sequence[Course] | None) -> list[str]:
    """Check that trainings were evaluated on this machine and on these courses; returns warnings of those that do not say.

    Raises ValueError naming what differs.
    """
    warnings = []
    for folder in folders:
        plan, record = load_run(folder)[0], folder / PROVENANCE
        if not record.exists():
            warnings.append(
                f"{folder} has no {PROVENANCE}: whether its machine and ground are those of today is unknown"
            )
            continue
        changes = changed_inputs(record, evaluation_inputs(plan, machine, held_out))
        if changes:
            raise ValueError(
                f"{folder} was evaluated otherwise than the controllers would be now: {listed(changes)}; restore that, or"
                " leave the folder out"
            )
    return warnings


def references_asked(plan: TrainingPlan, machine: Machine, held_out: Sequence[Course] | None) -> dict[str, Any]:
    """What :func:`references` depends on, by name."""
    asked = asked_of(
        plan.env,
        REFERENCE_POLICIES[plan.env],
        machine=machine,
        courses=held_out,
        episodes=plan.eval_episodes,
        device=plan.device,
    )
    return asked | localised(plan.env, plan.localisation)


def references(
    plan: TrainingPlan,
    machine: Machine,
    held_out: Sequence[Course] | None,
    progress: Callable[[str, float], Any] = lambda what, share: None,
    kept: Path | None = None,
) -> Evaluation:
    """The reference controllers on the episodes that trainings of ``plan`` are evaluated on.

    Args:
        plan: Of the trainings.
        machine: That policies are made for.
        held_out: Where to evaluate; None where the task is no drive.
        progress: Called with a controller's name and the share of everything that is done.
        kept: Folder to keep episodes in.
    """
    return evaluate(
        plan.env,
        REFERENCE_POLICIES[plan.env],
        episodes=plan.eval_episodes,
        seed=EVALUATION_SEED,
        courses=held_out,
        machine=machine,
        soil=plan.soil,
        device=plan.device,
        localisation=plan.localisation,
        kept=kept,
        progress=progress,
    )


# ---- reports ---------------------------------------------------------------------------------------------------------


def compared(env: str) -> tuple[str, ...]:
    """The metrics that curves show."""
    return (*TASKS[env].decisive, SUCCESS)


def to_json(curves: Sequence[LearningCurve], beside: Evaluation) -> dict[str, Any]:
    """Content of ``curves.json``."""
    return {
        "env": beside.env,
        "curves": [
            {
                "command": one.plan.command,
                "seeds": one.seeds,
                "steps": one.steps,
                "minutes": one.minutes,
                "figures": {name: _plain(values) for name, values in one.metrics.items()},
                "over_seeds": _over_seeds(one),
            }
            for one in curves
        ],
        "references": beside.to_json()["policies"],
    }


def _over_seeds(curve: LearningCurve) -> dict[str, dict[str, dict[str, float | None]]]:
    """Interquartile means and intervals by metric and steps."""
    steps = [str(one) for one in curve.steps]
    return plain({name: dict(zip(steps, curve.over_seeds(name), strict=True)) for name in curve.metrics})


def _plain(values: np.ndarray) -> Any:
    """With None in the place of NaN."""
    return [[value if np.isfinite(value) else None for value in row] for row in values.tolist()]


def table(curves: Sequence[LearningCurve], beside: Evaluation) -> Comparison:
    """The last evaluations, and the controllers: the best first, by success, then by the first decisive metric."""
    metrics = {name: display_factor(describe(name)[1]) for name in compared(beside.env)}
    head = ["", "seeds", "steps", "min"]
    for name in metrics:
        words, unit = named(name)
        head.append(f"{words} [{unit}]")
    found: list[tuple[tuple[float, float], list[str]]] = []
    decisive = TASKS[beside.env].decisive[0]
    for one in curves:
        last = {name: one.over_seeds(name)[-1] for name in metrics}
        cells = [_cell(last[name], scale, bool(one.bounds[name][:, -1].any())) for name, scale in metrics.items()]
        row = [one.name, str(len(one.seeds)), f"{one.steps[-1]:,}", f"{one.minutes[-1]:.1f}", *cells]
        found.append((_rank(last[SUCCESS].mean, last[decisive].mean, decisive), row))
    for policy, values in beside.summary.items():
        cells = [
            _cell(Interval(values[name].mean, np.nan, np.nan), scale, values[name].bounds > 0)
            for name, scale in metrics.items()
        ]
        found.append((_rank(values[SUCCESS].mean, values[decisive].mean, decisive), [policy, "", "", "", *cells]))
    rows = [row for _, row in sorted(found, key=lambda one: one[0])]
    note = "interquartile mean over the seeds [95 %]; ≥: a lower bound"
    return Comparison(f"{beside.env}: last evaluation, the best first", head, rows, note=note)


def _cell(value: Interval, scale: float, bound: bool) -> str:
    """A metric in the unit that is shown, with its interval, if there is one."""
    if not np.isfinite(value.mean):
        return "-"
    text = f"{'≥ ' if bound else ''}{scale * value.mean:.3g}"
    between = f" [{scale * value.low95:.3g}, {scale * value.high95:.3g}]"
    return text + (between if np.isfinite(value.low95) else "")


def _rank(success: float, value: float, decisive: str) -> tuple[float, float]:
    value = -value if decisive in MORE_IS_BETTER else value
    return -success, value if np.isfinite(value) else np.inf


def write_figure(curves: Sequence[LearningCurve], beside: Evaluation, path: Path) -> None:
    """A panel for each metric over the steps: interquartile mean of the seeds with its interval, paler from the least to the
    largest of them, and the controllers as dashed lines."""
    metrics = compared(beside.env)
    with saved_figure(path, 3.9 * len(metrics), 3.4) as figure:
        for axis, name in zip(figure.subplots(1, len(metrics), squeeze=False)[0], metrics, strict=True):
            _draw_curves(axis, curves, beside, name)
            axis.set_title(titled(name), loc="left", fontsize=10.0, fontweight="bold")
            axis.set_xlim(left=0.0)
            axis.set_xlabel("million environment steps")
            axis.grid(True)
            axis.spines[["top", "right"]].set_visible(False)
        figure.axes[-1].legend(framealpha=0.85, edgecolor="none", fontsize=8.0)


def _draw_curves(axis: Any, curves: Sequence[LearningCurve], beside: Evaluation, name: str) -> None:
    """Draw a metric over the steps, with limits that show what follows the first third."""
    unit = describe(name)[1]
    scale, shown = display_factor(unit), []
    for k, one in enumerate(curves):
        values, colour = scale * one.metrics[name], COLOURS[k % len(COLOURS)]
        mean, low, high = scale * np.array([each[:3] for each in one.over_seeds(name)]).T
        steps = np.array(one.steps) / 1e6
        label = f"{one.name}, {len(one.seeds)} seed{'s' * (len(one.seeds) > 1)}, {one.minutes[-1]:.0f} min"
        axis.fill_between(steps, values.min(axis=0), values.max(axis=0), color=colour, alpha=0.12, lw=0.0)
        axis.fill_between(steps, low, high, color=colour, alpha=0.25, lw=0.0)
        axis.plot(steps, mean, "o-", color=colour, ms=3.5, lw=1.6, label=label)
        shown += [*values[:, len(steps) // 3 :].ravel()]
    for k, (policy, found) in enumerate(beside.summary.items()):
        value = scale * found[name].mean
        style, colour = ("--", ":", "-.", (0, (9, 3)))[k % 4], (INK, SOFT)[k % 2]
        axis.axhline(value, color=colour, lw=1.2, ls=style, label=policy)
        shown.append(value)
    known = [value for value in shown if np.isfinite(value)] or [0.0, 1.0]  # who fails has no metric
    low, high = min(known), max(known)
    margin = 0.15 * max(high - low, 0.02 * abs(high), 1e-9)
    top = min(high + margin, 100.0 + 0.2 * margin) if unit == "%" else high + margin
    axis.set_ylim(low - margin, top)  # what the first evaluations find may lie outside
