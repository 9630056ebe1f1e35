"""Which effect: the evidence for nothing, for each effect, each pair, other calibration, and what the catalogue lacks.

All hypotheses see the same recordings, the same error of the twin and the same nuisances, whose prior is normal. The
linear model (:mod:`.linear`) says where their searches begin; they are refined with the twin itself (:mod:`.search`), the
likelier the further, nothing among them, and weighed by Laplace's method. What explains most if all adds up, one effect
or two, is searched afresh before it sees what others found; what goes with the likeliest effects is simulated beside
them, where their own searches have ended. Searches begin under a larger error of the twin, where a far cause is not
hidden behind oscillations that are out of step; once they have ended, the likeliest go on under a smaller one, which lets
pressures sway less otherwise than the twin's do, and are weighed by that. Other calibration is nothing with wider priors.
*Unknown* is something beside any of these, which shows in that none of them fits as well as the right cause does
elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import lsq_linear
from scipy.special import logsumexp
from scipy.stats import chi2, expon, norm

from aoro_gym.diagnosis.axes import Axis
from aoro_gym.diagnosis.cross_entropy import Population, evolve
from aoro_gym.diagnosis.linear import Beside, Hypothesis, Linear, Misfit
from aoro_gym.diagnosis.noise import Floats
from aoro_gym.diagnosis.problem import Problem, Progress
from aoro_gym.diagnosis.replay import USUAL
from aoro_gym.diagnosis.result import CALIBRATION, UNKNOWN
from aoro_gym.diagnosis.search import ALL, EASED, ROUGH, Search, alone, firmer, refine, trade

DIRECTIONS = 12, 24
"""Of the nuisances in which a hypothesis takes slopes of its own: at first, and later."""
VALLEYS = 2
"""Of the cost along an effect's magnitude, in which its search begins."""
FAR_OFF = (0.4, 0.9)
"""Shares of the way to an end of a range, from whose better one a search begins besides: what calibration makes of a far
cause only a search tells that has gone there."""
RIVALS = 2
"""Searches of each effect that go on from there."""
FRESH, SHOWN = 4, 50.0
"""Effects, and pairs, that are searched afresh (:meth:`.Linear.likely`), and the squares by which they must explain more."""
STRONGER = (1.0, 1.5)
"""Factors on their sizes with which these searches begin: if what effects do adds up, calibration makes up for too much of
them, and a deeper valley may lie farther off."""
APART = 0.05
"""Distance between their places."""
SINGLES = 12
"""Hypotheses of one effect that are likely."""
LEADERS, PARTNERS = 3, 5
"""The likeliest of one effect, which also make pairs with one another, and other partners of each."""
NEAR, AHEAD = 100.0, 0.1
"""Log odds behind the likeliest beyond which an effect does not lead, before its search has ended, and in shares of what the
likeliest has before nothing."""
PAIRS = 8
"""Hypotheses of two effects that are likely."""
MOST = 8
"""Hypotheses that may have a chance."""
FINALISTS, CLOSE = 4, 0.02
"""Of them, those that take all slopes anew, and how likely these must be beside the likeliest."""
STRAINED, AGAIN, ASIDE = 1.0, 2, 0.12
"""Strain of the likeliest hypothesis from which its search is doubted, those of one effect and of two that are searched
again by other ways, and how far beside their places."""
FAR = (0.15, 0.5, 0.85)
"""Shares of the way to an end of a range where searches begin once all others have failed, and those of a partner."""
FARTHER = 20.0
"""Whitened squares by which the likeliest effect must have come down for its partners to be looked for again."""
ROAMING, CROWD, ROUNDS = 3, 48, 8
"""Once all have failed: of the likeliest hypotheses of one effect and of two, those that a population of so many machines
goes on from, and its generations."""
SWAYS = 0.1
"""Least factor on the assumed error of how pressures sway (``ModelError.sways``) under which hypotheses are weighed,
where the twin errs as usual; else it goes by the square of its error. Searches need more of it to end in the right valley,
but what is in it tells more (E, machines of the development family)."""
FIRM = 7
"""Hypotheses that go on under it."""
CHANCE = 25.0
"""Log odds behind the best beyond which a hypothesis has none."""
SOFT = 3.0
"""Factor on the twin's own error under which searches begin."""
PRIOR = {"nothing": 0.40, "single": 0.33, "pair": 0.17, UNKNOWN: 0.05, CALIBRATION: 0.05}
"""Prior probabilities of the kinds of hypotheses; within a kind all are equally likely. Of two machines that something is
wrong with, one has a second thing wrong (a judgement, in the proportion of the blind check's standard suite)."""


