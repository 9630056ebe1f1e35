"""Where the machine is, as well as its sensors' stated errors allow: an extended Kalman filter on dead reckoning and GPS.

:class:`~aoro_gym.sensors.localisation.Localisation` drives on as if the ground were level, knows of no slip, and takes a
fixed share of every solution. This filter carries a state of twelve with its covariance (R. E. Kalman, "A new approach to
linear filtering and prediction problems", J. Basic Engineering 82, 1960; the extended one as in A. Gelb, Applied Optimal
Estimation, 1974, chapter 6):

    x, y, heading ψ, bias of the turning rate, slip and sideslip besides their means,
    drift of a fixed and of a float solution (x and y each), errors of the measured roll φ and pitch θ,

all but the first three first-order Gauss-Markov, as :class:`~aoro_gym.sensors.gps.GpsNoise` and
:class:`~aoro_gym.sensors.imu.ImuNoise` state their errors.

**Dead reckoning.** The heading turns by (ω_y sin φ + ω_z cos φ) / cos θ, the mean of two samples of it, less the bias and
what the attitude's errors make of it; the plan is driven at v cos θ. Tires creep under what a slope asks of them,
U = (tan θ / cos φ, −tan φ) in units of the load: along by k_x U_x / (1 − |U|/μ) of the way, across by k_y U_y / (1 − |U|/μ),
linear for small demands and without bound as the friction μ is used up, as brush tires are (H. B. Pacejka, Tire and Vehicle
Dynamics, 2012, chapter 3). The share |U|/μ counts up to 0.8: the law says nothing of sliding. k_x, k_y, μ and the mean are
found by least squares on 80 drives over courses to learn on of ``AORO/PathTracking-v1`` (E): the μ that is found is that of
the ground.

**GPS.** A solution shows the antenna some time ago: the state is taken back along what was reckoned since, and up from the
reference point to the antenna by the attitude of then. The line between the antennas, which lies across the frame, does not
point at the heading + 90° where the frame is tilted both ways, but at heading + 90° − atan(sin θ tan φ): 4° at 15° each.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from aoro_gym.checks import check_range
from aoro_gym.execution.array_api import HOST, Array, Arrays, Index, floats, namespace
from aoro_gym.sensors.attitude import wrapped
from aoro_gym.sensors.gps import FLOAT, Antennas, GpsNoise, GpsReading
from aoro_gym.sensors.imu import ImuNoise
from aoro_gym.sensors.noise import chosen_rows

X, Y, HEADING, BIAS, SLIP, SIDESLIP, DRIFT_X, DRIFT_Y, FLOAT_X, FLOAT_Y, ROLL_ERROR, PITCH_ERROR = range(12)
"""Places of the state."""
SIZE = 12
LARGEST_SHARE = 0.8
"""Of the friction [-] that the law of creep is asked for."""
UNKNOWN_POSITION, UNKNOWN_HEADING = 1.0, 0.1
"""[m], [rad] standard deviations before the first solution, which is the estimate that it corrects."""
EXACT_POSITION, EXACT_HEADING = 1e-3, 1e-4
"""[m], [rad] that a solution is off by at least: no covariance may become singular with sensors without errors."""


@dataclass(frozen=True)
class PoseFilterSettings:
    """What a pose filter takes for granted of tires on ground (E)."""

    longitudinal_creep: float = 0.057
    """k_x [-]"""
    lateral_creep: float = 0.030
    """k_y [-]"""
    friction: float = 0.49
    """μ [-]"""
    mean_slip: float = -0.016
    """Speed over ground beyond that from the wheels on level ground [-]."""
    slip_spread: float = 0.02
    """Standard deviation of what wanders about the mean [-]."""
    slip_time: float = 1.5
    """Its correlation time [s]."""
    sideslip_spread: float = 0.01
    """Likewise across [rad]."""
    sideslip_time: float = 1.0
    """[s]"""
    slip_walk: float = 0.02
    """Root of the spectral density of what is white [√s]."""
    sideslip_walk: float = 0.015
    """[rad √s]"""
    heading_walk: float = math.radians(0.1)
    """Of the heading beyond the gyroscope's own noise: samples of it stand for a whole step [rad/√s]."""

    def __post_init__(self) -> None:
        for name in (
            "longitudinal_creep", "lateral_creep", "slip_spread", "sideslip_spread", "slip_walk", "sideslip_walk",
            "heading_walk",
        ):  # fmt: skip
            check_range(name, getattr(self, name), ge=0.0, lt=1.0)
        check_range("mean_slip", self.mean_slip, ge=-0.5, le=0.5)
        check_range("friction", self.friction, gt=0.0, lt=math.inf)
        for name in ("slip_time", "sideslip_time"):
            check_range(name, getattr(self, name), "s", gt=0.0, lt=math.inf)


