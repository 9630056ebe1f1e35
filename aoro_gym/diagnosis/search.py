"""The best fit of one hypothesis with the twin itself, in its nuisances and in the magnitudes of its effects.

It begins with slopes that all hypotheses share, and takes its own in the directions that matter most: what a parameter does
depends on what else is wrong.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import lsq_linear

from aoro_gym.diagnosis.axes import PRIOR_INFORMATION, volume
from aoro_gym.diagnosis.linear import Hypothesis, Linear, Tangent
from aoro_gym.diagnosis.noise import Floats
from aoro_gym.diagnosis.problem import STEP, STRAIGHT, Problem, Progress
from aoro_gym.diagnosis.replay import Variants

SETTLED = 0.5
"""Change of the whitened squares by which a search ends."""
SETTLE = 4
"""Steps of a stage of the fit of nuisances alone."""
LENGTHS = (0.5, 0.2)
"""Shorter steps that are tried along with a whole one."""
AXIS_STEP = 0.01
"""Finite-difference step of places."""
SHORTENED = 0.3
"""Share of a step along a direction that must be left within the ranges."""
ALL = 10_000
"""Directions: all that there are."""


class Search:
    """Gauss–Newton steps of one hypothesis: nuisances u (standard deviations) and places z of its axes.

    Args:
        linear: Of the hypothesis's problem.
        effects: Of the hypothesis.
        places: To begin with.
        leader: Hypothesis of fewer effects to begin at; by default the centre of the problem.
        directions: Along which slopes are taken in every round: those of the nuisances in which the prediction moves most.
            Along the others it keeps those that it began with.
    """

    def __init__(
        self,
        linear: Linear,
        effects: tuple[str, ...],
        places: tuple[float, ...],
        leader: Hypothesis | None = None,
        directions: int = 0,
    ):
        self.linear = linear
        self.effects = effects
        self.directions = directions
        z = np.array(places, dtype=np.float64)
        if leader is None or leader.tangent is None:
            self.tangent, start = linear.tangent, linear.problem.centre
            left = linear.residual - sum(linear.shift(effects, z), np.zeros(len(linear.residual)))
        else:
            self.tangent, start = leader.tangent, leader.nuisances
            left = leader.left + self.tangent.jacobian @ start
            column = 0
            for name in effects:
                count = len(linear.problem.axes[name])
                if name not in leader.effects:
                    left = left - sum(linear.shift((name,), z[column : column + count]))
                column += count
        self.nuisances: Floats = self.tangent.best(left)
        self.places: Floats = z
        self.point = start, z
        """Best nuisances and places so far."""
        self.cost = np.inf
        self.residual: Floats = left
        """Whitened (D,), at ``point``."""
        self.slopes: Floats = np.empty((len(left), 0))
        """Whitened (D, axes), there."""
        self.reach = 1.0
        self.done = False
        self._learned = -1  # directions of the slopes that were taken at ``point``
        self._failed = False

    def variants(self) -> Variants:
        """The machine to be tried next, its neighbours along every axis and along :attr:`directions` of its nuisances, and
        machines on the way there."""
        if self._failed and self._learned < self.directions:
            # no step from here has led anywhere: what is so right here?
            self.nuisances, self.places = self.point
        u, z = self.nuisances, self.places
        lengths = np.array(LENGTHS if np.isfinite(self.cost) else (*LENGTHS, 0.0))[:, None]
        (a, b), self._steps = self.point, np.where(z < 0.5, AXIS_STEP, -AXIS_STEP)
        on_the_way = a + lengths * (u - a), b + lengths * (z - b)
        self._tried = [(u, z), *zip(*on_the_way, strict=True)]
        self._moves = self._around(u)
        points = np.vstack([np.tile(u, (1 + len(z), 1)), u + self._moves, on_the_way[0]])
        places = np.vstack([z[None], z + np.diag(self._steps), np.tile(z, (len(self._moves), 1)), on_the_way[1]])
        return self.linear.problem.at(points, self.effects, places)

    def _around(self, u: Floats) -> Floats:
        """Steps (k, u) along which slopes are taken."""
        problem = self.linear.problem
        felt = len(problem.felt)
        if self.directions >= felt:
            sizes = np.linalg.norm(self.tangent.jacobian[:, :felt], axis=0)
            return problem.neighbours(u, sizes)[0] - u
        along, sizes = self.tangent.directions(felt, self.directions)
        steps = along * np.minimum(STEP, STRAIGHT / sizes)[:, None]
        low, high = self.tangent.bounds
        forward, backward = (np.clip(u + sign * steps, low, high) - u for sign in (1.0, -1.0))
        kept = [np.linalg.norm(moved, axis=1) for moved in (forward, backward)]
        moves = np.where((kept[0] >= kept[1])[:, None], forward, backward)
        return moves[np.maximum(*kept) > SHORTENED * np.linalg.norm(steps, axis=1)]

    def learn(self, found: Floats) -> None:
        """Take in what was simulated (D, N), and choose the next point."""
        problem, linear = self.linear.problem, self.linear
        felt, axes, moves = len(problem.felt), len(self.places), len(self._moves)
        base, around, on_the_way = np.split(found, [1, 1 + axes + moves], axis=1)
        if np.all(np.isfinite(base)) and np.all(np.isfinite(around[:, :axes])):
            measured = problem.measured[:, None]
            plain = np.concatenate([measured - base, measured - on_the_way, around - base], axis=1)
            white = problem.white(linear.whiteners, np.nan_to_num(plain))
            tried = len(self._tried)
            lefts = [white[:, k] - linear.own @ u[felt:] for k, (u, _) in enumerate(self._tried)]
            costs = np.array([self._cost(left, u) for left, (u, _) in zip(lefts, self._tried, strict=True)])
            costs[np.flatnonzero(np.any(np.isnan(on_the_way), axis=0)) + 1] = np.inf
            best = int(np.argmin(costs))
            here = self.point[0] is self.nuisances
            first = not np.isfinite(self.cost)
            self.done = not here and abs(costs[best] - self.cost) < SETTLED
            if here or first or (best == 0 and costs[0] < self.cost):
                self.slopes = white[:, tried : tried + axes] / self._steps
                known = np.all(np.isfinite(around[:, axes:]), axis=0)
                if np.any(known):
                    self.tangent = self.tangent.updated(self._moves[known], white[:, tried + axes :][:, known])
            self._failed = not here and costs[best] >= self.cost
            if here:
                self.reach, self._learned = 1.0, self.directions
            elif self._failed:
                self.reach *= 0.4
            else:
                self.point, self.cost, self.residual = self._tried[best], float(costs[best]), lefts[best]
                self.reach = min(1.0, 2.0 * self.reach)
                self._learned = self.directions if best == 0 else -1
        else:
            self._failed = True
            self.reach *= 0.3
        if np.isfinite(self.cost):
            gain = self._step()
            self.done |= self._learned >= self.directions and gain < SETTLED

    def _cost(self, left: Floats, nuisances: Floats) -> float:
        return float(left @ left + nuisances @ self.tangent.precision @ nuisances)

    def _step(self) -> float:
        """To the least cost of the linear model within the ranges of the places; what that should gain."""
        tangent = self.tangent
        u, z = self.point
        target = self.residual + tangent.jacobian @ u  # what nuisances and places have to explain
        to = z
        if z.size:
            information = tangent.projected(self.slopes, self.slopes)
            pull = tangent.projected(self.slopes, target)
            factor = np.linalg.cholesky(information + 1e-6 * np.eye(len(z)))
            within = -z - 1e-9, 1.0 - z + 1e-9
            to = z + lsq_linear(factor.T, solve_triangular(factor, pull, lower=True), within).x
            to = np.clip(to, 0.0, 1.0)
        best = tangent.best(target - self.slopes @ (to - z))
        self.nuisances = u + self.reach * (best - u)
        self.places = z + self.reach * (to - z)
        left = target - tangent.jacobian @ self.nuisances - self.slopes @ (self.places - z)
        return self.cost - self._cost(left, self.nuisances)

    def weighed(self) -> Hypothesis:
        """With Laplace's evidence: nuisances are integrated out, places count by their share of their range."""
        tangent = self.tangent
        u, z = self.point
        log_evidence = -0.5 * self.cost + tangent.shrunk - self.linear.log_volume
        covariance = np.empty((0, 0))
        if z.size:
            information = tangent.projected(self.slopes, self.slopes)
            pull = tangent.projected(self.slopes, self.residual + tangent.jacobian @ u)
            held = np.where(z <= 0.0, np.minimum(pull, 0.0), np.where(z >= 1.0, np.maximum(pull, 0.0), 0.0))
            log_evidence += volume(z.tolist(), information, held)
            covariance = np.linalg.inv(information + PRIOR_INFORMATION * np.eye(len(z)))
        places = tuple(map(float, z))
        return Hypothesis(
            self.effects, log_evidence, places, u, covariance, self.cost, self.residual, self.slopes, tangent, True
        )


