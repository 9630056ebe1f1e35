"""Rotations of the front frame and the orders that sensors count in; x forward, y left, z up."""

from __future__ import annotations

import math

from aoro_gym.execution.array_api import Array, floats, namespace


def in_world(roll: Array, pitch: Array, yaw: Array, vector: Array) -> Array:
    """Vectors of the front frame's axes in the world's, (..., 3).

    R = R_z(yaw) R_y(pitch) R_x(roll), as the twin's outputs of these names.

    Args:
        roll: [rad] (N,), positive where the left side is up; or (...).
        pitch: [rad], positive where the nose is down; likewise.
        yaw: Heading [rad], likewise.
        vector: (3,) or (..., 3), which broadcasts with them.
    """
    roll, pitch, yaw, vector = floats(roll), floats(pitch), floats(yaw), floats(vector)
    xp = namespace(roll, vector)
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    s, c = xp.sin(roll), xp.cos(roll)
    y, z = c * y - s * z, s * y + c * z
    s, c = xp.sin(pitch), xp.cos(pitch)
    x, z = c * x + s * z, c * z - s * x
    s, c = xp.sin(yaw), xp.cos(yaw)
    x, y = c * x - s * y, s * x + c * y
    return xp.stack([x, y, xp.broadcast_to(z, x.shape)], axis=-1)


def wrapped(angle: Array) -> Array:
    """``angle`` [rad] in [−π, π)."""
    return (floats(angle) + math.pi) % (2.0 * math.pi) - math.pi


def angles_of(quaternion: Array) -> tuple[Array, Array, Array]:
    """Roll, pitch and yaw [rad] (N,) of unit quaternions x, y, z, w (4, N) from the frame's axes to the world's."""
    xp = namespace(quaternion)
    x, y, z, w = floats(quaternion)
    roll = xp.atan2(2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y))
    pitch = -xp.asin(xp.clip(2.0 * (x * z - w * y), -1.0, 1.0))
    yaw = xp.atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
    return roll, pitch, yaw


def quaternion_of(roll: Array, pitch: Array, yaw: Array) -> Array:
    """Unit quaternions x, y, z, w (..., 4) of R_z(yaw) R_y(pitch) R_x(roll), angles [rad] of one shape (...): what
    :func:`angles_of` takes apart."""
    roll, pitch, yaw = (0.5 * floats(angle) for angle in (roll, pitch, yaw))
    xp = namespace(roll)
    (sr, sp, sy), (cr, cp, cy) = ([f(angle) for angle in (roll, pitch, yaw)] for f in (xp.sin, xp.cos))
    return xp.stack(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ],
        axis=-1,
    )
