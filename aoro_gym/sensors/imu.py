"""The inertial unit on the front frame: rates, specific force, and roll and pitch from its own filter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.sensors.attitude import in_world
from aoro_gym.sensors.chain import SAMPLE_RATE
from aoro_gym.sensors.noise import (
    Drift,
    Seeds,
    channel,
    checked_generators,
    chosen_rows,
    columns,
    draw_seeds,
    tick,
    white,
)


@dataclass(frozen=True)
class ImuNoise:
    """Errors of each axis, rms; biases and attitude errors wander."""

    rate_white: float = 0.0  # [rad/s]
    rate_bias: float = 0.0  # [rad/s]
    force_white: float = 0.0  # [m/s²]
    force_bias: float = 0.0  # [m/s²]
    bias_time: float = 300.0  # [s] correlation time of both biases
    attitude_white: float = 0.0  # [rad] of roll and pitch
    attitude_drift: float = 0.0  # [rad]
    attitude_time: float = 5.0  # [s] its correlation time

    def __post_init__(self) -> None:
        for name in ("rate_white", "rate_bias", "force_white", "force_bias", "attitude_white", "attitude_drift"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"{name} is {getattr(self, name)}, but must be at least 0")
        for name in ("bias_time", "attitude_time"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} is {getattr(self, name)} s, but must be above 0 and finite")

    @classmethod
    def typical(cls) -> ImuNoise:
        """A micromechanical unit with an attitude filter.

        E, after data sheets: 0.007 °/s/√Hz and 120 µg/√Hz (Xsens MTi-1) over 50 Hz; roll and pitch to 0.2° at rest and
        0.5° in motion (Xsens MTi-30, user manual MT0605P, section 4.3). Biases are what a filter leaves: 0.1 °/s, 2 mg.
        """
        return cls(
            rate_white=math.radians(0.007 * math.sqrt(50.0)),
            rate_bias=math.radians(0.1),
            force_white=120e-6 * 9.81 * math.sqrt(50.0),
            force_bias=2e-3 * 9.81,
            attitude_white=math.radians(0.05),
            attitude_drift=math.radians(0.4),
        )


@dataclass(frozen=True)
class ImuReading:
    """One sample of K units, in the front frame's axes."""

    rates: NDArray[np.float64]
    """Angular velocity [rad/s] (K, 3)."""
    force: NDArray[np.float64]
    """Specific force [m/s²] (K, 3): acceleration less gravity, so (0, 0, 9.81) at rest on level ground."""
    roll: NDArray[np.float64]
    """[rad] (K,), positive where the left side is up."""
    pitch: NDArray[np.float64]
    """[rad] (K,), positive where the nose is down."""


class Imu:
    """The units of N twins.

    Args:
        num_twins: How many.
        noise: Their errors; :meth:`ImuNoise.typical` by default, ``ImuNoise()`` for none.
    """

    def __init__(self, num_twins: int = 1, noise: ImuNoise | None = None):
        if num_twins < 1:
            raise ValueError(f"num_twins is {num_twins}, but must be at least 1")
        self.num_twins = num_twins
        self.noise = ImuNoise.typical() if noise is None else noise
        self.scale = np.ones(num_twins)
        """Multiplier [-] of each unit's errors (N,)."""
        self._seeds: Seeds = np.zeros(num_twins, dtype=np.uint64)
        drift = {"rate": SAMPLE_RATE, "num_twins": num_twins}
        bias = [self.noise.rate_bias] * 3 + [self.noise.force_bias] * 3
        self._bias = Drift(bias, time=self.noise.bias_time, **drift)
        self._attitude = Drift([self.noise.attitude_drift] * 2, time=self.noise.attitude_time, **drift)
        self.reset(np.arange(num_twins), np.random.default_rng(0).spawn(num_twins))

    def reset(self, indices: ArrayLike, rngs: Sequence[np.random.Generator]) -> None:
        """Begin a new run of the twins ``indices`` (K,), with one generator each."""
        rows = chosen_rows(indices, self.num_twins)
        checked_generators(rngs, rows)
        seeds = draw_seeds(rngs)
        self._seeds[rows] = seeds
        self._bias.reset(rows, channel(seeds, 0))
        self._attitude.reset(rows, channel(seeds, 1))

    def measure(
        self,
        rates: ArrayLike,
        force: ArrayLike,
        roll: ArrayLike,
        pitch: ArrayLike,
        time: ArrayLike,
        indices: ArrayLike | None = None,
    ) -> ImuReading:
        """One sample of each unit.

        Args:
            rates: True angular velocity [rad/s] (K, 3) in the front frame's axes.
            force: True specific force [m/s²] (K, 3) where the unit sits; see :func:`specific_force`.
            roll: True attitude [rad] (K,).
            pitch: Likewise.
            time: Time [s] since the twin's reset, scalar or (K,), not before that of the last call.
            indices: Which twins, integers (K,); all by default. The others stay as they are.
        """
        rows = chosen_rows(indices, self.num_twins)
        k, noise = len(rows), self.noise
        number = tick(np.broadcast_to(np.asarray(time, dtype=np.float64), (k,)), SAMPLE_RATE)
        seeds = self._seeds[rows]
        scale = self.scale[rows]
        bias = scale * self._bias.at(rows, number)
        attitude = scale * self._attitude.at(rows, number)
        random = scale * np.stack([white(channel(seeds, 2 + i), number) for i in range(8)])
        return ImuReading(
            rates=columns("rates", rates, (k, 3)) + (bias[:3] + noise.rate_white * random[:3]).T,
            force=columns("force", force, (k, 3)) + (bias[3:] + noise.force_white * random[3:6]).T,
            roll=columns("roll", roll, (k,)) + attitude[0] + noise.attitude_white * random[6],
            pitch=columns("pitch", pitch, (k,)) + attitude[1] + noise.attitude_white * random[7],
        )


def specific_force(
    velocity: ArrayLike,
    acceleration: ArrayLike,
    rates: ArrayLike,
    angular_acceleration: ArrayLike,
    roll: ArrayLike,
    pitch: ArrayLike,
    *,
    place: ArrayLike = (0.0, 0.0, 0.0),
    gravity: float = 9.81,
) -> NDArray[np.float64]:
    """Specific force [m/s²] (N, 3) at a point of the front frame, in its axes: v̇ + ω×v + ω̇×r + ω×(ω×r) − g.

    Args:
        velocity: Of the frame's origin in its own axes [m/s] (N, 3).
        acceleration: Rate of change of these components [m/s²] (N, 3).
        rates: ω [rad/s] (N, 3).
        angular_acceleration: ω̇ [rad/s²] (N, 3).
        roll: [rad] (N,).
        pitch: [rad] (N,).
        place: r [m], the point in the frame's axes (3,).
        gravity: [m/s²].
    """
    omega = np.asarray(rates, dtype=np.float64)
    lever = np.broadcast_to(np.asarray(place, dtype=np.float64), omega.shape)
    inertial = np.asarray(acceleration) + np.cross(omega, np.asarray(velocity))
    inertial = inertial + np.cross(np.asarray(angular_acceleration), lever) + np.cross(omega, np.cross(omega, lever))
    # the world's vertical in the frame's axes: the third row of R, which yaw leaves alone
    vertical = np.stack([in_world(roll, pitch, np.zeros_like(omega[:, 0]), axis)[:, 2] for axis in np.eye(3)], axis=1)
    return inertial + gravity * vertical
