"""A learned problem in the linear model of its nuisances: all hypotheses at a glance.

With nuisances u of prior precision P, A = I + J P⁻¹ Jᵀ, a hypothesis that shifts the prediction by s has

    −2 ln p(y | s) = (r₀ − s)ᵀ A⁻¹ (r₀ − s) + ln |A| + const.

Every effect's shift s was simulated at a few magnitudes and is interpolated between them; shifts of a pair add up. So all
singles and all pairs follow from one Gram matrix.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, cho_factor, cho_solve, solve_triangular
from scipy.stats import chi2

from aoro_gym.diagnosis.axes import FEW_NODES, PRIOR_INFORMATION, Axis, Shift, axes_of, volume
from aoro_gym.diagnosis.noise import EXACT, Floats, ModelError
from aoro_gym.diagnosis.problem import Problem
from aoro_gym.diagnosis.replay import COARSE

PARTNERS = 12
"""Effects, the likeliest, of which one at least is in every pair that is screened."""
FAINT = 0.1
"""Square of how far, in noise lengths, the prediction must move with a direction of nuisances for it to tell anything."""
ROUNDING = 1e-12
"""Share of the squares of slopes by which they count as uncertain where rounding has made them contradict themselves."""
DEPENDENT = 1e-9
"""Ratio of singular values below which moves of nuisances count as dependent."""


class Tangent:
    """Whitened prediction as a linear function of nuisances around some point, and their prior.

    Its slopes (D, u) are J = (B 0) + M W: tangents that follow from one another share the wide B, and each has a narrow M of
    its own.

    Args:
        jacobian: B (D, b).
        precision: Of the prior (u, u).
        bounds: Ends (u,) of the nuisances.
        stiffness: What damps their moves (u, u); the precision by default.
        own: M (D, k) and W (k, u), if J is not B.
        inner: Jᵀ J, if it is known.
    """

    def __init__(
        self,
        jacobian: Floats,
        precision: Floats,
        bounds: tuple[Floats, Floats],
        stiffness: Floats | None = None,
        own: tuple[Floats, Floats] | None = None,
        inner: Floats | None = None,
    ):
        self.precision = precision
        self.bounds = bounds
        self.stiffness = precision if stiffness is None else stiffness
        self._shared = jacobian
        self._own = (np.empty((len(jacobian), 0)), np.empty((0, len(precision)))) if own is None else own
        if self._own[1].shape[0] > jacobian.shape[1]:
            self._shared = self.jacobian
            self._own = np.empty((len(jacobian), 0)), np.empty((0, len(precision)))
        if inner is None:
            whole = self.jacobian
            inner = whole.T @ whole
        self._information = inner

    @property
    def jacobian(self) -> Floats:
        """J (D, u)."""
        columns, weights = self._own
        if not len(weights):
            return self._shared
        return np.pad(self._shared, ((0, 0), (0, weights.shape[1] - self._shared.shape[1]))) + columns @ weights

    def moved(self, nuisances: Floats) -> Floats:
        """J u (D,) or (D, n): by how much the prediction moves with ``nuisances`` (u,) or (u, n)."""
        columns, weights = self._own
        return self._shared @ nuisances[: self._shared.shape[1]] + columns @ (weights @ nuisances)

    def pull(self, residual: Floats) -> Floats:
        """Jᵀ r (u,) or (u, n): where a ``residual`` (D,) or (D, n) pulls the nuisances."""
        columns, weights = self._own
        found = weights.T @ (columns.T @ residual)
        found[: self._shared.shape[1]] += self._shared.T @ residual
        return found

    @cached_property
    def _normal(self) -> tuple[Floats, tuple[Floats, bool]]:
        """A = P + Jᵀ J (u, u), and its factor."""
        normal = self.precision + self._information
        try:
            return normal, cho_factor(normal)
        except np.linalg.LinAlgError:  # what updates have added and taken away has left rounding
            whole = self.jacobian
            self._information = whole.T @ whole
            normal = self.precision + self._information + np.diag(ROUNDING * np.diag(self._information))
            return normal, cho_factor(normal)

    @cached_property
    def shrunk(self) -> float:
        """See :meth:`left_of_the_prior`."""
        return self.left_of_the_prior(1.0)

    def left_of_the_prior(self, temperature: float) -> float:
        """−½ ln |A|, what the data leave of the prior's volume, where they count by so much less."""
        information = self._information / temperature
        both = np.linalg.slogdet(self.precision)[1], np.linalg.slogdet(self.precision + information)[1]
        return 0.5 * float(both[0] - both[1])

    def beside(
        self,
        slopes: Floats,
        precision: float,
        bounds: tuple[Floats, Floats] | None = None,
        stiffness: float | None = None,
    ) -> Tangent:
        """With more unknowns, that have the ``slopes`` (D, n), a prior and, if given, ``bounds`` (n,) of their own."""
        count = slopes.shape[1]
        low, high = bounds or (np.full(count, -np.inf), np.full(count, np.inf))
        cross = self.pull(slopes)
        columns, weights = self._own

        def grown(matrix: Floats, more: Floats) -> Floats:
            return block_diag(matrix, more)  # pyright: ignore[reportReturnType]

        one = np.eye(count)
        return Tangent(
            self._shared,
            grown(self.precision, precision * one),
            (np.append(self.bounds[0], low), np.append(self.bounds[1], high)),
            grown(self.stiffness, (precision if stiffness is None else stiffness) * one),
            (np.concatenate([columns, slopes], axis=1), grown(weights, one)),
            np.block([[self._information, cross], [cross.T, slopes.T @ slopes]]),
        )

    def updated(self, moves: Floats, changes: Floats) -> Tangent:
        """The nearest one, by the prior, in which ``moves`` (k, u) of the nuisances bring ``changes`` (D, k): Broyden's
        update of several secants at once."""
        lengths = moves @ self.precision
        # at ends of ranges moves may coincide
        weights = np.linalg.lstsq(lengths @ moves.T, lengths, rcond=DEPENDENT)[0]
        missed = changes - self.moved(moves.T)
        # (J + M W)ᵀ (J + M W), with far fewer columns in M than in J
        cross = self.pull(missed) @ weights
        inner = self._information + cross + cross.T + weights.T @ (missed.T @ missed) @ weights
        own = np.concatenate([self._own[0], missed], axis=1), np.concatenate([self._own[1], weights])
        return Tangent(self._shared, self.precision, self.bounds, own=own, inner=inner)

    @property
    def sizes(self) -> Floats:
        """Lengths (u,) of the slopes."""
        return np.sqrt(np.maximum(np.diag(self._information), 0.0))  # of what an update takes away, rounding is left

    def directions(self, free: int, most: int) -> tuple[Floats, Floats]:
        """Directions (k, u) among the first ``free`` nuisances, each a prior standard deviation long and independent of the
        others, in which the prediction moves most, and more than :data:`FAINT`; and how far it moves (k,)."""
        root = np.linalg.cholesky(np.linalg.inv(self.precision[:free, :free]))
        power, axes = np.linalg.eigh(root.T @ self._information[:free, :free] @ root)
        chosen = np.flatnonzero(power > FAINT)[::-1][:most]
        found = np.zeros((len(chosen), len(self.precision)))
        found[:, :free] = (root @ axes[:, chosen]).T
        return found, np.sqrt(power[chosen])

    @property
    def covariance(self) -> Floats:
        """Of the posterior of the nuisances (u, u)."""
        return cho_solve(self._normal[1], np.eye(len(self.precision)))

    @property
    def spread(self) -> Floats:
        """B (D, u) with B Bᵀ = J P⁻¹ Jᵀ: what the prior of the nuisances does to the prediction."""
        return np.linalg.solve(np.linalg.cholesky(self.precision), self.jacobian.T).T

    def projected(self, columns: Floats, against: Floats) -> Floats:
        """columnsᵀ A⁻¹ against."""
        pull = self.pull(against)
        along = pull if columns is against else self.pull(columns)
        return columns.T @ against - along.T @ cho_solve(self._normal[1], pull)

    def best(self, residual: Floats) -> Floats:
        """Nuisances (u,) within their ranges that explain a ``residual`` (D,) best, priors included."""
        return self.steps(residual, (0.0,), np.zeros(len(self.precision)))[0]

    def steps(self, residual: Floats, dampings: Sequence[float], near: Floats) -> list[Floats]:
        """The same (u,) for each of several ``dampings``: so much of the stiffness keeps them ``near`` others (u,)."""
        pull = self.pull(residual)
        normal, factor = self._normal

        def step(damping: float) -> Floats:
            if not damping:
                return self._within(normal, factor, pull)
            damped = normal + damping * self.stiffness
            return self._within(damped, cho_factor(damped), pull + damping * self.stiffness @ near)

        return [step(damping) for damping in dampings]

    def _within(self, normal: Floats, factor: tuple[Floats, bool], pull: Floats) -> Floats:
        """Solution (u,) of normal x = pull, held at the bounds that it would leave."""
        low, high = self.bounds
        best: Floats = cho_solve(factor, pull)
        held = np.zeros(len(best), dtype=bool)
        for _ in range(len(best)):
            beyond = ~held & ((best < low) | (best > high))
            if not np.any(beyond):
                break
            held |= beyond
            best[held] = np.clip(best[held], low[held], high[held])
            free = ~held
            rest = pull[free] - normal[np.ix_(free, held)] @ best[held]
            best[free] = np.linalg.solve(normal[np.ix_(free, free)], rest)
        return best


