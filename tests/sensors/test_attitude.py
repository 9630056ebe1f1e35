"""Quaternions and angles of the front frame, against SciPy's rotations and each other."""

import numpy as np
from scipy.spatial.transform import Rotation

from aoro_gym.sensors.attitude import angles_of, in_world, quaternion_of

ANGLES = np.random.default_rng(1).uniform(-1.5, 1.5, (3, 20))
"""Roll, pitch and yaw [rad]."""


def test_quaternions_are_those_of_the_angles():
    found = quaternion_of(*ANGLES)
    turned = Rotation.from_euler("ZYX", ANGLES[::-1].T)
    np.testing.assert_allclose(
        found, turned.as_quat() * np.sign(np.sum(found * turned.as_quat(), 1))[:, None], atol=1e-14
    )
    np.testing.assert_allclose(np.array(angles_of(found.T)), ANGLES, atol=1e-12)
    vector = np.array([0.3, -1.0, 2.0])
    roll, pitch, yaw = ANGLES
    np.testing.assert_allclose(in_world(roll, pitch, yaw, vector), Rotation.from_quat(found).apply(vector), atol=1e-14)
