"""Learned policies as small files that load without running foreign code, and without torch.

A policy is two files: ``NAME.safetensors`` holds the numbers, ``NAME.json`` what they mean: environment, observation terms,
network, and how the policy was trained. ``agents/policies`` ships some, which go by their name.

>>> import gymnasium
>>> from aoro_gym.agents.policies.learned import shipped_policies
>>> for name, path in shipped_policies("AORO/Turning-v0").items():
...     policy = LearnedPolicy.load(path)  # doctest: +SKIP

Stable-Baselines3's own files (``.zip``, ``vecnormalize.pkl``) are pickles: whoever made one decides what runs when it is
loaded. :func:`load_policy` takes them only from those who say that they trust it.
"""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aoro_gym.agents.controllers.turning import Actions, Observations
from aoro_gym.execution.files import read_json, write_bytes, written_whole

FORMAT, FORMATS = 2, (1, 2)
"""Of the files that are written, and those that are read; those of 1 do not say which numbers they are of."""
SHIPPED = Path(__file__).parent
ACTIVATIONS = {"tanh": np.tanh, "relu": lambda x: np.maximum(x, 0.0)}
"""Of the hidden layers, by name."""
KNOWN = 1e7
"""Observations that a policy to start from counts as having seen: its normalisation hardly moves."""
ONNX_OPSET, ONNX_IR = 17, 9
"""Versions that runtimes of 2023 and later read."""


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
    """A multilayer perceptron that maps observations to actions; the same protocol as the reference controllers.

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

    def __post_init__(self) -> None:
        if self.activation not in ACTIVATIONS:
            raise ValueError(f"activation is {self.activation!r}; choose one of: {', '.join(ACTIVATIONS)}")
        sizes = [self.weights[0].shape[1], *(len(weight) for weight in self.weights)]
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            if weight.shape != (sizes[k + 1], sizes[k]) or bias.shape != (sizes[k + 1],):
                raise ValueError(
                    f"layer {k} has weights {weight.shape} and biases {bias.shape}, but follows {sizes[k]} numbers"
                )
            if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
                raise ValueError(f"layer {k} holds numbers that are not finite")
        if self.low.shape != (sizes[-1],) or self.high.shape != (sizes[-1],):
            raise ValueError(f"the network gives {sizes[-1]} actions, but {self.low.shape[0]} have bounds")
        if not (self.low <= self.high).all():
            raise ValueError("the lower bound of an action is above the upper one")
        if self.normalisation is not None:
            for moment in (self.normalisation.mean, self.normalisation.variance):
                if moment.shape != (sizes[0],):
                    raise ValueError(f"the network takes {sizes[0]} numbers, but {len(moment)} are normalised")
            if not (self.normalisation.variance >= 0.0).all():
                raise ValueError("a variance of the normalisation is below 0")

    @property
    def sizes(self) -> list[int]:
        """Numbers before and after each layer."""
        return [self.weights[0].shape[1], *(len(weight) for weight in self.weights)]

    def __call__(self, observations: Observations) -> Actions:
        values = np.asarray(observations, dtype=np.float32)
        if self.normalisation is not None:
            values = self.normalisation(values)
        last = len(self.weights) - 1
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            values = values @ weight.T + bias
            if k < last:
                values = ACTIVATIONS[self.activation](values)
        if self.squashed:
            values = self.low + np.float32(0.5) * (np.tanh(values) + np.float32(1.0)) * (self.high - self.low)
        return np.clip(values, self.low, self.high)

    def reset(self, mask: NDArray[np.bool_] | None = None) -> None:
        """Nothing to forget."""

    def made_for(self, env: Any) -> LearnedPolicy:
        """This policy, for the environment ``env``, wrapped or not.

        Raises ValueError that says what it observes otherwise than this policy has learned.
        """
        env = env.unwrapped
        layout = dict(env.observation_layout)
        if self.layout and layout != dict(self.layout):
            raise ValueError(
                f"the policy has learned from {_listed(self.layout)}, but the environment observes {_listed(layout)}"
            )
        for what, mine, space in (
            ("observes", self.sizes[0], env.single_observation_space),
            ("takes", self.sizes[-1], env.single_action_space),
        ):
            if space.shape != (mine,):
                raise ValueError(f"the environment {what} {space.shape[0]} numbers, but the policy was made for {mine}")
        return self

    # ---- files

    def save(self, path: Path) -> list[Path]:
        """Write ``path`` with the suffixes .safetensors and .json, each whole or not at all.

        The JSON has the digest of the numbers that it describes: one of other numbers is refused when it is loaded.
        """
        from safetensors.numpy import save

        numbers, about = path.with_suffix(".safetensors"), path.with_suffix(".json")
        content = save({name: np.ascontiguousarray(array) for name, array in self.arrays().items()})
        description = {**self.description(), "numbers": _fingerprint(content)}
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
        return found

    def description(self) -> dict[str, Any]:
        """What the numbers mean, for JSON."""
        one = self.normalisation
        return {
            "format": FORMAT,
            "environment": self.environment,
            "observation": {name: [span.start, span.stop] for name, span in self.layout.items()},
            "normalisation": None if one is None else {"epsilon": one.epsilon, "clip": one.clip},
            "network": {"sizes": self.sizes, "activation": self.activation, "squashed": self.squashed},
            "training": dict(self.training),
        }

    @classmethod
    def of(cls, description: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> LearnedPolicy:
        """What :meth:`description` and :meth:`arrays` were of.

        Raises ValueError naming what is missing or wrong.
        """
        fields, sizes, normalised = _read_description(description)
        normalisation = None
        if normalised is not None:
            mean, variance = (_array(arrays, f"observation.{name}", 1, np.float64) for name in ("mean", "variance"))
            normalisation = Normalisation(mean, variance, **normalised)
        found = cls(
            weights=tuple(_array(arrays, f"layer{k}.weight", 2) for k in range(len(sizes) - 1)),
            biases=tuple(_array(arrays, f"layer{k}.bias", 1) for k in range(len(sizes) - 1)),
            low=_array(arrays, "action.low", 1),
            high=_array(arrays, "action.high", 1),
            normalisation=normalisation,
            **fields,
        )
        if found.sizes != sizes:
            raise ValueError(f"its layers have the sizes {found.sizes}, not {shortened(sizes)}")
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
            _read_description(description)
        except ValueError as error:
            raise ValueError(f"{about} is no policy's: {error}") from None
        content = numbers.read_bytes()
        try:
            found = cls.of(description, _read_numbers(numbers, content))
            if description["format"] == FORMAT and description.get("numbers") != _fingerprint(content):
                raise ValueError("its numbers are others; resume the training, which writes both, or restore them")
            return found
        except _NoNumbers:
            raise
        except ValueError as error:
            raise ValueError(f"{numbers} is not the policy that {about.name} describes: {error}") from None


def _fingerprint(content: bytes) -> str:
    return f"sha256:{hashlib.sha256(content).hexdigest()}"


class _NoNumbers(ValueError):
    """A file holds no arrays."""


def _read_description(content: Mapping[str, Any]) -> tuple[dict[str, Any], list[int], dict[str, float] | None]:
    """Fields of a :class:`LearnedPolicy`, its sizes and the numbers of its normalisation, from a policy's
    JSON.

    Raises ValueError that names what is missing or wrong.
    """
    if _entry(content, "format", int) not in FORMATS:
        known = ", ".join(map(str, FORMATS))
        raise ValueError(f"format is {shortened(content['format'])}, but this version reads {known}")
    network = _entry(content, "network", dict)
    sizes = _entry(network, "sizes", list)
    if len(sizes) < 2 or not all(isinstance(one, int) and not isinstance(one, bool) and one > 0 for one in sizes):
        raise ValueError(f"sizes is {shortened(sizes)}, but must be two whole numbers or more, each above 0")
    layout = {}
    for name, span in _entry(content, "observation", dict).items():
        whole = isinstance(span, list) and len(span) == 2 and all(type(end) is int for end in span)
        if not whole or not 0 <= span[0] < span[1] <= sizes[0]:
            raise ValueError(
                f"observation {shortened(name)} is {shortened(span)}, but must be [first, end] in [0, {sizes[0]}]"
            )
        layout[name] = slice(*span)
    normalised = None
    if "normalisation" not in content:
        raise ValueError("normalisation is missing; null stands for none")
    if content["normalisation"] is not None:
        found = _entry(content, "normalisation", dict)
        normalised = {name: _positive(found, name) for name in ("epsilon", "clip")}
    fields = {
        "activation": _entry(network, "activation", str),
        "squashed": _entry(network, "squashed", bool),
        "environment": _entry(content, "environment", str),
        "layout": layout,
        "training": _entry(content, "training", dict),
    }
    return fields, sizes, normalised


def _entry(content: Mapping[str, Any], name: str, kind: type) -> Any:
    """An entry of the kind; ValueError if it is missing or another."""
    kinds = {int: "a whole number", dict: "an object", list: "a list", str: "text", bool: "true or false"}
    if name not in content:
        raise ValueError(f"{name} is missing")
    if type(content[name]) is not kind:
        raise ValueError(f"{name} is {shortened(content[name])}, but must be {kinds[kind]}")
    return content[name]


def _positive(content: Mapping[str, Any], name: str) -> float:
    value = content.get(name)
    try:
        number = float(value) if type(value) in (int, float) else math.nan  # pyright: ignore[reportArgumentType]
    except OverflowError:
        number = math.inf
    if not 0.0 < number < math.inf:
        raise ValueError(f"{name} is {shortened(value)}, but must be a finite number above 0")
    return number


def shortened(value: Any) -> str:
    """What a file holds, for a message."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:40]}... ({len(text)} characters)"


