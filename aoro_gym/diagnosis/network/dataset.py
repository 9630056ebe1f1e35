"""Simulated days with their labels, on the device: drawn in processes, simulated as they come."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, fields
from typing import TypeVar

import numpy as np
import torch
import warp as wp
from numpy.typing import NDArray
from torch import Tensor

from aoro_gym.diagnosis.network import hypotheses
from aoro_gym.diagnosis.simulation import logs, manoeuvres
from aoro_gym.diagnosis.simulation.days import HEALTHY, Days, draw_days
from aoro_gym.diagnosis.simulation.manoeuvres import Manoeuvre
from aoro_gym.diagnosis.simulation.prior import Prior
from aoro_gym.effects.catalogue import IDS

CHUNK = 3584
"""Machines that are drawn together."""


@dataclass(frozen=True)
class Labelled:
    """Simulated days on the device: M machines, D days, the first HEALTHY of them healthy, J manoeuvres.

    Attributes:
        samples: int16 (M, D, J, channels, T), in :data:`~aoro_gym.diagnosis.simulation.logs.UNITS`.
        commands: (M, J, 2, T), held.
        chain: Magnitudes of effects of the measuring chain (M, D, 4).
        outsider: Number of a deviation that the catalogue lacks (M, D), −1 for none.
        hypothesis: Number of what is wrong (M, D).
        effects: Numbers of the effects (M, D, 2), −1 for none.
        sizes: Scaled sizes (M, D, 2).
    """

    samples: Tensor
    commands: Tensor
    chain: Tensor
    outsider: Tensor
    hypothesis: Tensor
    effects: Tensor
    sizes: Tensor

    @property
    def machines(self) -> int:
        return len(self.samples)

    def of(self, machines: Tensor) -> Labelled:
        """Some of the machines, by number or by truth."""
        return Labelled(*(getattr(self, field.name)[machines] for field in fields(self)))


@dataclass(frozen=True)
class Amount:
    """How much is simulated.

    Attributes:
        machines: M.
        later: Later days of each.
        manoeuvres: J.
        seed: Of all draws.
        processes: That draw.
    """

    machines: int
    later: int = 4
    manoeuvres: int = 6
    seed: int = 0
    processes: int = 1


DrawJob = tuple[Prior, int, Amount, int]
"""Prior, machines of a chunk, what is simulated in all, and the chunk's seed."""
Drawn = TypeVar("Drawn")


def simulate(
    prior: Prior, amount: Amount, device: str, progress: Callable[[int, int], object] = lambda done, total: None
) -> tuple[Labelled, NDArray[np.float64]]:
    """Labelled days on ``device``, and the scales (effects,) [SI] of their sizes; the same for the same ``amount``.

    A machine of which a twin diverges is left out. ``progress`` is told machines that are done, and all.
    """
    shape = (amount.machines, HEALTHY + amount.later, amount.manoeuvres, len(logs.CHANNELS), manoeuvres.SAMPLES)
    samples = torch.empty(shape, dtype=torch.int16, device=torch.device(device))
    days, commands, whole, done = [], [], [], 0
    with drawn_chunks(_draw, prior, amount, CHUNK) as chunks:
        for number, (drawn, told) in enumerate(chunks):
            count = len(told)

            def part(twins: int, of: int, done: int = done, count: int = count) -> None:
                progress(done + count * twins // of, amount.machines)

            found = logs.simulate(drawn, told, seed=amount.seed + number, device=device, progress=part)
            samples[done : done + count] = wp.to_torch(found.samples).reshape(count, *shape[1:])
            days.append(drawn)
            commands.append(found.commands)
            whole.append(~found.diverged.any(axis=(1, 2)))
            done += count
    drawn = Days.joined(days)
    scales = size_scales(drawn)
    data = labelled(samples, np.concatenate(commands), drawn, scales)
    kept = np.concatenate(whole)
    return (data if kept.all() else data.of(torch.as_tensor(kept, device=samples.device))), scales


@contextmanager
def drawn_chunks(
    draw: Callable[[DrawJob], Drawn], prior: Prior, amount: Amount, chunk: int
) -> Iterator[Iterator[Drawn]]:
    """What ``draw`` makes of chunks of machines, in their order, ahead in processes where there are several."""
    sizes = [min(chunk, amount.machines - first) for first in range(0, amount.machines, chunk)]
    jobs = [(prior, size, amount, amount.seed * 65537 + number) for number, size in enumerate(sizes)]
    if amount.processes == 1:
        yield map(draw, jobs)
        return
    context = multiprocessing.get_context("spawn")
    pool: Executor = ProcessPoolExecutor(amount.processes, mp_context=context)
    try:
        yield pool.map(draw, jobs)
    finally:
        pool.shutdown(cancel_futures=True)


def _draw(job: DrawJob) -> tuple[Days, list[list[Manoeuvre]]]:
    prior, machines, amount, seed = job
    rng = np.random.default_rng([seed, 1])
    told = [manoeuvres.draw(rng, amount.manoeuvres) for _ in range(machines)]
    return draw_days(prior, machines, amount.later, seed), told


def size_scales(days: Days) -> NDArray[np.float64]:
    """Scales (effects,) [SI] of the sizes: the median of what is drawn; 1 of what is not."""
    change, effects = np.abs(days.change).ravel(), days.effects.ravel()
    drawn = [change[effects == number] for number in range(len(IDS))]
    return np.array([np.median(values) if len(values) else 1.0 for values in drawn])


def labelled(samples: Tensor, commands: NDArray[np.float32], days: Days, scales: NDArray[np.float64]) -> Labelled:
    """``days`` (M · D,) with their ``samples`` and the ``commands`` (M, J, 2, T − 1) that were logged."""
    machines, each = samples.shape[:2]
    device = samples.device

    def put(values: NDArray[np.generic], dtype: torch.dtype) -> Tensor:
        return torch.as_tensor(values.reshape(machines, each, *values.shape[1:]), dtype=dtype, device=device)

    last = commands[..., -1:]
    return Labelled(
        samples=samples,
        commands=torch.as_tensor(np.concatenate([commands, last], axis=-1), device=device),
        chain=put(days.chain, torch.float32),
        outsider=put(days.outsider, torch.int64),
        hypothesis=put(hypotheses.number_of(days.effects, days.outsider >= 0), torch.int64),
        effects=put(days.effects, torch.int64),
        sizes=put(np.arcsinh(days.change / scales[np.maximum(days.effects, 0)]), torch.float32),
    )
