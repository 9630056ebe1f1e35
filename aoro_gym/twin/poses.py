"""Where a twin is, by its state."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from aoro_gym.machine.kinematics import Pose
from aoro_gym.twin.records import State


def pose_of_state(state: ArrayLike) -> Pose:
    """Pose of one twin by its column of :attr:`aoro_gym.twin.Twin.state`."""
    s = np.asarray(state, dtype=np.float64)
    q = s[[State["QW"], State["QX"], State["QY"], State["QZ"]]]
    arms, wheels = (tuple(s[State[f"{name}_FL"] : State[f"{name}_FL"] + 4].tolist()) for name in ("ARM", "WHEEL"))
    return Pose(s[State["X"] : State["X"] + 3], q / np.linalg.norm(q), float(s[State["JOINT"]]), arms, wheels)