def _read_numbers(file: Path, content: bytes) -> dict[str, NDArray[Any]]:
    """Arrays by name; an error that names the file if it holds none."""
    from safetensors.numpy import load

    try:
        return load(content)
    except Exception as error:  # of a foreign library, for whatever bytes
        raise _NoNumbers(f"{file} is no .safetensors: {shortened(str(error))}") from None


def _array(arrays: Mapping[str, NDArray[Any]], name: str, dimensions: int, kind: Any = np.float32) -> NDArray[Any]:
    """An array of finite numbers; ValueError if it is missing or another."""
    if name not in arrays:
        raise ValueError(f"{name} is missing")
    found = arrays[name]
    if found.ndim != dimensions or found.dtype.kind != "f":
        raise ValueError(
            f"{name} has shape {found.shape} and type {found.dtype}, but must be {dimensions}-dimensional floats"
        )
    if not np.isfinite(found).all():
        raise ValueError(f"{name} holds numbers that are not finite")
    return found.astype(kind, copy=False)


def shipped_policies(environment: str) -> dict[str, Path]:
    """The policies for an environment that come with the package, by name."""
    files = sorted(SHIPPED.glob("*.json"))
    found = {file.stem: json.loads(file.read_text(encoding="utf-8"))["environment"] for file in files}
    return {file.stem: file for file in files if found[file.stem] == environment}


