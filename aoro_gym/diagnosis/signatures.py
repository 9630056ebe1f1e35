"""What effects do to logs, simulated with every family of laws at a few sizes.

A later log is compared with a healthy one of the same commands, to which the twin adds what should have changed: another
command or start, and effects. So the twin's own error, the same on both days, cancels. Without a healthy log the twin
stands for it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.diagnosis.arrival import AFTER, AHEAD, NEVER, arrivals
from aoro_gym.diagnosis.axes import Axis
from aoro_gym.diagnosis.network.cases import nearest
from aoro_gym.diagnosis.noise import LEAST, Floats, Noise, noise_of
from aoro_gym.diagnosis.recording import TICK, Recording
from aoro_gym.diagnosis.replay import COARSE, Replay, Signals, Simulator, Variants
from aoro_gym.effects.effect import Effect
from aoro_gym.machine import Machine
from aoro_gym.machine.laws import FAMILIES, family
from aoro_gym.machine.parameters import InvalidMachine

ONE_SIDE = (0.1, 0.3, 0.6, 1.0)
"""Nodes of an axis with one side: shares of the way from none to its end. The fit's own size is simulated, too."""
TWO_SIDES = (0.12, 0.45, 1.0)
"""The same on either of two sides."""
SAME_START = 2e-3
"""Difference [rad] of start angles below which one twin without effects stands for both days."""
OWN = "own"
"""Name of the user's laws where they are those of no family."""


@dataclass(frozen=True)
class Log:
    """A later log and the healthy one that it is compared with.

    Attributes:
        later: Recording of F samples.
        healthy: One of the same commands, if there is any.
        beside: Sample (F,) of ``healthy`` beside each of ``later``; empty without one.
        held_out: Whether it takes no part in fits.
    """

    later: Recording
    healthy: Recording | None
    beside: NDArray[np.intp]
    held_out: bool

    @property
    def signals(self) -> tuple[str, ...]:
        """Channels that both have."""
        return tuple(c for c in self.later.channels if self.healthy is None or c in self.healthy.channels)

    @property
    def copies(self) -> float:
        """How many times a sensor's noise is in the difference."""
        return 1.0 if self.healthy is None else 2.0

    def along(self, values: Floats) -> Floats:
        """Samples of the healthy log, beside those of the later one."""
        return np.asarray(values, dtype=np.float64)[self.beside]


def logs_of(later: Sequence[Recording], healthy: Sequence[Recording], held_out: Sequence[Recording] = ()) -> list[Log]:
    """Every later and held-out log beside the healthy one that is most like it."""
    found = []
    for one, left_out in [*((one, False) for one in later), *((one, True) for one in held_out)]:
        number = nearest(one, healthy)
        if number is None:
            found.append(Log(one, None, np.empty(0, dtype=np.intp), left_out))
            continue
        other = healthy[number]
        beside = np.arange(one.ticks + 1) + _begins(other) - _begins(one)
        found.append(Log(one, other, np.clip(beside, 0, other.ticks), left_out))
    return found


def _begins(recording: Recording) -> int:
    """Tick of the first command."""
    moves = np.flatnonzero(np.any(np.abs(recording.commands) > 1e-3, axis=1))
    return int(moves[0]) if len(moves) else 0


def families_of(machine: Machine) -> dict[str, Machine]:
    """The machine with the laws of every family, its own first."""
    found = {name: machine.with_laws(name) for name in FAMILIES}
    mine = [name for name in FAMILIES if family(name).choices == machine.laws.choices]
    if not mine:
        return {OWN: machine, **found}
    return {name: found[name] for name in (*mine, *(name for name in found if name not in mine))}


@dataclass(frozen=True)
class Block:
    """A signal of a log, with K families of laws.

    Attributes:
        log: Number of the log.
        signal: Channel.
        measured: Later log (F,) SI.
        before: Prediction without effects (K, F) SI.
        clock: What a later clock by a second does (F,) SI.
        counts: Samples (F,) that are compared.
        noise: Of the sensor.
        copies: How many times it is in the difference.
    """

    log: int
    signal: str
    measured: Floats
    before: Floats
    clock: Floats
    counts: NDArray[np.bool_]
    noise: Noise
    copies: float

    @property
    def variance(self) -> float:
        """Of the noise in the difference [SI²]."""
        return self.copies * float(max(self.noise.covariance[0], LEAST[self.signal] ** 2))


