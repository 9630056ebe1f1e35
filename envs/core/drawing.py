"""What draws the next episodes of many sub-environments, and gives back what was drawn for nothing.

A sub-environment's generator is its own; so what its next episode draws is the same whenever it is drawn, and with which
others. Where a task draws by :mod:`aoro_gym.execution.streams` alone, the generators' states lie in arrays here while
episodes are drawn ahead, and come home when they are given back.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.envs.core.randomisation import Randomisation
from aoro_gym.execution.streams import Generators, Streams, all_streams, read_states, write_states

Rows = NDArray[np.intp]
TOGETHER_FROM = 512
"""Least number of sub-environments whose generators draw together: batches of fewer are so small that they are slower."""


class Together:
    """Draws all at once.

    Args:
        generators: Of the N sub-environments, NumPy's with PCG64.
    """

    def __init__(self, generators: list[Any]):
        self._generators = generators
        self._here = np.zeros(len(generators), dtype=bool)  # whose state is in the arrays
        self._ahead = np.zeros(len(generators), dtype=bool)  # who has drawn what is not used yet
        self._states = np.zeros((len(generators), 6), dtype=np.uint64)
        self._before = np.zeros_like(self._states)  # of those that are ahead, before they drew

    def take(self, rows: Rows) -> Generators:
        """To draw the next episodes of the sub-environments ``rows`` (K,) with."""
        new = rows[~self._here[rows]]
        if len(new):
            self._states[new] = read_states([self._generators[i] for i in new]).T
            self._here[new] = True
        states = self._before[rows] = self._states[rows]
        self._ahead[rows] = True
        return Streams(states.T)

    def drawn(self, rows: Rows, draws: Generators) -> None:
        """Those of ``rows`` are drawn, with what :meth:`take` gave."""
        assert isinstance(draws, Streams)
        self._states[rows] = draws.states.T

    def used(self, rows: Rows) -> None:
        """Those of ``rows`` have begun."""
        self._ahead[rows] = False

    def give_back(self, rows: Rows) -> None:
        """Generators of ``rows`` are as if what was drawn and is not used had not been."""
        here = rows[self._here[rows]]
        states = np.where(self._ahead[here, None], self._before[here], self._states[here])
        write_states([self._generators[i] for i in here], states.T)
        self._here[here] = self._ahead[here] = False


class OneByOne:
    """Draws with any generators, and with those that they spawn. Arguments and methods are those of :class:`Together`."""

    def __init__(self, generators: list[Any]):
        self._generators = generators
        self._before: dict[int, tuple[np.random.Generator, Any, int]] = {}

    def take(self, rows: Rows) -> Generators:
        for i in rows.tolist():
            bits = self._generators[i].bit_generator
            self._before[i] = self._generators[i], bits.state, getattr(bits.seed_seq, "n_children_spawned", 0)
        return [self._generators[i] for i in rows]

    def drawn(self, rows: Rows, draws: Generators) -> None:
        pass  # generators know where they are

    def used(self, rows: Rows) -> None:
        for i in rows.tolist():
            del self._before[i]

    def give_back(self, rows: Rows) -> None:
        for i in rows.tolist():
            if i in self._before:
                _restore(*self._before.pop(i))


def drawing(env: Any) -> Together | OneByOne:
    """What draws for ``env``, a :class:`~aoro_gym.envs.core.vector.TwinVectorEnv`, as it is now."""
    known = type(env.task.randomisation).draw is Randomisation.draw and getattr(env.task, "draws_together", False)
    together = env.num_envs >= TOGETHER_FROM and known and all_streams(env._generators)
    return (Together if together else OneByOne)(env._generators)


def _restore(generator: np.random.Generator, state: Any, spawned: int) -> None:
    """Give a generator its ``state`` back, and how many it had ``spawned``, which is no part of that."""
    bits: Any = generator.bit_generator
    seeds = bits.seed_seq
    if getattr(seeds, "n_children_spawned", 0) == spawned:
        bits.state = state
    else:  # what it spawns next is what it has spawned since
        again = np.random.SeedSequence(
            seeds.entropy, spawn_key=seeds.spawn_key, pool_size=seeds.pool_size, n_children_spawned=spawned
        )
        bits.__setstate__((state, again))
