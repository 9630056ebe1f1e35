"""A Kalman filter for a pose, written apart from the package's: functions of a state vector, Jacobians by differences,
all measurements of a solution at once.

The state is x, y, ψ, bias, slip, sideslip, two drifts of a fixed and two of a float solution, errors of roll and pitch.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]


def jacobian(function: Callable[[Floats], Floats], state: Floats) -> Floats:
    """By central differences of fourth order; rows of the value, columns of the state."""
    columns = []
    for unit in 1e-3 * np.eye(len(state)):
        near, far = (function(state + k * unit) - function(state - k * unit) for k in (1, 2))
        columns.append((8.0 * near - far) / 12.0 / 1e-3)
    return np.stack(columns, axis=1)


def rotation(heading: float, pitch: float, roll: float) -> Rotation:
    """R_z R_y R_x"""
    return Rotation.from_euler("ZYX", [heading, pitch, roll])


def heading_rate(rates: Floats, roll: float, pitch: float) -> float:
    """Rate of the heading: rate of the direction in the plan of the rotated x-axis."""
    forward = rotation(0.0, pitch, roll).apply([1.0, 0.0, 0.0])
    change = np.cross(rotation(0.0, pitch, roll).apply(rates), forward)
    return float((forward[0] * change[1] - forward[1] * change[0]) / (forward[0] ** 2 + forward[1] ** 2))


def turning(rates: Floats, roll: float, pitch: float) -> Floats:
    """The rate of the heading, and its derivatives by roll and pitch."""
    slopes = jacobian(lambda both: np.array([heading_rate(rates, both[0], both[1])]), np.array([roll, pitch]))
    return np.array([heading_rate(rates, roll, pitch), *slopes[0]])


class OracleFilter:
    """One twin's; arguments as those of the package's class, SI.

    Args:
        settings: Such as :class:`aoro_gym.sensors.pose_filter.PoseFilterSettings`.
        gps: Such as :class:`aoro_gym.sensors.gps.GpsNoise`.
        imu: Such as :class:`aoro_gym.sensors.imu.ImuNoise`.
        antennas: Such as :class:`aoro_gym.sensors.gps.Antennas`.
        step: [s]
        floors: Least errors of a solution: position [m], heading [rad].
    """

    def __init__(self, settings, gps, imu, antennas, *, step: float, floors: tuple[float, float]):
        self.settings, self.antennas, self.step = settings, antennas, step
        spreads = [
            imu.rate_bias,
            settings.slip_spread,
            settings.sideslip_spread,
            *[gps.drift] * 2,
            *[gps.float_drift] * 2,
        ]
        times = [imu.bias_time, settings.slip_time, settings.sideslip_time, *[gps.drift_time] * 2]
        self.spreads = np.array([0.0] * 3 + spreads + [imu.attitude_drift] * 2)
        times += [gps.float_drift_time] * 2 + [imu.attitude_time] * 2
        self.decay = np.array([1.0] * 3 + [np.exp(-step / time) for time in times])
        self.mean = np.array([0, 0, 0, 0, settings.mean_slip, 0, 0, 0, 0, 0, 0, 0], dtype=float)
        height = antennas.main[2]
        self.position_variance = gps.white**2 + (height * imu.attitude_white) ** 2 + floors[0] ** 2
        self.heading_variances = [
            (each / antennas.baseline) ** 2 + floors[1] ** 2
            for each in (gps.float_relative, gps.float_relative, gps.relative)
        ]
        self.turn_variance = (step * imu.rate_white) ** 2 + step * settings.heading_walk**2

    def begin(self, state: Floats, covariance: Floats, rates: Floats, roll: float, pitch: float) -> None:
        """From an estimate (12,) and its covariance (12, 12), with what the inertial unit shows."""
        self.state, self.covariance = state.copy(), covariance.copy()
        self.turning, self.reckoned = turning(rates, roll, pitch), [np.array([0.0, 0.0, 0.0, roll, pitch])]

    def move(self, speed: float, rates: Floats, roll: float, pitch: float) -> float:
        """A step on; the way by the wheels in the plan [m]."""
        now, before, settings = turning(rates, roll, pitch), self.reckoned[-1], self.settings
        mean, self.turning = 0.5 * (self.turning + now), now
        roll_then, pitch_then = 0.5 * (before[3] + roll), 0.5 * (before[4] + pitch)
        way = self.step * speed * np.cos(pitch_then)
        # gravity in the frame's axes, in units of what presses the tires on
        gravity = rotation(0.0, pitch_then, roll_then).inv().apply([0.0, 0.0, -1.0])
        demand = gravity[:2] / -gravity[2]
        more = 1.0 / (1.0 - min(np.hypot(*demand) / settings.friction, 0.8))

        def flow(state: Floats) -> Floats:
            turn = self.step * (mean[0] - state[3] - mean[1:] @ state[10:12])
            move = way * np.array(
                [
                    1.0 + state[4] + settings.longitudinal_creep * demand[0] * more,
                    state[5] + settings.lateral_creep * demand[1] * more,
                    0.0,
                ]
            )
            after = self.mean + self.decay * (state - self.mean)
            after[:2] += rotation(state[2] + 0.5 * turn, 0.0, 0.0).apply(move)[:2]
            after[2] += turn
            return after

        gradient = jacobian(flow, self.state)
        middle = self.state[2] + 0.5 * self.step * (mean[0] - self.state[3] - mean[1:] @ self.state[10:12])
        after = flow(self.state)
        row = flow(np.concatenate([before[:3], self.state[3:]]))
        self.reckoned.append(np.array([*row[:3], roll, pitch]))
        noise = np.diag(self.spreads**2 * (1.0 - self.decay**2))
        axes = rotation(middle, 0.0, 0.0).as_matrix()[:2, :2]
        walks = np.array([settings.slip_walk, settings.sideslip_walk]) * way
        noise[:2, :2] += axes @ np.diag(walks**2 / self.step) @ axes.T
        noise[2, 2] += self.turn_variance
        self.state, self.covariance = after, gradient @ self.covariance @ gradient.T + noise
        return way

    def take(self, position: Floats, heading: float, quality: int, age: float, place: Floats, way: float) -> None:
        """A solution of ``age`` [s], since when ``way`` [m] were driven.

        Args:
            position: Of the main antenna in the plan [m] (2,).
            heading: [rad]
            quality: 1 float, 2 fixed.
            age: [s]
            place: Of the reference point in the frame's axes [m] (3,).
            way: [m]
        """
        late, share = divmod(age / self.step, 1.0)
        rows = [self.reckoned[max(-1 - int(late) - k, -len(self.reckoned))] for k in (0, 1)]
        then, now = (1.0 - share) * rows[0] + share * rows[1], self.reckoned[-1]
        turn = now[2] - then[2]
        since = rotation(-now[2], 0.0, 0.0).apply([*(now[:2] - then[:2]), 0.0])
        main, line = np.array(self.antennas.main), np.subtract(self.antennas.auxiliary, self.antennas.main)
        about = self.state.copy()

        def linearised(value: Callable[[float, float], Floats], state: Floats) -> Floats:
            """The attitude's errors count to first order about the measured attitude."""
            slopes = jacobian(lambda both: value(both[0], both[1]), then[3:5])
            return value(then[3], then[4]) - slopes @ state[10:12]

        def shown(state: Floats) -> Floats:
            slip = way * (state[4:6] - about[4:6])
            back = since + rotation(-0.5 * turn, 0.0, 0.0).apply([*slip, 0.0])
            lever = linearised(lambda roll, pitch: rotation(0.0, pitch, roll).apply(place - main), state)
            across = linearised(lambda roll, pitch: rotation(0.0, pitch, roll).apply(line), state)
            before = state[2] - turn
            antenna = state[:2] - rotation(state[2], 0.0, 0.0).apply(back)[:2]
            antenna = antenna - rotation(before, 0.0, 0.0).apply([*lever[:2], 0.0])[:2]
            drift = state[8:10] if quality == 1 else state[6:8]
            direction = np.arctan2(across[1], across[0]) - self.antennas.direction
            return np.array([*(antenna + drift), before + age * (state[3] - about[3]) + direction])

        slope = jacobian(shown, about)
        # what walked since is in the state's errors, but not in what is shown
        axes = rotation(about[2] - 0.5 * turn, 0.0, 0.0).as_matrix()
        walks = np.array([self.settings.slip_walk, self.settings.sideslip_walk]) * way
        walked = np.diag([*(walks**2 / max(age, self.step)), self.turn_variance / self.step * age])
        common = np.zeros((12, 3))
        common[:3] = -axes @ walked @ axes.T
        noise = np.diag([self.position_variance] * 2 + [self.heading_variances[quality]]) - common[:3]
        off = np.array([*position, heading]) - shown(about)
        off[2] = (off[2] + np.pi) % (2.0 * np.pi) - np.pi
        shared = self.covariance @ slope.T + common
        spread = slope @ self.covariance @ slope.T + slope @ common + common.T @ slope.T + noise
        gain = np.linalg.solve(spread, shared.T).T
        self.state = about + gain @ off
        self.covariance = self.covariance - gain @ spread @ gain.T
