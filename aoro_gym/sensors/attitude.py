"""Rotations of the front frame and the orders that sensors count in; x forward, y left, z up."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def in_world(roll: ArrayLike, pitch: ArrayLike, yaw: ArrayLike, vector: ArrayLike) -> NDArray[np.float64]:
    """A vector of the front frame's axes in the world's, shape (N, 3).

    R = R_z(yaw) R_y(pitch) R_x(roll), as the twin's outputs of these names.

    Args:
        roll: [rad] (N,), positive where the left side is up.
        pitch: [rad] (N,), positive where the nose is down.
        yaw: Heading [rad] (N,).
        vector: (3,) or (N, 3).
    """
    x, y, z = np.moveaxis(np.asarray(vector, dtype=np.float64), -1, 0)
    s, c = np.sin(roll), np.cos(roll)
    y, z = c * y - s * z, s * y + c * z
    s, c = np.sin(pitch), np.cos(pitch)
    x, z = c * x + s * z, c * z - s * x
    s, c = np.sin(yaw), np.cos(yaw)
    return np.stack(np.broadcast_arrays(c * x - s * y, s * x + c * y, z), axis=-1)


def wrapped(angle: ArrayLike) -> NDArray[np.float64]:
    """``angle`` [rad] in [−π, π)."""
    return (np.asarray(angle, dtype=np.float64) + np.pi) % (2.0 * np.pi) - np.pi


def angles_of(quaternion: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Roll, pitch and yaw [rad] (N,) of unit quaternions x, y, z, w (4, N) from the frame's axes to the world's."""
    x, y, z, w = np.asarray(quaternion, dtype=np.float64)
    roll = np.arctan2(2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y))
    pitch = -np.arcsin(np.clip(2.0 * (x * z - w * y), -1.0, 1.0))
    yaw = np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
    return roll, pitch, yaw
