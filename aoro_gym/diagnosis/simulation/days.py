"""Machines and days drawn from the prior: records of twins, the ground under them, and what is wrong with them.

A machine has :data:`HEALTHY` days on which nothing is wrong and several later ones, on which something may be. All arrays
have one row a day, machine by machine, its healthy days first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from aoro_gym.diagnosis.simulation import forms, outsiders
from aoro_gym.diagnosis.simulation.prior import KINDS, Prior
from aoro_gym.effects.catalogue import EFFECTS, IDS
from aoro_gym.effects.effect import Effect, Magnitude
from aoro_gym.machine import Machine
from aoro_gym.machine.ensemble import bundled_ensemble
from aoro_gym.machine.parameters import InvalidMachine
from aoro_gym.terrains.plane import Plane
from aoro_gym.twin.records import pack

Floats = NDArray[np.float64]

CHAIN = ("sensor_delay", "sensor_filter", "sensor_gain", "measuring_chain")
"""Effects of the measuring chain, which act where signals are sampled."""
HEALTHY = 2
"""Days of a machine on which nothing is wrong; the first is what a user compares with, the second repeats it."""
ATTEMPTS = 60
"""Times that what no machine can have is halved before it is given up."""


@dataclass(frozen=True)
class Days:
    """N days of machines.

    Attributes:
        records: Of the twins (N,).
        joint_range: [rad] to either side (N,).
        slope: Rise of the ground ahead and to the left [rad] (N, 2).
        chain: Magnitudes of :data:`CHAIN` (N, 4).
        kind: Number in :data:`~aoro_gym.diagnosis.simulation.prior.KINDS` (N,).
        effects: Numbers in the catalogue (N, 2), −1 for none.
        outsider: Number in :data:`~aoro_gym.diagnosis.simulation.outsiders.ALL` (N,), −1 for none.
        without: First operational magnitude [SI] of :attr:`effects` without them (N, 2).
        change: How much the effects change it [SI] (N, 2).
        severity: Sizes as shares of the effects' ranges (N, 2), beyond 1 where the prior goes beyond them.
    """

    records: NDArray[np.void]
    joint_range: Floats
    slope: Floats
    chain: Floats
    kind: NDArray[np.int8]
    effects: NDArray[np.int16]
    outsider: NDArray[np.int16]
    without: Floats
    change: Floats
    severity: Floats

    @classmethod
    def joined(cls, parts: list[Days]) -> Days:
        """Days of all ``parts``, one after the other."""
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in cls.__dataclass_fields__))

    def of(self, rows: NDArray[np.intp]) -> Days:
        """Some of the days, by number."""
        return Days(*(getattr(self, name)[rows] for name in Days.__dataclass_fields__))


@cache
def bases() -> tuple[Machine, ...]:
    """Machines that others are drawn around."""
    return (Machine.load("aoro"), Machine.load("aoro_datasheet"), *bundled_ensemble())


def draw_days(prior: Prior, machines: int, later: int, seed: int) -> Days:
    """``machines`` machines with :data:`HEALTHY` healthy and ``later`` later days each; the same for the same seed."""
    rng = np.random.default_rng(seed)
    healthy = draw_machines(prior, machines, rng)
    return _with_days(prior, _with_baseline(prior, healthy, rng), later, rng)


def draw_machines(prior: Prior, count: int, rng: np.random.Generator) -> Machine:
    """``count`` machines in random order, at least two: around each of the bases, at each of the spreads."""
    groups = [
        (base, spread, laws, share / len(bases()) / len(prior.spreads))
        for base in bases()
        for spread in prior.spreads
        for laws, share in (("any", 1.0 - prior.families), ("families", prior.families))
    ]
    counts = rng.multinomial(count, [share for *_, share in groups])
    parts = [
        base.sample(max(int(many), 2), laws=laws, parameters=spread, seed=int(rng.integers(2**31))).variants(
            np.arange(many)
        )
        for (base, spread, laws, _), many in zip(groups, counts, strict=True)
        if many
    ]
    return Machine.stacked(parts, [part.num_variants for part in parts]).variants(rng.permutation(count))


def _with_baseline(prior: Prior, machine: Machine, rng: np.random.Generator) -> Machine:
    """Machines some of which have, healthy, a little of what effects bring."""
    values = {}
    for key, largest in prior.baselines.items():
        has = rng.random(machine.num_variants) < prior.baseline
        low = -largest if key in prior.signed else 0.0
        values[key] = np.where(has, rng.uniform(low, largest, machine.num_variants), machine.entries[key].value)
    return machine.set(values, check_ranges=False)


def _with_days(prior: Prior, machine: Machine, later: int, rng: np.random.Generator) -> Days:
    """The healthy days of each of N machines, and ``later`` others."""
    count, days = machine.num_variants, HEALTHY + later
    every = np.repeat(np.arange(count), days)
    factor = np.repeat(np.exp(rng.uniform(*np.log(prior.day_factor), size=count)), days)
    own = np.exp(rng.uniform(*np.log(prior.share_factor), size=(len(prior.day_shares), count)))
    drifted = another_day(prior, machine.variants(every), factor, rng, np.repeat(own, days, axis=1))
    slope = factor[:, None] * prior.slope * rng.standard_normal((count * days, 2))
    kind = rng.choice(len(KINDS), p=prior.weights, size=count * days).astype(np.int8)
    kind.reshape(count, days)[:, :HEALTHY] = 0
    return _affected(prior, drifted, slope, kind, rng)


def another_day(
    prior: Prior, machine: Machine, factor: Floats, rng: np.random.Generator, own: Floats | float = 1.0
) -> Machine:
    """Each variant as it is on some day: small changes of all that is uncertain, of the oil's temperature and the load.

    Args:
        prior: Says by how much.
        machine: N variants.
        factor: On all changes (N,).
        rng: Random numbers.
        own: Factor on each of ``prior.day_shares`` besides (shares, N).
    """
    entries = [one for one in machine.entries.values() if one.role in ("nuisance", "both")]
    values = np.array([np.broadcast_to(one.value, machine.num_variants) for one in entries])
    half = np.array(
        [
            np.broadcast_to(one.commissioned[1] - np.asarray(one.value), machine.num_variants)
            if one.role == "both"
            else np.full(machine.num_variants, prior.day * (one.range[1] - one.range[0]))
            for one in entries
        ]
    )
    low, high = np.array([one.range for one in entries]).T[:, :, None]
    change = factor * half * np.clip(rng.standard_normal(values.shape), -2.5, 2.5) / 1.96

    def moved(machine: Machine, share: Floats) -> Machine:
        drawn = np.clip(values + share * change, np.minimum(low, values), np.maximum(high, values))
        return machine.set({one.key: drawn[i] for i, one in enumerate(entries)}, check_ranges=False)

    machine = _as_far_as_it_goes(moved, machine)
    normal = own * np.clip(rng.standard_normal((len(prior.day_shares), machine.num_variants)), -2.5, 2.5)
    grown = {
        key: factor * size * draw
        for (keys, size), draw in zip(prior.day_shares.items(), normal, strict=True)
        for key in keys.split()
    }
    machine = _as_far_as_it_goes(
        lambda m, share: m.scale({key: np.exp(share * one) for key, one in grown.items()}, check_ranges=False), machine
    )
    warmer = np.clip(factor * prior.temperature * rng.standard_normal(machine.num_variants), -15.0, 15.0)
    load = np.maximum(factor * prior.load * rng.standard_normal(machine.num_variants), 0.0)
    machine = _as_far_as_it_goes(lambda m, share: EFFECTS["oil_temperature"].apply(m, share * warmer), machine)
    return _as_far_as_it_goes(lambda m, share: EFFECTS["payload"].apply(m, share * load), machine)


def _as_far_as_it_goes(changed: Callable[[Machine, Floats], Machine], machine: Machine) -> Machine:
    """``changed(machine, share)`` with the largest shares (N,), 1 or halved again and again, that a machine can have."""
    share = np.ones(machine.num_variants)
    for _ in range(ATTEMPTS):
        try:
            return changed(machine, share)
        except InvalidMachine as error:
            share = np.where(np.broadcast_to(error.shown[0][1], share.shape), 0.5 * share, share)
    return machine


def _affected(prior: Prior, machine: Machine, slope: Floats, kind: NDArray[np.int8], rng: np.random.Generator) -> Days:
    """Days with what is wrong on them; rows in the order of the variants."""
    count = machine.num_variants
    effects = np.full((count, 2), -1, dtype=np.int16)
    effects[:, 0] = np.where((kind == 1) | (kind == 2), rng.integers(len(IDS), size=count), -1)
    other = (effects[:, 0] + rng.integers(1, len(IDS), size=count)) % len(IDS)
    effects[:, 1] = np.where(kind == 2, other, -1)
    outsider = np.where(kind == 3, rng.choice(len(outsiders.ALL), p=outsiders.SHARES, size=count), -1).astype(np.int16)
    days = Days(
        records=pack(machine),
        joint_range=np.zeros(count),
        slope=slope.copy(),
        chain=np.zeros((count, len(CHAIN))),
        kind=kind,
        effects=effects,
        outsider=outsider,
        without=np.zeros((count, 2)),
        change=np.zeros((count, 2)),
        severity=np.zeros((count, 2)),
    )
    for place in range(2):
        machine = _changed(
            machine,
            effects[:, place],
            lambda part, rows, number, place=place: _with_effect(
                prior, part, EFFECTS[IDS[number]], days, rows, place, rng
            ),
        )
    of_machine = np.where(outsider < len(outsiders.MACHINE) + len(outsiders.DRAWN), outsider, -1)
    machine = _changed(machine, of_machine, lambda part, rows, number: deviating(part, outsiders.ALL[number], rng))
    days.records[:] = pack(machine)
    days.joint_range[:] = machine.joint.range
    return _without_idle(days)


def _changed(
    machine: Machine,
    choice: NDArray[np.integer],
    change: Callable[[Machine, NDArray[np.intp], int], Machine],
) -> Machine:
    """``machine`` with ``change(part, rows, number)`` of the rows of every number (N,) that is not negative."""
    parts, order = [], []
    for number in np.unique(choice):
        rows = np.flatnonzero(choice == number)
        twice = rows if len(rows) > 1 else np.repeat(rows, 2)  # a machine of one variant has no arrays
        part = machine.variants(twice)
        changed = part if number < 0 else change(part, twice, int(number))
        parts.append(changed.variants(np.arange(len(rows))))
        order.append(rows)
    return Machine.stacked(parts, list(map(len, order))).variants(np.argsort(np.concatenate(order)))


def _without_idle(days: Days) -> Days:
    """``days`` without effects that a machine's laws know nothing of: a static compensator is never late."""
    idle = (days.effects >= 0) & (days.change == 0.0)
    days.effects[idle] = -1
    second = (days.effects[:, 0] < 0) & (days.effects[:, 1] >= 0)
    for rows in (days.effects, days.without, days.change, days.severity):
        rows[second] = rows[second][:, ::-1]
    known = days.kind < 3
    days.kind[known] = (days.effects[known] >= 0).sum(axis=1)
    return days


