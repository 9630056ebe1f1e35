"""The camera that follows the machine, the sun, and the haze between."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from aoro_gym.machine.solid import Points

BEHIND, ASIDE, ABOVE, AIM = 8.6, 4.4, 4.6, (2.0, 0.8)
"""The camera [m]: behind the hinge, right of it, above the ground there; the point that it looks at, ahead and above."""
FOCAL = 1.12
"""Of the camera, in half widths of the picture."""
FAR = 120.0
HAZE = np.array([0.84, 0.88, 0.88])
SUN = np.array([-0.45, 0.35, 0.82]) / math.sqrt(0.45**2 + 0.35**2 + 0.82**2)
"""Direction to the sun in the world."""


class Camera:
    """A pinhole that looks from a point at another."""

    def __init__(self, eye: Points, target: Points):
        self.eye = eye
        forward = (target - eye) / np.linalg.norm(target - eye)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        self._axes = np.stack([right, np.cross(right, forward), forward])
        self.heading = math.atan2(forward[1], forward[0])

    def seen(self, points: Points) -> tuple[Points, Points]:
        """Places in the picture (..., 2), right and up in half widths, and depths [m] (...)."""
        local = (points - self.eye) @ self._axes.T
        depth = local[..., 2]
        return FOCAL * local[..., :2] / np.maximum(depth, 0.3)[..., None], depth

    @classmethod
    def following(cls, origin: Points, heading: float, height: Any) -> Camera:
        """The camera behind a machine.

        Args:
            origin: The machine's hinge (3,) [m].
            heading: The machine's [rad].
            height: Of the ground [m] (N,) at places (N, 2).
        """
        ahead = np.array([math.cos(heading), math.sin(heading)])
        eye = origin[:2] - BEHIND * ahead + ASIDE * np.array([ahead[1], -ahead[0]])
        floor = float(height(eye[None])[0])
        target = np.array([*(origin[:2] + AIM[0] * ahead), origin[2] + AIM[1]])
        return cls(np.array([*eye, max(floor, origin[2] - 0.8) + ABOVE]), target)

    def horizon(self) -> float:
        """Its place in the picture, up."""
        far = self.eye + 1e4 * np.array([math.cos(self.heading), math.sin(self.heading), 0.0])
        return self.seen(far)[0][1]


def hazed(colour: Points, distance: Any) -> Points:
    """A colour (3,) or colours (N, 3) at a distance [m], () or (N, 1)."""
    return colour + (HAZE - colour) * np.minimum(distance / FAR, 1.0) ** 0.8
