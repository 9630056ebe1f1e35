"""Where a twin is, by its state."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.machine.kinematics import CranePose, Pose
from aoro_gym.machine.vehicle_crane import VehicleCrane, size_of_log
from aoro_gym.twin.records import CraneRow, State


def pose_of_state(state: ArrayLike, crane: VehicleCrane | None = None) -> Pose:
    """Pose of one twin by its column of :attr:`aoro_gym.twin.Twin.state`, and of its ``crane``, if it has one."""
    s = np.asarray(state, dtype=np.float64)
    q = s[[State["QW"], State["QX"], State["QY"], State["QZ"]]]
    arms, wheels = (tuple(s[State[f"{name}_FL"] : State[f"{name}_FL"] + 4].tolist()) for name in ("ARM", "WHEEL"))
    at = s[State["X"] : State["X"] + 3], q / np.linalg.norm(q), float(s[State["JOINT"]]), arms, wheels
    return Pose(*at, None if crane is None else _crane_pose(s, crane))


def _crane_pose(state: NDArray[np.float64], crane: VehicleCrane) -> CranePose:
    first = int(CraneRow["JOINT_SLEW"])
    mass, yaw, axial, transverse = (float(one) for one in state[int(CraneRow["HELD_MASS"]) :][:4])
    return CranePose(crane, tuple(state[first : first + 4].tolist()), yaw, size_of_log(mass, axial, transverse))