def _with_effect(
    prior: Prior,
    machine: Machine,
    effect: Effect,
    days: Days,
    rows: NDArray[np.intp],
    place: int,
    rng: np.random.Generator,
) -> Machine:
    """``machine``, whose variants are the days' ``rows``, with ``effect`` as their cause number ``place``."""
    magnitudes, severity = draw_magnitudes(effect, len(rows), (prior.weakest, prior.strongest), rng)
    formed = forms.drawn_form(effect, len(rows), prior.own_form, prior.mixed_form, prior.varied_form, rng)
    without = np.broadcast_to(effect.measured(machine, *effect.none)[0], len(rows))
    none = np.array(effect.none)[:, None]
    share = np.ones(len(rows))
    for _ in range(ATTEMPTS):
        reduced = tuple(none + share * (magnitudes - none))
        try:
            affected, measured = formed.apply(machine, *reduced), effect.measured(machine, *reduced)[0]
            break
        except InvalidMachine as error:
            share = np.where(np.broadcast_to(error.shown[0][1], share.shape), 0.7 * share, share)
    else:
        raise ValueError(f"effect {effect.id}: {ATTEMPTS} reductions leave no machine that can have it")
    days.without[rows, place] = without
    days.change[rows, place] = np.broadcast_to(measured, len(rows)) - without
    days.severity[rows, place] = severity * share
    if effect.id in CHAIN:
        days.chain[rows, CHAIN.index(effect.id)] = reduced[0]
    if effect.id == "ground_slope":
        days.slope[rows] += np.stack(reduced, axis=1)
    return affected


