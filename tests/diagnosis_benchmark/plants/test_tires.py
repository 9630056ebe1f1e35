"""The plants' tires against closed forms."""

import numpy as np
import pytest

from aoro_gym.diagnosis_benchmark.plants.tires import NOMINAL_LOAD, PARKING, Tires


@pytest.mark.parametrize("level", [0, 2, 3])
def test_a_sliding_tire_resists_by_its_friction(constants, level):
    """Steady sliding: N g(v), with the viscous part; the patch's bristles all slide alike."""
    tires, speed = Tires(constants, level), 0.5
    zero = np.zeros((4, 1))
    tires.advance(zero, zero + speed, zero, zero, 5.0)  # bristles settle within g/(σ₀ v), 0.2 s
    _, lateral, torque = tires.forces(zero + NOMINAL_LOAD, zero, zero + speed, zero, zero)
    sticking = constants["tire.friction_coulomb" if level == 3 else "tire.friction_static"]
    grip = constants["tire.friction_coulomb"] + (sticking - constants["tire.friction_coulomb"]) * np.exp(
        -((speed / constants["tire.stribeck_velocity"]) ** 2)
    )
    expected = -NOMINAL_LOAD * (grip + constants["tire.sigma2_lateral"] * speed)
    assert lateral[:, 0] == pytest.approx(expected[0], rel=1e-9)
    assert torque[:, 0] == pytest.approx(0.0, abs=1e-6)


def test_a_standing_tire_of_level_3_resists_swivelling_up_to_its_torque(constants):
    tires = Tires(constants, 3)
    zero = np.zeros((4, 1))
    for angle, share in ((0.1, 1.0 - np.exp(-1.0)), (0.9, 1.0 - np.exp(-10.0))):  # scrub angle 0.1 rad
        tires.advance(zero, zero, zero + angle, zero, 1.0)
        torque = tires.forces(zero + NOMINAL_LOAD, zero, zero, zero, zero)[2]
        assert torque[:, 0] == pytest.approx(-share * PARKING)


def test_a_patch_that_rolls_sheds_its_swivel_torque(constants):
    tires = Tires(constants, 2)
    zero = np.zeros((4, 1))
    for _ in range(100):
        tires.advance(zero, zero, zero + 0.0035, zero, 1.0)
    standing = tires.forces(zero + NOMINAL_LOAD, zero, zero, zero, zero)[2]
    tires.advance(zero, zero, zero, zero + 1.0, 1.0)  # a metre straight on
    rolled = tires.forces(zero + NOMINAL_LOAD, zero, zero, zero, zero)[2]
    assert np.all(standing < -500.0)
    assert np.all(np.abs(rolled) < 0.1 * np.abs(standing))  # exp(−1 m / 0.4 m)
