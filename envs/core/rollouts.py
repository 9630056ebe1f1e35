"""What running episodes would come to: copies of them, on which actions are tried.

>>> import gymnasium
>>> import numpy as np
>>> from aoro_gym.envs import register_envs
>>> from aoro_gym.envs.core.rollouts import Rollouts
>>> register_envs()
>>> envs = gymnasium.make_vec("AORO/Turning-v0", num_envs=2)
>>> _ = envs.reset(seed=1)
>>> tried = Rollouts(envs.unwrapped, copies=3)
>>> tried.load(envs.unwrapped)
>>> left = np.full((6, 1), 0.5, dtype=np.float32)  # three copies of the first episode, then three of the second
>>> rewards, ended = tried.step(left)
>>> rewards.shape
(6,)
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.checks import check_integer
from aoro_gym.envs.core.ray_sensing import RaySensing
from aoro_gym.envs.core.task import Outputs
from aoro_gym.envs.core.terms import Frozen
from aoro_gym.envs.core.vector import TwinVectorEnv
from aoro_gym.execution.array_api import Array, Arrays, Index, namespace
from aoro_gym.execution.device_names import SIMD

DIVERGED = -1e6
"""Reward of a step in which a twin diverges: worse than anything that an episode may come to."""
Place = tuple[Any, Any, Any, int]
"""An object, the one that copies it, the name of an array in both, and the axis along which sub-environments lie."""


class Rollouts:
    """``copies`` of every episode of a vector environment, which go on by themselves: same task, same kernels, one launch a
    control step for all. A copy has the twin's state, the task's, and its sensors' errors, those to come included, so that
    equal actions come to the same.

    Args:
        env: Whose episodes are copied; its machine is that of the copies. What it observes by rays is not copied.
        copies: Of each, at least 2.

    Raises ValueError naming ``copies``.
    """

    def __init__(self, env: TwinVectorEnv, copies: int):
        check_integer("copies", copies, ge=2)
        self.copies = copies
        self._rows = np.repeat(np.arange(env.num_envs), copies)
        twin = env.twin
        self._env = TwinVectorEnv(
            _without_state(env.task),
            len(self._rows),
            machine=twin.machine.variants(self._rows),
            terrain=twin.terrain,
            ground=twin._made["ground"],
            soil=None if twin.soil is None else twin.soil.variants(self._rows),
            device=SIMD if twin.simd else twin.device.alias,
            output="numpy" if env.arrays.on_host else "torch",
            own_machines=False,
            autoreset_mode="Disabled",
            kernels=env._kernels and (not env.arrays.on_host or twin.device.is_cpu),  # arrays where those of env are
        )
        self._source: TwinVectorEnv | None = None
        self._places: list[Place] = []

    def load(self, env: TwinVectorEnv) -> None:
        """Copy the episodes of ``env`` as they are now: of the environment that this was made for, or of one like it with
        other machines."""
        mine = self._env
        if self._source is not env:
            self._source = env
            self._places = list(_places(env.task, mine.task, (env.num_envs, mine.num_envs)))
        with mine.arrays.ordered():
            mine.twin.take_up(env.twin, self._rows)
            mine._read_outputs()
            on_device = env.arrays.index(self._rows)
            for source, target, name, axis in [*self._places, (env, mine, "_steps", 0)]:
                values = _part(source, name)
                rows = self._rows if isinstance(values, np.ndarray) else on_device  # some are of the host anyway
                _part(target, name)[...] = _repeated(values, axis, env.num_envs, rows)
            outputs = Outputs(mine.arrays.alias(mine.twin.outputs), mine.arrays.alias(mine.twin.state))
            _forget_views(mine.task, outputs)

    def step(self, actions: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Advance all copies by a control step.

        Args:
            actions: (num_envs x copies, A), all copies of an episode after each other.

        Returns:
            Rewards, those of twins that diverge :data:`DIVERGED`, and whether the episode terminates in this step, each
            (num_envs x copies,). The copies go on all the same.
        """
        mine = self._env
        mine._done[:] = False
        _, rewards, terminated, _, _ = mine.step(actions)
        diverged = mine.arrays.host(mine._status) != 0
        rewards = np.where(diverged, np.float32(DIVERGED), mine.arrays.host(rewards))
        return rewards, np.array(mine.arrays.host(terminated))

    def returns(self, actions: NDArray[np.float32]) -> NDArray[np.float64]:
        """Sum of the rewards of each copy (num_envs x copies,) until its episode terminates, a step at a time as
        :meth:`step`; the host waits for the last one alone, where the kernels know all of the task's terms.

        Args:
            actions: Of H control steps (num_envs x copies, H, A).
        """
        in_turn = np.ascontiguousarray(np.moveaxis(actions, 1, 0))
        mine, kernels = self._env, self._env._in_kernels()
        if kernels is None or kernels.has_own:
            return self._returns_of_steps(in_turn)
        arrays, xp = mine.arrays, mine.arrays.xp
        total, running = arrays.zeros(len(actions)), arrays.ones(len(actions), xp.bool)
        with arrays.ordered():
            for given in arrays.asarray(in_turn, xp.float32):
                kernels.run(given)
                rewards, terminated = kernels.judged()
                rewards = xp.where(kernels.status != 0, DIVERGED, rewards)
                total += xp.where(running, rewards, 0.0)
                running &= ~terminated
            kernels.told()
            return np.array(arrays.host(total))

    def _returns_of_steps(self, in_turn: NDArray[np.float32]) -> NDArray[np.float64]:
        total, running = np.zeros(in_turn.shape[1]), np.ones(in_turn.shape[1], dtype=bool)
        for given in in_turn:
            rewards, ended = self.step(given)
            total += np.where(running, rewards, 0.0)
            running &= ~ended
        return total


