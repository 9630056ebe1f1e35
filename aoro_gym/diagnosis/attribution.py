"""Which effect: the evidence for nothing, for each effect, for each pair, and for something that the catalogue lacks.

All hypotheses see the same whitened residuals r and the same nuisances u, whose prior is normal. Around the machine that
was given, nuisances are linear, r(u) = r₀ − J u, and are integrated out in closed form: with A = I + J Jᵀ a hypothesis
that shifts the prediction by s has

    −2 ln p(y | s) = (r₀ − s)ᵀ A⁻¹ (r₀ − s) + ln |A| + const.

Every effect's shift s is simulated at a few magnitudes and interpolated between them; shifts of a pair add up. So all
singles and all pairs follow from one Gram matrix. The likeliest hypotheses are then refined with the twin itself
(Gauss–Newton in nuisances and magnitudes), nothing among them, and weighed by Laplace's method.

*Unknown* is a hypothesis, too: a flexible error of the joint's rate and of the pressures (:mod:`.noise`), larger than
the twin's own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import lsq_linear
from scipy.special import logsumexp, ndtr
from scipy.stats import chi2

from aoro_gym.calibration.space import Space
from aoro_gym.diagnosis.noise import Floats, ModelError, Noise, Whitener, noise_of, whitener
from aoro_gym.diagnosis.recording import TICK, Recording
from aoro_gym.diagnosis.replay import Replay, Variants
from aoro_gym.twin import Machine
from aoro_gym.twin.effects import Effect, Magnitude

NODES = (0.1, 0.3, 0.6, 1.0)
"""Magnitudes simulated on either side of ``none``: shares of the way to the end of the range."""
FINE = 41
"""Places of the grid on which a search begins."""
STEP = 0.5
"""Finite-difference step of nuisances, in prior standard deviations."""
PAIRS = 16
"""Pairs that are refined with the twin: the likeliest of all that were screened. Nothing and every single effect are."""
SETTLING = 12
"""Most Jacobians of the nuisances, each at the best point so far."""
BOXES = (0.3, 1.0, 3.0, 10.0)
"""Half widths [prior standard deviations] of the boxes within which a step of all nuisances is tried."""
EASING = (20.0, 8.0, 3.0, 1.0)
"""Multiples of the twin's own error under which the first steps are taken: the cost has fewer valleys then."""
ENOUGH = 0.003
"""A step that lowers the cost by less than this share is the last."""
ROUNDS = 6
"""Gauss–Newton steps of every hypothesis, twice."""
FELT = 0.1
"""Whitened length of what one standard deviation of a nuisance does, below which it is left alone."""
START_JITTER = 1e-3
"""Standard deviation [s] of a recording's clock against its commands."""
ANGLE_BIAS = np.radians(0.03)
"""Standard deviation [rad] of the angle's zero, anew in each recording."""
PRESSURE_BIAS = 0.3e5
"""Standard deviation [Pa] of a pressure sensor's zero, one for all recordings."""
SURPRISES = (3.0, 6.0, 12.0)
"""Sizes of an unknown cause, in multiples of the twin's own error."""

