"""Minibatches of proximal policy optimisation, for which the host never waits: each is one launch on a GPU.

The objective is that of Schulman et al. 2017, https://arxiv.org/abs/1707.06347, equations 7 and 9, as Stable-Baselines3 and
skrl calculate it. A minibatch is some hundred small kernels, forth and back, which take a GPU less time than Python takes to
launch them; recorded as a CUDA graph they are launched as one.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from numpy.typing import NDArray
from torch.nn.functional import mse_loss  # pyright: ignore[reportMissingImports]
from torch.nn.utils import clip_grad_norm_  # pyright: ignore[reportMissingImports]

WARM_UPS = 3
"""Calls before one is recorded, in which libraries choose their kernels and take their memory."""


class Samples(NamedTuple):
    """A rollout's S samples, in tensors that stay where they are from rollout to rollout."""

    observations: torch.Tensor
    """(S, O)"""
    actions: torch.Tensor
    """(S, A)"""
    values: torch.Tensor
    """What the critic said when the rollout was made (S,)."""
    log_probs: torch.Tensor
    """Logarithms of the actions' densities, of then (S,)."""
    advantages: torch.Tensor
    """(S,)"""
    returns: torch.Tensor
    """What the critic should have said (S,)."""


class Figures(NamedTuple):
    """What a minibatch says of itself."""

    policy_loss: Any
    value_loss: Any
    """Mean squared error, without its weight."""
    entropy_loss: Any
    """−entropy, without its weight."""
    approx_kl: Any
    """Divergence of the policy from that of the rollout: mean of r − 1 − ln r, http://joschu.net/blog/kl-approx.html."""
    clip_fraction: Any
    """Share of samples whose ratio lies outside the clip range."""
    loss: Any
    """What is descended."""


Evaluate = Callable[[torch.Tensor, torch.Tensor], tuple[torch.Tensor, torch.Tensor, torch.Tensor]]
"""Gives values, logarithms of densities and entropies, each (B,), of observations (B, O) and actions (B, A). It draws
nothing and looks at no value."""


@dataclass(frozen=True)
class _Recording:
    """A graph, the tensors that it reads and writes, and what has to stay alive for it."""

    graph: Any
    rows: torch.Tensor
    figures: torch.Tensor
    gradients: list[torch.Tensor | None]
    samples: Samples


class Minibatches:
    """Gradients of minibatches, clipped, where an optimiser finds them.

    Args:
        evaluate: The networks.
        parameters: Theirs, all on one device.
        value_weight: Of the value's loss.
        entropy_weight: Of the entropy's.
        max_norm: Of all gradients together.
        normalised: Whether the advantages of each minibatch are normalised.
    """

    def __init__(
        self,
        evaluate: Evaluate,
        parameters: Iterable[torch.nn.Parameter],
        *,
        value_weight: float,
        entropy_weight: float,
        max_norm: float,
        normalised: bool,
    ):
        self._evaluate, self._parameters = evaluate, list(parameters)
        self._value_weight, self._entropy_weight = value_weight, entropy_weight
        self._max_norm, self._normalised = max_norm, normalised
        self._clips_values = False
        # of the ratio: half the width, least, largest; of values: least, largest change; tensors, as a graph holds numbers
        self._bounds = torch.zeros(5, device=self._parameters[0].device)
        self._recorded: dict[tuple[Any, ...], _Recording] = {}

    def clip(self, ratio: float, values: float | None) -> None:
        """Clip by these ranges from now on; values not at all if None."""
        self._clips_values = values is not None
        reach = values or 0.0
        bounds = np.array([ratio, 1.0 - ratio, 1.0 + ratio, -reach, reach], dtype=np.float32)
        self._bounds.copy_(uploaded(bounds, self._bounds.device))

    def gradients(self, samples: Samples, rows: torch.Tensor) -> torch.Tensor:
        """Set the parameters' gradients to those of the minibatch ``rows`` (B,) of ``samples``.

        Returns:
            Its :class:`Figures` as a tensor (6,), on the device.
        """
        if not rows.is_cuda:
            return self._gradients(samples, rows)
        learning = (one.requires_grad for one in self._parameters)
        key = (len(rows), self._clips_values, *learning, *(one.data_ptr() for one in samples))
        if key not in self._recorded:
            self._recorded[key] = self._record(samples, rows)
        recorded = self._recorded[key]
        recorded.rows.copy_(rows)
        recorded.graph.replay()
        for parameter, gradient in zip(self._parameters, recorded.gradients, strict=True):
            parameter.grad = gradient
        return recorded.figures.clone()

    def _record(self, samples: Samples, rows: torch.Tensor) -> _Recording:
        rows = rows.clone()
        with torch.cuda.device(rows.device):
            aside, here = torch.cuda.Stream(), torch.cuda.current_stream()
            aside.wait_stream(here)
            with warnings.catch_warnings():
                # torch looks at where gradients would be accumulated, which they are not
                warnings.filterwarnings("ignore", "The AccumulateGrad node's stream does not match")
                with torch.cuda.stream(aside):
                    for _ in range(WARM_UPS):
                        self._gradients(samples, rows)
                here.wait_stream(aside)
                graph = torch.cuda.CUDAGraph()
                with torch.cuda.graph(graph):
                    figures = self._gradients(samples, rows)
        return _Recording(graph, rows, figures, [one.grad for one in self._parameters], samples)

    def _gradients(self, samples: Samples, rows: torch.Tensor) -> torch.Tensor:
        figures = self._figures(Samples(*(one[rows] for one in samples)))
        learning = [one for one in self._parameters if one.requires_grad]
        # not backward(): what it adds to gradients is bound to the stream that first saw a parameter, and graphs have theirs
        found = dict(zip(learning, torch.autograd.grad(figures.loss, learning, allow_unused=True), strict=True))
        for parameter in self._parameters:
            parameter.grad = found.get(parameter)
        clip_grad_norm_(self._parameters, self._max_norm)
        return torch.stack([one.detach() for one in figures])

    def _figures(self, batch: Samples) -> Figures:
        width, least, largest, down, up = self._bounds.unbind()
        values, log_probs, entropies = self._evaluate(batch.observations, batch.actions)
        advantages = batch.advantages
        if self._normalised and len(advantages) > 1:
            advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        log_ratio = log_probs - batch.log_probs
        ratio = torch.exp(log_ratio)
        policy_loss = -torch.min(advantages * ratio, advantages * torch.clamp(ratio, least, largest)).mean()
        if self._clips_values:
            values = batch.values + torch.clamp(values - batch.values, down, up)
        value_loss = mse_loss(batch.returns, values)
        entropy_loss = -entropies.mean()
        with torch.no_grad():
            divergence = (ratio - 1.0 - log_ratio).mean()
            clipped = (torch.abs(ratio - 1.0) > width).float().mean()
        loss = policy_loss + self._entropy_weight * entropy_loss + self._value_weight * value_loss
        return Figures(policy_loss, value_loss, entropy_loss, divergence, clipped, loss)


def uploaded(values: NDArray[Any], device: torch.device) -> torch.Tensor:
    """``values`` on a device, not waited for: memory that is not pinned would be read when all before it is done."""
    tensor = torch.from_numpy(values)
    if device.type == "cuda":
        tensor = tensor.pin_memory()
    return tensor.to(device, non_blocking=True)
