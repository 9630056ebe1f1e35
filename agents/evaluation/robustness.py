"""Which gap between twin and machine hurts which policy.

Policies are made for the machine of the file. Here they drive the same episodes, with the same errors of the sensors, on
machines that differ from it in one way each: every effect of the catalogue that acts on the machine, at a share of its range
to either side; every family of laws; and all uncertain parameters drawn at once. A change is a metric on such a machine less
that on the machine of the file, episode by episode.

>>> from aoro_gym.agents.evaluation.robustness import conditions
>>> from aoro_gym.machine import Machine
>>> next(one.name for one in conditions(Machine.load("aoro")) if one.kind == "pump")
'pump_response ×1.73'
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.agents.controllers.reference import Factory
from aoro_gym.agents.evaluation.evaluate import evaluate
from aoro_gym.agents.evaluation.leaderboard import SEED, forests
from aoro_gym.agents.evaluation.metrics import MORE_IS_BETTER, SUCCESS, describe, display_factor, shown, titled, verdict
from aoro_gym.agents.evaluation.perturbations import SWITCHABLE, Perturbation, magnitude_at, perturbed, unperturbed
from aoro_gym.agents.evaluation.plots import saved_figure
from aoro_gym.agents.evaluation.result import Evaluation
from aoro_gym.agents.evaluation.statistics import Interval, plain
from aoro_gym.agents.evaluation.tasks import TASKS, EvaluationTask
from aoro_gym.checks import check_range
from aoro_gym.effects.effect import MachineEffect, Magnitude
from aoro_gym.execution.files import with_nulls, write_json
from aoro_gym.machine import Machine
from aoro_gym.machine.laws import FAMILIES, family
from aoro_gym.reporting.terminal import Comparison

CALIBRATED = "as calibrated"
"""Name and kind of the condition that others are compared with."""
DRAWN = "parameters"
"""Kind of the condition of which all uncertain parameters are drawn."""
LAWS = "laws"
"""Kind of a condition of other laws."""
MOST_ROWS, MOST_SHOWN = 24, 10
"""Conditions in the figure and in the terminal's tables: those that hurt most."""


@dataclass(frozen=True)
class Condition:
    """One way in which the driven machine differs from the one that policies are made for."""

    name: str
    kind: str
    """:data:`CALIBRATED`, :data:`DRAWN`, :data:`LAWS`, or the component of an effect."""
    machines: Perturbation
    """Gives the machines that are driven."""


def conditions(machine: Machine, share: float = 0.5) -> list[Condition]:
    """The machine as it is, then all that differs from it in one way; see the module.

    An effect whose size would leave the machine without physical meaning is left out.

    Args:
        machine: One machine.
        share: Size of the effects, as a share of the way from nothing to an end of their range; of factors, of the
            logarithm's way.

    Raises ValueError unless 0 < ``share`` <= 1.
    """
    check_range("share", share, "", gt=0.0, le=1.0)
    found = [Condition(CALIBRATED, CALIBRATED, unperturbed), Condition("all parameters drawn", DRAWN, perturbed)]
    for name in FAMILIES:
        if family(name).names != machine.laws.names:
            found.append(Condition(f"laws of {name}", LAWS, _always(machine.with_laws(**family(name).names))))
    for effect in SWITCHABLE.values():
        found += _of_effect(machine, effect, share)
    return found


def _of_effect(machine: Machine, effect: MachineEffect, share: float) -> Iterator[Condition]:
    """An effect to either side; once where its range has but one."""
    sizes = {tuple(magnitude_at(one, side * share) for one in effect.magnitudes): None for side in (1.0, -1.0)}
    for size in sizes:
        try:
            affected = effect.apply(machine, *size)
        except ValueError:
            continue
        sizes_shown = ", ".join(_shown_size(one, value) for one, value in zip(effect.magnitudes, size, strict=True))
        yield Condition(f"{effect.id} {sizes_shown}", effect.component, _always(affected))


def _shown_size(magnitude: Magnitude, value: float) -> str:
    """A factor as ``×1.4``, other sizes with their sign and unit."""
    if magnitude.none == 1.0 and magnitude.unit == "1":
        return f"×{value:.3g}"
    return f"{value:+.3g}" if magnitude.unit == "1" else f"{value:+.3g} {magnitude.unit}"


def _always(affected: Machine) -> Perturbation:
    """The same machine whatever the seeds."""
    return lambda machine, seeds: affected