PRIOR = {"nothing": 0.40, "single": 0.40, "pair": 0.10, "unknown": 0.10}
"""Prior probabilities of the kinds of hypotheses; within a kind all are equally likely."""

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Axis:
    """One magnitude of one effect, searched between 0 and 1 over its range."""

    effect: Effect
    index: int

    @property
    def magnitude(self) -> Magnitude:
        return self.effect.magnitudes[self.index]

    @cached_property
    def none(self) -> float:
        return float(self.place(self.magnitude.none))

    def value(self, place: Floats | float) -> Floats:
        """Magnitude at ``place`` in [0, 1]."""
        low, high = self.magnitude.low, self.magnitude.high
        z = np.asarray(place, dtype=np.float64)
        return low * (high / low) ** z if self.magnitude.scale == "log" else low + (high - low) * z

    def place(self, value: Floats | float) -> Floats:
        low, high = self.magnitude.low, self.magnitude.high
        v = np.asarray(value, dtype=np.float64)
        return np.log(v / low) / np.log(high / low) if self.magnitude.scale == "log" else (v - low) / (high - low)

    @cached_property
    def nodes(self) -> Floats:
        """Places that are simulated; denser near ``none``."""
        shares = np.array(NODES)
        below = self.none - self.none * shares if self.none > 1e-9 else np.empty(0)
        above = self.none + (1.0 - self.none) * shares if self.none < 1.0 - 1e-9 else np.empty(0)
        return np.sort(np.concatenate([below, above]))

    @cached_property
    def fine(self) -> Floats:
        """Places of the grid on which a search begins."""
        return np.linspace(0.0, 1.0, FINE)

    @cached_property
    def _basis(self) -> tuple[CubicSpline, int]:
        places = np.sort(np.append(self.nodes, self.none))
        return CubicSpline(places, np.eye(len(places))), int(np.searchsorted(places, self.none))

    def spline(self, place: Floats | float, derivative: int = 0) -> Floats:
        """Weights (…, nodes) of the shifts at the nodes in the shift at ``place``; that at ``none`` is zero."""
        basis, where = self._basis
        return np.delete(basis(place, derivative), where, axis=-1)


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects and how it fares."""

    effects: tuple[str, ...]
    log_evidence: float
    places: tuple[float, ...] = ()  # of every axis, at the best fit
    nuisances: Floats = field(default_factory=lambda: np.empty(0))  # standard deviations
    covariance: Floats = field(default_factory=lambda: np.empty((0, 0)))  # of the places
    cost: float = np.nan  # whitened squares at the best fit, priors included
    probability: float = 0.0


class Problem:
    """Recordings, the machine that should have made them, and what may part the two.

    Args:
        machine: The commissioned twin.
        recordings: To be explained.
        effects: Catalogue by id.
        keys: Nuisance parameters.
        spread: Their prior standard deviations, in the unit cube of :class:`~aoro_gym.calibration.space.Space`.
        error: The twin's own error.
        reference: Mean residuals of the healthy machine (SI, by the commands' signature and channel), subtracted.
        noise: By channel; from the recordings' standstill by default.
        device: Where twins run.
    """

    def __init__(
        self,
        machine: Machine,
        recordings: Sequence[Recording],
        effects: Mapping[str, Effect],
        *,
        keys: Sequence[str],
        spread: Floats,
        error: ModelError,
        reference: Mapping[tuple[bytes, str], Floats] | None = None,
        noise: Mapping[str, Noise] | None = None,
        device: str = "cpu",
    ):
        self.machine = machine
        self.recordings = tuple(recordings)
        self.effects = dict(effects)
        self.space = Space(machine, keys)
        self.spread = np.asarray(spread, dtype=np.float64)
        self.error = error
        self.reference = dict(reference or {})
        self.replay = Replay(recordings, device=device)
        longest = max(len(r.channels["joint_angle"]) for r in recordings)
        self.noise = dict(noise or {})
        for name in self.replay.signals:
            self.noise.setdefault(name, noise_of(recordings, name, longest))
        self.blocks = [(index, name) for index, r in enumerate(self.recordings) for name in r.channels]
        """Recording and channel of every part of a stacked residual."""
        self._whiteners: list[Whitener] = []  # of the error that the search has come down to
        self.own: Floats = np.empty((0, 0))
        """Whitened shifts (D, c) of the recordings' own nuisances."""
        self.axes: dict[str, list[Axis]] = {}
        self.felt: NDArray[np.intp] = np.arange(len(self.space.keys))
        """Nuisances that show; the others stay where they are."""
        self.centre: Floats = np.zeros(0)
        """Best fit of the nuisances alone, in standard deviations: the felt ones, then the recordings' own."""
        self.jacobian: Floats = np.empty((0, 0))
        """Whitened change (D, u) of the predictions a standard deviation of each."""
        self.residual: Floats = np.empty(0)
        """Whitened r₀ (D,) of the linear model r(u) = r₀ − J u."""
        self.shifts: dict[tuple[str, int], Floats] = {}
        """Whitened shifts (D, nodes) by effect and number of its axis."""

    # ---- predictions ----

    def variants(self, nuisances: Floats, effects: Sequence[str], places: Floats) -> Variants:
        """N machines: ``nuisances`` (N, d) in prior standard deviations, ``places`` (N, axes) of the ``effects``."""
        count = len(nuisances)
        moved = np.flatnonzero(np.any(nuisances != 0.0, axis=0))
        machine = self.machine
        if moved.size:
            points = np.clip(self.space.point() + self.spread * nuisances, 0.0, 1.0)
            values = self.space.values(points)
            machine = machine.set(
                {self.space.keys[i]: values[:, i] if count > 1 else float(values[0, i]) for i in moved}
            )
        magnitudes, column = [], 0
        for name in effects:
            effect = self.effects[name]
            axes = range(len(effect.magnitudes))
            values = [Axis(effect, i).value(places[:, column + i]) for i in axes]
            magnitudes.append((effect, tuple(v if count > 1 else float(v[0]) for v in values)))
            column += len(effect.magnitudes)
        return Variants.of(machine, magnitudes, count)

    def simulate(self, variants: Sequence[Variants], progress: Callable[[float], None] = lambda share: None) -> Floats:
        """Stacked predictions (D, N), SI."""
        found = self.replay.run(variants, progress)
        return np.concatenate([found[index][name] for index, name in self.blocks]).astype(np.float64)

    @cached_property
    def measured(self) -> Floats:
        """Stacked measurements (D,), SI, less what the healthy machine did otherwise than its twin."""
        parts = []
        for index, name in self.blocks:
            recording = self.recordings[index]
            values = recording.channels[name].astype(np.float64)
            known = self.reference.get((recording.signature, name))
            parts.append(values - known[: len(values)] if known is not None else values)
        return np.concatenate(parts)

    @cached_property
    def base(self) -> Floats:
        """Stacked prediction (D,) of the given machine."""
        return self.simulate([Variants(self.machine)])[:, 0]

    def split(self, stacked: Floats) -> list[Floats]:
        """Parts of a stacked array by block."""
        ends = np.cumsum([len(self.recordings[index].channels[name]) for index, name in self.blocks])
        return np.split(stacked, ends[:-1])

    def whiteners(self, error: ModelError) -> list[Whitener]:
        """One a block."""
        parts = self.split(self.base)
        out = []
        for (index, name), predicted in zip(self.blocks, parts, strict=True):
            known = (self.recordings[index].signature, name) in self.reference
            out.append(whitener(self.noise[name], name, predicted, error.scaled(KNOWN) if known else error))
        return out

    def white(self, stacked: Floats) -> Floats:
        """``stacked`` (D,) or (D, N) of differences, whitened."""
        return np.concatenate([w(part) for w, part in zip(self._whiteners, self.split(stacked), strict=True)])

    @cached_property
    def _own(self) -> Floats:
        """Shifts (D, c), SI, by one standard deviation of what belongs to the recordings themselves: each one's clock
        and zero of the angle, each pressure sensor's zero."""
        parts = self.split(self.base)

        def stacked(shift: Callable[[int, str, Floats], Any]) -> Floats:
            """Column (D,) of what ``shift`` gives for each block's recording, channel and prediction."""
            blocks = zip(self.blocks, parts, strict=True)
            return np.concatenate([np.broadcast_to(shift(i, name, part), part.shape) for (i, name), part in blocks])

        columns = []
        for k in range(len(self.recordings)):
            columns.append(
                stacked(lambda i, name, part, k=k: START_JITTER * np.gradient(part) / TICK if i == k else 0.0)
            )
            columns.append(stacked(lambda i, name, part, k=k: ANGLE_BIAS if (i, name) == (k, "joint_angle") else 0.0))
        for channel in self.replay.signals:
            if "pressure" in channel:
                columns.append(stacked(lambda i, name, part, c=channel: PRESSURE_BIAS if name == c else 0.0))
        return np.stack(columns, axis=1)

    # ---- linear model ----

    def learn(self, progress: Progress = lambda sentence, share: None) -> None:
        """Fit the nuisances alone, and simulate around that fit what every nuisance and every effect does."""
        self.axes = {
            name: [Axis(effect, i) for i in range(len(effect.magnitudes))] for name, effect in self.effects.items()
        }
        self._settle(lambda share: progress("fitting nuisances", 0.6 * share))
        batch = [self._at(self.centre[None])]
        for name, axes in self.axes.items():
            for axis in axes:
                places = np.tile([a.none for a in axes], (len(axis.nodes), 1))
                places[:, axis.index] = axis.nodes
                batch.append(self._at(np.tile(self.centre, (len(places), 1)), (name,), places))
        found = self.simulate(batch, lambda share: progress("what every effect does", 0.6 + 0.4 * share))
        shifts = self.white(np.nan_to_num(found - found[:, :1]))
        column = 1
        for name, axes in self.axes.items():
            for axis in axes:
                self.shifts[name, axis.index] = shifts[:, column : column + len(axis.nodes)]
                column += len(axis.nodes)

    def _at(self, points: Floats, effects: Sequence[str] = (), places: Floats | None = None) -> Variants:
        """Machines at ``points`` (N, u) of the felt nuisances (what lies beyond them is the recordings' own)."""
        nuisances = np.zeros((len(points), len(self.space.keys)))
        nuisances[:, self.felt] = points[:, : len(self.felt)]
        return self.variants(nuisances, effects, np.empty((len(points), 0)) if places is None else places)

    def _settle(self, progress: Callable[[float], None]) -> None:
        """Gauss–Newton in the nuisances alone: ``centre``, and there the Jacobian (D, u) and the residual r₀ of the
        linear model r(u) = r₀ − J u."""
        own = self._own.shape[1]
        self.centre = np.zeros(len(self.felt) + own)
        last = False
        for step in range(SETTLING):
            if step < len(EASING):
                self._whiteners = self.whiteners(self.error.scaled(EASING[step]))
                self.own = self.white(self._own)
            d = len(self.felt)
            h = np.where(self.space.point()[self.felt] + STEP * self.spread[self.felt] <= 1.0, STEP, -STEP)
            points = np.vstack([self.centre, self.centre + np.eye(d, d + own) * h[:, None]])
            found = self.simulate(
                [self._at(points)], lambda share, step=step: progress((step + 0.8 * share) / SETTLING)
            )
            slopes: Floats = self.white(np.nan_to_num(found[:, 1:] - found[:, :1])) / h
            if step == 0:
                shown = np.flatnonzero(np.linalg.norm(slopes, axis=0) > FELT)
                slopes = slopes[:, shown]
                self.felt = self.felt[shown]
                self.centre = np.concatenate([self.centre[:d][shown], self.centre[d:]])
                d = len(shown)
            self.jacobian = np.concatenate([slopes, self.own], axis=1)
            residual = self.white(self.measured - found[:, 0]) - self.own @ self.centre[d:]
            self.residual = residual + self.jacobian @ self.centre
            if last or step == SETTLING - 1:
                break
            tried = np.array([self.centre, *(self._boxed(residual, box) for box in BOXES)])
            found = self.simulate([self._at(tried)])
            white = self.white(self.measured[:, None] - found) - self.own @ tried[:, d:].T
            costs = np.nan_to_num(np.sum(white**2, axis=0) + np.sum(tried**2, axis=1), nan=np.inf)
            best = int(np.argmin(costs))
            self.centre = tried[best]
            last = step >= len(EASING) - 1 and costs[best] > (1.0 - ENOUGH) * costs[0]
        progress(1.0)

    def _boxed(self, residual: Floats, box: float) -> Floats:
        """Least cost of the linear model within ``box`` standard deviations of the centre, and within the ranges."""
        d, whole = len(self.felt), len(self.centre)
        place, width = self.space.point()[self.felt], self.spread[self.felt]
        low, high = np.full(whole, -np.inf), np.full(whole, np.inf)
        low[:d] = np.maximum(-box, np.minimum(-place / width - self.centre[:d], 0.0) - 1e-9)
        high[:d] = np.minimum(box, np.maximum((1.0 - place) / width - self.centre[:d], 0.0) + 1e-9)
        slopes = np.vstack([self.jacobian, np.eye(whole)])
        target = np.concatenate([residual, -self.centre])
        inner: Any = np.linalg.qr(np.column_stack([slopes, target]), "r")
        return self.centre + lsq_linear(inner[:, :-1], inner[:, -1], (low, high)).x

    def shift(self, effects: Sequence[str], places: Floats) -> Floats:
        """Whitened shift (D,) of ``effects`` at ``places``, interpolated and added up."""
        total = np.zeros(len(self.residual))
        axes = [(name, axis) for name in effects for axis in self.axes[name]]
        for (name, axis), place in zip(axes, places, strict=True):
            total += self.shifts[name, axis.index] @ axis.spline(place)
        return total

    def slope(self, effects: Sequence[str], places: Floats) -> Floats:
        """Its derivatives (D, axes) by the places."""
        axes = [(name, axis) for name in effects for axis in self.axes[name]]
        columns = [self.shifts[name, a.index] @ a.spline(z, 1) for (name, a), z in zip(axes, places, strict=True)]
        return np.stack(columns, axis=1) if columns else np.empty((len(self.residual), 0))

    def projected(self, columns: Floats, against: Floats) -> Floats:
        """columnsᵀ A⁻¹ against."""
        inner = cho_factor(np.eye(self.jacobian.shape[1]) + self.jacobian.T @ self.jacobian)
        return columns.T @ against - (self.jacobian.T @ columns).T @ cho_solve(inner, self.jacobian.T @ against)

    def screen(self) -> dict[tuple[str, ...], tuple[float, tuple[float, ...]]]:
        """Log evidence, up to a constant common to all, and best places of nothing, every effect and every pair."""
        names = list(self.axes)
        flat = [(name, axis) for name in names for axis in self.axes[name]]
        everything = np.concatenate([self.residual[:, None], *(self.shifts[n, a.index] for n, a in flat)], axis=1)
        gram = self.projected(everything, everything)
        starts = np.cumsum([1, *(len(a.nodes) for _, a in flat)])
        nothing = float(gram[0, 0])
        where = {name: [i for i, (n, _) in enumerate(flat) if n == name] for name in names}
        found: dict[tuple[str, ...], tuple[float, tuple[float, ...]]] = {(): (-0.5 * nothing, ())}
        best: dict[str, tuple[float, ...]] = {}
        for effects in [*((name,) for name in names), *combinations(names, 2)]:
            axes = [i for name in effects for i in where[name]]
            columns = np.concatenate([np.arange(starts[i], starts[i + 1]) for i in axes])
            part = Shift([flat[i][1] for i in axes], gram[np.ix_(columns, columns)], gram[columns, 0])
            if len(effects) == 1:
                first = part.grid()
                cost, places, information = part.descend(first)
                best[effects[0]] = places
            else:
                cost, places, information = part.descend(sum((best[name] for name in effects), ()))
            found[effects] = (-0.5 * (nothing + cost) + _volume(places, information), places)
        return found

    # ---- refinement with the twin ----

    def refine(
        self,
        candidates: Sequence[tuple[tuple[str, ...], tuple[float, ...]]],
        progress: Progress = lambda sentence, share: None,
        start: Floats | None = None,
    ) -> list[Hypothesis]:
        """The best fit of every candidate (effects, first places) in nuisances and magnitudes, the same effort for each.

        Nuisances begin at ``start``, or where the linear model has them. Gauss–Newton steps, whose slopes are those around
        the fit of the nuisances alone, corrected by what each step did (Broyden 1965); within the span of all slopes and
        shifts, which is where a step can change anything.
        """
        slopes = np.concatenate([self.jacobian, *self.shifts.values()], axis=1)
        self._span = np.linalg.qr(np.column_stack([slopes, self.residual]))[0]
        searches = [Search(self, effects, places, start) for effects, places in candidates]
        for step in range(ROUNDS + 1):
            batch = [search.variants() for search in searches]
            found = self.simulate(batch, lambda share, step=step: progress("refining", (step + share) / (ROUNDS + 1)))
            ends = np.cumsum([one.count for one in batch])
            for search, mine in zip(searches, np.split(found, ends[:-1], axis=1), strict=True):
                search.learn(mine)
        return [search.weighed() for search in searches if np.isfinite(search.cost)]

    def surprise(self) -> float:
        """Log evidence of an unknown cause, on the scale of :meth:`screen`: the same residuals under larger errors."""
        columns = self._plain(np.column_stack([self.jacobian, self.residual]))

        def evidence(error: ModelError) -> float:
            whiteners = self.whiteners(error)
            white = np.concatenate([w(part) for w, part in zip(whiteners, self.split(columns), strict=True)])
            jacobian, residual = white[:, :-1], white[:, -1]
            inner = np.eye(jacobian.shape[1]) + jacobian.T @ jacobian
            pull = jacobian.T @ residual
            fit = residual @ residual - pull @ np.linalg.solve(inner, pull)
            volume = sum(float(np.sum(np.log(np.diag(w.factor)))) for w in whiteners)
            return -0.5 * fit - volume - 0.5 * np.linalg.slogdet(inner)[1]

        larger = [evidence(self.error.scaled(factor)) for factor in SURPRISES]
        nothing = -0.5 * float(self.projected(self.residual[:, None], self.residual[:, None])[0, 0])
        return nothing + float(np.logaddexp.reduce(larger)) - float(np.log(len(larger))) - evidence(self.error)

    def _plain(self, white: Floats) -> Floats:
        """Whitened columns (D, N) back in SI."""
        return np.concatenate([w.factor @ part for w, part in zip(self._whiteners, self.split(white), strict=True)])

    def apart(self, hypothesis: Hypothesis) -> list[tuple[float, ...]]:
        """The places of a hypothesis, effect by effect."""
        ends = np.cumsum([len(self.axes[name]) for name in hypothesis.effects])
        return [tuple(part) for part in np.split(np.array(hypothesis.places), ends[:-1])] if hypothesis.effects else []

    def fit_p(self, hypothesis: Hypothesis) -> float:
        """Probability of residuals at least as large as those of a fitted hypothesis, if it holds."""
        free = len(hypothesis.places)
        return float(np.asarray(chi2.sf(hypothesis.cost, len(self.measured) - free)))


PRIOR_INFORMATION = 12.0
"""Of a place: its prior is uniform over [0, 1], whose variance is 1/12."""
KNOWN = 0.3
"""Share of the twin's own error that is left where the healthy machine's residual of the same manoeuvre is subtracted."""


class Search:
    """The best fit of one hypothesis: nuisances u (standard deviations) and places z of its axes."""

    def __init__(
        self,
        problem: Problem,
        effects: tuple[str, ...],
        places: tuple[float, ...],
        start: Floats | None,
    ):
        self.problem = problem
        self.effects = effects
        span = problem._span
        z = np.array(places, dtype=np.float64)
        jacobian = span.T @ problem.jacobian
        u = start
        if u is None:
            left = span.T @ (problem.residual - problem.shift(effects, z))
            u = np.linalg.solve(np.eye(jacobian.shape[1]) + jacobian.T @ jacobian, jacobian.T @ left)
        self.nuisances = len(u)
        self.tried = np.concatenate([u, z])
        self.point, self.cost = self.tried, np.inf
        self.residual = np.empty(0)  # in the span, at ``point``
        # what the prediction does, in the span
        self.slopes = np.concatenate([jacobian, span.T @ problem.slope(effects, z)], axis=1)
        self.last: tuple[Floats, Floats] | None = None
        self.reach = 1.0

    def variants(self) -> Variants:
        """The machine to be simulated next, and its neighbours along every axis."""
        u, z = np.split(self.tried, [self.nuisances])
        self._steps = np.where(z < 0.5, 0.01, -0.01)
        places = np.vstack([z, z + np.diag(self._steps)]) if z.size else z[None]
        problem = self.problem
        return problem._at(np.tile(u, (len(places), 1)), self.effects, places)

    def learn(self, found: Floats) -> None:
        """Take in what was simulated, and choose the next point."""
        problem = self.problem
        u = self.tried[: self.nuisances]
        if np.all(np.isfinite(found)):
            white = problem.white(problem.measured - found[:, 0]) - problem.own @ u[len(problem.felt) :]
            residual = problem._span.T @ white
            cost = float(white @ white + u @ u)
            if self.last is not None:
                moved = self.tried - self.last[0]
                if moved @ moved > 1e-12:
                    surprise = self.last[1] - residual - self.slopes @ moved
                    self.slopes = self.slopes + np.outer(surprise, moved) / (moved @ moved)
            if found.shape[1] > 1:
                self.slopes[:, self.nuisances :] = (
                    problem._span.T @ problem.white(found[:, 1:] - found[:, :1]) / self._steps
                )
            self.last = self.tried, residual
            if cost < self.cost:
                self.point, self.cost, self.residual = self.tried, cost, residual
                self.reach = min(1.0, 2.0 * self.reach)
            else:
                self.reach *= 0.4
        else:
            self.reach *= 0.3
        if np.isfinite(self.cost):
            self.tried = self.point + self.reach * self._step()

    def _step(self) -> Floats:
        """To the least cost of the linear model within the ranges of the places."""
        n = self.nuisances
        u, z = self.point[:n], self.point[n:]
        target = np.concatenate([self.residual, -u])
        slopes = np.vstack([self.slopes, np.eye(n, len(self.point))])
        if not z.size:
            return np.linalg.lstsq(slopes, target, rcond=None)[0]
        low = np.concatenate([np.full(n, -np.inf), -z - 1e-9])
        high = np.concatenate([np.full(n, np.inf), 1.0 - z + 1e-9])
        step = lsq_linear(slopes, target, (low, high)).x
        step[n:] = np.clip(step[n:], -z, 1.0 - z)
        return step

    def weighed(self) -> Hypothesis:
        """With Laplace's evidence: nuisances are integrated out, places count by their share of their range."""
        u, z = np.split(self.point, [self.nuisances])
        log_evidence = -0.5 * self.cost
        covariance = np.empty((0, 0))
        if z.size:
            jacobian, slopes = np.split(self.slopes, [self.nuisances], axis=1)
            inner = np.eye(self.nuisances) + jacobian.T @ jacobian
            information = slopes.T @ slopes - (jacobian.T @ slopes).T @ np.linalg.solve(inner, jacobian.T @ slopes)
            log_evidence += _volume(z.tolist(), information)
            covariance = np.linalg.inv(information + PRIOR_INFORMATION * np.eye(len(z)))
        return Hypothesis(self.effects, log_evidence, tuple(map(float, z)), u, covariance, self.cost)


class Shift:
    """Cost of the shift of some axes together, −2 φ·b + φᵀ G φ with the spline weights φ of their places.

    Args:
        axes: Of one effect or of two.
        gram: G (n, n) over all their nodes.
        linear: b (n,).
    """

    def __init__(self, axes: Sequence[Axis], gram: Floats, linear: Floats):
        self.axes = axes
        self.gram = gram
        self.linear = linear
        self.starts = np.cumsum([0, *(len(axis.nodes) for axis in axes)])

    def grid(self) -> tuple[float, ...]:
        """Best place of each axis for itself, on a grid."""
        out = []
        for k, axis in enumerate(self.axes):
            mine = slice(self.starts[k], self.starts[k + 1])
            weights = axis.spline(axis.fine)
            cost = np.einsum("fi,ij,fj->f", weights, self.gram[mine, mine], weights) - 2.0 * weights @ self.linear[mine]
            out.append(float(axis.fine[int(np.argmin(cost))]))
        return tuple(out)

    def at(self, places: Floats) -> tuple[float, Floats, Floats]:
        """Cost, half its gradient (a,), and the information (a, a) at ``places`` (a,)."""
        weights = np.concatenate([axis.spline(z) for axis, z in zip(self.axes, places, strict=True)])
        slopes = np.zeros((len(self.axes), len(weights)))
        for k, (axis, z) in enumerate(zip(self.axes, places, strict=True)):
            slopes[k, self.starts[k] : self.starts[k + 1]] = axis.spline(z, 1)
        pull = self.gram @ weights - self.linear
        cost = float(weights @ (pull - self.linear))
        return cost, slopes @ pull, slopes @ self.gram @ slopes.T

    def descend(self, first: tuple[float, ...]) -> tuple[float, tuple[float, ...], Floats]:
        """Least cost near ``first``, its places, and the information there (Gauss–Newton within the ranges)."""
        places = np.array(first)
        cost, gradient, information = self.at(places)
        reach = 1.0
        for _ in range(20):
            damped = information + 1e-9 * np.eye(len(places))
            tried = np.clip(places - reach * np.linalg.solve(damped, gradient), 0.0, 1.0)
            new = self.at(tried)
            if new[0] < cost:
                done = cost - new[0] < 1e-3
                places, (cost, gradient, information) = tried, new
                reach = min(1.0, 2.0 * reach)
                if done:
                    break
            else:
                reach *= 0.3
        return cost, tuple(map(float, places)), information


def _volume(places: Sequence[float], information: Floats) -> float:
    """Log of the share of a uniform prior over the ranges that a best fit's normal occupies (Laplace)."""
    if not len(places):
        return 0.0
    z = np.array(places)
    covariance = np.linalg.inv(information + PRIOR_INFORMATION * np.eye(len(z)))
    std = np.sqrt(np.diag(covariance))
    inside = ndtr((1.0 - z) / std) - ndtr(-z / std)
    return float(0.5 * np.linalg.slogdet(2.0 * np.pi * covariance)[1] + np.sum(np.log(np.maximum(inside, 1e-12))))


def attribute(problem: Problem, progress: Progress = lambda sentence, share: None) -> list[Hypothesis]:
    """All hypotheses with their probabilities, the likeliest first; ``("unknown",)`` is something else."""
    problem.learn(lambda sentence, share: progress(sentence, 0.4 * share))
    screened = problem.screen()
    log_prior = _log_priors(list(screened))
    ranked = sorted(screened, key=lambda effects: -(screened[effects][0] + log_prior[effects]))
    pairs = [effects for effects in ranked if len(effects) == 2][:PAIRS]
    chosen = [*(effects for effects in ranked if len(effects) < 2), *pairs]
    first = problem.refine(
        [(effects, screened[effects][1]) for effects in chosen],
        lambda sentence, share: progress(sentence, 0.4 + 0.3 * share),
    )
    # a valley that one has found is shown to all: no hypothesis may win because another was lost on its way
    best = min(first, key=lambda h: h.cost)
    found = dict(zip(best.effects, problem.apart(best), strict=True))
    again = []
    for h in first:
        own = dict(zip(h.effects, problem.apart(h), strict=True))
        again.append((h.effects, tuple(place for name in h.effects for place in found.get(name, own[name]))))
    second = problem.refine(again, lambda sentence, share: progress(sentence, 0.7 + 0.3 * share), best.nuisances)
    kept: dict[tuple[str, ...], Hypothesis] = {}
    for h in [*first, *second]:
        if h.effects not in kept or h.cost < kept[h.effects].cost:
            kept[h.effects] = h
    hypotheses = list(kept.values())
    unknown = Hypothesis(("unknown",), problem.surprise())
    everything = [*hypotheses, unknown]
    log_prior[("unknown",)] = np.log(PRIOR["unknown"])
    logs = np.array([h.log_evidence + log_prior[h.effects] for h in everything])
    probabilities = np.exp(logs - logsumexp(logs))
    weighed = [
        Hypothesis(h.effects, h.log_evidence, h.places, h.nuisances, h.covariance, h.cost, float(p))
        for h, p in zip(everything, probabilities, strict=True)
    ]
    return sorted(weighed, key=lambda h: -h.probability)


def _log_priors(hypotheses: Sequence[tuple[str, ...]]) -> dict[tuple[str, ...], float]:
    singles = sum(len(h) == 1 for h in hypotheses)
    pairs = sum(len(h) == 2 for h in hypotheses)
    share = {
        0: PRIOR["nothing"],
        1: PRIOR["single"] / max(singles, 1),
        2: PRIOR["pair"] / max(pairs, 1),
    }
    return {h: float(np.log(share[len(h)])) for h in hypotheses}