class Fit(NamedTuple):
    """How well the right cause fits a kind of channel: its whitened residual has the mean square
    noise · n + error · (1 − n) + law · e where noise alone has n, the twin's own error is the rest of what was assumed, and
    the cause explains e."""

    noise: float
    """Share that is left of the noise."""
    error: float
    """Share that is left of the twin's own error."""
    spread: float
    """Standard deviation of the logarithm."""
    law: float = 0.0
    """Share of what the cause explains that is left: the twin's law of an effect is not quite the machine's."""

    def erring(self, power: float) -> Fit:
        """That of a twin that errs by ``power``, a square, of what is usual."""
        return self._replace(error=min(power * self.error, 1.0))

    def ratio(self, misfit: Misfit, explained: float = 0.0) -> float:
        """By how much more is left than what is usual where so much of the mean square is ``explained``."""
        usual = self.noise * misfit.noise + self.error * (1.0 - misfit.noise) + self.law * explained
        return misfit.square / usual


@dataclass(frozen=True)
class Trust:
    """How far what logs say is believed.

    Attributes:
        temperature: By which fits count less: samples are not as many as they seem, as the twin's own error is not that of
            its model.
        doubt: Share of the evidence for a gap by which the temperature grows: no effect of the twin is quite that of a
            machine with other laws.
        strain: Factor with which it also grows by the strain of the likeliest hypothesis over what is usual: parameters are
            bent so far from where they should have stayed because a law is not the machine's.
        usual: Strain where the cause is right.
        others: Factor with which it also grows by what all other effects would explain beside the likeliest hypothesis,
            over what chance has them explain: as they cannot all be there, so much do they make up for the twin's own error.
        half: Evidence for a gap [nats] at which half of what these two add counts: they say that a cause may be another one,
            not whether there is any, which the little evidence of healthy machines tells.
        bent: What they add (:meth:`beside`).
        fit: What the right cause leaves, by kind of channel.
        surprise: Mean of the logarithm by which that is larger where something unknown shows.
        declared: Probability that the declared set of causes holds the truth.
        sharpness: Power of all probabilities: how sure they may be.
        laws: Standard deviation of the logarithm of a size, beside what logs leave open: the twin finds the size of an
            effect in its own laws, which are not the machine's.
    """

    temperature: float
    doubt: float
    fit: Mapping[str, Fit] = field(default_factory=dict)
    surprise: Mapping[str, float] = field(default_factory=dict)
    declared: float = 0.95
    sharpness: float = 1.0
    strain: float = 0.0
    usual: float = 1.0
    others: float = 0.0
    half: float = 1.0
    bent: float = 0.0
    laws: float = 0.25

    def beside(self, likeliest: Beside) -> Trust:
        """The same where this is the likeliest hypothesis, and what others do beside it."""
        bent = self.strain * max(likeliest.leader.strain / self.usual - 1.0, 0.0)
        if self.others:
            bent += self.others * max(likeliest.excess - 1.0, 0.0)
        return replace(self, bent=bent)


TRUST: Mapping[str, Trust] = {
    "angle": Trust(
        1.0, 0.016, {"angle": Fit(0.70, 0.50, 0.12)}, {"angle": 0.2}, declared=0.65, sharpness=0.45, strain=1.0, usual=0.2,
        laws=0.1,
    ),
    "pressure": Trust(
        1.2, 0.0003, {"angle": Fit(0.76, 0.10, 0.11, 0.3), "pressure": Fit(0.75, 0.016, 0.11, 0.3)},
        {"angle": 0.4, "pressure": 0.85}, declared=0.75, sharpness=0.55, strain=16.0, usual=0.42, others=0.25,
        half=200.0, laws=0.12,
    ),
    "day-one": Trust(
        9.0, 0.008, {"angle": Fit(0.89, 0.89, 0.25), "pressure": Fit(0.31, 0.31, 0.44)}, {"angle": 0.165, "pressure": 1.0},
        sharpness=0.4, laws=0.6,
    ),
}  # fmt: skip
"""By the kind of channel that tells most, pressures wherever they were logged, then also by whether there are healthy logs
that say how much the twin errs (E: the likeliest for machines of the development family)."""
USUAL_MISFIT: Mapping[str, float] = {"angle": 4.0, "pressure": 0.06}
"""Factor on the assumed error of the twin (:meth:`~aoro_gym.diagnosis.problem.Problem.misfits`) up to which samples are as
many as they seem, and at which doubt is as said."""
HOTTEST = 8.0
"""Most that the temperature grows by that (E, machines of the development family, which err by 0.25 at most)."""