@dataclass(frozen=True)
class Robustness:
    """Evaluations of the same policies on machines that differ in one way each."""

    share: float
    conditions: Sequence[Condition]
    """The first is :data:`CALIBRATED`."""
    found: Mapping[str, Evaluation]
    """By the condition's name."""

    @property
    def calibrated(self) -> Evaluation:
        """On the machine that policies are made for."""
        return self.found[CALIBRATED]

    @property
    def policies(self) -> list[str]:
        """From the best to the worst on that machine."""
        return self.calibrated.ranking

    @property
    def metrics(self) -> tuple[str, ...]:
        """Success, then the decisive metrics."""
        return (SUCCESS, *self.calibrated.task.decisive)

    @cached_property
    def changes(self) -> dict[str, dict[str, dict[str, Interval]]]:
        """Mean change of a metric by condition, policy and metric, over the episodes that have it in both."""
        return {
            name: {
                policy: {metric: self._change(result, policy, metric) for metric in self.metrics}
                for policy in self.policies
            }
            for name, result in self.found.items()
            if name != CALIBRATED
        }

    def _change(self, result: Evaluation, policy: str, metric: str) -> Interval:
        driven, before = result.runs[policy], self.calibrated.runs[policy]
        return result.over_episodes(driven.exact(metric) - before.exact(metric))

    @cached_property
    def worst_first(self) -> list[str]:
        """Conditions by the harm that they do to the best policy: success that is lost, then the first decisive metric's
        change for the worse; a change that is not known is the last."""
        best, metric = self.policies[0], self.metrics[1]
        sign = -1.0 if metric in MORE_IS_BETTER else 1.0

        def harm(name: str) -> tuple[float, float]:
            change = self.changes[name][best]
            worse = sign * change[metric].mean
            return -change[SUCCESS].mean, worse if math.isfinite(worse) else -math.inf

        return sorted(self.changes, key=harm, reverse=True)

    def to_json(self) -> dict[str, Any]:
        """Content of ``robustness.json``."""
        return self.calibrated.asked | {
            "share": self.share,
            "policies": self.policies,
            "calibrated": plain(self.calibrated.summary),
            "conditions": {one.name: {"kind": one.kind} for one in self.conditions[1:]},
            "worst_first": self.worst_first,
            "changes": {name: plain(change) for name, change in self.changes.items()},
        }


def measure(
    env: str,
    policies: Mapping[str, Factory],
    *,
    share: float = 0.5,
    episodes: int = 32,
    seed: int = SEED,
    machine: str | Machine = "aoro",
    device: str = "cpu",
    kept: Path | None = None,
    progress: Callable[[str, float], Any] = lambda what, share: None,
) -> Robustness:
    """Evaluate policies under every condition.

    Args:
        env: Id of the environment.
        policies: What makes each policy, by name.
        share: See :func:`conditions`.
        episodes: Under each condition, always the same ones.
        seed: Of the first episode.
        machine: That policies are made for.
        device: Of the twins.
        kept: Folder to keep episodes in.
        progress: Called with a policy's name and the share of everything that is done.

    Raises as :func:`conditions` and :func:`~aoro_gym.agents.evaluation.evaluate.evaluate`.
    """
    machine = machine if isinstance(machine, Machine) else Machine.load(machine)
    courses = forests() if env == "AORO/PathTracking-v0" else None
    differing, found = conditions(machine, share), {}
    # machines of other laws need other kernels, which are slower
    groups = [[one for one in differing if (one.kind == LAWS) == others] for others in (False, True)]
    done = 0
    for group in filter(None, groups):

        def tell(policy: str, part: float, size: int = len(group), before: int = done) -> None:
            progress(policy, (before + part * size) / len(differing))

        together = evaluate(
            env,
            policies,
            episodes=episodes,
            repeats=len(group),
            same_noise=True,
            seed=seed,
            courses=courses,
            machine=machine,
            drawn=partial(_of_conditions, group, TASKS[env], seed, episodes),
            device=device,
            kept=kept,
            progress=tell,
        )
        for place, condition in enumerate(group):
            own = slice(place * episodes, (place + 1) * episodes)
            runs = {name: run.part(own) for name, run in together.runs.items()}
            found[condition.name] = replace(together, runs=runs, repeats=1)
        done += len(group)
    return Robustness(share, differing, {one.name: found[one.name] for one in differing})