def load_policy(path: Path, *, trust_pickle: bool = False) -> LearnedPolicy:
    """The policy of a file: ``.json`` with ``.safetensors``, or, if it is trusted, a ``.zip`` of Stable-Baselines3.

    Raises ValueError naming the file and what is wrong, OSError if there is none.
    """
    if path.suffix in (".json", ".safetensors"):
        return LearnedPolicy.load(path)
    if path.suffix != ".zip":
        raise ValueError(f"{path} is no policy; give a .json with its .safetensors, or a .zip of Stable-Baselines3")
    if not trust_pickle:
        raise ValueError(f"{path} is a pickle, which runs code of whoever made it; give --trust-pickle if you trust it")
    return _from_zip(path)


def _from_zip(path: Path) -> LearnedPolicy:
    """What ``model.save`` wrote, with the ``vecnormalize.pkl`` beside it or in the folder of its name, if there is one."""
    try:
        from stable_baselines3.common.save_util import load_from_zip_file  # pyright: ignore[reportMissingImports]
        from stable_baselines3.common.vec_env import VecNormalize  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise ValueError(f"{path} needs {error.name}: pip install 'aoro-gym[agents]'") from error
    import pickle

    if not path.is_file():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
    try:
        data, parameters, _ = load_from_zip_file(path, device="cpu")
        data = data or {}
        policy = data["policy_class"](
            data["observation_space"], data["action_space"], lambda _: 0.0, **data.get("policy_kwargs", {})
        )
        policy.load_state_dict(parameters["policy"])
    except Exception as error:  # a pickle of whoever may fail with anything
        raise ValueError(f"{path} holds no policy of Stable-Baselines3: {shortened(str(error))}") from error
    normaliser = None
    for folder in (path.parent, path.with_suffix("")):
        if (folder / "vecnormalize.pkl").exists():
            normaliser = pickle.loads((folder / "vecnormalize.pkl").read_bytes())
            if not isinstance(normaliser, VecNormalize):
                raise ValueError(f"{folder / 'vecnormalize.pkl'} is no VecNormalize")
    return of_stable_baselines3(policy, normaliser)


