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
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import lsq_linear
from scipy.special import logsumexp
from scipy.stats import chi2

from aoro_gym.diagnosis.axes import PRIOR_INFORMATION, Shift, volume
from aoro_gym.diagnosis.noise import Floats, ModelError
from aoro_gym.diagnosis.nuisances import Nuisances
from aoro_gym.diagnosis.problem import Problem, Progress
from aoro_gym.diagnosis.replay import Variants
from aoro_gym.diagnosis.result import CALIBRATION, UNKNOWN

PARTNERS = 12
"""Effects, the likeliest, of which one at least is in every pair that is screened."""
LIKELIEST = 7
"""Hypotheses of one effect, and of two, that are refined in any case."""
CHANCE = 12.0
"""Log odds behind the best beyond which a hypothesis is not refined any more."""
MOST = 10
"""Hypotheses that are refined at once."""
WAVES = 1
"""Times that hypotheses are chosen to be refined."""
ROUNDS = 5
"""Gauss–Newton steps of every refinement."""
SETTLED = 0.5
"""Change of the whitened squares by which a refinement ends."""
DOUBT = 0.005
"""Share of the evidence for a gap that may be wrong for any hypothesis: about what searches leave between two that explain
logs of the twin itself equally well (E)."""
SURPRISES = (0.3, 0.6, 1.2)
"""Sizes of an unknown cause, as shares of the gap that is seen."""
AGAIN = 2
"""Times that a problem is learned anew."""
CONVERGED = 5.0
"""Change of the whitened squares of the best fit below which it is not."""
REFITS = 2
"""Jacobians of the fit of other calibration."""

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
    left: Floats = field(default_factory=lambda: np.empty(0))  # whitened residual (D,) at the best fit
    slopes: Floats = field(default_factory=lambda: np.empty((0, 0)))  # of what explains it (D, axes), by place
    refined: bool = False
    probability: float = 0.0


