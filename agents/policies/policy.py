"""Policies: what all of them offer, and learned ones as small files that load without torch or foreign code.

A policy is two files: ``NAME.safetensors`` holds the numbers, ``NAME.json`` what they mean: environment, observation terms,
network, and how the policy was trained. ``agents/policies`` ships some, which go by their name.

>>> import gymnasium
>>> from aoro_gym.agents.policies.files import shipped_policies
>>> for name, path in shipped_policies("AORO/Turning-v0").items():
...     policy = LearnedPolicy.load(path)  # doctest: +SKIP

Stable-Baselines3's own files (``.zip``, ``vecnormalize.pkl``) are pickles: whoever made one decides what runs when it is
loaded. :func:`~aoro_gym.agents.policies.files.load_policy` takes them only from those who say that they trust it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from aoro_gym.agents.policies.description import (
    FORMAT,
    FORMAT_WITH_MEMORY,
    NoNumbers,
    fingerprint,
    read_array,
    read_description,
    read_numbers,
    shortened,
)
from aoro_gym.agents.policies.memory import GatedMemory
from aoro_gym.checks import check_choice, check_finite, check_range
from aoro_gym.envs.core.offered_terms import FURTHER
from aoro_gym.execution.files import read_json, written_whole

Observations = NDArray[np.float32]
Actions = NDArray[np.float32]
ACTIVATIONS = {"tanh": np.tanh, "relu": lambda x: np.maximum(x, 0.0)}
"""Of the hidden layers, by name."""


class Policy(Protocol):
    """Anything that maps observations to actions, many at once."""

    def __call__(self, observations: Observations) -> Actions:
        """Actions (N, A) for observations (N, O)."""
        ...

    def reset(self, mask: NDArray[np.bool_] | None = None) -> None:
        """Forget the past of the sub-environments where ``mask`` (N,) holds, or of all."""
        ...


@dataclass(frozen=True)
class Normalisation:
    """y = clip((x − mean) / √(variance + ε), ±clip), in float64 as ``VecNormalize`` calculates it."""

    mean: NDArray[np.float64]
    variance: NDArray[np.float64]
    epsilon: float
    clip: float

    def __call__(self, observations: NDArray[Any]) -> NDArray[np.float32]:
        scaled = (observations - self.mean) / np.sqrt(self.variance + self.epsilon)
        return np.clip(scaled, -self.clip, self.clip).astype(np.float32)


@dataclass(frozen=True)
class LearnedPolicy:
    """A multilayer perceptron that maps observations to actions, with a memory before it or without; the same protocol as
    the reference controllers.

    One with a memory is for one environment at a time: it remembers what each of its sub-environments was asked since
    :meth:`reset`; :meth:`made_for` gives one that remembers nothing yet.

    Raises ValueError if its parts do not fit each other.
    """

    weights: tuple[NDArray[np.float32], ...]
    """Of each layer, (outputs, inputs)."""
    biases: tuple[NDArray[np.float32], ...]
    """Of each layer, (outputs,)."""
    activation: str
    """Of the hidden layers, a key of :data:`ACTIVATIONS`."""
    squashed: bool
    """Whether a hyperbolic tangent bounds the result, which is then stretched over the action space."""
    low: NDArray[np.float32]
    """Bounds of the action space (A,)."""
    high: NDArray[np.float32]
    normalisation: Normalisation | None = None
    """Of the observation; None takes it as it is."""
    environment: str = ""
    """Id of the environment that the policy was trained in."""
    layout: Mapping[str, slice] = field(default_factory=dict)
    """Columns of the observation by term; empty if they are not known."""
    training: Mapping[str, Any] = field(default_factory=dict)
    """How the policy came about: command, seed, steps, revision, …"""
    memory: GatedMemory | None = None
    """Before the layers, which then take what it gives; None: they take the observation."""
    _state: NDArray[np.float32] | None = field(default=None, init=False, repr=False, compare=False)
    """Of the memory (N, U), once it was asked."""

    def __repr__(self) -> str:
        memory = "" if self.memory is None else f"memory {self.memory.sizes[-1]}, "
        return f"LearnedPolicy({self.environment!r}, {memory}layers {self.sizes}, {self.activation})"

    def __post_init__(self) -> None:
        check_choice("activation", self.activation, ACTIVATIONS)
        sizes = [self.weights[0].shape[1], *(len(weight) for weight in self.weights)]
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            if weight.shape != (sizes[k + 1], sizes[k]) or bias.shape != (sizes[k + 1],):
                raise ValueError(
                    f"layer {k} has weights {weight.shape} and biases {bias.shape}, but follows {sizes[k]} numbers"
                )
            check_finite(f"layer{k}.weight", weight)
            check_finite(f"layer{k}.bias", bias)
        if self.low.shape != (sizes[-1],) or self.high.shape != (sizes[-1],):
            raise ValueError(f"the network gives {sizes[-1]} actions, but {self.low.shape[0]} have bounds")
        for k in np.flatnonzero(~(self.low <= self.high)):
            raise ValueError(f"action.low[{k}] is {self.low[k]}, but must be at most action.high[{k}], {self.high[k]}")
        if self.memory is not None and sum(self.memory.sizes[1:]) != sizes[0]:
            raise ValueError(f"the memory gives {sum(self.memory.sizes[1:])} numbers, but layer 0 takes {sizes[0]}")
        if self.normalisation is not None:
            for moment in (self.normalisation.mean, self.normalisation.variance):
                if moment.shape != (self.observed,):
                    raise ValueError(f"the network takes {self.observed} numbers, but {len(moment)} are normalised")
            check_range("observation.variance", self.normalisation.variance, ge=0.0)

    @property
    def sizes(self) -> list[int]:
        """Numbers before and after each layer, behind a memory."""
        return [self.weights[0].shape[1], *(len(weight) for weight in self.weights)]

    @property
    def observed(self) -> int:
        """Numbers of an observation."""
        return self.weights[0].shape[1] if self.memory is None else self.memory.sizes[0]

    def __call__(self, observations: Observations) -> Actions:
        values = np.asarray(observations, dtype=np.float32)[..., : self.observed]
        if self.normalisation is not None:
            values = self.normalisation(values)
        if self.memory is not None:
            values = self._remembered(self.memory, values)
        last = len(self.weights) - 1
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            values = values @ weight.T + bias
            if k < last:
                values = ACTIVATIONS[self.activation](values)
        if self.squashed:
            values = self.low + np.float32(0.5) * (np.tanh(values) + np.float32(1.0)) * (self.high - self.low)
        return np.clip(values, self.low, self.high)

    def _remembered(self, memory: GatedMemory, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """What the memory gives, which takes in the ``values`` (N, O); of another number N it begins anew."""
        state = self._state
        if state is None or len(state) != len(values):
            state = np.zeros((len(values), memory.sizes[2]), dtype=np.float32)
        values, state = memory(values, state)
        object.__setattr__(self, "_state", state)
        return values

    def reset(self, mask: NDArray[np.bool_] | None = None) -> None:
        """Forget the past, if there is a memory: of the sub-environments where ``mask`` (N,) holds, or of all."""
        if self._state is not None:
            state = None if mask is None else np.where(mask[:, None], np.float32(0.0), self._state)
            object.__setattr__(self, "_state", state)

    def made_for(self, env: Any) -> LearnedPolicy:
        """This policy, for the environment ``env``, wrapped or not.

        Raises ValueError that says what it observes otherwise than this policy has learned.
        """
        env = env.unwrapped
        learned, estimated = self.training.get("localisation"), getattr(env, "localisation", None)
        if learned not in (None, estimated):
            raise ValueError(
                f"the policy has learned with localisation {learned!r}, but that of the environment is {estimated!r}; make "
                f"it with localisation={learned!r}, or give --localisation {learned}"
            )
        layout = dict(env.observation_layout)
        # further terms come last: what was learned from is the same without them
        left_out = [name for name in layout if self.layout and name not in self.layout and name in FURTHER]
        known = {name: span for name, span in layout.items() if name not in left_out}
        if self.layout and known != dict(self.layout):
            lacking = {name: True for name in self.layout if name not in layout and name in FURTHER}
            raise ValueError(
                f"the policy has learned from {_listed(self.layout)}, but the environment observes {_listed(layout)}"
                + (f"; make it with observation_terms={lacking}" if lacking else "")
            )
        beside = sum(layout[name].stop - layout[name].start for name in left_out)
        for what, mine, further, space in (
            ("observes", self.observed, beside, env.single_observation_space),
            ("takes", self.sizes[-1], 0, env.single_action_space),
        ):
            if space.shape != (mine + further,):
                raise ValueError(f"the environment {what} {space.shape[0]} numbers, but the policy was made for {mine}")
        return self if self.memory is None else replace(self)

    def save(self, path: Path) -> list[Path]:
        """Write ``path`` with the suffixes .safetensors and .json, each whole or not at all.

        The JSON has the digest of the numbers that it describes: one of other numbers is refused when it is loaded.
        """
        from safetensors.numpy import save

        numbers, about = path.with_suffix(".safetensors"), path.with_suffix(".json")
        content = save({name: np.ascontiguousarray(array) for name, array in self.arrays().items()})
        description = {**self.description(), "numbers": fingerprint(content)}
        with written_whole(numbers) as first, written_whole(about) as second:
            first.write_bytes(content)
            second.write_text(json.dumps(description, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
        return [numbers, about]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All numbers by name."""
        found: dict[str, NDArray[Any]] = {"action.low": self.low, "action.high": self.high}
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            found |= {f"layer{k}.weight": weight, f"layer{k}.bias": bias}
        if self.normalisation is not None:
            found |= {"observation.mean": self.normalisation.mean, "observation.variance": self.normalisation.variance}
        return found if self.memory is None else found | self.memory.arrays()

    def description(self) -> dict[str, Any]:
        """What the numbers mean, for JSON."""
        one = self.normalisation
        network: dict[str, Any] = {"sizes": self.sizes, "activation": self.activation, "squashed": self.squashed}
        if self.memory is not None:
            network["memory"] = list(self.memory.sizes)
        return {
            "format": FORMAT if self.memory is None else FORMAT_WITH_MEMORY,
            "environment": self.environment,
            "observation": {name: [span.start, span.stop] for name, span in self.layout.items()},
            "normalisation": None if one is None else {"epsilon": one.epsilon, "clip": one.clip},
            "network": network,
            "training": dict(self.training),
        }

    @classmethod
    def of(cls, description: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> LearnedPolicy:
        """What :meth:`description` and :meth:`arrays` were of.

        Raises ValueError naming what is missing or wrong.
        """
        fields, sizes, normalised, remembers = read_description(description)
        normalisation = None
        if normalised is not None:
            mean, variance = (read_array(arrays, f"observation.{name}", 1, np.float64) for name in ("mean", "variance"))
            normalisation = Normalisation(mean, variance, **normalised)
        found = cls(
            weights=tuple(read_array(arrays, f"layer{k}.weight", 2) for k in range(len(sizes) - 1)),
            biases=tuple(read_array(arrays, f"layer{k}.bias", 1) for k in range(len(sizes) - 1)),
            low=read_array(arrays, "action.low", 1),
            high=read_array(arrays, "action.high", 1),
            normalisation=normalisation,
            memory=GatedMemory.of(arrays, read_array) if remembers else None,
            **fields,
        )
        if found.sizes != sizes:
            raise ValueError(f"its layers have the sizes {found.sizes}, not {shortened(sizes)}")
        if found.memory is not None and list(found.memory.sizes) != remembers:
            raise ValueError(f"its memory has the sizes {list(found.memory.sizes)}, not {shortened(remembers)}")
        return found

    @classmethod
    def load(cls, path: Path) -> LearnedPolicy:
        """The policy of the files ``path`` with the suffixes .safetensors and .json.

        Raises ValueError naming the file and what is wrong in it, OSError if there is none.
        """
        numbers, about = path.with_suffix(".safetensors"), path.with_suffix(".json")
        if path.is_file() and not about.is_file():
            raise ValueError(f"{path} needs {about.name} beside it, which says what its numbers mean")
        description = read_json(about)
        try:
            read_description(description)
        except ValueError as error:
            raise ValueError(f"{about} is no policy's: {error}") from None
        content = numbers.read_bytes()
        try:
            found = cls.of(description, read_numbers(numbers, content))
            if description["format"] >= FORMAT and description.get("numbers") != fingerprint(content):
                raise ValueError("its numbers are others; resume the training, which writes both, or restore them")
            return found
        except NoNumbers:
            raise
        except ValueError as error:
            raise ValueError(f"{numbers} is not the policy that {about.name} describes: {error}") from None


def _listed(layout: Mapping[str, slice]) -> str:
    return ", ".join(f"{name} ({span.stop - span.start})" for name, span in layout.items())