def trust_of(problem: Problem) -> Trust:
    """That of a problem's channels. Temperature, to its end, doubt, and what pressures leave go by the square of the twin's
    error, as the healthy logs show it; where there are none, it errs as usual, and parameters may lie anywhere."""
    kinds = {problem.kinds[name] for name in problem.signals if name in problem.kinds}
    kind = "pressure" if "pressure" in kinds else "angle"
    usual, power = TRUST[kind], power_of_error(problem, kind)
    if power is None:
        return TRUST["day-one"] if kind == "pressure" else replace(usual, strain=0.0)
    fit = {name: one.erring(power) if name == kind == "pressure" else one for name, one in usual.fit.items()}
    hotter = min(max(power, 1.0), HOTTEST)
    return replace(usual, temperature=usual.temperature * hotter, doubt=usual.doubt * power, fit=fit)


def power_of_error(problem: Problem, kind: str) -> float | None:
    """Square of what the twin errs in a kind of channel, over the usual, as the healthy logs show it, if there are any."""
    errs = [factor for name, factor in problem.misfit.items() if problem.kinds.get(name) == kind]
    return (float(np.median(errs)) / USUAL_MISFIT[kind]) ** 2 if errs else None


def attribute(
    problem: Problem, trust: Trust, progress: Progress = lambda sentence, share: None
) -> tuple[list[Hypothesis], Linear]:
    """All hypotheses of a learned problem with their probabilities, the likeliest first, and the linear model that they
    were found with."""
    linear = Linear(problem, problem.error)
    soft, eased = (Linear(problem, problem.error.scaled(factor)) for factor in (SOFT, EASED))
    prior = log_priors(problem.axes)
    other = other_calibration(problem)
    searches: dict[tuple[str, ...], Search] = {(): Search(linear, (), directions=ALL)}
    few, many = DIRECTIONS
    anew: set[tuple[str, ...]] = set()
    tried: set[tuple[str, ...]] = set()

    def after(effects: Iterable[tuple[str, ...]], rounds: int, directions: int, share: float) -> list[Hypothesis]:
        """Hypotheses after some more rounds, the likeliest first; nothing and other calibration come along."""
        those = [searches[e] for e in dict.fromkeys(effects) if e]
        for one in those:
            one.directions = max(one.directions, directions)
        refine([*those, searches[()], other], rounds, lambda s, x: progress(s, share + 0.05 * x))
        trade([*those, searches[()]], other)
        return _likeliest(one.weighed() for one in those if np.isfinite(one.cost))

    def begin(found: Iterable[Search]) -> list[tuple[str, ...]]:
        """New searches; of those that were begun before, the better one is kept."""
        new = []
        for one in found:
            old = searches.get(one.effects)
            if old is None or one.cost < old.cost:
                searches[one.effects] = one
                new.append(one.effects)
        return new

    def paired(leaders: Sequence[Hypothesis], share: float) -> None:
        """Pairs of leaders and what goes best with them, or does best alone: from where the leader has come to, and from the
        beginning, as what calibration did in a partner's stead is in the way of both."""
        found: list[Search] = []
        begun: list[Search] = []
        least = searches[()].weighed().log_evidence + CHANCE
        singles = [h for h in ranked(1)[:LEADERS] if h.log_evidence > least]
        able = {name for h in singles for name in h.effects}
        for ahead in linear.beside(leaders):
            for rank, (effects, places) in enumerate(ahead.partners()):
                if rank >= PARTNERS and not able.issuperset(effects):
                    continue
                starts = [places, _together(searches, ahead.leader, effects)]
                at_none, *far = _beside(problem.axes, ahead.leader, effects, (0.0, *FAR))
                found.append(Search(linear, effects, [*starts, at_none], ahead, directions=few))
                if effects not in tried:
                    tried.add(effects)
                    begun.append(Search(eased, effects, [*starts, *far], directions=few))
        refine(begun, 1)
        both = [*found, *firmer(begun, linear)]
        refine(both, 0)
        new = begin(both)
        after([h.effects for h in after(new, 1, few, share)[:PAIRS]], 2, many, share + 0.05)

    def slight(share: float) -> None:
        """What goes best beside nothing, from where that has come to: what hardly shows is lost among slopes that are few,
        or of elsewhere."""
        found = [
            Search(linear, e, [places, *_beside(problem.axes, ahead.leader, e, (0.0,))], ahead, directions=few)
            for ahead in linear.beside([searches[()].weighed()])
            for e, places in ahead.partners()[:SINGLES]
        ]
        refine(found, 0)
        after(begin(found), 2, many, share)

    def settled(new: Sequence[Search], under: Linear, share: float) -> list[Search]:
        """Where searches under the eased error come to ``under`` a problem's own."""
        refine(new, 1, lambda s, x: progress(s, share + 0.02 * x))
        firm = firmer(new, under)
        refine(firm, 1, lambda s, x: progress(s, share + 0.02 + 0.02 * x))
        return firm

    def best_settled(found: Iterable[Search], share: float) -> list[Search]:
        """Where the best of each hypothesis comes to under a problem's own error. It goes on with the slopes that it has."""
        best = {one.effects: one for one in sorted(found, key=lambda one: -one.cost)}
        firm = settled(list(best.values()), linear, share)
        for one in firm:
            one.directions = few
        return firm

    def descend(found: Sequence[Hypothesis], share: float) -> None:
        """Each of what was ``found``, once, from the beginning: another way down may end lower."""
        new = [Search(eased, h.effects, [h.places], directions=ALL) for h in found if h.effects not in anew]
        anew.update(one.effects for one in new)
        begin(settled(new, linear, share))

    def afresh(share: float) -> None:
        """What may be all that is wrong, one effect or two, from where the machine's parameters have stayed: with all slopes
        of its own at once, before it sees what others found. A valley in which calibration makes up for a cause is one that
        few slopes do not lead out of."""
        likely = soft.likely(FRESH, SHOWN)
        anew.update(likely)
        new = [
            Search(eased, effects, [_scaled(problem.axes, effects, at, factor) for at in places], directions=ALL)
            for effects, places in likely.items()
            for factor in STRONGER
        ]
        refine(new, 1, lambda s, x: progress(s, share + 0.01 * x))
        begin(best_settled(new, share + 0.01))

    def by_other_ways(share: float) -> None:
        """The likeliest causes once more from where the machine's parameters have stayed, down from a rough error and an
        eased one, and from places beside: where parameters are strained, they may make up for what a search has missed."""
        likely = [*ranked(1)[:AGAIN], *ranked(2)[:AGAIN]]
        rough = Linear(problem, ROUGH)
        new = [Search(rough, h.effects, [h.places], directions=ALL) for h in likely]
        refine(new, 1, lambda s, x: progress(s, share + 0.01 * x))
        new = firmer(new, eased)
        for h in likely:
            aside = (-ASIDE, 0.0, ASIDE) if len(h.places) == 1 else (0.0,)
            new += [Search(eased, h.effects, [tuple(z + step for z in h.places)], directions=ALL) for step in aside]
        refine(new, 1, lambda s, x: progress(s, share + 0.01 + 0.01 * x))
        begin(best_settled(new, share + 0.02))

    def roam(found: Sequence[Hypothesis], share: float) -> None:
        """The likeliest causes, and other calibration, from where populations come to."""
        singles, pairs = ([h.effects for h in found if h.effects in searches and len(h.effects) == n] for n in (1, 2))
        crowds = [Population(problem, e, searches[e].point, CROWD) for e in [*singles[:ROAMING], *pairs[:ROAMING]]]
        evolve(crowds, ROUNDS, lambda s, x: progress(s, share + 0.04 * x))
        wide = Population(other.linear.problem, start=other.point)
        evolve([wide], progress=lambda s, x: progress(s, share + 0.04 + 0.02 * x))

        def goes_on(one: Population, under: Linear) -> Search:
            search = Search(under, one.effects, [tuple(one.best[1])], directions=ALL)
            search.begin_at(*one.best)
            return search

        begin(settled([goes_on(one, eased) for one in crowds], linear, share + 0.06))
        alike = other.linear.problem
        wider = Linear(alike, alike.error.scaled(EASED))
        trade(settled([goes_on(wide, wider)], other.linear, share + 0.08), other)

    def leading(found: Sequence[Hypothesis], margin: float) -> list[Hypothesis]:
        """Those that may come out ahead; one, where none is far before nothing."""
        nothing = searches[()].weighed().log_evidence
        best = max((h.log_evidence for h in found), default=nothing)
        least = best - max(margin, AHEAD * (best - nothing))
        return [h for h in found[: LEADERS if best > nothing + CHANCE else 1] if h.log_evidence >= least]

    def near_nothing() -> bool:
        """Whether no effect has left nothing so far behind that what goes best beside that does not matter."""
        nothing = searches[()].weighed().log_evidence
        return all(h.log_evidence < nothing + NEAR for h in ranked(1)[:1])

    def weighed() -> list[Hypothesis]:
        return [one.weighed() for one in searches.values() if np.isfinite(one.cost)]

    def ranked(count: int) -> list[Hypothesis]:
        """Of so many effects, the likeliest first."""
        return _likeliest(h for h in weighed() if len(h.effects) == count)

    def deserved(likeliest: Hypothesis) -> Trust:
        """Where this is the likeliest hypothesis; what others do beside it is taken to be what they do at the centre."""
        axes = {name: mine for name, mine in problem.axes.items() if name not in likeliest.effects}
        return trust.beside(Beside(likeliest, tuple(problem.axes), axes, linear.shifts))

    def believed(found: Sequence[Hypothesis], wide: Search | None = None, under: Linear = linear) -> list[Hypothesis]:
        """Weighed, beside other calibration where its search is given, with as much trust as the likeliest deserves."""
        likeliest = max(found, key=lambda h: h.log_evidence)
        here = deserved(likeliest)
        if wide is not None and np.isfinite(wide.cost):
            loose = other.weighed()

            def calibration(temperature: float) -> Hypothesis:
                return replace(_calibration(wide, under, temperature), misfit=loose.misfit)

            first = calibration(here.temperature)
            if first.log_evidence > likeliest.log_evidence:
                here = deserved(loose)
            found = [*found, calibration(tempering([*found, first], here))]
        return weigh(found, prior, here)

    def firmly(found: list[Hypothesis]) -> list[Hypothesis]:
        """``found``, weighed where pressures sway less otherwise than the twin's do: the likeliest by what they come to
        there, the others as far from nothing as they were. How well they fit, and where, is as it was."""
        power = power_of_error(problem, "pressure")
        if power is None or SWAYS * power >= problem.error.sways:
            return found
        progress("weighing", 0.97)
        error = replace(problem.error, sways=SWAYS * power)
        firm = Linear(problem, error)
        likely = [h.effects for h in found if h.effects in searches and h.effects][:FIRM]
        new = firmer([searches[e] for e in ((), *likely)], firm)
        wide = firmer([other] if np.isfinite(other.cost) else [], Linear(other.linear.problem, error))
        for one in new:
            one.directions = ALL
        refine([*new, *wide], 2, slopes=USUAL)
        trade(new, *wide)
        ends = {one.effects: one.weighed() for one in new}
        before, nothing = searches[()].weighed(), ends[()]

        def there(h: Hypothesis) -> Hypothesis:
            if h.effects in ends:
                evidence, cost = ends[h.effects].log_evidence, ends[h.effects].cost
            else:
                evidence = nothing.log_evidence + h.log_evidence - before.log_evidence
                cost = nothing.cost + h.cost - before.cost
            return replace(h, log_evidence=evidence, cost=cost)

        return believed([there(h) for h in weighed()], *wide, under=firm)

    def contend(share: float) -> list[Hypothesis]:
        """All that may have a chance to the end."""
        likely = [h for h in believed(weighed()) if h.effects and h.refined][:MOST]
        chosen = [h.effects for h in likely if h.probability > likely[0].probability * np.exp(-CHANCE)]
        parts = [(name,) for effects in chosen for name in effects]  # one of a pair may be all that there is
        after([*chosen, *parts], 2, many, share)
        last = [h for h in believed(weighed()) if h.effects and h.refined][:FINALISTS]
        last = [h for h in last if h.probability > CLOSE * last[0].probability]
        descend(last, share + 0.05)
        after([h.effects for h in last], 2, ALL, share + 0.1)
        return believed(weighed(), other)

    searches[()].offered([alone(problem, 1)])
    first = [Search(soft, (name,), places) for name, places in soft.starts(VALLEYS).items()]
    first += [Search(soft, (name,), way) for name, axes in problem.axes.items() for way in ways_of(axes, FAR_OFF)]
    refine(first, 1, lambda s, x: progress(s, 0.05 * x))
    rivals = firmer(_rivals(first), linear)
    for one in rivals:
        one.directions = few
    refine(rivals, 1, lambda s, x: progress(s, 0.05 + 0.05 * x))
    begin(rivals)
    afresh(0.08)
    singles = [effects for effects in searches if len(effects) == 1]
    after([h.effects for h in after(singles, 0, few, 0.1)[:SINGLES]], 2, many, 0.15)
    if near_nothing():
        slight(0.17)
    likely = leading(ranked(1), NEAR)
    descend(likely, 0.2)
    # partners are looked for beside where leaders end, not on their way
    leaders = leading(after([h.effects for h in likely], 2, ALL, 0.22), CHANCE)
    paired(leaders, 0.25)
    known = {h.effects for h in leaders}
    pair = next(iter(ranked(2)), None)
    others = [searches[name,] for name in (pair.effects if pair else ()) if (name,) not in known]
    if others:
        paired([one.weighed() for one in others if np.isfinite(one.cost)], 0.3)
    evidence = {h.effects: h.log_evidence for h in weighed()}
    if max(evidence.values()) > evidence[()] + CHANCE:
        progress("looking for another calibration", 0.35)
        trade([alone(other.linear.problem, 1)], other)  # what parts the two may be far off
    costs = {h.effects: h.cost for h in leaders}
    found = contend(0.4)
    if _likeliest(weighed())[0].strain > STRAINED:
        by_other_ways(0.45)
        found = contend(0.48)
    leader = next((h for h in found if h.refined and len(h.effects) == 1), None)
    if (
        leader is not None
        and leader.log_evidence > evidence[()] + CHANCE
        and leader.cost < costs.get(leader.effects, np.inf) - FARTHER
    ):
        paired([leader], 0.5)
        found = contend(0.55)
    if found[0].effects == (UNKNOWN,):
        roam(found, 0.6)
        paired(ranked(1)[:1], 0.7)
        found = contend(0.72)
    if found[0].effects == (UNKNOWN,):
        progress("looking farther off", 0.8)
        rough = Linear(problem, ROUGH)
        far = [Search(rough, (name,), [start]) for name, axes in problem.axes.items() for start in _around(axes, FAR)]
        refine(far, 0)
        far = sorted((one for one in far if np.isfinite(one.cost)), key=lambda one: one.cost)[:SINGLES]
        for one in far:
            one.directions = many
        refine(far, 2, lambda s, x: progress(s, 0.8 + 0.02 * x))
        far = firmer(far, soft)
        refine(far, 1, lambda s, x: progress(s, 0.82 + 0.01 * x))
        far = firmer(far, linear)
        refine(far, 2, lambda s, x: progress(s, 0.83 + 0.02 * x))
        new = begin(far)
        paired(_likeliest(searches[e].weighed() for e in new)[:1], 0.86)
        found = contend(0.9)
    return firmly(found), linear


