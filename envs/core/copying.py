"""True copies and pickles of environments.

An environment's arrays partly alias the memory of its twin; those of a copy alias the memory of the copy's twin.
"""

from __future__ import annotations

import copy
import io
import pickle
from collections.abc import Callable, Mapping
from importlib import import_module
from types import ModuleType
from typing import Any

ADVICE = (
    "an environment is pickled only if all of its terms and wrappers are: define their functions in a module, or make "
    "another environment with the same arguments (gymnasium.make(env.spec)) and reset it with the same seed"
)


def copied(env: Any, memo: dict[int, Any]) -> Any:
    """A deep copy of the vector environment ``env``; see :func:`copy.deepcopy` for ``memo``."""
    other: Any = object.__new__(type(env))
    memo[id(env)] = other
    twin = copy.deepcopy(env.twin, memo)
    aliases = env.aliases()
    memo |= {id(array): now for array, now in zip(aliases, env.aliases(twin), strict=True)}
    memo |= {id(module): module for module in (env.arrays.xp,)}
    state = {name: copy.deepcopy(value, memo) for name, value in env.copied_state().items()}
    other.restore_state({**state, "twin": twin})
    return other


def pickled(env: Any) -> tuple[Callable[..., Any], tuple[Any, ...]]:
    """What ``env.__reduce__`` gives; TypeError that says what to do if a part of it cannot be pickled."""
    aliases = {id(array): number for number, array in enumerate(env.aliases())}
    buffer = io.BytesIO()
    try:
        twin = pickle.dumps(env.twin)
        _Pickler(buffer, aliases, env.twin).dump(env.copied_state())
    except Exception as error:  # whatever a part that cannot be pickled raises
        raise TypeError(f"{type(env).__name__}: {error}; {ADVICE}") from error
    return _restored, (type(env), twin, buffer.getvalue(), env.arrays)


def _restored(kind: type, twin: bytes, state: bytes, arrays: Any) -> Any:
    env: Any = object.__new__(kind)
    env.arrays, env.twin = arrays, pickle.loads(twin)
    env.restore_state(_Unpickler(io.BytesIO(state), env.aliases(), env.twin).load())
    return env


class _Pickler(pickle.Pickler):
    """Leaves out the twin, its memory and modules, and names them instead."""

    def __init__(self, file: io.BytesIO, aliases: Mapping[int, int], twin: Any):
        super().__init__(file)
        self._aliases, self._twin = aliases, twin

    def persistent_id(self, obj: Any) -> Any:
        if obj is self._twin:
            return "twin", 0
        if isinstance(obj, ModuleType):
            return "module", obj.__name__
        number = self._aliases.get(id(obj))
        return None if number is None else ("alias", number)


class _Unpickler(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, aliases: tuple[Any, ...], twin: Any):
        super().__init__(file)
        self._aliases, self._twin = aliases, twin

    def persistent_load(self, pid: Any) -> Any:
        kind, name = pid
        return {
            "twin": lambda: self._twin,
            "module": lambda: import_module(name),
            "alias": lambda: self._aliases[name],
        }[kind]()
