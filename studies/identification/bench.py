"""Structures as search spaces, and their figures: many structures side by side in one launch."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aoro_gym.calibration.published import LEVELS
from aoro_gym.calibration.space import Space
from aoro_gym.machine import Machine
from aoro_gym.validation.turns import stacked
from studies.identification.figures import REFERENCES, Found, found_of
from studies.identification.search import Evaluate, Job
from studies.identification.splits import Split
from studies.identification.structures import felt, machine_of, uncertain

IDENTIFIABLE = 0.05
"""Tolerances that a quarter of a parameter's range moves a figure by, at least, for it to be searched."""
PROBES = 2
"""Machines at which it is tried what figures feel: the data sheets', and random ones near it."""
ALL = np.ones(len(LEVELS), dtype=bool)

Floats = NDArray[np.float64]
Request = tuple[str, Floats, NDArray[np.bool_]]
"""A structure, points (N, d) of its space, and the levels (3,) that they turn at."""


@dataclass(frozen=True)
class Model:
    """A structure and the parameters of it that are searched."""

    name: str
    space: Space

    @property
    def prior(self) -> Floats:
        """Point (d,) of the data sheets."""
        return self.space.point()

    def machine(self, points: Floats) -> Machine:
        """A variant a point, (N, d)."""
        return self.space.population(points).levelled()


@dataclass
class Bench:
    """Where machines turn."""

    device: str
    batch: int
    threads: int
    models: dict[str, Model]

    def found(self, requests: Sequence[Request], *, sampled: bool = False) -> list[Found]:
        """Figures of the points of each request, those from samples if asked for; all structures in one launch a level."""
        if not requests:
            return []
        order = sorted(range(len(requests)), key=lambda i: requests[i][0])  # neighbours of one structure in a warp
        machines, levels = [], []
        for name in dict.fromkeys(requests[i][0] for i in order):
            own = [requests[i] for i in order if requests[i][0] == name]
            machines.append(self.models[name].machine(np.vstack([points for _, points, _ in own])))
            levels += [np.repeat(which[:, None], len(points), axis=1) for _, points, which in own]
        whole = found_of(
            stacked(machines), np.hstack(levels), self.device, batch=self.batch, threads=self.threads, sampled=sampled
        )
        out: list[Found] = [whole] * len(requests)
        begin = 0
        for i in order:
            end = begin + len(requests[i][1])
            out[i] = whole.part(slice(begin, end))
            begin = end
        return out

    def evaluate(self, splits: Mapping[str, Split]) -> Evaluate:
        """Residuals of jobs, by the splits' names."""

        def residuals(asked: Sequence[tuple[Job, Floats]]) -> list[Floats]:
            found = self.found([(job.structure, points, splits[job.split].levels) for job, points in asked])
            return [splits[job.split].residuals(one) for (job, _), one in zip(asked, found, strict=True)]

        return residuals


def searched(names: Sequence[str], bench: Bench, seed: int, say: Callable[[str], None]) -> dict[str, list[str]]:
    """Parameters that a figure feels by :data:`IDENTIFIABLE`, at the data sheet's machine or at a random one near it."""
    requests, keys = [], {}
    for name in names:
        machine = machine_of(name)
        keys[name] = uncertain(name, machine)
        model = bench.models[name] = Model(name, Space(machine, keys[name]))
        rng = np.random.default_rng(seed)
        near = model.prior + rng.normal(0.0, 0.15, (PROBES - 1, len(keys[name])))
        for probe in np.vstack([model.prior, np.clip(near, 0.05, 0.95)]):
            side = np.where(probe > 0.5, -0.25, 0.25)
            requests.append((name, np.vstack([probe, probe + np.diag(side)]), ALL))
    say(f"which of {sum(map(len, keys.values()))} parameters the figures feel")
    found = bench.found(requests)
    changes: dict[str, list[Floats]] = {name: [] for name in names}
    for (name, *_), one in zip(requests, found, strict=True):
        for reference in REFERENCES:
            misses = one.misses(reference)
            changes[name].append(misses[:, 1:] - misses[:, :1])
    return {name: felt(keys[name], np.vstack(changes[name]), IDENTIFIABLE) for name in names}