def _likeliest(hypotheses: Iterable[Hypothesis]) -> list[Hypothesis]:
    return sorted(hypotheses, key=lambda h: -h.log_evidence)


def _together(
    searches: Mapping[tuple[str, ...], Search], leader: Hypothesis, effects: tuple[str, ...]
) -> tuple[float, ...]:
    """Places of a pair: the leader's, and the other effect's where it was found best alone."""
    of = {name: searches[name,].point[1] for name in effects} | dict.fromkeys(leader.effects, np.array(leader.places))
    return tuple(float(place) for name in effects for place in of[name])


def _beside(
    axes: Mapping[str, Sequence[Axis]], leader: Hypothesis, effects: tuple[str, ...], shares: Sequence[float]
) -> list[tuple[float, ...]]:
    """Places of a leader, and of another effect beside it at ``shares`` of the way from none to an end."""
    (other,) = set(effects) - set(leader.effects)
    of = dict.fromkeys(leader.effects, leader.places)
    return [
        tuple(place for name in effects for place in (start if name == other else of[name]))
        for start in dict.fromkeys(_around(axes[other], shares))
    ]


def _rivals(searches: Iterable[Search]) -> list[Search]:
    """The best searches of each effect that have not come to the same place."""
    kept: dict[tuple[str, ...], list[Search]] = {}
    for one in sorted((one for one in searches if np.isfinite(one.cost)), key=lambda one: one.cost):
        mine = kept.setdefault(one.effects, [])
        if len(mine) < RIVALS and all(np.max(np.abs(one.point[1] - other.point[1])) > APART for other in mine):
            mine.append(one)
    return [one for mine in kept.values() for one in mine]


