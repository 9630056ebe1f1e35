"""What is measured on a crane: its joints, pressures, the load cell at its tip, and where a camera sees the log."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aoro_gym.envs.core.task import Outputs
from aoro_gym.envs.loading.config import LoadingConfig
from aoro_gym.execution.array_api import Array, Arrays, Index, floats
from aoro_gym.sensors import CraneNoise, CraneSensors
from aoro_gym.twin.records import CraneRow

PRESSURES = ("crane_pressure_bore_lift", "crane_pressure_bore_fold", "crane_pressure_annulus_fold", "pump_pressure")
"""Channels of the pressures that are measured."""


class LoadingSensors:
    """Sensors of N cranes, and what they last read.

    Args:
        num_envs: N.
        config: Their noise.
        arrays: Where they live.
    """

    def __init__(self, num_envs: int, config: LoadingConfig, arrays: Arrays):
        n, self._arrays, self._config = num_envs, arrays, config
        self._noise = arrays.ones(n)
        noise = CraneNoise(
            config.joint_angle_noise, config.telescope_noise, config.pressure_noise, config.load_noise
        )  # fmt: skip
        self._crane = CraneSensors(n, noise, pressures=PRESSURES, interval=config.control_step, arrays=arrays)
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
        self._crane.reset(where, generators)
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
        xp, noise, first = self._arrays.xp, self._noise[rows], int(CraneRow.JOINT_SLEW)
        assert outputs.state is not None
        joints = floats(outputs.state[first : first + 4][:, rows])
        level = xp.stack([floats(outputs.last(channel)[rows]) for channel in PRESSURES])
        force = floats(outputs.state[int(CraneRow.TIP_LOAD)][rows])
        shown = self._crane.measure(joints, level, force, time, None if isinstance(rows, slice) else rows)
        for kept, true, one in zip(
            (self.joints, self.pressures, self.load), (joints, level, force), shown, strict=True
        ):
            kept[..., rows] = true + noise * (one - true)