class Linear:
    """A learned problem, whitened under one error of the twin and compressed: r(u, z) = r₀ − J u − S φ(z), as seen in the
    span of r₀, J and S."""

    def __init__(self, problem: Problem, error: ModelError, effects: bool = True):
        self.problem = problem
        self.whiteners = problem.whiteners(error, problem.given)
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
        self._normal = np.eye(u) + self.jacobian.T @ self.jacobian
        self._inner = cho_factor(self._normal)
        self.constant = -float(np.sum(np.log(np.diag(self._inner[0])))) - self.log_volume
        """Of every log evidence: −½ ln |A| and the volume of the noise."""

    @property
    def samples(self) -> int:
        return len(self.span)

    def projected(self, columns: Floats, against: Floats) -> Floats:
        """columnsᵀ A⁻¹ against."""
        return columns.T @ against - (self.jacobian.T @ columns).T @ cho_solve(self._inner, self.jacobian.T @ against)

    def best_nuisances(self, residual: Floats) -> Floats:
        """Nuisances (u,) within their ranges that explain a ``residual`` in the span best, priors included."""
        low, high = self.problem.bounds
        pull = self.jacobian.T @ residual
        best: Floats = cho_solve(self._inner, pull)
        held = np.zeros(len(best), dtype=bool)
        for _ in range(len(best)):
            beyond = ~held & ((best < low) | (best > high))
            if not np.any(beyond):
                break
            held |= beyond
            best[held] = np.clip(best[held], low[held], high[held])
            free = ~held
            rest = pull[free] - self._normal[np.ix_(free, held)] @ best[held]
            best[free] = np.linalg.solve(self._normal[np.ix_(free, free)], rest)
        return best

    def evidence(self) -> float:
        """Log evidence of the nuisances alone, with all constants that depend on the error of the twin."""
        pull = self.jacobian.T @ self.residual
        fit = self.residual @ self.residual - pull @ cho_solve(self._inner, pull)
        return float(-0.5 * fit + self.constant)

    def shift(self, effects: Sequence[str], places: Floats, derivative: int = 0) -> list[Floats]:
        """Shift of every axis of ``effects`` at its place, or its derivative by it."""
        axes = [(name, axis) for name in effects for axis in self.problem.axes[name]]
        return [
            self.shifts[name, axis.index] @ axis.spline(z, derivative)
            for (name, axis), z in zip(axes, places, strict=True)
        ]

    def without(self, recordings: Sequence[int], hypothesis: Hypothesis) -> tuple[Floats, Floats]:
        """Nuisances and places of a refined ``hypothesis``, fitted to all but some ``recordings`` (their numbers), to first
        order around its best fit."""
        ends = np.cumsum([len(w.factor) for w in self.whiteners])
        pieces = np.split(np.arange(ends[-1]), ends[:-1])
        blocks = zip(self.problem.blocks, pieces, strict=True)
        rows = np.concatenate([piece for (index, _), piece in blocks if index not in recordings])
        span = self.span[rows]
        u, z = hypothesis.nuisances, np.array(hypothesis.places, dtype=np.float64)
        jacobian = span @ self.jacobian
        columns = np.column_stack([jacobian, hypothesis.slopes[rows]])
        target = hypothesis.left[rows] + jacobian @ u
        low, high = self.problem.bounds
        prior = np.eye(len(u), columns.shape[1])
        whole = np.column_stack([np.vstack([columns, prior]), np.concatenate([target, np.zeros(len(u))])])
        small: Any = np.linalg.qr(whole, "r")  # the bounded problem in as many rows as unknowns
        bounds = np.concatenate([low, -z]) - 1e-9, np.concatenate([high, 1.0 - z]) + 1e-9
        found = lsq_linear(small[:, :-1], small[:, -1], bounds).x
        return np.clip(found[: len(u)], low, high), np.clip(z + found[len(u) :], 0.0, 1.0)

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

        def screened(effects: tuple[str, ...], first: tuple[float, ...] | None) -> Hypothesis:
            mine = [i for name in effects for i in where[name]]
            columns = np.concatenate([np.arange(starts[i], starts[i + 1]) for i in mine])
            part = Shift([flat[i][1] for i in mine], gram[np.ix_(columns, columns)], gram[columns, 0])
            cost, places, information = part.descend(part.grid() if first is None else first)
            evidence = base - 0.5 * cost + volume(places, information)
            covariance = np.linalg.inv(information + PRIOR_INFORMATION * np.eye(len(places)))
            return Hypothesis(effects, evidence, places, covariance=covariance, cost=nothing + cost)

        found: dict[tuple[str, ...], Hypothesis] = {(): Hypothesis((), base, cost=nothing)}
        for name in axes:
            found[(name,)] = screened((name,), None)
        likeliest = sorted(axes, key=lambda name: -found[(name,)].log_evidence)[:PARTNERS]
        for pair in combinations(axes, 2):
            if set(pair) & set(likeliest):
                found[pair] = screened(pair, sum((found[(name,)].places for name in pair), ()))
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
        self.white = np.empty(0), np.empty((0, 0))  # residual and slopes there, of all samples
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
                self.white = whole, white[:, 1:] / self._steps
                self.residual, self.slopes = (linear.span.T @ part for part in self.white)
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
            pull = self.linear.projected(self.slopes, self.residual + self.linear.jacobian @ u)
            held = np.where(z <= 0.0, np.minimum(pull, 0.0), np.where(z >= 1.0, np.maximum(pull, 0.0), 0.0))
            log_evidence += volume(z.tolist(), information, held)
            covariance = np.linalg.inv(information + PRIOR_INFORMATION * np.eye(len(z)))
        places = tuple(map(float, z))
        return Hypothesis(self.effects, log_evidence, places, u, covariance, self.cost, *self.white, refined=True)


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


def attribute(problem: Problem, progress: Progress = lambda sentence, share: None) -> tuple[list[Hypothesis], Linear]:
    """All hypotheses of a learned problem with their probabilities, the likeliest first, and the linear model that they
    were found with, around the centre that the problem has then.

    What was learned far from the truth misleads: nuisances as uncertain as the valve's flow act on turns beyond what is
    linear. So all is done again around the nuisances that suit nothing best, and around those that suit the best hypothesis,
    until that changes nothing; every hypothesis counts by the best fit that it ever had.
    """
    found: dict[tuple[str, ...], Hypothesis] = {}
    linear, centre = Linear(problem, problem.error), ()
    for again in range(AGAIN + 1):
        begin, share = again / (AGAIN + 1), 1.0 / (AGAIN + 1)
        new = _searched(linear, WAVES, lambda s, x, begin=begin, share=share: progress(s, begin + share * x))
        last = found.get(centre)
        for effects, h in new.items():
            old = found.get(effects)
            if old is None or not old.refined or (h.refined and h.log_evidence > old.log_evidence):
                found[effects] = h
        best = max((h for h in found.values() if h.refined), key=lambda h: h.log_evidence)
        settled = last is not None and found[centre].cost > last.cost - CONVERGED and best.effects == centre
        if again == AGAIN or settled:
            break
        centre = () if again == 0 else best.effects
        problem.centre = found[centre].nuisances
        problem.learn()
        linear = Linear(problem, problem.error)
    return weigh([*found.values(), unknown(problem), other_calibration(problem, linear)], log_priors(found)), linear


