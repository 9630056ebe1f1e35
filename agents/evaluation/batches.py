"""Episodes in batches: here, or as jobs on a cluster."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.agents.controllers.privileged import made_to_drive
from aoro_gym.agents.controllers.reference import Factory
from aoro_gym.agents.evaluation.cached_episodes import EpisodeCache
from aoro_gym.agents.evaluation.episodes import Episodes
from aoro_gym.agents.policies.policy import Policy
from aoro_gym.execution.cluster import ClusterError, Failed, connected, on_ray
from aoro_gym.machine import Machine

AT_ONCE = 64
"""Episodes that are driven together."""
SHARD = 16
"""The same on a cluster: enough jobs for many nodes."""


@dataclass(frozen=True)
class Driver:
    """Drives batches of episodes in an environment."""

    make: Callable[..., Any]
    """Makes so many sub-environments of it, on a ``machine``."""
    drive: Callable[..., Episodes]
    """See :class:`~aoro_gym.agents.evaluation.tasks.EvaluationTask`."""
    machine: Machine
    """The one that policies are made for."""
    drawn: Callable[[Machine, Sequence[int]], Machine]
    """Gives the machines that are driven, one a seed."""

    def __call__(self, policy: Factory, seeds: list[int]) -> Episodes:
        """Drive one batch."""
        known = vector = self.make(len(seeds), machine=self.machine)
        plant = self.drawn(self.machine, seeds)
        if plant is not self.machine:
            vector = self.make(len(seeds), machine=plant)
        return self.drive(vector, made_to_drive(policy, known, vector), seeds)


def drive_repeats(
    drive: Callable[..., Episodes],
    first: int,
    episodes: int,
    env: Any,
    policy: Policy,
    seeds: list[int],
    tell: Callable[[float], Any] = lambda share: None,
) -> Episodes:
    """Drive the episodes of the first ``episodes`` seeds from ``first`` on, again and again, with other noise.

    Args:
        drive: Drives episodes of the environment.
        first: Seed of the first episode.
        episodes: How many different ones there are.
        env: Vector environment.
        policy: Who drives.
        seeds: Draw the sensors' errors; one a sub-environment.
        tell: Called with the share that is done.
    """
    return drive(env, policy, seeds, tell, asked=[first + (seed - first) % episodes for seed in seeds])


def drive_locally(
    driver: Driver,
    policies: Mapping[str, Factory],
    seeds: NDArray[np.int_],
    cache: EpisodeCache,
    progress: Callable[[str, float], Any],
) -> dict[str, Episodes]:
    """Episodes by policy, batch by batch; environments of one size are made once.

    Args:
        driver: Drives them.
        policies: What makes each policy, by name.
        seeds: Of the episodes (N,).
        cache: To read episodes from and to write them to.
        progress: Called with a policy's name and the share of everything that is done.
    """
    runs: dict[str, Episodes] = {}
    known: Any = None
    vector: Any = None
    done = 0
    for batch in batches_of(seeds, AT_ONCE):
        plant = driver.drawn(driver.machine, batch)
        files = {name: cache.file(policy, batch, plant) for name, policy in policies.items()}
        before = {name: cache.read(file) for name, file in files.items()}
        if None in before.values():
            if known is None or known.num_envs != len(batch):
                known = vector = driver.make(len(batch), machine=driver.machine)
            if plant is not driver.machine:
                vector = driver.make(len(batch), machine=plant)
        for name, policy in policies.items():

            def tell(share: float, name: str = name, done: int = done, size: int = len(batch)) -> None:
                progress(name, (done + share * size) / (len(seeds) * len(policies)))

            run = before[name]
            if run is None:
                run = driver.drive(vector, made_to_drive(policy, known, vector), batch, tell)
                cache.write(files[name], run)
            runs[name] = runs[name].joined(run) if name in runs else run
            done += len(batch)
    return runs


def drive_on_cluster(
    driver: Driver,
    policies: Mapping[str, Factory],
    seeds: NDArray[np.int_],
    cache: EpisodeCache,
    progress: Callable[[str, float], Any],
    *,
    ray: str,
    device: str,
) -> dict[str, Episodes]:
    """Episodes by policy; what each policy does in each batch is a job on a cluster.

    Args:
        driver: See :func:`drive_locally`, as for ``policies``, ``seeds``, ``cache`` and ``progress``.
        policies: See there.
        seeds: See there.
        cache: See there.
        progress: See there.
        ray: Address of the cluster.
        device: Of the twins.

    Raises ClusterError if a job failed.
    """
    batches = batches_of(seeds, SHARD)
    jobs = {f"{name}, part {k}": (policy, part) for name, policy in policies.items() for k, part in enumerate(batches)}
    plants = [driver.drawn(driver.machine, part) for part in batches]
    files = {job: cache.file(*jobs[job], plants[k % len(batches)]) for k, job in enumerate(jobs)}
    before = {job: cache.read(file) for job, file in files.items()}
    found = {job: run for job, run in before.items() if run is not None}
    with connected(ray):
        for job, run in on_ray(driver, {job: jobs[job] for job in jobs if job not in found}, device=device):
            if isinstance(run, Failed):
                raise ClusterError(f"{job}: {run.reason}")
            found[job] = run
            cache.write(files[job], run)
            progress(job, len(found) / len(jobs))
    return {
        name: reduce(Episodes.joined, (found[f"{name}, part {k}"] for k in range(len(batches)))) for name in policies
    }


def batches_of(seeds: NDArray[np.int_], most: int) -> list[list[int]]:
    """The seeds in batches of nearly the same size: a small last one would take as long as a large one."""
    return [part.tolist() for part in np.array_split(seeds, math.ceil(len(seeds) / most))]
