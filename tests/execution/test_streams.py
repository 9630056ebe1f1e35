"""Random numbers of many generators at once: the same to the bit as NumPy's, whatever is drawn in whatever order."""

import numpy as np

from aoro_gym.execution.streams import (
    Streams,
    all_streams,
    normals,
    read_states,
    uniforms,
    whole_numbers,
    write_states,
)


def generators(count: int) -> list[np.random.Generator]:
    return [np.random.default_rng(seed) for seed in range(count)]


def test_all_draws_are_numpys_to_the_bit():
    plain = generators(37)
    streams = Streams(read_states(plain))
    rng = np.random.default_rng(3)
    for _ in range(300):
        counts = rng.choice([1, 2, 3, 7, 1000, 2**31 + 1, 2**32 - 1], size=len(plain))  # 2³¹ + 1: half are drawn again
        shape = tuple(rng.integers(1, 12, size=rng.integers(1, 3)))
        draw = rng.integers(5)
        if draw == 0:
            np.testing.assert_array_equal(whole_numbers(streams, counts), whole_numbers(plain, counts))
        elif draw == 1:
            np.testing.assert_array_equal(uniforms(streams, *shape), uniforms(plain, *shape))
        elif draw == 2:
            np.testing.assert_array_equal(streams.raw(), [each.bit_generator.random_raw() for each in plain])
        elif draw == 3:
            np.testing.assert_array_equal(normals(streams), normals(plain))
        else:
            count = int(rng.integers(1, 50))
            numbers, words = streams.normals_and_words(count)
            for row in range(count):
                np.testing.assert_array_equal(numbers[row], normals(plain))
                np.testing.assert_array_equal(words[row], [each.bit_generator.random_raw() for each in plain])
        np.testing.assert_array_equal(streams.states[:4], read_states(plain)[:4])
    again = generators(37)
    write_states(again, streams.states)
    for one, other in zip(again, plain, strict=True):
        assert one.bit_generator.state == other.bit_generator.state


def test_a_million_normal_numbers_are_numpys():
    plain = generators(1000)
    streams = Streams(read_states(plain))
    drawn = np.stack([streams.standard_normal() for _ in range(1000)], axis=1)
    np.testing.assert_array_equal(drawn, [each.standard_normal(1000) for each in plain])
    assert np.abs(drawn).max() > 3.7  # the base layer's tail is among them


def test_more_numbers_than_a_block():
    plain = generators(3)
    np.testing.assert_array_equal(uniforms(Streams(read_states(plain)), 7, 31), uniforms(plain, 7, 31))


def test_other_bit_generators_are_told_apart():
    assert all_streams(generators(2))
    assert not all_streams([*generators(1), np.random.Generator(np.random.MT19937(0))])
    assert not all_streams([None])
