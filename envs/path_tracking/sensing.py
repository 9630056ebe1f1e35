"""What a vehicle measures: its sensors, and the dead reckoning on them."""

from __future__ import annotations

from aoro_gym.envs.core.joint import MeasuredJoint
from aoro_gym.envs.core.task import Outputs
from aoro_gym.envs.path_tracking.config import PathTrackingConfig
from aoro_gym.execution.array_api import Array, Arrays, Index, floats
from aoro_gym.execution.streams import Generators
from aoro_gym.sensors import (
    Gps,
    GpsReading,
    Imu,
    Localisation,
    LocalisationGains,
    PoseFilter,
    PressureSensor,
    WheelSpeedSensor,
)
from aoro_gym.sensors.imu import specific_force
from aoro_gym.sensors.wheel_speed import ground_speed
from aoro_gym.twin.records import WHEELS

ALL = slice(None)
"""Rows of all sub-environments."""


def true_pose(outputs: Outputs, rows: Index) -> tuple[Array, Array, Array, Array]:
    """Position of the hinge [m] (K, 3), roll, pitch and yaw [rad] (K,) of the sub-environments ``rows``."""
    values = floats(outputs.group("position_x", 6)[-1][:, rows])
    return values[:3].T, values[3], values[4], values[5]


class VehicleSensors:
    """Sensors of N vehicles, and what they last read.

    Args:
        num_envs: N.
        config: Their noise.
        arrays: Where they live.
    """

    def __init__(self, num_envs: int, config: PathTrackingConfig, arrays: Arrays):
        self._arrays, self._config, n = arrays, config, num_envs
        self._noise = arrays.ones(n)
        self.roll, self.pitch = arrays.zeros(n), arrays.zeros(n)
        """Of the front frame [rad] (N,)."""
        self.rates, self.force = arrays.zeros((n, 3)), arrays.zeros((n, 3))
        """Of the front frame [rad/s], and its specific force [m/s²], (N, 3)."""
        self.wheel_rates, self.speed = arrays.zeros((n, 4)), arrays.zeros(n)
        """Of the wheels [rad/s] (N, 4), and over ground [m/s] (N,)."""
        self.joint = MeasuredJoint(
            n,
            config.joint_angle_noise,
            interval=config.sample_step,
            frames=round(config.control_step / config.sample_step),
            kept=config.rate_samples,
            arrays=arrays,
        )
        self._imu = Imu(n, config.imu_noise, accelerometers=config.observe_inertial, arrays=arrays)
        self._wheel_sensor = WheelSpeedSensor(n, config.wheel_speed_noise, arrays=arrays)
        self.gps = Gps(
            n, config.gps_noise, antennas=config.antennas, latency=config.gps_latency, interval=config.control_step,
            arrays=arrays,
        )  # fmt: skip
        self.localisation = _localisation(n, config, arrays)
        self._pressure_rows = {channel: row for row, channel in enumerate(_pressures_used(config))}
        self._pressures = arrays.zeros((len(self._pressure_rows), n))
        self._pressure_sensor = PressureSensor(n, config.pressure_noise, count=len(self._pressure_rows), arrays=arrays)

    def reset(self, rows: Index, generators: Generators, noise: Array) -> None:
        """New runs of the sensors ``rows`` (K,), from one generator each, with multiples (K,) of their noise."""
        for scale in (self._noise, self.joint.scale, self.gps.scale, self._imu.scale):
            self._arrays.put(scale, rows, noise)
        for sensor in (self.joint, self._imu, self._wheel_sensor, self.gps, self._pressure_sensor):
            sensor.reset(rows, generators)

    def begin(self, outputs: Outputs, reference: Array, rolling_radius: Array, where: Index) -> None:
        """The sub-environments ``where`` (K,) rest.

        Args:
            outputs: Of the twins.
            reference: The reference points in the front frames' axes [m] (N, 3).
            rolling_radius: Of the wheels [m] (N,).
            where: Sub-environments.
        """
        self.joint.begin(outputs.last("joint_angle")[where], where)
        fix = self._sense(outputs, rolling_radius, where, self._arrays.zeros(len(where)))
        measured = fix, self.roll[where], self.pitch[where], reference[where]
        if isinstance(self.localisation, PoseFilter):
            self.localisation.begin(*measured, rates=self.rates[where], indices=where)
        else:
            self.localisation.begin(*measured, where)

    def update(self, outputs: Outputs, reference: Array, rolling_radius: Array, time: Array) -> None:
        """One reading of all sensors at the end of a control step, at ``time`` [s] (N,); see :meth:`begin`."""
        self.joint.update(outputs.samples("joint_angle"), time)
        fix = self._sense(outputs, rolling_radius, ALL, time)
        measured = fix, self.roll, self.pitch, reference
        if isinstance(self.localisation, PoseFilter):
            self.localisation.update(*measured, speed=self.speed, rates=self.rates)
        else:
            self.localisation.update(
                *measured, speed=self.speed, yaw_rate=self.rates[:, 2], step=self._config.control_step
            )

    def pressure(self, channel: str) -> Array:
        """The last reading of a channel [Pa] (N,)."""
        return self._pressures[self._pressure_rows[channel]]

    def arm_pressures(self, end: str) -> Array:
        """The last readings at one end of the four arm cylinders, ``bore`` or ``rod`` [Pa] (4, N)."""
        first = self._pressure_rows[f"arm_pressure_{end}_{WHEELS[0]}"]  # those of the four corners follow each other
        return self._pressures[first : first + len(WHEELS)]

    def _sense(self, outputs: Outputs, rolling_radius: Array, rows: Index, time: Array) -> GpsReading:
        """One reading of every sensor but that of the joint; gives that of the GPS."""
        asked = None if rows is ALL else rows
        position, roll, pitch, yaw = true_pose(outputs, rows)
        noise = self._noise[rows]
        rates, force = floats(outputs.states("WX", 3)[:, rows]).T, None
        if self._config.observe_inertial:
            force = specific_force(
                outputs.states("VX", 3)[:, rows].T, outputs.states("AVX", 3)[:, rows].T, rates,
                outputs.states("AWX", 3)[:, rows].T, roll, pitch,
            )  # fmt: skip
        inertial = self._imu.measure(rates, force, roll, pitch, time, asked)
        self.roll[rows], self.pitch[rows], self.rates[rows] = inertial.roll, inertial.pitch, inertial.rates
        if inertial.force is not None:
            self.force[rows] = inertial.force

        true = floats(outputs.group(f"wheel_rate_{WHEELS[0]}", len(WHEELS))[-1][:, rows]).T
        shown = true + noise[:, None] * (self._wheel_sensor.measure(true, time, asked) - true)
        self.wheel_rates[rows] = shown
        self.speed[rows] = ground_speed(shown, rolling_radius[rows])
        if self._pressure_rows:
            level = floats(self._arrays.xp.stack([outputs.last(channel)[rows] for channel in self._pressure_rows]))
            self._pressures[:, rows] = level + noise * (self._pressure_sensor.measure(level, time, asked) - level)
        return self.gps.measure(position, roll, pitch, yaw, time, asked)


def _localisation(num_envs: int, config: PathTrackingConfig, arrays: Arrays) -> Localisation | PoseFilter:
    """Of the configuration's kind; the filter is told the sensors' stated errors."""
    chosen, antennas = config.localisation, config.antennas
    if isinstance(chosen, LocalisationGains):
        return Localisation(num_envs, antennas=antennas, gains=chosen, arrays=arrays)
    return PoseFilter(
        num_envs, settings=chosen, antennas=antennas, gps_noise=config.gps_noise, imu_noise=config.imu_noise,
        latency=config.gps_latency, step=config.control_step, arrays=arrays,
    )  # fmt: skip


def _pressures_used(config: PathTrackingConfig) -> list[str]:
    """Channels of the pressure sensors that a controller reads."""
    used = ["drive_pressure_forward", "drive_pressure_return"] if config.gear == "automatic" else []
    if config.arms is not None and not config.act_arms:
        used += [f"arm_pressure_{end}_{wheel}" for end in ("bore", "rod") for wheel in WHEELS]
    return used
