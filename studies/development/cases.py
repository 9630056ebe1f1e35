"""Cases of the development plants, made again from a seed: a machine's healthy day and a later one, four logs each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from aoro_gym.diagnosis.recording import Recording
from aoro_gym.diagnosis_benchmark import independent
from aoro_gym.diagnosis_benchmark.cases import Excitation
from aoro_gym.diagnosis_benchmark.judge.features import CHANNELS
from aoro_gym.diagnosis_benchmark.judge.plants import (
    ComponentPlants,
    IndependentPlants,
    LayeredPlants,
    Log,
    PlantRun,
    Plants,
)
from aoro_gym.diagnosis_benchmark.judge.suite import SUITES, JudgedCase, Plan, Suite, plan
from aoro_gym.execution.files import written_whole
from aoro_gym.units import BAR, LITRE_PER_MINUTE

LAYERED: tuple[LayeredPlants, ...] = tuple(LayeredPlants(level) for level in (0, 1, 2, 3))
"""Plants around the calibrated ensemble, whose laws the twin does not share."""
INDEPENDENT: tuple[IndependentPlants, ...] = tuple(IndependentPlants(name) for name in independent.FAMILIES)
"""Plants that share nothing with the twin."""
TAUGHT: tuple[str, ...] = ("elm", "fir", "hazel")
"""Component families that were judged once and have taught since."""
COMPONENT: tuple[IndependentPlants, ...] = tuple(ComponentPlants(name) for name in TAUGHT)
"""Plants that share nothing with the twin either, and but the integrator with :data:`INDEPENDENT`."""
OPENED: tuple[tuple[int, tuple[IndependentPlants, ...]], ...] = (
    (112849172439076219896902514827477302792, INDEPENDENT),
    (193628089705577519851568687749887461767, COMPONENT),
)
"""Seeds of judged suites, and their plants: each was scored once and has been open since: they judge no more."""
SUITE = Suite("development", 600, 231, 400, 400, machines=24, protocols=40, logs=4, draws=4)
"""2,324 cases: healthy ones, singles of each level, pairs, and what the catalogue lacks."""
SIZE_UNITS: Mapping[tuple[str, str], float] = {
    ("bar", "Pa"): BAR, ("L/min", "m^3/s"): LITRE_PER_MINUTE, ("mrad", "rad"): 1e-3, ("deg", "rad"): np.pi / 180.0,
    ("N m", "N*m"): 1.0,
    ("m³/s", "m^3/s"): 1.0,
    **{(unit, unit): 1.0 for unit in ["s", "1", "K", "N", "kg", "Pa", "m^3/s", "rad", "N*m", "1/s", "N/m", "m^3/Pa"]},
}  # fmt: skip
"""Of plants' magnitudes and of the twin's: those of other pairs are not the same quantity, and not compared."""
TOGETHER, DEVICE_TOGETHER = 60, 4000
"""Cases that are simulated in one go by a processor and by a GPU, which takes as long for many as for few."""


@dataclass(frozen=True)
class DevelopmentCase:
    """A case, the true change of each effect's operational magnitude [SI], and its recordings."""

    case: JudgedCase
    sizes: dict[str, list[float]]
    healthy: Sequence[Recording]
    later: Sequence[Recording]

    def with_channels(self, channels: Sequence[str], logs: int | None = None) -> DevelopmentCase:
        """The same with fewer channels, and with the first ``logs`` only."""
        healthy, later = (
            [replace(one, channels={name: one.channels[name] for name in channels}) for one in recordings[:logs]]
            for recordings in (self.healthy, self.later)
        )
        return replace(self, healthy=healthy, later=later)


def planned(seed: int, suite: Suite = SUITE) -> Plan:
    """The plan of :data:`LAYERED`."""
    return plan(suite, LAYERED, seed)


def opened() -> list[tuple[Plan, tuple[IndependentPlants, ...]]]:
    """The plans of :data:`OPENED`, 1,515 cases each, and their plants."""
    return [(plan(SUITES["seal"], plants, seed), plants) for seed, plants in OPENED]


