"""Speed sensors in the wheel motors: pulses of a toothed ring, and the speed from the time between them.

At walking pace a wheel gives some ten pulses a second: counting them in a control step would say next to nothing.
So, as speed counters do, the time between pulses is measured; while none comes the wheel can be no faster than one pulse
in the time that has passed, and after a while it is said to stand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.sensors.noise import (
    Seeds,
    channel,
    checked_generators,
    chosen_rows,
    columns,
    draw_seeds,
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
        if self.pulses < 0 or self.pulses != int(self.pulses):
            raise ValueError(f"pulses is {self.pulses}, but must be a whole number of at least 0")
        if not (0.0 <= self.tooth_error <= 0.2 and self.timer >= 0.0 and self.standstill > 0.0):
            raise ValueError(f"{self}: needs tooth_error in [0, 0.2], timer of at least 0 s, standstill above 0 s")

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
    """

    def __init__(self, num_twins: int = 1, noise: WheelSpeedNoise | None = None):
        if num_twins < 1:
            raise ValueError(f"num_twins is {num_twins}, but must be at least 1")
        self.num_twins = num_twins
        self.noise = WheelSpeedNoise.typical() if noise is None else noise
        shape = (num_twins, WHEELS)
        self._seeds: Seeds = np.zeros(num_twins, dtype=np.uint64)
        self._turned = np.zeros(shape)  # [pitches] since a tooth stood at the sensor
        self._rate = np.zeros(shape)  # [rad/s] true, at the last call
        self._time = np.zeros(num_twins)  # [s] of the last call
        self._edge = np.zeros(shape)  # [pitches] place of the last pulse, with its error
        self._edge_time = np.zeros(shape)  # [s] of it
        self._shown = np.zeros(shape)  # [rad/s]
        self.reset(np.arange(num_twins), np.random.default_rng(0).spawn(num_twins))

    def reset(self, indices: ArrayLike, rngs: Sequence[np.random.Generator]) -> None:
        """Begin a new run of the twins ``indices`` (K,), with one generator each: the wheels stand."""
        rows = chosen_rows(indices, self.num_twins)
        checked_generators(rngs, rows)
        seeds = draw_seeds(rngs)
        self._seeds[rows] = seeds
        for wheel in range(WHEELS):
            self._turned[rows, wheel] = uniform(channel(seeds, wheel), 0)
        self._edge[rows] = np.nan  # no pulse yet
        for state in (self._rate, self._time, self._edge_time, self._shown):
            state[rows] = 0.0

    def measure(self, rate: ArrayLike, time: ArrayLike, indices: ArrayLike | None = None) -> NDArray[np.float64]:
        """Measured speeds [rad/s] (K, 4), positive forward.

        Args:
            rate: True speeds relative to the arms [rad/s] (K, 4); straight lines between two calls.
            time: Time [s] since the twin's reset, scalar or (K,), not before that of the last call.
            indices: Which twins, integers (K,); all by default. The others stay as they are.
        """
        rows = chosen_rows(indices, self.num_twins)
        true = columns("rate", rate, (len(rows), WHEELS))
        if not self.noise.pulses:
            return true.copy()
        now = np.broadcast_to(np.asarray(time, dtype=np.float64), (len(rows),))
        began = self._time[rows][:, None]
        step = now[:, None] - began
        before, pitch = self._turned[rows], 2.0 * np.pi / self.noise.pulses
        after = before + 0.5 * (self._rate[rows] + true) * step / pitch
        moved = after - before
        # the last tooth that passed: its number, and when it did
        forward = moved > 0.0
        tooth = np.where(forward, np.floor(after), np.ceil(after))
        passed = np.where(forward, tooth > before, tooth < before)
        share = np.where(passed, (tooth - before) / np.where(moved == 0.0, 1.0, moved), 0.0)
        instant = began + share * step
        if self.noise.timer > 0.0:
            instant = np.round(instant / self.noise.timer) * self.noise.timer
        place = tooth + self.noise.tooth_error * self._tooth_errors(rows, tooth)

        edge, edge_time, shown = self._edge[rows], self._edge_time[rows], self._shown[rows]
        known = passed & np.isfinite(edge)
        taken = np.maximum(instant - edge_time, max(self.noise.timer, 1e-9))
        shown = np.where(known, (place - edge) * pitch / taken, shown)
        waited = now[:, None] - np.where(passed, instant, edge_time)
        fastest = np.where(waited < self.noise.standstill, pitch / np.maximum(waited, 1e-9), 0.0)
        shown = np.clip(shown, -fastest, fastest)

        self._turned[rows], self._rate[rows], self._time[rows] = after, true, now
        self._edge[rows] = np.where(passed, place, edge)
        self._edge_time[rows] = np.where(passed, instant, edge_time)
        self._shown[rows] = shown
        return shown

    def _tooth_errors(self, rows: NDArray[np.int64], tooth: NDArray[np.float64]) -> NDArray[np.float64]:
        """Standard normal errors of the teeth, the same one in every turn."""
        number = np.mod(tooth, self.noise.pulses).astype(np.int64)
        seeds = self._seeds[rows]
        return np.stack([white(channel(seeds, WHEELS + wheel), number[:, wheel]) for wheel in range(WHEELS)], axis=1)


def ground_speed(rates: ArrayLike, radius: ArrayLike) -> NDArray[np.float64]:
    """Speed over ground [m/s] (N,) from wheel speeds (N, 4) [rad/s] and the rolling radius [m]: by the mean of the two
    middle ones, so that neither one wheel that spins nor one that is blocked tells."""
    ordered = np.sort(np.asarray(rates, dtype=np.float64), axis=1)
    return np.asarray(radius) * 0.5 * (ordered[:, 1] + ordered[:, 2])
