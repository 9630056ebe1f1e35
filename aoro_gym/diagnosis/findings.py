"""What is reported of weighed hypotheses: the verdict, the declared set, where in the machine, causes with their sizes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.diagnosis.linear import Hypothesis, Linear
from aoro_gym.diagnosis.noise import Floats
from aoro_gym.diagnosis.problem import Problem
from aoro_gym.diagnosis.result import CALIBRATION, UNKNOWN, Cause, CredibleInterval, presence
from aoro_gym.effects.effect import ChainEffect, Effect, GroundEffect

LEAST_PROBABILITY = 0.8
"""Probability of any cause from which causes are named at all, and of one from which it is named alone. Of the development
family's healthy machines none had more than 0.77 by the angle, 0.60 with pressures."""
DRAWS = 2000
"""Of the posterior, for intervals of magnitudes."""
SPREAD_INFLATION = 1.5
"""Factor on the standard deviations of places (E)."""
LEAST_SHIFT = 1.0
"""Prior standard deviations by which a parameter must have moved to be listed."""
LEAST_COSINE = 0.95
"""Cosine of the angle between what two effects do, once calibration has had its share, above which they are alike."""


def verdict_of(hypotheses: Sequence[Hypothesis]) -> str:
    """See :data:`~aoro_gym.diagnosis.result.VERDICTS`. A cause is one that is there alone or beside something else: that a
    second, slight effect cannot be told from none takes nothing from the first."""
    best = hypotheses[0]
    of = {h.effects: h.probability for h in hypotheses}
    healthy = of.get((), 0.0) + of.get((CALIBRATION,), 0.0)
    unknown = of.get((UNKNOWN,), 0.0)
    if healthy > 1.0 - LEAST_PROBABILITY:
        if healthy < 0.5:
            return "inconclusive"
        return "no_gap" if of.get((), 0.0) >= of.get((CALIBRATION,), 0.0) else "calibration"
    if unknown >= 0.5:
        return "unknown"
    if best.effects in ((), (UNKNOWN,), (CALIBRATION,)):
        return "ambiguous"
    return "cause" if presence(best.effects, of) >= LEAST_PROBABILITY else "ambiguous"


def declared_of(hypotheses: Sequence[Hypothesis], probability: float) -> tuple[str, ...]:
    """Effects of the least set of hypotheses that holds the truth with this ``probability``."""
    total, names = 0.0, dict[str, None]()
    for h in hypotheses:
        names.update(dict.fromkeys(h.effects))
        total += h.probability
        if total >= probability:
            break
    return tuple(names)


def components_of(hypotheses: Sequence[Hypothesis], effects: Mapping[str, Effect]) -> dict[str, float]:
    """Probability that a cause lies in a component, largest first."""
    found: dict[str, float] = {}
    for h in hypotheses:
        for component in {effects[name].component for name in h.effects if name in effects}:
            found[component] = found.get(component, 0.0) + h.probability
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def row_of(hypothesis: Hypothesis) -> Floats:
    return np.array(hypothesis.places, dtype=np.float64)[None]


def cause_of(problem: Problem, hypothesis: Hypothesis, laws: float, out: Path | None) -> Cause:
    """With its machine file if ``out`` is given, and intervals of its magnitudes, wider by ``laws`` (``Trust``)."""
    known = tuple(name for name in hypothesis.effects if name in problem.effects)
    components = tuple(dict.fromkeys(problem.effects[name].component for name in known))
    if not known:
        return Cause(hypothesis.effects, hypothesis.probability)
    rng = np.random.default_rng(0)
    best = np.array(hypothesis.places)
    spread = SPREAD_INFLATION * np.linalg.cholesky(hypothesis.covariance + 1e-12 * np.eye(len(best)))
    drawn = np.clip(best + rng.standard_normal((DRAWS, len(best))) @ spread.T, 0.0, 1.0)
    other = np.exp(laws * rng.standard_normal(DRAWS))
    nuisances = hypothesis.nuisances if hypothesis.refined else problem.centre
    machine = problem.at(nuisances[None]).machine
    magnitudes: dict[str, tuple[CredibleInterval, ...]] = {}
    settings: dict[str, tuple[float, ...]] = {}
    column = 0
    for name in known:
        effect, axes = problem.effects[name], problem.axes[name]
        values = [axis.value(drawn[:, column + i]) for i, axis in enumerate(axes)]
        settings[name] = tuple(float(axis.value(best[column + i])) for i, axis in enumerate(axes))
        column += len(axes)
        without = effect.measured(machine, *effect.none)
        parts = []
        for one, at, none in zip(effect.operational, effect.measured(machine, *values), without, strict=True):
            low, median, high = np.quantile((np.asarray(at, dtype=np.float64) - none) * other, [0.05, 0.5, 0.95])
            parts.append(CredibleInterval(float(median), float(low), float(high), one.unit, one.quantity))
        magnitudes[name] = tuple(parts)
    file = ""
    if out is not None and not any(isinstance(problem.effects[name], ChainEffect | GroundEffect) for name in known):
        file = f"machines/{'+'.join(known)}.toml"
        (out / "machines").mkdir(parents=True, exist_ok=True)
        problem.at(nuisances[None], known, row_of(hypothesis)).machine.save(out / file)
    return Cause(hypothesis.effects, hypothesis.probability, magnitudes, settings, components, file)


def moved_by(problem: Problem, best: Hypothesis | None) -> tuple[dict[str, Any], ...]:
    """Parameters that the best fit has moved, the farthest first."""
    if best is None:
        return ()
    felt = problem.felt
    moved = problem.at(best.nuisances[None]).machine
    rows = []
    for k, deviation in sorted(zip(felt, best.nuisances[: len(felt)], strict=True), key=lambda item: -abs(item[1])):
        key = problem.nuisances.keys[k]
        entry = problem.nuisances.machine.entries[key]
        if abs(deviation) > LEAST_SHIFT:
            rows.append(
                {
                    "key": key, "unit": entry.unit, "before": float(entry.value),
                    "after": float(moved.entries[key].value), "deviations": float(deviation),
                }
            )  # fmt: skip
    return tuple(rows)


def alike_effects(linear: Linear) -> tuple[tuple[str, str], ...]:
    """Pairs of effects that these recordings cannot tell apart, however large they are."""
    problem = linear.problem
    names, columns = [], []
    for name, axes in problem.axes.items():
        if len(axes) == 1:
            names.append(name)
            columns.append(linear.shifts[name, 0][:, -1])
    if len(names) < 2:
        return ()
    stacked = np.column_stack(columns)
    gram = linear.tangent.projected(stacked, stacked)
    size = np.sqrt(np.maximum(np.diag(gram), 1e-12))
    cosine = gram / np.outer(size, size)
    shown = size > 3.0
    return tuple(
        (names[i], names[j])
        for i in range(len(names))
        for j in range(i + 1, len(names))
        if shown[i] and shown[j] and abs(cosine[i, j]) > LEAST_COSINE
    )
