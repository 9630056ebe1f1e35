"""A control step as a few launches: those of a task around that of its twins, and those that begin episodes where others
end; recorded once, on CUDA as two graphs. What the host waits for stands between them: it reads how a step has ended while
the device begins the next episodes.

What stands in the launches are addresses, so all that they share with the host is written in place. Terms that are functions
of the user's own are left to the host: they are asked after the launches, as those of tasks without kernels are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from aoro_gym.envs.core.kernels.beginning import choose, write_drawn
from aoro_gym.envs.core.kernels.step import (
    BEGUN,
    DONE,
    OWN,
    RUNNING,
    TERMINATED,
    TRUNCATED,
    StepMemory,
    clear_flags,
    rest_outputs,
)
from aoro_gym.envs.core.task import Outputs
from aoro_gym.execution.array_api import Array, Arrays, Index
from aoro_gym.execution.launches import RecordedLaunch
from aoro_gym.twin.recorded import BLOCK_DIM

Launch = tuple[Any, list[Any]]
"""A kernel and what it takes; one thread a sub-environment."""
THREADS = 16_384
"""Threads of a GPU that write the starts of episodes: some 30 begin in a step of 65,536, with 400 writes each."""


@dataclass(frozen=True)
class TaskKernels:
    """What a task's control step is made of."""

    before: Sequence[Launch]
    """From actions to commands; the twins follow."""
    after: Sequence[Launch]
    """Measurement and judgement."""
    rest: Launch
    """First measurements of those whose episodes begin, at rest, one a thread, and what is logged then."""
    observe: Launch
    """Writes the observation."""
    rewarded: Sequence[Callable[[Any], Array]]
    """Functions of reward terms that the kernels know, by their kinds."""
    observed: Sequence[Callable[[Any], Array]]
    """Likewise of observation terms."""
    logged: Sequence[tuple[Sequence[str], Array]]
    """Names of the rows of arrays (rows, N): what is logged, in the order of ``Task.info``."""
    begun: Sequence[tuple[Sequence[str], Array]]
    """Likewise what ``rest`` logs."""


class Logged(NamedTuple):
    """Rows of infos, by name."""

    names: Sequence[str]
    ended: Array
    """At the end of the step (rows, N)."""
    begun: Array
    """Of episodes that have begun in it (rows, N), or 0."""
    nothing: Array
    """0."""


