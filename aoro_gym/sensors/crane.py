"""Sensors of a crane: its joints, the pressures of its cylinders, and the load cell between tip and grapple.

The class of the crane is known, what is mounted on it is not: all figures are estimates (E).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.checks import check_integer, check_range
from aoro_gym.execution.array_api import HOST, Array, Arrays, Index
from aoro_gym.recording.commands import JOINTS
from aoro_gym.sensors.chain import SAMPLE_RATE
from aoro_gym.sensors.joint_angle import JointAngleNoise, JointAngleSensor, slope_weights
from aoro_gym.sensors.noise import chosen_rows, columns
from aoro_gym.sensors.pressure import PressureNoise, PressureSensor

TURNING = JOINTS[:3]
"""Joints that turn: slew, lift, fold."""
PRESSURES = tuple(f"crane_pressure_{side}_{joint}" for side in ("bore", "annulus") for joint in JOINTS)
"""Outputs of the twin that are the pressures of both chambers of all cylinders."""
RATE_SAMPLES = 5
"""Samples of a joint whose slope is its measured rate. (E: 50 ms)"""


def _angle_noise() -> JointAngleNoise:
    """E: rotary sensors of 12 bits a turn with a quarter of a bit of white noise, as on the arms."""
    return JointAngleNoise(white=math.radians(0.022), resolution=2.0 * math.pi / 2**12)


def _cell_noise() -> PressureNoise:
    """E: a load pin of 40 kN in the tip: half a per cent of zero error, a tenth of white noise, 12 bits; the chain is that
    of pressure sensors, in newtons."""
    return PressureNoise(low=0.0, high=4e4, zero_error=200.0, white=40.0, resolution=4e4 / 2**12)


@dataclass(frozen=True)
class CraneNoise:
    """What the sensors of a crane add."""

    angle: JointAngleNoise = field(default_factory=_angle_noise)
    """Of slew, lift and fold."""
    telescope: float = 0.003
    """Standard deviation [m] of the telescope's length. E"""
    pressure: PressureNoise = field(default_factory=PressureNoise.typical)
    load: PressureNoise = field(default_factory=_cell_noise)
    """Of the load cell, in newtons."""
    delay: float = 0.0
    """Age [s] of the joints that a sample shows."""

    def __post_init__(self) -> None:
        check_range("telescope", self.telescope, "m", ge=0.0, lt=math.inf)
        check_range("delay", self.delay, "s", ge=0.0, lt=math.inf)