def of_stable_baselines3(policy: Any, normaliser: Any = None, **about: Any) -> LearnedPolicy:
    """A policy of Stable-Baselines3 (of PPO, A2C or SAC, with ``MlpPolicy``), acting without exploration.

    Args:
        policy: ``model.policy``
        normaliser: The ``VecNormalize`` that it has learned behind, if there was one.
        about: The other fields of :class:`LearnedPolicy`.

    Raises ValueError if the network is of another kind.
    """
    modules, squashed = _network(policy)
    normalisation = None
    if normaliser is not None and normaliser.norm_obs:
        moments = normaliser.obs_rms
        normalisation = Normalisation(moments.mean.copy(), moments.var.copy(), normaliser.epsilon, normaliser.clip_obs)
    return of_network(modules, policy.action_space, squashed=squashed, normalisation=normalisation, **about)


def of_network(modules: Iterable[Any], action_space: Any, *, squashed: bool = False, **about: Any) -> LearnedPolicy:
    """The policy of torch's layers, linear ones with activations between them.

    Args:
        modules: The layers, first to last.
        action_space: The box of one environment's actions.
        squashed: See :class:`LearnedPolicy`, as for ``about``, its other fields.

    Raises ValueError if the network is of another kind.
    """
    linear, activation = _layers(modules)
    return LearnedPolicy(
        weights=tuple(module.weight.detach().cpu().numpy().copy() for module in linear),
        biases=tuple(module.bias.detach().cpu().numpy().copy() for module in linear),
        activation=activation,
        squashed=squashed,
        low=action_space.low.astype(np.float32),
        high=action_space.high.astype(np.float32),
        **about,
    )


def into_stable_baselines3(learned: LearnedPolicy, policy: Any, normaliser: Any = None) -> None:
    """Give a policy of Stable-Baselines3, and the ``VecNormalize`` before it, the weights and the moments of ``learned``:
    its actor acts as that one does. Critics and the size of the exploration stay as they are.

    Raises ValueError if the networks differ.
    """
    modules, squashed = _network(policy)
    moments = None if normaliser is None or not normaliser.norm_obs else normaliser.obs_rms
    into_network(learned, modules, squashed=squashed, normalised=moments is not None)
    if moments is not None and learned.normalisation is not None:
        moments.mean, moments.var = learned.normalisation.mean.copy(), learned.normalisation.variance.copy()
        moments.count = KNOWN


def into_network(learned: LearnedPolicy, modules: Iterable[Any], *, squashed: bool = False, normalised: bool) -> None:
    """Give torch's layers, see :func:`of_network`, the weights of ``learned``.

    Args:
        learned: The policy.
        modules: The layers.
        squashed: Whether a hyperbolic tangent follows.
        normalised: Whether a normalisation of the observations, which the caller takes over, stands before them.

    Raises ValueError if the networks differ.
    """
    import torch  # pyright: ignore[reportMissingImports]

    linear, activation = _layers(modules)
    sizes = [linear[0].in_features, *(module.out_features for module in linear)]
    if (sizes, activation, squashed) != (learned.sizes, learned.activation, learned.squashed):
        raise ValueError(
            f"the policy to start from has layers {learned.sizes} with {learned.activation}, but the network to train "
            f"{sizes} with {activation}; set policy_kwargs, or train with the algorithm that it came from"
        )
    if normalised != (learned.normalisation is not None):
        raise ValueError("either both or none of the policy to start from and the training must normalise observations")
    with torch.no_grad():
        for module, weight, bias in zip(linear, learned.weights, learned.biases, strict=True):
            module.weight.copy_(torch.from_numpy(weight))
            module.bias.copy_(torch.from_numpy(bias))