class KernelStep:
    """The control step of a vector environment.

    Args:
        env: The :class:`~aoro_gym.envs.core.vector.TwinVectorEnv`, allocated.
    """

    def __init__(self, env: Any):
        self._arrays: Arrays = env.arrays
        self._twin, self._task, self.num_envs = env.twin, env.task, env.num_envs
        arrays, xp, n, twin = self._arrays, env.arrays.xp, env.num_envs, env.twin
        self._advance = twin.advancing(env.task.control_step, sample_every=env.task.sample_step)
        self._built_on = twin.outputs, env.max_episode_steps, env.task.reward_terms
        terms = len(env.task.reward_terms)
        self.given = arrays.zeros(env.action_space.shape, xp.float32)
        """Actions as they were given (N, A)."""
        self.resetting, self.keeps = arrays.zeros(n, xp.bool), arrays.zeros(n, xp.bool)
        """Whose episode begins in the step, and whose observation stays as it was (N,)."""
        self._flags = arrays.zeros(8, xp.int32)
        self._begun, self.known = arrays.zeros(n, xp.int64), arrays.zeros((5, n), xp.float32)
        self._values, self._rewards = arrays.zeros((terms, n), xp.float32), arrays.zeros(n, xp.float32)
        self._ending, self._ended = arrays.zeros(n, xp.int64), arrays.zeros((4, n), xp.bool)
        self._observation = env._observation
        self.outputs = Outputs(arrays.alias(twin.outputs), arrays.alias(twin.state))
        """Of the twins; their memory."""
        self.status = arrays.alias(twin.status_codes)
        """Likewise (N,)."""
        self._memory = self._shared(env)
        self._give: Callable[[Array], Any] = partial(np.copyto, self.given) if arrays.on_host else self.given.copy_
        kernels = env.task.kernels(self._memory)
        self._kernels = kernels  # a recorded launch holds addresses, not what lies there
        self._tell_terms(env, kernels)
        self._observe = self._recorded(kernels.observe)
        self._step = self._step_launches(kernels)
        self._rest = [
            self._recorded((rest_outputs, [self._memory, arrays.shared(self.known)])),
            self._recorded(kernels.rest),
        ]
        self._drawn: Any = None
        self._write: RecordedLaunch | None = None
        self._begin: list[Callable[[], Any]] = []
        self._parts = [self._step]  # of a control step; a second one begins episodes
        self._final = self._observation
        self._logged = self._all_logged(env, kernels)
        self._graphs: list[Any] = []  # of the parts
        self._runs = 0
        on_gpu = twin.device.is_cuda
        self._events = [[wp.Event(twin.device, enable_timing=True) for _ in range(2)] for _ in range(2 * on_gpu)]
        self._on_host: list[list[tuple[Array, Array]]] = []  # of every other step
        self._seen: list[list[NDArray[Any]]] = []  # likewise, as NumPy's arrays

    def fits(self, env: Any) -> bool:
        """Whether the launches are still of what ``env`` has: memory of the outputs, limit of steps, and reward terms."""
        outputs, steps, terms = self._built_on
        return outputs is env.twin.outputs and steps == env.max_episode_steps and terms is env.task.reward_terms

    def _shared(self, env: Any) -> Any:
        out, arrays, task, twin = StepMemory(), self._arrays, env.task, env.twin
        out.control_step, out.reasons = task.control_step, len(task.termination_reasons)
        out.max_steps = -1 if env.max_episode_steps is None else env.max_episode_steps
        out.commands, out.outputs, out.state, out.status = twin.commands, twin.outputs, twin.state, twin.status_codes
        for name, array in (
            ("given", self.given), ("least", env._least_action), ("largest", env._largest_action),
            ("steps", env._steps), ("resetting", self.resetting), ("flags", self._flags), ("begun", self._begun),
            ("values", self._values), ("rewards", self._rewards), ("ending", self._ending), ("ended", self._ended),
            ("keeps", self.keeps), ("lowest", env._lowest), ("highest", env._highest),
            ("observation", self._observation),
        ):  # fmt: skip
            setattr(out, name, arrays.shared(array))
        self._sources = (env._least_action, env._largest_action, env._steps, env._lowest, env._highest)
        return out

    def _tell_terms(self, env: Any, kernels: TaskKernels) -> None:
        """The terms by their kinds, and which are left to the host."""
        device, task = str(self._twin.device), env.task
        rewards = [_kind(term.function, kernels.rewarded) for term in task.reward_terms.values()]
        observations = [_kind(term.function, kernels.observed) for term in task.observation_terms.values()]
        self.own_rewards = [name for name, kind in zip(task.reward_terms, rewards, strict=True) if kind == OWN]
        """Names of the reward terms that the kernels don't know."""
        self.own_observations = [
            name for name, kind in zip(task.observation_terms, observations, strict=True) if kind == OWN
        ]
        """Likewise of the observation terms."""
        weights = np.array([term.weight for term in task.reward_terms.values()], dtype=np.float64)
        columns = [env.observation_layout[name].start for name in task.observation_terms]
        self._memory.weights = wp.array(weights, dtype=wp.float64, device=device)
        for field, numbers in (("reward_kinds", rewards), ("observation_kinds", observations), ("columns", columns)):
            setattr(self._memory, field, wp.array(np.array(numbers, dtype=np.int32), dtype=int, device=device))

    def _all_logged(self, env: Any, kernels: TaskKernels) -> list[Logged]:
        """What :class:`Logged` says of the reward terms, and of what the task logs."""
        zeros, rewards = self._arrays.zeros, [f"reward/{name}" for name in env.task.reward_terms]
        nothing = zeros((), self._values.dtype)
        out = [Logged(rewards, self._values, nothing, nothing)]
        for (names, ended), (_, begun) in zip(kernels.logged, kernels.begun, strict=True):
            out.append(Logged(names, ended, begun, zeros((), ended.dtype)))
        return out

    def _recorded(self, launch: Launch, threads: int | None = None) -> RecordedLaunch:
        kernel, inputs = launch
        dim = self.num_envs if threads is None else threads
        return RecordedLaunch(kernel, dim, inputs, device=self._twin.device, block_dim=BLOCK_DIM)

    def run(self, actions: Array) -> None:
        """One control step under ``actions`` (N, A), observation included."""
        events = self._events[self._runs % 2] if self._events else ()
        if events:
            self._twin.device.stream.record_event(events[0])
        self._give(actions)
        self._runs += 1
        self._launch(0)
        if self._on_host:
            for here, there in self._on_host[self._runs % 2]:
                here.copy_(there, non_blocking=True)
        if events:
            self._twin.device.stream.record_event(events[1])
        if self._begin:
            self._launch(1)
        if events and not self._graphs:  # what the launches need is loaded now
            self._graphs = [self._captured(calls) for calls in self._parts]

    @property
    def computing(self) -> bool:
        """Whether the device is still at the last step, how that ends not being known yet; nothing waits for it."""
        return bool(self._events) and self._runs > 0 and not self._events[(self._runs - 1) % 2][1].is_complete

    @property
    def seconds(self) -> float:
        """Time [s] that a GPU took for the step before the last one, until it was known how that ends; 0: there was none."""
        if not self._events or self._runs < 2:
            return 0.0
        first, last = self._events[self._runs % 2]
        return 1e-3 * wp.get_event_elapsed_time(first, last)

    def _step_launches(self, kernels: TaskKernels) -> list[Callable[[], Any]]:
        """Those that make a control step, observation included."""
        before, after = ([self._recorded(launch).launch for launch in some] for some in (kernels.before, kernels.after))
        clear = self._recorded((clear_flags, [self._memory]), 1).launch
        return [clear, *before, self._advance_twins, *after, self._observe.launch]

    def _advance_twins(self) -> None:
        self._advance(0, self.num_envs)

    def _launch(self, part: int) -> None:
        if self._graphs:
            wp.capture_launch(self._graphs[part])
        else:
            for call in self._parts[part]:
                call()

    def _captured(self, calls: Sequence[Callable[[], Any]]) -> Any:
        """``calls`` as one graph; torch's own stream, where it is the default one, cannot be captured."""
        with (
            wp.ScopedStream(wp.Stream(self._twin.device)) as stream,
            wp.ScopedCapture(stream=stream, force_module_load=False) as capture,
        ):
            for call in calls:
                call()
        return capture.graph

    def judged_view(self) -> Any:
        """What reward terms of the user's own see."""
        return self._task.judged_view()

    def rest(self, rows: Index, known: Sequence[Any]) -> None:
        """First outputs and measurements of the sub-environments ``rows`` (K,).

        ``known`` are five numbers or arrays (K,), see :func:`aoro_gym.envs.core.kernels.step.rest_outputs`.
        """
        values = np.array(np.broadcast_arrays(*known, np.zeros(len(rows)))[:-1], dtype=np.float32)
        self._arrays.put(self.known, (slice(None), rows), values)
        self._choose(rows)
        for each in self._rest:
            each.launch()

    def _choose(self, rows: Index) -> None:
        """Let the episodes of ``rows`` (K,) be those that begin."""
        self._begun[: len(rows)] = rows
        self._flags[int(BEGUN)] = len(rows)

    def take_drawn(self, drawn: Any, *, in_step: bool) -> None:
        """Begin episodes that are drawn ahead.

        Args:
            drawn: A :class:`~aoro_gym.envs.core.kernels.beginning.Drawn`, whose arrays live as long as it is used, or None.
            in_step: Whether they begin in the launches of a step in which others end.
        """
        memory = self._memory
        if self._graphs:
            wp.synchronize_device(self._twin.device)  # it may be at them
        self._drawn, self._write, self._begin, self._graphs, self._on_host = drawn, None, [], [], []
        self._parts = [self._step]
        if drawn is None:
            return
        threads = THREADS if self._twin.device.is_cuda else 1
        self._write = self._recorded((write_drawn, [memory, drawn, threads]), threads)
        if in_step:
            self._final = self._arrays.copy(self._observation)
            rests = (each.launch for each in (*self._rest, self._observe))
            choosing = self._recorded((choose, [memory, drawn])).launch
            self._begin = [self._keeping(), self._write.launch, self._twin.recorded_reset().launch, *rests]
            self._parts = [[*self._step, choosing], self._begin]
            there = self._flags, self._ended[int(DONE)]
            self._on_host = [
                [(self._arrays.pinned(tuple(each.shape), each.dtype), each) for each in there] for _ in range(2)
            ]
            self._seen = [[here.numpy() for here, _ in each] for each in self._on_host]

    def _keeping(self) -> Callable[[], Any]:
        """Keeps the observation at the end of a step."""
        if not self._twin.device.is_cuda:
            return partial(self._final.copy_, self._observation)
        return partial(wp.copy, self._arrays.shared(self._final), self._memory.observation)

    @property
    def begins(self) -> bool:
        """Whether episodes begin in the launches of a step."""
        return bool(self._begin)

    def begin(self, rows: Index) -> None:
        """Begin the episodes of ``rows`` (K,) that are drawn."""
        assert self._write is not None
        self._choose(rows)
        self._twin.start_memory[0].zero_()
        self._write.launch()
        self._twin.reset_marked()
        for each in self._rest:
            each.launch()

    def wait(self) -> tuple[list[int], NDArray[np.bool_]]:
        """The flags, and for another step whose episode has ended (N,), when it is known how a step ends; episodes that it
        begins, and what was launched after them, are not waited for."""
        if self._events:
            wp.synchronize_event(self._events[(self._runs - 1) % 2][1])
        flags, done = self._seen[self._runs % 2]
        return flags.tolist(), done

    def results(self) -> tuple[list[Array], list[Logged]]:
        """Of a step that begins episodes, too, in memory that the next one overwrites: the observation, that of its end,
        rewards, reasons and rows of how episodes ended; and what is logged."""
        return [self._observation, self._final, self._rewards, self._ending, self._ended], self._logged

    def told(self) -> None:
        """Let the task know that its arrays are those of another step."""
        self._task.took(self.outputs)

    def observe(self) -> None:
        """Renew the observation where it is not to stay as it was."""
        self._observe.launch()

    @property
    def has_own(self) -> bool:
        """Whether any term is left to the host."""
        return bool(self.own_rewards or self.own_observations)

    @property
    def flags(self) -> Array:
        """See :mod:`aoro_gym.envs.core.kernels.step` (5,)."""
        return self._flags[:5]

    def judged(self) -> tuple[Array, Array]:
        """Rewards (N,) by the terms that the kernels know, and which episodes terminate: until the next step."""
        return self._rewards, self._ended[int(TERMINATED)]

    def values(self) -> Array:
        """Contribution of each reward term (T, N), to be kept; 0 for those of own functions."""
        return self._arrays.copy(self._values)

    def rewards(self) -> Array:
        """Sum of the terms that the kernels know (N,), to be kept."""
        return self._arrays.copy(self._rewards)

    def ended(self) -> tuple[Array, Array, Array, Array, Array]:
        """Why episodes end (N,), and whether they terminate, are truncated, either, and ran at all, to be kept."""
        ended = self._arrays.copy(self._ended)
        rows = (ended[int(row)] for row in (TERMINATED, TRUNCATED, DONE, RUNNING))
        terminated, truncated, done, running = rows
        return self._arrays.copy(self._ending), terminated, truncated, done, running

    def infos(self) -> dict[str, Array]:
        """What ``Task.info`` gives at the end of the step."""
        out: dict[str, Array] = {}
        for names, array in self._kernels.logged:
            out |= zip(names, self._arrays.copy(array), strict=True)
        return out


