"""Random fields over the plane: hills, the forest floor's waves, patches of plants."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


class RandomField:
    """A random field of plane waves with amplitudes in proportion to their lengths^``roll``: mean 0, mean square 1."""

    def __init__(self, rng: np.random.Generator, count: int, shortest: float, longest: float, roll: float = 1.0):
        length = np.exp(rng.uniform(np.log(shortest), np.log(longest), count))
        direction = rng.uniform(0.0, 2.0 * np.pi, count)
        self.numbers = 2.0 * np.pi / length[:, None] * np.stack([np.cos(direction), np.sin(direction)], axis=1)
        amplitude = length**roll
        self.amplitude = amplitude * np.sqrt(2.0 / np.sum(amplitude**2))
        self.phase = rng.uniform(0.0, 2.0 * np.pi, count)

    def grid(self, x: Array, y: Array) -> Array:
        """(rows, columns) over the axes ``x`` (columns,) and ``y`` (rows,): a wave over a grid is an outer product."""
        across = self.amplitude[:, None] * np.exp(1j * (np.outer(self.numbers[:, 0], x) + self.phase[:, None]))
        return (np.exp(1j * np.outer(y, self.numbers[:, 1])) @ across).real

    def at(self, points: Array) -> Array:
        """(K,) at points (K, 2)."""
        return np.cos(points @ self.numbers.T + self.phase) @ self.amplitude