def _scaled(
    axes: Mapping[str, Sequence[Axis]], effects: Sequence[str], places: Sequence[float], factor: float
) -> tuple[float, ...]:
    """Places of effects that are so many times as large."""
    none = [axis.none for name in effects for axis in axes[name]]
    return tuple(z + factor * (place - z) for place, z in zip(places, none, strict=True))


def _around(axes: Sequence[Axis], shares: Sequence[float]) -> list[tuple[float, ...]]:
    """All of :func:`ways_of`."""
    return [place for way in ways_of(axes, shares) for place in way]


def ways_of(axes: Sequence[Axis], shares: Sequence[float]) -> list[list[tuple[float, ...]]]:
    """Places at ``shares`` of the way from none to an end, one magnitude at a time, by magnitude and side."""
    none = [axis.none for axis in axes]
    return [
        [tuple(z if i != index else z + share * (end - z) for i, z in enumerate(none)) for share in shares]
        for index, axis in enumerate(axes)
        for end in (0.0, 1.0)
        if axis.reach(end) > APART
    ]


def _calibration(other: Search, linear: Linear, temperature: float) -> Hypothesis:
    """Its nuisances are another problem's. What data that count less leave of their prior is more."""
    h = other.weighed()
    mine, usual = other.linear.tangent, linear.tangent
    more = [one.left_of_the_prior(temperature) - one.shrunk for one in (mine, usual)]
    return Hypothesis((CALIBRATION,), h.log_evidence + more[0] - more[1], cost=h.cost, left=h.left, misfit=h.misfit)


