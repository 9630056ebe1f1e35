"""Reward and observation terms: plain functions of a task's view, by name.

A term is a function of one argument, the view of all sub-environments at the end of a control step (for turning:
:class:`aoro_gym.envs.turning.view.TurningView`). It returns one number a sub-environment, shape (N,); an observation term
may also return (N, K). The view's ``xp`` is the namespace of its arrays, by the names of the array API standard: terms that
call ``view.xp.abs`` and the like, instead of ``numpy.abs``, work with ``output="torch"``, too. A view holds until the next
step.

Where a task has kernels (:mod:`aoro_gym.envs.core.kernel_step`) the package's own terms are part of them. Terms of your own
are asked after the launches: the first one costs the view, about 0.1 ms a step on a CPU and 60 small launches on a GPU.

Terms are changed by name when an environment is made, without subclassing:

    gymnasium.make(
        "AORO/Turning-v0",
        reward_terms={
            "pump_effort": (-0.1, lambda view: view.output("pump_pressure") / 1e7),  # new: weight, function
            "overshoot": -20.0,                                                      # another weight
            "flow_oscillation": None,                                                # left out
        },
        observation_terms={"engine_speed": ObservationTerm(lambda view: view.output("engine_speed"), low=0, high=300)},
    )
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from aoro_gym.execution.array_api import Array

LARGEST = 1e6
"""Bound of an observation term that states none; check_env wants finite spaces."""


@dataclass(frozen=True)
class RewardTerm:
    """One summand of the reward: ``weight`` × ``function(view)``, the function's result of shape (N,)."""

    weight: float
    function: Callable[[Any], Array]

    def __post_init__(self) -> None:
        if not callable(self.function):
            raise ValueError(f"a reward term's function is {self.function!r}, but must be callable: view → (N,)")
        if isinstance(self.weight, bool) or not isinstance(self.weight, int | float) or not math.isfinite(self.weight):
            raise ValueError(f"a reward term's weight is {self.weight!r}, but must be a finite number")


@dataclass(frozen=True)
class ObservationTerm:
    """One part of the observation: ``function(view)`` of shape (N,) or (N, K), clipped to [``low``, ``high``]."""

    function: Callable[[Any], Array]
    low: float = -LARGEST
    high: float = LARGEST

    def __post_init__(self) -> None:
        if not callable(self.function):
            raise ValueError(
                f"an observation term's function is {self.function!r}, but must be callable: view → (N, K)"
            )
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise ValueError(
                f"an observation term's bounds are [{self.low}, {self.high}], but must be finite with low < high"
            )


T = TypeVar("T")


