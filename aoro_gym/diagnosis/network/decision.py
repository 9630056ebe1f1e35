"""From what networks say to a verdict: is anything wrong, is it in the catalogue, which effects may it be.

Networks are trained on simulated machines; how sure they are elsewhere is learnt from cases whose truth is known
(:func:`calibrated`), for each usual set of sensors:

- a temperature T: probabilities are raised to 1/T, which makes them as likely as can be (Guo et al. 2017);
- the null test: the share of healthy cases in which a statistic was no larger (a conformal p-value, Vovk 2005), one against
  causes of the catalogue and one against something else, each with a share of the false alarms (Bonferroni): what machines
  and days do that was never simulated looks like something else, and must not hide causes that are plain;
- thresholds of "something else" and of an effect's probability, given that something of the catalogue is wrong, which as
  many known causes pass as asked for (split conformal, least ambiguous sets, Sadinle et al. 2019);
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
"""Share of healthy cases that are taken for a gap, of the families that calibrate; of others it was 1.5 to 2.0 %."""
SUSPECTED = 0.2
"""Share of healthy cases of which a gap is not ruled out: what it may be is declared, without a gap being said."""
REJECTED = 0.02
"""Share of known causes that are taken for something outside of the catalogue."""
HELD = 0.97
"""Share of single causes with a gap said that their declared set holds."""
INTERVAL = 0.9
"""Share of true sizes that their intervals hold."""
SURE = 0.8
"""Probability from which a cause is named alone."""
LEAST = 1e-4
"""Probability below which a hypothesis is not kept."""
TEMPERATURES = np.geomspace(0.5, 4.0, 61)
"""That are tried."""
HEALTHY_QUANTILES = 400
"""By which the null distribution is kept."""
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
class Calibration:
    """What was learnt from cases with a known truth; see the module.

    Attributes:
        cases: Number of them.
        temperature: T.
        null: Statistics of the null test.
        outside: Least probability of something else, given that something is wrong, from which that is said.
        member: Least probability of an effect, given that something of the catalogue is wrong, in the declared set.
        widening: Factor on the distances of a size's quantiles from their median, so that its 90 % interval holds as often.
    """

    cases: int
    temperature: float
    null: tuple[NullStatistic, ...]
    outside: float
    member: float
    widening: float = 1.0

    def null_p(self, nothing: Floats | float, outside: Floats | float) -> Floats:
        """Probability (...) of a gap as clear as this while nothing is wrong, from the probabilities (...) of nothing and of
        something else; never zero."""
        found = [one.p(STATISTICS[one.name](np.asarray(nothing), np.asarray(outside))) / one.share for one in self.null]
        return np.minimum(np.min(found, axis=0), 1.0)

    @classmethod
    def from_dict(cls, told: Mapping[str, Any]) -> Calibration:
        """Of what :func:`as_dict` wrote."""
        null = tuple(NullStatistic(one["name"], one["share"], tuple(one["healthy"])) for one in told["null"])
        return cls(**{**told, "null": null})


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


def tempered(probabilities: Floats, temperature: float) -> Floats:
    """Probabilities (..., hypotheses) at another temperature."""
    logs = np.log(np.maximum(probabilities, 1e-30)) / temperature
    powers = np.exp(logs - logs.max(axis=-1, keepdims=True))
    return powers / powers.sum(axis=-1, keepdims=True)


def decide(probabilities: Floats, calibration: Calibration) -> Decision:
    """The verdict on a case whose hypotheses have these ``probabilities`` (hypotheses,), as networks say."""
    share = tempered(np.asarray(probabilities, dtype=np.float64), calibration.temperature)
    nothing, outside = share[hypotheses.NOTHING], share[hypotheses.OUTSIDE]
    null_p = float(calibration.null_p(nothing, outside))
    effects = share @ hypotheses.MEMBERS
    best = hypotheses.SINGLE + int(np.argmax(share[hypotheses.SINGLE :]))
    declared: tuple[str, ...] = ()
    if null_p <= SUSPECTED:
        declared = _declared(effects, best, max(1.0 - nothing - outside, 1e-30), calibration.member)
    if null_p > ALARMS:
        verdict, first = "no_gap", hypotheses.NOTHING
    elif outside >= calibration.outside * (1.0 - nothing):
        verdict, first = "unknown", hypotheses.OUTSIDE
    else:
        named = hypotheses.names_of(best)
        together = float(share[hypotheses.MEMBERS[:, [IDS.index(one) for one in named]].all(axis=1)].sum())
        verdict, first = ("cause" if together >= SURE else "ambiguous"), best
    order = [first, *(int(k) for k in np.argsort(-share, kind="stable") if k != first and share[k] >= LEAST)]
    ranked = tuple((_effects_of(number), float(share[number])) for number in order)
    return Decision(verdict, null_p, ranked, effects, declared)


def _declared(effects: Floats, best: int, known: float, member: float) -> tuple[str, ...]:
    """Effects of the best hypothesis, and all that are likely enough, the likeliest first."""
    chosen = effects / known >= member
    chosen |= hypotheses.MEMBERS[best] > 0.0
    return tuple(IDS[k] for k in np.argsort(-effects, kind="stable") if chosen[k])


def _effects_of(number: int) -> tuple[str, ...]:
    return (UNKNOWN,) if number == hypotheses.OUTSIDE else hypotheses.names_of(number)


def calibrated(
    probabilities: Floats,
    truth: NDArray[np.integer],
    weights: Floats | None = None,
    statistics: Mapping[str, float] = SPLIT,
) -> Calibration:
    """What cases with a known truth say of networks.

    Args:
        probabilities: Of the hypotheses (N, hypotheses), as networks say.
        truth: Numbers of the true ones (N,), one of them at least that of nothing. Without a known cause that is noticed
            nothing is taken for something else, and every effect may be the cause.
        weights: Of the cases (N,), equal by default.
        statistics: Of the null test, and the share of false alarms of each.

    Raises:
        ValueError: something is wrong in every case.
    """
    weights = np.ones(len(truth)) if weights is None else weights
    logs = np.log(np.maximum(probabilities, 1e-30))
    temperature = float(TEMPERATURES[np.argmin([_loss(logs / t, truth, weights) for t in TEMPERATURES])])
    share = tempered(probabilities, temperature)
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
    calibration = Calibration(len(truth), temperature, null, 0.0, 0.0)
    alarmed = calibration.null_p(nothing, outside) <= ALARMS
    known = alarmed & (truth >= hypotheses.SINGLE)
    told = outside / np.maximum(1.0 - nothing, 1e-30)
    single = known & (truth < hypotheses.PAIR)
    within = (share @ hypotheses.MEMBERS) / np.maximum(1.0 - nothing - outside, 1e-30)[:, None]
    of_truth = within[single, truth[single] - hypotheses.SINGLE]
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


def _loss(logs: Floats, truth: NDArray[np.integer], weights: Floats) -> float:
    """Weighted mean −ln of the truth's probability."""
    top = logs.max(axis=1)
    norm = top + np.log(np.exp(logs - top[:, None]).sum(axis=1))
    return float(np.average(norm - logs[np.arange(len(truth)), truth], weights=weights))


def _quantile(values: Floats, levels: float | Floats, weights: Floats) -> Floats:
    """Quantiles of weighted ``values`` (n,): the least value up to which a share of the weight lies."""
    order = np.argsort(values)
    reached = np.cumsum(weights[order]) / weights.sum()
    return values[order][np.minimum(np.searchsorted(reached, levels), len(values) - 1)]


def as_dict(sets: Mapping[str, Calibration]) -> dict[str, dict[str, Any]]:
    """For ``calibration.json``."""
    return {name: asdict(one) for name, one in sets.items()}
