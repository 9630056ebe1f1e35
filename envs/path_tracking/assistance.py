"""Small controllers between a task's action and the machine: gear, traction valves, pendulum arms.

None is published for the machine: they are ours, plain ones, on what the machine measures. Without the last two it does
not get far off the road: four wheels on held arms are a table with four legs, of which two carry the weight wherever the
ground is twisted, and through an open differential the oil goes to a wheel that hangs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aoro_gym.checks import check_range
from aoro_gym.execution.array_api import HOST, Array, Arrays, Index, namespace

GEAR_DISPLACEMENT = (1.0, 0.75, 0.5)
"""Displacement of all motors in gears 1, 2 and 3, as a share of the full one: half on one axle, then on both."""


@dataclass(frozen=True)
class GearShift:
    """When to shift. A gear is left upward near its top speed with pressure to spare, downward under load or when slow:
    with hysteresis in speed, in pressure and in time."""

    up_speed: float = 0.85
    """Share [-] of a gear's top speed from which the next one may come, with nearly full drive signal."""
    up_signal: float = 0.9
    """Drive signal [-] that this needs."""
    up_pressure: float = 180e5
    """Largest pressure difference [Pa] that the next gear would need: the present one times the displacements' ratio."""
    down_speed: float = 0.55
    """Share [-] of the lower gear's top speed below which it comes back."""
    down_pressure: float = 260e5
    """Pressure difference [Pa] above which it does."""
    hold: float = 1.5
    """Shortest time [s] in a gear."""

    def __post_init__(self) -> None:
        check_range("up_speed", self.up_speed, gt=0.0, le=1.0)
        check_range("down_speed", self.down_speed, gt=0.0, lt=self.up_speed, note=", below up_speed")
        check_range("up_pressure", self.up_pressure, "Pa", gt=0.0, lt=self.down_pressure, note=", below down_pressure")
        check_range("up_signal", self.up_signal, gt=0.0, le=1.0)
        check_range("hold", self.hold, "s", ge=0.0)


class AutomaticGear:
    """Gears of N machines.

    Args:
        num_envs: N.
        shift: When to shift.
        arrays: Where they live.
    """

    def __init__(self, num_envs: int, shift: GearShift | None = None, arrays: Arrays = HOST):
        self._shift = GearShift() if shift is None else shift
        self._arrays = arrays
        self._share = arrays.asarray(GEAR_DISPLACEMENT)
        self.gear = arrays.ones(num_envs)
        """1, 2 or 3 (N,)."""
        self._held = arrays.zeros(num_envs)  # [s]

    def reset(self, where: Index, gear: float = 1.0) -> None:
        """``gear`` for the sub-environments ``where``."""
        self._arrays.put(self.gear, where, gear)
        self._arrays.put(self._held, where, 0.0)

    def update(self, drive_signal: Array, speed: Array, pressure: Array, top_speed: Array, step: float) -> Array:
        """Gears (N,) for the next ``step`` [s].

        Args:
            drive_signal: Of the last step (N,).
            speed: Measured [m/s] (N,).
            pressure: Measured between the two sides of the loop [Pa] (N,).
            top_speed: Of first gear [m/s] (N,): that of the pump's full flow through the full displacement.
            step: Time [s] since the last call.
        """
        xp, shift, share = self._arrays.xp, self._shift, self._share
        self._held = self._held + step
        index = xp.astype(self.gear, xp.int64) - 1
        above, below = xp.clip(index + 1, None, 2), xp.clip(index - 1, 0, None)
        speed, pressure = xp.abs(speed), xp.abs(pressure)
        up = (
            (index < 2)
            & (speed > shift.up_speed * top_speed / share[index])
            & (xp.abs(drive_signal) >= shift.up_signal)
            & (pressure * share[index] / share[above] < shift.up_pressure)
        )
        slow = speed < shift.down_speed * top_speed / share[below]
        down = (index > 0) & (slow | (pressure > shift.down_pressure))
        due = self._held >= shift.hold
        down, up = due & down, due & up & ~down
        self.gear = xp.where(down, self.gear - 1.0, xp.where(up, self.gear + 1.0, self.gear))
        self._held = xp.where(down | up, 0.0, self._held)
        return self.gear


@dataclass(frozen=True)
class TractionControl:
    """Throttles the oil of wheels that spin, so that those that grip get pressure."""

    excess: float = 1.5
    """A wheel spins that turns this many times as fast as the others in the mean …"""
    slack: float = 0.5
    """… and this much faster [rad/s]."""
    close: float = 4.0
    """Change of its valve's opening [1/s] while it does."""
    open: float = 0.5
    """And while it does not."""
    least: float = 0.03
    """Smallest opening [-]."""

    def __post_init__(self) -> None:
        check_range("excess", self.excess, gt=1.0)
        for name in ("slack", "close", "open"):
            check_range(name, getattr(self, name), gt=0.0)
        check_range("least", self.least, ge=0.0, le=1.0)

    def openings(self, openings: Array, wheel_rates: Array, step: float) -> Array:
        """Openings (N, 4) [-] for the next ``step`` [s], after ``openings``, from measured wheel speeds (N, 4) [rad/s]."""
        xp = namespace(wheel_rates)
        turning = xp.abs(wheel_rates)
        others = (turning[:, 0] + turning[:, 1] + turning[:, 2] + turning[:, 3])[:, None] - turning
        spins = turning > self.excess * others / 3.0 + self.slack
        moved = xp.where(spins, openings - step * self.close, openings + step * self.open)
        return xp.clip(moved, self.least, 1.0)


