"""What is measured on a crane: its joints, pressures, the load cell at its tip, and where a camera sees the log."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aoro_gym.envs.core.task import Outputs
from aoro_gym.envs.loading.config import LoadingConfig
from aoro_gym.execution.array_api import Array, Arrays, Index, floats
from aoro_gym.sensors import JointAngleSensor, PressureSensor
from aoro_gym.sensors.chain import SAMPLE_RATE
from aoro_gym.sensors.noise import draw_seeds, tick, white
from aoro_gym.twin.records import CraneRow

TURNING = 3
"""Joints that turn: slew, lift, fold."""
PRESSURES = ("crane_pressure_bore_lift", "crane_pressure_bore_fold", "crane_pressure_annulus_fold", "pump_pressure")
"""Channels of the pressures that are measured."""


class CraneSensors:
    """Sensors of N cranes, and what they last read.

    Args:
        num_envs: N.
        config: Their noise.
        arrays: Where they live.
    """

    def __init__(self, num_envs: int, config: LoadingConfig, arrays: Arrays):
        n, self._arrays, self._config = num_envs, arrays, config
        self._noise = arrays.ones(n)
        # one angle sensor a joint, those of a crane side by side
        self._angles = JointAngleSensor(
            TURNING * n, config.joint_angle_noise, interval=config.control_step, arrays=arrays
        )
        self._seeds = arrays.zeros(n, arrays.xp.int64)
        self._pressure = PressureSensor(n, config.pressure_noise, count=len(PRESSURES), arrays=arrays)
        self._cell = PressureSensor(n, config.load_noise, arrays=arrays)
        self.joints, self.rates = arrays.zeros((4, n)), arrays.zeros((4, n))
        """Slew, lift, fold [rad] and telescope [m], and their differences over a control step, (4, N)."""
        self.pressures = arrays.zeros((len(PRESSURES), n))
        """[Pa] (4, N)"""
        self.load = arrays.zeros(n)
        """[N] (N,)"""
        self.offset = arrays.zeros((3, n))
        """Of the camera's log: along x, along y [m], and of its angle [rad]."""

    def reset(self, where: NDArray[np.intp], generators: list[np.random.Generator], noise: NDArray[np.float64]) -> None:
        """New runs of the sensors of the cranes ``where`` (K,), from one generator each, with multiples (K,) of their
        noise."""
        arrays, rows, config = self._arrays, self._arrays.index(where), self._config
        arrays.put(self._noise, rows, noise)
        each = (where[:, None] * TURNING + np.arange(TURNING)).ravel()
        self._angles.reset(arrays.index(each), [generator for generator in generators for _ in range(TURNING)])
        arrays.put(self._seeds, rows, draw_seeds(generators))
        self._pressure.reset(rows, generators)
        self._cell.reset(rows, generators)
        spread = np.array([config.log_offset, config.log_offset, config.log_angle_offset])
        drawn = np.array([generator.standard_normal(3) for generator in generators]) * spread * noise[:, None]
        arrays.put(self.offset, (slice(None), rows), drawn.T)

    def begin(self, outputs: Outputs, where: Index) -> None:
        """First readings of the cranes ``where`` (K,), at rest."""
        self._read(outputs, where, self._arrays.zeros(len(where)))
        self.rates[:, where] = 0.0

    def update(self, outputs: Outputs, time: Array) -> None:
        """Readings of all at the end of a control step, at ``time`` [s] (N,)."""
        before = self._arrays.copy(self.joints)
        self._read(outputs, slice(None), time)
        self.rates = (self.joints - before) / self._config.control_step

    def _read(self, outputs: Outputs, rows: Index, time: Array) -> None:
        arrays, xp = self._arrays, self._arrays.xp
        noise = self._noise[rows]
        first = int(CraneRow.JOINT_SLEW)
        assert outputs.state is not None
        true = floats(outputs.state[first : first + 4][:, rows])
        number = arrays.arange(len(self._noise))[rows]
        each = (number[:, None] * TURNING + arrays.arange(TURNING)).reshape(-1)
        when = xp.stack([time] * TURNING, axis=1).reshape(-1)
        shown = self._angles.measure(true[:TURNING].T.reshape(-1), when, each).reshape(-1, TURNING).T
        slid = self._config.telescope_noise * white(self._seeds[rows], tick(time, SAMPLE_RATE))
        self.joints[:, rows] = true + noise * (xp.concat([shown, (true[TURNING] + slid)[None]]) - true)
        asked = None if isinstance(rows, slice) else rows
        level = xp.stack([floats(outputs.last(channel)[rows]) for channel in PRESSURES])
        self.pressures[:, rows] = level + noise * (self._pressure.measure(level, time, asked) - level)
        force = floats(outputs.state[int(CraneRow.TIP_LOAD)][rows])
        self.load[rows] = force + noise * (self._cell.measure(force, time, asked) - force)