def refine(searches: Sequence[Search], rounds: int, progress: Progress = lambda sentence, share: None) -> None:
    """Take every search, of problems with the same recordings, as far as so many rounds do, all in the same launches."""
    for search in searches:
        search.done = False
    for step in range(rounds):
        active = [search for search in searches if not search.done]
        if not active:
            break
        progress("refining", step / rounds)
        batch = [search.variants() for search in active]
        found = active[0].linear.problem.simulate(batch)
        ends = np.cumsum([one.count for one in batch])
        for search, mine in zip(active, np.split(found, ends[:-1], axis=1), strict=True):
            search.learn(mine)


def from_a_part(linear: Linear, pair: Search, searches: Mapping[tuple[str, ...], Search]) -> Search | None:
    """Two effects fit no worse than either of them alone: where they do, a search that begins at the better one's fit."""
    part = min((searches[name,] for name in pair.effects), key=lambda one: one.cost)
    if part.cost >= pair.cost:
        return None
    places: list[float] = []
    for name in pair.effects:
        places += part.point[1].tolist() if name in part.effects else [axis.none for axis in linear.problem.axes[name]]
    return Search(linear, pair.effects, tuple(places), part.weighed(), pair.directions)


def settle(problem: Problem, stages: int, progress: Progress = lambda sentence, share: None) -> Tangent:
    """Move a problem to the best fit of its nuisances alone, and hold all hypotheses to the error of that twin.

    Args:
        problem: Need not be learned.
        stages: How often the error is taken anew around what was found.
        progress: Called with a sentence and the share done.

    Returns:
        The tangent there.
    """
    tangent = None
    for stage in range(stages):
        progress("fitting uncertain parameters", stage / stages)
        problem.learn(effects=False)
        search = Search(Linear(problem, problem.error), (), (), directions=ALL)
        refine([search], SETTLE)
        problem.hold_to(search.point[0])
        tangent = search.tangent
    assert tangent is not None
    return tangent
