"""Repeatable noise: a function of a seed and of the sample's number, not of what was asked for before.

So a thousand twins need no loop over a thousand generators, and a recording made at once agrees to the bit with one
measured sample by sample.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Seeds = NDArray[np.uint64]
Rows = NDArray[np.int64]


def draw_seeds(rngs: Sequence[np.random.Generator]) -> Seeds:
    """A seed for :func:`white` from each generator, shape (len(rngs),)."""
    return np.array([rng.integers(0, 2**63) for rng in rngs], dtype=np.uint64)


def white(seeds: Seeds, number: ArrayLike) -> NDArray[np.float64]:
    """Standard normal noise, independent from sample to sample and from seed to seed.

    Counters go through the SplitMix64 finaliser (Steele, Lea, Flood 2014) and through the Box-Muller transform.

    Args:
        seeds: One a channel, shape (N,).
        number: Number of the sample, whole, of a shape that broadcasts with (N,).
    """
    counter = np.atleast_1d(np.asarray(number)).astype(np.int64).view(np.uint64)
    first = _mixed(np.atleast_1d(seeds) ^ _mixed(counter))
    second = _mixed(first)
    radius = np.sqrt(-2.0 * np.log(_uniform(first)))
    return radius * np.cos(2.0 * np.pi * _uniform(second))


def uniform(seeds: Seeds, number: ArrayLike) -> NDArray[np.float64]:
    """Uniform numbers in (0, 1), as repeatable as :func:`white` and with the same arguments."""
    counter = np.atleast_1d(np.asarray(number)).astype(np.int64).view(np.uint64)
    return _uniform(_mixed(np.atleast_1d(seeds) ^ _mixed(counter)))


def channel(seeds: Seeds, number: int) -> Seeds:
    """Seeds (N,) for one of a sensor's channels, each independent of the others."""
    return _mixed(seeds + _mixed(np.array([number], dtype=np.uint64)))


class Drift:
    """Errors that wander: first-order Gauss-Markov, C channels of N twins.

    x(t + Δ) = a x(t) + rms √(1 − a²) w with a = exp(−Δ / time): exact for any Δ, and stationary from the start
    (Gelb 1974, Applied Optimal Estimation, ch. 2).

    Args:
        rms: Standard deviation of each channel (C,).
        time: Correlation time [s], above 0.
        rate: Samples a second [Hz].
        num_twins: N.
    """

    def __init__(self, rms: ArrayLike, *, time: float, rate: float, num_twins: int):
        self._rms = np.atleast_1d(np.asarray(rms, dtype=np.float64))[:, None]
        self._decay = float(np.exp(-1.0 / (rate * time)))
        self._seeds: Seeds = np.zeros((len(self._rms), num_twins), dtype=np.uint64)
        self._number = np.zeros(num_twins, dtype=np.int64)
        self._value = np.zeros((len(self._rms), num_twins))

    def reset(self, rows: Rows, seeds: Seeds) -> None:
        """Begin anew for the twins ``rows`` (K,), with one seed each."""
        for c in range(len(self._rms)):
            self._seeds[c, rows] = channel(seeds, c)
        self._number[rows] = 0
        self._value[:, rows] = self._rms * self._white(rows, np.full(len(rows), -1))

    def at(self, rows: Rows, number: NDArray[np.int64]) -> NDArray[np.float64]:
        """Values (C, K) of the twins ``rows`` at their samples ``number`` (K,), not before the last ones asked for."""
        decay = self._decay ** np.maximum(number - self._number[rows], 0)
        fresh = np.sqrt(1.0 - decay**2)
        value = decay * self._value[:, rows] + self._rms * fresh * self._white(rows, number)
        self._value[:, rows] = value
        self._number[rows] = np.maximum(number, self._number[rows])
        return value

    def _white(self, rows: Rows, number: NDArray[np.int64]) -> NDArray[np.float64]:
        return np.stack([white(seeds[rows], number) for seeds in self._seeds])


def chosen_rows(indices: ArrayLike | None, num_twins: int) -> Rows:
    """Rows (K,) that ``indices`` stands for: all of them for None.

    Raises ValueError if one is outside the sensor's twins or stands there twice.
    """
    if indices is None:
        return np.arange(num_twins)
    rows = np.atleast_1d(np.asarray(indices, dtype=np.int64))
    if rows.size and not (rows.min() >= 0 and rows.max() < num_twins):
        raise ValueError(f"indices reach from {rows.min()} to {rows.max()}, but must be in [0, {num_twins - 1}]")
    if len(np.unique(rows)) != len(rows):
        raise ValueError("indices name a twin twice; name each once")
    return rows


def columns(name: str, value: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """``value`` as floats of the given shape; ValueError that names it otherwise."""
    array = np.asarray(value, dtype=np.float64)
    if array.shape != shape:
        raise ValueError(f"{name} has shape {array.shape}, but must be {shape}")
    return array


def checked_generators(rngs: Sequence[np.random.Generator], rows: Rows) -> None:
    """ValueError unless there is one generator for each row."""
    if len(rngs) != len(rows):
        raise ValueError(f"{len(rngs)} generators for {len(rows)} twins; give one each")


def _mixed(bits: Seeds) -> Seeds:
    bits = bits + np.uint64(0x9E3779B97F4A7C15)
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return bits ^ (bits >> np.uint64(31))


def _uniform(bits: Seeds) -> NDArray[np.float64]:
    """In (0, 1), both ends excluded."""
    return ((bits >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52


def tick(time: ArrayLike, rate: float) -> NDArray[np.int64]:
    """Number of the sample taken at ``time`` [s] by a clock of ``rate`` [Hz], wherever between two seconds it ticks."""
    # just below one half: neither clocks on whole milliseconds nor rounded time stamps meet the edge
    return np.floor(np.asarray(time, dtype=np.float64) * rate + 0.499).astype(np.int64)


def quantised(values: NDArray[np.float64], resolution: float) -> NDArray[np.float64]:
    """``values`` rounded to whole multiples of ``resolution``; as they are for zero."""
    return np.round(values / resolution) * resolution if resolution > 0.0 else values
