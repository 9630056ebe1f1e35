"""Plants of any family behind one protocol: what the judge and the suite ask of them, whatever their laws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol

import numpy as np

from aoro_gym.diagnosis_benchmark import cases, component_families, independent
from aoro_gym.diagnosis_benchmark.cases import Excitation
from aoro_gym.diagnosis_benchmark.judge.features import CHANNELS, Floats
from aoro_gym.diagnosis_benchmark.plants import effects as layered
from aoro_gym.diagnosis_benchmark.plants.constants import constants_of
from aoro_gym.diagnosis_benchmark.plants.runs import Run, record
from aoro_gym.machine.machine_file import Parameter

Log = Mapping[str, Floats]


@dataclass(frozen=True)
class Path:
    """Sizes of an effect in one direction: of either sign, or of one mix of its parts.

    Attributes:
        direction: Unit vector over the parts of the size; ±1 where it has one part.
        weak: Least size that cases draw.
        strong: Largest one.
    """

    direction: tuple[float, ...]
    weak: float
    strong: float

    def size(self, share: float) -> tuple[float, ...]:
        """Size (parts,) a share of the geometric way from ``weak`` to ``strong``; as the family measures it."""
        return tuple(self.weak * (self.strong / self.weak) ** share * np.array(self.direction))


@dataclass(frozen=True, eq=False)
class PlantRun:
    """One log to be made.

    Attributes:
        machine: As the family draws it.
        excitation: What it is told to do.
        effects: Sizes (parts,) by effect.
        outside: Name of a deviation outside of the catalogue and its size, 0 weak to 1 strong.
        seed: Of the sensors' noise, and of when and where a deviation happens.
    """

    machine: Any
    excitation: Excitation
    effects: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    outside: tuple[str, float] | None = None
    seed: int = 0


class Plants(Protocol):
    """A family of plants: machines that share their laws."""

    @property
    def name(self) -> str: ...

    @property
    def effects(self) -> Mapping[str, tuple[Path, ...]]:
        """Directions and ranges by effect of the catalogue."""
        ...

    @property
    def outside(self) -> tuple[str, ...]:
        """Deviations outside of the catalogue."""
        ...

    def machine(self, rng: np.random.Generator) -> Any:
        """A healthy machine."""
        ...

    def another_day(self, machine: Any, rng: np.random.Generator) -> Any:
        """The same machine on another day."""
        ...

    def magnitude(self, effect: str, machine: Any, size: tuple[float, ...]) -> dict[str, Any]:
        """Change of the effect's magnitude that a size makes on a machine, as answers hold it: ``magnitude`` (parts,) and
        ``unit``; ValueError if the machine cannot have it."""
        ...

    def record(self, runs: Sequence[PlantRun], *, exact: bool) -> list[Log]:
        """Logs of runs with the columns :data:`CHANNELS`, SI at 100 Hz; ``exact`` ones without noise of the sensors."""
        ...


@dataclass(frozen=True)
class IndependentPlants:
    """A family of :mod:`aoro_gym.diagnosis_benchmark.independent`."""

    PACKAGE: ClassVar[Any] = independent
    """Where families, effects, deviations and recording are."""
    JUDGING: ClassVar[tuple[str, ...]] = independent.FAMILIES
    """Families that suites of these plants are of, whatever others the package has."""

    name: str
    device: str = "cpu"

    @property
    def effects(self) -> Mapping[str, tuple[Path, ...]]:
        return {
            name: tuple(Path((float(sign),), one.weak, one.strong) for sign in one.signs)
            for name, one in self.PACKAGE.EFFECTS.items()
        }

    @property
    def outside(self) -> tuple[str, ...]:
        return tuple(self.PACKAGE.OUTSIDE)

    def machine(self, rng: np.random.Generator) -> Any:
        return self.PACKAGE.machine(self.name, rng)

    def another_day(self, machine: Any, rng: np.random.Generator) -> Any:
        return self.PACKAGE.another_day(self.name, machine, rng)

    def magnitude(self, effect: str, machine: Any, size: tuple[float, ...]) -> dict[str, Any]:
        without = self.PACKAGE.measure(effect, self.name, machine)
        changed = self.PACKAGE.measure(effect, self.name, self.PACKAGE.apply(effect, self.name, machine, size[0]))
        unit = self.PACKAGE.EFFECTS[effect].unit
        change = changed / without - 1.0 if unit == "relative" else changed - without
        return {"magnitude": [change], "unit": unit}

    def record(self, runs: Sequence[PlantRun], *, exact: bool) -> list[Log]:
        made = [
            self.PACKAGE.Run(
                self.name,
                run.machine,
                run.excitation.steering,
                {effect: size[0] for effect, size in run.effects.items()},
                run.excitation.drive,
                run.excitation.start * run.machine["stop_angle"],
                run.seed,
                *(run.outside or (None, 0.0)),
            )
            for run in runs
        ]
        return [
            {channel: log[channel] for channel in CHANNELS}
            for log in self.PACKAGE.record(made, self.device, noise=not exact)
        ]


@dataclass(frozen=True)
class ComponentPlants(IndependentPlants):
    """A family of :mod:`aoro_gym.diagnosis_benchmark.component_families`, or a mixture of some by its name."""

    PACKAGE: ClassVar[Any] = component_families
    JUDGING: ClassVar[tuple[str, ...]] = ("elm", "fir", "hazel")


@dataclass(frozen=True)
class SealedPlants(ComponentPlants):
    """A family of :mod:`aoro_gym.diagnosis_benchmark.component_families` that judges and nothing else."""

    JUDGING: ClassVar[tuple[str, ...]] = component_families.SEALED


JUDGED: Mapping[str, type[IndependentPlants]] = {
    "independent": IndependentPlants,
    "component": ComponentPlants,
    "sealed": SealedPlants,
}
"""Plants that a judged suite may be of."""
OPEN: tuple[str, ...] = ("independent", "component")
"""Groups of families that anybody may know: what can be told apart in any suite is judged beside them."""


def judged_plants(group: str, device: str = "cpu") -> list[IndependentPlants]:
    """The judging families of a group of :data:`JUDGED`."""
    plants = JUDGED[group]
    return [plants(name, device) for name in plants.JUDGING]


@dataclass(frozen=True)
class LayeredPlants:
    """A level of laws of :mod:`aoro_gym.diagnosis_benchmark.plants`, around the calibrated ensemble."""

    level: int
    device: str = "cpu"

    @property
    def name(self) -> str:
        return f"level_{self.level}"

    @property
    def effects(self) -> Mapping[str, tuple[Path, ...]]:
        return {name: _paths(layered.EFFECTS[name]) for name in cases.INSIDE}

    @property
    def outside(self) -> tuple[str, ...]:
        return layered.OUTSIDE

    def machine(self, rng: np.random.Generator) -> Any:
        member = rng.choice([name for family in cases.FAMILIES.values() for name in family.members])
        plant = cases.varied(cases.loaded(cases.MACHINES / "ensemble" / f"{member}.toml"), rng, cases.built)
        return plant.set(cases.baseline_of(plant, rng), check_ranges=False) if self.level else plant

    def another_day(self, machine: Any, rng: np.random.Generator) -> Any:
        return cases.varied(machine, rng, cases.wandering)

    def magnitude(self, effect: str, machine: Any, size: tuple[float, ...]) -> dict[str, Any]:
        return {
            "magnitude": list(self._change(effect, machine.entries, size)),
            "unit": layered.EFFECTS[effect].unit,
        }

    def record(self, runs: Sequence[PlantRun], *, exact: bool) -> list[Log]:
        noise = cases.EXACT if exact else None
        logs = record([self._run(run, noise) for run in runs], device=self.device)
        return [{channel: log.channels[channel][:-1] for channel in CHANNELS} for log in logs]

    def _run(self, run: PlantRun, noise: Any) -> Run:
        entries = run.machine.entries
        sizes = dict(run.effects)
        if run.outside is not None:
            name, share = run.outside
            path = _paths(layered.EFFECTS[name])[0]
            sizes[name] = path.size(share)
        changes = {name: self._change(name, entries, size) for name, size in sizes.items()}
        return Run(
            entries,
            run.excitation.steering,
            self.level,
            {name: change if len(change) > 1 else change[0] for name, change in changes.items()},
            run.excitation.drive,
            run.excitation.start * float(run.machine.joint.range),
            run.seed,
            noise,
        )

    def _change(self, effect: str, entries: Mapping[str, Parameter], size: tuple[float, ...]) -> Floats:
        if not layered.EFFECTS[effect].relative:
            return np.array(size)
        without = np.ravel(layered.EFFECTS[effect].measure(constants_of([entries]), self.level))
        return np.expm1(np.array(size)) * without


def _paths(effect: layered.PlantEffect) -> tuple[Path, ...]:
    """Directions of a plant effect, a relative one in logarithms; of two parts, either sign of either part."""
    low, high = np.log1p([effect.low, effect.high]) if effect.relative else (effect.low, effect.high)
    if low < 0.0 < high:
        return tuple(Path((float(np.sign(end)),), cases.WEAKEST * abs(end), abs(float(end))) for end in (high, low))
    least, most = sorted((abs(float(low)), abs(float(high))))
    if effect.parts:
        return tuple(Path(one, least, most) for one in ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)))
    return (Path((float(np.sign(high or low)),), least, most),)
