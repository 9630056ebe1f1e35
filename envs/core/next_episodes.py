"""Episodes that are drawn before they begin: by the host, while the device computes.

What an episode begins with is drawn by its sub-environment's generator alone, whenever that is; so it may be known long
before it is needed, and many are drawn at once in about the time of one. It is kept on the device, as writes into the memory
of task and twins, and the launches of a step begin it where another ends (:mod:`aoro_gym.envs.core.kernels.beginning`). What
was drawn and is not used is given back: generators are as if it had not been.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.envs.core.drawing import Together, drawing
from aoro_gym.envs.core.kernels.beginning import Drawn
from aoro_gym.execution.array_api import Array
from aoro_gym.execution.scatter import RowWrites
from aoro_gym.execution.streams import Generators
from aoro_gym.execution.uploads import Uploads

AT_ONCE = 64
"""Least number of episodes that are drawn together; that many of thousands may go without one that is ready."""
MOST = 256
"""Largest number of them at first, where more are missing; it is doubled while two such batches fit into a step ..."""
LIMIT = 2048
"""... until it is this."""
SHARE = 8
"""At least so many batches make all of the sub-environments, where these are few."""


class NextEpisodes:
    """Of N sub-environments of an environment in kernels, whose arrays are on a device.

    Args:
        num_envs: N.
        in_step: Whether they begin in the launches of a step; else only by :meth:`begin`.
    """

    def __init__(self, num_envs: int, *, in_step: bool):
        self._ready = np.zeros(num_envs, dtype=bool)
        self.failed: Exception | None = None
        """Why none is drawn any more; it is told when such an episode begins."""
        self._in_step = in_step
        self._unnoted: tuple[Any, ...] = ()  # see began()
        self._ready_then = self._ready  # when the launches of the last step were
        self._batch = min(AT_ONCE, max(1, num_envs // SHARE))
        self._most = MOST if self._batch == AT_ONCE else self._batch
        self._drawing: Any = None  # see drawing()
        self._drawn_of: tuple[Any, ...] = ()
        self._memory: tuple[Any, ...] = ()  # what else is written at a start, see _drawn
        self._writes: RowWrites | None = None  # None: nothing is there on the device
        self._replaced = False  # whether what was drawn is for arrays that are used no more
        self._on_device: dict[str, Array] = {}  # see Drawn
        self._uploads: Uploads | None = None  # of the bits there
        self._sent: list[Array] = []  # whose bits are on their way

    @property
    def ready(self) -> NDArray[np.bool_]:
        """Whose next episode is drawn (N,)."""
        self._note()
        return self._ready

    def draw(self, env: Any, needed: NDArray[np.intp] | None = None) -> int:
        """Draw a batch of episodes, if so many are missing, for what follows; gives how many it drew.

        Args:
            env: The :class:`~aoro_gym.envs.core.vector.TwinVectorEnv`.
            needed: Sub-environments that wait for theirs, which are drawn at once; what is drawn together costs little
                more with those of others.
        """
        drawn = self._draw(env, needed)
        self._arrive()
        return drawn

    def _draw(self, env: Any, needed: NDArray[np.intp] | None = None) -> int:
        """What :meth:`draw` does, but that nothing may begin them before :meth:`_arrive`."""
        missing = ~self.ready
        if not env.task.randomisation.varies_machine:
            missing &= ~env._machine_changed  # these get the machine of all back
        rows, least = (np.flatnonzero(missing), self._batch) if needed is None else (needed[missing[needed]], 1)
        if self.failed is not None or self._replaced or len(rows) < least:
            return 0
        if not self._drawn_of:
            self.renew(env)
        self._drawing = drawing(env) if self._drawing is None else self._drawing
        if needed is None:
            rows = rows[: self._most]
        elif isinstance(self._drawing, Together):
            rows = np.union1d(rows, np.flatnonzero(missing)[: self._most])
        generators = self._drawing.take(rows)
        try:
            tensors, indices, values = _drawn(env, rows, generators, self._memory_of(env))
        except Exception as error:  # whatever it is: it is raised again where the episode begins
            self.failed = error
            self._drawing.give_back(rows)
            return 0
        if self._writes is None or not self._writes.fits(tensors, indices, len(rows)):
            writes, self._writes = self._writes, RowWrites(tensors, indices, len(rows))
            if writes is None:
                self._allocate(env, self._writes.places)
            elif not np.array_equal(writes.places, self._writes.places):  # arrays were replaced
                self._replaced = True
                self._drawing.give_back(rows)
                return 0
        self._drawing.drawn(rows, generators)
        assert self._uploads is not None
        self._sent.append(self._uploads.send(self._on_device["bits"], rows, partial(self._writes.fill, values=values)))
        self.ready[rows] = True
        return len(rows)

    def _arrive(self) -> None:
        """Let launches that follow begin all that is drawn."""
        if self._sent and self._uploads is not None:
            self._uploads.arrive(*self._sent)
            for index in self._sent:
                self._on_device["ready"].index_fill_(0, index, True)
            self._sent.clear()

    def _memory_of(self, env: Any) -> tuple[Any, ...]:
        if not self._memory:
            twin = env.twin
            self._memory = tuple(env.arrays.alias(each) for each in (*twin.start_memory, twin.machine_words))
        return self._memory

    def _allocate(self, env: Any, places: NDArray[np.int64]) -> None:
        """Make room on the device for what is written to ``places`` (3, M), and let steps begin it."""
        arrays, xp, drawn = env.arrays, env.arrays.xp, Drawn()
        self._on_device = {
            "ready": arrays.zeros(len(self.ready), xp.bool),
            "places": arrays.asarray(places, xp.int64),
            "bits": arrays.zeros((len(self.ready), places.shape[1]), xp.int64),
            "marks": self._memory[0],
        }
        for name, array in self._on_device.items():
            setattr(drawn, name, arrays.shared(array))
        self._uploads = Uploads(arrays)
        self._uploads.follow()
        env._kernel_step.take_drawn(drawn, in_step=self._in_step)

    def draw_during(self, env: Any, step: Any) -> None:
        """Draw a batch while the device is at a step, and more that are likely to be there before the step is.

        Args:
            env: See :meth:`draw`.
            step: Its :class:`~aoro_gym.envs.core.kernel_step.KernelStep`.
        """
        began, spent, fits = time.perf_counter(), 0.0, True
        while fits and (drawn := self._draw(env)):
            before, spent = spent, time.perf_counter() - began
            last, seconds = spent - before, step.seconds
            if drawn == self._most >= MOST:
                more, less = step.computing and 2.0 * last <= seconds, last > seconds
                self._most = min(2 * drawn, LIMIT) if more else max(drawn // 2, MOST) if less else drawn
            fits = step.computing and spent + last <= seconds
        self._arrive()

    def launched(self) -> None:
        """The launches of a step have been asked for, which begin those episodes that are ready now.

        Those of the step before may still read what these began with: others come to its place after them.
        """
        self._ready_then = self.ready.copy()
        if self._uploads is not None:
            self._uploads.follow_last()

    def began(self, env: Any, done: NDArray[np.bool_]) -> None:
        """The launches of a step began episodes where ``done`` (N,), of those that were drawn.

        Who that was is noted when it is asked for, at the latest when the device is at the next step, which need not wait.
        """
        self._unnoted = done, env._machine_changed if env.task.randomisation.varies_machine else None

    def undrawn(self, done: NDArray[np.bool_]) -> NDArray[np.intp]:
        """Sub-environments whose episode has ended in a step, ``done`` (N,), without the launches having another."""
        return np.flatnonzero(done & ~self._ready_then)

    def _note(self) -> None:
        """Take note of what :meth:`began` was told."""
        if not self._unnoted:
            return
        (done, changed), self._unnoted = self._unnoted, ()
        begun = np.flatnonzero(done & self._ready_then)
        self._ready[begun] = False
        self._drawing.used(begun)
        if changed is not None:
            changed[begun] = True

    def begin(self, env: Any, where: NDArray[np.intp]) -> NDArray[np.intp]:
        """Begin those episodes of the sub-environments ``where`` (K,) that are drawn; gives the others.

        Args:
            env: See :meth:`draw`.
            where: Sub-environments.
        """
        self.renew(env)
        undrawn = where[~self.ready[where]]
        if self._writes is not None and 0 < len(undrawn) <= MOST:
            self.draw(env, undrawn)
        usable = self.ready[where]
        rows, others = where[usable], where[~usable]
        if len(rows):
            self._begin(env, rows)
        self.forget(env, others)
        return others

    def forget(self, env: Any, where: NDArray[np.intp] | None = None) -> None:
        """Give back what was drawn for the sub-environments ``where``, all by default; not while a step begins it."""
        self._note()
        rows = np.arange(len(self.ready)) if where is None else where
        if self._drawing is not None:
            self._drawing.give_back(rows)
            self._drawing = self._drawing if where is not None else None  # generators may be others afterwards
        known = rows[self.ready[rows]]
        if len(known):
            self.ready[known] = False
            self._on_device["ready"].index_fill_(0, env.arrays.uploaded(known), False)

    def renew(self, env: Any) -> None:
        """Forget what was drawn of other settings than those of now, or for other arrays."""
        now = env.task.randomisation, env.task.config
        if len(self._drawn_of) != len(now) or any(a is not b for a, b in zip(self._drawn_of, now, strict=True)):
            self._replaced = self._writes is not None  # other machines may be written
            self._drawn_of = now
            self.forget(env)
        if self._replaced:
            self.forget(env)
            env._kernel_step.take_drawn(None, in_step=False)
            self._replaced, self._writes, self._on_device = False, None, {}

    def _begin(self, env: Any, rows: NDArray[np.intp]) -> None:
        env._kernel_step.begin(env.arrays.index(rows))
        if env.task.randomisation.varies_machine:
            env._machine_changed[rows] = True
        if self._uploads is not None:
            self._uploads.follow()  # the bits of others come to where theirs are read
        env._rested_in_kernels(rows)
        self.ready[rows] = False
        self._drawing.used(rows)


def _drawn(
    env: Any, rows: NDArray[np.intp], generators: Generators, memory: tuple[Any, ...]
) -> tuple[Sequence[Any], Sequence[Any], Sequence[Any]]:
    """What episodes of the sub-environments ``rows`` (K,) begin with, by their ``generators``: tensors, indices and values
    of :class:`aoro_gym.execution.scatter.RowWrites`.

    ``memory`` are the twins' marks, poses, terrains and machines, which are written beside the task's.
    """
    task, twin, arrays, (*start_memory, machines) = env.task, env.twin, env.arrays, memory
    draws = task.randomisation.draw(generators)
    machine = draws.apply(twin.machine.variants(rows))
    with arrays.kept() as writes:
        start = task.start(rows, generators, draws, machine, {})
        index = arrays.index(rows)
        arrays.put(env._steps, index, 0)
        pose, numbers = twin.checked_start(len(rows), start.position, start.heading, start.joint_angle, start.terrain)
        for array, place, values in zip(
            start_memory, (index, (slice(None), index), index), (True, pose, numbers), strict=True
        ):
            arrays.put(array, place, values)
        known = np.stack(np.broadcast_arrays(*env._known_at_rest(start, machine), np.zeros(len(rows)))[:-1])
        arrays.put(env._kernel_step.known, (slice(None), index), known)
        if task.randomisation.varies_machine:
            records = twin.checked_records(rows, machine)
            arrays.put(machines, index, records.view(np.int32).reshape(len(rows), -1))
    tensors, indices, values = zip(*writes, strict=True)
    return tensors, indices, values
