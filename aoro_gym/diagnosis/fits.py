"""How large causes are and how much of the gap they close: fits of sizes, by simulation, to what changed on the later day.

Nobody knows a machine's laws, and what an effect does differs between them. So each cause is fitted with every family of
laws (:mod:`.signatures`), which weighs sizes by how well they explain the logs (:mod:`.sizes`). Intervals hold the spread
over families. How much of the gap a cause closes is told on logs that took no part in the fit (:mod:`.closures`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator
from scipy.stats import norm

from aoro_gym.diagnosis.axes import Axis
from aoro_gym.diagnosis.closures import black_box, gap_closures, typical
from aoro_gym.diagnosis.network.shape import QUANTILES
from aoro_gym.diagnosis.noise import Floats
from aoro_gym.diagnosis.places import Gap, places
from aoro_gym.diagnosis.recording import TICK, Recording
from aoro_gym.diagnosis.replay import COARSE, Replay, Simulator, Variants
from aoro_gym.diagnosis.result import Cause, CredibleInterval, Curve, GapClosure, Place
from aoro_gym.diagnosis.signatures import (
    Block,
    Log,
    Nodes,
    Without,
    axes_of,
    families_of,
    logs_of,
    settings_of,
    signatures,
    without_effects,
)
from aoro_gym.diagnosis.sizes import Evidence, Interpolation, Weighed, settled, weigh, zero_of
from aoro_gym.effects.catalogue import EFFECTS
from aoro_gym.effects.effect import ChainEffect, Effect, GroundEffect
from aoro_gym.machine import Machine
from aoro_gym.machine.parameters import InvalidMachine

ERROR = 0.3
"""Share of what changed by which the twin errs in any case (E): what effects do under two families of laws has a median
cosine of 0.74 to 0.92."""
DAYS = 0.02
"""Share of a signal's scatter by which days differ without a cause (E)."""
TRUST = 0.3
"""Factor on differences of evidence between families of laws: none of them is the machine's, so that one which explains a
little more is not much likelier (E)."""
OWN_LAWS = 2.0
"""Cost by which another family must explain more than the machine's own laws to be shown (E)."""
SHOWN = 0.02
"""Weight of a family from which its best size is simulated."""
ROUNDS = 2
"""Simulations of the best sizes, all effects of a cause together."""
MOVED = 0.02
"""Way on an axis beyond which a size is simulated again."""
SCORES = tuple(norm.ppf(QUANTILES).tolist())
"""Quantiles of a standard normal, at the levels at which networks give those of sizes."""
TABLE = {1: 41, 2: 13}
"""Places of an axis at which operational magnitudes are measured, by the number of an effect's axes."""
DRAWS = 400
"""Sizes that are drawn for intervals, and of them the :data:`PREDICTED` that are predicted."""
PREDICTED = 24

Quantiles = Sequence[float] | Floats
"""Of a change, at :data:`SCORES`."""


@dataclass(frozen=True)
class Fit:
    """A cause with the sizes that explain the logs best.

    Attributes:
        effects: Ids.
        settings: By effect, the magnitudes that the twin takes.
        changes: By effect, how far its operational magnitudes [SI] lie from those of the twin without it, one or two.
        shrinkage: Of the gap, by log and signal, fitted and held out.
        family: Laws with which the cause explains most.
        misfits: By family, cost that the fit leaves, as a share of that without effects.
        curves: With that family.
        machine_file: Written machine with the effects, relative to the result; empty if none was written.
        components: Parts of the machine that the effects lie in.
    """

    effects: tuple[str, ...]
    settings: Mapping[str, tuple[float, ...]]
    changes: Mapping[str, tuple[CredibleInterval, ...]]
    shrinkage: tuple[GapClosure, ...]
    family: str
    misfits: Mapping[str, float]
    curves: tuple[Curve, ...]
    machine_file: str = ""
    components: tuple[str, ...] = ()

    @property
    def held_out_S(self) -> float | None:
        """Median over logs that took no part in the fit, and signals; None if there is none."""
        return typical(self.shrinkage)

    def cause(self, probability: float) -> Cause:
        """As a diagnosis lists it."""
        return Cause(self.effects, probability, self.changes, self.settings, self.components, self.machine_file)


