"""Repeatable noise: :mod:`aoro_gym.sensors.noise` for one twin."""

import math

import numpy as np
import warp as wp

from aoro_gym.execution.array_api import Arrays
from aoro_gym.sensors import chain
from aoro_gym.sensors import noise as sensors

TAU = wp.constant(wp.float64(2.0 * math.pi))
GOLDEN = wp.constant(wp.uint64(0x9E3779B97F4A7C15))
FIRST_FACTOR = wp.constant(wp.uint64(0xBF58476D1CE4E5B9))
SECOND_FACTOR = wp.constant(wp.uint64(0x94D049BB133111EB))
UNIT = wp.constant(wp.float64(2.0**-52))
SAMPLE_RATE = wp.constant(wp.float64(chain.SAMPLE_RATE))


@wp.func
def mixed(bits: wp.uint64):
    """The SplitMix64 finaliser."""
    out = bits + GOLDEN
    out = (out ^ (out >> wp.uint64(30))) * FIRST_FACTOR
    out = (out ^ (out >> wp.uint64(27))) * SECOND_FACTOR
    return out ^ (out >> wp.uint64(31))


@wp.func
def bits_of(seed: wp.int64, number: wp.int64):
    """64 bits of a sample."""
    return mixed(wp.uint64(seed) ^ mixed(wp.uint64(number)))


@wp.func
def uniform_of(bits: wp.uint64):
    """In (0, 1), both ends excluded."""
    return (wp.float64(bits >> wp.uint64(12)) + wp.float64(0.5)) * UNIT


@wp.func
def uniform(seed: wp.int64, number: wp.int64):
    """A uniform number in (0, 1)."""
    return uniform_of(bits_of(seed, number))


@wp.func
def white(seed: wp.int64, number: wp.int64):
    """A standard normal number."""
    first = bits_of(seed, number)
    radius = wp.sqrt(wp.float64(-2.0) * wp.log(uniform_of(first)))
    return radius * wp.cos(TAU * uniform_of(mixed(first)))


@wp.func
def tick(time: wp.float64):
    """Number of the sample at ``time`` [s] of a clock of 100 Hz."""
    return wp.int64(wp.floor(time * SAMPLE_RATE + wp.float64(0.499)))


@wp.func
def quantised(value: wp.float64, resolution: wp.float64):
    """Rounded to whole multiples, half to even; as it is for zero."""
    if resolution > wp.float64(0.0):
        return wp.rint(value / resolution) * resolution
    return value


@wp.struct
class DriftMemory:
    """Errors that wander, C channels of N twins."""

    rms: wp.array(dtype=wp.float64)  # (C,)
    damping: wp.array(dtype=wp.float64)  # (C,) a sample
    seeds: wp.array2d(dtype=wp.int64)  # (C, N)
    number: wp.array(dtype=wp.int64)  # (N,) last sample
    value: wp.array2d(dtype=wp.float64)  # (C, N)


def drift_memory(drift: sensors.Drift, arrays: Arrays) -> DriftMemory:
    """The memory of ``drift``, shared."""
    out = DriftMemory()
    out.rms, out.damping = (constants(arrays, arrays.host(each)) for each in (drift._rms, drift._damping))
    out.seeds, out.number, out.value = (arrays.shared(each) for each in (drift._seeds, drift._number, drift._value))
    return out


def constants(arrays: Arrays, values: object) -> wp.array:
    """Numbers as float64 (C,) beside the twins."""
    return wp.array(np.array(values, dtype=np.float64).ravel(), dtype=wp.float64, device=str(arrays.device))


@wp.func
def drifted(d: DriftMemory, i: int, number: wp.int64):
    """Move all channels of twin ``i`` on to its sample ``number``, not before the last one."""
    passed = number - d.number[i]
    if passed > wp.int64(0):
        for c in range(d.rms.shape[0]):
            decay = wp.exp(d.damping[c] * wp.float64(passed))
            fresh = d.rms[c] * wp.sqrt(wp.float64(1.0) - decay * decay)
            d.value[c, i] = decay * d.value[c, i] + fresh * white(d.seeds[c, i], number)
        d.number[i] = number
