"""The plants' bodies against closed forms."""

import numpy as np
import pytest

from aoro_gym.diagnosis_benchmark.plants.bodies import FRONT, PITCH, REAR, ROLL, Bodies, X, Y, Z
from aoro_gym.diagnosis_benchmark.plants.fluid import Oil
from aoro_gym.diagnosis_benchmark.plants.tires import NOMINAL_LOAD


def test_the_mass_matrix_is_that_of_two_bodies(constants):
    """Kinetic energy from point velocities of both frames, by finite differences of their places."""
    bodies = Bodies(constants, Oil(constants, 0))
    rng = np.random.default_rng(1)
    bodies.position[:] = rng.uniform(-0.4, 0.4, (7, 1)) * np.array([1, 1, 1, 1, 0, 0, 0])[:, None]
    u = rng.uniform(-1.0, 1.0, (7, 1))
    factor = bodies.mass_factor()[..., 0]
    energy = 0.5 * np.sum((factor.T @ u[:, 0]) ** 2)
    expected = 0.0
    for half, row in ((bodies.front, FRONT), (bodies.rear, REAR)):
        heading = bodies.position[row, 0]
        turn = np.array([[np.cos(heading), -np.sin(heading), 0], [np.sin(heading), np.cos(heading), 0], [0, 0, 1]])
        place = turn @ np.array([half.reach[0], 0.0, half.height[0]])
        rate = np.array([u[ROLL, 0], u[PITCH, 0], u[row, 0]])
        velocity = np.array([u[X, 0], u[Y, 0], u[Z, 0]]) + np.cross(rate, place)
        own = np.array([[half.roll[0], 0, half.product[0]], [0, half.pitch[0], 0], [half.product[0], 0, half.yaw[0]]])
        local = turn.T @ rate
        expected += 0.5 * half.mass[0] * velocity @ velocity + 0.5 * local @ own @ local
    assert energy == pytest.approx(expected, rel=1e-12)
    force = rng.uniform(-1.0, 1.0, (7, 1))
    matrix = factor @ factor.T
    assert matrix @ bodies.solve(factor[..., None], force)[:, 0] == pytest.approx(force[:, 0])


def test_tires_bear_the_machine_in_balance(constants, machine):
    bodies = Bodies(constants, Oil(constants, 0))
    bodies.stand(np.array([0.6]))
    load = bodies.loads(np.zeros((7, 1)))
    assert load.sum() == pytest.approx(9.81 * machine.mass, rel=1e-3)
    # in balance to a thousandth of what one wheel's moment is
    assert np.abs((bodies.weight() + bodies.lift(load))[Z:]).max() < 1e-3 * NOMINAL_LOAD


def test_level_frames_carry_the_design_loads(constants, machine):
    bodies = Bodies(constants, Oil(constants, 0))
    bodies.stand(np.zeros(1))
    rest = machine.rest
    loads = [rest.wheel_load_front] * 2 + [rest.wheel_load_rear] * 2
    assert bodies.loads(np.zeros((7, 1)))[:, 0] == pytest.approx(loads, rel=1e-6)
