"""The best fit of one hypothesis with the twin itself, in its nuisances and in the magnitudes of its effects.

It begins with slopes that all hypotheses share, and takes its own in the directions that matter most: what a parameter does
depends on what else is wrong.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from aoro_gym.diagnosis.axes import PRIOR_INFORMATION, volume
from aoro_gym.diagnosis.linear import Beside, Hypothesis, Linear, Tangent
from aoro_gym.diagnosis.noise import Floats
from aoro_gym.diagnosis.problem import LARGEST_STEP, STEP, STRAIGHT, Problem, Progress
from aoro_gym.diagnosis.replay import COARSE, USUAL, Steps, Variants

SETTLED = 0.5
"""Change of the whitened squares by which a search ends."""
SETTLE = 3
"""Rounds of a stage of the fit of nuisances alone, under the twin's own error."""
DAMPING = (0.0, 10.0, 1e2, 1e3, 1e4, 1e6)
"""Of the steps that are tried together, in prior precisions (Levenberg 1944, Marquardt 1963): what moves the prediction by
many noise lengths goes on, what hardly moves it stays, and a curved valley is followed."""
FIRST = (0.0, 100.0)
"""The same of the steps that a search begins with; not to move at all is tried, too."""
LEAST = 1e-6
"""Precision of a place: keeps it where nothing tells."""
AXIS_STEP = 0.01
"""Finite-difference step of places."""
CHORDS = 4
"""Steps that follow one another on the slopes of one point, as each also tells how these change (Broyden 1965), where there
are so many slopes that steps cost far less."""
MANY = 8 * len(DAMPING)
"""Directions of slopes along which steps follow one another."""
SHORTENED = 0.3
"""Share of a step along a direction that must be left within the ranges."""
TRADED = 3
"""Others whose points a search tries."""
ALL = 10_000
"""Directions: all that tell anything."""


