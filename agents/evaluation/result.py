"""The result of an evaluation: intervals, ranking and differences of policies."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from aoro_gym.agents.evaluation.episodes import Episodes
from aoro_gym.agents.evaluation.metrics import OVER, RATES, ranked
from aoro_gym.agents.evaluation.statistics import (
    Floats,
    Interval,
    interquartile_mean,
    interval,
    plain,
    stratified_interval,
)
from aoro_gym.agents.evaluation.tasks import TASKS, EvaluationTask
from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.machine import Machine


@dataclass(frozen=True)
class Evaluation:
    """Episodes of several policies."""

    env: str
    episodes: int
    seed: int
    courses: tuple[Course, ...]
    """Where was driven; none where the task is no drive."""
    runs: Mapping[str, Episodes]
    """By policy; all episodes, then all of them once more for each further repeat."""
    machine: Machine
    control_step: float
    """[s]"""
    scene: Callable[[], Any]
    """Makes what draws ``Episodes.film``."""
    repeats: int = 1
    """How often each episode was driven."""

    def __repr__(self) -> str:
        return f"Evaluation({self.env!r}, {self.episodes} episodes each of {', '.join(self.runs)})"

    @property
    def task(self) -> EvaluationTask:
        return TASKS[self.env]

    @cached_property
    def summary(self) -> dict[str, dict[str, Interval]]:
        """Every metric by policy and name."""
        return {
            policy: {
                name: interval(run.metrics[name], rate=True) if name in RATES else self.of(run, name)
                for name in run.metrics
            }
            for policy, run in self.runs.items()
        }

    @cached_property
    def ranking(self) -> list[str]:
        """Policies from the best to the worst: by success, then by the first decisive metric."""
        return ranked(self.summary, self.task.decisive[0])

    def of(self, run: Episodes, name: str, statistic: Callable[..., Any] = np.nanmean) -> Interval:
        """A metric of ``run``, over the episodes that have it."""
        found = self.over_episodes(run.metrics[name], statistic)
        return found._replace(bounds=int(run.bounded(name).sum()))

    def over_episodes(self, values: Floats, statistic: Callable[..., Any] = np.nanmean) -> Interval:
        """Of a metric (repeats * episodes,), as other episodes might have been driven: each resampled with its repeats."""
        return interval(values.reshape(self.repeats, self.episodes).T, statistic=statistic)

    def over_repeats(self, values: Floats, statistic: Callable[..., Any] = np.mean) -> Interval:
        """The same, as these episodes might have been driven with other noise and on other machines."""
        return stratified_interval(values, np.tile(np.arange(self.episodes), self.repeats), statistic=statistic)

    @cached_property
    def interquartile(self) -> dict[str, dict[str, Interval]]:
        """The same for the mean of the middle half of the episodes; not of rates, of which it would be 0 or 1."""
        return {
            policy: {name: self.of(run, name, interquartile_mean) for name in run.metrics if name not in RATES}
            for policy, run in self.runs.items()
        }

    @cached_property
    def stratified(self) -> dict[str, dict[str, Interval]]:
        """The mean of the middle half of all that was driven, with its interval over repeats of these episodes: decisive
        metrics by policy and name; empty where each episode was driven once."""
        if self.repeats == 1:
            return {}
        return {
            policy: {
                name: self.over_repeats(run.metrics[name], interquartile_mean)._replace(
                    bounds=int(run.bounded(name).sum())
                )
                for name in self.task.decisive
            }
            for policy, run in self.runs.items()
        }

    @cached_property
    def endings(self) -> dict[str, dict[str, Interval]]:
        """Share of episodes by policy and ending, the most frequent ending first."""
        known = [ending for ending, _ in Counter(e for run in self.runs.values() for e in run.endings).most_common()]
        return {
            policy: {
                ending: interval(np.array([ended == ending for ended in run.endings], dtype=np.float64), rate=True)
                for ending in known
            }
            for policy, run in self.runs.items()
        }

    @cached_property
    def differences(self) -> dict[str, dict[str, Interval]]:
        """Every metric of the other policies less that of the first one, episode by episode, over those in which both have
        it: what they share cancels."""
        first, *others = self.runs
        return {policy: self.less(policy, first, tuple(self.runs[policy].metrics)) for policy in others}

    def less(self, policy: str, other: str, names: Sequence[str]) -> dict[str, Interval]:
        """Metrics of ``policy`` less those of ``other``, likewise."""
        one, two = self.runs[policy], self.runs[other]
        return {name: self.over_episodes(one.exact(name) - two.exact(name)) for name in names}

    @property
    def asked(self) -> dict[str, Any]:
        """What was driven, as JSON."""
        return {
            "env": self.env,
            "episodes": self.episodes,
            "repeats": self.repeats,
            "seed": self.seed,
            "machine": self.machine.name,
            "courses": [course.name for course in self.courses],
        }

    def to_json(self) -> dict[str, Any]:
        """Content of ``evaluation.json``; None where an interval says nothing."""
        return self.asked | {
            "ranking": self.ranking,
            "over": {name: what for name, what in OVER.items() if name in next(iter(self.runs.values())).metrics},
            "policies": plain(self.summary),
            "interquartile_means": plain(self.interquartile),
            "stratified_interquartile_means": plain(self.stratified),
            "endings": plain(self.endings),
            "differences": {"from": next(iter(self.runs)), "policies": plain(self.differences)},
        }