class CraneSensors:
    """Sensors of the cranes of N twins.

    Args:
        num_twins: N.
        noise: What they add; :class:`CraneNoise` by default.
        pressures: Channels of the pressures that are measured.
        interval: Time [s] between two samples of :meth:`measure`.
        arrays: Where they live.
    """

    def __init__(
        self,
        num_twins: int = 1,
        noise: CraneNoise | None = None,
        *,
        pressures: Sequence[str] = PRESSURES,
        interval: float = 1.0 / SAMPLE_RATE,
        arrays: Arrays = HOST,
    ):
        check_integer("num_twins", num_twins)
        self.num_twins = num_twins
        self.noise = CraneNoise() if noise is None else noise
        self.pressures = tuple(pressures)
        """Channels of :meth:`measure`'s pressures."""
        self._arrays = arrays
        given: Any = {"delay": self.noise.delay, "interval": interval, "arrays": arrays}
        # one angle sensor a joint, those of a crane side by side
        self._angles = JointAngleSensor(len(TURNING) * num_twins, self.noise.angle, **given)
        self._length = JointAngleSensor(num_twins, JointAngleNoise(white=self.noise.telescope), **given)  # in metres
        self._pressure = PressureSensor(num_twins, self.noise.pressure, count=len(self.pressures), arrays=arrays)
        self._cell = PressureSensor(num_twins, self.noise.load, arrays=arrays)

    def reset(self, indices: Index, rngs: Sequence[np.random.Generator]) -> None:
        """Begin a new run of the twins ``indices`` (K,), with one generator each."""
        where = np.atleast_1d(np.asarray(indices, dtype=np.int64))
        each = (where[:, None] * len(TURNING) + np.arange(len(TURNING))).ravel()
        self._angles.reset(each, [rng for rng in rngs for _ in TURNING])
        for sensor in (self._length, self._pressure, self._cell):
            sensor.reset(where, rngs)

    def measure(
        self, joints: Array, pressures: Array, load: Array, time: Array, indices: Index | None = None
    ) -> tuple[Array, Array, Array]:
        """One sample of the twins ``indices`` (K,), all by default: joints (4, K), pressures (C, K) and load (K,).

        Args:
            joints: True slew, lift, fold [rad] and telescope [m], (4, K).
            pressures: True pressures [Pa] of the channels ``pressures``, (C, K).
            load: True force [N] on the tip, (K,).
            time: [s] since the twin's reset, (K,).
            indices: Which twins.
        """
        arrays, xp = self._arrays, self._arrays.xp
        rows, k = chosen_rows(indices, self.num_twins, arrays)
        count = len(TURNING)
        true = columns("joints", joints, (count + 1, k), arrays)
        number = arrays.arange(self.num_twins)[rows]
        each = (number[:, None] * count + arrays.arange(count)).reshape(-1)
        when = xp.stack([time] * count, axis=1).reshape(-1)
        turned = self._angles.measure(true[:count].T.reshape(-1), when, each).reshape(-1, count).T
        asked = None if isinstance(rows, slice) else rows
        slid = self._length.measure(true[count], time, asked)
        return (
            xp.concat([turned, slid[None]]),
            self._pressure.measure(pressures, time, asked),
            self._cell.measure(load, time, asked),
        )

    def record(
        self, channels: Mapping[str, ArrayLike], time: ArrayLike, rng: np.random.Generator
    ) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]:
        """A whole log of one crane: ticks [s] (K,), and by the twin's output names what is measured (K,), SI: joints, their
        rates, pressures and the load.

        A rate is the slope of the line through the last :data:`RATE_SAMPLES` samples of its joint, as a controller can know
        it: 20 ms late.

        Args:
            channels: Outputs of a twin (F,), evenly spaced, at rest in the first sample.
            time: Instants [s] (F,).
            rng: Draws all that is random.
        """
        measured: dict[str, NDArray[np.float64]] = {}
        ticks = np.zeros(0)
        for joint, stream in zip(JOINTS, rng.spawn(len(JOINTS)), strict=True):
            noise = self.noise.angle if joint in TURNING else JointAngleNoise(white=self.noise.telescope)
            sensor = JointAngleSensor(1, noise, delay=self.noise.delay)
            ticks, values = sensor.record(channels[f"crane_joint_{joint}"], time, stream)
            measured[f"crane_joint_{joint}"] = values
            measured[f"crane_rate_{joint}"] = slopes(values)
        for name, stream in zip(self.pressures, rng.spawn(len(self.pressures)), strict=True):
            measured[name] = PressureSensor(1, self.noise.pressure).record(channels[name], time, stream)[1]
        measured["crane_tip_load"] = PressureSensor(1, self.noise.load).record(channels["crane_tip_load"], time, rng)[1]
        return ticks, measured


def slopes(values: NDArray[np.float64], interval: float = 1.0 / SAMPLE_RATE) -> NDArray[np.float64]:
    """Slopes [1/s] (K,) of the lines through the last :data:`RATE_SAMPLES` of ``values`` (K,), ``interval`` [s] apart, at
    rest before the first."""
    weights = slope_weights(RATE_SAMPLES, interval)
    padded = np.concatenate([np.full(RATE_SAMPLES - 1, values[0]), values])
    return np.asarray(sum(weight * padded[RATE_SAMPLES - 1 - i : len(padded) - i] for i, weight in enumerate(weights)))
