"""Which effect: the evidence for nothing, for each effect, each pair, other calibration, and what the catalogue lacks.

All hypotheses see the same recordings, the same error of the twin and the same nuisances, whose prior is normal. Around the
centre of a :class:`~aoro_gym.diagnosis.problem.Problem` nuisances are linear and are integrated out in closed form: with
A = I + J Jᵀ a hypothesis that shifts the prediction by s has

    −2 ln p(y | s) = (r₀ − s)ᵀ A⁻¹ (r₀ − s) + ln |A| + const.

Every effect's shift s is simulated at a few magnitudes and interpolated between them; shifts of a pair add up. So all
singles and all pairs follow from one Gram matrix. Those that have a chance, nothing among them, are then refined with the
twin itself (Gauss–Newton in nuisances and magnitudes) until none that was not refined could still win, and are weighed by
Laplace's method. Other calibration is nothing with wider priors. *Unknown* is a gap of the size that is seen, of any shape:
an error of the twin (:mod:`.noise`) as large as the gap itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import lsq_linear
from scipy.special import logsumexp
from scipy.stats import chi2

from aoro_gym.diagnosis.axes import PRIOR_INFORMATION, Shift, volume
from aoro_gym.diagnosis.noise import Floats, ModelError
from aoro_gym.diagnosis.problem import Problem, Progress
from aoro_gym.diagnosis.replay import Variants
from aoro_gym.diagnosis.result import CALIBRATION, UNKNOWN

PARTNERS = 12
"""Effects, the likeliest, of which one at least is in every pair that is screened."""
CHANCE = 12.0
"""Log odds behind the best beyond which a hypothesis is not refined."""
MOST = 12
"""Hypotheses that are refined at once."""
WAVES = 3
"""Times that hypotheses are chosen to be refined."""
ROUNDS = 3
"""Gauss–Newton steps of every refinement."""
SETTLED = 0.5
"""Change of the whitened squares by which a refinement ends."""
SURPRISES = (0.3, 0.6, 1.2)
"""Sizes of an unknown cause, as shares of the gap that is seen."""
WIDER = (2.0, 4.0, 8.0)
"""Multiples of the priors' widths under which other calibration is weighed."""

