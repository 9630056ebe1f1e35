"""Rotations of the front frame: :mod:`aoro_gym.sensors.attitude` for one twin."""

import math

import warp as wp

PI = wp.constant(wp.float64(math.pi))
TAU = wp.constant(wp.float64(2.0 * math.pi))


@wp.func
def in_world(roll: wp.float64, pitch: wp.float64, yaw: wp.float64, vector: wp.vec3d):
    """A vector of the front frame's axes in the world's."""
    s = wp.sin(roll)
    c = wp.cos(roll)
    y = c * vector[1] - s * vector[2]
    z = s * vector[1] + c * vector[2]
    s = wp.sin(pitch)
    c = wp.cos(pitch)
    x = c * vector[0] + s * z
    z = c * z - s * vector[0]
    s = wp.sin(yaw)
    c = wp.cos(yaw)
    return wp.vec3d(c * x - s * y, s * x + c * y, z)


@wp.func
def wrapped(angle: wp.float64):
    """An angle [rad] in [−π, π)."""
    turned = wp.mod(angle + PI, TAU)
    if turned < wp.float64(0.0):
        turned += TAU
    return turned - PI