def other_calibration(problem: Problem) -> Search:
    """No effect, but uncertain parameters elsewhere within their ranges, under the same noise as all."""
    wide = Problem(
        problem.recordings, problem.nuisances.wider("recalibration"), {}, error=problem.error,
        references=problem.references, noise=problem.noise, misfit=problem.misfit, simulator=problem.simulator,
    )  # fmt: skip
    wide.hold_to_that_of(problem)
    wide.learn()
    return Search(Linear(wide, wide.error), (), directions=ALL)


def without(linear: Linear, recordings: Sequence[int], hypothesis: Hypothesis) -> tuple[Floats, Floats]:
    """Nuisances and places of a refined ``hypothesis``, fitted to all but some ``recordings`` (their numbers), to first
    order around its best fit."""
    tangent = hypothesis.tangent
    assert tangent is not None
    ends = np.cumsum([len(w.factor) for w in linear.whiteners])
    pieces = np.split(np.arange(ends[-1]), ends[:-1])
    blocks = zip(linear.problem.blocks, pieces, strict=True)
    rows = np.concatenate([piece for (index, _), piece in blocks if index not in recordings])
    u, z = hypothesis.nuisances, np.array(hypothesis.places, dtype=np.float64)
    columns = np.column_stack([tangent.jacobian[rows], hypothesis.slopes[rows]])
    target = hypothesis.left[rows] + tangent.moved(u)[rows]
    low, high = tangent.bounds
    prior = np.column_stack([np.linalg.cholesky(tangent.precision).T, np.zeros((len(u), len(z)))])
    whole = np.column_stack([np.vstack([columns, prior]), np.concatenate([target, np.zeros(len(u))])])
    small: Any = np.linalg.qr(whole, "r")  # the bounded problem in as many rows as unknowns
    bounds = np.concatenate([low, -z]) - 1e-9, np.concatenate([high, 1.0 - z]) + 1e-9
    found = lsq_linear(small[:, :-1], small[:, -1], bounds).x
    return np.clip(found[: len(u)], low, high), np.clip(z + found[len(u) :], 0.0, 1.0)


