"""Measures of the machine that its controllers know."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aoro_gym.envs.path_tracking.assistance import MachineDimensions
from aoro_gym.execution.array_api import Array, Arrays
from aoro_gym.machine import Machine


class Measures:
    """Of N machines, each (N,) SI."""

    def __init__(self, num_envs: int, arrays: Arrays):
        n, self._arrays = num_envs, arrays
        self.front, self.rear, self.half_track = arrays.ones(n), arrays.ones(n), arrays.ones(n)
        """From the hinge to the axles, and from the middle to a wheel [m]."""
        self.rolling_radius, self.top_speed = arrays.ones(n), arrays.ones(n)
        """Of the wheels [m]; in the first gear [m/s]."""
        self.rod_share = arrays.ones(n)
        """Area at the rod's end of an arm's cylinder over that at the bore's [-]."""
        self._arm_length, self._arm_dead_band = arrays.ones(n), arrays.zeros(n)
        self._arm_rest = arrays.zeros((4, n))

    def take(self, machine: Machine, where: NDArray[np.intp]) -> None:
        """Take over those of a machine for the sub-environments ``where`` (K,)."""
        arrays, rows, driveline, tire = self._arrays, self._arrays.index(where), machine.driveline, machine.tire
        radius = tire.radius  # the rims of the twin's discs roll where the ground is pressed in: calibrated, as it were
        flow = driveline.pump.displacement * machine.engine.set_speed
        for state, value in (
            (self.front, machine.frame.front.axle_distance),
            (self.rear, machine.frame.rear.axle_distance),
            (self.half_track, 0.5 * machine.frame.track),
            (self.rolling_radius, radius),
            (self.top_speed, flow / (4.0 * driveline.motor.displacement) * radius),
            (self._arm_length, machine.arm.length),
            (self._arm_dead_band, machine.arm.valve.dead_band),
            (self.rod_share, machine.arm.cylinder.annulus_area / machine.arm.cylinder.bore_area),
        ):
            arrays.put(state, rows, value)
        front, rear = np.broadcast_arrays(machine.rest.arm_angle_front, machine.rest.arm_angle_rear)
        arrays.put(self._arm_rest, (slice(None), rows), np.stack([front, front, rear, rear]).reshape(4, -1))

    @property
    def reference(self) -> Array:
        """The reference point in the front frame's axes [m] (N, 3)."""
        zero = self._arrays.xp.zeros_like(self.front)
        return self._arrays.xp.stack([self.front, zero, zero], axis=1)

    @property
    def stance(self) -> MachineDimensions:
        """Those that the arms' controller takes."""
        return MachineDimensions(
            self.front, self.rear, self.half_track, self._arm_length, self._arm_rest, self._arm_dead_band
        )
