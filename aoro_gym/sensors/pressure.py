"""Pressure sensors: a range, a zero error, white noise and a quantiser.

The machine has them on all of its cylinders; their make is not published. The figures are those of a common industrial
transmitter (engineering estimates).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.checks import check_integer, check_range
from aoro_gym.execution.array_api import HOST, Array, Arrays, Index, namespace
from aoro_gym.execution.streams import Generators, Streams, normals
from aoro_gym.sensors.chain import SAMPLE_RATE, sample
from aoro_gym.sensors.noise import (
    Seeds,
    checked_generators,
    chosen_rows,
    columns,
    draw_seeds,
    quantised,
    seeds_of,
    tick,
    white,
)
from aoro_gym.units import BAR


@dataclass(frozen=True)
class PressureNoise:
    """What a pressure sensor does to the pressure; gauge pressures."""

    low: float = -BAR  # [Pa] lowest that it shows
    high: float = 400.0 * BAR  # [Pa] highest
    zero_error: float = 0.0  # [Pa] rms over sensors, constant in a run
    white: float = 0.0  # [Pa] rms
    resolution: float = 0.0  # [Pa]; 0: none

    def __post_init__(self) -> None:
        check_range("low", self.low, "Pa", lt=self.high, note=", which is high")
        for name in ("zero_error", "white", "resolution"):
            check_range(name, getattr(self, name), "Pa", ge=0.0)

    @classmethod
    def typical(cls) -> PressureNoise:
        """E: 0 to 400 bar, 0.25 % of it zero error, 12 bits, white noise of two of them."""
        return cls(low=0.0, zero_error=BAR, white=0.2 * BAR, resolution=400.0 * BAR / 2**12)


class PressureSensor:
    """One pressure sensor, or several, on each of N twins.

    Args:
        num_twins: How many.
        noise: What they do; :meth:`PressureNoise.typical` by default.
        count: Sensors on each twin, C; None: one, whose arrays have no axis for it.
        arrays: Where they live.
    """

    def __init__(
        self,
        num_twins: int = 1,
        noise: PressureNoise | None = None,
        *,
        count: int | None = None,
        arrays: Arrays = HOST,
    ):
        check_integer("num_twins", num_twins)
        self.num_twins = num_twins
        self.noise = PressureNoise.typical() if noise is None else noise
        self._each = () if count is None else (count,)
        self._arrays = arrays
        self._zero = arrays.zeros((*self._each, num_twins))
        self._seeds: Seeds = arrays.zeros((*self._each, num_twins), arrays.xp.int64)
        self.reset(np.arange(num_twins), np.random.default_rng(0).spawn(num_twins))

    def reset(self, indices: Index, rngs: Generators) -> None:
        """Begin a new run of the twins ``indices`` (K,), with one generator each."""
        rows, k = chosen_rows(indices, self.num_twins, self._arrays)
        checked_generators(rngs, k)
        zero, seeds = self._drawn(rngs, *self._each)
        self._arrays.put(self._zero, (..., rows), zero)
        self._arrays.put(self._seeds, (..., rows), seeds)

    def measure(self, pressure: Array, time: Array, indices: Index | None = None) -> Array:
        """Measured pressure [Pa] (K,) of the true one [Pa] (K,) at ``time`` [s], scalar or (K,), on the twins
        ``indices`` (K,), all by default. Pressures are (C, K) where each twin has C sensors."""
        rows, k = chosen_rows(indices, self.num_twins, self._arrays)
        true = columns("pressure", pressure, (*self._each, k), self._arrays)
        return self._sampled(true, self._zero[..., rows], self._seeds[..., rows], self._arrays.asarray(time))

    def record(
        self, pressure: ArrayLike, time: ArrayLike, rng: np.random.Generator
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Whole logs: ticks [s] (K,) and measured pressures [Pa] (K, N), or (K,) for one log.

        ``pressure`` [Pa] is (F, N) or (F,), at ``time`` [s] (F,); every log has a sensor of its own, drawn by ``rng``.
        """
        true = np.asarray(pressure, dtype=np.float64)
        ticks, values = sample(time, true[:, None] if true.ndim == 1 else true)
        zero, seeds = self._drawn(rng.spawn(values.shape[1]))
        measured = self._sampled(values, zero[0], seeds[0], ticks[:, None])
        return ticks, measured[:, 0] if true.ndim == 1 else measured

    def _drawn(self, rngs: Generators, count: int = 1) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Zero errors [Pa] and seeds (count, K) of ``count`` sensors for each of the K generators."""
        if isinstance(rngs, Streams):
            zero, words = rngs.normals_and_words(count)
            return zero * self.noise.zero_error, seeds_of(words)
        zero, seeds = np.empty((count, len(rngs))), np.empty((count, len(rngs)), dtype=np.int64)
        for row in range(count):
            zero[row], seeds[row] = normals(rngs), draw_seeds(rngs)
        return zero * self.noise.zero_error, seeds

    def _sampled(self, value: Array, zero: Array, seeds: Seeds, time: Array) -> Array:
        noisy = value + zero + self.noise.white * white(seeds, tick(time, SAMPLE_RATE))
        return namespace(noisy).clip(quantised(noisy, self.noise.resolution), self.noise.low, self.noise.high)