class PoseFilter:
    """Estimated plan pose of a point of the front frame, for N twins, with its covariance; see the module.

    Args:
        num_twins: How many.
        settings: What is taken for granted of slip.
        antennas: Where the antennas stand, as the controller was told.
        gps_noise: Errors that the receiver states.
        imu_noise: Errors that the inertial unit states.
        latency: Age [s] of a solution as it comes out.
        step: Time [s] from one update to the next.
        arrays: Where they live.

    Raises ValueError naming the argument, its value and its bound.
    """

    def __init__(
        self,
        num_twins: int = 1,
        *,
        settings: PoseFilterSettings | None = None,
        antennas: Antennas | None = None,
        gps_noise: GpsNoise | None = None,
        imu_noise: ImuNoise | None = None,
        latency: float = 0.04,
        step: float = 0.05,
        arrays: Arrays = HOST,
    ):
        check_range("latency", latency, "s", ge=0.0, le=1.0)
        check_range("step", step, "s", gt=0.0, le=0.1)
        self.num_twins, self.step = num_twins, step
        self.settings = PoseFilterSettings() if settings is None else settings
        antennas = Antennas() if antennas is None else antennas
        gps = GpsNoise.typical() if gps_noise is None else gps_noise
        imu = ImuNoise.typical() if imu_noise is None else imu_noise
        self._arrays = arrays
        self._antenna = arrays.asarray(antennas.main)
        self._line = arrays.asarray(np.subtract(antennas.auxiliary, antennas.main))
        self._direction = antennas.direction
        self._take_noise(gps, imu, antennas)
        kept = math.ceil(latency / step) + 3
        self._history = arrays.zeros((kept, num_twins, 5))
        """x, y, heading [m, rad] as reckoned without GPS, measured roll and pitch [rad], newest first."""
        self._turning = arrays.zeros((num_twins, 3))  # what :func:`heading_rate` gave last
        self.state = arrays.zeros((num_twins, SIZE))
        """(N, 12)"""
        self.covariance = arrays.zeros((num_twins, SIZE, SIZE))
        """(N, 12, 12)"""
        self.position = arrays.zeros((num_twins, 2))
        """[m] (N, 2)"""
        self.heading = arrays.zeros(num_twins)
        """[rad] (N,), in [−π, π)"""

    def _take_noise(self, gps: GpsNoise, imu: ImuNoise, antennas: Antennas) -> None:
        """Spreads and decays of what wanders (12,), and variances of a solution by quality (3,)."""
        arrays, settings, step = self._arrays, self.settings, self.step
        wandering = {
            BIAS: (imu.rate_bias, imu.bias_time),
            SLIP: (settings.slip_spread, settings.slip_time),
            SIDESLIP: (settings.sideslip_spread, settings.sideslip_time),
            DRIFT_X: (gps.drift, gps.drift_time),
            FLOAT_X: (gps.float_drift, gps.float_drift_time),
            ROLL_ERROR: (imu.attitude_drift, imu.attitude_time),
        }
        for of, other in ((DRIFT_X, DRIFT_Y), (FLOAT_X, FLOAT_Y), (ROLL_ERROR, PITCH_ERROR)):
            wandering[other] = wandering[of]
        spread, decay = np.zeros(SIZE), np.ones(SIZE)
        for place, (rms, time) in wandering.items():
            spread[place], decay[place] = rms, math.exp(-step / time)
        self._spread2, self._decay = arrays.asarray(spread**2), arrays.asarray(decay)
        self._fresh2 = arrays.asarray(spread**2 * (1.0 - decay**2))
        mean = np.zeros(SIZE)
        mean[SLIP] = settings.mean_slip
        self._mean = arrays.asarray(mean)
        relative = np.array([gps.float_relative, gps.float_relative, gps.relative]) / antennas.baseline
        self._heading2 = arrays.asarray(relative**2 + EXACT_HEADING**2)
        height = antennas.main[2]
        self._position2 = gps.white**2 + (height * imu.attitude_white) ** 2 + EXACT_POSITION**2
        self._turn2 = (step * imu.rate_white) ** 2 + step * settings.heading_walk**2

    def begin(self, gps: GpsReading, roll: Array, pitch: Array, place: Array, *, rates: Array, indices: Index) -> None:
        """Begin anew with the first solutions of the twins ``indices`` (K,), which rest.

        Args:
            gps: Solutions (K,) of the receiver.
            roll: Measured roll (K,) [rad].
            pitch: Measured pitch (K,) [rad].
            place: The point in the front frame's axes [m] (3,) or (K, 3).
            rates: Measured angular velocity in the front frame's axes [rad/s] (K, 3).
            indices: The twins.
        """
        arrays, xp = self._arrays, self._arrays.xp
        rows, k = chosen_rows(indices, self.num_twins, arrays)
        roll, pitch = floats(roll), floats(pitch)
        zero = xp.zeros_like(roll)
        state = xp.asarray(xp.broadcast_to(self._mean, (k, SIZE)), copy=True)
        line, _, _ = levelled(roll, pitch, self._line)
        lever, _, _ = levelled(roll, pitch, floats(place) - self._antenna)
        heading = floats(gps.heading) + self._direction - xp.atan2(line[:, 1], line[:, 0])
        state[:, :2], state[:, HEADING] = floats(gps.position)[:, :2] + turned(heading, lever), heading
        variances = xp.asarray(self._spread2, copy=True)
        variances[X] = variances[Y] = UNKNOWN_POSITION**2
        variances[HEADING] = UNKNOWN_HEADING**2
        history = xp.stack([zero, zero, zero, roll, pitch], axis=-1)
        covariance = arrays.zeros((k, SIZE, SIZE))
        each = arrays.arange(SIZE)
        covariance[:, each, each] = variances
        state, covariance = self._corrected(state, covariance, gps, history, history, place, zero)
        self._history[:, rows] = history
        self._turning[rows] = heading_rate(rates, roll, pitch)
        self._keep(rows, state, covariance)

    def update(self, gps: GpsReading, roll: Array, pitch: Array, place: Array, *, speed: Array, rates: Array) -> None:
        """Move all poses on by a step, and correct them by fresh solutions.

        Args:
            gps: The receivers' readings (N).
            roll: Measured [rad] (N,).
            pitch: Measured [rad] (N,).
            place: The point in the front frame's axes [m] (3,) or (N, 3).
            speed: From the wheels [m/s] (N,).
            rates: Measured angular velocity in the front frame's axes [rad/s] (N, 3).
        """
        xp, roll, pitch = self._arrays.xp, floats(roll), floats(pitch)
        way = self._moved(floats(speed), floats(rates), roll, pitch)
        # what was measured and reckoned as the solution was made, on the straight line between two updates
        ago = xp.clip(floats(gps.age) / self.step, 0.0, len(self._history) - 1.001)
        late = xp.astype(xp.floor(ago), xp.int64)
        share, each = (ago - floats(late))[:, None], self._arrays.arange(self.num_twins)
        then = (1.0 - share) * self._history[late, each] + share * self._history[late + 1, each]
        state, covariance = self._corrected(
            self.state, self.covariance, gps, self._history[0], then, place, way / self.step * gps.age
        )
        fresh = xp.asarray(gps.fresh)
        state = xp.where(fresh[:, None], state, self.state)
        self._keep(slice(None), state, xp.where(fresh[:, None, None], covariance, self.covariance))

    def _keep(self, rows: Index, state: Array, covariance: Array) -> None:
        self.state[rows], self.covariance[rows] = state, covariance
        self.position[rows], self.heading[rows] = state[:, :2], wrapped(state[:, HEADING])

    def _moved(self, speed: Array, rates: Array, roll: Array, pitch: Array) -> Array:
        """Reckon a step on; gives the way [m] (N,) in the plan by the wheels."""
        xp, x, step, settings = self._arrays.xp, self.state, self.step, self.settings
        now = heading_rate(rates, roll, pitch)
        rate, by_roll, by_pitch = (0.5 * (self._turning + now)).T
        turn = step * (rate - x[:, BIAS] - by_roll * x[:, ROLL_ERROR] - by_pitch * x[:, PITCH_ERROR])
        self._turning = now
        before = self._history[0]
        mean_roll, mean_pitch = 0.5 * (before[:, 3] + roll), 0.5 * (before[:, 4] + pitch)
        way = step * speed * xp.cos(mean_pitch)
        slip, sideslip = creep(mean_roll, mean_pitch, settings, xp)
        along, across = way * (1.0 + x[:, SLIP] + slip), way * (x[:, SIDESLIP] + sideslip)
        s, c = xp.sin(x[:, HEADING] + 0.5 * turn), xp.cos(x[:, HEADING] + 0.5 * turn)
        moved = xp.stack([along * c - across * s, along * s + across * c], axis=-1)
        odometer = before[:, :2] + turned(before[:, 2] + 0.5 * turn, xp.stack([along, across], axis=-1))
        row = xp.concat([odometer, xp.stack([before[:, 2] + turn, roll, pitch], axis=-1)], axis=1)
        self._history = xp.concat([row[None], self._history[:-1]])

        flow = self._arrays.zeros(self.covariance.shape)
        each = self._arrays.arange(SIZE)
        flow[:, each, each] = self._decay
        for axis, by_heading, e, n in ((X, -moved[:, 1], c, -s), (Y, moved[:, 0], s, c)):
            flow[:, axis, HEADING] = by_heading
            for place, rate in ((BIAS, 1.0), (ROLL_ERROR, by_roll), (PITCH_ERROR, by_pitch)):
                flow[:, axis, place] = -0.5 * step * rate * by_heading
            flow[:, axis, SLIP], flow[:, axis, SIDESLIP] = way * e, way * n
        flow[:, HEADING, BIAS] = -step
        flow[:, HEADING, ROLL_ERROR], flow[:, HEADING, PITCH_ERROR] = -step * by_roll, -step * by_pitch
        self.covariance = flow @ self.covariance @ xp.permute_dims(flow, (0, 2, 1))
        self.covariance[:, each, each] += self._fresh2
        along2, across2 = ((way * walk) ** 2 / step for walk in (settings.slip_walk, settings.sideslip_walk))
        for a, b, value in (
            (X, X, along2 * c * c + across2 * s * s), (Y, Y, along2 * s * s + across2 * c * c),
            (X, Y, (along2 - across2) * c * s), (Y, X, (along2 - across2) * c * s), (HEADING, HEADING, self._turn2),
        ):  # fmt: skip
            self.covariance[:, a, b] += value
        self.state = self._mean + self._decay * (x - self._mean)
        self.state[:, :2] += moved
        self.state[:, HEADING] += turn
        return way

    def _corrected(
        self, state: Array, covariance: Array, gps: GpsReading, now: Array, then: Array, place: Array, way: Array
    ) -> tuple[Array, Array]:
        """State and covariance after a solution of K receivers.

        Args:
            state: (K, 12)
            covariance: (K, 12, 12)
            gps: The solutions.
            now: A row (K, 5) of the history.
            then: Likewise, as the solution was made.
            place: The point in the front frame's axes [m] (3,) or (K, 3).
            way: Driven since [m] (K,), by the wheels.
        """
        xp = self._arrays.xp
        turn = now[:, 2] - then[:, 2]
        since = turned(-now[:, 2], now[:, :2] - then[:, :2])  # in the axes of now
        lever, by_roll, by_pitch = levelled(then[:, 3], then[:, 4], floats(place) - self._antenna)
        line, line_by_roll, line_by_pitch = levelled(then[:, 3], then[:, 4], self._line)
        errors = state[:, ROLL_ERROR : PITCH_ERROR + 1]
        lever = lever - by_roll * errors[:, :1] - by_pitch * errors[:, 1:]
        line = line - line_by_roll * errors[:, :1] - line_by_pitch * errors[:, 1:]
        heading = state[:, HEADING] - turn
        apart = turned(state[:, HEADING], since) + turned(heading, lever)
        is_float = xp.asarray(gps.quality == FLOAT)[:, None]
        drift = xp.where(is_float, state[:, FLOAT_X : FLOAT_Y + 1], state[:, DRIFT_X : DRIFT_Y + 1])
        middle = turned(state[:, HEADING] - 0.5 * turn, xp.stack([way, xp.zeros_like(way)], axis=-1))
        slope = self._arrays.zeros((len(state), 3, SIZE))
        slope[:, 0, X] = slope[:, 1, Y] = slope[:, 2, HEADING] = 1.0
        slope[:, 0, HEADING], slope[:, 1, HEADING] = apart[:, 1], -apart[:, 0]
        slope[:, :2, SLIP] = -middle
        slope[:, 0, SIDESLIP], slope[:, 1, SIDESLIP] = middle[:, 1], -middle[:, 0]
        slope[:, :2, ROLL_ERROR], slope[:, :2, PITCH_ERROR] = turned(heading, by_roll), turned(heading, by_pitch)
        floated = floats(is_float[:, 0])
        for axis in (0, 1):
            slope[:, axis, DRIFT_X + axis], slope[:, axis, FLOAT_X + axis] = 1.0 - floated, floated
        square = xp.sum(line**2, axis=1)
        for column, d in ((ROLL_ERROR, line_by_roll), (PITCH_ERROR, line_by_pitch)):
            slope[:, 2, column] = (line[:, 1] * d[:, 0] - line[:, 0] * d[:, 1]) / square
        shown = heading + xp.atan2(line[:, 1], line[:, 0]) - self._direction
        slope[:, 2, BIAS] = floats(gps.age)
        off = floats(gps.position)[:, :2] - (state[:, :2] - apart + drift)
        off = xp.concat([off, wrapped(floats(gps.heading) - shown)[:, None]], axis=1)
        return self._taken_in(state, covariance, off, slope, gps, way, state[:, HEADING] - 0.5 * turn)

    def _taken_in(
        self, state: Array, covariance: Array, off: Array, slope: Array, gps: GpsReading, way: Array, heading: Array
    ) -> tuple[Array, Array]:
        """State and covariance after heading and position along and across, one after the other; linearised about ``state``.

        What the machine slipped and turned since the solution was made is in the state's errors, but not in what was shown:
        an error of the measurement that is correlated with them (Gelb, section 4.5). In this order those of the later
        measurements are not changed by the earlier ones, as the heading's does not depend on the position.

        Args:
            state: (K, 12)
            covariance: (K, 12, 12)
            off: What is measured less what ``state`` says (K, 3): x, y, heading.
            slope: Its derivative by the state (K, 3, 12).
            gps: The solutions.
            way: Driven since [m] (K,), by the wheels.
            heading: Mean since [rad] (K,).
        """
        xp, age, zero = self._arrays.xp, floats(gps.age), self._arrays.zeros(state.shape)
        c, s = xp.cos(heading)[:, None], xp.sin(heading)[:, None]
        unit = self._arrays.asarray(np.eye(SIZE))
        along, across = c * unit[X] + s * unit[Y], c * unit[Y] - s * unit[X]
        since2 = way**2 / xp.clip(age, self.step, None)
        x, y = c[:, 0] * off[:, 0] + s[:, 0] * off[:, 1], c[:, 0] * off[:, 1] - s[:, 0] * off[:, 0]
        walks = (
            self.settings.slip_walk**2 * since2,
            self.settings.sideslip_walk**2 * since2,
            self._turn2 / self.step * age,
        )
        change = zero
        for row, error, axis, walk, variance in (
            (slope[:, 2], off[:, 2], unit[HEADING] + zero, walks[2], self._heading2[gps.quality]),
            (c * slope[:, 0] + s * slope[:, 1], x, along, walks[0], self._position2),
            (c * slope[:, 1] - s * slope[:, 0], y, across, walks[1], self._position2),
        ):  # fmt: skip
            shared = (covariance @ row[:, :, None])[:, :, 0] - walk[:, None] * axis
            spread = xp.sum(row * (shared - walk[:, None] * axis), axis=1) + variance + walk
            left = (error - xp.sum(row * change, axis=1)) / spread
            change = change + shared * left[:, None]
            covariance = covariance - shared[:, :, None] * shared[:, None, :] / spread[:, None, None]
        return state + change, covariance