PRIOR = {"nothing": 0.40, "single": 0.35, "pair": 0.10, UNKNOWN: 0.10, CALIBRATION: 0.05}
"""Prior probabilities of the kinds of hypotheses; within a kind all are equally likely."""


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects and how it fares."""

    effects: tuple[str, ...]
    log_evidence: float  # of the recordings, up to a constant common to all
    places: tuple[float, ...] = ()  # of every axis, at the best fit
    nuisances: Floats = field(default_factory=lambda: np.empty(0))  # (u,) standard deviations
    covariance: Floats = field(default_factory=lambda: np.empty((0, 0)))  # of the places
    cost: float = np.nan  # whitened squares at the best fit, priors included
    refined: bool = False
    probability: float = 0.0


class Linear:
    """A learned problem, whitened under one error of the twin and compressed: r(u, z) = r₀ − J u − S φ(z), as seen in the
    span of r₀, J and S."""

    def __init__(self, problem: Problem, error: ModelError, effects: bool = True):
        self.problem = problem
        self.whiteners = problem.whiteners(error, problem.predicted)
        self.log_volume = sum(float(np.sum(np.log(np.diag(w.factor)))) for w in self.whiteners)
        felt = len(problem.felt)
        own = problem.own(problem.predicted)
        residual = problem.measured - problem.predicted + problem.slopes @ problem.centre[:felt]
        shifts = list(problem.shifts.values()) if effects else []
        plain = np.concatenate([residual[:, None], problem.slopes, own, *shifts], axis=1)
        white = problem.white(self.whiteners, plain)
        self.own = white[:, 1 + felt : 1 + felt + own.shape[1]]
        """Whitened shifts (D, c) of the recordings' own nuisances."""
        self.span, small = np.linalg.qr(white)
        """Orthonormal basis (D, n) of all that the model can do."""
        u = felt + own.shape[1]
        self.residual = small[:, 0]
        self.jacobian = small[:, 1 : 1 + u]
        starts = np.cumsum([1 + u, *(part.shape[1] for part in shifts)])
        keys = problem.shifts if effects else ()
        self.shifts = {key: small[:, a:b] for key, a, b in zip(keys, starts[:-1], starts[1:], strict=True)}

        self._inner = cho_factor(np.eye(u) + self.jacobian.T @ self.jacobian)
        self.constant = -float(np.sum(np.log(np.diag(self._inner[0])))) - self.log_volume
        """Of every log evidence: −½ ln |A| and the volume of the noise."""

    @property
    def samples(self) -> int:
        return len(self.span)

    def projected(self, columns: Floats, against: Floats) -> Floats:
        """columnsᵀ A⁻¹ against."""
        return columns.T @ against - (self.jacobian.T @ columns).T @ cho_solve(self._inner, self.jacobian.T @ against)

    def best_nuisances(self, residual: Floats) -> Floats:
        """Nuisances (u,) that explain a ``residual`` in the span best, priors included."""
        return cho_solve(self._inner, self.jacobian.T @ residual)

    def evidence(self, wider: float = 1.0) -> float:
        """Log evidence of the nuisances alone, their machine's priors ``wider`` by a factor, with all constants that
        depend on the error of the twin."""
        jacobian = self.jacobian.copy()
        jacobian[:, : len(self.problem.felt)] *= wider
        inner = np.eye(jacobian.shape[1]) + jacobian.T @ jacobian
        pull = jacobian.T @ self.residual
        fit = self.residual @ self.residual - pull @ np.linalg.solve(inner, pull)
        return float(-0.5 * fit - 0.5 * np.linalg.slogdet(inner)[1] - self.log_volume)

    def shift(self, effects: Sequence[str], places: Floats, derivative: int = 0) -> list[Floats]:
        """Shift of every axis of ``effects`` at its place, or its derivative by it."""
        axes = [(name, axis) for name in effects for axis in self.problem.axes[name]]
        return [
            self.shifts[name, axis.index] @ axis.spline(z, derivative)
            for (name, axis), z in zip(axes, places, strict=True)
        ]

    def screen(self) -> dict[tuple[str, ...], Hypothesis]:
        """Nothing, every effect, and every pair with one of the :data:`PARTNERS` likeliest."""
        axes = self.problem.axes
        flat = [(name, axis) for name in axes for axis in axes[name]]
        everything = np.concatenate([self.residual[:, None], *(self.shifts[n, a.index] for n, a in flat)], axis=1)
        gram = self.projected(everything, everything)
        starts = np.cumsum([1, *(len(axis.nodes) for _, axis in flat)])
        where = {name: [i for i, (n, _) in enumerate(flat) if n == name] for name in axes}
        nothing = float(gram[0, 0])
        base = self.evidence()

        def weigh(effects: tuple[str, ...], first: tuple[float, ...] | None) -> Hypothesis:
            mine = [i for name in effects for i in where[name]]
            columns = np.concatenate([np.arange(starts[i], starts[i + 1]) for i in mine])
            part = Shift([flat[i][1] for i in mine], gram[np.ix_(columns, columns)], gram[columns, 0])
            cost, places, information = part.descend(part.grid() if first is None else first)
            evidence = base - 0.5 * cost + volume(places, information)
            covariance = np.linalg.inv(information + PRIOR_INFORMATION * np.eye(len(places)))
            return Hypothesis(effects, evidence, places, covariance=covariance, cost=nothing + cost)

        found: dict[tuple[str, ...], Hypothesis] = {(): Hypothesis((), base, cost=nothing)}
        for name in axes:
            found[(name,)] = weigh((name,), None)
        likeliest = sorted(axes, key=lambda name: -found[(name,)].log_evidence)[:PARTNERS]
        for pair in combinations(axes, 2):
            if set(pair) & set(likeliest):
                found[pair] = weigh(pair, sum((found[(name,)].places for name in pair), ()))
        return found


