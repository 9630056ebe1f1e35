"""From what networks say to a verdict: is anything wrong, is it in the catalogue, which effects may it be.

Networks are trained on simulated machines; how sure they are elsewhere is learnt from cases whose truth is known
(:func:`calibrated`), for each usual set of sensors:

- a temperature T (Guo et al. 2017): probabilities are raised to 1/T; and offsets of the logarithms of nothing, of something
  else and of pairs against single effects (bias-corrected temperature scaling, Alexandari et al. 2020): networks were
  trained on another mixture of these, and take single effects for pairs on machines that they do not know. Together they
  make the truth as likely as can be;
- the null test: the share of healthy cases in which a statistic was no larger (a conformal p-value, Vovk 2005), one against
  causes of the catalogue and one against something else, each with a share of the false alarms (Bonferroni): what machines
  and days do that was never simulated looks like something else, and must not hide causes that are plain;
- a threshold of "something else" against the likeliest known cause, and one of an effect's probability if a single effect
  is there, which as many known causes pass as asked for (split conformal, least ambiguous sets, Sadinle et al. 2019);
  effects that may well be there beside another are declared, too;
- a widening of the intervals of sizes (conformalised quantiles, Romano et al. 2019, in the scaled form).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from aoro_gym.diagnosis.network import hypotheses
from aoro_gym.diagnosis.network.forward import TRAINED
from aoro_gym.diagnosis.result import UNKNOWN
from aoro_gym.effects.catalogue import IDS
from aoro_gym.execution.files import read_json

Floats = NDArray[np.float64]

SENSOR_SETS: Mapping[str, tuple[str, ...]] = {
    "pressures": ("joint_angle", "pressure_a", "pressure_b", "pump_pressure"),
    "ports": ("joint_angle", "pressure_a", "pressure_b"),
    "angle": ("joint_angle",),
}
"""Channels of usual sets of sensors, the richest first."""
ALARMS = 0.015
"""Share of healthy cases that are taken for a gap, of the families that calibrate; of others it was 1.2 to 1.8 %."""
SUSPECTED = 0.2
"""Share of healthy cases of which a gap is not ruled out: what it may be is declared, without a gap being said."""
REJECTED = 0.02
"""Share of known causes that are taken for something outside of the catalogue."""
HELD = 0.975
"""Share of single causes with a gap said that their declared set holds, of the families that calibrate; of others
it was 96.9 to 97.2 %."""
PRESENT = 0.1
"""Probability from which an effect is declared, alone or beside another, given that something of the catalogue is wrong."""
INTERVAL = 0.9
"""Share of true sizes that their intervals hold."""
SURE = 0.8
"""Probability from which a cause is named alone."""
LEAST = 1e-4
"""Probability below which a hypothesis is not kept."""
TEMPERATURES = np.geomspace(0.5, 4.0, 61)
"""That are tried."""
OFFSETS = 3.0
"""Standard deviation of offsets before anything is learnt (natural logarithm): keeps them finite where there is no case."""
HEALTHY_QUANTILES = 400
"""By which the null distribution is kept."""
SINGLE_GROUP = 2
"""Number of the group of single effects."""
GROUPS = np.repeat([0, 1, SINGLE_GROUP, 3], [1, 1, hypotheses.PAIR - hypotheses.SINGLE, len(hypotheses.PAIRS)])
"""Group of each hypothesis (hypotheses,): nothing, something else, single effects, pairs."""
STATISTICS: Mapping[str, Callable[[Floats, Floats], Floats]] = {
    "nothing": lambda nothing, outside: nothing,
    "known": lambda nothing, outside: nothing / np.maximum(1.0 - outside, 1e-30),
    "outside": lambda nothing, outside: 1.0 - outside,
}
"""Of the null test, from the probabilities of nothing and of something else: small where something is wrong."""
SPLIT: Mapping[str, float] = {"known": 0.75, "outside": 0.25}
"""Statistics of the null test for logs, and the share of the false alarms that is each one's."""


@dataclass(frozen=True)
class NullStatistic:
    """A statistic of the null test.

    Attributes:
        name: One of :data:`STATISTICS`.
        share: Of the false alarms that are its own.
        healthy: Its evenly spaced quantiles in healthy cases, rising.
    """

    name: str
    share: float
    healthy: tuple[float, ...]

    def p(self, value: Floats) -> Floats:
        """Share (...) of healthy cases in which the statistic is no larger than ``value`` (...)."""
        return (1 + np.searchsorted(self.healthy, value, side="right")) / (1 + len(self.healthy))


