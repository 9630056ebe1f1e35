"""Random numbers of many generators at once: NumPy's PCG64, with the states of all of them in arrays.

A call of a generator takes about a microsecond whatever it draws, and an episode takes dozens of calls. Here one call draws
for K generators, to the bit what each of them gives (NumPy's ``Generator.random``, ``integers``, ``standard_normal``).

PCG64 (O'Neill 2014, HMC-CS-2014-0905, member XSL-RR 128/64) goes from state to state by s ← a s + c modulo 2¹²⁸, with an
own c for each stream; k states further it is aᵏ s + (1 + a + … + aᵏ⁻¹) c, so that a block of them is calculated at once. A
state gives 64 bits: its halves, exclusive or, turned right by its highest six bits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

Words = NDArray[np.uint64]
MULTIPLIER = 0x2360ED051FC65DA44385DF649FCCF645
"""a of NumPy's PCG64."""
BLOCK = 64
"""States that are calculated at once."""
_HALF, _LOW = np.uint64(32), np.uint64(0xFFFFFFFF)
_ALL = 2**128 - 1


class Streams:
    """K generators.

    Args:
        states: Words (6, K): the state's high and low half, those of c, whether half of a word is left of the last 32 bits
            that were drawn, and that half.
    """

    def __init__(self, states: Words):
        self._states = states.copy()
        self._each = np.arange(states.shape[1])
        self._fill(BLOCK)

    def __len__(self) -> int:
        return len(self._each)

    @property
    def states(self) -> Words:
        """As now, see the class."""
        out = self._states.copy()
        out[:2] = self._block[:, self._at, self._each]
        return out

    def random(self, shape: tuple[int, ...]) -> NDArray[np.float64]:
        """What ``generator.random(shape)`` gives of each, (K, *shape)."""
        bits = self._words(math.prod(shape)) >> np.uint64(11)
        return (bits.astype(np.float64) * 2.0**-53).reshape(len(self), *shape)

    def raw(self) -> Words:
        """What ``generator.bit_generator.random_raw()`` gives of each (K,)."""
        return self._words(1)[:, 0]

    def below(self, counts: NDArray[np.integer]) -> NDArray[np.intp]:
        """What ``generator.integers(count)`` gives of each for its ``count`` (K,), in [1, 2³²).

        Lemire's way (2019, ACM TOMACS 29.1): the high half of a product of 32 bits with the count, drawn again where the low
        half is less than 2³² modulo it; 32 bits are half a word, the low one first.
        """
        out, left = np.zeros(len(self), dtype=np.intp), np.flatnonzero(counts > 1)
        while len(left):
            count = counts[left].astype(np.uint64)
            product = self._half_words(left) * count
            right = (product & _LOW) >= np.uint64(2**32) % count
            out[left[right]] = product[right] >> _HALF
            left = left[~right]
        return out

    def standard_normal(self) -> NDArray[np.float64]:
        """What ``generator.standard_normal()`` gives of each (K,).

        Ziggurat (Marsaglia, Tsang 2000): 8 bits name a layer, one the sign, 52 are the place in it; but for one of eighty
        draws that is inside the density, which is all that is calculated here. Others are left to NumPy.
        """
        out, outside = _normal_numbers(self.raw())
        self._at[outside] -= 1
        out[outside] = self._by_numpy(np.flatnonzero(outside), np.random.Generator.standard_normal)
        return out

    def normals_and_words(self, count: int) -> tuple[NDArray[np.float64], Words]:
        """What ``count`` times :meth:`standard_normal` and then :meth:`raw` give, both (count, K)."""
        bits = self._words(2 * count)
        (numbers, outside), words = _normal_numbers(bits[:, ::2]), bits[:, 1::2]
        alone = outside.any(axis=1)
        self._at[alone] -= 2 * count
        which = np.flatnonzero(alone)
        for i, drawn in zip(which, self._by_numpy(which, partial(_alternating, count=count)), strict=True):
            numbers[i], words[i] = drawn
        return numbers.T, words.T

    def _by_numpy(self, which: NDArray[np.intp], draw: Callable[[np.random.Generator], Any]) -> list[Any]:
        """What ``draw`` gives with each of the streams ``which`` (M,), of whose words it takes none by halves."""
        generator, now = _spare(), np.concatenate([self._block[:, self._at[which], which], self._states[2:, which]])
        bits: Any = generator.bit_generator
        drawn, states = [], []
        for words in now.T.tolist():
            bits.state = _told(*words)
            drawn.append(draw(generator))
            states.append(bits.state["state"]["state"])
        then = np.array([[state >> 64 for state in states], [state & 2**64 - 1 for state in states]], dtype=np.uint64)
        there = (self._block[:, :, which] == then[:, None]).all(axis=0)
        self._at[which] = there.argmax(axis=0)
        if not there.any(axis=0).all():  # some are beyond the block
            states = self.states
            states[:2, which] = then
            self._states = states
            self._fill(BLOCK)
        return drawn

    def _half_words(self, which: NDArray[np.intp]) -> Words:
        """32 bits of the streams ``which`` (M,)."""
        left, half = self._states[4, which] != 0, self._states[5, which]
        self._need(1)
        ahead = which[~left]
        self._at[ahead] += 1
        words = self._outputs[self._at[ahead] - 1, ahead]
        half[~left] = words & _LOW
        self._states[4, which], self._states[5, ahead] = ~left, words >> _HALF
        return half

    def _words(self, count: int) -> Words:
        """The next words (K, count)."""
        self._need(count)
        out = self._outputs[self._at[:, None] + np.arange(count), self._each[:, None]]
        self._at += count
        return out

    def _need(self, count: int) -> None:
        if self._at.max(initial=0) + count > len(self._outputs):
            self._states = self.states
            self._fill(max(count, BLOCK))

    def _fill(self, count: int) -> None:
        """Calculate ``count`` states from that of now on."""
        powers, sums = _ahead(count)
        high, low, inc_high, inc_low = self._states[:4]
        further = _sum(_product(powers, (high, low)), _product(sums, (inc_high, inc_low)))
        self._block = np.stack(
            [np.concatenate([now[None], then]) for now, then in zip((high, low), further, strict=True)]
        )
        high, low = further
        turn, bits = high >> np.uint64(58), high ^ low
        self._outputs = (bits >> turn) | (bits << (-turn & np.uint64(63)))
        self._at = np.zeros(len(self._each), dtype=np.intp)


