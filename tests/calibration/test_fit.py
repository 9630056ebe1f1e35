"""The search itself, on functions whose answers are known."""

import json

import numpy as np
import pytest

from aoro_gym.calibration.ensemble import draw_ensemble, farthest_apart, posterior_factor
from aoro_gym.calibration.fit import FAILED, least_squares_fit
from aoro_gym.calibration.procedure import crossing
from aoro_gym.calibration.space import Space
from aoro_gym.machine import Machine

KEYS = ("steering.valve.spool_time_constant", "steering.pump.margin", "joint.friction_torque")


@pytest.fixture(scope="module")
def space():
    return Space(Machine.load("aoro_datasheet"), KEYS)


def test_the_cube_is_the_ranges(space):
    entries = space.machine.entries
    low, high = space.values(np.zeros(3)), space.values(np.ones(3))
    np.testing.assert_allclose(low, [entries[k].range[0] for k in KEYS], rtol=1e-12)
    np.testing.assert_allclose(high, [entries[k].range[1] for k in KEYS], rtol=1e-12)
    # a wide range is searched on a logarithmic scale, a narrow one on a linear one
    middle = space.values(np.full(3, 0.5))
    assert middle[0] == pytest.approx(np.sqrt(low[0] * high[0]))
    assert middle[1] == pytest.approx(0.5 * (low[1] + high[1]))
    np.testing.assert_allclose(space.values(space.point()), [entries[k].value for k in KEYS], rtol=1e-12)


def test_population_has_one_variant_a_point(space):
    points = np.array([[0.1, 0.2, 0.3], [0.9, 0.8, 0.7]])
    machine = space.population(points)
    assert machine.num_variants == 2
    np.testing.assert_allclose(machine.entries["steering.pump.margin"].value, space.values(points)[:, 1])
    assert space.population(points[0]).num_variants == 1


def test_leaning_names_key_and_end(space):
    assert space.at_bounds([0.0, 0.5, 0.999]) == [(KEYS[0], "low"), (KEYS[2], "high")]


def test_unknown_keys_are_named():
    with pytest.raises(ValueError, match=r"'steering\.valve\.colour' is no parameter"):
        Space(Machine.load("aoro_datasheet"), ["steering.valve.colour"])


def curved(points):
    """Residuals (3, N) with their root at (0.3, 0.8); the second branch of the square is far outside the cube."""
    x, y = points[:, 0], points[:, 1]
    return 100.0 * np.array([x + 0.2 * x**2 - 0.318, y - 0.8 + 0.1 * (x - 0.3), (x - 0.3) * (y - 0.8)])


def test_least_squares_finds_the_root(tmp_path):
    fits = least_squares_fit(
        curved, np.array([0.6, 0.4]), prior_weight=1e-3, starts=2, population=16, checkpoint=tmp_path / "c.json"
    )
    # the pull to the prior moves the root by weight² · 4² · 0.5 / 100² at most; the convergence bound is 1e-4 of a step
    np.testing.assert_allclose(fits[0].point, [0.3, 0.8], atol=1e-4)
    assert fits[0].cost <= fits[1].cost


def test_failed_figures_count_but_do_not_stop_the_search():
    def partly(points):
        found = curved(points)
        found[:, points[:, 0] > 0.7] = np.nan
        return found

    fits = least_squares_fit(partly, np.array([0.95, 0.4]), prior_weight=1e-3, starts=3, population=32)
    np.testing.assert_allclose(fits[0].point, [0.3, 0.8], atol=1e-4)
    assert max(np.abs(fit.residuals).max() for fit in fits) <= FAILED


def test_a_checkpoint_of_another_search_is_not_used(tmp_path):
    path = tmp_path / "c.json"
    first = least_squares_fit(
        curved, np.array([0.6, 0.4]), prior_weight=1e-3, starts=1, population=16, seed=0, checkpoint=path
    )
    kept = json.loads(path.read_text())
    kept["fits"][0]["cost"] = -1.0
    path.write_text(json.dumps(kept))
    arguments = {"prior_weight": 1e-3, "starts": 1, "population": 16, "checkpoint": path}
    assert least_squares_fit(curved, np.array([0.6, 0.4]), seed=0, **arguments)[0].cost == -1.0
    assert least_squares_fit(curved, np.array([0.6, 0.4]), seed=1, **arguments)[0].cost == pytest.approx(first[0].cost)