class Search:
    """The best fit of one hypothesis with the twin itself: nuisances u (standard deviations) and places z of its axes.

    Gauss–Newton steps with the slopes in u of the linear model, which all hypotheses share, and those in z simulated anew.
    """

    def __init__(self, linear: Linear, effects: tuple[str, ...], places: tuple[float, ...]):
        self.linear = linear
        self.effects = effects
        z = np.array(places, dtype=np.float64)
        left = linear.residual - sum(linear.shift(effects, z), np.zeros(len(linear.residual)))
        self.nuisances: Floats = linear.best_nuisances(left)
        self.places: Floats = z
        self.slopes: Floats = np.column_stack([np.empty((len(left), 0)), *linear.shift(effects, z, 1)])
        self.point = self.nuisances, z
        self.cost = np.inf
        self.residual: Floats = np.empty(0)  # in the span, at ``point``
        self.reach = 1.0
        self.done = False

    def variants(self) -> Variants:
        """The machine to be simulated next, and its neighbours along every axis."""
        z = self.places
        self._steps = np.where(z < 0.5, 0.01, -0.01)
        places = np.vstack([z, z + np.diag(self._steps)]) if z.size else z[None]
        return self.linear.problem.at(np.tile(self.nuisances, (len(places), 1)), self.effects, places)

    def learn(self, found: Floats) -> None:
        """Take in what was simulated (D, 1 + axes), and choose the next point."""
        problem, linear = self.linear.problem, self.linear
        if np.all(np.isfinite(found)):
            plain = np.column_stack([problem.measured - found[:, 0], found[:, 1:] - found[:, :1]])
            white = problem.white(linear.whiteners, plain)
            whole = white[:, 0] - linear.own @ self.nuisances[len(problem.felt) :]
            cost = float(whole @ whole + self.nuisances @ self.nuisances)
            self.done = abs(cost - self.cost) < SETTLED
            if cost < self.cost:
                self.point, self.cost = (self.nuisances, self.places), cost
                self.residual = linear.span.T @ whole
                self.slopes = linear.span.T @ white[:, 1:] / self._steps
                self.reach = min(1.0, 2.0 * self.reach)
            else:
                self.reach *= 0.4
        else:
            self.reach *= 0.3
        if np.isfinite(self.cost):
            self._step()

    def _step(self) -> None:
        """To the least cost of the linear model within the ranges of the places."""
        linear = self.linear
        u, z = self.point
        target = self.residual + linear.jacobian @ u  # what nuisances and places have to explain
        to = z
        if z.size:
            information = linear.projected(self.slopes, self.slopes)
            pull = linear.projected(self.slopes, target)
            factor = np.linalg.cholesky(information + 1e-6 * np.eye(len(z)))
            to = z + lsq_linear(factor.T, np.linalg.solve(factor, pull), (-z - 1e-9, 1.0 - z + 1e-9)).x
            to = np.clip(to, 0.0, 1.0)
        best = linear.best_nuisances(target - self.slopes @ (to - z))
        self.nuisances = u + self.reach * (best - u)
        self.places = z + self.reach * (to - z)

    def weighed(self) -> Hypothesis:
        """With Laplace's evidence: nuisances are integrated out, places count by their share of their range."""
        u, z = self.point
        log_evidence = -0.5 * self.cost + self.linear.constant
        covariance = np.empty((0, 0))
        if z.size:
            information = self.linear.projected(self.slopes, self.slopes)
            log_evidence += volume(z.tolist(), information)
            covariance = np.linalg.inv(information + PRIOR_INFORMATION * np.eye(len(z)))
        return Hypothesis(self.effects, log_evidence, tuple(map(float, z)), u, covariance, self.cost, refined=True)