@dataclass(frozen=True)
class Fits:
    """Causes in the order in which they were asked for, where the gap lies, and what a black box closes of it (median S)."""

    causes: tuple[Fit, ...]
    places: tuple[Place, ...]
    black_box: float | None

    def __getitem__(self, effects: tuple[str, ...]) -> Fit:
        return next(one for one in self.causes if set(one.effects) == set(effects))

    def controls(self, effects: tuple[str, ...]) -> dict[str, float | None]:
        """Median held-out S of a cause, of the best other one of as many effects that shares none, and of a black box."""
        others = [
            one for one in self.causes if len(one.effects) == len(effects) and not set(one.effects) & set(effects)
        ]
        found = [S for one in others if (S := one.held_out_S) is not None]
        wrong = max(found) if found else None
        return {"cause": self[effects].held_out_S, "wrong_cause": wrong, "black_box": self.black_box}


@dataclass
class _Hypothesis:
    """A cause with one family of laws, and what is known of its sizes so far."""

    machine: Machine
    family: int
    nodes: list[Nodes]
    blocks: Sequence[Block]
    known: Sequence[Callable[[Floats], Floats] | None] = ()
    """By effect, costs (P,) of places (P, axes) by what is known of its size beforehand."""
    apart: Sequence[Sequence[Callable[[Floats], Floats] | None]] = ()
    """The same by the other logs, by the number of the log that is left out; empty: nothing."""
    together: list[Floats] = field(default_factory=list)
    """By block, what the effects do at :attr:`simulated` beyond the sum of what interpolation says (F,) SI."""
    simulated: Floats | None = None

    def __post_init__(self) -> None:
        self.interpolation = Interpolation(self.nodes)
        self.together = [np.zeros(len(block.measured)) for block in self.blocks]
        self.shifts = [
            np.concatenate([shifts[b] for one in self.nodes for shifts in one.shifts], axis=1)
            for b in range(len(self.blocks))
        ]

    def prior(self, where: Floats, left_out: int | None = None) -> Floats:
        """Costs (P,) of places (P, axes) by what is known beforehand, from the other logs if one is ``left_out``."""
        if left_out is not None and not self.apart:
            return np.zeros(len(where))
        cost, column = np.zeros(len(where)), 0
        for one, known in zip(self.nodes, self.known if left_out is None else self.apart[left_out], strict=True):
            mine = where[:, column : column + len(one.axes)]
            column += len(one.axes)
            cost += 0.0 if known is None else known(mine)
        return cost

    def weighed(self, logs: NDArray[np.bool_], left_out: int | None = None) -> Weighed:
        """Sizes by some of the ``logs`` (L,)."""
        prior = partial(self.prior, left_out=left_out)
        return weigh(self.evidence, self.interpolation, prior, self.scale, logs)

    def update(self) -> None:
        """Moments of the residuals once :attr:`together` is known."""
        columns, floors = [], []
        for block, shifts, more in zip(self.blocks, self.shifts, self.together, strict=True):
            change = block.measured - block.before[self.family]
            columns.append(np.column_stack([change - more, shifts, block.clock])[block.counts])
            floors.append(block.variance + ERROR**2 * float(np.mean(np.square(change[block.counts]))))
        zeros = [zero_of(block.signal) for block in self.blocks]
        self.evidence = Evidence.of([block.log for block in self.blocks], columns, floors, zeros)
        self.scale = settled(self.evidence, self.interpolation, self.prior)

    def misfit(self, best: Floats, logs: NDArray[np.bool_]) -> float:
        """Cost of the residuals at a place (axes,), as a share of that without effects."""
        weights = np.stack([self.interpolation(best[None])[0], np.zeros(self.shifts[0].shape[1])])
        left, whole = self.evidence.costs(weights, self.scale) @ logs
        return float(left / max(whole, 1e-12))

    def after(self, block: int, where: Floats) -> Floats:
        """Prediction (F, P) SI with the effects at places (P, axes)."""
        moved = self.shifts[block] @ self.interpolation(where).T
        return (self.blocks[block].before[self.family] + self.together[block])[:, None] + moved

    def values(self, where: Floats) -> list[tuple[Any, ...]]:
        """Magnitudes of every effect at ``where`` (axes,) or (P, axes)."""
        out, column = [], 0
        for one in self.nodes:
            found = [axis.value(where[..., column + i]) for i, axis in enumerate(one.axes)]
            column += len(one.axes)
            out.append(settings_of(one.axes, found))
        return out

    def variants(self, where: Floats) -> Variants:
        """The machine with all effects; raises InvalidMachine where there can be none."""
        effects = [one.axes[0].effect for one in self.nodes]
        settings = [tuple(float(value) for value in values) for values in self.values(where)]
        return Variants.of(self.machine, list(zip(effects, settings, strict=True)), 1)


