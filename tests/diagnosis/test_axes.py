"""Axes: places and magnitudes, shifts between nodes, and the least cost of a few of them, against closed forms."""

import numpy as np
import pytest

from aoro_gym.diagnosis.axes import NODES, PRIOR_INFORMATION, Axis, Shift, axes_of, volume
from aoro_gym.effects.catalogue import EFFECTS

ALL_AXES = [axis for effect in EFFECTS.values() for axis in axes_of(effect)]
FROM_END = [Axis(EFFECTS["spool_lag"], 0), Axis(EFFECTS["seal_friction"], 0)]
"""Absent at the low end of their ranges."""


@pytest.mark.parametrize("axis", ALL_AXES, ids=lambda axis: f"{axis.effect.id}-{axis.index}")
def test_places_and_magnitudes_belong_together(axis):
    places = np.linspace(0.0, 1.0, 11)
    np.testing.assert_allclose(axis.place(axis.value(places)), places, atol=1e-12)
    least = axis.magnitude.least
    assert axis.value(0.0) == pytest.approx(axis.magnitude.low if least is None else least)
    assert axis.value(1.0) == pytest.approx(axis.magnitude.high)
    assert axis.value(axis.none) == pytest.approx(axis.magnitude.none, abs=1e-12)


@pytest.mark.parametrize("axis", ALL_AXES, ids=lambda axis: f"{axis.effect.id}-{axis.index}")
def test_shifts_are_met_at_the_nodes_and_vanish_at_none(axis):
    assert np.all((axis.nodes >= min(axis.none, 0.0)) & (axis.nodes <= 1.0))
    np.testing.assert_allclose(axis.spline(axis.nodes), np.eye(len(axis.nodes)), atol=1e-12)
    np.testing.assert_allclose(axis.spline(axis.none), 0.0, atol=1e-12)


@pytest.mark.parametrize("axis", ALL_AXES, ids=lambda axis: f"{axis.effect.id}-{axis.index}")
def test_a_cubic_through_none_is_met_between_the_nodes(axis):
    fine = np.linspace(0.0, 1.0, 21)
    away = axis.nodes - axis.none
    np.testing.assert_allclose(
        axis.spline(fine) @ (away**3 - 0.2 * away), (fine - axis.none) ** 3 - 0.2 * (fine - axis.none), atol=1e-9
    )
    np.testing.assert_allclose(
        axis.spline(fine, 1) @ (away**3 - 0.2 * away), 3.0 * (fine - axis.none) ** 2 - 0.2, atol=1e-8
    )


def test_what_does_not_count_as_a_cause_lies_below_the_range():
    axis = Axis(EFFECTS["frame_compliance"], 0)
    least, most = axis.low, axis.magnitude.high
    assert axis.value(0.0) == least > axis.magnitude.none == 0.0
    assert axis.none == pytest.approx(-least / (most - least))
    np.testing.assert_allclose(axis.value(axis.nodes), np.array(NODES) * most)


def test_nodes_reach_from_none_to_both_ends():
    np.testing.assert_allclose(FROM_END[0].nodes, NODES)
    inner = next(axis for axis in ALL_AXES if 0.1 < axis.none < 0.9)
    below, above = inner.nodes[: len(NODES)], inner.nodes[len(NODES) :]
    np.testing.assert_allclose((inner.none - below[::-1]) / inner.none, NODES)
    np.testing.assert_allclose((above - inner.none) / (1.0 - inner.none), NODES)


def linear(directions, residual):
    """Cost of shifts that grow linearly along ``directions`` (samples, 2), in place of ``residual`` (samples,)."""
    columns = np.concatenate([np.outer(directions[:, k], axis.nodes) for k, axis in enumerate(FROM_END)], axis=1)
    return Shift(FROM_END, columns.T @ columns, columns.T @ residual)


def test_least_cost_of_linear_shifts_is_that_of_least_squares():
    """With shifts linear in their places, −2 φ·b + φᵀ G φ is |r − S z|² − |r|², whose least is known."""
    rng = np.random.default_rng(4)
    directions = rng.standard_normal((50, 2))
    residual = directions @ np.array([0.4, 0.7]) + 0.01 * rng.standard_normal(50)
    shift = linear(directions, residual)
    cost, found, information = shift.descend(shift.grid())
    best, square, *_ = np.linalg.lstsq(directions, residual, rcond=None)
    np.testing.assert_allclose(found, best, atol=1e-6)
    assert cost == pytest.approx(float(square[0]) - float(residual @ residual), rel=1e-9)
    np.testing.assert_allclose(information, directions.T @ directions, rtol=1e-9)


