"""The most probable point that has all figures, on figures whose answer is known."""

import numpy as np
import pytest
from scipy.optimize import minimize

from aoro_gym.calibration import procedure, right_turns
from aoro_gym.calibration.fit import ENOUGH
from aoro_gym.calibration.probable import PENALTY, elastic_step, most_probable_fit, prior_cost
from aoro_gym.calibration.procedure import measured_curve, published_turn_time
from aoro_gym.calibration.right_turns import EDGE, KEYS, RIGHT_FIGURES, with_right_turns
from aoro_gym.calibration.space import PRIOR_STD
from aoro_gym.machine import Machine
from aoro_gym.simulation.key_figures import FIGURES


def test_one_linear_figure_is_met_where_the_prior_is_projected():
    """|a·u - b| ≤ 1 from beyond it: the nearest point of the plane a·u = b + 1 is u₀ - a (a·u₀ - b - 1)/|a|²."""
    a, b, prior = np.array([6.0, -3.0, 2.0]), 1.0, np.array([0.7, 0.4, 0.5])
    expected = prior - a * (a @ prior - b - 1.0) / (a @ a)
    fit = most_probable_fit(lambda points: (points @ a - b)[None], prior, np.array([0.2, 0.2, 0.3]), limit=1.0)
    np.testing.assert_allclose(fit.point, expected, atol=1e-6)
    assert fit.cost == pytest.approx(prior_cost(expected, prior), rel=1e-6)
    # the multiplier, 2 (a·u₀ - b - 1)/(|a| 0.25)², is below the penalty: so the penalty is exact
    assert 2.0 * (a @ prior - b - 1.0) / (a @ a) / PRIOR_STD**2 < PENALTY


def test_a_figure_that_is_met_leaves_the_prior():
    prior = np.array([0.7, 0.0])
    fit = most_probable_fit(lambda points: points[:, :1].T - 0.5, prior, np.array([0.1, 0.9]))
    np.testing.assert_allclose(fit.point, prior, atol=1e-6)


def dual(slopes, residuals, point, prior, box, limit):
    """Largest value of the dual of the quadratic program, smooth and without constraints but for its multipliers' range
    [0, PENALTY]: for these the best point is a projection onto the box."""
    low, high = np.maximum(point - box, 0.0), np.minimum(point + box, 1.0)

    def negative(multipliers):
        above, below = np.split(multipliers, 2)
        best = np.clip(prior - 0.5 * PRIOR_STD**2 * slopes.T @ (above - below), low, high)
        there = residuals + slopes @ (best - point)
        rise = np.concatenate([there - limit, -there - limit])
        return -(prior_cost(best, prior) + multipliers @ rise), -rise

    options = {"maxiter": 20000, "maxfun": 50000, "ftol": 1e-15, "gtol": 1e-9}
    ranges = [(0.0, PENALTY)] * (2 * len(residuals))
    multipliers = np.zeros(len(ranges))
    for _ in range(10):  # where its memory misleads it, a search ends early; the next one forgets
        found = minimize(negative, multipliers, jac=True, method="L-BFGS-B", bounds=ranges, options=options)
        multipliers = found.x
    return -found.fun


@pytest.mark.parametrize("box", [0.01, 0.1, 0.4])
@pytest.mark.parametrize("size", [3, 60])
def test_no_point_of_a_box_is_better(box, size):
    """The dual's value is a lower bound of the quadratic program's, whatever solved it; here they meet. With three
    parameters not all figures can be had, with sixty they can."""
    rng = np.random.default_rng(size)
    slopes, residuals = 8.0 * rng.standard_normal((25, size)), 1.5 * rng.standard_normal(25)
    point, prior = rng.uniform(size=(2, size))
    found = elastic_step(slopes, residuals, point, prior, box, 1.9)
    assert np.max(np.abs(found - point)) <= box + 1e-12 and np.min(found) >= 0.0 and np.max(found) <= 1.0
    beyond = np.sum(np.maximum(np.abs(residuals + slopes @ (found - point)) - 1.9, 0.0))
    assert prior_cost(found, prior) + PENALTY * beyond == pytest.approx(
        dual(slopes, residuals, point, prior, box, 1.9), rel=1e-6
    )


def test_a_curved_figure_is_met_where_its_circle_is_nearest():
    """100 |u - c|² - 9 ≤ 1.88 is a disc; from outside its nearest point lies on the line to the centre. A search ends where
    a step gains less than a thousandth, twice."""
    centre, prior = np.array([0.3, 0.4]), np.array([0.9, 0.7])
    away = prior - centre
    expected = centre + np.sqrt(0.1088) * away / np.linalg.norm(away)
    fit = most_probable_fit(
        lambda points: 100.0 * np.sum(np.square(points - centre), axis=1)[None] - 9.0, prior, np.array([0.05, 0.6])
    )
    assert fit.cost == pytest.approx(prior_cost(expected, prior), rel=2.0 * ENOUGH)
    np.testing.assert_allclose(fit.point, expected, atol=0.01)
    assert np.abs(fit.residuals[0]) < 1.88 + 1e-3


def contradicting(points):
    """20 (x - 0.2) and 20 (x - 0.8), both within ± 1: from x = 0.25 to 0.75 they are 10 beyond that, in sum."""
    return 20.0 * np.array([points[:, 0] - 0.2, points[:, 0] - 0.8])


