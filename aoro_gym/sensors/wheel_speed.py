"""Speed sensors in the wheel motors: pulses of a toothed ring, and the speed from the time between them.

At walking pace a wheel gives some ten pulses a second: counting them in a control step would say next to nothing.
So, as speed counters do, the time between pulses is measured; while none comes the wheel can be no faster than one pulse
in the time that has passed, and after a while it is said to stand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aoro_gym.checks import check_integer, check_range
from aoro_gym.execution.array_api import HOST, Array, Arrays, Index, floats, namespace
from aoro_gym.execution.streams import Generators
from aoro_gym.sensors.noise import (
    Seeds,
    channels,
    checked_generators,
    chosen_rows,
    columns,
    draw_seeds,
    instants,
    quantised,
    uniform,
    white,
)

WHEELS = 4


@dataclass(frozen=True)
class WheelSpeedNoise:
    """What the ring and its counter do to the speed."""

    pulses: int = 0  # a turn of the wheel; 0: the exact speed
    tooth_error: float = 0.0  # [-] rms of a tooth's place, in pitches
    timer: float = 0.0  # [s] resolution of the counter's clock
    standstill: float = 0.5  # [s] without a pulse after which the wheel is said to stand

    def __post_init__(self) -> None:
        check_integer("pulses", self.pulses, ge=0)
        check_range("tooth_error", self.tooth_error, ge=0.0, le=0.2)
        check_range("timer", self.timer, "s", ge=0.0)
        check_range("standstill", self.standstill, "s", gt=0.0)

    @classmethod
    def typical(cls) -> WheelSpeedNoise:
        """E: 60 pulses a turn in quadrature (radial-piston motors give some 40 to 80), teeth true to 1 % of the
        pitch, a clock of 10 µs."""
        return cls(pulses=60, tooth_error=0.01, timer=1e-5)


class WheelSpeedSensor:
    """The speed sensors on the four wheels of N twins, in the order of ``aoro_gym.twin.records.WHEELS``.

    Args:
        num_twins: How many.
        noise: What they do; :meth:`WheelSpeedNoise.typical` by default, ``WheelSpeedNoise()`` for the exact speeds.
        arrays: Where they live.
    """

    def __init__(self, num_twins: int = 1, noise: WheelSpeedNoise | None = None, *, arrays: Arrays = HOST):
        check_integer("num_twins", num_twins)
        self.num_twins = num_twins
        self.noise = WheelSpeedNoise.typical() if noise is None else noise
        shape = (num_twins, WHEELS)
        self._arrays = arrays
        self._seeds: Seeds = arrays.zeros(shape, arrays.xp.int64)  # of the teeth's errors
        self._turned = arrays.zeros(shape)  # [pitches] since a tooth stood at the sensor
        self._rate = arrays.zeros(shape)  # [rad/s] true, at the last call
        self._time = arrays.zeros(num_twins)  # [s] of the last call
        self._edge = arrays.zeros(shape)  # [pitches] place of the last pulse, with its error
        self._edge_time = arrays.zeros(shape)  # [s] of it
        self._shown = arrays.zeros(shape)  # [rad/s]
        self.reset(np.arange(num_twins), np.random.default_rng(0).spawn(num_twins))

    def reset(self, indices: Index, rngs: Generators) -> None:
        """Begin a new run of the twins ``indices`` (K,), with one generator each: the wheels stand."""
        rows, k = chosen_rows(indices, self.num_twins, self._arrays)
        checked_generators(rngs, k)
        seeds = draw_seeds(rngs)
        self._arrays.put(self._turned, rows, uniform(channels(seeds, range(WHEELS)), 0).T)
        self._arrays.put(self._seeds, rows, channels(seeds, range(WHEELS, 2 * WHEELS)).T)
        self._arrays.put(self._edge, rows, np.nan)  # no pulse yet
        for state in (self._rate, self._time, self._edge_time, self._shown):
            self._arrays.put(state, rows, 0.0)

    def measure(self, rate: Array, time: Array, indices: Index | None = None) -> Array:
        """Measured speeds [rad/s] (K, 4), positive forward.

        Args:
            rate: True speeds relative to the arms [rad/s] (K, 4); straight lines between two calls.
            time: Time [s] since the twin's reset, scalar or (K,), not before that of the last call.
            indices: Which twins, integers (K,); all by default. The others stay as they are.
        """
        arrays, xp = self._arrays, self._arrays.xp
        rows, k = chosen_rows(indices, self.num_twins, arrays)
        true = columns("rate", rate, (k, WHEELS), arrays)
        if not self.noise.pulses:
            return xp.asarray(true, copy=True)
        now = instants(time, k, arrays)
        began = self._time[rows][:, None]
        step = now[:, None] - began
        before, pitch = self._turned[rows], 2.0 * np.pi / self.noise.pulses
        after = before + 0.5 * (self._rate[rows] + true) * step / pitch
        moved = after - before
        # the last tooth that passed: its number, and when it did
        forward = moved > 0.0
        tooth = xp.where(forward, xp.floor(after), xp.ceil(after))
        passed = xp.where(forward, tooth > before, tooth < before)
        share = xp.where(passed, (tooth - before) / xp.where(moved == 0.0, 1.0, moved), 0.0)
        instant = quantised(began + share * step, self.noise.timer)
        # the same error of a tooth in every turn
        place = tooth + self.noise.tooth_error * white(self._seeds[rows], tooth % self.noise.pulses)

        edge, edge_time, shown = self._edge[rows], self._edge_time[rows], self._shown[rows]
        known = passed & xp.isfinite(edge)
        taken = xp.clip(instant - edge_time, max(self.noise.timer, 1e-9), None)
        shown = xp.where(known, (place - edge) * pitch / taken, shown)
        edge_time = xp.where(passed, instant, edge_time)
        waited = now[:, None] - edge_time
        fastest = xp.where(waited < self.noise.standstill, pitch / xp.clip(waited, 1e-9, None), 0.0)
        shown = xp.clip(shown, -fastest, fastest)

        self._turned[rows], self._rate[rows], self._time[rows] = after, true, now
        self._edge[rows] = xp.where(passed, place, edge)
        self._edge_time[rows] = edge_time
        self._shown[rows] = shown
        return shown


def ground_speed(rates: Array, radius: Array) -> Array:
    """Speed over ground [m/s] (N,) from wheel speeds (N, 4) [rad/s] and the rolling radius [m]: by the mean of the two
    middle ones, so that neither one wheel that spins nor one that is blocked tells."""
    ordered = namespace(rates).sort(floats(rates), axis=1)
    return floats(radius) * 0.5 * (ordered[:, 1] + ordered[:, 2])