def draw_magnitudes(
    effect: Effect, count: int, ends: tuple[float, float], rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Magnitudes (m, count) of an effect and their sizes as shares of its range (count,).

    Sizes are logarithmically even between ``ends``, of a factor in its logarithm and no more than 1; where both signs can
    be, either is as likely; two magnitudes of one unit share their size at a random angle, a second one of another unit is
    drawn on its own.
    """
    first, *rest = effect.magnitudes
    most = min(ends[1], 1.0) if first.scale == "log" else ends[1]
    severity = np.exp(rng.uniform(np.log(ends[0]), np.log(most), count))
    if rest and rest[0].unit == first.unit:
        angle = rng.uniform(0.0, 2.0 * np.pi if first.low < first.none else 0.5 * np.pi, count)
        return first.high * severity * np.array([np.cos(angle), np.sin(angle)]), severity
    drawn = [_sized(first, severity, rng)]
    for one in rest:
        low, high = (np.log(one.low), np.log(one.high)) if one.scale == "log" else (one.low, one.high)
        even = rng.uniform(low, high, count)
        drawn.append(np.exp(even) if one.scale == "log" else even)
    return np.array(drawn), severity


def _sized(one: Magnitude, severity: Floats, rng: np.random.Generator) -> Floats:
    """A magnitude at shares of its range, to either side of none."""
    ends = np.array([one.low, one.high])
    if one.scale == "log":
        ends, none = np.log(ends), np.log(one.none)
    else:
        none = one.none
    sides = ends[np.abs(ends - none) > 0.0]
    end = rng.choice(sides, len(severity))
    least = 0.0 if one.least is None else one.least
    size = none + np.maximum(severity * np.abs(end - none), least) * np.sign(end - none)
    return np.exp(size) if one.scale == "log" else size


def deviating(machine: Machine, kind: str, rng: np.random.Generator) -> Machine:
    """``machine`` with a deviation of :data:`outsiders.MACHINE` or :data:`outsiders.DRAWN`."""
    count = machine.num_variants
    if kind == "another_machine":
        return machine.variants(np.roll(np.arange(count), 1))
    if kind == "any_parameters":
        keys = free_parameters()
        moved = np.argsort(rng.random((len(keys), count)), axis=0) < rng.integers(1, outsiders.MOST_FREE + 1, count)
        low, high = np.log(outsiders.FREE_FACTOR)
        size = rng.uniform(low, high, moved.shape)
        factors = dict(zip(keys, np.exp(rng.choice([-1.0, 1.0], moved.shape) * size * moved), strict=True))
    else:
        at = rng.random(count)  # one draw for all
        factors = {
            key: np.exp((1.0 - at) * np.log(a) + at * np.log(b)) for key, (a, b) in outsiders.MACHINE[kind].items()
        }
    return _as_far_as_it_goes(
        lambda m, share: m.scale({key: values**share for key, values in factors.items()}, check_ranges=False), machine
    )


@cache
def free_parameters() -> tuple[str, ...]:
    """Uncertain parameters of what a log shows that no effect moves, in any of its forms."""
    entries, moved = bases()[0].entries.values(), forms.moved_keys()
    return tuple(
        one.key
        for one in entries
        if one.role == "nuisance" and one.key.startswith(outsiders.FREE) and one.key not in moved
    )


def planes(slope: Floats) -> Plane:
    """Planes (N,) that rise by ``slope`` (N, 2) [rad] ahead and to the left."""
    return EFFECTS["ground_slope"].tilt(Plane(), slope[:, 0], slope[:, 1])
