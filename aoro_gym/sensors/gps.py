"""RTK-GPS with two antennas on the front frame: a position, and a heading from the line between the antennas.

The receiver computes ten solutions a second. Each shows where the antennas were at one instant, comes out a latency
later, and stays until the next one. The antennas stand high, so that roll and pitch move them in the plan: 2.2 m above
the ground 5 degrees of roll are 0.19 m.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.sensors.attitude import in_world, wrapped
from aoro_gym.sensors.noise import (
    Drift,
    Seeds,
    channel,
    checked_generators,
    chosen_rows,
    columns,
    draw_seeds,
    uniform,
    white,
)

RATE = 10.0
"""Solutions a second [Hz]."""
NONE, FLOAT, FIXED = 0, 1, 2
"""Quality of a solution: no satellites, ambiguities of the carrier not resolved, resolved."""

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Antennas:
    """Where the antennas stand in the front frame's axes [m], from the point on the ground under the hinge at rest."""

    main: Point = (1.0, 0.6, 2.2)
    """The one whose position is given. E: 2.2 m high, 1.2 m apart across the front frame."""
    auxiliary: Point = (1.0, -0.6, 2.2)
    """The one that the heading is measured to."""

    def __post_init__(self) -> None:
        if self.baseline < 0.1:
            raise ValueError(f"the antennas are {self.baseline:.3f} m apart in the plan, but must be 0.1 m or more")

    @property
    def baseline(self) -> float:
        """Distance [m] of the antennas in the plan."""
        return math.hypot(self.auxiliary[0] - self.main[0], self.auxiliary[1] - self.main[1])

    @property
    def direction(self) -> float:
        """Direction [rad] of the line from the main to the auxiliary antenna, from straight on, positive left."""
        return math.atan2(self.auxiliary[1] - self.main[1], self.auxiliary[0] - self.main[0])


@dataclass(frozen=True)
class FixLoss:
    """Times without a fixed solution, as under trees: a chain of three states with exponential durations [s]."""

    interval: float = math.inf
    """Mean time between two losses; infinite: none."""
    float_duration: float = 8.0
    none_duration: float = 3.0
    none_share: float = 0.3
    """Share [-] of losses in which there is no solution at all; float in the others."""

    def __post_init__(self) -> None:
        for name in ("interval", "float_duration", "none_duration"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} is {getattr(self, name)} s, but must be above 0")
        if not 0.0 <= self.none_share <= 1.0:
            raise ValueError(f"none_share is {self.none_share}, but must be in [0, 1]")


@dataclass(frozen=True)
class GpsNoise:
    """Errors of a solution; rms of each horizontal axis unless said otherwise."""

    white: float = 0.0  # [m] new in every solution
    drift: float = 0.0  # [m] wanders: atmosphere, multipath
    drift_time: float = 60.0  # [s] its correlation time
    relative: float = 0.0  # [m] of one antenna against the other: heading error = relative / baseline
    vertical: float = 1.0  # [-] vertical errors in units of the horizontal ones
    float_drift: float = 0.0  # [m] as drift, in a float solution
    float_drift_time: float = 20.0  # [s]
    float_relative: float = 0.0  # [m] as relative, in a float solution
    loss: FixLoss = FixLoss()

    def __post_init__(self) -> None:
        for name in ("white", "drift", "relative", "vertical", "float_drift", "float_relative"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"{name} is {getattr(self, name)}, but must be at least 0")
        for name in ("drift_time", "float_drift_time"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} is {getattr(self, name)} s, but must be above 0 and finite")

    @classmethod
    def typical(cls, loss: FixLoss | None = None) -> GpsNoise:
        """2 cm rms in the plan while fixed, a third of its power white.

        E, after data sheets: 0.8 cm + 1 ppm rms horizontally (Unicore UM980, 1 km baseline and a good antenna under an
        open sky); twice that on a machine, the rest multipath that wanders over a minute. Relative error 3 mm: 0.14°
        over 1.2 m, as receivers with two antennas state 0.2° for 1 m. A float solution wanders by 0.3 m.
        """
        plan = 0.02 / math.sqrt(2.0)
        return cls(
            white=plan * math.sqrt(1.0 / 3.0),
            drift=plan * math.sqrt(2.0 / 3.0),
            relative=0.003,
            vertical=2.0,
            float_drift=0.3 / math.sqrt(2.0),
            float_relative=0.02,
            loss=FixLoss() if loss is None else loss,
        )


