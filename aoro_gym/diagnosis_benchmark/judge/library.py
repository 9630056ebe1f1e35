"""What effects and days do to some machines of a family, manoeuvre by manoeuvre: simulated once, for all protocols.

The machines and their days are the same in all manoeuvres, so that the features of a protocol, any set of these
manoeuvres, are those of its manoeuvres side by side.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path as File
from typing import Any

import numpy as np

from aoro_gym.diagnosis_benchmark.cases import Excitation
from aoro_gym.diagnosis_benchmark.judge.features import CHANNELS, Floats, Means, features, means, paired, windows
from aoro_gym.diagnosis_benchmark.judge.plants import PlantRun, Plants
from aoro_gym.execution.files import written_whole


@dataclass(frozen=True)
class Extent:
    """How much a library holds.

    Attributes:
        machines: Whose days are compared.
        days: Of each, the first of which is the healthy one.
        changed: Machines that are given effects.
        shares: Of the way from the weakest to the strongest size.
    """

    machines: int = 12
    days: int = 4
    changed: int = 3
    shares: tuple[float, ...] = (0.0, 0.33, 0.67, 1.0)


@dataclass(frozen=True)
class Library:
    """A family's changes, by manoeuvre.

    Attributes:
        family: Its name.
        paths: Effect and number of its direction, one a row of ``effects``.
        days: Means of noisy logs of healthy machines (machines, days).
        exact: Of the same logs without noise.
        effects: Exact differences (paths, shares, machines, channels, means) that an effect makes on a day; NaN where a
            machine cannot have that size.
    """

    family: str
    paths: tuple[tuple[str, int], ...]
    days: Mapping[str, Means]
    exact: Mapping[str, Means]
    effects: Mapping[str, Floats]

    def signatures(self, manoeuvres: Sequence[str], channels: Sequence[int]) -> Floats:
        """Features (paths, shares, machines, features) of effects."""
        return features([self.effects[name] for name in manoeuvres], channels)

    def day_pairs(self, manoeuvres: Sequence[str], channels: Sequence[int]) -> Floats:
        """Features (pairs, features) between any two days of a healthy machine, with noise."""
        days = self.days[manoeuvres[0]].values.shape[1]
        first, second = np.array(list(combinations(range(days), 2))).T
        pairs = [paired(self.days[name][:, second], self.days[name][:, first]) for name in manoeuvres]
        found = features(pairs, channels)
        return found.reshape(-1, found.shape[-1])

    def noises(self, manoeuvres: Sequence[str], channels: Sequence[int]) -> Floats:
        """Features (logs, features) that the noise of a log adds."""
        found = features([paired(self.days[name], self.exact[name]) for name in manoeuvres], channels)
        return found.reshape(-1, found.shape[-1])

    def save(self, path: File) -> None:
        """Write to a file (.npz)."""
        arrays: dict[str, Any] = {"paths": np.array([f"{effect}/{place}" for effect, place in self.paths])}
        for name in self.days:
            arrays[f"{name}/days"], arrays[f"{name}/days_share"] = self.days[name].values, self.days[name].share
            arrays[f"{name}/exact"], arrays[f"{name}/exact_share"] = self.exact[name].values, self.exact[name].share
            arrays[f"{name}/effects"] = self.effects[name]
        with written_whole(path) as temporary:
            np.savez_compressed(temporary, family=self.family, **arrays)

    @classmethod
    def load(cls, path: File) -> Library:
        """Read what :meth:`save` has written."""
        with np.load(path) as arrays:
            names = [key.removesuffix("/days") for key in arrays if key.endswith("/days")]
            paths = tuple((effect, int(place)) for effect, _, place in (str(p).partition("/") for p in arrays["paths"]))
            return cls(
                str(arrays["family"]),
                paths,
                {name: Means(arrays[f"{name}/days"], arrays[f"{name}/days_share"]) for name in names},
                {name: Means(arrays[f"{name}/exact"], arrays[f"{name}/exact_share"]) for name in names},
                {name: arrays[f"{name}/effects"] for name in names},
            )


def build(
    plants: Plants,
    excitations: Sequence[Excitation],
    extent: Extent,
    seed: int,
    progress: Callable[[str], Any] = lambda sentence: None,
    together: int = 1,
) -> Library:
    """Simulate a family's library.

    Args:
        plants: The family.
        excitations: The manoeuvres.
        extent: How much of it.
        seed: Of machines, days and noise.
        progress: Called with each manoeuvre's name when it is done.
        together: Manoeuvres that are simulated in one go; one fills a CPU, all of them do not fill a GPU.
    """
    rng = np.random.default_rng([seed, *plants.name.encode()])
    machines = [plants.machine(rng) for _ in range(extent.machines)]
    days = [
        one for each in machines for one in (each, *(plants.another_day(each, rng) for _ in range(extent.days - 1)))
    ]
    seeds = rng.integers(2**62, size=(len(excitations), len(days)))
    paths = tuple((effect, place) for effect, several in plants.effects.items() for place in range(len(several)))
    changed = machines[: extent.changed]
    found: tuple[dict[str, Means], dict[str, Means], dict[str, Floats]] = {}, {}, {}
    wanted = {
        (row, column, place): (machine, {effect: plants.effects[effect][which].size(share)})
        for row, (effect, which) in enumerate(paths)
        for column, share in enumerate(extent.shares)
        for place, machine in enumerate(changed)
    }
    runs_of = {index: change for index, change in wanted.items() if _can(plants, *change)}
    where = np.array(list(runs_of))
    for first in range(0, len(excitations), together):
        part = list(excitations[first : first + together])
        healthy = [
            PlantRun(day, told, seed=int(drawn))
            for told, own in zip(part, seeds[first : first + together], strict=True)
            for day, drawn in zip(days, own, strict=True)
        ]
        later = [PlantRun(machine, told, effects) for told in part for machine, effects in runs_of.values()]
        noisy, exact = plants.record(healthy, exact=False), plants.record([*healthy, *later], exact=True)
        changes = exact[len(healthy) :]
        for number, told in enumerate(part):
            weights = windows(told.steering, told.drive)
            of_days, of_changes = (slice(number * n, (number + 1) * n) for n in (len(days), len(runs_of)))
            for into, logs in ((found[0], noisy), (found[1], exact)):
                into[told.name] = _shaped(means(logs[of_days], weights), (extent.machines, extent.days))
            base = found[1][told.name][:, 0]
            effects = np.full((len(paths), len(extent.shares), len(changed), len(CHANNELS), len(weights)), np.nan)
            effects[tuple(where.T)] = paired(means(changes[of_changes], weights), base[where[:, 2]])
            found[2][told.name] = effects
            progress(f"{plants.name}: {told.name}")
    return Library(plants.name, paths, *found)


def _can(plants: Plants, machine: Any, effects: Mapping[str, tuple[float, ...]]) -> bool:
    """Whether a machine can have an effect of that size."""
    try:
        return all(np.all(np.isfinite(plants.magnitude(*(e, machine, s))["magnitude"])) for e, s in effects.items())
    except ValueError:
        return False


def _shaped(found: Means, shape: tuple[int, ...]) -> Means:
    return Means(found.values.reshape(*shape, *found.values.shape[1:]), found.share.reshape(*shape, -1))