def tempering(hypotheses: Sequence[Hypothesis], trust: Trust) -> float:
    """By which fits count less: the more, the more the best one leaves beside what is usual, which is the size of the error
    that the data themselves show; and by the doubt that all the evidence for a gap leaves."""
    nothing, best = _nothing_and_best(hypotheses)
    ahead = max(best.log_evidence - nothing.log_evidence, 0.0)
    temperature = trust.temperature + trust.bent * ahead / (ahead + trust.half)
    if best.misfit:
        parts = [(trust.fit[kind].ratio(one), one.count) for kind, one in best.misfit.items()]
        temperature *= sum(ratio * count for ratio, count in parts) / sum(count for _, count in parts)
    return temperature + trust.doubt * ahead


def _nothing_and_best(hypotheses: Sequence[Hypothesis]) -> tuple[Hypothesis, Hypothesis]:
    return next(h for h in hypotheses if not h.effects), max(hypotheses, key=lambda h: h.log_evidence)


def weigh(hypotheses: Sequence[Hypothesis], prior: Mapping[tuple[str, ...], float], trust: Trust) -> list[Hypothesis]:
    """``hypotheses`` with their probabilities, the likeliest first; *unknown* joins them, where they say how well they fit.

    What a hypothesis fits better than nothing does is tempered (:func:`tempering`; Miller and Dunson 2019). What its freedom
    costs counts in full.

    The mean square that the right cause leaves has a known distribution. That something unknown is there beside a hypothesis
    has a prior probability, and makes it larger. All probabilities are taken to a power, as they would else be surer than
    they are right.
    """
    nothing, best = _nothing_and_best(hypotheses)
    temperature = tempering(hypotheses, trust)

    def tempered(h: Hypothesis) -> float:
        better = h.log_evidence - nothing.log_evidence
        if np.isnan(h.cost):
            return better / temperature + prior[h.effects]
        fits = 0.5 * (nothing.cost - h.cost)
        return fits / temperature + (better - fits) + prior[h.effects]

    evidence = np.array([tempered(h) for h in hypotheses])
    alone, beside = np.transpose([fitting(h, trust, nothing) for h in hypotheses])
    logs = evidence + alone
    shows = [bool(h.misfit) for h in hypotheses]
    if any(shows):
        hypotheses = [*hypotheses, Hypothesis((UNKNOWN,), best.log_evidence, cost=best.cost)]
        logs = np.append(logs, float(np.asarray(logsumexp((evidence + beside)[shows]))) + prior[UNKNOWN,])
    logs = trust.sharpness * np.asarray(logs, dtype=np.float64)
    probabilities = np.exp(logs - float(np.asarray(logsumexp(logs))))
    weighed = [replace(h, probability=float(p)) for h, p in zip(hypotheses, probabilities, strict=True)]
    return sorted(weighed, key=lambda h: -h.probability)