def all_streams(generators: Sequence[Any]) -> bool:
    """Whether :class:`Streams` knows their kind."""
    return all(type(each) is np.random.Generator and type(each.bit_generator) is np.random.PCG64 for each in generators)


def read_states(generators: Sequence[np.random.Generator]) -> Words:
    """Words (6, K) as :class:`Streams` takes them."""
    out = np.empty((6, len(generators)), dtype=np.uint64)
    for column, generator in enumerate(generators):
        told: Any = generator.bit_generator.state
        state, step = told["state"]["state"], told["state"]["inc"]
        out[:, column] = (
            state >> 64,
            state & 2**64 - 1,
            step >> 64,
            step & 2**64 - 1,
            told["has_uint32"],
            told["uinteger"],
        )
    return out


def write_states(generators: Sequence[np.random.Generator], states: Words) -> None:
    """Give ``generators`` the ``states`` (6, K)."""
    for generator, words in zip(generators, states.T.tolist(), strict=True):
        generator.bit_generator.state = _told(*words)


def _told(high: int, low: int, step_high: int, step_low: int, left: int, half: int) -> dict[str, Any]:
    """One of those states as NumPy takes it."""
    return {
        "bit_generator": "PCG64",
        "state": {"state": high << 64 | low, "inc": step_high << 64 | step_low},
        "has_uint32": left,
        "uinteger": half,
    }


Generators = Streams | Sequence[np.random.Generator]
"""What draws for K: one after the other, or all at once."""


def uniforms(generators: Generators, *shape: int) -> NDArray[np.float64]:
    """Uniform numbers in [0, 1), (K, *shape): ``generator.random(shape)`` of each."""
    if isinstance(generators, Streams):
        return generators.random(shape)
    return np.stack([each.random(shape) for each in generators])