def shared(out: Any, source: Any, names: Any, arrays: Arrays, prefix: str = "") -> Any:
    """``out`` with arrays of ``source``, shared.

    Args:
        out: A struct.
        source: What holds the arrays.
        names: Of its fields.
        arrays: Where they live.
        prefix: Of their names in ``source``.
    """
    for name in names:
        setattr(out, name, arrays.shared(getattr(source, prefix + name)))
    return out


def told_memory(
    told: Any, names: Sequence[Sequence[str]], count: int, arrays: Arrays, number: Any = None
) -> tuple[Any, list[tuple[Sequence[str], Array]]]:
    """``told``, and what is logged through it, as :class:`TaskKernels` takes it.

    Args:
        told: A struct with the arrays ``floats`` (rows, N), ``integers`` (rows, N) and ``success`` (N,).
        names: Of the rows of each; ``success`` has one.
        count: Number N of sub-environments.
        arrays: Where they live.
        number: Type of the ``floats``, by default float64.
    """
    xp = arrays.xp
    kinds = (number, xp.int64, xp.bool)
    logged = [arrays.zeros((len(rows), count), kind) for rows, kind in zip(names, kinds, strict=True)]
    floats, integers, success = logged
    told.floats, told.integers, told.success = (arrays.shared(each) for each in (floats, integers, success[0]))
    return told, list(zip(names, logged, strict=True))


def kernel_step(env: Any) -> KernelStep | None:
    """The step of ``env`` in kernels; None for a task that has none, and where arrays and twins live apart."""
    kernels = getattr(env.task, "kernels", None)
    apart = env.arrays.on_host and env.twin.device.is_cuda
    return None if kernels is None or apart or not env.task.has_kernels else KernelStep(env)


def _kind(function: Callable[[Any], Array], known: Sequence[Callable[[Any], Array]]) -> int:
    """Number of a term's function among those that the kernels know."""
    return known.index(function) if function in known else int(OWN)
