"""Episodes that are drawn before they begin: by the host, while the device computes.

What an episode begins with is drawn by its sub-environment's generator alone, whenever that is; so it may be known long
before it is needed, and many are drawn at once in about the time of one. What was drawn and is not used is given back:
generators are as if it had not been.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from aoro_gym.execution.scatter import by_row, scatter_rows

AT_ONCE = 64
"""Episodes that are drawn together; that many of thousands may go without one that is ready."""
SHARE = 8
"""At least so many batches make all of the sub-environments, where these are few."""


class NextEpisodes:
    """Of N sub-environments of an environment in kernels, whose arrays are on a device.

    Args:
        num_envs: N.
    """

    def __init__(self, num_envs: int):
        self.ready = np.zeros(num_envs, dtype=bool)
        """Whose next episode is drawn (N,)."""
        self.failed: Exception | None = None
        """Why none is drawn any more; it is told when such an episode begins."""
        self._batch = min(AT_ONCE, max(1, num_envs // SHARE))
        self._missed = 0  # episodes that began undrawn
        self._before: list[Any] = [None] * num_envs  # see _state_of
        self._drawn_of: tuple[Any, ...] = ()
        self._places = np.zeros((3, 0), dtype=np.int64)
        self._device_places: Any = None
        self._bits = np.zeros((num_envs, 0), dtype=np.int64)
        self._known = np.zeros((5, num_envs), dtype=np.float32)
        self._records: NDArray[Any] | None = None
        self._marks: Any = None  # of the twins that begin, with their poses and terrains

    def draw(self, env: Any) -> bool:
        """Draw a batch of episodes, if so many are missing; gives whether it did.

        Args:
            env: The :class:`~aoro_gym.envs.core.vector.TwinVectorEnv`.
        """
        waiting, batch = np.flatnonzero(~self.ready), self._batch
        if self.failed is not None or len(waiting) < batch:
            return False
        self._forget_others(env)
        if self._marks is None:
            self._marks = [env.arrays.alias(each) for each in env.twin.start_memory]
        rows = waiting[:batch]
        before = [_state_of(env.generators[i]) for i in rows]
        try:
            places, bits, known, records = _drawn(env, rows, self._marks)
        except Exception as error:  # whatever it is: it is raised again where the episode begins
            self.failed = error
            _restore(before)
            return False
        if not np.array_equal(places, self._places):  # arrays were replaced
            self.forget(env)
            self._places = places
            self._device_places = wp.array(places, dtype=wp.int64, device=env.twin.device)
            self._bits = np.empty((len(self.ready), bits.shape[1]), dtype=np.int64)
        if records is not None:
            if self._records is None:
                self._records = np.empty(len(self.ready), dtype=records.dtype)
            self._records[rows] = records
        self._bits[rows], self._known[:, rows], self.ready[rows] = bits, known, True
        for i, each in zip(rows, before, strict=True):
            self._before[i] = each
        return True

    def draw_during(self, env: Any, step: Any) -> None:
        """Draw a batch while the device is at a step, and more: as many episodes as began undrawn since the last one, and
        those that are likely to be there before the step is.

        Args:
            env: See :meth:`draw`.
            step: Its :class:`~aoro_gym.envs.core.kernel_step.KernelStep`.
        """
        began, count, missed = time.perf_counter(), 0, self._missed
        self._missed = 0
        while self.draw(env):
            count += 1
            spent = time.perf_counter() - began
            fits = step.computing and spent * (count + 1) / count <= step.seconds
            if not fits and count * self._batch >= missed:
                return

    def begin(self, env: Any, where: NDArray[np.intp]) -> NDArray[np.intp]:
        """Begin those episodes of the sub-environments ``where`` (K,) that are drawn; gives the others.

        Args:
            env: See :meth:`draw`.
            where: Sub-environments.
        """
        self._forget_others(env)
        usable = self.ready[where]
        if not env.task.randomisation.varies_machine:
            usable &= ~env._machine_changed[where]  # these get the machine of all back
        rows, others = where[usable], where[~usable]
        self._missed += len(others)
        self.forget(env, others)
        if len(rows):
            self._begin(env, rows)
        return others

    def forget(self, env: Any, where: NDArray[np.intp] | None = None) -> None:
        """Give back what was drawn for the sub-environments ``where``, all by default."""
        known = np.flatnonzero(self.ready) if where is None else where[self.ready[where]]
        _restore([self._before[i] for i in known])
        self.ready[known] = False

    def _forget_others(self, env: Any) -> None:
        """Forget what was drawn of other settings than those of now."""
        now = env.task.randomisation, env.task.config
        if len(self._drawn_of) != len(now) or any(a is not b for a, b in zip(self._drawn_of, now, strict=True)):
            self.forget(env)
            self._drawn_of, self._records = now, None

    def _begin(self, env: Any, rows: NDArray[np.intp]) -> None:
        twin, arrays = env.twin, env.arrays
        index = arrays.index(rows)
        if self._records is not None:
            twin.set_records(rows.astype(np.int32), self._records[rows])
            env._machine_changed[rows] = True
        twin.start_memory[0].zero_()
        bits = wp.array(self._bits[rows], dtype=wp.int64, device=twin.device)
        inputs = [self._device_places, arrays.shared(index), bits]
        wp.launch(scatter_rows, dim=bits.shape, inputs=inputs, device=twin.device)
        twin.reset_marked()
        env._rest_in_kernels(rows, index, self._known[:, rows])
        self.ready[rows] = False


def _drawn(
    env: Any, rows: NDArray[np.intp], marks: Any
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float32], NDArray[Any] | None]:
    """What episodes of the sub-environments ``rows`` (K,) begin with: places (3, M) and bits (K, M) of
    :func:`aoro_gym.execution.scatter.by_row`, what is known at rest (5, K), and records (K,) of machines that vary."""
    task, twin, arrays = env.task, env.twin, env.arrays
    generators = [env.generators[i] for i in rows]
    draws = task.randomisation.draw(generators)
    machine = draws.apply(twin.machine.variants(rows))
    records = twin.checked_records(rows, machine) if task.randomisation.varies_machine else None
    with arrays.kept() as writes:
        start = task.start(rows, generators, draws, machine, {})
        index = arrays.index(rows)
        arrays.put(env._steps, index, 0)
        pose, numbers = twin.checked_start(len(rows), start.position, start.heading, start.joint_angle, start.terrain)
        for array, place, values in zip(
            marks, (index, (slice(None), index), index), (True, pose, numbers), strict=True
        ):
            arrays.put(array, place, values)
    known = np.stack(np.broadcast_arrays(*env._known_at_rest(start, machine), np.zeros(len(rows)))[:-1])
    tensors, indices, values = zip(*writes, strict=True)
    return *by_row(tensors, indices, values, len(rows)), known.astype(np.float32), records


def _state_of(generator: np.random.Generator) -> tuple[np.random.Generator, Any, int]:
    """A generator with its state, and how many it has spawned, which is no part of that."""
    bits = generator.bit_generator
    return generator, bits.state, getattr(bits.seed_seq, "n_children_spawned", 0)


def _restore(before: list[tuple[np.random.Generator, Any, int]]) -> None:
    for generator, state, spawned in before:
        bits: Any = generator.bit_generator
        seeds = bits.seed_seq
        if getattr(seeds, "n_children_spawned", 0) == spawned:
            bits.state = state
        else:  # what it spawns next is what it has spawned since
            again = np.random.SeedSequence(
                seeds.entropy, spawn_key=seeds.spawn_key, pool_size=seeds.pool_size, n_children_spawned=spawned
            )
            bits.__setstate__((state, again))