class Search:
    """Damped Gauss–Newton steps of one hypothesis: nuisances u (standard deviations) and places z of its axes. In turn it
    asks for slopes at its best point, and tries steps from there.

    Args:
        linear: Of the hypothesis's problem.
        effects: Of the hypothesis.
        starts: Places to begin with, of which the best is followed.
        leader: Hypothesis of one effect to begin at; by default the centre of the problem.
        directions: Along which slopes are taken at every point: those of the nuisances in which the prediction moves most.
            Along the others it keeps those that it began with.
    """

    def __init__(
        self,
        linear: Linear,
        effects: tuple[str, ...],
        starts: Sequence[tuple[float, ...]] = ((),),
        leader: Beside | None = None,
        directions: int = 0,
    ):
        self.linear = linear
        self.effects = effects
        self.directions = directions
        begun = None if leader is None else leader.leader
        self.tangent = linear.tangent if begun is None or begun.tangent is None else begun.tangent
        centre = linear.problem.centre
        firsts = [centre] if begun is None else [begun.nuisances, centre]
        self._tried: list[tuple[Floats, Floats]] = []
        self._offers: list[tuple[Floats, Floats, Tangent]] = []  # what others found, with the tangent there
        for places in starts:
            z = np.clip(np.array(places, dtype=np.float64), 0.0, 1.0)
            left = self._expected(z, leader)
            self._tried += [(u, z) for u in (*self.tangent.steps(left, FIRST, firsts[0]), *firsts)]
        self.point = self._tried[0]
        """Best nuisances and places so far."""
        self.cost = np.inf
        self.residual: Floats = np.empty(0)
        """Whitened (D,), at ``point``."""
        self.slopes: Floats = np.zeros((len(linear.residual), len(self.point[1])))
        """Whitened (D, axes), by the places."""
        self.done = False
        self.trying = True
        """Whether steps are next, not slopes."""
        self._learned = -1  # directions of the slopes that were taken at ``point``
        self._chords = 0  # steps since then
        self._dampings = DAMPING  # of the steps that are tried

    def _expected(self, z: Floats, leader: Beside | None) -> Floats:
        """Residual (D,) that is left to the nuisances where effects do what they do beside the leader, or around the
        centre."""
        if leader is not None:
            return leader.left(self.effects, z)
        return self.linear.residual - sum(self.linear.shift(self.effects, z), np.zeros(len(self.linear.residual)))

    def begin_at(self, nuisances: Floats, places: Floats) -> None:
        """Begin with this point alone."""
        self._tried = [(nuisances, places)]

    def resume(self) -> None:
        """Go on, if there is more to be learned."""
        self.done &= self._learned >= self.directions
        self.trying = self._learned >= self.directions or not np.isfinite(self.cost)

    def offered(self, donors: Sequence[Search]) -> None:
        """Try what others found next: their nuisances, with the places of what both have. What a donor that is a part of
        this hypothesis lacks is left out, lest the whole be worse than its part; and where slopes are alike, nuisances also
        make up for what the donor has beside this hypothesis, and give way to what this one has beside the donor."""
        self._offers = []
        for donor in donors:
            # slopes of other nuisances, or whitened otherwise, are none of this one's
            alike = donor.linear is self.linear
            nuisances = donor.nuisances_of(self.linear.problem)
            tangent = donor.tangent if alike else self.tangent
            theirs, mine, none = donor.places_by_effect, self.places_by_effect, self.none
            part = theirs.keys() <= mine.keys()
            kept = [theirs.get(name, none[name] if part else place) for name, place in mine.items()]
            self._offers.append((nuisances, np.clip(np.concatenate([np.empty(0), *kept]), 0.0, 1.0), tangent))
            if alike and theirs.keys() != mine.keys():
                left = donor.residual + tangent.moved(nuisances)
                left = left + donor.shift_of(theirs.keys() - mine.keys()) - self.shift_of(mine.keys() - theirs.keys())
                both = np.concatenate([np.empty(0), *(theirs.get(name, place) for name, place in mine.items())])
                self._offers += [(u, both, tangent) for u in tangent.steps(left, FIRST, nuisances)]

    @property
    def places_by_effect(self) -> dict[str, Floats]:
        """Places (axes,) of every effect at the best point."""
        counts = [len(self.linear.problem.axes[name]) for name in self.effects]
        return dict(zip(self.effects, np.split(self.point[1], np.cumsum(counts)[:-1]), strict=False))

    @property
    def none(self) -> dict[str, Floats]:
        """Places (axes,) at which each effect is absent."""
        axes = self.linear.problem.axes
        return {name: np.array([axis.none for axis in axes[name]]) for name in self.effects}

    def shift_of(self, names: Collection[str]) -> Floats:
        """What some of its effects do (D,), by the slopes at the best point."""
        none = self.none
        moved = [
            place - none[name] if name in names else np.zeros(len(place))
            for name, place in self.places_by_effect.items()
        ]
        return self.slopes @ np.concatenate([np.empty(0), *moved])

    def nuisances_of(self, problem: Problem) -> Floats:
        """The best ones (u,), in standard deviations of a ``problem`` with the same recordings around the same machine."""
        mine, u = self.linear.problem, self.point[0]
        if problem is mine:
            return u
        felt, moved = len(mine.felt), np.zeros(len(mine.nuisances.keys))
        moved[mine.felt] = mine.nuisances.std[mine.felt] * u[:felt]
        return np.concatenate([(moved / problem.nuisances.std)[problem.felt], u[felt:]])

    def variants(self) -> Variants:
        """Machines to be tried next, or the best one and its neighbours along every axis and along :attr:`directions`."""
        if self._offers:
            points, places, _ = zip(*self._offers, strict=True)
            points, places = np.stack(points), np.stack(places)
        elif self.trying:
            points, places = map(np.stack, zip(*self._tried, strict=True))
        else:
            u, z = self.point
            self._steps = np.where(z < 0.5, AXIS_STEP, -AXIS_STEP)
            self._moves = self._around(u)
            points = np.vstack([np.tile(u, (1 + len(z), 1)), u + self._moves])
            places = np.vstack([z, z + np.diag(self._steps), np.tile(z, (len(self._moves), 1))])
        return self.linear.problem.at(points, self.effects, places)

    def _around(self, u: Floats) -> Floats:
        """Steps (k, u) along which slopes are taken."""
        problem = self.linear.problem
        felt = len(problem.felt)
        along, sizes = self.tangent.directions(felt, self.directions)
        farthest = np.max(np.abs(along[:, :felt]) * problem.nuisances.std[problem.felt], axis=1, initial=0.0)
        steps = along * np.minimum(np.minimum(STEP, STRAIGHT / sizes), LARGEST_STEP / farthest)[:, None]
        low, high = self.tangent.bounds
        forward, backward = (np.clip(u + sign * steps, low, high) - u for sign in (1.0, -1.0))
        kept = [np.linalg.norm(moved, axis=1) for moved in (forward, backward)]
        moves = np.where((kept[0] >= kept[1])[:, None], forward, backward)
        return moves[np.maximum(*kept) > SHORTENED * np.linalg.norm(steps, axis=1)]

    def learn(self, white: Floats) -> None:
        """Take in whitened residuals (D, N) of the machines that were tried, NaN of those that were lost, and choose what is
        next."""
        lost = np.isnan(np.sum(white, axis=0))
        if self._offers:
            offers, self._offers = self._offers, []
            best, gain = self._compared([offer[:2] for offer in offers], white, lost)
            if gain > SETTLED:
                self.tangent = offers[best][2]
                self._go(offers[best][:2], white[:, best])
        elif self.trying:
            best, gain = self._compared(self._tried, white, lost)
            fresh = self._learned >= self.directions
            if gain > 0.0:
                before = self.point, self.residual
                self._go(self._tried[best], white[:, best])
                self.done = fresh and gain < SETTLED
                if SETTLED <= gain < np.inf and self._chords < CHORDS and self.directions >= MANY:
                    self._chords += 1
                    near = DAMPING.index(self._dampings[best])
                    self._dampings = DAMPING[max(near - 1, 0) : near + 2]
                    self._bend(*before)
                    self.trying = self._step() > SETTLED
            else:
                self.done = fresh or not np.isfinite(self.cost)
                self.trying = False
        else:
            z, lost = self.point[1], lost[1:] | lost[0]
            changes = white[:, :1] - white[:, 1:]
            self.slopes = np.where(lost[: len(z)], self.slopes, changes[:, : len(z)] / self._steps)
            known = ~lost[len(z) :]
            if np.any(known):
                self.tangent = self.tangent.updated(self._moves[known], changes[:, len(z) :][:, known])
            self._learned, self.trying, self._chords, self._dampings = self.directions, True, 0, DAMPING
            self.done = self._step() < SETTLED

    def _bend(self, before: tuple[Floats, Floats], residual: Floats) -> None:
        """Change slopes by what a step from the point ``before``, with its ``residual`` (D,), has done beside what they
        promised: that of the nuisances as a share of the whole, both measured by their priors."""
        moved, along = self.point[0] - before[0], self.point[1] - before[1]
        promised = self.tangent.moved(moved)
        missed = residual - self.residual - promised - self.slopes @ along
        of_nuisances, of_places = moved @ self.tangent.precision @ moved, PRIOR_INFORMATION * along @ along
        if of_nuisances > 0.0:
            share = of_nuisances / (of_nuisances + of_places)
            self.tangent = self.tangent.updated(moved[None], (promised + share * missed)[:, None])
        if of_places > 0.0:
            self.slopes = self.slopes + np.outer(missed, PRIOR_INFORMATION * along / (of_nuisances + of_places))

    def _left(self, white: Floats, nuisances: Floats) -> Floats:
        """Residual (D,) less the recordings' own part."""
        return white - self.linear.own @ nuisances[len(self.linear.problem.felt) :]

    def _compared(self, points: Sequence[tuple[Floats, Floats]], white: Floats, lost: Floats) -> tuple[int, float]:
        """The best of several points, and by how much it is better than what was best before."""
        costs = [np.inf if lost[k] else self._cost(self._left(white[:, k], u), u) for k, (u, _) in enumerate(points)]
        best = int(np.argmin(costs))
        return best, -np.inf if lost[best] else self.cost - costs[best]

    def _go(self, point: tuple[Floats, Floats], white: Floats) -> None:
        """Make a point that was tried, with its whitened residual (D,), the best one."""
        self.point = point
        self.residual = self._left(white, point[0])
        self.cost = self._cost(self.residual, point[0])
        self._learned = -1
        self.trying = self.done = False

    def _cost(self, left: Floats, nuisances: Floats) -> float:
        return float(left @ left + nuisances @ self.tangent.precision @ nuisances)

    def _step(self) -> float:
        """Choose steps that are to be tried; what the longest should gain."""
        u, z = self.point
        # places have no prior but their range
        together = self.tangent.beside(self.slopes, LEAST, (-z, 1.0 - z), PRIOR_INFORMATION)
        target = self.residual + self.tangent.moved(u)
        steps = together.steps(target, self._dampings, np.append(u, np.zeros(len(z))))
        self._tried = [(x[: len(u)], np.clip(z + x[len(u) :], 0.0, 1.0)) for x in steps]
        left = target - together.moved(steps[0])
        return self.cost - self._cost(left, steps[0][: len(u)])

    def weighed(self) -> Hypothesis:
        """With Laplace's evidence: nuisances are integrated out, places count by their share of their range. What the data
        leave of the prior of the nuisances counts as at the centre for all hypotheses alike."""
        tangent = self.tangent
        u, z = self.point
        log_evidence = -0.5 * self.cost + self.linear.tangent.shrunk - self.linear.log_volume
        covariance = np.empty((0, 0))
        if z.size:
            information = tangent.projected(self.slopes, self.slopes)
            pull = tangent.projected(self.slopes, self.residual + tangent.moved(u))
            held = np.where(z <= 0.0, np.minimum(pull, 0.0), np.where(z >= 1.0, np.maximum(pull, 0.0), 0.0))
            log_evidence += volume(z.tolist(), information, held)
            covariance = np.linalg.inv(information + PRIOR_INFORMATION * np.eye(len(z)))
        places = tuple(map(float, z))
        return Hypothesis(
            self.effects, log_evidence, places, u, covariance, self.cost, self.residual, self.slopes, tangent, True,
            misfit=self.linear.misfit(self.residual),
        )  # fmt: skip


