"""The machine that carries the camera: not in view, but in the way of light, so that its shadow is."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from aoro_gym.machine import Machine
from aoro_gym.machine.kinematics import Kinematics
from aoro_gym.machine.solids import COLOURS, machine_solids
from aoro_gym.sensors.raytrace import Body

Array = NDArray[np.float64]
POSTURE = 9
"""Numbers of a posture: joint, four arms and four wheels [rad], as :class:`~aoro_gym.machine.kinematics.Pose` has them."""


class Carrier:
    """Its parts, each of the colour of most of its surface: light that bounces off them is (E) in that."""

    def __init__(self) -> None:
        machine = Machine.load("aoro")
        self._kinematics = Kinematics(machine)
        self._parts = {name: solid.triangles() for name, solid in machine_solids(machine).items()}
        front, rear = float(machine.rest.arm_angle_front), float(machine.rest.arm_angle_rear)
        self.rest: Array = np.array([0.0, front, front, rear, rear, 0.0, 0.0, 0.0, 0.0])
        """(9,) posture at rest, unbent."""
        known = np.array(list(COLOURS.values()))
        self._colours = [_commonest(*triangles, known) for triangles in self._parts.values()]

    def __len__(self) -> int:
        return len(self._parts)

    def bodies(self, instance: int, first_class: int, world: int) -> list[Body]:
        """What rays meet in a world.

        Args:
            instance: Of all of it.
            first_class: Class of the first of :data:`~aoro_gym.machine.solids.COLOURS`.
            world: The rays'.
        """
        return [
            Body("mesh", instance, first_class + colour, vertices=points, faces=faces, world=world)
            for (points, faces, _), colour in zip(self._parts.values(), self._colours, strict=True)
        ]

    def poses(self, front: Array, posture: Array) -> Array:
        """(P, 7) x, y, z [m] and quaternion x, y, z, w of all parts in the world's axes.

        Args:
            front: (4, 4) from the front frame's axes to the world's.
            posture: (9,) [rad].
        """
        placed = self._kinematics.placed(float(posture[0]), tuple(posture[1:5]), tuple(posture[5:9]))
        turn, out = Rotation.from_matrix(front[:3, :3]), []
        for name in self._parts:
            origin, wxyz = placed[name]
            own = turn * Rotation.from_quat(wxyz, scalar_first=True)
            out.append([*(front[:3, :3] @ origin + front[:3, 3]), *own.as_quat()])
        return np.array(out)


@cache
def carrier() -> Carrier:
    """The one of all data sets."""
    return Carrier()


def _commonest(points: Array, faces: NDArray[np.int64], shades: Array, known: Array) -> int:
    """Number of the colour of most of a part's surface."""
    a, b, c = np.moveaxis(points[faces], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    number = np.argmin(np.abs(shades[faces[:, 0]][:, None] - known[None]).sum(axis=2), axis=1)
    return int(np.argmax(np.bincount(number, weights=area, minlength=len(known))))