@dataclass(frozen=True)
class ArmControl:
    """How the arms move: four wheels stand on three modes of a rigid frame (height, roll, pitch) and one twist. The twist
    is set by pressures, so that both diagonals carry alike; roll and pitch are held, or levelled by attitude; the height
    returns to rest."""

    share_gain: float = 1.0 / 60e5
    """Arm signal per difference of pressure [1/Pa] between the diagonals."""
    share_band: float = 6e5
    """Difference [Pa] that is left."""
    share_time: float = 0.1
    """Time [s] over which pressures are smoothed."""
    level_gain: float = 0.0
    """Arm signal per metre of height [1/m] that a corner lacks to level; 0: roll and pitch are held."""
    level_band: float = 0.03
    """Height [m] that is left."""
    height_gain: float = 1.0
    """Arm signal per metre [1/m] by which the arms' mean is off its rest."""
    largest: float = 1.0
    """Largest arm signal [-]."""

    def __post_init__(self) -> None:
        for name in ("share_gain", "share_band", "share_time", "level_gain", "level_band", "height_gain"):
            check_range(name, getattr(self, name), ge=0.0)
        check_range("largest", self.largest, gt=0.0, le=1.0)

    @classmethod
    def sharing(cls) -> ArmControl:
        """Share the weight; roll and pitch are held."""
        return cls()

    @classmethod
    def levelling(cls) -> ArmControl:
        """Share the weight, and level the frames."""
        return cls(level_gain=3.0)


TWIST = np.array([1.0, -1.0, -1.0, 1.0])[:, None]
"""Signs of the corners (front left, front right, rear left, rear right) in the mode that bends a table's legs."""


@dataclass(frozen=True)
class MachineDimensions:
    """Measures of N machines, each (N,) [m] unless said otherwise."""

    front: Array
    """Hinge to front axle."""
    rear: Array
    """Hinge to rear axle."""
    half_track: Array
    arm_length: Array
    rest: Array
    """Arm angles [rad] (4, N) that the mean returns to."""
    dead_band: Array
    """Of the arm valves [-]."""


class ArmController:
    """Arms of N machines.

    Args:
        num_envs: N.
        control: How they move.
        arrays: Where they live.
    """

    def __init__(self, num_envs: int, control: ArmControl | None = None, arrays: Arrays = HOST):
        self._control = ArmControl.sharing() if control is None else control
        self._arrays = arrays
        self._signs = arrays.asarray(TWIST)
        self._twist = arrays.zeros(num_envs)  # [Pa] smoothed

    def reset(self, where: Index) -> None:
        """Forget the past of the sub-environments ``where``."""
        self._arrays.put(self._twist, where, 0.0)

    def update(
        self,
        pressures: Array,
        arm_angles: Array,
        roll: Array,
        pitch: Array,
        joint_angle: Array,
        stance: MachineDimensions,
        step: float,
    ) -> Array:
        """Arm signals (4, N) for the next ``step`` [s]; positive extends the cylinder and raises the frame.

        A corner at (x, y) of the front frame's axes stands y sin(roll) − x sin(pitch) above the hinge on level frames:
        what its arm takes back. The order of corners is that of ``aoro_gym.twin.records.WHEELS``.

        Args:
            pressures: Measured in the cylinders' bores, less the rods' share [Pa] (4, N).
            arm_angles: Measured [rad] (4, N). Sensors on the arms are an assumption; on all cylinders of the machine
                there are pressure sensors.
            roll: Measured [rad] (N,), positive where the left side is up.
            pitch: Measured [rad] (N,), positive where the nose is down.
            joint_angle: Measured [rad] (N,): where the rear frame's corners are.
            stance: The machine's measures.
            step: Time [s] since the last call.
        """
        xp, control, m = self._arrays.xp, self._control, stance
        twist = 0.25 * (pressures[0] - pressures[1] - pressures[2] + pressures[3])
        self._twist = self._twist + step / (step + control.share_time) * (twist - self._twist)
        demand = -self._signs * control.share_gain * beyond(self._twist, control.share_band)
        sunk = m.arm_length * (arm_angles - m.rest)  # an arm that points higher than at rest carries its frame too low
        demand = demand + control.height_gain * 0.25 * (sunk[0] + sunk[1] + sunk[2] + sunk[3])
        if control.level_gain > 0.0:
            s, c = xp.sin(joint_angle), xp.cos(joint_angle)
            # the rear frame is turned by −θ against the front one
            x = xp.stack([m.front, m.front, m.half_track * s - m.rear * c, -m.half_track * s - m.rear * c])
            y = xp.stack([m.half_track, -m.half_track, m.rear * s + m.half_track * c, m.rear * s - m.half_track * c])
            demand = demand + control.level_gain * beyond(x * xp.sin(pitch) - y * xp.sin(roll), control.level_band)
        demand = xp.clip(demand, -1.0, 1.0)
        size = xp.abs(demand)
        signal = xp.copysign(m.dead_band + (1.0 - m.dead_band) * size, demand)
        return xp.clip(xp.where(size > 0.02, signal, 0.0), -control.largest, control.largest)


def beyond(value: Array, band: float) -> Array:
    """What of ``value`` lies outside of ±``band``."""
    return value - namespace(value).clip(value, -band, band)