@dataclass(frozen=True)
class Offsets:
    """Added to the natural logarithms of probabilities, those of single effects being left as they are.

    Attributes:
        nothing: To that of nothing.
        outside: To that of something else.
        pair: To that of each pair.
    """

    nothing: float
    outside: float
    pair: float

    def each(self) -> Floats:
        """Of every hypothesis (hypotheses,)."""
        return np.array([self.nothing, self.outside, 0.0, self.pair])[GROUPS]


@dataclass(frozen=True)
class Calibration:
    """What was learnt from cases with a known truth; see the module.

    Attributes:
        cases: Number of them.
        temperature: T.
        null: Statistics of the null test.
        outside: Least probability of something else from which that is said: as networks say, given that it is that or the
            likeliest known cause. Without offsets: at temperature T, given that something is wrong.
        member: Least probability of an effect in the declared set, given that a single effect is there. Without offsets: of
            its being there, given that something of the catalogue is wrong.
        widening: Factor on the distances of a size's quantiles from their median, so that its 90 % interval holds as often.
        offsets: Of the logarithms at temperature T; None where networks are asked about what they were trained on, whose
            probabilities are right as they are.
    """

    cases: int
    temperature: float
    null: tuple[NullStatistic, ...]
    outside: float
    member: float
    widening: float = 1.0
    offsets: Offsets | None = None

    def null_p(self, nothing: Floats | float, outside: Floats | float) -> Floats:
        """Probability (...) of a gap as clear as this while nothing is wrong, from the probabilities (...) of nothing and of
        something else; never zero."""
        found = [one.p(STATISTICS[one.name](np.asarray(nothing), np.asarray(outside))) / one.share for one in self.null]
        return np.minimum(np.min(found, axis=0), 1.0)

    @classmethod
    def from_dict(cls, told: Mapping[str, Any]) -> Calibration:
        """Of what :func:`as_dict` wrote; a file that tells no offsets has none."""
        null = tuple(NullStatistic(one["name"], one["share"], tuple(one["healthy"])) for one in told["null"])
        offsets = told.get("offsets")
        return cls(**{**told, "null": null, "offsets": None if offsets is None else Offsets(**offsets)})


@dataclass(frozen=True)
class Decision:
    """What is said of a case.

    Attributes:
        verdict: One of :data:`~aoro_gym.diagnosis.result.VERDICTS`.
        null_p: Probability of a gap as clear as this while nothing is wrong.
        hypotheses: Effects and probability, the named one first, then by probability; none below :data:`LEAST`.
        effects: Probability (effects,) that an effect is there, alone or with another.
        declared: Ids of the effects that may be the cause, the likeliest first; none where a gap is ruled out, that is where
            ``null_p`` exceeds :data:`SUSPECTED`.
    """

    verdict: str
    null_p: float
    hypotheses: tuple[tuple[tuple[str, ...], float], ...]
    effects: Floats
    declared: tuple[str, ...]


def sensor_set(channels: Sequence[str]) -> str:
    """The richest of :data:`SENSOR_SETS` whose channels are all there; that of the angle where none is."""
    return next((name for name, needed in SENSOR_SETS.items() if set(needed) <= set(channels)), "angle")


@cache
def shipped() -> Mapping[str, Calibration]:
    """Of the networks that come with the package, by set of sensors."""
    return calibrations_of(TRAINED / "calibration.json")


def calibrations_of(path: Path) -> Mapping[str, Calibration]:
    """By set of sensors, from a file."""
    return {name: Calibration.from_dict(of) for name, of in read_json(path)["sets"].items()}


def tempered(probabilities: Floats, temperature: float, offsets: Offsets | None = None) -> Floats:
    """Probabilities (..., hypotheses) at another temperature, with ``offsets`` of their logarithms."""
    logs = np.log(np.maximum(probabilities, 1e-30)) / temperature
    if offsets is not None:
        logs = logs + offsets.each()
    powers = np.exp(logs - logs.max(axis=-1, keepdims=True))
    return powers / powers.sum(axis=-1, keepdims=True)