class Misfit(NamedTuple):
    """How a kind of channel fits."""

    square: float
    """Mean square of a whitened residual."""
    count: int
    """Samples that it is of."""
    noise: float
    """What it would be if there were nothing but the sensors' noise."""


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
    tangent: Tangent | None = None  # of the nuisances there
    refined: bool = False
    probability: float = 0.0
    misfit: Mapping[str, Misfit] = field(default_factory=dict)  # by kind of channel

    @property
    def strain(self) -> float:
        """Mean square of its nuisances, in standard deviations of their prior; 0 if there are none."""
        if self.tangent is None or not self.nuisances.size:
            return 0.0
        return float(self.nuisances @ self.tangent.precision @ self.nuisances) / self.nuisances.size


class Linear:
    """A learned problem, whitened under one error of the twin: r(u, z) = r₀ − J u − S φ(z)."""

    def __init__(self, problem: Problem, error: ModelError, effects: bool = True):
        self.problem = problem
        self.whiteners = problem.held(error)
        self.log_volume = sum(float(np.sum(np.log(np.diag(w.factor)))) for w in self.whiteners)
        felt = len(problem.felt)
        own = problem.own(problem.predicted)
        residual = problem.measured - problem.predicted + problem.slopes @ problem.centre[:felt]
        parts = {key: part for key, part in problem.shifts.items() if effects}
        white = problem.white(
            self.whiteners, np.concatenate([residual[:, None], problem.slopes, own, *parts.values()], axis=1)
        )
        u = felt + own.shape[1]
        self.own = white[:, 1 + felt : 1 + u]
        """Whitened shifts (D, c) of the recordings' own nuisances."""
        self.residual = white[:, 0]
        """r₀ (D,)."""
        self.tangent = Tangent(white[:, 1 : 1 + u], problem.precision, problem.bounds)
        ends = np.cumsum([1 + u, *(part.shape[1] for part in parts.values())])
        self.shifts = {key: white[:, a:b] for key, a, b in zip(parts, ends[:-1], ends[1:], strict=True)}
        """S (D, nodes) by effect and number of its axis."""

    def evidence(self) -> float:
        """Log evidence of the nuisances alone, with all constants that depend on the error of the twin."""
        fit = self.tangent.projected(self.residual, self.residual)
        return float(-0.5 * fit) + self.tangent.shrunk - self.log_volume

    @cached_property
    def kinds(self) -> dict[str, NDArray[np.bool_]]:
        """Whitened samples (D,) by kind of channel."""
        kinds = [self.problem.kinds.get(name, "") for _, name in self.problem.blocks]
        of = np.repeat(kinds, [len(w.factor) for w in self.whiteners])
        return {kind: of == kind for kind in dict.fromkeys(kinds) if kind}

    @cached_property
    def noise(self) -> Floats:
        """Mean square (D,) that noise alone has in a block once it was whitened, tr(L⁻¹ N L⁻ᵀ) / n."""
        parts = []
        for w, quiet in zip(self.whiteners, self.problem.held(EXACT), strict=True):
            white = solve_triangular(w.factor, quiet.factor, lower=True, check_finite=False)
            parts.append(np.full(len(white), np.sum(white**2) / len(white)))
        return np.concatenate(parts)

    def misfit(self, left: Floats) -> dict[str, Misfit]:
        """That of a whitened residual (D,), by kind of channel."""
        return {
            kind: Misfit(float(np.mean(left[its] ** 2)), int(its.sum()), float(np.mean(self.noise[its])))
            for kind, its in self.kinds.items()
            if its.any()
        }

    def shift(self, effects: Sequence[str], places: Floats, derivative: int = 0) -> list[Floats]:
        """Shift (D,) of every axis of ``effects`` at its place, or its derivative by it."""
        axes = [(name, axis) for name in effects for axis in self.problem.axes[name]]
        return [
            self.shifts[name, axis.index] @ axis.spline(z, derivative)
            for (name, axis), z in zip(axes, places, strict=True)
        ]

    @cached_property
    def _following(self) -> Callable[[tuple[str, ...]], Shift]:
        """What effects do, by their names, if that adds up and nuisances follow at once."""
        return _together(self.problem.axes, self.shifts, lambda x: self.tangent.projected(x, x), self.residual)

    @cached_property
    def _staying(self) -> Callable[[tuple[str, ...]], Shift]:
        """The same where the machine's nuisances stay at the centre and only the recordings' own follow: what an effect does
        to the machine's is not known far from there."""
        problem = self.problem
        felt = len(problem.felt)
        low, high = problem.bounds
        own = Tangent(self.own, problem.precision[felt:, felt:], (low[felt:], high[felt:]))
        here = self.residual - self.tangent.moved(np.append(problem.centre[:felt], np.zeros(self.own.shape[1])))
        return _together(problem.axes, self.shifts, lambda x: own.projected(x, x), here)

    def likely(self, most: int, least: float) -> dict[tuple[str, ...], list[tuple[float, ...]]]:
        """Effects and pairs of them that explain most, if what effects do adds up, with their places, each at a node: up to
        ``most`` of either kind where nuisances follow at once, and as many where the machine's stay. An effect must bring
        the whitened squares down by ``least``, a pair by so much more than any effect."""
        singles = [(name,) for name in self.problem.axes]
        pairs = list(combinations(self.problem.axes, 2))
        found: dict[tuple[str, ...], list[tuple[float, ...]]] = {}
        for together in (self._following, self._staying):
            best = {effects: together(effects).at_nodes() for effects in (*singles, *pairs)}
            lowest = min((best[effects][0] for effects in singles), default=0.0)
            for those, before in ((singles, 0.0), (pairs, lowest)):
                for effects in sorted(those, key=lambda effects: best[effects][0])[:most]:
                    cost, places = best[effects]
                    if cost < before - least:
                        found.setdefault(effects, []).append(places)
        return {effects: list(dict.fromkeys(those)) for effects, those in found.items()}

    def starts(self, most: int) -> dict[str, list[tuple[float, ...]]]:
        """Places from which to search for every effect: up to ``most`` valleys each of where nuisances follow at once, and
        of where the machine's stay at the centre."""
        both = self._following, self._staying
        return {
            name: list(dict.fromkeys(place for together in both for place in together((name,)).valleys(most)))
            for name in self.problem.axes
        }

    def screen(self, *, pairs: bool = True) -> dict[tuple[str, ...], Hypothesis]:
        """Nothing, every effect, and, if so asked, every pair with one of the :data:`PARTNERS` likeliest."""
        axes = self.problem.axes
        nothing = float(self.tangent.projected(self.residual, self.residual))
        base = self.evidence()

        def screened(effects: tuple[str, ...], first: tuple[float, ...] | None) -> Hypothesis:
            part = self._following(effects)
            cost, places, information = part.descend(part.grid() if first is None else first)
            evidence = base - 0.5 * cost + volume(places, information)
            covariance = np.linalg.inv(information + PRIOR_INFORMATION * np.eye(len(places)))
            return Hypothesis(effects, evidence, places, covariance=covariance, cost=nothing + cost)

        found: dict[tuple[str, ...], Hypothesis] = {(): Hypothesis((), base, cost=nothing)}
        for name in axes:
            found[(name,)] = screened((name,), None)
        if not pairs:
            return found
        likeliest = sorted(axes, key=lambda name: -found[(name,)].log_evidence)[:PARTNERS]
        for pair in combinations(axes, 2):
            if set(pair) & set(likeliest):
                found[pair] = screened(pair, sum((found[(name,)].places for name in pair), ()))
        return found

    def beside(self, leaders: Sequence[Hypothesis]) -> list[Beside]:
        """What every other effect does beside each of several refined hypotheses of one effect, all simulated together."""
        problem = self.problem
        of = [
            {name: axes_of(effect, FEW_NODES) for name, effect in problem.effects.items() if name not in h.effects}
            for h in leaders
        ]
        nodes = [problem.at_nodes(axes, h.nuisances, h.effects, h.places) for h, axes in zip(leaders, of, strict=True)]
        asked = [one for mine in nodes for one in mine.values()]
        if not asked:
            return []
        alone = [problem.at(h.nuisances[None], h.effects, np.array([h.places])) for h in leaders]
        white = problem.residuals(self.whiteners, [*alone, *asked], COARSE)
        here, white = white[:, : len(alone)], white[:, len(alone) :]
        ends = np.cumsum([one.count for one in asked])
        parts = iter(np.split(white, ends[:-1], axis=1))
        found = []
        for h, axes, mine, without in zip(leaders, of, nodes, here.T, strict=True):
            shifts = {key: np.nan_to_num(without[:, None] - next(parts)) for key in mine}
            found.append(Beside(h, tuple(problem.axes), axes, shifts))
        return found