def _without_state(task: Any) -> Any:
    """A task like ``task``, to be allocated; of what it observes one term is left, as nobody looks at it."""
    bare = copy.copy(task)
    for name, part in vars(task).items():
        if hasattr(part, "allocate"):
            setattr(bare, name, _without_state(part))
    name, term = next(
        (name, term) for name, term in task.observation_terms.items() if not hasattr(term.function, "oldest")
    )
    bare.observation_terms = Frozen({name: term})
    return bare


def _places(source: Any, target: Any, counts: tuple[int, int], seen: set[int] | None = None) -> Iterator[Place]:
    """Where ``source`` holds arrays of its sub-environments, as ``target`` does of its own; ``counts`` are how many."""
    seen = set() if seen is None else seen
    for name, mine, other in _parts(source, target):
        if isinstance(mine, Outputs | RaySensing | Arrays) or name == "_view" or id(mine) in seen:
            continue
        if hasattr(mine, "shape") and hasattr(mine, "dtype"):
            axis = _axis(tuple(mine.shape), tuple(other.shape), counts)
            if axis is not None:
                yield source, target, name, axis
        elif isinstance(mine, dict | list | tuple) or type(mine).__module__.startswith("aoro_gym."):
            seen.add(id(mine))
            yield from _places(mine, other, counts, seen)


def _parts(source: Any, target: Any) -> Iterator[tuple[Any, Any, Any]]:
    """Names of what both hold, and what they hold."""
    if isinstance(source, dict):
        yield from ((name, source[name], target[name]) for name in source if name in target)
    elif isinstance(source, list | tuple):
        yield from ((k, mine, other) for k, (mine, other) in enumerate(zip(source, target, strict=False)))
    else:
        theirs = getattr(target, "__dict__", {})
        yield from (
            (name, mine, theirs[name])
            for name, mine in getattr(source, "__dict__", {}).items()
            if isinstance(theirs.get(name), type(mine)) and theirs[name] is not mine
        )


def _axis(mine: tuple[int, ...], other: tuple[int, ...], counts: tuple[int, int]) -> int | None:
    """Along which sub-environments lie in arrays of these shapes; None where they are of something else."""
    differ = [k for k, (few, many) in enumerate(zip(mine, other, strict=True)) if few != many]
    if not differ:
        return None
    few, many = mine[differ[0]], other[differ[0]]
    if len(differ) > 1 or few * counts[1] != many * counts[0]:
        raise ValueError(f"arrays of shapes {mine} and {other} are not of {counts[0]} and {counts[1]} sub-environments")
    return differ[0]


def _part(owner: Any, name: Any) -> Any:
    return owner[name] if isinstance(owner, dict | list | tuple) else getattr(owner, name)


def _repeated(values: Array, axis: int, count: int, rows: Index) -> Array:
    """``values`` of ``count`` sub-environments, one or several side by side of each, as those of ``rows``."""
    before, each, after = values.shape[:axis], values.shape[axis] // count, values.shape[axis + 1 :]
    apart = values.reshape(*before, count, each, *after)
    return namespace(values).take(apart, rows, axis=axis).reshape(*before, len(rows) * each, *after)


def _forget_views(task: Any, outputs: Outputs) -> None:
    """Let a task, and what it is made of, see these outputs."""
    task._outputs = outputs
    if hasattr(task, "_view"):
        task._view = None
    for part in vars(task).values():
        if hasattr(part, "allocate"):
            _forget_views(part, outputs)