def decide(probabilities: Floats, calibration: Calibration) -> Decision:
    """The verdict on a case whose hypotheses have these ``probabilities`` (hypotheses,), as networks say."""
    probabilities = np.asarray(probabilities, dtype=np.float64)
    share = tempered(probabilities, calibration.temperature, calibration.offsets)
    nothing, outside = share[hypotheses.NOTHING], share[hypotheses.OUTSIDE]
    null_p = float(calibration.null_p(nothing, outside))
    effects = share @ hypotheses.MEMBERS
    best = hypotheses.SINGLE + int(np.argmax(share[hypotheses.SINGLE :]))
    declared: tuple[str, ...] = ()
    if null_p <= SUSPECTED:
        declared = _declared(share, best, calibration)
    if null_p > ALARMS:
        verdict, first = "no_gap", hypotheses.NOTHING
    elif _outside(probabilities, share, calibration.offsets) >= calibration.outside:
        verdict, first = "unknown", hypotheses.OUTSIDE
    else:
        named = hypotheses.names_of(best)
        together = float(share[hypotheses.MEMBERS[:, [IDS.index(one) for one in named]].all(axis=1)].sum())
        verdict, first = ("cause" if together >= SURE else "ambiguous"), best
    order = [first, *(int(k) for k in np.argsort(-share, kind="stable") if k != first and share[k] >= LEAST)]
    ranked = tuple((_effects_of(number), float(share[number])) for number in order)
    return Decision(verdict, null_p, ranked, effects, declared)


def _declared(share: Floats, best: int, calibration: Calibration) -> tuple[str, ...]:
    """Effects of the best hypothesis, and all that are likely enough, the likeliest first, of ``share`` (hypotheses,)."""
    effects = share @ hypotheses.MEMBERS
    chosen = _member(share, calibration.offsets) >= calibration.member
    chosen |= hypotheses.MEMBERS[best] > 0.0
    if calibration.offsets is not None:
        chosen |= _member(share, None) >= PRESENT
    return tuple(IDS[k] for k in np.argsort(-effects, kind="stable") if chosen[k])


def _outside(probabilities: Floats, share: Floats, offsets: Offsets | None) -> Floats:
    """Probability (...) of something else that a calibration's threshold is of.

    With offsets it is of what networks say before them: on families left out that tells something else more often.

    Args:
        probabilities: Of the hypotheses (..., hypotheses), as networks say.
        share: The same, calibrated.
        offsets: Of the calibration.
    """
    if offsets is None:
        return share[..., hypotheses.OUTSIDE] / np.maximum(1.0 - share[..., hypotheses.NOTHING], 1e-30)
    outside, known = probabilities[..., hypotheses.OUTSIDE], probabilities[..., hypotheses.SINGLE :].max(axis=-1)
    return outside / np.maximum(outside + known, 1e-30)


def _member(share: Floats, offsets: Offsets | None) -> Floats:
    """Probability (..., effects) of effects that a calibration's threshold is of, from calibrated ones (..., hypotheses)."""
    if offsets is None:
        known = 1.0 - share[..., hypotheses.NOTHING] - share[..., hypotheses.OUTSIDE]
        return (share @ hypotheses.MEMBERS) / np.maximum(known, 1e-30)[..., None]
    single = share[..., hypotheses.SINGLE : hypotheses.PAIR]
    return single / np.maximum(single.sum(axis=-1, keepdims=True), 1e-30)


def _effects_of(number: int) -> tuple[str, ...]:
    return (UNKNOWN,) if number == hypotheses.OUTSIDE else hypotheses.names_of(number)


def calibrated(
    probabilities: Floats,
    truth: NDArray[np.integer],
    weights: Floats | None = None,
    statistics: Mapping[str, float] = SPLIT,
    offset: bool = True,
) -> Calibration:
    """What cases with a known truth say of networks.

    Args:
        probabilities: Of the hypotheses (N, hypotheses), as networks say.
        truth: Numbers of the true ones (N,), one of them at least that of nothing. Without a known cause that is noticed
            nothing is taken for something else, and every effect may be the cause.
        weights: Of the cases (N,), equal by default.
        statistics: Of the null test, and the share of false alarms of each.
        offset: Whether offsets are learnt, with what belongs to them.

    Raises:
        ValueError: something is wrong in every case.
    """
    weights = np.ones(len(truth)) if weights is None else weights
    logs = np.log(np.maximum(probabilities, 1e-30))
    fit = _with_offsets if offset else _without_offsets
    fitted = [fit(logs / t, truth, weights) for t in TEMPERATURES]
    likeliest = int(np.argmin([loss for loss, _ in fitted]))
    temperature, offsets = float(TEMPERATURES[likeliest]), fitted[likeliest][1]
    share = tempered(probabilities, temperature, offsets)
    nothing, outside = share[:, hypotheses.NOTHING], share[:, hypotheses.OUTSIDE]
    healthy = truth == hypotheses.NOTHING
    if not healthy.any():
        raise ValueError(f"none of {len(truth)} cases is free of a cause; calibrate on more machines")
    levels = np.linspace(0.0, 1.0, HEALTHY_QUANTILES)
    null = tuple(
        NullStatistic(
            name,
            part,
            tuple(_quantile(STATISTICS[name](nothing, outside)[healthy], levels, weights[healthy]).tolist()),
        )
        for name, part in statistics.items()
    )
    calibration = Calibration(len(truth), temperature, null, 0.0, 0.0, offsets=offsets)
    alarmed = calibration.null_p(nothing, outside) <= ALARMS
    known = alarmed & (truth >= hypotheses.SINGLE)
    told = _outside(probabilities, share, offsets)
    single = known & (truth < hypotheses.PAIR)
    of_truth = _member(share, offsets)[single, truth[single] - hypotheses.SINGLE]
    return replace(
        calibration,
        outside=float(_quantile(told[known], 1.0 - REJECTED, weights[known])) if known.any() else 1.0,
        member=float(_quantile(of_truth, 1.0 - HELD, weights[single])) if single.any() else 0.0,
    )