def fit(
    machine: Machine,
    later: Sequence[Recording],
    healthy: Sequence[Recording] = (),
    causes: Sequence[tuple[str, ...]] = (),
    *,
    held_out: Sequence[Recording] = (),
    quantiles: Mapping[str, Quantiles] | None = None,
    quantiles_without: Sequence[Mapping[str, Quantiles]] = (),
    effects: Mapping[str, Effect] = EFFECTS,
    simulator: Simulator | None = None,
    out: Path | None = None,
) -> Fits:
    """Fit the sizes of causes.

    Args:
        machine: One variant, as it is known.
        later: Logs of the later day.
        healthy: Of a day on which nothing was wrong. A later log for whose commands there is none is compared with the twin.
        causes: Ids of the effects of each.
        held_out: Logs of the later day that take no part in any fit; without them each of ``later`` is left out in turn.
        quantiles: By effect, the five of the change of its first operational magnitude [SI] if it is known beforehand
            (:data:`SCORES`): sizes are weighed by them, too, and where all have one sign, the other one is not simulated.
        quantiles_without: The same by each of ``later`` without that log; without them only the other logs themselves
            say how large effects are where one is left out.
        effects: What there is, by id.
        simulator: On a CPU by default.
        out: Folder that machine files are written to, below ``machines``.

    Raises:
        ValueError: there is no recording of the later day.
        KeyError: a cause is in no catalogue.
    """
    if not later:
        raise ValueError("no recording of the later day given; name at least one log")
    device = simulator or Simulator()
    logs, machines = logs_of(later, healthy, held_out), families_of(machine)
    without = without_effects(logs, list(machines.values()), device)
    given = quantiles or {}
    sides = {name: _side(effects[name], machine, given.get(name, ())) for cause in causes for name in cause}
    axes = {name: axes_of(effects[name], side) for name, side in sides.items()}
    found = signatures(axes, sides, logs, list(machines.values()), without, device)
    hypotheses = [
        [
            _Hypothesis(
                one,
                k,
                [found[name][k] for name in cause],
                without.blocks,
                _knowns(cause, one, axes, given),
                [_knowns(cause, one, axes, others) for others in quantiles_without],
            )
            for k, one in enumerate(machines.values())
        ]
        for cause in causes
    ]
    fitted = np.array([not log.held_out for log in logs])
    _settle(hypotheses, logs, fitted, without, device)
    reported = tuple(
        _fit(cause, own, list(machines), logs, fitted, effects, out)
        for cause, own in zip(causes, hypotheses, strict=True)
    )
    folds = [(learned, log) for learned, log in _folds(fitted)]
    boxed = black_box(logs, without.blocks, [(np.flatnonzero(learned).tolist(), log) for learned, log in folds])
    return Fits(reported, _places(logs, without), boxed)


