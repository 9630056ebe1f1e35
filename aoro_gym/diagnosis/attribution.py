"""How hypotheses on a table of key figures are weighed: the evidence for nothing, for each effect, each pair, other
calibration, and what the catalogue lacks.

All hypotheses see the same figures, the same error of the twin and the same nuisances, whose prior is normal, and are
weighed by Laplace's method. Other calibration is nothing with wider priors. *Unknown* is something beside any of these,
which shows in that none of them fits as well as the right cause does elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp
from scipy.stats import expon, norm

from aoro_gym.diagnosis.linear import Beside, Hypothesis, Misfit
from aoro_gym.diagnosis.result import CALIBRATION, UNKNOWN

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
