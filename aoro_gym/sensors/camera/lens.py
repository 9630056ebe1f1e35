"""Intrinsics of a camera, with the lens distortion of Brown (1966) and Conrady (1919), as OpenCV counts them.

Axes: x right, y down, z ahead; the middle of the first pixel is at (0, 0).

>>> lens = Intrinsics.of_view(640, 480, 70.0)
>>> round(lens.focal[0], 1), lens.project([[1.0, 0.0, 2.0]])[0].round(1).tolist()
(457.0, [548.0, 239.5])
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from aoro_gym.checks import check_finite, check_integer, check_range
from aoro_gym.sensors.camera.kernels.lens import Lens

MOST_PIXELS = 8192
"""Of a row and of a column."""
MARGIN = 1.1
"""How much farther than its corner a picture must still be drawn one to one: flow looks beyond its edges. (E)"""


@dataclass(frozen=True)
class Intrinsics:
    """Width and height, focal lengths, principal point and distortion. Raises ``ValueError`` naming the field."""

    width: int
    """[pixels]"""
    height: int
    focal: tuple[float, float]
    """fx, fy [pixels]."""
    centre: tuple[float, float]
    """cx, cy [pixels]."""
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    """k1, k2, p1, p2, k3 [-], in the order of OpenCV and of ROS' plumb_bob."""

    def __post_init__(self) -> None:
        check_integer("width", self.width, ge=2, le=MOST_PIXELS)
        check_integer("height", self.height, ge=2, le=MOST_PIXELS)
        for name, count in (("focal", 2), ("centre", 2), ("distortion", 5)):
            check_finite(name, getattr(self, name))
            if len(getattr(self, name)) != count:
                raise ValueError(f"{name} has {len(getattr(self, name))} numbers, but must have {count}")
        check_range("focal", self.focal, "pixels", gt=0.0, lt=1e6)
        self._check_one_to_one()

    @classmethod
    def of_view(cls, width: int, height: int, across_deg: float, **others: Any) -> Intrinsics:
        """A lens in the middle of its sensor, that would see ``across_deg`` [deg] from left to right without distortion."""
        check_range("across_deg", across_deg, "deg", gt=1.0, lt=170.0)
        focal = 0.5 * width / math.tan(math.radians(0.5 * across_deg))
        return cls(width, height, (focal, focal), (0.5 * (width - 1), 0.5 * (height - 1)), **others)

    def scaled(self, share: float) -> Intrinsics:
        """The same view by ``share`` times as many pixels a side: corners stay corners."""
        width, height = round(self.width * share), round(self.height * share)
        x, y = width / self.width, height / self.height
        (fx, fy), (cx, cy) = self.focal, self.centre
        centre = (x * (cx + 0.5) - 0.5, y * (cy + 0.5) - 0.5)
        return Intrinsics(width, height, (x * fx, y * fy), centre, self.distortion)

    @property
    def matrix(self) -> NDArray[np.float64]:
        """(3, 3) intrinsic matrix [pixels]."""
        (fx, fy), (cx, cy) = self.focal, self.centre
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """(N, 2) pixels at which points (N, 3) [m] ahead of the camera, in its axes, are drawn."""
        p = np.asarray(points, dtype=np.float64)
        x, y = p[:, 0] / p[:, 2], p[:, 1] / p[:, 2]
        k1, k2, p1, p2, k3 = self.distortion
        s = x * x + y * y
        scale = 1.0 + s * (k1 + s * (k2 + s * k3))
        drawn = np.stack(
            [
                x * scale + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x),
                y * scale + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y,
            ],
            axis=1,
        )
        return drawn * self.focal + self.centre

    def unproject(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """(N, 3) points at depth 1, in the camera's axes, that are drawn at ``pixels`` (N, 2), by fixed-point steps."""
        drawn = (np.asarray(pixels, dtype=np.float64) - self.centre) / self.focal
        k1, k2, p1, p2, k3 = self.distortion
        point = drawn
        rounds = 60 if any(self.distortion) else 0
        for _ in range(rounds):  # each takes off more than half of the error of the strongest lens that does not fold
            x, y = point.T
            s = x * x + y * y
            scale = 1.0 + s * (k1 + s * (k2 + s * k3))
            shift = np.column_stack(
                [2.0 * p1 * x * y + p2 * (s + 2.0 * x * x), p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y]
            )
            point = (drawn - shift) / scale[:, None]
        return np.column_stack([point, np.ones(len(point))])

    def on_device(self) -> Any:
        """As device code has it."""
        lens: Any = Lens()
        k1, k2, p1, p2, k3 = map(float, self.distortion)
        lens.width, lens.height = self.width, self.height
        lens.focal, lens.centre = wp.vec2(*map(float, self.focal)), wp.vec2(*map(float, self.centre))
        lens.radial, lens.tangential = wp.vec3(k1, k2, k3), wp.vec2(p1, p2)
        return lens

    def _check_one_to_one(self) -> None:
        """ValueError where the drawn radius does not grow with the true one as far as the corners."""
        k1, k2, _, _, k3 = self.distortion
        (fx, fy), (cx, cy) = self.focal, self.centre
        far = max(math.hypot((u - cx) / fx, (v - cy) / fy) for u in (0, self.width) for v in (0, self.height))
        radius: Any = np.linspace(0.0, 20.0 * MARGIN * far, 20001)
        s = radius**2
        falling = 1.0 + s * (3.0 * k1 + s * (5.0 * k2 + 7.0 * s * k3)) <= 0.0
        ends = int(np.argmax(falling)) if falling.any() else len(radius) - 1
        drawn = float(radius[ends] * (1.0 + s[ends] * (k1 + s[ends] * (k2 + s[ends] * k3))))
        if drawn < MARGIN * far:
            raise ValueError(
                f"distortion {self.distortion} folds the picture: it draws nothing farther than {drawn:.3f} from the axis,"
                f" but the corners are at {far:.3f}; take weaker coefficients, or a longer focal length"
            )