def _side(effect: Effect, machine: Machine, quantiles: Quantiles) -> int:
    """The side of none, −1 or 1 along the magnitude, on which the change of the operational magnitude has one sign and lies
    by all ``quantiles``; 0 for either."""
    first = effect.magnitudes[0]
    if not (first.low < first.none < first.high) or len(effect.magnitudes) > 1 or not len(quantiles):
        return 0
    if min(quantiles) * max(quantiles) <= 0.0:
        return 0
    at = [float(np.ravel(effect.measured(machine, value)[0])[0]) for value in (first.low, first.none, first.high)]
    rising = np.sign(at[2] - at[0])
    return int(rising * np.sign(quantiles[0])) if (at[2] - at[1]) * (at[1] - at[0]) > 0.0 else 0


def _knowns(
    cause: tuple[str, ...],
    machine: Machine,
    axes: Mapping[str, tuple[Axis, ...]],
    quantiles: Mapping[str, Quantiles],
) -> list[Callable[[Floats], Floats] | None]:
    """By effect of a cause."""
    return [_known(axes[name][0].effect, machine, axes[name], quantiles.get(name)) for name in cause]


def _known(
    effect: Effect, machine: Machine, axes: Sequence[Axis], quantiles: Quantiles | None
) -> Callable[[Floats], Floats] | None:
    """Costs (P,) of an effect's places (P, axes) by the ``quantiles`` of the change of its first operational magnitude: half
    the square of the normal score, which is linear between them and beyond."""
    if quantiles is None:
        return None
    each = [np.linspace(0.0, 1.0, TABLE[len(axes)]) for _ in axes]
    where = [one.ravel() for one in np.meshgrid(*each, indexing="ij")]
    values = settings_of(axes, [axis.value(z) for axis, z in zip(axes, where, strict=True)])
    changes = _operational(effect, machine, values, len(where[0]))[0].reshape([len(one) for one in each])
    table = RegularGridInterpolator(each, changes)
    # quantiles that coincide have a slope all the same
    least = 1e-3 * max(float(np.ptp(quantiles)), 1e-3 * float(np.nanmax(np.abs(changes))), 1e-300)
    knots = np.maximum.accumulate(np.asarray(quantiles, dtype=np.float64) + least * np.arange(len(quantiles)))

    def cost(places: Floats) -> Floats:
        change = table(np.clip(places, 0.0, 1.0))
        score = np.interp(change, knots, SCORES)
        for end, inner in ((0, 1), (-1, -2)):
            slope = (SCORES[end] - SCORES[inner]) / (knots[end] - knots[inner])
            beyond = change < knots[0] if end == 0 else change > knots[-1]
            score = np.where(beyond, SCORES[end] + slope * (change - knots[end]), score)
        return np.where(np.isfinite(score), 0.5 * np.square(score), np.inf)

    return cost


def _settle(
    hypotheses: Sequence[Sequence[_Hypothesis]],
    logs: Sequence[Log],
    fitted: NDArray[np.bool_],
    without: Without,
    simulator: Simulator,
) -> None:
    """Simulate the best sizes, of likely families, until they stay where they are."""
    for own in hypotheses:
        for one in own:
            one.update()
    for _ in range(ROUNDS):
        asked: list[tuple[_Hypothesis, Floats, Variants]] = []
        for own in hypotheses:
            weighed = [one.weighed(fitted) for one in own]
            for one, found, weight in zip(own, weighed, _weights(weighed), strict=True):
                best = found.best
                still = one.simulated is not None and np.all(np.abs(best - one.simulated) < MOVED)
                if weight > SHOWN and not still:
                    try:
                        asked.append((one, best, one.variants(best)))
                    except InvalidMachine:
                        continue
        if not asked:
            return
        shown = iter(simulator.run([Replay(variants, log.later, COARSE) for _, _, variants in asked for log in logs]))
        for one, best, _ in asked:
            signals = [next(shown) for _ in logs]
            _learn(one, best, signals, without)


def _learn(one: _Hypothesis, best: Floats, signals: Sequence[Mapping[str, Floats]], without: Without) -> None:
    """Take what was simulated at the best sizes for what their effects do there."""
    weights = one.interpolation(best[None])[0]
    together = [
        signals[block.log][block.signal][:, 0].astype(np.float64)
        - without.twins[block.log][one.family][block.signal]
        - shifts @ weights
        for block, shifts in zip(one.blocks, one.shifts, strict=True)
    ]
    if all(np.all(np.isfinite(more)) for more in together):
        one.together, one.simulated = together, best
        one.update()


