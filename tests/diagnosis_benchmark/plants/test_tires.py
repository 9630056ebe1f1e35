"""The plants' tires against closed forms."""

import numpy as np
import pytest

from aoro_gym.diagnosis_benchmark.plants.tires import NOMINAL_LOAD, PARKING, pushed


@pytest.mark.parametrize("level", [0, 2, 3])
def test_a_sliding_tire_resists_by_its_friction(constants, level):
    """Steady sliding: N g(v), with the viscous part; the patch's bristles all slide alike."""
    speed = 0.5
    slides = (0.0, speed, 0.0, 0.0)
    _, lateral, torque, _ = pushed(constants, level, [(*slides, 5.0)], slides)  # settles within g/(σ₀ v), 0.2 s
    sticking = constants["tire.friction_coulomb" if level == 3 else "tire.friction_static"]
    grip = constants["tire.friction_coulomb"] + (sticking - constants["tire.friction_coulomb"]) * np.exp(
        -((speed / constants["tire.stribeck_velocity"]) ** 2)
    )
    expected = -float(NOMINAL_LOAD) * (grip + constants["tire.sigma2_lateral"] * speed)
    assert lateral == pytest.approx(expected, rel=1e-9)
    assert torque == pytest.approx(0.0, abs=1e-6)


def test_a_standing_tire_of_level_3_resists_swivelling_up_to_its_torque(constants):
    first, both = (
        pushed(constants, 3, [(0.0, 0.0, angle, 0.0, 1.0) for angle in angles])[2] for angles in ((0.1,), (0.1, 0.9))
    )
    assert first == pytest.approx(-(1.0 - np.exp(-1.0)) * PARKING)  # scrub angle 0.1 rad
    assert both == pytest.approx(-(1.0 - np.exp(-10.0)) * PARKING)


def test_a_patch_that_rolls_sheds_its_swivel_torque(constants):
    swivel = [(0.0, 0.0, 0.0035, 0.0, 1.0)] * 100
    standing = pushed(constants, 2, swivel)[2]
    rolled = pushed(constants, 2, [*swivel, (0.0, 0.0, 0.0, 1.0, 1.0)])[2]  # a metre straight on
    assert standing < -500.0
    assert np.abs(rolled) < 0.1 * np.abs(standing)  # exp(−1 m / 0.4 m)
