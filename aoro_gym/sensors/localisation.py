"""Where the machine is, as its controller knows it: dead reckoning between the solutions of the GPS.

A tracking script needs the pose of a point of the machine now, not that of an antenna a tenth of a second ago. This is
the plain way to get it: wheel speeds and yaw rate move the pose on, and every solution of the GPS, brought down from the
antenna by roll and pitch and forward in time by its age, pulls it back by a constant gain.
"""

from __future__ import annotations

from dataclasses import dataclass

from aoro_gym.checks import check_range
from aoro_gym.execution.array_api import HOST, Array, Arrays, Index, floats
from aoro_gym.sensors.attitude import in_world, wrapped
from aoro_gym.sensors.gps import Antennas, GpsReading
from aoro_gym.sensors.noise import chosen_rows


@dataclass(frozen=True)
class LocalisationGains:
    """Share [-] of the difference to a solution that is taken over, by its quality."""

    fixed: float = 0.4
    floating: float = 0.02

    def __post_init__(self) -> None:
        for name in ("fixed", "floating"):
            check_range(name, getattr(self, name), ge=0.0, le=1.0)


class Localisation:
    """Estimated plan pose of a point of the front frame, for N twins.

    The point is taken to move along the front frame's heading, as the middle of the front axle does without slip.

    Args:
        num_twins: How many.
        antennas: Where the antennas stand, as the controller was told.
        gains: How much a solution counts.
        arrays: Where they live.
    """

    def __init__(
        self,
        num_twins: int = 1,
        *,
        antennas: Antennas | None = None,
        gains: LocalisationGains | None = None,
        arrays: Arrays = HOST,
    ):
        self.num_twins = num_twins
        self._arrays = arrays
        self._antenna = arrays.asarray((Antennas() if antennas is None else antennas).main)
        gains = LocalisationGains() if gains is None else gains
        self._gains = arrays.asarray([0.0, gains.floating, gains.fixed])  # by quality
        self.position = arrays.zeros((num_twins, 2))
        """[m] (N, 2)"""
        self.heading = arrays.zeros(num_twins)
        """[rad] (N,), in [−π, π)"""

    def begin(
        self,
        gps: GpsReading,
        roll: Array,
        pitch: Array,
        place: Array,
        indices: Index,
    ) -> None:
        """Take the first solutions as they are, for the twins ``indices`` (K,); arguments as in :meth:`update`.

        Args:
            gps: Solutions (K,) of the receiver.
            roll: Measured roll (K,) [rad].
            pitch: Measured pitch (K,) [rad].
            place: The point in the front frame's axes [m] (3,) or (K, 3).
            indices: The twins.
        """
        rows, _ = chosen_rows(indices, self.num_twins, self._arrays)
        self.position[rows] = self._brought_down(gps, roll, pitch, place)
        self.heading[rows] = gps.heading

    def update(
        self,
        gps: GpsReading,
        roll: Array,
        pitch: Array,
        place: Array,
        *,
        speed: Array,
        yaw_rate: Array,
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
        xp, speed, rate = self._arrays.xp, floats(speed), floats(yaw_rate)
        self._move(speed, rate, step)
        gain = xp.where(gps.fresh, self._gains[gps.quality], 0.0)
        # the solution's pose, moved on by its age
        turned = rate * gps.age
        then = self._brought_down(gps, roll, pitch, place)
        direction = gps.heading + 0.5 * turned
        then = then + (speed * gps.age)[:, None] * xp.stack([xp.cos(direction), xp.sin(direction)], axis=1)
        self.position = self.position + gain[:, None] * (then - self.position)
        self.heading = wrapped(self.heading + gain * wrapped(gps.heading + turned - self.heading))

    def _move(self, speed: Array, rate: Array, step: float) -> None:
        xp, direction = self._arrays.xp, self.heading + 0.5 * step * rate
        self.position = self.position + (step * speed)[:, None] * xp.stack(
            [xp.cos(direction), xp.sin(direction)], axis=1
        )
        self.heading = self.heading + step * rate

    def _brought_down(self, gps: GpsReading, roll: Array, pitch: Array, place: Array) -> Array:
        lever = floats(place) - self._antenna
        return gps.position[:, :2] + in_world(roll, pitch, gps.heading, lever)[:, :2]
