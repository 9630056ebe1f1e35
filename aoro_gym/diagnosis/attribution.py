"""Which effect: the evidence for nothing, for each effect, each pair, other calibration, and what the catalogue lacks.

All hypotheses see the same recordings, the same error of the twin and the same nuisances, whose prior is normal. The linear
model (:mod:`.linear`) screens them; those that have a chance, nothing among them, are refined with the twin itself
(:mod:`.search`) and weighed by Laplace's method. Other calibration is nothing with wider priors. *Unknown* is a gap of the
size that is seen, of any shape: an error of the twin (:mod:`.noise`) as large as the gap itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
from scipy.optimize import lsq_linear
from scipy.special import logsumexp
from scipy.stats import chi2

from aoro_gym.diagnosis.linear import Hypothesis, Linear
from aoro_gym.diagnosis.noise import Floats
from aoro_gym.diagnosis.problem import Problem, Progress
from aoro_gym.diagnosis.result import CALIBRATION, UNKNOWN
from aoro_gym.diagnosis.search import ALL, Search, from_a_part, refine

DIRECTIONS = 12, 24
"""Of the nuisances in which a hypothesis takes slopes of its own: at first, and later."""
SINGLES = 12
"""Hypotheses of one effect that are likely."""
LEADERS, PARTNERS = 3, 5
"""The likeliest of one effect, and partners of each that make pairs."""
PAIRS = 8
"""Hypotheses of two effects that are likely."""
MOST = 8
"""Hypotheses that may have a chance."""
CHANCE = 25.0
"""Log odds behind the best beyond which a hypothesis has none."""
TEMPERATURE = 4.0
"""By which fits count less: samples are not as many as they seem, as the twin's own error is not that of its model (E)."""
DOUBT = 0.005
"""Share of the evidence for a gap by which the temperature grows: about what searches leave between two hypotheses that
explain logs of the twin itself equally well (E)."""
SURPRISES = (0.3, 0.6, 1.2)
"""Sizes of an unknown cause, as shares of the gap that is seen."""

PRIOR = {"nothing": 0.40, "single": 0.35, "pair": 0.10, UNKNOWN: 0.10, CALIBRATION: 0.05}
"""Prior probabilities of the kinds of hypotheses; within a kind all are equally likely."""


def attribute(problem: Problem, progress: Progress = lambda sentence, share: None) -> tuple[list[Hypothesis], Linear]:
    """All hypotheses of a learned problem with their probabilities, the likeliest first, and the linear model that they
    were found with."""
    linear = Linear(problem, problem.error)
    screened = linear.screen(pairs=False)
    prior = log_priors(problem.axes)
    other = other_calibration(problem)
    searches: dict[tuple[str, ...], Search] = {}

    def after(effects: Sequence[tuple[str, ...]], rounds: int, directions: int, share: float) -> list[Hypothesis]:
        """Hypotheses after some more rounds, the likeliest first; nothing and other calibration come along."""
        those = [searches[e] for e in dict.fromkeys([(), *effects])]
        for one in those:
            one.directions = directions
        refine([*those, other], rounds, lambda s, x: progress(s, share + 0.3 * x))
        found = [searches[e].weighed() for e in effects if np.isfinite(searches[e].cost)]
        return sorted(found, key=lambda h: -h.log_evidence)

    few, many = DIRECTIONS
    singles = [e for e in screened if len(e) == 1]
    searches |= {e: Search(linear, e, screened[e].places) for e in [(), *singles]}
    likely = after(singles, 1, few, 0.0)[:SINGLES]
    likely = after([h.effects for h in likely], 2, many, 0.1)
    pairs = {}
    for leader in likely[:LEADERS]:
        for effects, places in linear.partners(leader)[:PARTNERS]:
            pairs.setdefault(effects, Search(linear, effects, places, leader))
    searches |= pairs
    likely = after(list(pairs), 1, few, 0.4)[:PAIRS]
    after([h.effects for h in likely], 2, many, 0.5)

    found = [one.weighed() for one in searches.values() if np.isfinite(one.cost)]
    weighed = [h for h in weigh(found, prior) if h.effects][:MOST]
    contenders = [h.effects for h in weighed if h.probability > weighed[0].probability * np.exp(-CHANCE)]
    alone = [(name,) for e in contenders for name in e]  # of a pair, one may be all that there is
    again = [from_a_part(linear, searches[e], searches) for e in contenders if len(e) == 2]
    searches |= {one.effects: one for one in again if one is not None}
    after(list(dict.fromkeys([*contenders, *alone])), 3, many, 0.7)
    found = [one.weighed() for one in searches.values() if np.isfinite(one.cost)]
    if np.isfinite(other.cost):
        h = other.weighed()
        found.append(Hypothesis((CALIBRATION,), h.log_evidence, cost=h.cost))  # its nuisances are another problem's
    return weigh([*found, unknown(problem)], prior), linear


