"""The plants' steering linkage against closed forms."""

# device code: its types are Warp's
# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportOperatorIssue=false
# pyright: reportCallIssue=false, reportIndexIssue=false, reportArgumentType=false, reportAssignmentType=false
import numpy as np
import pytest
import warp as wp

from aoro_gym.diagnosis_benchmark.plants.linkage import Cylinders, Displacement, cylinders_of, displacement, levers
from aoro_gym.diagnosis_benchmark.plants.records import evaluate, f64, packed


@wp.func
def length(c: Cylinders, angle: f64):
    pin_to_pin, _lever, _curve = levers(c.link, angle)
    return pin_to_pin


@wp.kernel(enable_backward=False)
def displaced(c: wp.array(dtype=Cylinders), angle: wp.array(dtype=f64), at: wp.array(dtype=Displacement)):
    i = wp.tid()
    at[i] = displacement(c[0], angle[i])


@pytest.fixture(scope="module")
def cylinders(constants):
    return packed(Cylinders, cylinders_of(constants), 1)


def displacements(cylinders, angles):
    """Records of :data:`Displacement` at ``angles`` [rad]."""
    at = wp.zeros(len(angles), dtype=Displacement, device="cpu")
    inputs = [wp.array(cylinders, dtype=Cylinders, device="cpu"), wp.array(angles, dtype=f64, device="cpu"), at]
    wp.launch(displaced, dim=len(angles), inputs=inputs, device="cpu")
    return at.numpy()


def test_the_stroke_spans_the_range(constants, cylinders):
    p, reach = "steering.cylinder.", constants["joint.range"]
    ends = evaluate(length, cylinders, Cylinders, np.stack([-reach, reach]))
    assert ends[0] == pytest.approx(constants[p + "dead_length"])
    assert ends[1] == pytest.approx(constants[p + "dead_length"] + constants[p + "stroke"])


def test_levers_are_the_derivatives_of_lengths_and_volumes(cylinders):
    step = 1e-5
    for angle in (-0.6, 0.0, 0.45):
        at, before, after = displacements(cylinders, angle + np.array([0.0, -step, step]))
        for volume, slope, curve in (("volume_a", "slope_a", "curve_a"), ("volume_b", "slope_b", "curve_b")):
            assert at[slope] == pytest.approx((after[volume] - before[volume]) / (2.0 * step), rel=1e-7)
            assert at[curve] == pytest.approx((after[slope] - before[slope]) / (2.0 * step), rel=1e-6)


def test_a_full_turn_takes_both_cylinders_oil(constants, cylinders):
    reach = constants["joint.range"][0]
    right, left = displacements(cylinders, np.array([-reach, reach]))
    assert left["volume_a"] - right["volume_a"] == pytest.approx(2.3311e-3, rel=1e-4)  # published bore, rod and stroke