def refine(
    searches: Sequence[Search],
    rounds: int,
    progress: Progress = lambda sentence, share: None,
    *,
    slopes: Steps = COARSE,
) -> None:
    """Take every search, of problems with the same recordings, as far as so many rounds of ``slopes`` and steps do, all in
    the same launches."""
    for search in searches:
        search.resume()
    _launch([search for search in searches if not np.isfinite(search.cost)])
    for step in range(rounds):
        progress("refining", step / rounds)
        _launch([search for search in searches if not (search.done or search.trying)], slopes)
        for _ in range(1 + CHORDS):
            _launch([search for search in searches if not search.done and search.trying])


def _launch(searches: Sequence[Search], steps: Steps = USUAL) -> None:
    if not searches:
        return
    batch = [search.variants() for search in searches]
    linear = searches[0].linear
    white = linear.problem.residuals(linear.whiteners, batch, steps)
    ends = np.cumsum([one.count for one in batch])
    for search, mine in zip(searches, np.split(white, ends[:-1], axis=1), strict=True):
        search.learn(mine)


def trade(searches: Sequence[Search], wider: Search | None = None) -> None:
    """Every search tries what the best others found, and the best of those that are parts of it or that it is a part of: no
    hypothesis may lose for want of a way that another went, and the more effects, the better the fit. One of a ``wider``
    prior, without effects, tries them, too."""
    ranked = sorted((one for one in searches if np.isfinite(one.cost)), key=lambda one: one.cost)
    for one in ranked:
        others = [other for other in ranked if other is not one]
        mine = set(one.effects)
        kin = [other for other in others if mine <= set(other.effects) or mine >= set(other.effects)]
        one.offered(list(dict.fromkeys([*others[:TRADED], *kin[:TRADED]])))
    trading = ranked if len(ranked) > 1 else []
    if wider is not None and np.isfinite(wider.cost) and ranked:
        plain = [one for one in ranked if not one.effects]
        wider.offered(list(dict.fromkeys([*plain, *ranked[:TRADED]])))
        trading = [*trading, wider]
    _launch(trading)
