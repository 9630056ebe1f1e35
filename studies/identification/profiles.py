"""Profiles of parameters: how well the figures can be met with a parameter held, the others fitted anew.

The cost of a profile has the misses of the figures and the pull of all *other* parameters to the data sheet, so it says
what the figures know of the parameter, and not what its range does. A rise by 3.84 bounds a 95 % interval (Wilks).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from aoro_gym.calibration.fit import inward_steps, sound
from studies.identification.bench import Bench, Model
from studies.identification.search import PULL, Job, search
from studies.identification.splits import Split

PROFILED = (("default", "mevea-nothing"), ("materials", "physical-nothing"))
"""Structures and fits that are profiled."""
GRID = (0.02, 0.26, 0.5, 0.74, 0.98)
"""Values of a profile, shares of the parameter's range."""
STEPS = 2
"""Gauss–Newton steps at each of them."""
RISE = float(chi2.ppf(0.95, 1))

Floats = NDArray[np.float64]


def profile(
    model: Model,
    split: Split,
    best: Floats,
    bench: Bench,
    *,
    kept: dict[str, Any] | None = None,
    steps: int = STEPS,
    until: float = np.inf,
    executor: Executor | None = None,
    say: Callable[[str], None] = lambda text: None,
    keep: Callable[[dict[str, Any]], None] = lambda found: None,
) -> dict[str, Any]:
    """Costs (grid,) of every parameter held at every value of :data:`GRID`, those that the figures determine most first.

    Each search begins where the posterior around the fit has its other parameters, to first order.

    Args:
        model: The structure.
        split: What is fitted.
        best: Point (d,) of the fit.
        bench: Where machines turn.
        kept: What an earlier call found; its parameters are not searched again.
        steps: Gauss–Newton steps at each value.
        until: Monotonic time [s] by which the last step is to end; parameters that have not come by then are left out.
        executor: Solves the steps in its workers.
        say: Told how far it is.
        keep: Given what is found whenever there is more.
    """
    evaluate = bench.evaluate({split.name: split})
    ahead = inward_steps(best)
    around = np.vstack([best, best + np.diag(ahead)])
    rows = sound(evaluate([(Job(model.name, split.name, 0, best.tolist()), around)])[0])
    jacobian = (rows[:, 1:] - rows[:, :1]) / ahead
    covariance = np.asarray(np.linalg.inv(jacobian.T @ jacobian + PULL**2 * np.eye(len(best))), dtype=np.float64)
    free = np.sum(np.square(rows[:, 0])) + np.sum(np.square(PULL * (best - model.prior)))
    shrunk = PULL * np.sqrt(np.diag(covariance))
    keys, costs = model.space.keys, dict((kept or {}).get("costs", {}))
    found = {"grid": list(GRID), "cost_of_the_fit": float(f"{free:.5g}"), "costs": costs,
             "std_of_prior": {key: float(f"{std:.4g}") for key, std in zip(keys, shrunk, strict=True)}}  # fmt: skip
    left = [int(k) for k in np.argsort(shrunk, kind="stable") if keys[k] not in costs]
    together = max(1, bench.batch // (len(GRID) * (len(best) + 1)))
    for number in range(0, len(left), together):
        some = left[number : number + together]
        jobs = [_held(model, split, best, covariance, k, value) for k in some for value in GRID]
        say(f"{len(left) - number} of {len(keys)} parameters to profile; now {', '.join(keys[k] for k in some)}")
        search(jobs, [model.prior] * len(jobs), evaluate, iterations=steps, until=until, executor=executor, say=say)
        rises = np.array([job.cost for job in jobs]).reshape(len(some), len(GRID))
        if not np.all(np.isfinite(rises)):
            break
        costs |= {keys[k]: [float(f"{cost:.5g}") for cost in row] for k, row in zip(some, rises, strict=True)}
        keep(found)
        if time.monotonic() > until:
            break
    return found


def _held(model: Model, split: Split, best: Floats, covariance: Floats, k: int, value: float) -> Job:
    """A search with parameter ``k`` held at ``value``."""
    point = np.clip(best + covariance[:, k] / covariance[k, k] * (value - best[k]), 0.01, 0.99)
    point[k] = value
    return Job(model.name, split.name, 0, point.tolist(), held=k)


def left_open(costs: Floats, grid: Floats) -> tuple[float, float]:
    """Ends of what a profile (grid,) leaves of the range, shares of it: where straight lines between its values rise by
    :data:`RISE` over the lowest one."""
    rise = costs - np.min(costs) - RISE
    lowest = int(np.argmin(costs))
    low, high = 0.0, 1.0
    for i in range(lowest, 0, -1):
        if rise[i - 1] > 0.0:
            low = grid[i] - (grid[i] - grid[i - 1]) * rise[i] / (rise[i] - rise[i - 1])
            break
    for i in range(lowest, len(grid) - 1):
        if rise[i + 1] > 0.0:
            high = grid[i] + (grid[i + 1] - grid[i]) * rise[i] / (rise[i] - rise[i + 1])
            break
    return float(low), float(high)
