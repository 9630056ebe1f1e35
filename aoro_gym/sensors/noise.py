"""Repeatable noise: a function of a seed and of the sample's number, not of what was asked for before.

So a thousand twins need no loop over a thousand generators, and a recording made at once agrees to the bit with one
measured sample by sample.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Seeds = NDArray[np.uint64]


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
