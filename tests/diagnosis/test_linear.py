"""Tangents: the algebra of nuisances with a correlated prior, against dense matrices."""

import numpy as np
import pytest

from aoro_gym.diagnosis.linear import FAINT, Tangent

SAMPLES, COUNT = 30, 6
FREE = np.full(COUNT, 9.0)


@pytest.fixture(scope="module")
def tangent():
    rng = np.random.default_rng(0)
    root = rng.standard_normal((COUNT, COUNT))
    precision = root @ root.T + np.eye(COUNT)
    return Tangent(rng.standard_normal((SAMPLES, COUNT)), precision, (-FREE, FREE))


def dense(tangent):
    """A = I + J P⁻¹ Jᵀ (D, D)."""
    return np.eye(SAMPLES) + tangent.jacobian @ np.linalg.solve(tangent.precision, tangent.jacobian.T)


def test_projections_and_volume_are_those_of_the_whole_covariance(tangent):
    columns = np.random.default_rng(1).standard_normal((SAMPLES, 3))
    np.testing.assert_allclose(
        tangent.projected(columns, columns), columns.T @ np.linalg.solve(dense(tangent), columns)
    )
    assert tangent.shrunk == pytest.approx(-0.5 * np.linalg.slogdet(dense(tangent))[1])
    np.testing.assert_allclose(tangent.spread @ tangent.spread.T, dense(tangent) - np.eye(SAMPLES), atol=1e-10)
    np.testing.assert_allclose(
        np.linalg.inv(tangent.covariance), tangent.precision + tangent.jacobian.T @ tangent.jacobian, rtol=1e-9
    )


def test_best_nuisances_have_no_gradient_where_they_are_free(tangent):
    """And at an end of their range pull outwards."""
    residual = 5.0 * np.random.default_rng(2).standard_normal(SAMPLES)
    free = tangent.best(residual)
    low, high = -FREE.copy(), FREE.copy()
    first = int(np.argmax(np.abs(free)))
    low[first], high[first] = -0.5 * abs(free[first]), 0.5 * abs(free[first])
    held = Tangent(tangent.jacobian, tangent.precision, (low, high)).best(residual)
    gradient = tangent.precision @ held - tangent.jacobian.T @ (residual - tangent.jacobian @ held)
    assert abs(held[first]) == pytest.approx(high[first])
    assert np.sign(gradient[first]) == -np.sign(held[first])
    np.testing.assert_allclose(np.delete(gradient, first), 0.0, atol=1e-9)


def test_an_update_takes_in_the_secants_and_leaves_the_rest(tangent):
    """Along the moves the slopes are those seen; along what is independent of them by the prior, those from before."""
    rng = np.random.default_rng(3)
    moves, changes = rng.standard_normal((2, COUNT)), rng.standard_normal((SAMPLES, 2))
    updated = tangent.updated(moves, changes)
    np.testing.assert_allclose(updated.jacobian @ moves.T, changes, atol=1e-10)
    other = rng.standard_normal(COUNT)
    other -= moves.T @ np.linalg.solve(moves @ tangent.precision @ moves.T, moves @ tangent.precision @ other)
    np.testing.assert_allclose(updated.jacobian @ other, tangent.jacobian @ other, atol=1e-10)
    twice = tangent.updated(np.vstack([moves, moves[:1]]), np.column_stack([changes, changes[:, :1]]))
    np.testing.assert_allclose(twice.jacobian, updated.jacobian, atol=1e-9)
    np.testing.assert_allclose(tangent.updated(np.eye(COUNT), changes[:, :1] * FREE).jacobian, changes[:, :1] * FREE)