def _network(policy: Any) -> tuple[list[Any], bool]:
    """The layers of the actor of a policy of Stable-Baselines3, and whether a hyperbolic tangent bounds their result.

    Raises ValueError if the policy is of another kind.
    """
    squashed = hasattr(policy, "actor")
    if squashed and hasattr(policy.actor, "latent_pi"):
        return [*policy.actor.latent_pi, policy.actor.mu], squashed
    if hasattr(policy, "mlp_extractor") and not policy.squash_output:
        return [*policy.mlp_extractor.policy_net, policy.action_net], squashed
    raise ValueError(f"{type(policy).__name__} cannot be taken over: give an MlpPolicy of PPO, A2C or SAC")


def _layers(modules: Iterable[Any]) -> tuple[list[Any], str]:
    """The linear layers among ``modules``, and the activation between them.

    Raises ValueError if there is anything else.
    """
    modules = list(modules)
    linear = [module for module in modules if type(module).__name__ == "Linear"]
    activations = {type(module).__name__.lower() for module in modules if module not in linear}
    if len(activations) > 1 or not activations <= set(ACTIVATIONS) or len(modules) != 2 * len(linear) - 1:
        raise ValueError(f"a network with {', '.join(sorted(activations))} cannot be taken over; use tanh or relu")
    return linear, next(iter(activations), "tanh")


def write_onnx(policy: LearnedPolicy, path: Path) -> None:
    """Write the policy for a vehicle's computer: one input ``observations`` (N, O), one output ``actions`` (N, A), both
    float32, normalisation and bounds included.

    Raises ValueError if onnx is missing.
    """
    try:
        import onnx  # pyright: ignore[reportMissingImports]
        from onnx import TensorProto, helper, numpy_helper  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise ValueError(f"an ONNX file needs {error.name}: pip install 'aoro-gym[onnx]'") from error
    constants: dict[str, NDArray[Any]] = {"low": policy.low, "high": policy.high}
    nodes: list[Any] = []
    value = "observations"

    def add(operator: str, *others: str, **attributes: Any) -> None:
        nonlocal value
        inputs, value = [value, *others], f"value{len(nodes)}"
        nodes.append(helper.make_node(operator, inputs, [value], **attributes))

    if policy.normalisation is not None:
        one = policy.normalisation
        constants |= {"mean": one.mean, "deviation": np.sqrt(one.variance + one.epsilon)}
        constants |= {"least": np.array(-one.clip), "most": np.array(one.clip)}
        add("Cast", to=TensorProto.DOUBLE)
        add("Sub", "mean")
        add("Div", "deviation")
        add("Clip", "least", "most")
        add("Cast", to=TensorProto.FLOAT)
    for k, (weight, bias) in enumerate(zip(policy.weights, policy.biases, strict=True)):
        constants |= {f"weight{k}": weight, f"bias{k}": bias}
        add("Gemm", f"weight{k}", f"bias{k}", transB=1)
        if k < len(policy.weights) - 1:
            add({"tanh": "Tanh", "relu": "Relu"}[policy.activation])
    if policy.squashed:
        constants |= {"half_span": 0.5 * (policy.high - policy.low), "middle": 0.5 * (policy.high + policy.low)}
        add("Tanh")
        add("Mul", "half_span")
        add("Add", "middle")
    # Clip takes scalars only, and every action has its own bounds
    add("Max", "low")
    add("Min", "high")
    nodes[-1].output[0] = "actions"
    sizes = policy.sizes
    graph = helper.make_graph(
        nodes,
        "policy",
        [helper.make_tensor_value_info("observations", TensorProto.FLOAT, ["N", sizes[0]])],
        [helper.make_tensor_value_info("actions", TensorProto.FLOAT, ["N", sizes[-1]])],
        [numpy_helper.from_array(np.ascontiguousarray(array), name) for name, array in constants.items()],
    )
    model = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", ONNX_OPSET)], ir_version=ONNX_IR, producer_name="aoro-gym"
    )
    terms = {name: [span.start, span.stop] for name, span in policy.layout.items()}
    helper.set_model_props(model, {"environment": policy.environment, "observation": json.dumps(terms)})
    onnx.checker.check_model(model, full_check=True)
    write_bytes(path, model.SerializeToString())


def _listed(layout: Mapping[str, slice]) -> str:
    return ", ".join(f"{name} ({span.stop - span.start})" for name, span in layout.items())