def refine(
    linear: Linear, candidates: Sequence[Hypothesis], progress: Progress = lambda sentence, share: None
) -> list[Hypothesis]:
    """The best fit of every candidate with the twin itself, with the same effort for each."""
    searches = [Search(linear, h.effects, h.places) for h in candidates]
    for step in range(ROUNDS + 1):
        active = [search for search in searches if not search.done]
        if not active:
            break
        batch = [search.variants() for search in active]
        progress("refining", step / (ROUNDS + 1))
        found = linear.problem.simulate(batch)
        ends = np.cumsum([one.count for one in batch])
        for search, mine in zip(active, np.split(found, ends[:-1], axis=1), strict=True):
            search.learn(mine)
    return [search.weighed() for search in searches if np.isfinite(search.cost)]


def attribute(problem: Problem, progress: Progress = lambda sentence, share: None) -> list[Hypothesis]:
    """All hypotheses of a learned problem with their probabilities, the likeliest first."""
    linear = Linear(problem, problem.error)
    found = linear.screen()
    prior = log_priors(found)
    for wave in range(WAVES):
        best = max(h.log_evidence + prior[h.effects] for h in found.values())
        waiting = [
            h
            for h in found.values()
            if not h.refined and (h.log_evidence + prior[h.effects] > best - CHANCE or not h.effects)
        ]
        waiting.sort(key=lambda h: -(h.log_evidence + prior[h.effects]))
        if not waiting:
            break
        chosen = waiting[:MOST]
        if () in (h.effects for h in waiting[MOST:]):
            chosen.append(found[()])
        for h in refine(linear, chosen, lambda s, share, wave=wave: progress(s, (wave + share) / WAVES)):
            found[h.effects] = h
    return weigh([*found.values(), *others(problem, linear)], prior)


def others(problem: Problem, linear: Linear) -> list[Hypothesis]:
    """Something outside of the catalogue, and other calibration."""
    sizes = [replace(problem.error, change=change) for change in SURPRISES]
    unknown = [Linear(problem, error, effects=False).evidence() for error in sizes]
    wider = [linear.evidence(factor) for factor in WIDER]
    return [
        Hypothesis((UNKNOWN,), float(logsumexp(unknown) - np.log(len(unknown)))),
        Hypothesis((CALIBRATION,), float(logsumexp(wider) - np.log(len(wider)))),
    ]


def weigh(hypotheses: Sequence[Hypothesis], prior: Mapping[tuple[str, ...], float]) -> list[Hypothesis]:
    """``hypotheses`` with their probabilities, the likeliest first."""
    logs = np.array([h.log_evidence + prior[h.effects] for h in hypotheses])
    probabilities = np.exp(logs - logsumexp(logs))
    weighed = [replace(h, probability=float(p)) for h, p in zip(hypotheses, probabilities, strict=True)]
    return sorted(weighed, key=lambda h: -h.probability)


def log_priors(hypotheses: Mapping[tuple[str, ...], Hypothesis]) -> dict[tuple[str, ...], float]:
    """Log prior probability of each."""
    singles = sum(len(h) == 1 for h in hypotheses)
    pairs = sum(len(h) == 2 for h in hypotheses)
    share = [PRIOR["nothing"], PRIOR["single"] / max(singles, 1), PRIOR["pair"] / max(pairs, 1)]
    logs = {h: float(np.log(share[len(h)])) for h in hypotheses}
    return {**logs, (UNKNOWN,): float(np.log(PRIOR[UNKNOWN])), (CALIBRATION,): float(np.log(PRIOR[CALIBRATION]))}


def fit_p(linear: Linear, hypothesis: Hypothesis) -> float:
    """Probability of residuals at least as large as those of a fitted hypothesis, if it holds."""
    return float(np.asarray(chi2.sf(hypothesis.cost, linear.samples - len(hypothesis.places))))