@dataclass(frozen=True)
class Beside:
    """A refined hypothesis, and what other effects do beside it: what an effect does depends on what else is wrong."""

    leader: Hypothesis
    catalogue: tuple[str, ...]  # all effects in the order that pairs have them in
    axes: Mapping[str, Sequence[Axis]]  # of the others
    shifts: Mapping[tuple[str, int], Floats]  # whitened (D, nodes), by effect and number of its axis

    @property
    def target(self) -> Floats:
        """What nuisances and others are to explain (D,), where the leader stays."""
        tangent = self.leader.tangent
        assert tangent is not None
        return self.leader.left + tangent.moved(self.leader.nuisances)

    def left(self, effects: Sequence[str], places: Floats) -> Floats:
        """What is left of :attr:`target` where the others among ``effects`` are at their ``places`` (axes,)."""
        left, column = self.target, 0
        for name in effects:
            axes = self.axes.get(name)
            if axes is None:  # the leader's own
                column += len(self.leader.places)
                continue
            for axis in axes:
                left = left - self.shifts[name, axis.index] @ axis.spline(places[column])
                column += 1
        return left

    @cached_property
    def _together(self) -> Callable[[tuple[str, ...]], Shift]:
        tangent = self.leader.tangent
        assert tangent is not None
        tangent = tangent.beside(self.leader.slopes, PRIOR_INFORMATION)
        return _together(self.axes, self.shifts, lambda x: tangent.projected(x, x), self.target)

    @cached_property
    def gains(self) -> dict[str, tuple[float, tuple[float, ...], Floats]]:
        """By each other effect: what it would gain in cost, all else following, at which places, and the information about
        these."""
        found = {}
        for name in self.axes:
            part = self._together((name,))
            cost, places, information = part.descend(part.grid())
            found[name] = -cost, places, information
        return found

    @cached_property
    def excess(self) -> float:
        """How much the others would gain beside the leader, by the upper quartile, over what chance has one of them gain, χ²
        of one degree of freedom: as they cannot all be there, so much is wrong with the twin, or with the leader."""
        gains = [gain for gain, _, _ in self.gains.values()]
        return float(np.quantile(gains, 0.75) / chi2.ppf(0.75, 1)) if gains else 0.0

    def partners(self) -> list[tuple[tuple[str, ...], tuple[float, ...]]]:
        """Pairs of the leader and another effect, with the places that suit them, the likeliest first."""
        leader = self.leader
        pairs = []
        for name, (gain, places, information) in self.gains.items():
            of = {**dict.fromkeys(leader.effects, leader.places), name: places}
            effects = tuple(one for one in self.catalogue if one in of)
            pairs.append((0.5 * gain + volume(places, information), effects, sum((of[one] for one in effects), ())))
        return [(effects, places) for _, effects, places in sorted(pairs, reverse=True)]


def _together(
    axes: Mapping[str, Sequence[Axis]],
    shifts: Mapping[tuple[str, int], Floats],
    product: Callable[[Floats], Floats],
    target: Floats,
) -> Callable[[tuple[str, ...]], Shift]:
    """Cost of what effects do, by their names, to a ``target`` (D,): columnsᵀ M columns is their ``product``."""
    flat = [(name, axis) for name, mine in axes.items() for axis in mine]
    everything = np.concatenate([target[:, None], *(shifts[n, a.index] for n, a in flat)], axis=1)
    gram = product(everything)
    starts = np.cumsum([1, *(len(axis.nodes) for _, axis in flat)])

    def part(effects: tuple[str, ...]) -> Shift:
        mine = [i for name in effects for i, (other, _) in enumerate(flat) if other == name]
        columns = np.concatenate([np.arange(starts[i], starts[i + 1]) for i in mine])
        return Shift([flat[i][1] for i in mine], gram[np.ix_(columns, columns)], gram[columns, 0])

    return part