@pytest.mark.parametrize("stop", [1, 2, 3, 6, 9])
def test_a_search_that_was_ended_anywhere_finds_the_same(tmp_path, stop):
    arguments = {"prior_weight": 1e-3, "starts": 2, "population": 128}
    whole = least_squares_fit(curved, np.array([0.6, 0.4]), **arguments)
    calls = []

    def interrupted(points):
        calls.append(len(points))
        if len(calls) == stop:
            raise KeyboardInterrupt
        return curved(points)

    path = tmp_path / "c.json"
    with pytest.raises(KeyboardInterrupt):
        least_squares_fit(interrupted, np.array([0.6, 0.4]), checkpoint=path, **arguments)
    before = len(calls)
    assert least_squares_fit(interrupted, np.array([0.6, 0.4]), checkpoint=path, **arguments) == whole
    alone = []
    least_squares_fit(lambda points: (alone.append(1), curved(points))[1], np.array([0.6, 0.4]), **arguments)
    # what was kept is not computed again: two evaluations are a step, which is kept whole
    assert len(calls) - before <= len(alone) - (before - 1) + 1


@pytest.mark.parametrize(
    "change",
    [
        lambda kept: kept | {"fits": 3},
        lambda kept: kept | {"costs": [["a"]]},
        lambda kept: kept | {"step": {"iteration": 1}},
        lambda kept: {"signature": kept["signature"]},
        lambda kept: kept | {"fits": [{"point": [None]}]},
    ],
)
def test_a_damaged_checkpoint_is_named(tmp_path, change):
    path = tmp_path / "c.json"
    arguments = {"prior_weight": 1e-3, "starts": 1, "population": 16, "checkpoint": path}
    least_squares_fit(curved, np.array([0.6, 0.4]), **arguments)
    path.write_text(json.dumps(change(json.loads(path.read_text()))))
    with pytest.raises(ValueError, match=rf"{path} is damaged .* --restart begins anew"):
        least_squares_fit(curved, np.array([0.6, 0.4]), **arguments)
    path.write_text("{")
    with pytest.raises(ValueError, match=rf"{path} is not JSON"):
        least_squares_fit(curved, np.array([0.6, 0.4]), **arguments)


def test_ensemble_spreads_where_the_data_are_blind():
    """Residuals that see x + y alone: members keep the sum and spread along the difference."""

    def blind(points):
        return 50.0 * (points[:, :1] + points[:, 1:2] - 1.0).T

    best = np.array([0.5, 0.5])
    members = draw_ensemble(blind, best[None], 6, accept=lambda found: np.all(np.abs(found) < 2.0, axis=0))
    assert members.shape == (6, 2)
    assert np.array_equal(members[0], best)
    assert np.abs(members.sum(axis=1) - 1.0).max() < 2.0 / 50.0
    assert np.ptp(members[:, 0] - members[:, 1]) > 0.5
    # along the blind direction the posterior is the prior, across it 1/(50 √2) or less
    factor, jacobian = posterior_factor(blind, best, 0.25)
    np.testing.assert_allclose(jacobian, [[50.0, 50.0]], rtol=1e-9)
    covariance = factor @ factor.T
    along, across = np.array([1.0, -1.0]) / np.sqrt(2.0), np.array([1.0, 1.0]) / np.sqrt(2.0)
    assert along @ covariance @ along == pytest.approx(0.25**2)
    assert across @ covariance @ across == pytest.approx(1.0 / (2.0 * 50.0**2 + 16.0))


def test_where_nothing_else_fits_the_best_stays_alone():
    def sharp(points):
        return 1e6 * (points - 0.5).T

    best = np.array([[0.5, 0.5]])
    members = draw_ensemble(sharp, best, 5, accept=lambda found: np.all(np.abs(found) < 1e-9, axis=0), candidates=8)
    assert np.array_equal(members, best)


def test_farthest_apart_takes_the_corners_first():
    points = np.array([[0.5, 0.5], [0.0, 0.0], [0.1, 0.0], [1.0, 1.0], [0.9, 1.0]])
    assert {tuple(p) for p in farthest_apart(points, 3)} == {(0.5, 0.5), (0.0, 0.0), (1.0, 1.0)}


def test_crossing_brackets_or_says_none():
    values = np.array([1.0, 2.0, 3.0, 4.0])
    assert crossing(values, np.array([5.0, 4.0, 2.0, 1.0]), 3.0) == (2.0, 3.0)
    assert crossing(values, np.array([np.nan, 4.0, 2.0, 1.0]), 3.0) == (2.0, 3.0)
    assert crossing(values, np.array([5.0, 4.5, 4.2, 4.1]), 3.0) is None
