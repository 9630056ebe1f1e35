"""The launches that advance twins, recorded."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

from aoro_gym.execution.launches import RecordedLaunch
from aoro_gym.twin.kernels import roles

BLOCK_DIM = 32
"""Threads a block: one warp, so that a few thousand twins already reach every multiprocessor. Every other number would
compile the kernels again."""
FIRST = 9
"""Of the arguments of the kernel that advances: the number of the first twin."""
WORTH_THREADS = 200
"""Twin-steps of a launch (about 4 µs each on a core) from which several CPU threads pay."""
LAST = 14
"""Of those of the kernel by roles: the twin after the last one."""
LANES, FEWEST = 16, 4
"""Twins that lanes advance together at most, and from how many on they are faster than one after the other."""


class RecordedAdvance:
    """Advances twins by a number of main steps.

    Args:
        kernel: The kernel ``advance``.
        inputs: Its arguments.
        steps: Main steps, for how many threads pay.
        device: Of the twins.
        lanes: The kernel on several lanes of a core, or none.
        by_roles: Whether it is the kernel ``advance_by_roles``.
    """

    def __init__(
        self, kernel: Any, inputs: Sequence[Any], *, steps: int, device: Any, lanes: Any = None, by_roles: bool = False
    ):
        self._steps, self._on_cpu, self._lanes, self._by_roles = steps, device.is_cpu, lanes, by_roles
        told = [*inputs, 1] if by_roles else inputs
        block_dim = roles.BLOCK_DIM if by_roles else BLOCK_DIM
        self._record = lambda: RecordedLaunch(kernel, 1, told, device=device, block_dim=block_dim)
        self._launches = [self._record()]
        self._told = (0, 0, 0)
        self._own: Callable[[], Any] = lambda: None
        self._others: list[Callable[[], Any]] = []

    def __call__(self, first: int, last: int, threads: int) -> None:
        """Advance the twins from ``first`` up to ``last``; on the CPU, whose backend is single-threaded, one slice of them a
        thread, of ``threads`` at most."""
        told = (first, last, threads)
        if told != self._told:
            self._share(*told)
            self._told = told
        if self._others:
            waiting = [_threads().submit(launch) for launch in self._others]
            self._own()
            for one in waiting:
                one.result()
        else:
            self._own()

    def _share(self, first: int, last: int, threads: int) -> None:
        twins = last - first
        if self._by_roles:
            self._launches[0].set(-(-twins // roles.TWINS) * roles.BLOCK_DIM, {FIRST: first, LAST: last})
            self._own = self._launches[0].launch
            return
        shares = min(threads, twins) if self._on_cpu and twins * self._steps >= WORTH_THREADS else 1
        while len(self._launches) < shares:
            self._launches.append(self._record())
        together = LANES if self._lanes is not None and twins >= LANES * shares else 1
        groups = -(-twins // together)
        for number, launch in enumerate(self._launches[:shares]):
            begin, end = (first + min(each * groups // shares * together, twins) for each in (number, number + 1))
            launch.set(end - begin, {FIRST: begin}, self._lanes if end - begin >= FEWEST else None)
        self._own, *self._others = (launch.launch for launch in self._launches[:shares])


def cores() -> int:
    """CPU cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def _threads() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(cores(), thread_name_prefix="twin")
