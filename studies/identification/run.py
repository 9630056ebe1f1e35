"""Which structure predicts: fits that leave one level, or figures of one kind, out and predict them.

    python -m studies.identification.run --out identification --structures default library --device cpu:simd

For the figures of the published twin and, apart, of the real machine, a structure (:mod:`.structures`) is fitted to all but
one of the levels 100, 75 and 50 % and predicts the one left out; likewise figures of one kind. Every uncertain parameter
that the figures feel is searched: a population around the data sheets a seed, turned once and shared by all fits, then
bounded Gauss–Newton steps from its best member. Ranges are priors: the pull to the data sheet is that of a range read as
95 %, and its ends bound the search. The valve's table is an input of every fit, so that the mean flow of the level left out
is known; what is predicted are the figures of the transient.

Ctrl-C is safe: the same command goes on where it stopped, as it does when ``--minutes`` are over; so does one with more
seeds, steps or structures. ``FOLDER`` gets a JSON file a structure and ``table.md``.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from aoro_gym.calibration.fit import costs, sound
from aoro_gym.calibration.space import Space
from aoro_gym.execution.digest import digest
from aoro_gym.execution.files import read_json, write_json, write_text
from studies.identification.bench import ALL, IDENTIFIABLE, Bench, Model, searched
from studies.identification.describe import described, intervals, unfitted
from studies.identification.profiles import PROFILED, profile
from studies.identification.search import PULL, Job, search
from studies.identification.splits import BY_KIND, BY_LEVEL, WHOLE, Split
from studies.identification.structures import STRUCTURES, machine_of
from studies.identification.table import markdown

SPREAD = 0.25
"""Standard deviation of the population, share of a range: that of the prior."""
BETWEEN = 3
"""Steps between two looks at what the fits predict."""
PARTS = {"levels": (*BY_LEVEL, *WHOLE), "kinds": BY_KIND}
"""Fits that run side by side, by name."""

Floats = NDArray[np.float64]


@dataclass
class Study:
    """Fits of several structures side by side, and what is kept of them."""

    names: Sequence[str]
    folder: Path
    bench: Bench
    seeds: int
    population: int
    steps: int
    until: float = np.inf
    executor: Executor | None = None
    results: dict[str, dict[str, Any]] = field(default_factory=dict)
    began: float = field(default_factory=time.monotonic)

    def __post_init__(self) -> None:
        for name in self.names:
            inputs = digest(machine_of(name).identity, self.population, PULL, SPREAD, IDENTIFIABLE)
            file = self.folder / f"{name}.json"
            kept = read_json(file) if file.exists() else {}
            if kept and kept.get("inputs") != inputs:
                raise ValueError(f"{file} was begun with other settings or another machine: choose another --out")
            self.results[name] = kept or {"structure": name, "inputs": inputs, "splits": {}}

    def keep(self) -> None:
        """Write what is known."""
        for name, result in self.results.items():
            write_json(self.folder / f"{name}.json", result)

    def say(self, what: str) -> None:
        """Tell what is being done."""
        print(f"{time.monotonic() - self.began:6.1f} s: {what}", file=sys.stderr, flush=True)

    def prepare(self) -> None:
        """Parameters that are felt, and what the data sheets alone predict."""
        fresh = [name for name in self.names if "searched" not in self.results[name]]
        for name, keys in searched(fresh, self.bench, 0, self.say).items() if fresh else ():
            self.results[name]["searched"] = keys
        for name in self.names:
            self.bench.models[name] = Model(name, Space(machine_of(name), self.results[name]["searched"]))
        fresh = [name for name in self.names if "not_fitted" not in self.results[name]]
        found = self.bench.found([(name, self.bench.models[name].prior[None], ALL) for name in fresh], sampled=True)
        for name, one in zip(fresh, found, strict=True):
            self.results[name]["not_fitted"] = unfitted(one)
        self.keep()

    def points(self, name: str, seed: int) -> Floats:
        """The population (N, d) of a seed, the data sheet's machine first."""
        prior = self.bench.models[name].prior
        normal = qmc.MultivariateNormalQMC(np.zeros(len(prior)), rng=np.random.default_rng(seed))
        points = prior + SPREAD * normal.random(self.population)
        # half of it nearer: far from every data sheet most machines do nothing like the published turns
        points[::2] = prior + 0.4 * (points[::2] - prior)
        points[0] = prior
        return np.clip(points, 0.01, 0.99)

    def starts(self) -> dict[str, dict[str, list[float]]]:
        """Best member of the population, by ``structure/seed`` and split."""
        file = self.folder / ".starts.json"
        kept: dict[str, dict[str, list[float]]] = read_json(file) if file.exists() else {}
        missing = [(name, seed) for name in self.names for seed in range(self.seeds) if f"{name}/{seed}" not in kept]
        together = max(1, self.bench.batch // self.population)
        for number in range(0, len(missing), together):
            if time.monotonic() > self.until:
                return kept
            self.say(f"population {number} of {len(missing)}, {self.population} machines each")
            some = missing[number : number + together]
            points = [self.points(name, seed) for name, seed in some]
            found = self.bench.found([(name, one, ALL) for (name, _), one in zip(some, points, strict=True)])
            for (name, seed), own, one in zip(some, points, found, strict=True):
                prior = self.bench.models[name].prior
                pull = np.full(len(prior), PULL)
                kept[f"{name}/{seed}"] = {
                    split.name: own[int(np.argmin(costs(sound(split.residuals(one)), own, prior, pull)))].tolist()
                    for split in (*BY_LEVEL, *WHOLE, *BY_KIND)
                }
            write_json(file, kept)
        return kept

    def fit(self, part: str) -> None:
        """The fits of a part, and what they predict; that is kept as far as it is known after every few steps."""
        splits = {split.name: split for split in PARTS[part]}
        starts = self.starts()
        files = {name: self.folder / f".{name}-{part}.json" for name in self.names}
        jobs = [Job(**job) for file in files.values() if file.exists() for job in read_json(file)["jobs"]]
        known = {(job.structure, job.split, job.seed) for job in jobs}
        jobs += [
            Job(name, split, seed, starts[f"{name}/{seed}"][split])
            for name in self.names for seed in range(self.seeds) if f"{name}/{seed}" in starts
            for split in splits if (name, split, seed) not in known
        ]  # fmt: skip
        if not jobs:
            return
        self.say(f"{part}: {len(jobs)} searches of {', '.join(self.names)}")

        def keep() -> None:
            for name, file in files.items():
                write_json(file, {"jobs": [job.to_json() for job in jobs if job.structure == name]})

        for steps in range(min(BETWEEN, self.steps), self.steps + BETWEEN, BETWEEN):
            before = [job.iteration for job in jobs]
            search(
                jobs, [self.bench.models[job.structure].prior for job in jobs], self.bench.evaluate(splits),
                iterations=min(steps, self.steps), until=self.until, executor=self.executor, say=self.say, keep=keep,
            )  # fmt: skip
            if steps == BETWEEN or before != [job.iteration for job in jobs]:
                self.describe(jobs, splits)

    def describe(self, jobs: Sequence[Job], splits: dict[str, Split]) -> None:
        """Keep what the fits predict, by structure and split."""
        found = self.bench.found([(job.structure, np.array([job.point]), ALL) for job in jobs], sampled=True)
        groups: dict[tuple[str, str], list[int]] = {}
        for i, job in enumerate(jobs):
            groups.setdefault((job.structure, job.split), []).append(i)
        for (name, split), members in groups.items():
            self.results[name]["splits"][split] = described(
                self.bench.models[name], splits[split], [jobs[i] for i in members], [found[i] for i in members]
            )
        self.keep()
        write_text(self.folder / "table.md", markdown(self.folder))

    def uncertainties(self) -> None:
        """What the best fit of each leave-one-level-out and of all rows leaves open."""
        splits = {split.name: split for split in PARTS["levels"]}
        wanted = [
            (self.bench.models[name], splits[split], result)
            for name in self.names
            for split, result in self.results[name]["splits"].items()
            if split in splits and "point" in result and "interval" not in result
        ]
        together = max(1, self.bench.batch // 100)
        for number in range(0, len(wanted), together):
            if time.monotonic() > self.until:
                return
            self.say(f"intervals, {number} of {len(wanted)}")
            intervals(wanted[number : number + together], self.bench)
            self.keep()

    def profiles(self) -> None:
        """Profiles of the parameters of :data:`PROFILED` structures."""
        splits = {split.name: split for split in WHOLE}
        for name, split in PROFILED:
            if split not in self.results.get(name, {"splits": {}})["splits"]:
                continue
            if time.monotonic() > self.until:
                return
            self.say(f"profiles of {name}, {split}")
            model, kept = self.bench.models[name], self.results[name].setdefault("profiles", {})
            best = np.array(self.results[name]["splits"][split]["point"])

            def keep(found: dict[str, Any], kept: dict[str, Any] = kept, split: str = split) -> None:
                kept[split] = found
                self.keep()

            profile(
                model, splits[split], best, self.bench, kept=kept.get(split), until=self.until,
                executor=self.executor, say=self.say, keep=keep,
            )  # fmt: skip


def run(study: Study, parts: Sequence[str]) -> None:
    """The parts of a study, one after the other."""
    study.prepare()
    for part in parts:
        if part in PARTS:
            study.fit(part)
        elif part == "intervals":
            study.uncertainties()
        else:
            study.profiles()
        write_text(study.folder / "table.md", markdown(study.folder))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    add = parser.add_argument
    add("--out", type=Path, required=True, help="folder of the results")
    add("--structures", nargs="+", default=list(STRUCTURES), choices=STRUCTURES, help="structures to fit")
    add("--device", default="cpu:simd", help="cpu, cpu:simd or cuda:N")
    add("--seeds", type=int, default=1, help="populations, each with searches of its own")
    add("--population", type=int, default=128, help="machines a population")
    add("--steps", type=int, default=8, help="Gauss-Newton steps a fit, at most")
    add("--batch", type=int, default=256, help="twins of a launch, at most")
    add("--processes", type=int, default=1, help="processes that solve steps, and threads that read figures")
    add("--minutes", type=float, default=np.inf, help="time for searches; the same command goes on")
    add("--parts", nargs="+", default=["levels"], choices=[*PARTS, "intervals", "profiles"], help="what is run")
    add("--table", action="store_true", help="only write table.md anew from the results in the folder")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    until = time.monotonic() + 60.0 * given.minutes
    try:
        if not given.table:
            bench = Bench(given.device, given.batch, given.processes, {})
            with ProcessPoolExecutor(given.processes, mp_context=get_context("spawn")) as pool:
                executor = pool if given.processes > 1 else None
                study = Study(
                    given.structures, given.out, bench, given.seeds, given.population, given.steps, until, executor
                )
                run(study, given.parts)
    except KeyboardInterrupt:
        print("interrupted; the same command goes on here", file=sys.stderr)
        sys.exit(130)
    write_text(given.out / "table.md", markdown(given.out))
    print(markdown(given.out))


if __name__ == "__main__":
    main()