@pytest.mark.parametrize("updates", [0, 1, 2, 4])
def test_tangents_that_follow_from_one_another_are_those_of_their_whole_matrix(tangent, updates):
    """Two secants an update, so that what is their own grows beyond what they share."""
    rng = np.random.default_rng(7)
    for _ in range(updates):
        tangent = tangent.updated(rng.standard_normal((2, COUNT)), rng.standard_normal((SAMPLES, 2)))
    ends = np.full(COUNT, -0.1), np.full(COUNT, 0.1)
    both = Tangent(tangent.jacobian, tangent.precision, ends).updated(np.eye(COUNT)[:1], np.ones((SAMPLES, 1)))
    both = both.beside(rng.standard_normal((SAMPLES, 3)), 0.5, (np.full(3, -0.2), np.full(3, 0.2)), 2.0)
    for one in (tangent, both):
        whole = Tangent(one.jacobian, one.precision, one.bounds, one.stiffness)
        residual, moves = rng.standard_normal((SAMPLES, 2)), rng.standard_normal((len(one.precision), 2))
        np.testing.assert_allclose(one.moved(moves), one.jacobian @ moves, atol=1e-12)
        np.testing.assert_allclose(one.pull(residual[:, 0]), one.jacobian.T @ residual[:, 0], atol=1e-12)
        np.testing.assert_allclose(one.sizes, np.linalg.norm(one.jacobian, axis=0))
        np.testing.assert_allclose(one.projected(residual, residual), whole.projected(residual, residual))
        for found, expected in zip(
            *(t.steps(residual[:, 0], (0.0, 3.0), moves[:, 0]) for t in (one, whole)), strict=True
        ):
            np.testing.assert_allclose(found, expected, atol=1e-12)


def test_what_an_update_takes_away_has_no_length(tangent):
    """Not the root of what rounding leaves of a large square."""
    large = Tangent(1e6 * tangent.jacobian, tangent.precision, tangent.bounds)
    still = large.updated(np.eye(COUNT), np.zeros((SAMPLES, COUNT)))
    np.testing.assert_allclose(still.sizes, 0.0, atol=1e-1)


def test_slopes_that_rounding_makes_contradict_themselves_are_multiplied_anew(tangent):
    """Squares of slopes that were carried through updates are those of no slopes any more where less than nothing is left of
    a direction: the best nuisances are those of the slopes themselves."""
    jacobian = tangent.jacobian.copy()
    jacobian[:, 0] = jacobian[:, 1]
    loose = tangent.precision * 1e-3
    exact = Tangent(jacobian, loose, (-FREE, FREE))
    apart = np.eye(COUNT)[0] - np.eye(COUNT)[1]
    rounded = Tangent(jacobian, loose, (-FREE, FREE), inner=jacobian.T @ jacobian - np.outer(apart, apart))
    assert np.linalg.eigvalsh(loose + jacobian.T @ jacobian - np.outer(apart, apart))[0] < 0.0
    residual = np.random.default_rng(1).standard_normal(SAMPLES)
    np.testing.assert_allclose(rounded.best(residual), exact.best(residual), rtol=1e-6)
    np.testing.assert_allclose(rounded.covariance, exact.covariance, rtol=1e-6)


def test_directions_are_independent_standard_deviations_that_show_most(tangent):
    directions, sizes = tangent.directions(4, 3)
    np.testing.assert_allclose(
        directions[:, :4] @ tangent.precision[:4, :4] @ directions[:, :4].T, np.eye(len(sizes)), atol=1e-10
    )
    assert not np.any(directions[:, 4:])
    np.testing.assert_allclose(np.linalg.norm(tangent.jacobian @ directions.T, axis=0), sizes)
    assert np.all(np.diff(sizes) <= 0.0)
    root = np.linalg.cholesky(np.linalg.inv(tangent.precision[:4, :4]))
    exact = np.linalg.svd(tangent.jacobian[:, :4] @ root, compute_uv=False)
    np.testing.assert_allclose(sizes, exact[exact**2 > FAINT][:3])


def test_what_hardly_moves_the_prediction_is_no_direction():
    lengths = np.sqrt(FAINT) * np.array([0.9, 20.0, 1.1, 3.0])
    wide = np.full(4, np.inf)
    directions, sizes = Tangent(np.diag(lengths), np.eye(4), (-wide, wide)).directions(4, 10)
    np.testing.assert_allclose(sizes, lengths[[1, 3, 2]])
    np.testing.assert_allclose(np.abs(directions), np.eye(4)[[1, 3, 2]], atol=1e-12)


def test_unknowns_beside_the_nuisances_have_a_prior_of_their_own(tangent):
    slopes = np.random.default_rng(4).standard_normal((SAMPLES, 2))
    both = tangent.beside(slopes, 12.0)
    np.testing.assert_allclose(
        both.spread @ both.spread.T, tangent.spread @ tangent.spread.T + slopes @ slopes.T / 12.0
    )
    assert len(both.best(np.ones(SAMPLES))) == COUNT + 2