@dataclass(frozen=True)
class Without:
    """What the twins show without effects.

    Attributes:
        blocks: All signals of all logs.
        twins: By log, by family, signals (F,) of the later day.
        arrivals: By log, sample at which the joint arrives at its stop, −1 if it does not.
    """

    blocks: tuple[Block, ...]
    twins: tuple[tuple[dict[str, Floats], ...], ...]
    arrivals: tuple[int, ...]


def without_effects(logs: Sequence[Log], machines: Sequence[Machine], simulator: Simulator) -> Without:
    """Later logs beside what they should be if nothing had changed."""
    days = [(log, one) for log in logs for one in (log.later, log.healthy) if one is not None and _needed(log, one)]
    bare = [Variants(machine) for machine in machines]
    found = iter(simulator.run([Replay(variants, one, COARSE) for _, one in days for variants in bare]))
    shown: dict[tuple[int, int], list[dict[str, Floats]]] = {}
    for log, one in days:
        shown[id(log), id(one)] = [_only(next(found)) for _ in machines]
    recorded = [one for log in logs for one in (log.later, log.healthy) if one is not None]
    noise: dict[str, Noise] = {}
    for signal in {signal for log in logs for signal in log.signals}:
        noise[signal] = noise_of(recorded, signal, max(one.ticks + 1 for one in recorded))
    blocks, twins, arrived = [], [], []
    for number, log in enumerate(logs):
        later = shown[id(log), id(log.later)]
        healthy = shown.get((id(log), id(log.healthy)), later)
        twins.append(tuple(later))
        instants = _arrivals(log, later)
        arrived.append(int(instants[0]))
        compared = _compared(log.later.ticks + 1, instants)
        for signal in log.signals:
            before = np.stack([_before(log, signal, a, b) for a, b in zip(later, healthy, strict=True)])
            counts = np.ones_like(compared) if signal == "joint_angle" else compared
            clock = -np.gradient(later[0][signal]) / TICK
            measured = np.asarray(log.later.channels[signal], dtype=np.float64)
            blocks.append(Block(number, signal, measured, before, clock, counts, noise[signal], log.copies))
    return Without(tuple(blocks), tuple(twins), tuple(arrived))


def _needed(log: Log, one: Recording) -> bool:
    """Whether the twin would show something else than on the later day."""
    if one is log.later:
        return True
    return one.signature != log.later.signature or abs(one.start_angle - log.later.start_angle) > SAME_START


def _only(signals: Signals) -> dict[str, Floats]:
    return {name: values[:, 0].astype(np.float64) for name, values in signals.items()}


def _before(log: Log, signal: str, later: Mapping[str, Floats], healthy: Mapping[str, Floats]) -> Floats:
    """What is expected of a signal (F,) of the later log if nothing had changed."""
    if log.healthy is None:
        return later[signal]
    measured = log.along(log.healthy.channels[signal])
    return measured if healthy is later else measured + later[signal] - log.along(healthy[signal])


def _arrivals(log: Log, twins: Sequence[Mapping[str, Floats]]) -> Floats:
    """Instants at which the joint arrives at its stop: in the later log, in the healthy one, with every family."""
    angles = [log.later.channels["joint_angle"]]
    angles += [] if log.healthy is None else [log.along(log.healthy.channels["joint_angle"])]
    angles += [one["joint_angle"] for one in twins if "joint_angle" in one]
    return np.round(arrivals(np.stack(angles, axis=1).astype(np.float64), log.later.commands[:, 0]))


def _compared(count: int, instants: Floats) -> NDArray[np.bool_]:
    """Samples (F,) at which pressures are compared: a front that comes earlier on one day than on the other differs by its
    full height, whatever the cause."""
    counts = np.ones(count, dtype=bool)
    there = instants[instants != NEVER]
    if len(there):
        counts[max(int(there.min()) - AHEAD, 0) : int(there.max()) + AFTER] = False
    return counts


