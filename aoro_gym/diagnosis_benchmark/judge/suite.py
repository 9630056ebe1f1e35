"""The suite that a diagnosis is judged on, as a plan: which plant does what under which deviation, all by a seed.

Several cases share a machine of a family and its healthy day, so that a calibration per machine serves them all. A case
follows one of the suite's protocols: a few manoeuvres from one pool. The later day is its own.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from hashlib import sha256
from typing import Any

import numpy as np

from aoro_gym.diagnosis_benchmark import component_families, independent
from aoro_gym.diagnosis_benchmark.cases import Excitation, protocol
from aoro_gym.diagnosis_benchmark.judge.plants import PlantRun, Plants

KINDS = ("healthy", "single", "pair", "outside")

FAMILIAR = independent.FAMILIAR | component_families.FAMILIAR
"""Deviations of independent and component plants whose like anybody may train on; the other half nobody may."""


@dataclass(frozen=True)
class Suite:
    """How many cases of which.

    Attributes:
        name: Of the suite, mixed into the seed.
        healthy: Cases with nothing wrong.
        singles: With one effect, of each family.
        pairs: With two.
        outside: With a deviation outside of the catalogue, half of kinds that nothing was trained on.
        machines: Of each family, that cases share.
        protocols: Sets of manoeuvres.
        logs: Manoeuvres of a protocol.
        draws: Of ramp, steps, pulses and drive for the pool, beside the six full turns.
        only: Manoeuvres of the pool; all by default.
    """

    name: str
    healthy: int
    singles: int
    pairs: int
    outside: int
    machines: int
    protocols: int
    logs: int
    draws: int
    only: tuple[str, ...] | None = None


SUITES: Mapping[str, Suite] = {
    one.name: one
    for one in (
        Suite("small", 30, 33, 18, 18, 6, 1, 2, 1, only=("left_100", "steps_1")),
        Suite("seal", 564, 165, 216, 240, 24, 20, 4, 4),
    )
}


@dataclass(frozen=True)
class JudgedCase:
    """A case of the plan.

    Attributes:
        name: Its number.
        kind: One of :data:`KINDS`.
        family: Of its plant.
        machine: Number of the family's machine.
        protocol: Number of its set of manoeuvres.
        effects: Number of the direction and share of the way to the strongest size, by effect.
        outside: Name and size of a deviation outside of the catalogue.
        novel: Whether nothing was trained on that kind.
        seed: Of its later day and its noise.
    """

    name: str
    kind: str
    family: str
    machine: int
    protocol: int
    effects: Mapping[str, tuple[int, float]]
    outside: tuple[str, float] | None
    novel: bool
    seed: int


@dataclass(frozen=True, eq=False)
class Plan:
    """All cases of a suite.

    Attributes:
        suite: How many of which.
        seed: Of all draws.
        excitations: The pool of manoeuvres by name.
        protocols: Names of the manoeuvres of each.
        cases: In their order, which tells nothing.
    """

    suite: Suite
    seed: int
    excitations: Mapping[str, Excitation]
    protocols: tuple[tuple[str, ...], ...]
    cases: tuple[JudgedCase, ...]

    @property
    def digest(self) -> str:
        """SHA-256 of all that the plan says."""
        content = {
            "suite": asdict(self.suite),
            "seed": self.seed,
            "excitations": {
                name: [one.start, one.steering.tolist(), None if one.drive is None else one.drive.tolist()]
                for name, one in self.excitations.items()
            },
            "protocols": self.protocols,
            "cases": [asdict(case) for case in self.cases],
        }
        return sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    def machine(self, plants: Plants, number: int) -> Any:
        """A machine of the plan, on its healthy day."""
        return plants.machine(np.random.default_rng([self.seed, number, *plants.name.encode()]))

    def runs(self, case: JudgedCase, plants: Plants, healthy: Any) -> dict[str, list[PlantRun]]:
        """Runs of a case by purpose: ``healthy`` and ``logs``, of two effects ``without ID``, too.

        Args:
            case: The case.
            plants: Its family.
            healthy: Its machine.
        """
        rng = np.random.default_rng(case.seed)
        later = plants.another_day(healthy, rng)
        seeds = rng.integers(2**62, size=(2, len(self.protocols[case.protocol])))
        sizes = {name: plants.effects[name][place].size(share) for name, (place, share) in case.effects.items()}
        excitations = [self.excitations[name] for name in self.protocols[case.protocol]]
        runs = {
            "healthy": [PlantRun(healthy, e, seed=int(s)) for e, s in zip(excitations, seeds[0], strict=True)],
            "logs": [
                PlantRun(later, e, sizes, case.outside, int(s)) for e, s in zip(excitations, seeds[1], strict=True)
            ],
        }
        for name in sizes if len(sizes) > 1 else ():
            others = {other: size for other, size in sizes.items() if other != name}
            runs[f"without {name}"] = [PlantRun(later, e, others) for e in excitations]
        return runs


def pool(rng: np.random.Generator, draws: int, only: Sequence[str] | None = None) -> dict[str, Excitation]:
    """Manoeuvres by name: six full turns, and ``draws`` each of a ramp, steps, pulses and a slow drive."""
    found = {}
    for draw in range(1, draws + 1):
        for one in protocol(rng, reach=(0.5, 1.0), drive=(0.1, 0.3), driven=1.0):
            turn = one.name.startswith(("left", "right"))
            name = one.name if turn else f"{one.name}_{draw}"
            found.setdefault(name, Excitation(name, one.start, one.steering, one.drive))
    return found if only is None else {name: found[name] for name in only}


def plan(suite: Suite, families: Sequence[Plants], seed: int) -> Plan:
    """The plan of a suite; the same for the same arguments.

    Every effect, every family, machine and protocol comes as often as another, as far as counts allow; sizes are
    uniform in their logarithm between the weakest and the strongest.
    """
    rng = np.random.default_rng([seed, *suite.name.encode()])
    excitations = pool(rng, suite.draws, suite.only)
    turns = [name for name in excitations if name.startswith(("left", "right"))]
    protocols = tuple(_protocol(rng, list(excitations), turns, suite.logs) for _ in range(suite.protocols))
    drawn: list[tuple[str, Plants, list[str], tuple[str, bool] | None]] = []
    drawn += [("healthy", plants, [], None) for plants in _in_turn(rng, families, suite.healthy)]
    for plants in families:
        drawn += [("single", plants, [effect], None) for effect in _in_turn(rng, list(plants.effects), suite.singles)]
    for plants in _in_turn(rng, families, suite.pairs):
        drawn.append(("pair", plants, rng.choice(list(plants.effects), 2, replace=False).tolist(), None))
    for number, plants in enumerate(_in_turn(rng, families, suite.outside)):
        novel = number // len(families) % 2 == 1
        kinds = [name for name in plants.outside if (name not in FAMILIAR) == novel] or list(plants.outside)
        drawn.append(("outside", plants, [], (str(rng.choice(kinds)), novel)))
    machines = {plants.name: _in_turn(rng, range(suite.machines), len(drawn)) for plants in families}
    numbers = _in_turn(rng, range(suite.protocols), len(drawn))
    cases = []
    for place, index in enumerate(rng.permutation(len(drawn))):
        kind, plants, effects, outside = drawn[index]
        sizes = {name: (int(rng.integers(len(plants.effects[name]))), float(rng.uniform())) for name in effects}
        cases.append(
            JudgedCase(
                f"{place + 1:04d}", kind, plants.name, int(machines[plants.name].pop()), int(numbers[index]), sizes,
                (outside[0], float(rng.uniform())) if outside else None, bool(outside and outside[1]),
                int(rng.integers(2**62)),
            )
        )  # fmt: skip
    return Plan(suite, seed, excitations, protocols, tuple(cases))


def _protocol(rng: np.random.Generator, names: list[str], turns: list[str], count: int) -> tuple[str, ...]:
    """A full turn and other manoeuvres, in the order of the pool."""
    first = str(rng.choice(turns))
    others = rng.choice([name for name in names if name != first], count - 1, replace=False).tolist()
    return tuple(name for name in names if name in (first, *others))


def _in_turn(rng: np.random.Generator, items: Sequence[Any], count: int) -> list[Any]:
    """``count`` of the ``items`` in random order, all as often as can be."""
    rounds = [rng.permutation(len(items)) for _ in range(-(-count // len(items)))]
    return [items[index] for index in np.concatenate([[], *rounds]).astype(int)[:count]]
