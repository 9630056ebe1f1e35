"""Episodes in batches: here, or as jobs on a cluster."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial, reduce
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.agents.controllers.privileged import made_to_drive
from aoro_gym.agents.controllers.reference import Factory
from aoro_gym.agents.evaluation.cached_episodes import EpisodeCache
from aoro_gym.agents.evaluation.episodes import Episodes
from aoro_gym.agents.policies.policy import Policy
from aoro_gym.execution.cluster import ClusterError, Failed, connected, on_ray
from aoro_gym.execution.device_names import on_cpu
from aoro_gym.execution.sharing import shared_out
from aoro_gym.machine import Machine

AT_ONCE, AT_ONCE_ON_GPU = 64, 2048
"""Episodes that are driven together: a GPU takes hardly longer for more."""
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
    at_once: int
    """Most episodes that are driven together."""

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
    same_noise: bool,
    env: Any,
    policy: Policy,
    seeds: list[int],
    tell: Callable[[float], Any] = lambda share: None,
) -> Episodes:
    """Drive the episodes of the first ``episodes`` seeds from ``first`` on, again and again.

    Args:
        drive: Drives episodes of the environment.
        first: Seed of the first episode.
        episodes: How many different ones there are.
        same_noise: Whether the sensors' errors are those of the episode, too; else ``seeds`` draw them.
        env: Vector environment.
        policy: Who drives.
        seeds: Have drawn the machines; one a sub-environment.
        tell: Called with the share that is done.
    """
    asked = [first + (seed - first) % episodes for seed in seeds]
    return drive(env, policy, asked, tell) if same_noise else drive(env, policy, seeds, tell, asked=asked)


class _Place:
    """A device, with the environments that were made there last: those of one size are made once.

    Args:
        driver: Drives there.
        making: Held while anything is made, which several devices must not do at once; None: there is one.
    """

    def __init__(self, driver: Driver, making: AbstractContextManager[Any] | None):
        self._driver, self._making = driver, making or nullcontext()
        self._warms = making is not None
        self._known: Any = None
        self._vector: Any = None

    def drive(
        self,
        policies: Mapping[str, Factory],
        cache: EpisodeCache,
        batch: list[int],
        tell: Callable[[str, float], Any],
    ) -> dict[str, Episodes]:
        """Episodes of the seeds ``batch`` by policy.

        Args:
            policies: What makes each policy, by name.
            cache: To read episodes from and to write them to.
            batch: Seeds.
            tell: Called with a policy's name and the share of all of it that is done.
        """
        driver, runs = self._driver, {}
        plant = driver.drawn(driver.machine, batch)
        files = {name: cache.file(policy, batch, plant) for name, policy in policies.items()}
        before = {name: cache.read(file) for name, file in files.items()}
        if None in before.values():
            with self._making:
                self._make(len(batch), plant)
        for done, (name, policy) in enumerate(policies.items()):
            run = before[name]
            if run is None:
                with self._making:
                    made = made_to_drive(policy, self._known, self._vector)
                run = driver.drive(self._vector, made, batch, partial(_told, tell, name, done, len(policies)))
                cache.write(files[name], run)
            runs[name] = run
            tell(name, (done + 1) / len(policies))
        return runs

    def _make(self, count: int, plant: Machine) -> None:
        driver = self._driver
        if self._known is None or self._known.num_envs != count:
            self._known = self._vector = self._warmed(driver.make(count, machine=driver.machine))
        if plant is not driver.machine:
            self._vector = self._warmed(driver.make(count, machine=plant))

    def _warmed(self, vector: Any) -> Any:
        """``vector``, whose kernels are loaded."""
        if self._warms:
            vector.reset(seed=0)
            vector.step(np.zeros(vector.action_space.shape, dtype=np.float32))
        return vector


def _told(tell: Callable[[str, float], Any], name: str, done: int, policies: int, share: float) -> None:
    tell(name, (done + share) / policies)


def drive_locally(
    drivers: Sequence[Driver],
    policies: Mapping[str, Factory],
    seeds: NDArray[np.int_],
    cache: EpisodeCache,
    progress: Callable[[str, float], Any],
) -> dict[str, Episodes]:
    """Episodes by policy, batch by batch; several devices share the batches, each of which is smaller then, if need be.

    Args:
        drivers: One a device.
        policies: What makes each policy, by name.
        seeds: Of the episodes (N,).
        cache: To read episodes from and to write them to.
        progress: Called with a policy's name and the share of everything that is done.
    """
    making = Lock() if len(drivers) > 1 else None
    batches = batches_of(seeds, min(drivers[0].at_once, math.ceil(len(seeds) / len(drivers))))
    found = shared_out(
        lambda place, batch, tell: place.drive(policies, cache, batch, tell),
        [_Place(driver, making) for driver in drivers],
        batches,
        progress,
    )
    return {name: reduce(Episodes.joined, (runs[name] for runs in found)) for name in policies}


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
        driver: Drives a batch.
        policies: See :func:`drive_locally`, as for ``seeds``, ``cache`` and ``progress``.
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


def at_once(device: str) -> int:
    """Most episodes that are driven together on a device."""
    return AT_ONCE if on_cpu(device) else AT_ONCE_ON_GPU


def batches_of(seeds: NDArray[np.int_], most: int) -> list[list[int]]:
    """The seeds in batches of nearly the same size: a small last one would take as long as a large one."""
    return [part.tolist() for part in np.array_split(seeds, math.ceil(len(seeds) / most))]