def widening_of(quantiles: Floats, sizes: Floats, weights: Floats) -> float:
    """Least factor, 1 at least, by which intervals are widened about their medians to hold 90 % of the true sizes.

    Args:
        quantiles: Said of each size (N, quantiles), rising.
        sizes: The true ones (N,).
        weights: Of the cases (N,).
    """
    middle = quantiles[:, quantiles.shape[1] // 2]
    side = np.where(sizes >= middle, quantiles[:, -1] - middle, middle - quantiles[:, 0])
    needed = np.abs(sizes - middle) / np.maximum(side, 1e-30)
    return max(float(_quantile(needed, INTERVAL, weights)), 1.0)


def _without_offsets(logs: Floats, truth: NDArray[np.integer], weights: Floats) -> tuple[float, None]:
    """Weighted mean −ln of the truth's probability, of ``logs`` (N, hypotheses) as they are."""
    own = logs[np.arange(len(truth)), truth]
    return float(np.average(np.logaddexp.reduce(logs, axis=1) - own, weights=weights)), None


def _with_offsets(logs: Floats, truth: NDArray[np.integer], weights: Floats) -> tuple[float, Offsets]:
    """Weighted mean −ln of the truth's probability with the likeliest offsets of ``logs`` (N, hypotheses), and these."""
    groups = np.stack([np.logaddexp.reduce(logs[:, number == GROUPS], axis=1) for number in range(4)], axis=1)
    cases, own, share = np.arange(len(truth)), GROUPS[truth], weights / weights.sum()
    found = minimize(_group_loss, np.zeros(3), args=(groups, own, share), jac=True, method="BFGS")
    within = share @ (groups[cases, own] - logs[cases, truth])
    return float(found.fun + within), Offsets(*(float(one) for one in found.x))


def _group_loss(free: Floats, groups: Floats, own: NDArray[np.integer], share: Floats) -> tuple[float, Floats]:
    """Weighted mean −ln of the probability of the truth's group, with what is known of offsets before; its gradient (3,).

    Args:
        free: Offsets (3,) of nothing, of something else and of pairs.
        groups: ln of the groups' sums (N, 4).
        own: The truth's group (N,).
        share: Of the weight that is each case's (N,).
    """
    moved = groups + np.insert(free, SINGLE_GROUP, 0.0)
    total, prior = np.logaddexp.reduce(moved, axis=1), 1.0 / (len(own) * OFFSETS**2)
    value = share @ (total - moved[np.arange(len(own)), own]) + 0.5 * prior * (free @ free)
    excess = share @ np.exp(moved - total[:, None]) - np.bincount(own, share, minlength=4)
    return float(value), np.delete(excess, SINGLE_GROUP) + prior * free


def _quantile(values: Floats, levels: float | Floats, weights: Floats) -> Floats:
    """Quantiles of weighted ``values`` (n,): the least value up to which a share of the weight lies."""
    order = np.argsort(values)
    reached = np.cumsum(weights[order]) / weights.sum()
    return values[order][np.minimum(np.searchsorted(reached, levels), len(values) - 1)]


def as_dict(sets: Mapping[str, Calibration]) -> dict[str, dict[str, Any]]:
    """For ``calibration.json``."""
    return {name: asdict(one) for name, one in sets.items()}
