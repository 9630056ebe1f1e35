"""Dead reckoning between the solutions of the GPS: :mod:`aoro_gym.sensors.localisation` for one twin."""

import numpy as np
import warp as wp

from aoro_gym.execution.array_api import Arrays
from aoro_gym.sensors.kernels.attitude import in_world, wrapped
from aoro_gym.sensors.kernels.gps import Solution
from aoro_gym.sensors.localisation import Localisation

HALF = wp.constant(wp.float64(0.5))


@wp.struct
class LocalisationMemory:
    """Of N twins."""

    antenna: wp.vec3d  # [m]
    gains: wp.vec3d  # by quality
    position: wp.array2d(dtype=wp.float64)  # (N, 2) [m]
    heading: wp.array(dtype=wp.float64)  # (N,) [rad]


def localisation_memory(localisation: Localisation, arrays: Arrays) -> LocalisationMemory:
    """The memory of ``localisation``, shared."""
    out = LocalisationMemory()
    for name in ("antenna", "gains"):
        values = np.ravel(arrays.host(getattr(localisation, f"_{name}")))
        setattr(out, name, wp.vec3d(*(float(value) for value in values)))
    out.position, out.heading = arrays.shared(localisation.position), arrays.shared(localisation.heading)
    return out


@wp.func
def begin_at(m: LocalisationMemory, i: int, gps: Solution, roll: wp.float64, pitch: wp.float64, place: wp.vec3d):
    """Take the first solution of twin ``i`` as it is."""
    then = gps.position + in_world(roll, pitch, gps.heading, place - m.antenna)
    m.position[i, 0] = then[0]
    m.position[i, 1] = then[1]
    m.heading[i] = gps.heading


@wp.func
def locate(
    m: LocalisationMemory,
    i: int,
    gps: Solution,
    roll: wp.float64,
    pitch: wp.float64,
    place: wp.vec3d,
    speed: wp.float64,
    yaw_rate: wp.float64,
    step: wp.float64,
):
    """Move the pose of twin ``i`` on by ``step`` [s], and toward a fresh solution."""
    direction = m.heading[i] + HALF * step * yaw_rate
    x = m.position[i, 0] + step * speed * wp.cos(direction)
    y = m.position[i, 1] + step * speed * wp.sin(direction)
    heading = m.heading[i] + step * yaw_rate
    gain = wp.float64(0.0)
    if gps.fresh:
        gain = m.gains[int(gps.quality)]
    turned = yaw_rate * gps.age
    then = gps.position + in_world(roll, pitch, gps.heading, place - m.antenna)
    direction = gps.heading + HALF * turned
    way = speed * gps.age
    m.position[i, 0] = x + gain * (then[0] + way * wp.cos(direction) - x)
    m.position[i, 1] = y + gain * (then[1] + way * wp.sin(direction) - y)
    m.heading[i] = wrapped(heading + gain * wrapped(gps.heading + turned - heading))
