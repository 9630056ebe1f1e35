"""The plants' steering linkage against closed forms."""

import numpy as np
import pytest

from aoro_gym.diagnosis_benchmark.plants.linkage import Linkage, SteeringCylinders


def test_the_stroke_spans_the_range(constants):
    p = "steering.cylinder."
    reach = constants["joint.range"]
    link = Linkage(constants[p + "dead_length"], constants[p + "stroke"], constants[p + "mount_ratio"], reach)
    assert link.length(-reach) == pytest.approx(constants[p + "dead_length"])
    assert link.length(reach) == pytest.approx(constants[p + "dead_length"] + constants[p + "stroke"])


def test_levers_are_the_derivatives_of_lengths_and_volumes(constants):
    cylinders, step = SteeringCylinders(constants), 1e-5
    for angle in (-0.6, 0.0, 0.45):
        at, before, after = (cylinders.at(np.array([angle + d])) for d in (0.0, -step, step))
        for volume, slope, curve in (("volume_a", "slope_a", "curve_a"), ("volume_b", "slope_b", "curve_b")):
            change = (getattr(after, volume) - getattr(before, volume)) / (2.0 * step)
            assert getattr(at, slope) == pytest.approx(change, rel=1e-7)
            bend = (getattr(after, slope) - getattr(before, slope)) / (2.0 * step)
            assert getattr(at, curve) == pytest.approx(bend, rel=1e-6)


def test_a_full_turn_takes_both_cylinders_oil(constants):
    cylinders, reach = SteeringCylinders(constants), constants["joint.range"]
    oil = cylinders.at(reach).volume_a - cylinders.at(-reach).volume_a
    assert oil == pytest.approx(2.3311e-3, rel=1e-4)  # published bore, rod and stroke
