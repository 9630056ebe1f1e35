"""Cases of the blind check: plants whose deviation is withheld, and what they are told to do.

A case is a plant of the calibrated ensemble at some level of laws (:mod:`aoro_gym.diagnosis_benchmark.plants`) with
nothing, one effect, two, one that the catalogue lacks, or only other nuisances. A commissioned case has logs of the
healthy plant, too; a day-one case has none, and nothing is wrong with its plant only where the twin's laws hold (level
0).

All is drawn by a seed. The family ``development`` is for tuning, ``score`` for what is reported: their plants descend from
different machines, are told to do other things, and no seed gives both the same, as it is mixed with the family's name.
Level 2 and half of the deviations outside the catalogue come in ``score`` only, level 3 in ``development``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.checks import check_choice
from aoro_gym.diagnosis_benchmark.plants.constants import constants_of
from aoro_gym.diagnosis_benchmark.plants.effects import EFFECTS, OUTSIDE, PlantEffect
from aoro_gym.diagnosis_benchmark.plants.runs import TICK, Run
from aoro_gym.diagnosis_benchmark.plants.sensors import SensorNoise
from aoro_gym.machine.machine_file import Parameter
from aoro_gym.machine.parameters import Machine

Array = NDArray[np.float64]

MODES = ("day-one", "commissioned")

KINDS = ("null", "single", "pair", "outside", "nuisance")
"""Nothing, one effect, two, one outside of the catalogue, or nuisances moved farther than a day moves them."""

INSIDE = tuple(name for name in EFFECTS if name not in OUTSIDE)

MACHINES = Path(__file__).parents[1] / "machines"

REST, SETTLE = 0.7, 1.5
"""Time [s] without command before a manoeuvre and after it; in the latter the joint sways for up to a second on its oil."""

WEAKEST = 0.1
"""Least severity of an effect that may have either sign, as a share of its range's end."""

BUILT = 0.05
"""How far (about 95 %) a plant lies from the machine file of its kind, as a share of a parameter's range."""

DAY = 0.02
"""How far (about 95 %) a nuisance lies from its usual value on another day, as a share of its range. Parameters that
effects move, too, stay as :attr:`Parameter.commissioned` says."""

MOVED = 0.25
"""The same where nuisances alone are to make the gap: half of the prior."""

AIR = (3e-3, 1e-2)
"""Share of free air in the oil of a plant above level 0: the upper part of the machine file's range, about the 0.5 % that
simulators take where nothing is known (S17, S18). With less, level 1 hardly differs from level 0."""

FRICTION = (1.2, 1.6)
"""Factor by which seals and joint of a plant above level 0 rub more, or less (estimate), within the file's ranges."""

TRIES = 100
"""Draws of a machine before it counts as impossible to vary."""

TURNS = {
    ("left", 1.0): (-1.0, 2.6), ("left", 0.75): (-1.0, 3.1), ("left", 0.5): (-1.0, 7.1),
    ("right", 1.0): (1.0, 2.8), ("right", 0.75): (1.0, 3.8), ("right", 0.5): (0.0, 7.1),
}  # fmt: skip
"""Where full turns begin, as a share of the joint's range, and for how long [s] their signal is held: what every machine of
the ensemble takes, and a tenth more. The slowest begins in the middle, as all of it takes 11 s."""


@dataclass(frozen=True)
class Suite:
    """How many cases of each kind, and of what all of them have logs: some of the family's excitations, by name, or all."""

    name: str
    null: int
    single: int
    pair: int
    outside: int
    nuisance: int
    logs: tuple[str, ...] | None = None


SUITES: Mapping[str, Suite] = {
    suite.name: suite
    for suite in (
        Suite("quick", null=3, single=4, pair=2, outside=2, nuisance=1, logs=("steps",)),
        Suite("standard", null=60, single=90, pair=45, outside=30, nuisance=15),
        Suite("full", null=200, single=300, pair=150, outside=100, nuisance=50),
    )
}


@dataclass(frozen=True, eq=False)
class Excitation:
    """What a machine is told to do for one log: signals (K,) at every tick, from rest at ``start`` of the joint's range."""

    name: str
    start: float
    steering: Array
    drive: Array | None = None


@dataclass(frozen=True)
class Family:
    """What cases are drawn from.

    Attributes:
        name: Mixed into every seed.
        levels: Of the plants, equally often.
        members: Of the calibrated ensemble that plants descend from.
        outside: Deviations outside of the catalogue.
        excitations: Draws what a plant is told to do.
    """

    name: str
    levels: tuple[int, ...]
    members: tuple[str, ...]
    outside: tuple[str, ...]
    excitations: Callable[[np.random.Generator], tuple[Excitation, ...]]


