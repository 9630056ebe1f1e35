"""RTK-GPS with two antennas on the front frame: a position, and a heading from the line between the antennas.

The receiver computes ten solutions a second. Each shows where the antennas were at one instant, comes out a latency
later, and stays until the next one. The antennas stand high, so that roll and pitch move them in the plan: 2.2 m above
the ground 5 degrees of roll are 0.19 m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from aoro_gym.checks import check_integer, check_range
from aoro_gym.execution.array_api import HOST, Array, Arrays, Index
from aoro_gym.execution.streams import Generators
from aoro_gym.sensors.attitude import in_world, wrapped
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
        check_range("baseline", self.baseline, "m", ge=0.1, note=" in the plan; set the antennas farther apart")

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
            check_range(name, getattr(self, name), "s", gt=0.0)
        check_range("none_share", self.none_share, ge=0.0, le=1.0)


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
            check_range(name, getattr(self, name), ge=0.0)
        for name in ("drift_time", "float_drift_time"):
            check_range(name, getattr(self, name), "s", gt=0.0, lt=math.inf)

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

    position: Array
    """Of the main antenna [m] (K, 3)."""
    heading: Array
    """Of the front frame [rad] (K,), in [−π, π)."""
    quality: Array
    """``NONE``, ``FLOAT`` or ``FIXED`` (K,)."""
    age: Array
    """Time [s] (K,) since the instant that position and heading show."""
    fresh: Array
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
        arrays: Where they live.

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
        arrays: Arrays = HOST,
    ):
        check_integer("num_twins", num_twins)
        check_range("latency", latency, "s", ge=0.0, le=1.0)
        check_range("interval", interval, "s", gt=0.0, le=1.0 / RATE, note=": no solution may be missed")
        self.num_twins = num_twins
        self.noise = GpsNoise.typical() if noise is None else noise
        self.antennas = Antennas() if antennas is None else antennas
        self.latency = latency
        n, xp = num_twins, arrays.xp
        self._arrays = arrays
        self.scale = arrays.ones(n)
        """Multiplier [-] of each receiver's errors (N,); 0 leaves clock and latency."""
        self._places = arrays.asarray([self.antennas.main, self.antennas.auxiliary])
        kept = math.ceil(latency / interval) + 2
        self._past = arrays.zeros((kept, n, 2, 3))  # [m] both antennas, newest first
        self._instants = arrays.zeros((kept, n))  # [s] of them
        # of the white errors x, y, z of the position and x, y of the line, then of losses: when, and of what kind
        self._seeds: Seeds = arrays.zeros((7, n), xp.int64)
        self._phase = arrays.zeros(n)  # share of a period by which the receiver's clock is late
        self._number = arrays.full(n, -1, xp.int64)  # of the last solution
        self._fresh = arrays.ones(n, xp.bool)  # not asked since the reset
        self._state = arrays.full(n, FIXED, xp.int64)
        self._position = arrays.zeros((n, 3))
        self._heading = arrays.zeros(n)
        self._instant = arrays.zeros(n)
        scale = np.array([1.0, 1.0, self.noise.vertical])
        drift = {"rate": RATE, "num_twins": n, "arrays": arrays}
        self._white = arrays.asarray(self.noise.white * scale)[:, None]
        # by quality
        loss = self.noise.loss
        self._loses = math.isfinite(loss.interval)
        self._relative = arrays.asarray([self.noise.float_relative, self.noise.float_relative, self.noise.relative])
        self._durations = arrays.asarray([loss.none_duration, loss.float_duration, loss.interval])  # [s]
        self._drift = Drift(self.noise.drift * scale, time=self.noise.drift_time, **drift)
        self._float_drift = Drift(self.noise.float_drift * scale, time=self.noise.float_drift_time, **drift)
        self.reset(np.arange(n), np.random.default_rng(0).spawn(n))

    def reset(self, indices: Index, rngs: Generators) -> None:
        """Begin a new run of the twins ``indices`` (K,), with one generator each: fixed, and standing still."""
        rows, k = chosen_rows(indices, self.num_twins, self._arrays)
        checked_generators(rngs, k)
        seeds = draw_seeds(rngs)
        self._arrays.put(self._seeds, (slice(None), rows), channels(seeds, range(3, 10)))
        self._arrays.put(self._phase, rows, uniform(channel(seeds, 0), 0))
        self._drift.reset(rows, channels(channel(seeds, 1), range(3)))
        self._float_drift.reset(rows, channels(channel(seeds, 2), range(3)))
        for state, value in ((self._number, -1), (self._state, FIXED), (self._fresh, True)):
            self._arrays.put(state, rows, value)

    @property
    def quality(self) -> Array:
        """Of the newest solutions (N,): ``NONE``, ``FLOAT`` or ``FIXED``."""
        return self._state

    def measure(
        self,
        position: Array,
        roll: Array,
        pitch: Array,
        yaw: Array,
        time: Array,
        indices: Index | None = None,
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
        arrays, xp = self._arrays, self._arrays.xp
        rows, k = chosen_rows(indices, self.num_twins, arrays)
        origin, now = columns("position", position, (k, 3), arrays), instants(time, k, arrays)
        roll, pitch, yaw = (
            columns(name, angle, (k,), arrays)[:, None]
            for name, angle in (("roll", roll), ("pitch", pitch), ("yaw", yaw))
        )
        places = origin[:, None] + in_world(roll, pitch, yaw, self._places)
        past, times = self._past[:, rows], self._instants[:, rows]
        begun = self._fresh[rows]
        if not arrays.known_all_false(begun):  # at rest until now
            past, times = xp.where(begun[:, None, None], places, past), xp.where(begun, now, times)
            self._fresh[rows] = False
        past, times = xp.concat([places[None], past[:-1]]), xp.concat([now[None], times[:-1]])
        self._past[:, rows], self._instants[:, rows] = past, times

        number = xp.astype(xp.floor((now - self.latency) * RATE - self._phase[rows] + 1e-9), xp.int64) + 1
        number = xp.clip(number, 0, None)  # the first solution is there from the start
        return self._solved(rows, number, now, past, times)

    def _solved(self, rows: Index, number: Array, now: Array, past: Array, times: Array) -> GpsReading:
        """The solutions of the ticks ``number`` (K,), which may have been there before, ``now`` (K,) [s]; ``past``
        (kept, K, 2, 3) [m] and ``times`` (kept, K) [s] are the antennas' places, newest first."""
        arrays, xp = self._arrays, self._arrays.xp
        instant = (number - 1 + self._phase[rows]) / RATE
        state = self._next_state(rows, number)
        fresh = (number > self._number[rows]) & (state != NONE)
        self._number[rows], self._state[rows] = number, state
        # the antennas at that instant, on the straight line between the two calls around it
        after = xp.clip(xp.sum(times > instant, axis=0) - 1, 0, len(times) - 2)
        each = arrays.arange(len(number))
        late, early = times[after, each], times[after + 1, each]
        share = xp.clip((late - instant) / xp.where(late > early, late - early, 1.0), 0.0, 1.0)[:, None, None]
        before, places = past[after + 1, each], past[after, each]
        places = places + share * (before - places)

        drift = self._drift.at(rows, number)
        if self._loses:
            drift = xp.where(state == FIXED, drift, self._float_drift.at(rows, number))
        random = white(self._seeds[:5, rows], number)
        scale = self.scale[rows]
        position = places[:, 0] + (scale * (drift + self._white * random[:3])).T
        line = (places[:, 1, :2] - places[:, 0, :2]) + (scale * self._relative[state] * random[3:]).T
        heading = wrapped(xp.atan2(line[:, 1], line[:, 0]) - self.antennas.direction)

        position = xp.where(fresh[:, None], position, self._position[rows])
        heading = xp.where(fresh, heading, self._heading[rows])
        instant = xp.where(fresh, xp.clip(instant, 0.0, None), self._instant[rows])
        self._position[rows], self._heading[rows], self._instant[rows] = position, heading, instant
        return GpsReading(position=position, heading=heading, quality=state, age=now - instant, fresh=fresh)

    def _next_state(self, rows: Index, number: Array) -> Array:
        """Qualities (K,) of the solutions ``number``; of one that was there before, as it was."""
        xp, state = self._arrays.xp, self._state[rows]
        if not self._loses:
            return state
        change, kind = uniform(self._seeds[5:, rows], number)
        passed = number - xp.clip(self._number[rows], 0, None)
        leaves = change < -xp.expm1(-passed / (RATE * self._durations[state]))
        lost = xp.where(kind < self.noise.loss.none_share, NONE, FLOAT)
        return xp.where(leaves, xp.where(state == FIXED, lost, FIXED), state)
