"""Laws of friction of the plants against closed forms."""

import numpy as np
import pytest

from aoro_gym.diagnosis_benchmark.plants.friction import CREEP, brown_mcphee, dahl, makkar, prandtl_force


def test_brown_and_mcphee_break_away_at_the_static_level(mapped):
    speeds = np.linspace(0.0, 0.1, 100001)
    force = -mapped(brown_mcphee, speeds, 300.0, 400.0)
    assert force.max() == pytest.approx(400.0, rel=2e-3)  # tanh 4 is 0.9993
    assert speeds[np.argmax(force)] == pytest.approx(float(CREEP), rel=0.05)
    assert force[-1] == pytest.approx(300.0, rel=2e-3)
    assert mapped(brown_mcphee, -0.05, 300.0, 400.0) == pytest.approx(-mapped(brown_mcphee, 0.05, 300.0, 400.0))


def test_makkar_s_law_breaks_away_at_the_static_level(mapped):
    speeds = np.linspace(0.0, 0.2, 200001)
    force = -mapped(makkar, speeds, 300.0, 400.0)
    assert force.max() == pytest.approx(300.0 + 0.87 * 100.0, rel=2e-3)
    assert speeds[np.argmax(force)] == pytest.approx(1.1 * float(CREEP), rel=0.05)
    assert force[-1] == pytest.approx(300.0, rel=2e-3)
    assert mapped(makkar, -0.05, 300.0, 400.0) == pytest.approx(-mapped(makkar, 0.05, 300.0, 400.0))


def test_sticking_friction_is_a_spring_up_to_its_capacity(mapped):
    stretch = np.array([1e-4, 1.0, -1.0])
    assert mapped(prandtl_force, stretch, 0.0, 1e6, 1e3, 200.0) == pytest.approx([-100.0, -200.0, 200.0])
    share = mapped(dahl, 0.0, 1e-3, 500.0)
    assert share == pytest.approx(1.0 - np.exp(-0.5))
    assert mapped(dahl, mapped(dahl, 0.0, 4e-4, 500.0), 6e-4, 500.0) == pytest.approx(share)
