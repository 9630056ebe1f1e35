"""Courses that the tests of path tracking share: level ground, and paths with a closed form."""

import numpy as np

from aoro_gym.envs.path_tracking.courses import Course
from aoro_gym.terrains import Path, Plane

LINE = Path(np.stack([np.arange(0.0, 41.0), np.zeros(41)], axis=1), name="line")
"""Along x, 40 m."""


def arc(radius, turn, *, count=80):
    """From the origin along x, then to the left by ``turn`` [rad] on a circle."""
    angle = np.linspace(0.0, turn, count)
    return Path(radius * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=1), name="arc")


def circle(radius, *, count=160):
    """Closed, counter-clockwise, from the origin along x."""
    angle = 2.0 * np.pi * np.arange(count) / count
    return Path(radius * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=1), closed=True, name="circle")


LEVEL = Course(Plane(), (LINE, arc(10.0, 2.5)), name="level")