def _weights(weighed: Sequence[Weighed]) -> Floats:
    """Of the families (K,)."""
    evidence = TRUST * np.array([one.evidence for one in weighed])
    return np.exp(evidence - np.logaddexp.reduce(evidence))


def _folds(fitted: NDArray[np.bool_]) -> list[tuple[NDArray[np.bool_], int]]:
    """Logs (L,) that are learned from, and the one that is not; of a single log there is none."""
    if not np.all(fitted):
        return [(fitted, int(log)) for log in np.flatnonzero(~fitted)]
    if len(fitted) < 2:
        return []
    return [(np.arange(len(fitted)) != log, log) for log in range(len(fitted))]


def _drawn(own: Sequence[_Hypothesis], weighed: Sequence[Weighed]) -> list[Floats]:
    """Places (n, axes) by family, :data:`DRAWS` altogether, in the order of their drawing."""
    rng = np.random.default_rng(0)
    families = rng.choice(len(own), p=_weights(weighed), size=DRAWS)
    out = []
    for k, one in enumerate(weighed):
        chances = np.exp(-(one.costs - one.least))
        mine = rng.choice(len(chances), p=chances / chances.sum(), size=int(np.sum(families == k)))
        out.append(one.places[mine])
    return out


def _shown(own: Sequence[_Hypothesis], weighed: Sequence[Weighed]) -> int:
    """Number of the family that explains most, or of the machine's own, the first, if it is hardly worse."""
    least = np.array([one.least for one in weighed])
    best = int(np.argmin(least))
    return best if least[0] - least[best] > OWN_LAWS else 0


def _fit(
    cause: tuple[str, ...],
    own: Sequence[_Hypothesis],
    names: Sequence[str],
    logs: Sequence[Log],
    fitted: NDArray[np.bool_],
    effects: Mapping[str, Effect],
    out: Path | None,
) -> Fit:
    """What is reported of a cause."""
    weighed = [one.weighed(fitted) for one in own]
    drawn, k = _drawn(own, weighed), _shown(own, weighed)
    shown, best = own[k], weighed[k].best
    shrinkage = [
        closure
        for log in np.flatnonzero(fitted)
        for closure in _closures(own, drawn, (k, best), int(log), logs, held_out=False)
    ]
    for learned, log in _folds(fitted):
        if np.all(learned == fitted):
            again, others, at = drawn, k, best
        else:
            found = [one.weighed(learned, log) for one in own]
            again, others = _drawn(own, found), _shown(own, found)
            at = found[others].best
        shrinkage += _closures(own, again, (others, at), log, logs, held_out=True)
    settings = {
        name: tuple(float(value) for value in values) for name, values in zip(cause, shown.values(best), strict=True)
    }
    return Fit(
        effects=cause,
        settings=settings,
        changes=_changes(cause, own, drawn, effects),
        shrinkage=tuple(shrinkage),
        family=names[k],
        misfits={
            name: hypothesis.misfit(one.best, fitted) for name, one, hypothesis in zip(names, weighed, own, strict=True)
        },
        curves=_curves(shown, best, logs),
        machine_file=_machine_file(cause, shown, best, effects, out),
        components=tuple(dict.fromkeys(effects[name].component for name in cause)),
    )


def _closures(
    own: Sequence[_Hypothesis],
    drawn: Sequence[Floats],
    shown: tuple[int, Floats],
    log: int,
    logs: Sequence[Log],
    *,
    held_out: bool,
) -> list[GapClosure]:
    """Of all signals of a log, with the family and the places ``shown`` and, for their intervals, those ``drawn``."""
    k, best = shown
    share = PREDICTED / DRAWS
    out: list[GapClosure] = []
    for b, block in enumerate(own[k].blocks):
        if block.log != log:
            continue
        few = [(one, where[: round(share * len(where))]) for one, where in zip(own, drawn, strict=True)]
        moved = [one.after(b, where) - block.before[one.family][:, None] for one, where in few if len(where)]
        before = block.before[k]
        draws = before[:, None] + np.concatenate(moved, axis=1)
        after = own[k].after(b, best[None])[:, 0]
        out += gap_closures(logs[log].later.name, block, before, after, draws, held_out=held_out)
    return out


