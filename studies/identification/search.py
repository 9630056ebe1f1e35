"""Bounded Gauss–Newton searches of many fits side by side: a launch has the Jacobians of all of them.

Each search is that of :mod:`aoro_gym.calibration.fit`, whose steps and boxes it has: a step is a linear least-squares
problem with bounds, and boxes of all sizes are tried.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from aoro_gym.calibration.fit import BOXES, ENOUGH, STEP, costs, inward_steps, sound

PULL = 4.0
"""Pull to the data sheet: a range is read as 95 %, so its standard deviation is a quarter of the unit cube."""

Floats = NDArray[np.float64]


@dataclass
class Job:
    """One search; a parameter may be held (``held``), which is not pulled then."""

    structure: str
    split: str
    seed: int
    point: list[float]
    held: int | None = None
    reach: float = 1.0
    step: float = STEP
    iteration: int = 0
    evaluations: int = 0
    cost: float = np.inf
    ended: bool = False
    history: list[float] = field(default_factory=list)

    def to_json(self) -> dict[str, Any]:
        """For a file."""
        return asdict(self)


Evaluate = Callable[[Sequence[tuple[Job, Floats]]], Sequence[Floats]]
"""Jobs with points (N, d) each → residuals (R, N) each, NaN where there is none."""


def pulls(job: Job, dimension: int) -> Floats:
    """Pull (d,) of each parameter to the data sheet."""
    pull = np.full(dimension, PULL)
    if job.held is not None:
        pull[job.held] = 0.0
    return pull


def tried(slopes: Floats, aim: Floats, point: Floats, reach: float, held: int | None) -> Floats:
    """The point and one within each box (1 + boxes, d)."""
    points = [point]
    for box in BOXES:
        low, high = np.maximum(-point, -box * reach) - 1e-9, np.minimum(1.0 - point, box * reach) + 1e-9
        if held is not None:
            low[held], high[held] = -1e-12, 1e-12
        step = lsq_linear(slopes, aim, (low, high), method="bvls").x
        moved = np.clip(point + step, 0.0, 1.0)
        if held is not None:
            moved[held] = point[held]
        points.append(moved)
    return np.array(points)


def improve(
    jobs: Sequence[Job], priors: Sequence[Floats], evaluate: Evaluate, executor: Executor | None = None
) -> None:
    """One Gauss–Newton step of every job that has not ended.

    Args:
        jobs: Searches; changed in place.
        priors: Point (d,) that each is drawn to.
        evaluate: See :data:`Evaluate`.
        executor: Solves the steps in its workers.
    """
    running = [(job, prior) for job, prior in zip(jobs, priors, strict=True) if not job.ended]
    asked = []
    for job, _ in running:
        point = np.array(job.point)
        asked.append((job, np.vstack([point, point + np.diag(inward_steps(point, job.step))])))
    problems = []
    for (job, prior), found in zip(running, map(sound, evaluate(asked)), strict=True):
        point, pull = np.array(job.point), pulls(job, len(prior))
        slopes = np.vstack([(found[:, 1:] - found[:, :1]) / inward_steps(point, job.step), np.diag(pull)])
        aim = -np.concatenate([found[:, 0], pull * (point - prior)])
        problems.append((slopes, aim, point, job.reach, job.held))
    solve = map if executor is None else executor.map
    points = list(solve(tried, *zip(*problems, strict=True))) if problems else []
    found = evaluate([(job, one) for (job, _), one in zip(running, points, strict=True)])
    for (job, prior), one, rows in zip(running, points, found, strict=True):
        _take(job, one, costs(sound(rows), one, prior, pulls(job, len(prior))), len(prior))


def _take(job: Job, points: Floats, cost: Floats, dimension: int) -> None:
    """Go to the best of the points tried; where none is better, nearer ones are tried next, and then it ends."""
    best = int(np.argmin(cost))
    job.iteration += 1
    job.evaluations += dimension + 1 + len(points)
    job.point, job.cost = points[best].tolist(), float(cost[best])
    job.history.append(float(f"{job.cost:.5g}"))
    if cost[best] > (1.0 - ENOUGH) * cost[0]:
        job.ended = job.step < STEP
        job.step, job.reach = 0.5 * job.step, job.reach / 3.0


def search(
    jobs: Sequence[Job],
    priors: Sequence[Floats],
    evaluate: Evaluate,
    *,
    iterations: int,
    until: float = np.inf,
    executor: Executor | None = None,
    keep: Callable[[], None] = lambda: None,
    say: Callable[[str], None] = lambda text: None,
) -> None:
    """Steps of all jobs until they have ended, have taken ``iterations``, or the time is over.

    Args:
        jobs: Searches; changed in place.
        priors: Point (d,) that each is drawn to.
        evaluate: See :data:`Evaluate`.
        iterations: Steps of a job, at most.
        until: Monotonic time [s] by which the last step is to end.
        executor: Solves the steps in its workers.
        keep: Called after every step of all.
        say: Told how far they are.
    """
    longest = 0.0
    while any(not job.ended and job.iteration < iterations for job in jobs):
        began = time.monotonic()
        if began + longest > until:
            say("the time is over; searches are not at their end")
            return
        chosen = [(job, prior) for job, prior in zip(jobs, priors, strict=True) if job.iteration < iterations]
        improve([job for job, _ in chosen], [prior for _, prior in chosen], evaluate, executor)
        keep()
        longest = max(longest, time.monotonic() - began)
        going = [job for job in jobs if not job.ended]
        say(
            f"{len(going)} of {len(jobs)} searches go on, median cost {np.median([job.cost for job in jobs]):.3g}, "
            f"{time.monotonic() - began:.1f} s a step"
        )
