"""The inertial unit on the front frame: rates, specific force, and roll and pitch from its own filter."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from aoro_gym.checks import check_integer, check_range
from aoro_gym.execution.array_api import HOST, Array, Arrays, Index, floats, namespace
from aoro_gym.execution.streams import Generators
from aoro_gym.sensors.chain import SAMPLE_RATE
from aoro_gym.sensors.noise import (
    Drift,
    Seeds,
    channel,
    channels,
    checked_generators,
    chosen_rows,
    columns,
    draw_seeds,
    instants,
    tick,
    white,
)
from aoro_gym.units import GRAVITY


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
            check_range(name, getattr(self, name), ge=0.0)
        for name in ("bias_time", "attitude_time"):
            check_range(name, getattr(self, name), "s", gt=0.0, lt=math.inf)

    @classmethod
    def typical(cls) -> ImuNoise:
        """A micromechanical unit with an attitude filter.

        E, after data sheets: 0.007 °/s/√Hz and 120 µg/√Hz (Xsens MTi-1) over 50 Hz; roll and pitch to 0.2° at rest and
        0.5° in motion (Xsens MTi-30, user manual MT0605P, section 4.3). Biases are what a filter leaves: 0.1 °/s, 2 mg.
        """
        return cls(
            rate_white=math.radians(0.007 * math.sqrt(50.0)),
            rate_bias=math.radians(0.1),
            force_white=120e-6 * GRAVITY * math.sqrt(50.0),
            force_bias=2e-3 * GRAVITY,
            attitude_white=math.radians(0.05),
            attitude_drift=math.radians(0.4),
        )


@dataclass(frozen=True)
class ImuReading:
    """One sample of K units, in the front frame's axes."""

    rates: Array
    """Angular velocity [rad/s] (K, 3)."""
    force: Array | None
    """Specific force [m/s²] (K, 3): acceleration less gravity, so (0, 0, 9.81) at rest on level ground."""
    roll: Array
    """[rad] (K,), positive where the left side is up."""
    pitch: Array
    """[rad] (K,), positive where the nose is down."""


class Imu:
    """The units of N twins.

    Args:
        num_twins: How many.
        noise: Their errors; :meth:`ImuNoise.typical` by default, ``ImuNoise()`` for none.
        accelerometers: Whether they show the specific force, too.
        arrays: Where they live.
    """

    def __init__(
        self,
        num_twins: int = 1,
        noise: ImuNoise | None = None,
        *,
        accelerometers: bool = True,
        arrays: Arrays = HOST,
    ):
        check_integer("num_twins", num_twins)
        self.num_twins = num_twins
        self.noise = ImuNoise.typical() if noise is None else noise
        self.scale = arrays.ones(num_twins)
        """Multiplier [-] of each unit's errors (N,)."""
        self._arrays = arrays
        self._axes = 6 if accelerometers else 3  # rates, then forces; the attitude follows them
        drifts = (
            [self.noise.rate_bias] * 3 + [self.noise.force_bias] * (self._axes - 3) + [self.noise.attitude_drift] * 2
        )
        times = [self.noise.bias_time] * self._axes + [self.noise.attitude_time] * 2
        whites = (
            [self.noise.rate_white] * 3 + [self.noise.force_white] * (self._axes - 3) + [self.noise.attitude_white] * 2
        )
        self._drift = Drift(drifts, time=times, rate=SAMPLE_RATE, num_twins=num_twins, arrays=arrays)
        self._white = arrays.asarray(whites)[:, None]
        self._seeds: Seeds = arrays.zeros((self._axes + 2, num_twins), arrays.xp.int64)
        self.reset(np.arange(num_twins), np.random.default_rng(0).spawn(num_twins))

    def reset(self, indices: Index, rngs: Generators) -> None:
        """Begin a new run of the twins ``indices`` (K,), with one generator each."""
        rows, k = chosen_rows(indices, self.num_twins, self._arrays)
        checked_generators(rngs, k)
        seeds = draw_seeds(rngs)
        bias, attitude = channels(channel(seeds, 0), range(self._axes)), channels(channel(seeds, 1), range(2))
        self._drift.reset(rows, np.concatenate([bias, attitude]))
        numbers = [2 + axis for axis in (*range(self._axes), 6, 7)]
        self._arrays.put(self._seeds, (slice(None), rows), channels(seeds, numbers))

    def measure(
        self,
        rates: Array,
        force: Array | None,
        roll: Array,
        pitch: Array,
        time: Array,
        indices: Index | None = None,
    ) -> ImuReading:
        """One sample of each unit.

        Args:
            rates: True angular velocity [rad/s] (K, 3) in the front frame's axes.
            force: True specific force [m/s²] (K, 3) where the unit sits; see :func:`specific_force`. None for units
                without accelerometers.
            roll: True attitude [rad] (K,).
            pitch: Likewise.
            time: Time [s] since the twin's reset, scalar or (K,), not before that of the last call.
            indices: Which twins, integers (K,); all by default. The others stay as they are.
        """
        arrays = self._arrays
        rows, k = chosen_rows(indices, self.num_twins, arrays)
        number = tick(instants(time, k, arrays), SAMPLE_RATE)
        error = self._drift.at(rows, number) + self._white * white(self._seeds[:, rows], number)
        error = self.scale[rows] * error
        return ImuReading(
            rates=columns("rates", rates, (k, 3), arrays) + error[:3].T,
            force=None if self._axes == 3 else columns("force", force, (k, 3), arrays) + error[3:6].T,
            roll=columns("roll", roll, (k,), arrays) + error[-2],
            pitch=columns("pitch", pitch, (k,), arrays) + error[-1],
        )


def specific_force(
    velocity: Array,
    acceleration: Array,
    rates: Array,
    angular_acceleration: Array,
    roll: Array,
    pitch: Array,
    *,
    place: tuple[float, float, float] = (0.0, 0.0, 0.0),
    gravity: float = GRAVITY,
) -> Array:
    """Specific force [m/s²] (N, 3) at a point of the front frame, in its axes: v̇ + ω×v + ω̇×r + ω×(ω×r) − g.

    Args:
        velocity: Of the frame's origin in its own axes [m/s] (N, 3).
        acceleration: Rate of change of these components [m/s²] (N, 3).
        rates: ω [rad/s] (N, 3).
        angular_acceleration: ω̇ [rad/s²] (N, 3).
        roll: [rad] (N,).
        pitch: [rad] (N,).
        place: r [m], the point in the frame's axes.
        gravity: [m/s²].
    """
    xp, cross = namespace(rates), namespace(rates).linalg.cross
    omega, roll, pitch = floats(rates), floats(roll), floats(pitch)
    inertial = floats(acceleration) + cross(omega, floats(velocity))
    if any(place):
        lever = xp.stack([xp.full_like(roll, coordinate) for coordinate in place], axis=1)
        inertial = inertial + cross(floats(angular_acceleration), lever) + cross(omega, cross(omega, lever))
    # the world's vertical in the frame's axes: the third row of R, see in_world
    vertical = xp.stack([-xp.sin(pitch), xp.sin(roll) * xp.cos(pitch), xp.cos(roll) * xp.cos(pitch)], axis=1)
    return inertial + gravity * vertical
