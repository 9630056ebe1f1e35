"""The tree of bodies is the twin's."""

import numpy as np
import pytest

from aoro_gym.interchange.sensor_places import sensor_places
from aoro_gym.machine import Machine
from aoro_gym.machine.rigid_bodies import (
    BASE,
    JOINT,
    REAR,
    composite,
    machine_bodies,
    poses,
    rest_angles,
    turned,
)
from aoro_gym.sensors import Antennas
from tests.interchange.loading import HINGES
from tests.oracles.bodies import BodyModel, uneven_machines


@pytest.fixture(scope="module")
def calibrated():
    return Machine.load("aoro")


@pytest.fixture(scope="module")
def machines(calibrated):
    uneven = uneven_machines(calibrated, np.random.default_rng(4), 3)
    return [uneven.variant(i) for i in range(3)]


def test_mass_centre_and_inertia_are_the_oracles(machines):
    rng = np.random.default_rng(1)
    for machine in machines:
        angles = dict(zip(HINGES, rng.uniform(-0.5, 0.5, len(HINGES)), strict=True))
        mass, centre, inertia = composite(machine_bodies(machine), angles)
        oracle, q = BodyModel(machine), np.concatenate([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], list(angles.values())])
        matrix = oracle.mass_matrix(q)
        about_origin = inertia + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        assert mass == pytest.approx(matrix[0, 0], rel=1e-12) and mass == pytest.approx(machine.mass, rel=1e-12)
        np.testing.assert_allclose(centre, oracle.center_of_mass(q), atol=1e-12)
        np.testing.assert_allclose(about_origin, matrix[3:6, 3:6], atol=1e-12 * matrix.max())


def test_positive_angles_turn_left_raise_and_roll_forward(calibrated):
    bodies = machine_bodies(calibrated)
    zero = dict.fromkeys(rest_angles(calibrated), 0.0)
    straight = poses(bodies, zero)
    heading = {name: np.arctan2(*poses(bodies, zero | {JOINT: 0.3})[name][0][1::-1, 0]) for name in (BASE, REAR)}
    assert heading[BASE] - heading[REAR] == pytest.approx(0.3, abs=1e-12)
    for corner in ("fl", "fr", "rl", "rr"):
        raised = poses(bodies, zero | {f"arm_{corner}": 0.3})[f"wheel_{corner}"][1]
        rise = raised - straight[f"wheel_{corner}"][1]
        assert rise[2] == pytest.approx(calibrated.arm.length * np.sin(0.3), abs=1e-12)
        rolled = poses(bodies, zero | {f"wheel_{corner}": 0.3})[f"wheel_{corner}"][0]
        assert (rolled @ [0.0, 0.0, 1.0])[0] == pytest.approx(np.sin(0.3), abs=1e-12)  # the tire's top goes forward


def test_rotations_turn_right_handed():
    np.testing.assert_allclose(
        turned(np.array([0.0, 0.0, 1.0]), 0.5 * np.pi) @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-15
    )
    np.testing.assert_allclose(
        turned(np.array([0.0, 1.0, 0.0]), 0.5 * np.pi) @ [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], atol=1e-15
    )


def test_sensors_are_where_the_twins_are():
    places = sensor_places()
    assert tuple(places["gps_main"]) == Antennas().main and tuple(places["gps_auxiliary"]) == Antennas().auxiliary
    assert not places["imu"].any()


def test_one_machine_only(calibrated):
    with pytest.raises(ValueError, match=r"the machine has 2 variants.*give variant"):
        machine_bodies(calibrated.scale({"wheel.mass": np.array([1.0, 1.1])}))
