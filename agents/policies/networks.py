"""Learned policies from layers of torch and policies of Stable-Baselines3, and their weights given back to them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from aoro_gym.agents.policies.policy import ACTIVATIONS, LearnedPolicy, Normalisation

KNOWN = 1e18
"""Observations that a policy to start from counts as having seen: the normalisation that its weights are made for stays."""


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