@dataclass(frozen=True)
class Hidden:
    """A deviation of a plant.

    Attributes:
        id: Of the effect.
        magnitude: ΔQ, SI; one a part where it has several.
        without: Q of the plant without it.
        severity: 0 at the weakest that is drawn, 1 at the end of the effect's range.
    """

    id: str
    magnitude: tuple[float, ...]
    without: tuple[float, ...]
    severity: float

    def as_dict(self) -> dict[str, Any]:
        """As it stands in the answers."""
        effect = EFFECTS[self.id]
        return {
            "component": effect.component, "quantity": effect.quantity, "unit": effect.unit,
            "magnitude": list(self.magnitude), "without": list(self.without), "severity": self.severity,
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class Case:
    """One case.

    Attributes:
        name: Its number, as text.
        kind: One of :data:`KINDS`.
        level: Of the plant's laws.
        twin: Machine file that the user has.
        hidden: Deviations.
        baseline: What a plant above level 0 has for its own, healthy or not: values by key, in the file's units.
        healthy: The plant on the day of its commissioning; None on day one.
        later: The plant on the day that is to be explained, without its deviations.
        excitations: What it does, the same on both days.
        seeds: Of the sensors' noise (days, excitations).
    """

    name: str
    kind: str
    level: int
    twin: Path
    hidden: tuple[Hidden, ...]
    baseline: Mapping[str, float]
    healthy: Machine | None
    later: Machine
    excitations: tuple[Excitation, ...]
    seeds: NDArray[np.int64]

    def runs(self) -> dict[str, list[Run]]:
        """Runs by purpose, one an excitation: ``healthy`` and ``logs``, which the user gets, and of the later day without
        noise ``with`` and ``without`` the deviation, where there is one, and ``without ID`` with the other one alone, where
        there are two."""
        effects = {one.id: one.magnitude if EFFECTS[one.id].parts else one.magnitude[0] for one in self.hidden}
        runs: dict[str, list[Run]] = {}
        if self.healthy is not None:
            runs["healthy"] = self._runs(self.healthy, {}, seeds=self.seeds[0])
        runs["logs"] = self._runs(self.later, effects, seeds=self.seeds[1])
        if self.hidden:
            runs["with"] = self._runs(self.later, effects, noise=EXACT)
            runs["without"] = self._runs(self.later, {}, noise=EXACT)
        for name in effects if len(effects) > 1 else ():
            others = {other: magnitude for other, magnitude in effects.items() if other != name}
            runs[f"without {name}"] = self._runs(self.later, others, noise=EXACT)
        return runs

    def _runs(
        self,
        machine: Machine,
        effects: Mapping[str, Any],
        *,
        seeds: Sequence[int] | None = None,
        noise: SensorNoise | None = None,
    ) -> list[Run]:
        reach = float(machine.joint.range)
        return [
            Run(
                machine.entries, excitation.steering, self.level, effects, excitation.drive, excitation.start * reach,
                0 if seeds is None else int(seeds[index]), noise,
            )
            for index, excitation in enumerate(self.excitations)
        ]  # fmt: skip

    def answer(self) -> dict[str, Any]:
        """What is withheld, as plain values."""
        return {
            "kind": self.kind,
            "level": self.level,
            "machine": self.later.name,
            "effects": {one.id: one.as_dict() for one in self.hidden},
            "baseline": dict(self.baseline),
            "logs": [excitation.name for excitation in self.excitations],
        }


EXACT = SensorNoise.none()


# -------------------------------------------------------------------------------------------------------------- manoeuvres
def _held(*pieces: tuple[float, float]) -> Array:
    """Signal that holds each of ``pieces`` (signal, time [s]) after a rest, and rests again."""
    whole = ((0.0, REST), *pieces, (0.0, SETTLE))
    return np.repeat([signal for signal, _ in whole], [round(time / TICK) for _, time in whole])


def protocol(
    rng: np.random.Generator, *, reach: tuple[float, float], drive: tuple[float, float], driven: float
) -> tuple[Excitation, ...]:
    """Full turns at 100, 75 and 50 %, a ramp, steps with a reversal, a pulse to either side; in some cases a slow drive.

    Args:
        rng: Draws signals between the ends of ``reach``, times, starts and sides.
        reach: Steering signals of all but the full turns.
        drive: Drive signals.
        driven: Share of cases that have a drive.
    """

    def either() -> float:
        return float(rng.choice([-1.0, 1.0]))

    excitations = []
    for (side, signal), (start, hold) in TURNS.items():
        toward = signal if side == "left" else -signal
        excitations.append(Excitation(f"{side}_{100 * signal:.0f}", start, _held((toward, hold))))
    side, peak = either(), rng.uniform(*reach)
    rise, fall = (np.linspace(0.0, 1.0, round(rng.uniform(*times) / TICK)) for times in ((1.8, 2.8), (0.8, 1.4)))
    rest, settle = np.zeros(round(REST / TICK)), np.zeros(round(SETTLE / TICK))
    excitations.append(
        Excitation("ramp", -0.8 * side, np.concatenate([rest, side * peak * rise, side * peak * fall[::-1], settle]))
    )
    side, first, second = either(), rng.uniform(*reach), rng.uniform(*reach)
    steps = (
        (side * first, rng.uniform(0.4, 0.7)),
        (0.6 * side * first, rng.uniform(0.4, 0.7)),  # falls short of zero, which a play of the spool shows in
        (-side * second, rng.uniform(0.7, 1.1)),
    )
    excitations.append(Excitation("steps", side * rng.uniform(-0.7, -0.3), _held(*steps)))  # clear of the stop ahead
    side, length, height = either(), rng.uniform(0.15, 0.4), rng.uniform(*reach)
    pulses = ((side * height, length), (0.0, rng.uniform(0.5, 0.8)), (-side * height, length))
    excitations.append(Excitation("pulse", rng.uniform(-0.2, 0.2), _held(*pulses)))
    if rng.random() < driven:
        side, turning = either(), rng.uniform(*reach)
        before, there, back = rng.uniform(0.8, 1.2), rng.uniform(0.5, 0.9), rng.uniform(0.5, 0.9)
        steering = _held((0.0, before), (side * turning, there), (-side * turning, back))
        rolling = _held((rng.choice([-1.0, 1.0], p=[0.25, 0.75]) * rng.uniform(*drive), before + there + back))
        count = min(len(steering), len(rolling))  # times are rounded to ticks apart
        excitations.append(Excitation("drive", 0.0, steering[:count], rolling[:count]))
    return tuple(excitations)


FAMILIES: Mapping[str, Family] = {
    family.name: family
    for family in (
        Family(
            "score",
            levels=(0, 1, 2),
            members=("02", "04", "06", "08"),
            outside=OUTSIDE,
            excitations=partial(protocol, reach=(0.6, 1.0), drive=(0.15, 0.3), driven=0.4),
        ),
        Family(
            "development",
            levels=(0, 1, 3),
            members=("01", "03", "05", "07"),
            outside=OUTSIDE[::2],
            excitations=partial(protocol, reach=(0.45, 0.8), drive=(0.1, 0.2), driven=0.25),
        ),
    )
}


# ------------------------------------------------------------------------------------------------------------------- draws
def plan(suite: Suite, *, mode: str, family: Family, seed: int) -> list[Case]:
    """The cases of a suite in their order, which tells nothing; the same for the same arguments.

    Raises:
        ValueError: the mode is unknown, or a machine's file leaves no room to vary it.
    """
    check_choice("mode", mode, MODES)
    label = [seed, *f"{suite.name} {mode} {family.name}".encode()]
    rng = np.random.default_rng(label)
    drawn: list[tuple[str, int, list[str]]] = []
    for kind in KINDS:
        count = getattr(suite, kind)
        levels = _in_turn(rng, family.levels, count)
        if mode == "day-one" and kind in ("null", "nuisance"):
            levels = [0] * count  # other laws are a gap
        names = {
            "single": [[name] for name in _in_turn(rng, INSIDE, count)],
            "pair": [rng.choice(INSIDE, 2, replace=False).tolist() for _ in range(count)],
            "outside": [[name] for name in _in_turn(rng, family.outside, count)],
        }.get(kind, [[]] * count)
        drawn += zip([kind] * count, levels, names, strict=True)
    order = rng.permutation(len(drawn))
    cases = []
    for place, index in enumerate(order):
        kind, level, effects = drawn[index]
        own = np.random.default_rng([*label, place])
        cases.append(_case(f"{place + 1:03d}", kind, level, effects, mode, family, suite.logs, own))
    return cases


def _in_turn(rng: np.random.Generator, items: Sequence[Any], count: int) -> list[Any]:
    """``count`` of the ``items`` in random order, all as often as can be."""
    rounds = [rng.permutation(len(items)) for _ in range(-(-count // len(items)))]
    return [items[index] for index in np.concatenate([[], *rounds]).astype(int)[:count]]


def _case(
    name: str,
    kind: str,
    level: int,
    effects: list[str],
    mode: str,
    family: Family,
    logs: Sequence[str] | None,
    rng: np.random.Generator,
) -> Case:
    member = MACHINES / "ensemble" / f"{rng.choice(family.members)}.toml"
    plant = varied(loaded(member), rng, built)
    baseline = baseline_of(plant, rng) if level else {}
    plant = plant.set(baseline, check_ranges=False)
    commissioned = mode == "commissioned"
    spread = _moved if kind == "nuisance" else wandering
    later = varied(plant, rng, spread) if commissioned or kind == "nuisance" else plant
    excitations = tuple(excitation for excitation in family.excitations(rng) if logs is None or excitation.name in logs)
    return Case(
        name=name,
        kind=kind,
        level=level,
        twin=member if commissioned else MACHINES / "aoro.toml",
        hidden=tuple(_hidden(EFFECTS[effect], later, level, rng) for effect in effects),
        baseline=baseline,
        healthy=plant if commissioned else None,
        later=later,
        excitations=excitations,
        seeds=rng.integers(2**63, size=(2, len(excitations))),
    )


loaded = cache(Machine.load)


def built(entry: Parameter) -> float:
    return BUILT * (entry.range[1] - entry.range[0])


def wandering(entry: Parameter) -> float:
    if entry.role == "both":
        return float(entry.commissioned[1] - entry.value)
    return DAY * (entry.range[1] - entry.range[0])


def _moved(entry: Parameter) -> float:
    return wandering(entry) if entry.role == "both" else MOVED * (entry.range[1] - entry.range[0])


def varied(machine: Machine, rng: np.random.Generator, spread: Callable[[Parameter], float]) -> Machine:
    """``machine`` with other values of what is uncertain, within ``spread`` (about 95 %) and within its ranges."""
    uncertain = [entry for entry in machine.entries.values() if entry.role in ("nuisance", "both")]
    values, half = (np.array([float(f(entry)) for entry in uncertain]) for f in (lambda entry: entry.value, spread))
    low, high = np.array([entry.range for entry in uncertain]).T
    refused = ""
    for _ in range(TRIES):
        drawn = values + half * np.clip(rng.standard_normal(len(values)) / 1.96, -1.0, 1.0)
        drawn = np.clip(drawn, np.minimum(low, values), np.maximum(high, values))
        try:
            values_by_key = {entry.key: float(value) for entry, value in zip(uncertain, drawn, strict=True)}
            return machine.set(values_by_key, check_ranges=False)
        except ValueError as error:  # parts that do not fit together
            refused = str(error)
    raise ValueError(
        f"none of {TRIES} draws around machine {machine.name} is valid; the last: {refused}; narrow its ranges"
    )


def baseline_of(machine: Machine, rng: np.random.Generator) -> dict[str, float]:
    """Air and friction, by key, that make a plant above level 0 another machine even with nothing wrong."""
    values = {"oil.gas_fraction": float(np.exp(rng.uniform(*np.log(AIR))))}
    for key in ("steering.cylinder.seal_preload", "joint.friction_torque"):
        entry = machine.entries[key]
        factor = rng.uniform(*FRICTION) ** rng.choice([-1.0, 1.0])
        values[key] = float(np.clip(entry.value * factor, *entry.range))
    return values


def _hidden(effect: PlantEffect, machine: Machine, level: int, rng: np.random.Generator) -> Hidden:
    """``effect`` at a drawn severity: logarithmic from the weakest to the range's end, of a factor in its logarithm; where
    both signs can be, either is as likely."""
    ends = np.log1p([effect.low, effect.high]) if effect.relative else np.array([effect.low, effect.high])
    if effect.low < 0.0 < effect.high:
        most = rng.choice(ends)
        least = WEAKEST * most
    else:
        least, most = sorted(ends, key=abs)
    severity = rng.uniform()
    size = least * (most / least) ** severity
    without = np.ravel(effect.measure(constants_of([machine.entries]), level))
    if effect.relative:
        magnitude = np.expm1(size) * without
    elif effect.parts:
        toward = rng.uniform(0.0, 2.0 * np.pi)
        magnitude = abs(size) * np.array([np.cos(toward), np.sin(toward)])
    else:
        magnitude = np.array([size])
    return Hidden(effect.id, tuple(magnitude.tolist()), tuple(without.tolist()), float(severity))