def whole_numbers(generators: Generators, counts: NDArray[np.integer]) -> NDArray[np.intp]:
    """Whole numbers less than ``counts`` (K,), each at least 1: ``generator.integers(count)``, nothing drawn for 1."""
    if isinstance(generators, Streams):
        return generators.below(counts)
    drawn = [int(each.integers(count)) if count > 1 else 0 for each, count in zip(generators, counts, strict=True)]
    return np.array(drawn, dtype=np.intp)


def normals(generators: Generators) -> NDArray[np.float64]:
    """Standard normal numbers (K,): ``generator.standard_normal()``."""
    if isinstance(generators, Streams):
        return generators.standard_normal()
    return np.array([each.standard_normal() for each in generators])


def _normal_numbers(bits: Words) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Standard normal numbers of words of 64 bits, and which of them may be outside of their layers."""
    widths, inside = _layers()
    layer, place = bits & np.uint64(0xFF), (bits >> np.uint64(9)) & np.uint64(2**52 - 1)
    return place * widths[layer] * np.where(bits & np.uint64(0x100), -1.0, 1.0), place >= inside[layer]


def _alternating(generator: np.random.Generator, count: int) -> tuple[tuple[float, ...], tuple[int, ...]]:
    """``count`` normal numbers, and a word after each."""
    pairs = [(generator.standard_normal(), generator.bit_generator.random_raw()) for _ in range(count)]
    numbers, words = zip(*pairs, strict=True)
    return numbers, words


def _product(a: tuple[Words, Words], b: tuple[Words, Words]) -> tuple[Words, Words]:
    """Of numbers of 128 bits, modulo 2¹²⁸."""
    (a_high, a_low), (b_high, b_low) = a, b
    a1, a0, b1, b0 = a_low >> _HALF, a_low & _LOW, b_low >> _HALF, b_low & _LOW
    middle = a1 * b0 + (a0 * b0 >> _HALF)
    other = a0 * b1 + (middle & _LOW)
    return a1 * b1 + (middle >> _HALF) + (other >> _HALF) + a_high * b_low + a_low * b_high, a_low * b_low


def _sum(a: tuple[Words, Words], b: tuple[Words, Words]) -> tuple[Words, Words]:
    low = a[1] + b[1]
    return a[0] + b[0] + (low < a[1]), low


@cache
def _spare() -> np.random.Generator:
    """One that is given a state before it draws."""
    return np.random.Generator(np.random.PCG64(0))


@cache
def _ahead(count: int) -> tuple[tuple[Words, Words], tuple[Words, Words]]:
    """aᵏ and 1 + a + … + aᵏ⁻¹ for k of 1 … ``count``, each high and low (count, 1)."""
    powers, sums, power, total = [], [], 1, 0
    for _ in range(count):
        total = (total + power) & _ALL
        power = power * MULTIPLIER & _ALL
        powers.append(power)
        sums.append(total)
    power_words, sum_words = (
        tuple(np.array([[each >> shift & 2**64 - 1] for each in numbers], dtype=np.uint64) for shift in (64, 0))
        for numbers in (powers, sums)
    )
    return power_words, sum_words  # pyright: ignore[reportReturnType]


@cache
def _layers() -> tuple[NDArray[np.float64], Words]:
    """Of the 256 layers of NumPy's ziggurat the widths, over 2⁵², and the least place (of 2⁵²) that may be outside the one
    above it.

    A place of 1 gives the width itself: NumPy is asked for it with a state that gives these bits. That of a layer is inside
    where it is less than the width of the next narrower one; the base, layer 0, ends with the widest of the others. A place
    less than that by rounding is left to NumPy as well.
    """
    generator, inverse = _spare(), pow(MULTIPLIER, -1, 2**128)
    widths = np.empty(256)
    for layer in range(256):
        bits = 1 << 9 | layer  # of a state whose high half is 0 they are the low one
        state = np.array([[0], [0], [0], [1], [0], [0]], dtype=np.uint64)
        before = (bits - 1) * inverse & _ALL
        state[:2, 0] = before >> 64, before & 2**64 - 1
        write_states([generator], state)
        widths[layer] = generator.standard_normal()
    narrower = np.concatenate([widths[-1:], [0.0], widths[1:-1]])
    return widths, np.maximum(narrower / widths * 2.0**52 * (1.0 - 1e-12), 0.0).astype(np.uint64)
