"""The inclined plane: its normal, its heights, and what it refuses."""

import numpy as np
import pytest

from aoro_gym.terrains import Plane


def test_level_by_default():
    plane = Plane()
    np.testing.assert_allclose(plane.normal, [0.0, 0.0, 1.0])
    assert plane.height(3.0, -4.0) == 0.0


@pytest.mark.parametrize("direction", [0.0, 90.0, 180.0, 37.0, -120.0])
def test_rises_towards_its_direction(direction):
    plane = Plane(slope_deg=10.0, direction_deg=direction)
    ahead = np.array([np.cos(np.radians(direction)), np.sin(np.radians(direction))])
    assert plane.height(*(5.0 * ahead)) == pytest.approx(5.0 * np.tan(np.radians(10.0)))
    assert plane.height(-5.0 * ahead[1], 5.0 * ahead[0]) == pytest.approx(0.0, abs=1e-12)  # across the slope


def test_normal_is_unit_and_at_right_angles_to_the_surface():
    rng = np.random.default_rng(1)
    plane = Plane(slope_deg=rng.uniform(-30, 30, 50), direction_deg=rng.uniform(-180, 180, 50))
    assert plane.normal.shape == (50, 3)
    np.testing.assert_allclose(np.linalg.norm(plane.normal, axis=-1), 1.0)
    assert np.all(plane.normal[:, 2] > 0)
    for x, y in [(1.0, 0.0), (0.0, 1.0), (-2.0, 3.0)]:
        edge = np.stack([np.full(50, x), np.full(50, y), plane.height(x, y)], axis=-1)
        np.testing.assert_allclose(np.sum(edge * plane.normal, axis=-1), 0.0, atol=1e-12)


def test_negative_slope_is_descent():
    down, up = Plane(slope_deg=-8.0, direction_deg=20.0), Plane(slope_deg=8.0, direction_deg=200.0)
    np.testing.assert_allclose(down.normal, up.normal, atol=1e-15)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("slope_deg", 46.0, r"slope_deg is 46 deg, but must be in \[-45, 45\] deg"),
        ("slope_deg", np.nan, "slope_deg is nan deg, but"),
        ("slope_deg", "steep", "slope_deg is 'steep', but must be a number"),
        ("friction", 0.0, "friction is 0.*, but"),
        ("friction", [1.0, -1.0], r"friction\[1\] is -1.*, but"),
        ("rolling_resistance", np.inf, "rolling_resistance is inf.*, but"),
        ("direction_deg", [[1.0]], r"direction_deg has the shape \(1, 1\)"),
        ("direction_deg", [], r"direction_deg has the shape \(0,\)"),
    ],
)
def test_refuses(field, value, message):
    with pytest.raises(ValueError, match=message):
        Plane(**{field: value})


def test_fields_must_agree_in_length():
    with pytest.raises(ValueError, match="slope_deg has 2, friction has 3"):
        Plane(slope_deg=[1.0, 2.0], friction=[1.0, 1.0, 1.0])


def test_does_not_change_and_does_not_share():
    slopes = np.array([1.0, 2.0])
    plane = Plane(slope_deg=slopes)
    slopes[0] = 40.0
    np.testing.assert_array_equal(plane.slope_deg, [1.0, 2.0])
    with pytest.raises(AttributeError):
        plane.slope_deg = 3.0  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(ValueError, match="read-only"):
        np.asarray(plane.slope_deg)[0] = 3.0