def test_a_search_ends_at_the_end_of_a_range():
    """The least lies beyond both ranges; directions at right angles keep the ends the best that is left."""
    rng = np.random.default_rng(5)
    directions, _ = np.linalg.qr(rng.standard_normal((50, 2)))
    residual = directions @ np.array([1.7, -0.4])
    cost, found, _ = linear(10.0 * directions, 10.0 * residual).descend((0.5, 0.5))
    assert found == (1.0, 0.0)
    assert cost == pytest.approx(100.0 * (0.7**2 + 0.4**2 - 1.7**2 - 0.4**2), rel=1e-9)


def test_a_search_goes_on_until_it_is_there():
    """A shift that grows with the square of its place, from the far end of the range: one step of Newton's lands at 0.64,
    Heron's rule leads on to 0.53."""
    axis = FROM_END[0]
    columns = np.outer(np.full(4, 50.0), axis.nodes**2)
    cost, (found,), _ = Shift([axis], columns.T @ columns, columns.T @ np.full(4, 50.0 * 0.53**2)).descend((1.0,))
    assert found == pytest.approx(0.53, abs=1e-3)
    assert cost == pytest.approx(-4.0 * (50.0 * 0.53**2) ** 2, abs=1e-2)


def test_a_grid_takes_every_axis_for_itself():
    """Between two steps of the grid, it is the nearer one; the other axis, at ``none``, does not count."""
    rng = np.random.default_rng(6)
    directions, _ = np.linalg.qr(rng.standard_normal((50, 2)))
    assert linear(directions, directions @ np.array([0.40 + 0.01, 0.70 - 0.01])).grid() == pytest.approx((0.4, 0.7))


def test_slopes_of_a_cost_are_its_differences():
    rng = np.random.default_rng(7)
    columns = rng.standard_normal((30, 2 * len(NODES)))
    shift = Shift(FROM_END, columns.T @ columns, columns.T @ rng.standard_normal(30))
    z, h = np.array([0.37, 0.81]), 1e-5
    _, half, _ = shift.at(z)
    differences = [(shift.at(z + e)[0] - shift.at(z - e)[0]) / (2.0 * h) for e in h * np.eye(2)]
    np.testing.assert_allclose(2.0 * half, differences, rtol=1e-5)


@pytest.mark.parametrize("information", [30.0, 3e3, 3e5])
@pytest.mark.parametrize("place", [0.0, 0.5, 1.0])
def test_volume_is_the_integral_of_a_normal_over_the_range(information, place):
    """∫₀¹ exp(−½ I (z − ẑ)²) dz; the weak pull of the prior, I + 12, is what both differ by."""
    z = np.linspace(0.0, 1.0, 200_001)
    exact = np.log(np.trapezoid(np.exp(-0.5 * (information + PRIOR_INFORMATION) * (z - place) ** 2), z))
    assert volume([place], np.array([[information]])) == pytest.approx(exact, abs=1e-4)


def test_volumes_of_axes_that_do_not_touch_multiply():
    whole = volume([0.2, 0.9], np.diag([40.0, 4e3]))
    assert whole == pytest.approx(volume([0.2], np.array([[40.0]])) + volume([0.9], np.array([[4e3]])), abs=1e-12)
    assert volume((), np.empty((0, 0))) == 0.0


def test_valleys_are_minima_of_the_profile():
    """A shift along one column whose place maps through a bent curve: two valleys, and with a second axis that does nothing,
    either of them with it or without."""
    axis = Axis(EFFECTS["spool_lag"], 0)
    wanted = (axis.fine[10], axis.fine[30])
    depth = -1.0 - 0.5 * (axis.nodes > 0.5)
    width = np.min(np.abs(axis.nodes[:, None] - wanted), axis=1)
    one = Shift([axis], np.zeros((len(axis.nodes),) * 2), -0.5 * depth * np.maximum(0.0, 1.0 - 8.0 * width))
    ways = one.valleys(5)
    profile = one._profiles[0]
    inner = [np.flatnonzero(axis.fine == z)[0] for (z,) in ways]
    assert all(profile[i] <= min(profile[max(i - 1, 0)], profile[min(i + 1, len(profile) - 1)]) for i in inner)
    assert [profile[i] for i in inner] == sorted(profile[i] for i in inner)
    assert one.grid() == ways[0]
    nodes = len(axis.nodes)
    both = Shift([axis, axis], np.zeros((2 * nodes,) * 2), np.concatenate([one.linear, np.zeros(nodes)]))
    assert (ways[0][0], axis.none) in both.valleys(50)