def _searched(linear: Linear, waves: int, progress: Progress) -> dict[tuple[str, ...], Hypothesis]:
    """All hypotheses; nothing and the likeliest of one effect and of two are refined, then all that could still win."""
    found = linear.screen()
    prior = log_priors(found)

    def score(h: Hypothesis) -> float:
        return h.log_evidence + prior[h.effects]

    def kept(refined: Sequence[Hypothesis]) -> None:
        for h in refined:
            if not found[h.effects].refined or h.log_evidence > found[h.effects].log_evidence:
                found[h.effects] = h

    def likeliest(size: int) -> list[Hypothesis]:
        return sorted((h for h in found.values() if len(h.effects) == size), key=score, reverse=True)[:LIKELIEST]

    kept(refine(linear, [found[()], *likeliest(1)], lambda s, x: progress(s, 0.3 * x)))
    pairs = likeliest(2)
    # a pair begins where it was found, and where each of its effects alone is best
    apart = [replace(h, places=sum((found[(name,)].places for name in h.effects), ())) for h in pairs]
    kept(refine(linear, [*pairs, *apart], lambda s, x: progress(s, 0.3 + 0.3 * x)))
    for wave in range(waves):
        best = max(map(score, found.values()))
        waiting = [h for h in found.values() if not h.refined and score(h) > best - CHANCE]
        if not waiting:
            break
        chosen = sorted(waiting, key=score, reverse=True)[:MOST]
        kept(refine(linear, chosen, lambda s, x, wave=wave: progress(s, 0.6 + 0.4 * (wave + x) / waves)))
    return found


def unknown(problem: Problem) -> Hypothesis:
    """Something outside of the catalogue."""
    sizes = [replace(problem.error, change=change) for change in SURPRISES]
    evidence = [Linear(problem, error, effects=False).evidence() for error in sizes]
    return Hypothesis((UNKNOWN,), float(logsumexp(evidence) - np.log(len(evidence))))


def other_calibration(problem: Problem, linear: Linear) -> Hypothesis:
    """No effect, but uncertain parameters elsewhere within their ranges: fitted with wide priors, weighed by Laplace's
    method under the same noise as all."""
    wide = Problem(
        problem.recordings, Nuisances(problem.nuisances.machine, "recalibration"), {}, error=problem.error,
        references=problem.references, noise=problem.noise, simulator=problem.simulator,
    )  # fmt: skip
    wide.settle(REFITS)
    white = wide.white(linear.whiteners, np.column_stack([wide.left, wide.slopes, wide.own(wide.predicted)]))
    residual, jacobian = white[:, 0], white[:, 1:]
    cost = float(residual @ residual + wide.centre @ wide.centre)
    shrunk = float(np.linalg.slogdet(np.eye(jacobian.shape[1]) + jacobian.T @ jacobian)[1])
    return Hypothesis((CALIBRATION,), -0.5 * (cost + shrunk) - linear.log_volume, cost=cost)


def weigh(hypotheses: Sequence[Hypothesis], prior: Mapping[tuple[str, ...], float]) -> list[Hypothesis]:
    """``hypotheses`` with their probabilities, the likeliest first.

    No twin shows a deviation exactly as its machine does, nor is any search of its magnitudes and nuisances perfect: of all
    the evidence that there is a gap, the share :data:`DOUBT` may be wrong for every hypothesis. So what a hypothesis fits
    better than nothing does is tempered (Miller and Dunson 2019) by what that share amounts to. What its freedom costs
    counts in full, as does the fit where there is no gap.
    """
    nothing = next(h for h in hypotheses if not h.effects)
    temperature = 1.0 + DOUBT * max(max(h.log_evidence for h in hypotheses) - nothing.log_evidence, 0.0)

    def tempered(h: Hypothesis) -> float:
        better = h.log_evidence - nothing.log_evidence
        if np.isnan(h.cost):
            return better / temperature + prior[h.effects]
        fits = 0.5 * (nothing.cost - h.cost)
        return fits / temperature + (better - fits) + prior[h.effects]

    logs = np.array([tempered(h) for h in hypotheses])
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