@pytest.mark.parametrize(("prior", "expected"), [(0.1, 0.25), (0.4, 0.4), (0.95, 0.75)])
def test_where_no_point_has_all_figures_their_excess_is_least(prior, expected):
    fit = most_probable_fit(contradicting, np.array([prior, 0.3]), np.array([0.5, 0.9]), limit=1.0)
    np.testing.assert_allclose(fit.point, [expected, 0.3], atol=1e-5)
    assert np.sum(np.abs(fit.residuals)) - 2.0 == pytest.approx(10.0, abs=1e-4)


def test_an_end_of_a_range_is_where_it_ends():
    """Figures ask for x + y = 1.7 at least, the prior for x = 2 y: y reaches 0.7 once x is at its end."""
    fit = most_probable_fit(
        lambda points: 50.0 * (points.sum(axis=1) - 1.72)[None], np.array([0.98, 0.49]), np.array([0.5, 0.5]), limit=1.0
    )
    np.testing.assert_allclose(fit.point, [1.0, 0.7], atol=1e-6)


@pytest.mark.parametrize("stop", [1, 3, 6, 12])
def test_a_search_that_was_ended_anywhere_finds_the_same(tmp_path, stop):
    def curved(points):
        return 100.0 * np.sum(np.square(points - 0.3), axis=1)[None] - 9.0

    prior, initial, calls = np.array([0.9, 0.7]), np.array([0.05, 0.6]), []

    def interrupted(points):
        calls.append(1)
        if len(calls) == stop:
            raise KeyboardInterrupt
        return curved(points)

    path = tmp_path / "search-probable.json"
    with pytest.raises(KeyboardInterrupt):
        most_probable_fit(interrupted, prior, initial, checkpoint=path)
    whole = most_probable_fit(curved, prior, initial)
    assert most_probable_fit(interrupted, prior, initial, checkpoint=path) == whole
    done = len(calls)
    assert most_probable_fit(interrupted, prior, initial, checkpoint=path) == whole
    assert len(calls) == done, "what is kept is not searched again"
    assert most_probable_fit(interrupted, prior, initial, limit=1.0, checkpoint=path) != whole


def nearly_linear(machine, turns, **_):
    """Right turns of a valve whose mean flow is the steady one by the square root of its edge's drop over 7 bar."""
    values = [np.atleast_1d(machine.entries[key].value) for key in KEYS]
    flow, drop, *openings = np.broadcast_arrays(*values)
    full = flow * np.sqrt(7.0 / drop)
    out = np.full((len(turns), len(FIGURES), len(full)), np.nan)
    for i, mean in enumerate([full, *(full * opening for opening in openings)][: len(turns)]):
        out[i, FIGURES.index("mean_flow_L_per_min")] = mean
        out[i, FIGURES.index("turn_time_s")] = 140.0 / mean
    return out


@pytest.fixture
def quick_turns(monkeypatch):
    """Right turns in closed form."""
    for module in (right_turns, procedure):
        monkeypatch.setattr(module, "population_figures", nearly_linear)


def test_right_turns_set_the_right_side_alone(quick_turns):
    """At the measured flows and the data sheet's 7 bar 140 L/min s need 2.1407 s, near enough: all stays as most probable,
    but for the return edge, wherever the right side was before. Where the flows are held, the drop alone is set."""
    sheet = measured_curve(Machine.load("aoro_datasheet"))
    before = sheet.set({"steering.valve.nominal_drop_out_left": 3.0, KEYS[1]: 12.0})
    found, misses = with_right_turns(before, sheet, set())
    assert found.entries[EDGE].value == 3.0
    changed = {key for key, entry in found.entries.items() if entry.value != before.entries[key].value}
    assert changed <= {EDGE, *KEYS}
    for key in KEYS:
        assert found.entries[key].value == pytest.approx(float(sheet.entries[key].value), rel=1e-4), key
    assert misses == pytest.approx(dict(zip(RIGHT_FIGURES, (0.07, 0.0, 0.0), strict=True)), abs=0.01)

    other = sheet.set({KEYS[1]: 9.0})
    found, misses = with_right_turns(other, other, {key for key in KEYS if key != KEYS[1]})
    assert [key for key in KEYS if found.entries[key].value != other.entries[key].value] == [KEYS[1]]
    # as near to 9 bar as 0.94 of 0.01 s allow, and a share of flows has the turn's share of the flow
    assert found.entries[KEYS[1]].value == pytest.approx(
        7.0 * (65.4 * (published_turn_time("right") + 0.0094) / 140.0) ** 2, rel=1e-4
    )
    assert list(misses.values()) == pytest.approx([0.94, -0.21, -0.21], abs=0.01)


def test_a_right_turn_that_no_drop_gives_is_named(quick_turns):
    sheet = measured_curve(Machine.load("aoro_datasheet"))
    with pytest.raises(
        ValueError, match=r"no steering\.valve\.nominal_drop_in_right within its range \[4, 14\] bar reaches 2\.14"
    ):
        with_right_turns(sheet.set({KEYS[0]: 110.0}, check_ranges=False), sheet, set())