class Frozen(Mapping[str, T], Generic[T]):
    """An immutable mapping by name, in order; unlike a mapping proxy it can be copied and pickled."""

    def __init__(self, items: Mapping[str, T] | None = None):
        self._items = dict(items or {})

    def __getitem__(self, name: str) -> T:
        return self._items[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __hash__(self) -> int:
        return hash(tuple(self._items.items()))

    def __repr__(self) -> str:
        return f"Frozen({self._items!r})"


def changed_rewards(
    terms: Mapping[str, RewardTerm],
    changes: Mapping[str, Any] | None,
    further: Mapping[str, Callable[[Any], Array]] | None = None,
) -> Frozen[RewardTerm]:
    """``terms`` with ``changes`` by name: a term or (weight, function), a weight alone, a function alone (weight 1), or
    None to leave the term out. A weight alone also asks for one of the ``further`` functions by its name.

    Raises ValueError that names the term and the fix.
    """
    further = {} if further is None else further
    result = dict(terms)
    for name, change in _named(changes, "reward_terms").items():
        if change is None:
            _known(name, result, "reward_terms", "leave out")
            del result[name]
        elif isinstance(change, RewardTerm):
            result[name] = change
        elif isinstance(change, int | float | np.number) and not isinstance(change, bool):
            known = {**further, **{each: term.function for each, term in result.items()}}
            _known(name, known, "reward_terms", "weigh")
            result[name] = _built(name, "reward_terms", RewardTerm, float(change), known[name])
        elif isinstance(change, tuple | list) and len(change) == 2:
            result[name] = _built(name, "reward_terms", RewardTerm, *change)
        elif callable(change):
            result[name] = RewardTerm(1.0, change)
        else:
            raise ValueError(
                f"reward_terms[{name!r}] is {change!r}; give (weight, function), a weight, a function, or None to leave "
                "the term out"
            )
    if not result:
        raise ValueError("reward_terms leaves no term; keep at least one")
    return Frozen(result)


def changed_observations(
    terms: Mapping[str, ObservationTerm],
    changes: Mapping[str, Any] | None,
    offered: Mapping[str, Callable[[], ObservationTerm]] | None = None,
) -> Frozen[ObservationTerm]:
    """``terms`` with ``changes`` by name: a term, a function alone, or None to leave the term out; new ones come last.

    True asks for the term that is ``offered`` under the name, with its defaults. Raises ValueError that names the term and
    the fix.
    """
    offered = {} if offered is None else offered
    result = dict(terms)
    for name, change in _named(changes, "observation_terms").items():
        if change is None:
            _known(name, result, "observation_terms", "leave out")
            del result[name]
        elif change is True:
            _known(name, offered, "observation_terms", "ask for by True")
            result[name] = offered[name]()
        elif isinstance(change, ObservationTerm):
            result[name] = change
        elif callable(change):
            result[name] = ObservationTerm(change)
        else:
            raise ValueError(
                f"observation_terms[{name!r}] is {change!r}; give an ObservationTerm, a function, None to leave the "
                f"term out, or True for one of: {', '.join(offered) or 'none'}"
            )
    if not result:
        raise ValueError("observation_terms leaves no term; keep at least one")
    return Frozen(result)


def rewards_of(terms: Mapping[str, RewardTerm], view: Any, num_envs: int) -> dict[str, Array]:
    """Weighted contribution of every term, each of shape (num_envs,).

    Raises ValueError naming a term whose result has another shape.
    """
    return {
        name: term.weight * _shaped(term.function(view), (num_envs,), f"reward_terms[{name!r}]")
        for name, term in terms.items()
    }


def observations_of(terms: Mapping[str, ObservationTerm], view: Any, num_envs: int) -> list[Array]:
    """Parts of the observation, each of shape (num_envs, K), not clipped yet.

    Raises ValueError naming a term whose result has another shape.
    """
    parts = []
    for name, term in terms.items():
        value = term.function(view)
        if getattr(value, "ndim", 0) == 2:
            value = _shaped(value, (num_envs, value.shape[1]), f"observation_terms[{name!r}]")
        else:
            value = _shaped(value, (num_envs,), f"observation_terms[{name!r}]")[:, None]
        parts.append(value)
    return parts


def _shaped(value: Array, shape: tuple[int, ...], what: str) -> Array:
    if tuple(getattr(value, "shape", ())) != shape:
        raise ValueError(
            f"{what} returned {tuple(value.shape) if hasattr(value, 'shape') else value!r}, but must return an array of "
            f"shape {shape}: one value a sub-environment"
        )
    return value


def _named(changes: Mapping[str, Any] | None, what: str) -> Mapping[str, Any]:
    if changes is None:
        return {}
    if not isinstance(changes, Mapping):
        raise ValueError(f"{what} is {changes!r}, but must be a mapping of names to terms")
    for name in changes:
        if not isinstance(name, str) or not name:
            raise ValueError(f"{what} has the name {name!r}, but names must be non-empty strings")
    return changes


def _known(name: str, terms: Mapping[str, Any], what: str, purpose: str) -> None:
    if name not in terms:
        raise ValueError(f"{what} has no {name!r} to {purpose}; choose one of: {', '.join(terms)}")


def _built(name: str, what: str, kind: Callable[..., T], *arguments: Any) -> T:
    try:
        return kind(*arguments)
    except ValueError as error:
        raise ValueError(f"{what}[{name!r}]: {error}") from None
