"""Repeatable noise: a function of a seed and of the sample's number, not of what was asked for before.

So a thousand twins need no loop over a thousand generators, a recording made at once agrees to the bit with one measured
sample by sample, and a device shows what the host does, up to the rounding of logarithm and cosine.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.checks import check_range
from aoro_gym.execution.array_api import HOST, Array, Arrays, Index, namespace
from aoro_gym.execution.streams import Generators, Streams

Seeds = Array
"""int64 (N,), or (C, N) for C channels: 64 bits each. Signed, as torch calculates with no others."""


def draw_seeds(rngs: Generators) -> NDArray[np.int64]:
    """A seed for :func:`white` from each generator, shape (len(rngs),)."""
    if isinstance(rngs, Streams):
        return seeds_of(rngs.raw())
    return np.array([draw_seed(rng) for rng in rngs], dtype=np.int64)


def seeds_of(words: NDArray[np.uint64]) -> NDArray[np.int64]:
    """The seeds that :func:`draw_seed` makes of a generator's words."""
    return (words >> np.uint64(1)).astype(np.int64)


def draw_seed(rng: np.random.Generator) -> int:
    """A seed for :func:`white`: ``rng.integers(0, 2**63)``."""
    bits = rng.bit_generator
    if type(bits) is np.random.PCG64:  # its next 64 bits less the lowest, in a sixth of the time
        return bits.random_raw() >> 1
    return int(rng.integers(0, 2**63))


def white(seeds: Seeds, number: Array) -> Array:
    """Standard normal noise, independent from sample to sample and from seed to seed.

    Counters go through the SplitMix64 finaliser (Steele, Lea, Flood 2014) and through the Box-Muller transform.

    Args:
        seeds: One a channel, shape (N,) or (C, N).
        number: Number of the sample, whole, of a shape that broadcasts with the seeds'.
    """
    xp = namespace(seeds)
    first = _bits(seeds, number)
    second = _mixed(first)
    radius = xp.sqrt(-2.0 * xp.log(_uniform(first)))
    return radius * xp.cos(2.0 * np.pi * _uniform(second))


def uniform(seeds: Seeds, number: Array) -> Array:
    """Uniform numbers in (0, 1), as repeatable as :func:`white` and with the same arguments."""
    return _uniform(_bits(seeds, number))


def channel(seeds: NDArray[np.int64], number: int) -> NDArray[np.int64]:
    """Seeds (N,) for one of a sensor's channels, each independent of the others; drawn ones, on the host."""
    return channels(seeds, [number])[0]


def channels(seeds: NDArray[np.int64], numbers: Iterable[int]) -> NDArray[np.int64]:
    """Seeds (C, N) for several of them."""
    return _mixed(seeds + _mixed_numbers(tuple(numbers)))


@lru_cache(maxsize=256)
def _mixed_numbers(numbers: tuple[int, ...]) -> NDArray[np.int64]:
    return _mixed(np.array(numbers, dtype=np.int64))[:, None]


class Drift:
    """Errors that wander: first-order Gauss-Markov, C channels of N twins.

    x(t + Δ) = a x(t) + rms √(1 − a²) w with a = exp(−Δ / time): exact for any Δ, and stationary from the start
    (Gelb 1974, Applied Optimal Estimation, ch. 2).

    Args:
        rms: Standard deviation of each channel (C,).
        time: Correlation time [s] of all, or of each channel (C,), above 0.
        rate: Samples a second [Hz].
        num_twins: N.
        arrays: Where they live.
    """

    def __init__(self, rms: ArrayLike, *, time: ArrayLike, rate: float, num_twins: int, arrays: Arrays = HOST):
        spread = np.atleast_1d(np.asarray(rms, dtype=np.float64))
        count = len(spread)
        self._arrays = arrays
        self._spread = spread[:, None]
        self._rms = arrays.asarray(self._spread)
        self._damping = arrays.asarray(np.broadcast_to(-1.0 / (rate * np.asarray(time)), count)[:, None])  # a sample
        self._seeds: Seeds = arrays.zeros((count, num_twins), arrays.xp.int64)
        self._number = arrays.zeros(num_twins, arrays.xp.int64)
        self._value = arrays.zeros((count, num_twins))

    def reset(self, rows: Index, seeds: NDArray[np.int64]) -> None:
        """Begin anew for the twins ``rows`` (K,), with the seeds (C, K) of their channels, on the host."""
        self._arrays.put(self._seeds, (slice(None), rows), seeds)
        self._arrays.put(self._value, (slice(None), rows), self._spread * white(seeds, -1))
        self._arrays.put(self._number, rows, 0)

    def at(self, rows: Index, number: Array) -> Array:
        """Values (C, K) of the twins ``rows`` at their samples ``number`` (K,), not before the last ones asked for.

        A sample that was asked for before stays as it is.
        """
        xp = self._arrays.xp
        passed = xp.clip(number - self._number[rows], 0, None)
        decay = xp.exp(self._damping * passed)
        fresh = self._rms * xp.sqrt(1.0 - decay**2)
        value = decay * self._value[:, rows] + fresh * white(self._seeds[:, rows], number)
        self._value[:, rows] = value
        self._number[rows] += passed
        return value


