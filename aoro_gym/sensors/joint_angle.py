"""The joint's rotary sensor: 100 samples a second, with spectral lines, white noise and a quantiser.

There is no filter against aliases before the sampler, so what the engine and its generator put on the wire at high
frequencies shows up as lines at low ones. After the published filter the lines near 6 Hz remain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.checks import check_finite, check_integer, check_range
from aoro_gym.execution.array_api import HOST, Array, Arrays, Index, floats, namespace
from aoro_gym.execution.streams import Generators, uniforms
from aoro_gym.sensors.chain import SAMPLE_RATE, sample, sampling_rate
from aoro_gym.sensors.noise import (
    Seeds,
    checked_generators,
    chosen_rows,
    columns,
    draw_seeds,
    quantised,
    tick,
    white,
)


@dataclass(frozen=True)
class NoiseLine:
    """A sinusoid whose frequency, as it appears at 100 samples a second, is somewhere in a band, anew in each run."""

    low: float  # [Hz]
    high: float  # [Hz]
    amplitude: float  # [rad]

    def __post_init__(self) -> None:
        check_range("low", self.low, "Hz", ge=0.0, le=self.high)
        check_range("amplitude", self.amplitude, "rad", ge=0.0)


@dataclass(frozen=True)
class JointAngleNoise:
    """What the sensor adds to the joint angle."""

    lines: tuple[NoiseLine, ...] = ()
    white: float = 0.0  # [rad] rms
    resolution: float = 0.0  # [rad] of the quantiser; 0: none

    def __post_init__(self) -> None:
        check_range("white", self.white, "rad", ge=0.0)
        check_range("resolution", self.resolution, "rad", ge=0.0)

    @classmethod
    def published(cls) -> JointAngleNoise:
        """Noise of the published kind.

        Published: lines near 6 Hz that survive the filter, up to 12.1 L/min peak to peak in the steady period at 100 %
        signal and 18.5 L/min at 50 %; lines near 15 Hz and from 25 to 33 Hz before it; a generator at 26.6 Hz. Heights
        before the filter, bits and white noise are not.

        One amplitude has to serve both levels, as the sensor does not know the signal. The steady period at 50 % is
        3.5 times longer, so the largest swing in it is larger, if the swing varies: several lines that beat, here four
        as orders 3.5 and 4 of a crankshaft at 26.6 Hz (93 and 106 Hz) appear at 6.9 and 6.4 Hz and wander with its
        speed. Their amplitude makes the medians over many runs miss both published figures by the same factor, 1.08: they
        are 13.1 and 17.2 L/min, and the published ones stand at the quantiles 0.41 and 0.66. A single line would swing
        by the same 15 L/min at either level.

        The other lines are estimates: as high as these in the spectrum of the unfiltered flow. 12 bits a turn and white
        noise of a quarter of a bit are estimates, too.
        """
        near_6 = math.radians(0.0565)
        return cls(
            lines=(
                *(NoiseLine(5.3, 6.9, near_6),) * 4,
                *(NoiseLine(low, high, near_6 * 6.1 * 2.0 / (low + high)) for low, high in _BEFORE_THE_FILTER),
            ),
            white=math.radians(0.022),
            resolution=2.0 * math.pi / 2**12,
        )

    def draw(self, rngs: Generators) -> NoiseDraw:
        """Frequencies, phases and a seed for one run of each generator."""
        low = np.array([line.low for line in self.lines])[:, None]
        high = np.array([line.high for line in self.lines])[:, None]
        uniform = np.ascontiguousarray(np.moveaxis(uniforms(rngs, 2, len(self.lines)), 0, -1))
        return NoiseDraw(low + (high - low) * uniform[0], 2.0 * np.pi * uniform[1], draw_seeds(rngs))

    def at(self, draw: NoiseDraw, time: Array, *, rate: float = SAMPLE_RATE) -> Array:
        """Noise [rad] without the quantiser: (N,) at one ``time`` [s] or one a run (N,), (F, N) at times (F, 1) or (F, N).

        White noise changes with every sample at ``rate`` [Hz] and depends on the number of the sample only.
        """
        xp = namespace(draw.seeds)
        instants = floats(time)
        shape = np.broadcast_shapes(instants.shape, draw.seeds.shape)
        total = xp.zeros(shape, dtype=xp.float64, device=draw.seeds.device)
        for line, frequency, phase in zip(self.lines, 2.0 * np.pi * draw.frequency, draw.phase, strict=True):
            total = total + line.amplitude * xp.sin(frequency * instants + phase)
        if self.white > 0.0:
            total = total + self.white * white(draw.seeds, tick(instants, rate))
        return total


_BEFORE_THE_FILTER = ((14.0, 15.0), (15.0, 16.0), (26.3, 26.9), (28.0, 31.0), (32.0, 33.5))
"""Bands [Hz] of the lines that the filter removes: direct ones of the generator, and aliases."""


@dataclass
class NoiseDraw:
    """What is random about a run, for N runs."""

    frequency: Array  # [Hz] (lines, N)
    phase: Array  # [rad] (lines, N)
    seeds: Seeds  # (N,)


class JointAngleSensor:
    """The joint-angle sensors of N twins.

    Args:
        num_twins: How many.
        noise: What they add; :meth:`JointAngleNoise.published` by default, ``JointAngleNoise()`` for none.
        delay: Age [s] of the angle that a sample shows, scalar or (N,).
        gain: Measured angle per true angle, scalar or (N,).
        cutoff: Corner [Hz] of a first-order low-pass before the sampler; None for none.
        interval: Time [s] between two samples of :meth:`measure`.
        arrays: Where they live.

    Between two samples the angle is taken as a straight line, by delay and low-pass.
    """

    def __init__(
        self,
        num_twins: int = 1,
        noise: JointAngleNoise | None = None,
        *,
        delay: ArrayLike = 0.0,
        gain: ArrayLike = 1.0,
        cutoff: float | None = None,
        interval: float = 1.0 / SAMPLE_RATE,
        arrays: Arrays = HOST,
    ):
        check_integer("num_twins", num_twins)
        check_range("interval", interval, "s", gt=0.0)
        if cutoff is not None:
            check_range("cutoff", cutoff, "Hz", gt=0.0, note=", or None for no low-pass")
        self.num_twins = num_twins
        self.noise = JointAngleNoise.published() if noise is None else noise
        self.delay = _one_a_twin("delay", delay, num_twins)
        self.gain = _one_a_twin("gain", gain, num_twins)
        check_range("delay", self.delay, "s", ge=0.0)
        self._arrays = arrays
        self._own_gain = arrays.asarray(self.gain)
        self.cutoff = cutoff
        self.interval = float(interval)
        lines = len(self.noise.lines), num_twins
        self._draw = NoiseDraw(arrays.zeros(lines), arrays.zeros(lines), arrays.zeros(num_twins, arrays.xp.int64))
        kept = math.ceil(self.delay.max() / self.interval - 1e-9) + 1
        self._age = arrays.asarray(self.delay / self.interval)  # [samples] of what is shown
        self._past = arrays.zeros((kept, num_twins))  # newest first
        self._before = arrays.zeros(num_twins)  # true angle at the last sample
        self._fresh = arrays.ones(num_twins, arrays.xp.bool)
        self.reset(np.arange(num_twins), np.random.default_rng(0).spawn(num_twins))

    def reset(self, indices: Index, rngs: Generators) -> None:
        """Begin a new run of some twins.

        Args:
            indices: Which, integers (K,).
            rngs: One generator each: draws the frequencies and phases of the lines, and the white noise.
        """
        rows, k = chosen_rows(indices, self.num_twins, self._arrays)
        checked_generators(rngs, k)
        draw = self.noise.draw(rngs)
        self._arrays.put(self._draw.frequency, (slice(None), rows), draw.frequency)
        self._arrays.put(self._draw.phase, (slice(None), rows), draw.phase)
        self._arrays.put(self._draw.seeds, rows, draw.seeds)
        self._arrays.put(self._fresh, rows, True)

    def measure(self, angle: Array, time: Array, indices: Index | None = None) -> Array:
        """One sample of each twin, or of some: the memory of the others stays as it is.

        Args:
            angle: True joint angle [rad] (K,); or (F, K), F samples that follow each other.
            time: Time [s] since the twin's reset, scalar or (K,); (F, K) of as many samples.
            indices: Which twins, integers (K,); all by default.

        Returns:
            Measured angle [rad], as many. The first sample after a reset finds the joint at rest.
        """
        arrays = self._arrays
        rows, k = chosen_rows(indices, self.num_twins, arrays)
        true = arrays.asarray(angle)
        if true.ndim != 2:
            true = columns("angle", true, (k,), arrays)
        value = true
        if self.cutoff is not None or len(self._past) > 1:
            shown = [self._followed(sample, rows) for sample in (true if true.ndim == 2 else true[None])]
            value = arrays.xp.stack(shown) if true.ndim == 2 else shown[0]
        draw = self._draw
        draw = NoiseDraw(draw.frequency[:, rows], draw.phase[:, rows], draw.seeds[rows])
        return self._sampled(value, draw, arrays.asarray(time), self._own_gain[rows])

    def _followed(self, true: Array, rows: Index) -> Array:
        """What low-pass and delay make of the next true angle [rad] (K,)."""
        arrays, xp = self._arrays, self._arrays.xp
        past, earlier, fresh = self._past[:, rows], self._before[rows], self._fresh[rows]
        if not arrays.known_all_false(fresh):
            past, earlier = xp.where(fresh, true, past), xp.where(fresh, true, earlier)
            self._fresh[rows] = False
        value = true
        if self.cutoff is not None:
            feedback, now, before = _first_order(self.cutoff, self.interval)
            value = feedback * past[0] + now * true + before * earlier
            self._before[rows] = true
        past = xp.concat([value[None], past[:-1]])
        self._past[:, rows] = past
        if len(past) > 1:
            age = self._age[rows]
            whole = xp.clip(xp.astype(age, xp.int64), None, len(past) - 2)
            each = arrays.arange(len(true))
            newer, older = past[whole, each], past[whole + 1, each]
            value = newer + (age - whole) * (older - newer)
        return value

    def record(
        self, angle: ArrayLike, time: ArrayLike, rng: np.random.Generator, *, offset: float = 0.0
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Whole logs: ticks [s] (K,) and measured angles [rad] (K, N), or (K,) for one log.

        Runs of its own, spawned from ``rng``; those of :meth:`measure` go on undisturbed.

        Args:
            angle: True joint angle [rad] (F, N) or (F,), evenly spaced, at rest in the first sample.
            time: Instants [s] (F,), at least as dense as the sensor's clock.
            rng: Draws all that is random.
            offset: Time [s] of some tick of the sensor's clock.
        """
        true = np.asarray(angle, dtype=np.float64)
        instants = np.asarray(time, dtype=np.float64)
        values = true[:, None] if true.ndim == 1 else true
        count = values.shape[1]
        if self.num_twins not in (1, count):
            raise ValueError(
                f"angle has {count} columns, but there are {self.num_twins} sensors; give as many, or use one"
            )
        if self.cutoff is not None:
            from scipy.signal import lfilter  # half a second to import

            feedback, now, before = _first_order(self.cutoff, 1.0 / sampling_rate(instants))
            values = values[0] + lfilter([now, before], [1.0, -feedback], values - values[0], axis=0)
        ticks, sampled = sample(instants, values, offset=offset)
        if self.delay.any():
            row = np.clip((ticks[:, None] - self.delay - instants[0]) * sampling_rate(instants), 0, len(instants) - 1)
            row = np.broadcast_to(row, (len(ticks), count))
            whole = np.minimum(row.astype(np.int64), len(instants) - 2)
            each = np.arange(count)
            sampled = values[whole, each] + (row - whole) * (values[whole + 1, each] - values[whole, each])
        measured = self._sampled(sampled, self.noise.draw(rng.spawn(count)), ticks[:, None], self.gain)
        return ticks, measured[:, 0] if true.ndim == 1 else measured

    def _sampled(self, value: Array, draw: NoiseDraw, time: Array, gain: Array) -> Array:
        return quantised(gain * value + self.noise.at(draw, time), self.noise.resolution)


def slope_weights(count: int, interval: float) -> list[float]:
    """Weights [1/s] of ``count`` samples ``interval`` [s] apart, newest first, whose sum is the slope of the least-squares
    line through them: the joint rate as a controller can know it."""
    order = np.arange(count)[::-1] - 0.5 * (count - 1)
    return [float(weight) for weight in order / (np.sum(order**2) * interval)]


def _first_order(cutoff: float, step: float) -> tuple[float, float, float]:
    """Weights of the last output, the input now and the input before: exact for inputs that are straight lines."""
    decay = math.exp(-2.0 * math.pi * cutoff * step)
    lag = (1.0 - decay) / (2.0 * math.pi * cutoff * step)
    return decay, 1.0 - lag, lag - decay


def _one_a_twin(name: str, value: ArrayLike, count: int) -> NDArray[np.float64]:
    array = np.asarray(value, dtype=np.float64)
    if array.shape not in ((), (count,)):
        raise ValueError(f"{name} has shape {array.shape}, but must be a scalar or ({count},)")
    check_finite(name, array)
    return np.broadcast_to(array, (count,)).copy()