def beyond(hypothesis: Hypothesis, kind: str, trust: Trust, nothing: Hypothesis) -> tuple[float, float]:
    """Logarithm by which more is left in a ``kind`` of channel than what is usual of what explains so much more than
    ``nothing`` does, and its standard deviation. Better than usual is as good as usual."""
    fit, misfit = trust.fit[kind], hypothesis.misfit[kind]
    explained = max(nothing.misfit[kind].square - misfit.square, 0.0)
    more = max(float(np.log(fit.ratio(misfit, explained))), 0.0)
    return more, float(np.hypot(fit.spread, np.sqrt(2.0 / misfit.count)))


def fitting(hypothesis: Hypothesis, trust: Trust, nothing: Hypothesis) -> tuple[float, float]:
    """Log density of how well something fits if it is all that there is, and if something unknown is there beside it, which
    shows or does not in any kind of channel."""
    alone = beside = 0.0
    for kind in hypothesis.misfit:
        more, spread = beyond(hypothesis, kind, trust, nothing)
        as_usual = float(norm.logpdf(more, scale=spread))
        shown = float(expon.logpdf(more, scale=trust.surprise[kind])) if more > 0.0 else -np.inf
        alone += as_usual
        beside += float(np.logaddexp(as_usual, shown)) - np.log(2.0)
    return alone, beside


def log_priors(names: Iterable[str]) -> dict[tuple[str, ...], float]:
    """Log prior probability of every hypothesis that a catalogue of effects makes."""
    names = tuple(names)
    kinds: dict[str, list[tuple[str, ...]]] = {
        "nothing": [()], "single": [(name,) for name in names], "pair": list(combinations(names, 2)),
        UNKNOWN: [(UNKNOWN,)], CALIBRATION: [(CALIBRATION,)],
    }  # fmt: skip
    return {h: float(np.log(PRIOR[kind] / len(those))) for kind, those in kinds.items() for h in those}


def fit_p(hypothesis: Hypothesis, trust: Trust, nothing: Hypothesis) -> float:
    """Probability that a refined hypothesis fits no better in any kind of channel, if it holds; ``nothing`` says how much it
    explains."""
    parts = [beyond(hypothesis, kind, trust, nothing) for kind in hypothesis.misfit]
    return float(np.asarray(chi2.sf(sum((more / spread) ** 2 for more, spread in parts), len(parts))))