def creep(roll: Array, pitch: Array, settings: PoseFilterSettings, xp: Any) -> tuple[Array, Array]:
    """Slip [-] and sideslip [rad] (N,) that a slope makes, by roll and pitch [rad] (N,); see the module."""
    along, across = xp.tan(pitch) / xp.cos(roll), -xp.tan(roll)
    share = xp.sqrt(along**2 + across**2) / settings.friction
    more = 1.0 / (1.0 - xp.clip(share, None, LARGEST_SHARE))
    return settings.longitudinal_creep * along * more, settings.lateral_creep * across * more


def heading_rate(rates: Array, roll: Array, pitch: Array) -> Array:
    """Rate of the heading [rad/s] of a frame R_z(ψ) R_y(θ) R_x(φ), and its derivatives by roll and pitch (N, 3).

    Args:
        rates: Angular velocity in these axes [rad/s] (N, 3).
        roll: φ [rad] (N,).
        pitch: θ [rad] (N,).
    """
    rates, xp = floats(rates), namespace(rates)
    s, c, flat = xp.sin(roll), xp.cos(roll), xp.cos(pitch)
    rate = (rates[:, 1] * s + rates[:, 2] * c) / flat
    return xp.stack([rate, (rates[:, 1] * c - rates[:, 2] * s) / flat, rate * xp.tan(pitch)], axis=-1)


def levelled(roll: Array, pitch: Array, vector: Array) -> tuple[Array, Array, Array]:
    """The plan's part [m] (N, 2) of a vector (3,) or (N, 3) of the frame's axes at heading 0, and its derivatives.

    Args:
        roll: [rad] (N,); the first derivative is by it.
        pitch: [rad] (N,), likewise the second.
        vector: [m]
    """
    xp = namespace(roll)
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    s, c = xp.sin(roll), xp.cos(roll)
    y, z = c * y - s * z, s * y + c * z
    s, c = xp.sin(pitch), xp.cos(pitch)
    zero = xp.zeros_like(y)
    return (
        xp.stack([c * x + s * z, y], axis=-1),
        xp.stack([s * y, -z], axis=-1),
        xp.stack([c * z - s * x, zero], axis=-1),
    )


def turned(angle: Array, vector: Array) -> Array:
    """Plane vectors (N, 2), turned left by angles [rad] (N,)."""
    xp = namespace(vector)
    s, c = xp.sin(angle), xp.cos(angle)
    return xp.stack([c * vector[:, 0] - s * vector[:, 1], s * vector[:, 0] + c * vector[:, 1]], axis=-1)