@dataclass(frozen=True)
class GpsReading:
    """The newest solutions of K receivers. Without satellites the last solution stays, with its age."""

    position: NDArray[np.float64]
    """Of the main antenna [m] (K, 3)."""
    heading: NDArray[np.float64]
    """Of the front frame [rad] (K,), in [−π, π)."""
    quality: NDArray[np.int64]
    """``NONE``, ``FLOAT`` or ``FIXED`` (K,)."""
    age: NDArray[np.float64]
    """Time [s] (K,) since the instant that position and heading show."""
    fresh: NDArray[np.bool_]
    """Whether a solution came in with this call (K,)."""


class Gps:
    """The receivers of N twins.

    Args:
        num_twins: How many.
        noise: Their errors; :meth:`GpsNoise.typical` by default, ``GpsNoise()`` for none.
        antennas: Where the antennas stand.
        latency: Time [s] from the instant of a solution until it comes out.
        interval: Longest time [s] between two calls of :meth:`measure`; between them the antennas move on straight
            lines.

    Raises ValueError naming the argument, its value and its bound.
    """

    def __init__(
        self,
        num_twins: int = 1,
        noise: GpsNoise | None = None,
        *,
        antennas: Antennas | None = None,
        latency: float = 0.04,
        interval: float = 0.05,
    ):
        if num_twins < 1:
            raise ValueError(f"num_twins is {num_twins}, but must be at least 1")
        if not 0.0 <= latency <= 1.0:
            raise ValueError(f"latency is {latency} s, but must be in [0, 1] s")
        if not 0.0 < interval <= 1.0 / RATE:
            raise ValueError(f"interval is {interval} s, but must be in (0, {1.0 / RATE}] s: no solution may be missed")
        self.num_twins = num_twins
        self.noise = GpsNoise.typical() if noise is None else noise
        self.antennas = Antennas() if antennas is None else antennas
        self.latency = latency
        n = num_twins
        self.scale = np.ones(n)
        """Multiplier [-] of each receiver's errors (N,); 0 leaves clock and latency."""
        kept = math.ceil(latency / interval) + 2
        self._past = np.zeros((kept, n, 6))  # [m] both antennas, newest first
        self._instants = np.zeros((kept, n))  # [s] of them
        self._seeds: Seeds = np.zeros(n, dtype=np.uint64)
        self._phase = np.zeros(n)  # share of a period by which the receiver's clock is late
        self._number = np.full(n, -1, dtype=np.int64)  # of the last solution
        self._fresh = np.ones(n, dtype=bool)  # not asked since the reset
        self._state = np.full(n, FIXED, dtype=np.int64)
        self._position = np.zeros((n, 3))
        self._heading = np.zeros(n)
        self._instant = np.zeros(n)
        drift = {"rate": RATE, "num_twins": n}
        scale = np.array([1.0, 1.0, self.noise.vertical])
        self._drift = Drift(self.noise.drift * scale, time=self.noise.drift_time, **drift)
        self._float_drift = Drift(self.noise.float_drift * scale, time=self.noise.float_drift_time, **drift)
        self.reset(np.arange(n), np.random.default_rng(0).spawn(n))

    def reset(self, indices: ArrayLike, rngs: Sequence[np.random.Generator]) -> None:
        """Begin a new run of the twins ``indices`` (K,), with one generator each: fixed, and standing still."""
        rows = chosen_rows(indices, self.num_twins)
        checked_generators(rngs, rows)
        seeds = draw_seeds(rngs)
        self._seeds[rows] = seeds
        self._phase[rows] = uniform(channel(seeds, 0), 0)
        self._drift.reset(rows, channel(seeds, 1))
        self._float_drift.reset(rows, channel(seeds, 2))
        self._number[rows] = -1
        self._state[rows] = FIXED
        self._fresh[rows] = True

    @property
    def quality(self) -> NDArray[np.int64]:
        """Of the newest solutions (N,): ``NONE``, ``FLOAT`` or ``FIXED``."""
        return self._state

    def measure(
        self,
        position: ArrayLike,
        roll: ArrayLike,
        pitch: ArrayLike,
        yaw: ArrayLike,
        time: ArrayLike,
        indices: ArrayLike | None = None,
    ) -> GpsReading:
        """What the receivers show.

        Args:
            position: True position [m] (K, 3) of the point that the antennas' places are counted from.
            roll: True attitude of the front frame [rad] (K,).
            pitch: Likewise.
            yaw: Likewise.
            time: Time [s] since the twin's reset, scalar or (K,), not before that of the last call.
            indices: Which twins, integers (K,); all by default. The others stay as they are.
        """
        rows = chosen_rows(indices, self.num_twins)
        k = len(rows)
        origin = columns("position", position, (k, 3))
        now = np.broadcast_to(np.asarray(time, dtype=np.float64), (k,))
        places = np.concatenate(
            [origin + in_world(roll, pitch, yaw, place) for place in (self.antennas.main, self.antennas.auxiliary)],
            axis=1,
        )
        begun = self._fresh[rows]
        if begun.any():  # at rest until now
            self._past[:, rows[begun]] = places[begun]
            self._instants[:, rows[begun]] = now[begun]
            self._fresh[rows] = False
        self._past[1:, rows] = self._past[:-1, rows]
        self._instants[1:, rows] = self._instants[:-1, rows]
        self._past[0, rows] = places
        self._instants[0, rows] = now

        number = np.floor((now - self.latency) * RATE - self._phase[rows] + 1e-9).astype(np.int64) + 1
        number = np.maximum(number, 0)  # the first solution is there from the start
        due = number > self._number[rows]
        if due.any():
            self._solve(rows[due], number[due])
        return GpsReading(
            position=self._position[rows],
            heading=self._heading[rows],
            quality=self._state[rows],
            age=now - self._instant[rows],
            fresh=due & (self._state[rows] != NONE),
        )

    def _solve(self, rows: NDArray[np.int64], number: NDArray[np.int64]) -> None:
        """New solutions, each for the instant of its tick."""
        noise = self.noise
        instant = (number - 1 + self._phase[rows]) / RATE
        state = self._next_state(rows, number)
        self._number[rows] = number
        self._state[rows] = state
        # the antennas at that instant, on the straight line between the two calls around it
        instants = self._instants[:, rows]
        after = np.clip(np.sum(instants > instant, axis=0) - 1, 0, len(instants) - 2)
        each = np.arange(len(rows))
        late, early = instants[after, each], instants[after + 1, each]
        share = np.clip((late - instant) / np.where(late > early, late - early, 1.0), 0.0, 1.0)[:, None]
        places = self._past[after, rows] + share * (self._past[after + 1, rows] - self._past[after, rows])

        fixed = state == FIXED
        drift = np.where(fixed, self._drift.at(rows, number), self._float_drift.at(rows, number)).T
        scale = np.array([1.0, 1.0, noise.vertical])
        seeds = self._seeds[rows]
        error = drift + noise.white * scale * np.stack([white(channel(seeds, 3 + i), number) for i in range(3)], axis=1)
        error = self.scale[rows][:, None] * error
        relative = self.scale[rows] * np.where(fixed, noise.relative, noise.float_relative)
        line = places[:, 3:5] - places[:, 0:2]
        line = line + relative[:, None] * np.stack([white(channel(seeds, 6 + i), number) for i in range(2)], axis=1)
        heading = wrapped(np.arctan2(line[:, 1], line[:, 0]) - self.antennas.direction)

        there = state != NONE
        self._position[rows[there]] = (places[:, :3] + error)[there]
        self._heading[rows[there]] = heading[there]
        self._instant[rows[there]] = np.maximum(instant, 0.0)[there]

    def _next_state(self, rows: NDArray[np.int64], number: NDArray[np.int64]) -> NDArray[np.int64]:
        loss, state = self.noise.loss, self._state[rows]
        if not math.isfinite(loss.interval):
            return state
        seeds = self._seeds[rows]
        change, kind = uniform(channel(seeds, 8), number), uniform(channel(seeds, 9), number)
        durations = np.array([loss.none_duration, loss.float_duration, loss.interval])
        leaves = change < -np.expm1(-(number - np.maximum(self._number[rows], 0)) / (RATE * durations[state]))
        lost = np.where(kind < loss.none_share, NONE, FLOAT)
        return np.where(leaves, np.where(state == FIXED, lost, FIXED), state)
