"""The joint as a controller knows it: measured angles, and the rate that the last of them show."""

from __future__ import annotations

import numpy as np

from aoro_gym.execution.array_api import HOST, Array, Arrays, Index
from aoro_gym.execution.streams import Generators
from aoro_gym.sensors import JointAngleNoise, JointAngleSensor
from aoro_gym.sensors.joint_angle import slope_weights


class MeasuredJoint:
    """The joint-angle sensors of N sub-environments, with their last samples.

    Args:
        num_envs: How many.
        noise: Of the sensors.
        interval: Time [s] between two samples.
        frames: Samples a control step.
        kept: How many the estimate of the rate takes its slope from.
        arrays: Where they live.
    """

    def __init__(
        self, num_envs: int, noise: JointAngleNoise, *, interval: float, frames: int, kept: int, arrays: Arrays = HOST
    ):
        self.scale = arrays.ones(num_envs)
        """Multiplier (N,) of the noise."""
        self._xp = arrays.xp
        self._sensor = JointAngleSensor(num_envs, noise, interval=interval, arrays=arrays)
        self._ages = arrays.asarray(interval * np.arange(frames)[::-1, None])  # [s]
        self._weights = slope_weights(kept, interval)
        self._angles = arrays.zeros((kept, num_envs))  # newest first

    def reset(self, rows: Index, generators: Generators) -> None:
        """New runs of the sensors ``rows`` (K,), from one generator each."""
        self._sensor.reset(rows, generators)

    def begin(self, angle: Array, where: Index) -> None:
        """The sub-environments ``where`` (K,) rest at ``angle`` [rad] (K,)."""
        shown = self._sensor.measure(angle, 0.0, where)
        self._angles[:, where] = angle + self.scale[where] * (shown - angle)

    def update(self, angles: Array, time: Array) -> None:
        """Take in the true ``angles`` [rad] (frames, N) of a control step that ended at ``time`` [s] (N,)."""
        xp = self._xp
        fresh = angles + self.scale * (self._sensor.measure(angles, time - self._ages) - angles)
        self._angles = xp.concat([xp.flip(fresh, axis=0), self._angles])[: len(self._angles)]

    @property
    def angle(self) -> Array:
        """The last measured angle [rad] (N,)."""
        return self._angles[0]

    @property
    def rate(self) -> Array:
        """Slope of the line through the last measured angles [rad/s] (N,)."""
        # one by one: the order of the sum, and so its rounding, does not depend on the number of sub-environments
        rate = self._weights[0] * self._angles[0]
        for weight, angle in zip(self._weights[1:], self._angles[1:], strict=True):
            rate = rate + weight * angle
        return rate