def chosen_rows(indices: Array | None, num_twins: int, arrays: Arrays = HOST) -> tuple[Index, int]:
    """Rows that ``indices`` stands for, all of them for None, and their number K.

    Raises ValueError if one is outside the sensor's twins or stands there twice. An index that lies on a device already is
    taken as it is.
    """
    if indices is None:
        return slice(None), num_twins
    if namespace(indices) is not np:
        return indices, len(indices)  # type: ignore[arg-type]
    rows = np.atleast_1d(np.asarray(indices, dtype=np.int64))
    if len(rows) and rows[0] >= 0 and rows[-1] < num_twins and (rows[1:] > rows[:-1]).all():
        return arrays.index(rows), len(rows)
    check_range("indices", rows, ge=0, le=num_twins - 1)
    if len(np.unique(rows)) != len(rows):
        raise ValueError(f"indices name twin {np.argmax(np.bincount(rows))} twice; name each once")
    return arrays.index(rows), len(rows)


def columns(name: str, value: Array, shape: tuple[int, ...], arrays: Arrays = HOST) -> Array:
    """``value`` as floats of the given shape; ValueError that names it otherwise."""
    array = arrays.asarray(value)
    if array.shape != shape:
        raise ValueError(f"{name} has shape {tuple(array.shape)}, but must be {shape}")
    return array


def instants(time: Array, count: int, arrays: Arrays = HOST) -> Array:
    """``time``, a number or (count,), as floats (count,)."""
    return arrays.xp.broadcast_to(arrays.asarray(time), (count,))


def checked_generators(rngs: Generators, count: int) -> None:
    """ValueError unless there are ``count`` generators, one for each row."""
    if len(rngs) != count:
        raise ValueError(f"{len(rngs)} generators for {count} twins; give one each")


def _bits(seeds: Seeds, number: Array) -> Array:
    xp = namespace(number)
    counter = (
        np.atleast_1d(np.asarray(number)).astype(np.int64) if xp is np else xp.astype(number, xp.int64, copy=False)
    )
    return _mixed(seeds ^ _mixed(counter))


def _mixed(bits: Array) -> Array:
    """The SplitMix64 finaliser on int64 arrays: products wrap, and right shifts are made logical by masks."""
    bits = bits + -0x61C8864680B583EB  # 0x9E3779B97F4A7C15
    bits = (bits ^ ((bits >> 30) & (2**34 - 1))) * -0x40A7B892E31B1A47  # 0xBF58476D1CE4E5B9
    bits = (bits ^ ((bits >> 27) & (2**37 - 1))) * -0x6B2FB644ECCEEE15  # 0x94D049BB133111EB
    return bits ^ ((bits >> 31) & (2**33 - 1))


def _uniform(bits: Array) -> Array:
    """In (0, 1), both ends excluded."""
    xp = namespace(bits)
    return (xp.astype((bits >> 12) & (2**52 - 1), xp.float64) + 0.5) * 2.0**-52


def tick(time: Array, rate: float) -> Array:
    """Number of the sample taken at ``time`` [s] by a clock of ``rate`` [Hz], wherever between two seconds it ticks."""
    # just below one half: neither clocks on whole milliseconds nor rounded time stamps meet the edge
    xp = namespace(time)
    if xp is np:
        return np.floor(np.asarray(time, dtype=np.float64) * rate + 0.499).astype(np.int64)
    return xp.astype(xp.floor(time * rate + 0.499), xp.int64)


def quantised(values: Array, resolution: float) -> Array:
    """``values`` rounded to whole multiples of ``resolution``; as they are for zero."""
    return namespace(values).round(values / resolution) * resolution if resolution > 0.0 else values