def cases_of(
    made: Plan, plants: Plants, kind: str | None = None, most: int | None = None, together: int = TOGETHER
) -> Iterator[DevelopmentCase]:
    """Simulates the cases of a family, some ``together``; the first ``most`` of one ``kind`` if asked for."""
    own = [case for case in made.cases if case.family == plants.name and kind in (None, case.kind)][:most]
    machines = {number: made.machine(plants, number) for number in {case.machine for case in own}}
    for first in range(0, len(own), together):
        part = own[first : first + together]
        runs = [made.runs(case, plants, machines[case.machine]) for case in part]
        logs = iter(plants.record([run for each in runs for run in each["healthy"] + each["logs"]], exact=False))
        for case, each in zip(part, runs, strict=True):
            told = magnitudes(plants, case, each["logs"][0])
            sizes = {name: list(magnitude["magnitude"]) for name, magnitude in told.items()}
            both = [[recording(run.excitation, next(logs)) for run in each[day]] for day in ("healthy", "logs")]
            yield DevelopmentCase(case, sizes, *both)


def magnitudes(plants: Plants, case: JudgedCase, run: PlantRun) -> dict[str, dict[str, Any]]:
    """True change of each effect's magnitude and its unit, as the plants measure it, of a ``run`` of the later day."""
    return {name: plants.magnitude(name, run.machine, run.effects[name]) for name in case.effects}


def recording(told: Excitation, log: Log) -> Recording:
    """A plant's log as a diagnosis reads it."""
    count = len(told.steering)
    commands = np.zeros((count - 1, 2))
    commands[:, 0] = told.steering[:-1]
    if told.drive is not None:
        commands[:, 1] = told.drive[:-1]
    channels = {name: np.asarray(log[name][:count], dtype=np.float64) for name in CHANNELS}
    rest = int(np.flatnonzero(np.any(np.abs(commands) > 1e-3, axis=1))[0])
    return Recording(told.name, commands, channels, rest, float(np.mean(channels["joint_angle"][:rest])))


def simulated(folder: Path, made: Plan, plants: Plants, together: int = TOGETHER) -> Path:
    """File of a family's cases, simulated where the folder has none of this plan."""
    path = folder / f"cases_{made.digest[:8]}_{plants.name}.npz"
    if not path.exists():
        _write(path, list(cases_of(made, plants, together=together)))
    return path


def kept(folder: Path, made: Plan, plants: Plants) -> list[DevelopmentCase]:
    """Cases of a family, simulated where the folder has none of this plan."""
    return _read(simulated(folder, made, plants), made)


def _write(path: Path, cases: Sequence[DevelopmentCase]) -> None:
    arrays: dict[str, np.ndarray] = {}
    for one in cases:
        for day, recordings in (("healthy", one.healthy), ("later", one.later)):
            for number, log in enumerate(recordings):
                signals = np.stack([log.channels[name] for name in CHANNELS]).astype(np.float32)
                arrays[f"{one.case.name}/{day}/{number}"] = signals
        for name, size in one.sizes.items():
            arrays[f"{one.case.name}/size/{name}"] = np.array(size)
    with written_whole(path) as temporary:
        np.savez(temporary, allow_pickle=False, **arrays)


def _read(path: Path, made: Plan) -> list[DevelopmentCase]:
    with np.load(path) as kept_arrays:
        arrays = dict(kept_arrays)
    found = []
    for case in made.cases:
        if f"{case.name}/later/0" not in arrays:
            continue
        told = [made.excitations[name] for name in made.protocols[case.protocol]]
        days = [
            [
                recording(one, dict(zip(CHANNELS, arrays[f"{case.name}/{day}/{number}"], strict=True)))
                for number, one in enumerate(told)
            ]
            for day in ("healthy", "later")
        ]
        sizes = {name: arrays[f"{case.name}/size/{name}"].tolist() for name in case.effects}
        found.append(DevelopmentCase(case, sizes, *days))
    return found
