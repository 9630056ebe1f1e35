"""Bounded nonlinear least squares over a population of twins.

Gauss–Newton steps within the bounds and within a box around the point: each is a linear least-squares problem with
bounds, solved by SciPy (``lsq_linear``: Branch, Coleman, Li, SIAM J. Sci. Comput. 21, 1999). Twins are cheap side by
side: a Jacobian is one launch with a twin a free parameter, and the steps of boxes of all sizes are another, so that no
trust region has to be guessed. From the data-sheet machine this ended at 14.5 on the published figures, where
``least_squares`` had ended at 42.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear
from scipy.stats import qmc

from aoro_gym.calibration.progress import Work
from aoro_gym.calibration.space import PRIOR_STD
from aoro_gym.execution.digest import digest
from aoro_gym.execution.files import read_json, write_text

STEP = 0.02
"""Finite-difference step in the unit cube: large against float32 noise, small against the curvature."""

FAILED = 20.0
"""Residual of a figure that does not exist, for example because a turn never ended."""

Residuals = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Points (N, d) → residuals (R, N) in standard deviations; NaN where there is none."""

Tried = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Points (N, d), the one that steps lead from first, their residuals (R, N) and costs (N,)."""

BOXES = (0.01, 0.03, 0.1, 0.2, 0.4)
"""Half widths, in the unit cube, of the boxes within which a step is tried."""

ENOUGH = 1e-3
"""A step that lowers the cost by less than this share ends a search."""

BATCH = 64
"""Members of the first population that are evaluated, and kept, together."""

USUAL_STEPS = 8
"""Steps that a search usually takes, for the estimate of its end."""


@dataclass(frozen=True)
class Fit:
    """One converged search."""

    point: tuple[float, ...]
    residuals: tuple[float, ...]
    cost: float
    """Sum of squared residuals, priors included."""
    evaluations: int


def sound(residuals: NDArray[np.float64]) -> NDArray[np.float64]:
    """Residuals within ± :data:`FAILED`, also those of a figure that there is not, or of a simulation that diverged."""
    return np.clip(np.where(np.isfinite(residuals), residuals, FAILED), -FAILED, FAILED)


def inward_steps(point: NDArray[np.float64], size: float = STEP) -> NDArray[np.float64]:
    """Finite differences (d,) of a ``size`` at ``point`` (d,), away from the nearer bound."""
    return np.where(point < 0.5, size, -size)


def steps_within(
    boxes: Sequence[float] | NDArray[np.float64],
    slopes: NDArray[np.float64],
    residuals: NDArray[np.float64],
    point: NDArray[np.float64],
    prior: NDArray[np.float64],
    pull: float,
) -> NDArray[np.float64]:
    """The ``point`` and where a Gauss–Newton step within each box leads from it (1 + boxes, d).

    Args:
        boxes: Half widths.
        slopes: Jacobian (R, d) at the point.
        residuals: (R,) there.
        point: (d,)
        prior: (d,) to which the point is pulled.
        pull: One over the prior's standard deviation.
    """
    slopes = np.vstack([slopes, pull * np.eye(len(point))])
    aim = -np.concatenate([residuals, pull * (point - prior)])
    tried = [point]
    for box in boxes:
        ends = np.maximum(-point, -box) - 1e-9, np.minimum(1.0 - point, box) + 1e-9
        tried.append(np.clip(point + lsq_linear(slopes, aim, ends).x, 0.0, 1.0))
    return np.array(tried)


def costs(
    residuals: NDArray[np.float64],
    points: NDArray[np.float64],
    prior: NDArray[np.float64],
    pull: float | NDArray[np.float64],
) -> NDArray[np.float64]:
    """Cost (N,) of sound ``residuals`` (R, N) at ``points`` (N, d) that are pulled to ``prior`` (d,)."""
    return np.sum(np.square(residuals), axis=0) + np.sum(np.square(pull * (points - prior)), axis=1)


def least_squares_fit(
    residuals: Residuals,
    prior: NDArray[np.float64],
    *,
    prior_weight: float,
    starts: int,
    population: int,
    max_iterations: int = 25,
    spread: float = PRIOR_STD,
    seed: int = 0,
    initial: NDArray[np.float64] | None = None,
    problem: str = "",
    checkpoint: Path | None = None,
    work: Work | None = None,
) -> list[Fit]:
    """Fit from several starts, the best first.

    A seeded Sobol population around the prior is evaluated in batches; its best members are refined one by one. Every
    batch and every step is kept in ``checkpoint``: the same search, called again, goes on there and finds the same.

    Args:
        residuals: See :data:`Residuals`.
        prior: Point (d,) that the search is drawn to.
        prior_weight: Weight of the pull to the prior: residuals w (u − u₀)/0.25 are added, where 0.25 is the standard
            deviation that belongs to a range read as 95 %.
        starts: How many members are refined; the prior itself is always one.
        population: Size of the first population.
        max_iterations: Jacobians a start.
        spread: Standard deviation of the population around the prior in the unit cube.
        seed: Seed of the population.
        initial: Point (d,) to refine, in place of a population.
        problem: Digest of what is fitted to what; a checkpoint of another problem is not resumed.
        checkpoint: File (JSON) to resume from and to write to.
        work: Told as parts begin; ``residuals`` count their work themselves.

    Raises:
        ValueError: the checkpoint is damaged.
    """
    signature = digest(
        prior, prior_weight, starts, population, max_iterations, spread, seed, initial, problem, STEP, BOXES, ENOUGH
    )
    search = Search(residuals, prior, prior_weight, max_iterations, Checkpoint(checkpoint, signature), work or Work())
    ranking = search.ranked(starts, population, spread, seed) if initial is None else [initial.tolist()]
    for index in range(starts):
        search.refine(index, ranking[index], f"start {index + 1}", f"start {index + 1} of {starts}")
    return sorted(search.checkpoint.fits, key=lambda fit: fit.cost)


class Checkpoint:
    """Parts of a search that are done, in a file if there is one."""

    def __init__(self, path: Path | None, signature: str):
        self.path, self.signature = path, signature
        self.costs: list[list[float]] = []  # of the batches of the first population
        self.fits: list[Fit] = []
        self.step: dict[str, Any] | None = None  # where the refinement that runs stands
        if path is not None and path.exists():
            self._read(path)

    def _read(self, path: Path) -> None:
        content = read_json(path)
        if content.get("signature") != self.signature:
            return
        try:
            self.costs = [[float(cost) for cost in batch] for batch in content["costs"]]
            self.fits = [
                Fit(
                    tuple(map(float, fit["point"])), tuple(map(float, fit["residuals"])), float(fit["cost"]),
                    int(fit["evaluations"]),
                )
                for fit in content["fits"]
            ]  # fmt: skip
            step = content["step"]
            self.step = step and {
                "iteration": int(step["iteration"]), "evaluations": int(step["evaluations"]),
                "step": float(step["step"]), "point": list(map(float, step["point"])),
                "reach": list(map(float, step["reach"])),
            }  # fmt: skip
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise ValueError(f"{path} is damaged ({type(error).__name__}: {error}); --restart begins anew") from None

    def write(self) -> None:
        if self.path is not None:
            fits = [asdict(fit) for fit in self.fits]
            content = {"signature": self.signature, "costs": self.costs, "fits": fits, "step": self.step}
            write_text(self.path, json.dumps(content))


@dataclass
class Search:
    """One search; see :func:`least_squares_fit`."""

    residuals: Residuals
    prior: NDArray[np.float64]
    prior_weight: float
    max_iterations: int
    checkpoint: Checkpoint
    work: Work
    boxes: Sequence[float] = BOXES
    difference: float = STEP

    def evaluate(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Residuals (R, N) of points (N, d), within ± :data:`FAILED`."""
        return sound(self.residuals(np.atleast_2d(points)))

    def ranked(self, starts: int, population: int, spread: float, seed: int) -> list[list[float]]:
        """The prior and the best others of the first population."""
        dimension = len(self.prior)
        normal = qmc.MultivariateNormalQMC(np.zeros(dimension), rng=np.random.default_rng(seed)).random(population)
        points = np.clip(self.prior + spread * normal, 0.01, 0.99)
        points[0] = np.clip(self.prior, 0.01, 0.99)
        batches = np.array_split(points, max(1, population // BATCH))
        if len(self.checkpoint.costs) < len(batches):
            self.work.begin("population", f"evaluating a population of {population}")
        for batch in batches[len(self.checkpoint.costs) :]:
            self.checkpoint.costs.append(np.sum(np.square(self.evaluate(batch)), axis=0).tolist())
            self.checkpoint.write()
        order = np.argsort(np.concatenate(self.checkpoint.costs))
        order = np.concatenate([[0], order[order != 0]])[: max(starts, 1)]
        return points[order].tolist()

    def refine(self, index: int, start: list[float], phase: str, sentence: str) -> None:
        """Step from ``start`` until steps gain next to nothing, unless this fit, by ``index``, is kept already."""
        if index < len(self.checkpoint.fits):
            return
        at = self.checkpoint.step or {
            "iteration": 0, "evaluations": 0, "step": self.difference, "point": start, "reach": list(self.boxes)
        }  # fmt: skip
        self.work.begin(phase, sentence)
        ends = False
        while not ends:
            self.work.say(f"{sentence}, step {at['iteration'] + 1}")
            data, cost, ends = self.improve(at)
            ends = ends or at["iteration"] >= self.max_iterations
            self.checkpoint.step = at
            if ends:
                fit = Fit(tuple(at["point"]), tuple(map(float, data)), cost, at["evaluations"])
                self.checkpoint.fits.append(fit)
                self.checkpoint.step = None
            self.checkpoint.write()

    def improve(self, at: dict[str, Any]) -> tuple[NDArray[np.float64], float, bool]:
        """Take one step from where ``at`` stands; its residuals and cost, and whether the search has ended."""
        point = np.array(at["point"])
        steps = inward_steps(point, at["step"])
        found = self.evaluate(np.vstack([point, point + np.diag(steps)]))
        slopes = (found[:, 1:] - found[:, :1]) / steps
        tried, found, cost = self.tried(np.array(at["reach"]), slopes, found[:, 0], point)
        best = int(np.argmin(cost))
        at["iteration"] += 1
        at["evaluations"] += len(point) + 1 + len(tried)
        at["point"] = tried[best].tolist()
        has_ended = False
        if cost[best] > (1.0 - ENOUGH) * cost[0]:
            has_ended = at["step"] < self.difference
            # once more, nearer: the figures are not quite smooth
            at["step"], at["reach"] = 0.5 * at["step"], (np.array(at["reach"]) / 3.0).tolist()
        return found[:, best], float(cost[best]), has_ended

    def tried(
        self, reach: NDArray[np.float64], slopes: NDArray[np.float64], residuals: NDArray[np.float64],
        point: NDArray[np.float64],
    ) -> Tried:  # fmt: skip
        """Gauss–Newton within the bounds and a box around the point; boxes of all sizes are tried in one launch.

        Args:
            reach: Half widths of the boxes.
            slopes: Jacobian (R, d) at the point.
            residuals: (R,) there.
            point: (d,)
        """
        pull = self.prior_weight / PRIOR_STD
        points = steps_within(reach, slopes, residuals, point, self.prior, pull)
        found = self.evaluate(points)
        return points, found, costs(found, points, self.prior, pull)
