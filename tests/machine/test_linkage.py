"""The cylinder linkage: its closed form against the two conditions that define it, and its lever."""

import numpy as np
import pytest

from aoro_gym.machine.linkage import Linkage, close_linkage
from aoro_gym.machine.parameters import Machine

# dead length [m], stroke [m], mount ratio, half range [rad]
CASES = {
    "steering": (0.505, 0.265, 0.766, np.radians(40.0)),
    "arm": (0.62, 0.37, 0.55, np.radians(28.0)),
    "isosceles": (0.60, 0.265, 1.0, np.radians(43.0)),
    "front pin farther": (0.49, 0.265, 1.4, np.radians(38.0)),
    "short stroke": (0.50, 0.05, 0.8, np.radians(10.0)),
}


@pytest.fixture(params=CASES.values(), ids=list(CASES))
def linkage(request: pytest.FixtureRequest) -> Linkage:
    return close_linkage(*request.param)


def test_closed_at_one_end_and_open_at_the_other(linkage: Linkage) -> None:
    assert linkage.length(-linkage.half_range) == pytest.approx(linkage.dead_length, rel=1e-12)
    assert linkage.length(linkage.half_range) == pytest.approx(linkage.dead_length + linkage.stroke, rel=1e-12)


def test_never_bottoms_between_the_ends(linkage: Linkage) -> None:
    angles = np.linspace(-1.0, 1.0, 101) * linkage.half_range
    assert np.all(linkage.lever(angles) > 0.0)
    inside = linkage.extension(angles[1:-1])
    assert np.all((inside > 0.0) & (inside < linkage.stroke))


def test_lever_is_the_derivative_of_the_length(linkage: Linkage) -> None:
    # central difference: h²/6 |L'''| + ε L/h, with |L'''| < 10 m/rad³ and L < 1 m; below 1e-10 m at h = 6e-6 rad
    step = np.cbrt(np.finfo(float).eps)
    angles = np.linspace(-1.0, 1.0, 21) * linkage.half_range
    slope = (linkage.length(angles + step) - linkage.length(angles - step)) / (2.0 * step)
    np.testing.assert_allclose(linkage.lever(angles), slope, rtol=0.0, atol=step**2 * 10.0 / 6.0 + 2.2e-16 / step)


def test_mean_lever_is_the_mean_of_the_lever(linkage: Linkage) -> None:
    nodes, weights = np.polynomial.legendre.leggauss(40)
    assert 0.5 * weights @ linkage.lever(nodes * linkage.half_range) == pytest.approx(linkage.mean_lever, rel=1e-12)


def test_of_two_mountings_the_one_with_the_longer_shortest_lever() -> None:
    linkage = close_linkage(0.62, 0.37, 0.45, np.radians(28.0))
    other = np.radians(34.405)  # the second solution, close to a dead centre
    pins = 0.62 / np.sqrt(1.0 + 0.45**2 - 0.9 * np.cos(other - linkage.half_range))
    worse = Linkage(pins, 0.45 * pins, other, 0.62, 0.37, linkage.half_range)
    assert worse.length(worse.half_range) == pytest.approx(0.99, abs=1e-4)
    ends = np.array([-1.0, 1.0]) * linkage.half_range
    assert np.min(linkage.lever(ends)) > np.min(worse.lever(ends))


def test_nan_where_the_stroke_cannot_span_the_range() -> None:
    ratio = np.array([0.1, 0.766, 0.2])
    linkage = close_linkage(0.505, 0.265, ratio, np.radians(40.0))
    assert np.isnan(linkage.g0).tolist() == [True, False, True]
    assert np.isnan(linkage.a).tolist() == np.isnan(linkage.b).tolist() == [True, False, True]


def test_arrays_equal_a_loop_of_scalars() -> None:
    inputs = np.array(list(CASES.values())).T
    batch = close_linkage(*inputs)
    for i, row in enumerate(inputs.T):
        single = close_linkage(*row)
        for name in ("a", "b", "g0"):
            # the same operations; only the rounding of vectorised elementary functions may differ
            assert getattr(batch, name)[i] == pytest.approx(getattr(single, name), rel=1e-13)


def test_scalars_give_floats() -> None:
    linkage = close_linkage(*CASES["steering"])
    assert all(type(x) is float for x in (linkage.a, linkage.b, linkage.g0))


def test_effective_lever_in_a_left_turn() -> None:
    """Derived elsewhere from pins at (0.40, ±0.194) m behind and (0.28, ±0.194) m ahead of the hinge, to 1 mm."""
    cylinder = Machine.load("aoro_datasheet").steering.cylinder
    angles = np.radians([-40.0, -20.0, 0.0, 20.0, 40.0])
    swept = cylinder.bore_area * cylinder.linkage.lever(angles) + cylinder.annulus_area * cylinder.linkage.lever(
        -angles
    )
    lever = swept / (cylinder.bore_area + cylinder.annulus_area)
    np.testing.assert_allclose(lever, [0.197, 0.199, 0.194, 0.183, 0.165], rtol=0.0, atol=0.5e-3)


def test_arm_lever_is_moderate_over_the_swing() -> None:
    linkage = Machine.load().arm.cylinder.linkage
    lever = linkage.lever(np.linspace(-1.0, 1.0, 101) * linkage.half_range)
    assert np.min(lever) > 0.30 and np.max(lever) < 0.42
