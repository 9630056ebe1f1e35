"""Repeatable noise: distribution and independence."""

import numpy as np
import pytest
from scipy.stats import kstest

from aoro_gym.sensors.noise import _mixed, _uniform, draw_seed, draw_seeds, quantised, tick, white


def test_white_noise_is_standard_normal():
    seeds = draw_seeds(np.random.default_rng(1).spawn(400))
    values = white(seeds, np.arange(500)[:, None])
    assert values.shape == (500, 400)
    # Kolmogorov-Smirnov at the 0.1 % level; 1.95/√n is its bound
    assert kstest(values.ravel(), "norm").statistic < 1.95 / np.sqrt(values.size)
    # correlations of n independent pairs: 1/√n, five of them
    for other in (values[1:, :], values[:, 1:]):
        same = values[: other.shape[0], : other.shape[1]]
        assert abs(np.corrcoef(same.ravel(), other.ravel())[0, 1]) < 5 / np.sqrt(same.size)


def test_white_noise_depends_on_seed_and_number_only():
    seeds = draw_seeds(np.random.default_rng(1).spawn(3))
    np.testing.assert_array_equal(white(seeds, np.arange(9)[:, None])[4], white(seeds, 4))
    np.testing.assert_array_equal(white(seeds[1:2], 4), white(seeds, 4)[1:2])


@pytest.mark.parametrize("kind", [np.random.PCG64, np.random.Philox, np.random.MT19937])
def test_seeds_are_whole_numbers_of_the_generator(kind):
    """Whatever draws the bits, and with other draws between."""
    one, other = (np.random.Generator(kind(5)) for _ in range(2))
    for _ in range(100):
        assert draw_seed(one) == other.integers(0, 2**63)
        assert one.standard_normal() == other.standard_normal() and one.integers(5) == other.integers(5)


def test_ticks_count_samples_wherever_the_clock_stands():
    for offset in np.arange(10) * 1e-3:
        np.testing.assert_array_equal(np.diff(tick(offset + np.arange(500) / 100.0, 100.0)), 1)


def test_quantiser():
    values = np.array([-0.26, 0.24, 0.1])
    assert quantised(values, 0.5) == pytest.approx([-0.5, 0.0, 0.0])
    assert quantised(values, 0.0) is values


def test_bits_are_those_of_splitmix64():
    # its outputs for the seed 1234567; the nth mixes the seed and n times the golden ratio, of which one is added inside
    published = [
        6457827717110365317, 3203168211198807973, 9817491932198370423, 4593380528125082431, 16408922859458223821,
    ]  # fmt: skip
    states = 1234567 + np.arange(5) * -0x61C8864680B583EB
    np.testing.assert_array_equal(_mixed(states).view(np.uint64), np.array(published, dtype=np.uint64))


def test_uniform_numbers_are_the_middles_of_equal_cells():
    first, last = _uniform(np.array([0, -1]))  # no bit set, and all of them: half a cell of 2⁻⁵² from either end
    assert (first, last) == (2.0**-53, 1.0 - 2.0**-53)
