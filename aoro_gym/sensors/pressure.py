"""Pressure sensors: a range, a zero error, white noise and a quantiser.

The machine has them on all of its cylinders; their make is not published. The figures are those of a common industrial
transmitter (engineering estimates).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.sensors.chain import SAMPLE_RATE, sample
from aoro_gym.sensors.noise import (
    Seeds,
    checked_generators,
    chosen_rows,
    columns,
    draw_seeds,
    quantised,
    tick,
    white,
)


@dataclass(frozen=True)
class PressureNoise:
    """What a pressure sensor does to the pressure; gauge pressures."""

    low: float = -1e5  # [Pa] lowest that it shows
    high: float = 400e5  # [Pa] highest
    zero_error: float = 0.0  # [Pa] rms over sensors, constant in a run
    white: float = 0.0  # [Pa] rms
    resolution: float = 0.0  # [Pa]; 0: none

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise ValueError(f"low = {self.low:g} Pa must be below high = {self.high:g} Pa")
        if not (self.zero_error >= 0.0 and self.white >= 0.0 and self.resolution >= 0.0):
            raise ValueError(f"{self}: zero_error, white and resolution must be at least 0 Pa")

    @classmethod
    def typical(cls) -> PressureNoise:
        """E: 0 to 400 bar, 0.25 % of it zero error, 12 bits, white noise of two of them."""
        return cls(low=0.0, zero_error=1e5, white=0.2e5, resolution=400e5 / 2**12)


class PressureSensor:
    """One pressure sensor on each of N twins.

    Args:
        num_twins: How many.
        noise: What they do; :meth:`PressureNoise.typical` by default.
    """

    def __init__(self, num_twins: int = 1, noise: PressureNoise | None = None):
        if num_twins < 1:
            raise ValueError(f"num_twins is {num_twins}, but must be at least 1")
        self.num_twins = num_twins
        self.noise = PressureNoise.typical() if noise is None else noise
        self._zero = np.zeros(num_twins)
        self._seeds: Seeds = np.zeros(num_twins, dtype=np.uint64)
        self.reset(np.arange(num_twins), np.random.default_rng(0).spawn(num_twins))

    def reset(self, indices: ArrayLike, rngs: Sequence[np.random.Generator]) -> None:
        """Begin a new run of the twins ``indices`` (K,), with one generator each."""
        chosen = chosen_rows(indices, self.num_twins)
        checked_generators(rngs, chosen)
        self._zero[chosen], self._seeds[chosen] = self._drawn(rngs)

    def measure(self, pressure: ArrayLike, time: ArrayLike, indices: ArrayLike | None = None) -> NDArray[np.float64]:
        """Measured pressure [Pa] (K,) of the true one [Pa] (K,) at ``time`` [s], scalar or (K,), on the twins
        ``indices`` (K,), all by default."""
        rows = chosen_rows(indices, self.num_twins)
        return self._sampled(columns("pressure", pressure, rows.shape), self._zero[rows], self._seeds[rows], time)

    def record(
        self, pressure: ArrayLike, time: ArrayLike, rng: np.random.Generator
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Whole logs: ticks [s] (K,) and measured pressures [Pa] (K, N), or (K,) for one log.

        ``pressure`` [Pa] is (F, N) or (F,), at ``time`` [s] (F,); every log has a sensor of its own, drawn by ``rng``.
        """
        true = np.asarray(pressure, dtype=np.float64)
        ticks, values = sample(time, true[:, None] if true.ndim == 1 else true)
        measured = self._sampled(values, *self._drawn(rng.spawn(values.shape[1])), ticks[:, None])
        return ticks, measured[:, 0] if true.ndim == 1 else measured

    def _drawn(self, rngs: Sequence[np.random.Generator]) -> tuple[NDArray[np.float64], Seeds]:
        zero = np.array([rng.standard_normal() for rng in rngs]) * self.noise.zero_error
        return zero, draw_seeds(rngs)

    def _sampled(
        self, value: NDArray[np.float64], zero: NDArray[np.float64], seeds: Seeds, time: ArrayLike
    ) -> NDArray[np.float64]:
        noisy = value + zero + self.noise.white * white(seeds, tick(time, SAMPLE_RATE))
        return np.clip(quantised(noisy, self.noise.resolution), self.noise.low, self.noise.high)
