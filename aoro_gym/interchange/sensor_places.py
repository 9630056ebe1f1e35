"""Where the twin's sensors sit, for other simulators."""

from __future__ import annotations

import numpy as np

from aoro_gym.machine.rigid_bodies import Vector
from aoro_gym.sensors.gps import Antennas


def sensor_places() -> dict[str, Vector]:
    """Places [m] of the twin's sensors on the front frame, by name."""
    antennas = Antennas()
    return {
        "gps_main": np.array(antennas.main),
        "gps_auxiliary": np.array(antennas.auxiliary),
        "imu": np.zeros(3),  # where the environments read it, the origin of the twin's position
    }
