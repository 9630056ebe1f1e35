"""Axes: places and magnitudes, and shifts between nodes, against closed forms."""

import numpy as np
import pytest

from aoro_gym.diagnosis.axes import NODES, Axis, axes_of
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