@dataclass(frozen=True)
class Nodes:
    """What an effect does with one family of laws at a few sizes.

    Attributes:
        axes: Its magnitudes that are searched.
        places: By axis, places (m,) that were simulated.
        shifts: By axis and number of the block, (F, m) SI.
    """

    axes: tuple[Axis, ...]
    places: tuple[Floats, ...]
    shifts: tuple[tuple[Floats, ...], ...]


def axes_of(effect: Effect, side: int = 0) -> tuple[Axis, ...]:
    """Magnitudes that are searched, of an effect on one ``side`` of none, −1 or 1, or on either. A second one of another
    unit stays at none: it says how, and not how much."""
    first, *rest = effect.magnitudes
    count = 1 + sum(one.unit == first.unit for one in rest)
    both = first.low < first.none < first.high and not side
    return tuple(Axis(effect, index, TWO_SIDES if both else ONE_SIDE) for index in range(count))


def nodes_on(axis: Axis, side: int) -> Floats:
    """Places of an axis that are simulated on a ``side`` of none, or on either."""
    where = axis.nodes
    if side and len(axis.effect.magnitudes) == 1:
        where = where[(where - axis.none) * side > 0.0]
    return where


def settings_of(axes: Sequence[Axis], values: Sequence[Any]) -> tuple[Any, ...]:
    """Magnitudes that an effect takes, from the ``values`` of its axes, one each."""
    effect = axes[0].effect
    return (*values, *effect.none[len(axes) :])


def signatures(
    effects: Mapping[str, tuple[Axis, ...]],
    sides: Mapping[str, int],
    logs: Sequence[Log],
    machines: Sequence[Machine],
    without: Without,
    simulator: Simulator,
) -> dict[str, list[Nodes]]:
    """What effects do along their axes, by effect and family, in one go.

    Args:
        effects: Axes by id.
        sides: By id, the side of none that is simulated: 1, -1, or 0 for both.
        logs: Whose commands are repeated.
        machines: One of each family of laws.
        without: What these do without effects.
        simulator: Of the twins.
    """
    tasks, layout = [], []
    for name, axes in effects.items():
        for k, machine in enumerate(machines):
            wanted = [(i, z) for i, axis in enumerate(axes) for z in nodes_on(axis, sides.get(name, 0))]
            valid, variants = _variants(machine, axes, wanted)
            layout.append((name, k, axes, valid))
            tasks += [Replay(variants, log.later, COARSE) for log in logs] if variants else []
    shown = iter(simulator.run(tasks) if tasks else [])
    out: dict[str, list[Nodes]] = {name: [] for name in effects}
    for name, k, axes, valid in layout:
        signals = [next(shown) for _ in logs] if valid else []
        good = _sound(signals, len(valid))
        columns = [[j for j, (i, _) in enumerate(valid) if i == a and good[j]] for a in range(len(axes))]
        places = tuple(np.array([valid[j][1] for j in mine]) for mine in columns)
        shifts = tuple(
            tuple(
                signals[b.log][b.signal][:, mine].astype(np.float64) - without.twins[b.log][k][b.signal][:, None]
                if mine
                else np.empty((len(b.measured), 0))
                for b in without.blocks
            )
            for mine in columns
        )
        out[name].append(Nodes(axes, places, shifts))
    return out


def _variants(
    machine: Machine, axes: Sequence[Axis], wanted: Sequence[tuple[int, float]]
) -> tuple[list[tuple[int, float]], Variants | None]:
    """Those of the ``wanted`` nodes, axis and place, that a machine can have, as variants of it."""

    def built(nodes: Sequence[tuple[int, float]]) -> Variants:
        values = [
            np.array([float(axis.value(z)) if i == a else axis.magnitude.none for i, z in nodes])
            for a, axis in enumerate(axes)
        ]
        return Variants.of(machine, [(axes[0].effect, settings_of(axes, values))], len(nodes))

    try:
        return list(wanted), built(wanted)
    except InvalidMachine:
        valid = []
        for node in wanted:
            try:
                built([node])
            except InvalidMachine:
                continue
            valid.append(node)
        return valid, built(valid) if valid else None


def _sound(signals: Sequence[Signals], count: int) -> NDArray[np.bool_]:
    """Which variants diverge in no log (count,)."""
    good = np.ones(count, dtype=bool)
    for one in signals:
        for values in one.values():
            good &= np.all(np.isfinite(values), axis=0)
    return good
