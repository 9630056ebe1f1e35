"""What is measured at the arms (their angles, the pressures in their cylinders, that of their pump), and a map of the
ground."""

from __future__ import annotations

import numpy as np

from aoro_gym.envs.core.task import Outputs
from aoro_gym.envs.levelling.config import LevellingConfig
from aoro_gym.envs.path_tracking.courses import HeightMap
from aoro_gym.execution.array_api import Array, Arrays, Index, floats
from aoro_gym.sensors import JointAngleSensor, PressureSensor
from aoro_gym.sensors.chain import SAMPLE_RATE
from aoro_gym.sensors.noise import channels, draw_seeds, tick, white
from aoro_gym.twin.records import WHEELS

CORNERS = len(WHEELS)


class ArmSensors:
    """Sensors at the arms of N machines, and what they last read.

    Args:
        num_envs: N.
        config: Their noise.
        arrays: Where they live.
    """

    def __init__(self, num_envs: int, config: LevellingConfig, arrays: Arrays):
        n, self._arrays, self._step = num_envs, arrays, config.control_step
        self._noise = arrays.ones(n)
        # one angle sensor an arm, those of a machine side by side
        self._angle_sensor = JointAngleSensor(
            CORNERS * n, config.arm_angle_noise, interval=config.control_step, arrays=arrays
        )
        self._pressure_sensor = PressureSensor(n, config.pressure_noise, count=2 * CORNERS + 1, arrays=arrays)
        self.angles, self.rates = arrays.zeros((CORNERS, n)), arrays.zeros((CORNERS, n))
        """Of the arms [rad], and their differences over a control step [rad/s], (4, N)."""
        self._pressures = arrays.zeros((2 * CORNERS + 1, n))

    def reset(self, where: np.ndarray, generators: list[np.random.Generator], noise: np.ndarray) -> None:
        """New runs of the sensors of the machines ``where`` (K,), from one generator each, with multiples (K,) of their
        noise."""
        arrays = self._arrays
        arrays.put(self._noise, arrays.index(where), noise)
        each = (where[:, None] * CORNERS + np.arange(CORNERS)).ravel()
        self._angle_sensor.reset(arrays.index(each), [generator for generator in generators for _ in range(CORNERS)])
        self._pressure_sensor.reset(arrays.index(where), generators)

    def begin(self, outputs: Outputs, where: Index) -> None:
        """First readings of the machines ``where`` (K,), at rest."""
        self._read(outputs, where, self._arrays.zeros(len(where)))
        self.rates[:, where] = 0.0

    def update(self, outputs: Outputs, time: Array) -> None:
        """Readings of all at the end of a control step, at ``time`` [s] (N,)."""
        before = self._arrays.xp.asarray(self.angles, copy=True)
        self._read(outputs, slice(None), time)
        self.rates = (self.angles - before) / self._step

    def supports(self, rod_share: Array) -> Array:
        """What the cylinders bear [Pa] (4, N): pressure at the bore less the rod's share (N,) of that at the rod."""
        return self._pressures[:CORNERS] - rod_share * self._pressures[CORNERS : 2 * CORNERS]

    @property
    def supply(self) -> Array:
        """Pressure of the pump [Pa] (N,)."""
        return self._pressures[-1]

    def _read(self, outputs: Outputs, rows: Index, time: Array) -> None:
        arrays, xp = self._arrays, self._arrays.xp
        noise = self._noise[rows]
        true = floats(outputs.group(f"arm_angle_{WHEELS[0]}", CORNERS)[-1][:, rows])
        count = true.shape[1]
        number = arrays.arange(len(self._noise))[rows]
        each = (number[:, None] * CORNERS + arrays.arange(CORNERS)).reshape(-1)
        flat = true.T.reshape(-1)
        when = xp.stack([time] * CORNERS, axis=1).reshape(-1)
        shown = self._angle_sensor.measure(flat, when, each).reshape(count, CORNERS).T
        self.angles[:, rows] = true + noise * (shown - true)
        level = xp.concat(
            [
                floats(outputs.group(f"arm_pressure_bore_{WHEELS[0]}", 2 * CORNERS)[-1][:, rows]),
                floats(outputs.last("pump_pressure")[rows])[None],
            ]
        )
        asked = None if isinstance(rows, slice) else rows
        self._pressures[:, rows] = level + noise * (self._pressure_sensor.measure(level, time, asked) - level)


class GroundMap:
    """Heights of the ground in the two tracks of N machines, as a map from lidar sweeps gives them: true ones with noise,
    in a map that lies beside its place.

    Args:
        num_envs: N.
        config: Places and errors.
        arrays: Where they live.
    """

    def __init__(self, num_envs: int, config: LevellingConfig, arrays: Arrays):
        n, self._arrays, self._config = num_envs, arrays, config
        places = [(x, side) for side in (1.0, -1.0) for x in config.ground_ahead]
        self._places = arrays.asarray(places)  # (2 K, 2) [m] ahead, side
        self._noise = arrays.ones(n)
        self._offset = arrays.zeros((n, 2))  # [m]
        self._seeds = arrays.zeros((len(places), n), arrays.xp.int64)
        self.heights = arrays.zeros((n, len(places)))
        """Over their mean [m] (N, 2 K)."""

    def reset(self, where: np.ndarray, generators: list[np.random.Generator], noise: np.ndarray) -> None:
        """New maps of the machines ``where`` (K,), from one generator each, with multiples (K,) of their errors."""
        arrays, rows = self._arrays, self._arrays.index(where)
        offset = np.array([generator.standard_normal(2) for generator in generators]) * self._config.ground_offset
        arrays.put(self._noise, rows, noise)
        arrays.put(self._offset, rows, offset * np.asarray(noise)[:, None])
        seeds = channels(draw_seeds(generators), range(self._seeds.shape[0]))
        arrays.put(self._seeds, (slice(None), rows), seeds)

    def read(
        self, outputs: Outputs, height_map: HeightMap, ground: Array, half_track: Array, time: Array, rows: Index
    ) -> None:
        """Heights at the end of a step.

        Args:
            outputs: Of the twins.
            height_map: The grounds.
            ground: Which of them each machine stands on (N,).
            half_track: Middle to wheel [m] (N,).
            time: [s] (K,).
            rows: Of the machines that read (K,).
        """
        xp = self._arrays.xp
        x, y, yaw = (floats(outputs.last(name))[rows] for name in ("position_x", "position_y", "yaw"))
        s, c = xp.sin(yaw)[:, None], xp.cos(yaw)[:, None]
        ahead = self._places[:, 0] + self._offset[rows, 0][:, None]
        left = self._places[:, 1] * half_track[rows][:, None] + self._offset[rows, 1][:, None]
        places = xp.stack([x[:, None] + c * ahead - s * left, y[:, None] + s * ahead + c * left], axis=-1)
        error = self._config.ground_noise * self._noise[rows] * white(self._seeds[:, rows], tick(time, SAMPLE_RATE))
        shown = height_map.height(ground[rows][:, None], places) + error.T
        mean = shown[:, 0]
        for column in range(1, shown.shape[1]):  # in an order that does not depend on the number of machines
            mean = mean + shown[:, column]
        self.heights[rows] = shown - (mean / shown.shape[1])[:, None]
