"""The network that trainers of this package build: a multilayer perceptron of torch, tanh between its layers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from torch import nn  # pyright: ignore[reportMissingImports]


def perceptron(sizes: Sequence[int], last_gain: float | None = None) -> nn.Sequential:
    """Layers that take and give ``sizes`` numbers, the first what is observed.

    Args:
        sizes: Of the input, of every hidden layer, and of the output.
        last_gain: Gain of the last layer, where all are orthogonal to begin with, hidden ones of gain √2, without biases, as
            Stable-Baselines3 makes them; None leaves them as torch makes them.
    """
    layers: list[nn.Module] = []
    for k, (before, after) in enumerate(pairwise(sizes)):
        last = k == len(sizes) - 2
        linear = nn.Linear(before, after)
        if last_gain is not None:
            nn.init.orthogonal_(linear.weight, gain=last_gain if last else math.sqrt(2.0))
            nn.init.zeros_(linear.bias)
        layers += [linear] if last else [linear, nn.Tanh()]
    return nn.Sequential(*layers)