def _changes(
    cause: tuple[str, ...], own: Sequence[_Hypothesis], drawn: Sequence[Floats], effects: Mapping[str, Effect]
) -> dict[str, tuple[CredibleInterval, ...]]:
    """Changes of the operational magnitudes by the effects, over families and sizes."""
    found: dict[str, list[list[Floats]]] = {name: [] for name in cause}
    for one, where in zip(own, drawn, strict=True):
        if not len(where):
            continue
        for name, values in zip(cause, one.values(where), strict=True):
            found[name].append(_operational(effects[name], one.machine, values, len(where)))
    out = {}
    for name, families in found.items():
        parts = []
        for part, quantity in enumerate(effects[name].operational):
            changes = np.concatenate([family[part] for family in families])
            low, median, high = np.nanquantile(changes, [0.05, 0.5, 0.95])
            parts.append(CredibleInterval(float(median), float(low), float(high), quantity.unit, quantity.quantity))
        out[name] = tuple(parts)
    return out


def _operational(effect: Effect, machine: Machine, values: tuple[Any, ...], count: int) -> list[Floats]:
    """Changes (n,) of each operational magnitude; NaN where no machine can have the effect."""
    without = effect.measured(machine, *effect.none)
    try:
        at = effect.measured(machine, *values)
    except InvalidMachine:
        if count == 1:
            return [np.full(1, np.nan) for _ in without]
        each = [
            _operational(effect, machine, tuple(np.broadcast_to(value, count)[i : i + 1] for value in values), 1)
            for i in range(count)
        ]
        return [np.concatenate([one[part] for one in each]) for part in range(len(without))]
    return [
        np.broadcast_to(np.asarray(new, dtype=np.float64) - old, count) for new, old in zip(at, without, strict=True)
    ]


def _curves(shown: _Hypothesis, best: Floats, logs: Sequence[Log]) -> tuple[Curve, ...]:
    """Signals with the family that is shown."""
    out = []
    for b, block in enumerate(shown.blocks):
        log = logs[block.log]
        spread = np.where(block.counts, np.sqrt(shown.evidence.floors[b]), np.nan)
        out.append(
            Curve(
                log.later.name, block.signal, log.held_out, TICK * np.arange(len(block.measured)), block.measured,
                block.before[shown.family], shown.after(b, best[None])[:, 0], spread,
            )
        )  # fmt: skip
    return tuple(out)


def _machine_file(
    cause: tuple[str, ...], shown: _Hypothesis, best: Floats, effects: Mapping[str, Effect], out: Path | None
) -> str:
    """Write the machine with its effects, where they all lie in the machine and there can be one."""
    if out is None or any(isinstance(effects[name], ChainEffect | GroundEffect) for name in cause):
        return ""
    try:
        changed = shown.variants(best).machine
    except InvalidMachine:
        return ""
    file = f"machines/{'+'.join(cause)}.toml"
    (out / "machines").mkdir(parents=True, exist_ok=True)
    changed.save(out / file)
    return file


def _places(logs: Sequence[Log], without: Without) -> tuple[Place, ...]:
    """Where the gap to the machine with its own laws lies."""
    gaps = []
    for block in without.blocks:
        residual = np.where(block.counts, block.measured - block.before[0], 0.0)
        swing = float(np.std(block.before[0][block.counts]))
        std = float(np.sqrt(block.variance + (DAYS * swing) ** 2 + zero_of(block.signal) ** 2))
        gaps.append(Gap(logs[block.log].later, block.signal, residual, std, without.arrivals[block.log]))
    return places(gaps)