def unknown(problem: Problem) -> Hypothesis:
    """Something outside of the catalogue."""
    sizes = [replace(problem.error, change=change) for change in SURPRISES]
    evidence = [Linear(problem, error, effects=False).evidence() for error in sizes]
    return Hypothesis((UNKNOWN,), float(logsumexp(evidence) - np.log(len(evidence))))


def other_calibration(problem: Problem) -> Search:
    """No effect, but uncertain parameters elsewhere within their ranges, under the same noise as all."""
    wide = Problem(
        problem.recordings, problem.nuisances.wider("recalibration"), {}, error=problem.error,
        references=problem.references, noise=problem.noise, simulator=problem.simulator,
    )  # fmt: skip
    wide.hold_to_that_of(problem)
    wide.learn()
    return Search(Linear(wide, wide.error), (), (), directions=ALL)


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
    target = hypothesis.left[rows] + tangent.jacobian[rows] @ u
    low, high = tangent.bounds
    prior = np.column_stack([np.linalg.cholesky(tangent.precision).T, np.zeros((len(u), len(z)))])
    whole = np.column_stack([np.vstack([columns, prior]), np.concatenate([target, np.zeros(len(u))])])
    small: Any = np.linalg.qr(whole, "r")  # the bounded problem in as many rows as unknowns
    bounds = np.concatenate([low, -z]) - 1e-9, np.concatenate([high, 1.0 - z]) + 1e-9
    found = lsq_linear(small[:, :-1], small[:, -1], bounds).x
    return np.clip(found[: len(u)], low, high), np.clip(z + found[len(u) :], 0.0, 1.0)


def weigh(
    hypotheses: Sequence[Hypothesis], prior: Mapping[tuple[str, ...], float], temperature: float = TEMPERATURE
) -> list[Hypothesis]:
    """``hypotheses`` with their probabilities, the likeliest first.

    What a hypothesis fits better than nothing does is tempered (Miller and Dunson 2019): by ``temperature``, and, as no twin
    shows a deviation exactly as its machine does, nor is any search perfect, by the share :data:`DOUBT` of all the evidence
    that there is a gap. What its freedom costs counts in full.
    """
    nothing = next(h for h in hypotheses if not h.effects)
    temperature += DOUBT * max(max(h.log_evidence for h in hypotheses) - nothing.log_evidence, 0.0)

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


def log_priors(names: Iterable[str]) -> dict[tuple[str, ...], float]:
    """Log prior probability of every hypothesis that a catalogue of effects makes."""
    names = tuple(names)
    kinds: dict[str, list[tuple[str, ...]]] = {
        "nothing": [()], "single": [(name,) for name in names], "pair": list(combinations(names, 2)),
        UNKNOWN: [(UNKNOWN,)], CALIBRATION: [(CALIBRATION,)],
    }  # fmt: skip
    return {h: float(np.log(PRIOR[kind] / len(those))) for kind, those in kinds.items() for h in those}


def fit_p(linear: Linear, hypothesis: Hypothesis) -> float:
    """Probability of residuals at least as large as those of a fitted hypothesis, if it holds."""
    return float(np.asarray(chi2.sf(hypothesis.cost, len(linear.residual) - len(hypothesis.places))))
