"""Where the machine is, as its controller knows it: dead reckoning between the solutions of the GPS.

A tracking script needs the pose of a point of the machine now, not that of an antenna a tenth of a second ago. This is
the plain way to get it: wheel speeds and yaw rate move the pose on, and every solution of the GPS, brought down from the
antenna by roll and pitch and forward in time by its age, pulls it back by a constant gain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.sensors.attitude import in_world, wrapped
from aoro_gym.sensors.gps import FIXED, FLOAT, Antennas, GpsReading
from aoro_gym.sensors.noise import chosen_rows


@dataclass(frozen=True)
class LocalisationGains:
    """Share [-] of the difference to a solution that is taken over, by its quality."""

    fixed: float = 0.4
    floating: float = 0.02

    def __post_init__(self) -> None:
        for name in ("fixed", "floating"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name} is {getattr(self, name)}, but must be in [0, 1]")


class Localisation:
    """Estimated plan pose of a point of the front frame, for N twins.

    The point is taken to move along the front frame's heading, as the middle of the front axle does without slip.

    Args:
        num_twins: How many.
        antennas: Where the antennas stand, as the controller was told.
        gains: How much a solution counts.
    """

    def __init__(self, num_twins: int = 1, *, antennas: Antennas | None = None, gains: LocalisationGains | None = None):
        self.num_twins = num_twins
        self._antennas = Antennas() if antennas is None else antennas
        self._gains = LocalisationGains() if gains is None else gains
        self.position = np.zeros((num_twins, 2))
        """[m] (N, 2)"""
        self.heading = np.zeros(num_twins)
        """[rad] (N,), in [−π, π)"""

    def begin(self, gps: GpsReading, roll: ArrayLike, pitch: ArrayLike, place: ArrayLike, indices: ArrayLike) -> None:
        """Take the first solutions as they are, for the twins ``indices`` (K,); arguments as in :meth:`update`."""
        rows = chosen_rows(indices, self.num_twins)
        self.position[rows] = self._brought_down(gps, roll, pitch, place)
        self.heading[rows] = gps.heading

    def update(
        self,
        gps: GpsReading,
        roll: ArrayLike,
        pitch: ArrayLike,
        place: ArrayLike,
        *,
        speed: ArrayLike,
        yaw_rate: ArrayLike,
        step: float,
    ) -> None:
        """Move all poses on by ``step`` [s], and toward fresh solutions.

        Args:
            gps: The receivers' readings (N).
            roll: Measured [rad] (N,).
            pitch: Measured [rad] (N,).
            place: The point in the front frame's axes [m] (3,) or (N, 3).
            speed: Measured over ground [m/s] (N,).
            yaw_rate: Measured [rad/s] (N,).
            step: Time [s] since the last call.
        """
        speed, rate = np.asarray(speed, dtype=np.float64), np.asarray(yaw_rate, dtype=np.float64)
        self._move(speed, rate, step)
        gain = np.where(gps.quality == FIXED, self._gains.fixed, self._gains.floating) * (gps.quality >= FLOAT)
        gain = np.where(gps.fresh, gain, 0.0)
        # the solution's pose, moved on by its age
        turned = rate * gps.age
        then = self._brought_down(gps, roll, pitch, place)
        direction = gps.heading + 0.5 * turned
        then = then + (speed * gps.age)[:, None] * np.stack([np.cos(direction), np.sin(direction)], axis=1)
        self.position = self.position + gain[:, None] * (then - self.position)
        self.heading = wrapped(self.heading + gain * wrapped(gps.heading + turned - self.heading))

    def _move(self, speed: NDArray[np.float64], rate: NDArray[np.float64], step: float) -> None:
        direction = self.heading + 0.5 * step * rate
        self.position = self.position + (step * speed)[:, None] * np.stack([np.cos(direction), np.sin(direction)], 1)
        self.heading = self.heading + step * rate

    def _brought_down(
        self, gps: GpsReading, roll: ArrayLike, pitch: ArrayLike, place: ArrayLike
    ) -> NDArray[np.float64]:
        lever = np.asarray(place, dtype=np.float64) - np.asarray(self._antennas.main)
        return gps.position[:, :2] + in_world(roll, pitch, gps.heading, lever)[:, :2]