def _of_conditions(
    group: Sequence[Condition], task: EvaluationTask, first: int, episodes: int, machine: Machine, seeds: Sequence[int]
) -> Machine:
    """One machine a seed: the k-th ``episodes`` seeds from ``first`` on are those of the k-th condition, on which the
    episodes have the seeds from ``first`` on."""
    place, episode = np.divmod(np.array(seeds) - first, episodes)
    parts = [(group[k], (first + episode[place == k]).tolist()) for k in dict.fromkeys(place.tolist())]
    return Machine.stacked(
        [task.drawing(one.machines)(machine, own) for one, own in parts], [len(own) for _, own in parts]
    )


# ---- reports ---------------------------------------------------------------------------------------------------------


def write(result: Robustness, folder: Path, *, made_by: Mapping[str, Any]) -> list[Path]:
    """Write ``robustness.json`` and ``robustness.png``; returns the files."""
    summary, picture = folder / "robustness.json", folder / "robustness.png"
    write_json(summary, with_nulls(result.to_json() | {"made_by": dict(made_by)}))
    write_figure(result, picture)
    return [summary, picture]


def tables(result: Robustness) -> list[Comparison]:
    """For a terminal: changes of each metric by the conditions that hurt most, policies across."""
    found = []
    for metric in result.metrics:
        words, unit = describe(metric)
        before = {policy: shown(result.calibrated.summary[policy][metric], unit) for policy in result.policies}
        rows = [[CALIBRATED, *before.values()]]
        for name in result.worst_first[:MOST_SHOWN]:
            changes = [result.changes[name][policy][metric] for policy in result.policies]
            rows.append([name, *(_signed(change, unit) for change in changes)])
        title = f"{words} [{unit}]: change by what differs, the worst {len(rows) - 1} of {len(result.changes)}"
        found.append(Comparison(title, ["", *result.policies], rows))
    return found


def _signed(change: Interval, unit: str) -> str:
    text = shown(change, unit)
    return f"+{text}" if change.mean > 0.0 else text


def write_figure(result: Robustness, path: Path) -> None:
    """A heat map for each metric: what differs down, the worst first, policies across. Red is worse, blue better, by the
    share of the largest change; changes whose 95 % interval holds 0 are grey."""
    rows, metrics, policies = result.worst_first[:MOST_ROWS], result.metrics, result.policies
    width, height = 3.2 + len(metrics) * (0.6 + 0.72 * len(policies)), 1.8 + 0.28 * len(rows)
    with saved_figure(path, width, height) as figure:
        axes = figure.subplots(1, len(metrics), squeeze=False)[0]
        for column, (axis, metric) in enumerate(zip(axes, metrics, strict=True)):
            _draw_changes(axis, result, rows, metric)
            axis.set_title(titled(metric).replace(", ", ",\n"), loc="left", fontsize=9.5, fontweight="bold")
            axis.set_xticks(range(len(policies)), labels=policies, rotation=35.0, ha="right", fontsize=8.5)
            axis.set_yticks(range(len(rows)), labels=rows if column == 0 else [""] * len(rows), fontsize=8.5)
            axis.tick_params(length=0)
            axis.spines[:].set_visible(False)


def _draw_changes(axis: Any, result: Robustness, rows: Sequence[str], metric: str) -> None:
    """The cells of one heat map."""
    scale = display_factor(describe(metric)[1])
    sign = -1.0 if metric in MORE_IS_BETTER else 1.0
    changes = [[result.changes[name][policy][metric] for policy in result.policies] for name in rows]
    known = np.array([[bool(verdict(metric, one)) for one in row] for row in changes])
    means = scale * np.array([[one.mean for one in row] for row in changes])
    most = float(np.nanmax(np.abs(np.where(known, means, 0.0)))) or 1.0
    axis.imshow(np.where(known, sign * means, 0.0), cmap="RdBu_r", vmin=-1.4 * most, vmax=1.4 * most, aspect="auto")
    digits = max(0, 2 - math.floor(math.log10(most)) - 1)
    for (row, column), mean in np.ndenumerate(means):
        text = "-" if math.isnan(mean) else "0" if mean == 0.0 else f"{mean:+.{digits}f}"
        colour = "black" if known[row, column] else "#999999"
        axis.text(column, row, text, ha="center", va="center", fontsize=7.5, color=colour)
