"""The judge's statistics against closed forms and draws."""

import numpy as np
import pytest
from scipy.stats import norm

from aoro_gym.diagnosis_benchmark.judge.statistics import (
    Paths,
    explain,
    pieces,
    power,
    scatter_of_laws,
    shrunk_covariance,
    threshold,
)

SIZE = 6


def axis(place: int) -> np.ndarray:
    return np.eye(SIZE)[place]


def straight(*ends: tuple[int, int, np.ndarray]) -> Paths:
    """Paths of one piece each from (group, effect, end)."""
    return Paths(
        np.array([group for group, _, _ in ends]),
        np.array([effect for _, effect, _ in ends]),
        np.zeros((len(ends), SIZE)),
        np.array([end for _, _, end in ends]),
    )


@pytest.mark.parametrize("times", [0.5, 1.0, 1.5, 3.0])
def test_a_change_of_some_thresholds_is_seen_as_often_as_a_normal_distribution_says(times: float) -> None:
    limit, std = 4.0, 0.8
    expected = norm.sf(limit, times * limit, std) + norm.cdf(-limit, times * limit, std)
    assert power(times * limit, limit, std) == pytest.approx(expected, rel=1e-12)
    drawn = times * limit + std * np.random.default_rng(0).standard_normal(40_000)
    assert np.mean(np.abs(drawn) > limit) == pytest.approx(expected, abs=4 * np.sqrt(0.25 / 40_000))


def test_a_further_value_exceeds_the_threshold_in_one_per_cent() -> None:
    rng = np.random.default_rng(0)
    rate = np.mean([rng.standard_normal() > threshold(rng.standard_normal(99)) for _ in range(20_000)])
    assert rate == pytest.approx(0.01, abs=4 * np.sqrt(0.01 * 0.99 / 20_000))


def test_too_few_values_have_no_threshold() -> None:
    with pytest.raises(ValueError, match="needs 99 values, not 98"):
        threshold(np.zeros(98))


def test_a_covariance_of_few_samples_can_be_inverted_and_of_many_is_theirs() -> None:
    rng = np.random.default_rng(0)
    mix = rng.standard_normal((SIZE, SIZE))
    few = shrunk_covariance(rng.standard_normal((4, SIZE)) @ mix.T)
    assert np.linalg.eigvalsh(few).min() > 0.0
    many = rng.standard_normal((100_000, SIZE)) @ mix.T
    truth = mix @ mix.T
    scale = np.sqrt(np.outer(np.diag(truth), np.diag(truth)))
    # the correlation of normal values scatters by at most 1/√n, a product of two by √2 of it
    assert np.max(np.abs(shrunk_covariance(many) - truth) / scale) < 5 * np.sqrt(2 / 100_000)


def test_the_nearest_point_is_on_the_path() -> None:
    found = pieces([np.stack([axis(0), 3.0 * axis(0), 3.0 * axis(0) + axis(1)])[None, :, None]], [[0]])
    squares, shares = found.nearest(2.0 * axis(0) + axis(2))
    assert np.sqrt(squares) == pytest.approx([np.sqrt(2.0), 1.0, np.sqrt(2.0)])
    assert shares == pytest.approx([1.0, 0.5, 0.0])


def test_a_size_that_a_machine_cannot_have_is_passed_over() -> None:
    sizes = np.stack([axis(0), np.full(SIZE, np.nan), 3.0 * axis(0)])[None, :, None]
    found = pieces([sizes], [[0]])
    assert found.end.tolist() == [axis(0).tolist(), (3.0 * axis(0)).tolist()]
    assert found.start.tolist() == [np.zeros(SIZE).tolist(), axis(0).tolist()]


def test_identical_signatures_are_never_isolable() -> None:
    paths = straight((0, 0, 50.0 * axis(0)), (0, 1, 50.0 * axis(0)), (0, 2, 50.0 * axis(1)))
    for size in (0.1, 1.0, 10.0, 100.0):
        for laws in (0.0, 0.1):
            found = explain(size * axis(0), paths, np.full(SIZE, laws), ["a", "b", "c"], noisy=False)
            assert {"a", "b"} <= set(found.alike("a"))
            assert {"a", "b"} <= set(found.alike("b"))


@pytest.mark.parametrize(("laws", "isolable"), [(0.0, True), (0.1, False)])
def test_the_scatter_of_laws_takes_away_what_it_hides(laws: float, isolable: bool) -> None:
    # by another effect, 10 σ away: 50 nats; laws that err by 32 % of a length of 10 leave 50/11
    paths = straight((0, 0, 50.0 * axis(0)), (0, 1, 50.0 * axis(1)))
    found = explain(10.0 * axis(0), paths, np.full(SIZE, laws), ["a", "b"], noisy=False)
    assert found.nats["a"] - found.nats["b"] == pytest.approx(50.0 / (1.0 + 100.0 * laws))
    assert found.nats["a"] == pytest.approx(0.0)
    assert (found.alike("a", nats=5.0) == ("a",)) == isolable


def test_the_scatter_of_laws_is_that_between_families() -> None:
    rng = np.random.default_rng(0)
    tilt = 0.2
    ends = []
    for effect in range(400):
        # the second family's signature lacks a normal part along the last axis
        ends += [
            (0, effect, 30.0 * axis(0)),
            (1, effect, 30.0 * (axis(0) + tilt * rng.standard_normal() * axis(SIZE - 1))),
        ]
    found = scatter_of_laws(straight(*ends))
    # the nearest point of a tilted path is nearer: a length x (1 + t²) lacks x t at the angle of t
    tilts = np.array([end[-1] / 30.0 for _, _, end in ends[1::2]])
    angles = np.arctan(tilts)
    lacks = np.concatenate([np.sin(angles), np.sin(angles)]) ** 2
    assert np.trace(found) == pytest.approx(lacks.mean(), rel=0.03)
    assert found[-1, -1] > 0.9 * np.trace(found)


def test_no_family_beside_another_has_no_scatter() -> None:
    with pytest.raises(ValueError, match="two families"):
        scatter_of_laws(straight((0, 0, 30.0 * axis(0)), (1, 1, 30.0 * axis(1))))
