"""The measuring chain of the joint: angle at 100 Hz → low-pass without phase → cylinder strokes → joint flow.

The real machine's flow was never measured: it is derived from the joint angle. The twin goes through the same chain, so
that both are blurred alike: the filter lowers the first peak by some percent and moves it by 10 to 20 ms. How the published
curves were filtered is known in part, and other machines' logs are filtered otherwise: :data:`CHAINS` has other chains.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.checks import check_choice, check_integer, check_range

if TYPE_CHECKING:
    from aoro_gym.machine.sections import SteeringCylinder

SAMPLE_RATE = 100.0
"""Samples a second [Hz] of the joint-angle sensor."""
CUTOFF = 7.0
"""Corner frequency [Hz] of the published low-pass."""
ORDER = 4
"""Order of the published Butterworth low-pass; it runs over the signal forward and backward."""
STANDSTILL = 0.5
"""Rest [s] that a recording keeps before and after a motion, so that the filter's ends do not reach into it."""


def sample(time: ArrayLike, values: ArrayLike, *, rate: float = SAMPLE_RATE, offset: float = 0.0) -> Any:
    """Ticks [s] (K,) of a sensor's clock within ``time``, and the values at them (K, ...).

    A sample is the last value at or before its tick: there is no filter against aliases.

    Args:
        time: Instants [s] (F,), rising.
        values: What to sample (F, ...).
        rate: Ticks a second [Hz].
        offset: Time [s] of some tick: ticks stand at ``offset`` + k / ``rate``.
    """
    instants = np.asarray(time, dtype=np.float64)
    slack = 1e-6  # of a tick: time stamps are sums of rounded steps
    first = math.ceil((instants[0] - offset) * rate - slack)
    last = math.floor((instants[-1] - offset) * rate + slack)
    if last < first:
        raise ValueError(f"{instants[-1] - instants[0]:g} s of recording hold no sample at {rate:g} Hz")
    ticks = offset + np.arange(first, last + 1) / rate
    pick = np.searchsorted(instants, ticks + slack / rate, side="right") - 1
    return ticks, np.asarray(values)[np.maximum(pick, 0)]


def sampling_rate(time: ArrayLike) -> float:
    """Samples a second [Hz] of evenly spaced instants [s] (F,); ValueError where they are not evenly spaced."""
    instants = np.asarray(time, dtype=np.float64)
    if instants.ndim != 1 or instants.size < 2:
        raise ValueError(f"time has shape {instants.shape}, but must be (F,) with at least two samples")
    steps = np.diff(instants)
    step = float(instants[-1] - instants[0]) / (instants.size - 1)
    if step <= 0 or np.abs(steps - step).max() > 0.01 * step:
        raise ValueError(
            f"samples are {steps.min():g} to {steps.max():g} s apart, but must be evenly spaced; fill gaps and remove "
            "repeated rows first"
        )
    return 1.0 / step


def low_pass(
    values: ArrayLike, *, rate: float = SAMPLE_RATE, cutoff: float = CUTOFF, order: int = ORDER
) -> NDArray[np.float64]:
    """``values`` (F, ...) through a Butterworth low-pass, forward and backward along the first axis.

    Twice the same filter in opposite directions: no phase, and the square of its gain,
    1 / (1 + (tan(πf/rate) / tan(π cutoff/rate))^(2 order)), so one half at the corner.

    Args:
        values: Evenly spaced samples.
        rate: Samples a second [Hz].
        cutoff: Corner frequency [Hz].
        order: Order of one pass.
    """
    from scipy.signal import sosfiltfilt  # half a second to import

    return sosfiltfilt(_butterworth(order, cutoff, rate), np.asarray(values, dtype=np.float64), axis=0)


def _butterworth(order: int, cutoff: float, rate: float) -> NDArray[np.float64]:
    """Second-order sections of one pass."""
    check_range("cutoff", cutoff, "Hz", gt=0.0, lt=0.5 * rate, note=f" at {rate:g} samples a second")
    from scipy.signal import butter  # half a second to import

    return np.asarray(butter(order, cutoff, fs=rate, output="sos"))


def low_pass_gain(
    frequency: ArrayLike, *, rate: float = SAMPLE_RATE, cutoff: float = CUTOFF, order: int = ORDER
) -> NDArray[np.float64]:
    """Gain of :func:`low_pass` at ``frequency`` [Hz], in closed form."""
    warped = np.tan(np.pi * np.asarray(frequency, dtype=np.float64) / rate) / np.tan(np.pi * cutoff / rate)
    return 1.0 / (1.0 + warped ** (2 * order))


@dataclass(frozen=True)
class MeasuringChain:
    """What lies between the joint's angle and the flow that is made of it; by default as published.

    The sampler takes θ(t - latency) at each tick, without a filter against aliases. The filter is one of :data:`FILTERS`:

    - ``butterworth``: one pass has the gain 1/√(1 + r^(2n)) at r = tan(πf/rate)/tan(π cutoff/rate), the bilinear transform
      of the analogue filter of order n. With ``zero_phase`` it runs forward and backward, which squares the gain; else it
      delays slow motion by 1/(2 rate tan(π cutoff/rate) sin(π/2n)): 58 ms as published.
    - ``moving_average``: the mean of an odd number m of samples, nearest to ``window``; gain
      sin(πfm/rate)/(m sin(πf/rate)), so that nothing is left at f = rate/m. With ``zero_phase`` around each sample, else up
      to it, which delays all of it by (m - 1)/(2 rate).
    - ``none``: the samples themselves; noise of the sensor then drowns the flow, so for exact angles only.

    All hold for recordings that rest in their first and last :data:`STANDSTILL` seconds. A latency moves the angle against
    commands and pressures, but no figure that counts from the angle's own start.

    Raises ValueError naming the field, its value and its bound.
    """

    filter: str = "butterworth"
    order: int = ORDER
    """n of a pass of the Butterworth filter."""
    cutoff: float = CUTOFF
    """Corner frequency [Hz] of the Butterworth filter: one pass leaves 1/√2 (-3 dB)."""
    window: float = 0.09
    """Length [s] of the moving average."""
    zero_phase: bool = True
    """Whether the filter sees what comes after a sample, as logs allow; else it is causal, as on the machine."""
    rate: float = SAMPLE_RATE
    """Samples a second [Hz]."""
    latency: float = 0.0
    """Age [s] of the angle that a sample shows."""

    def __post_init__(self) -> None:
        check_choice("filter", self.filter, FILTERS)
        check_integer("order", self.order)
        for name, unit in (("cutoff", "Hz"), ("window", "s"), ("rate", "Hz")):
            check_range(name, getattr(self, name), unit, gt=0.0, lt=math.inf)
        check_range("latency", self.latency, "s", ge=0.0, lt=math.inf)

    def sampled(self, time: ArrayLike, angle: ArrayLike, *, offset: float = 0.0) -> Any:
        """Ticks [s] (K,) of the sampler's clock, and the angles (K, ...) that it takes at them; see :func:`sample`.

        Args:
            time: Instants [s] (F,), rising; before the first one the joint rests.
            angle: Joint angle (F, ...).
            offset: Time [s] of some tick.
        """
        instants = np.asarray(time, dtype=np.float64)
        ticks, _ = sample(instants, instants, rate=self.rate, offset=offset)
        late = np.concatenate([instants[:1], instants + self.latency])
        values = np.concatenate([np.asarray(angle)[:1], np.asarray(angle)])
        return ticks, sample(late, values, rate=self.rate, offset=offset)[1][: len(ticks)]

    def filtered(self, values: ArrayLike, rate: float | None = None) -> NDArray[np.float64]:
        """Evenly spaced samples (F, ...) after the filter, at ``rate`` [Hz], by default the chain's own."""
        series = np.asarray(values, dtype=np.float64)
        rate = self.rate if rate is None else rate
        if self.filter == "none":
            return series
        if self.filter == "moving_average":
            half = round(0.5 * (self.window * rate - 1.0))
            before, after = (half, half) if self.zero_phase else (2 * half, 0)
            padded = np.concatenate([series[:1]] * before + [series] + [series[-1:]] * after)
            return np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1, axis=0).mean(axis=-1)
        if self.zero_phase:
            return low_pass(series, rate=rate, cutoff=self.cutoff, order=self.order)
        from scipy.signal import sosfilt, sosfilt_zi  # half a second to import

        sections = _butterworth(self.order, self.cutoff, rate)
        rest = sosfilt_zi(sections).reshape(-1, 2, *(1,) * (series.ndim - 1)) * series[0]
        return np.asarray(sosfilt(sections, series, axis=0, zi=rest)[0])


FILTERS = ("butterworth", "moving_average", "none")
"""Kinds of filters of a measuring chain."""

PUBLISHED = MeasuringChain()
"""The chain of the published curves: 100 Hz, fourth order, 7 Hz; without phase, as the published turns seem to begin before
0 s."""

CHAINS: Mapping[str, MeasuringChain] = {
    "published": PUBLISHED,
    # E: "fourth order" may count both passes
    "second_order": MeasuringChain(order=2),
    # E: as steep as filters of logs come
    "sixth_order": MeasuringChain(order=6),
    # a filter on the machine, whose curves come 58 ms late
    "causal": MeasuringChain(zero_phase=False),
    # E: what loggers do without a filter; half the gain at 6.7 Hz, near the published 7 Hz
    "moving_average": MeasuringChain(filter="moving_average"),
    "trailing_average": MeasuringChain(filter="moving_average", zero_phase=False),
    # E: an angle that comes over a bus, one of its cycles old
    "late": MeasuringChain(latency=0.02),
    # E: half the published rate, as a bus may log it
    "half_rate": MeasuringChain(rate=50.0),
    "unfiltered": MeasuringChain(filter="none"),
}
"""Measuring chains by name, the published one first."""


def port_volume(cylinder: SteeringCylinder, angle: ArrayLike, direction: ArrayLike) -> Any:
    """Oil [m³] on the side of the joint that a turn pressurises, less what it holds at the start of a full turn.

    A turn fills the bore of one cylinder and the annulus of the other, and a right turn is a mirrored left one:
    V = A_bore s(σθ) + A_annulus (S − s(−σθ)) with the stroke s(θ), 0 to S, of the cylinder that a left turn extends.

    Args:
        cylinder: One of the two steering cylinders with its linkage; floats, or arrays of shape (N,).
        angle: Joint angle [rad], any shape that broadcasts with (N,).
        direction: σ: +1 left, -1 right, scalar or (N,).
    """
    turned = np.asarray(direction) * np.asarray(angle, dtype=np.float64)
    extends, retracts = cylinder.linkage.extension(turned), cylinder.linkage.extension(-turned)
    return cylinder.bore_area * extends + cylinder.annulus_area * (cylinder.stroke - retracts)


def turn_flow(cylinder: SteeringCylinder, angle: ArrayLike, rate: ArrayLike, direction: ArrayLike) -> Any:
    """Joint flow [m³/s] of a turn from the joint's motion: the rate of :func:`port_volume`.

    Q = (A_bore l(σθ) + A_annulus l(-σθ)) σ dθ/dt, with the lever l(θ) = ds/dθ.

    Args:
        cylinder: One of the two steering cylinders with its linkage; floats, or arrays of shape (N,).
        angle: Joint angle [rad], any shape that broadcasts with (N,).
        rate: Joint rate [rad/s], likewise.
        direction: σ: +1 left, -1 right, scalar or (N,).
    """
    turned = np.asarray(direction) * np.asarray(angle, dtype=np.float64)
    extends, retracts = cylinder.linkage.lever(turned), cylinder.linkage.lever(-turned)
    return (cylinder.bore_area * extends + cylinder.annulus_area * retracts) * np.asarray(direction) * np.asarray(rate)


def measured_flow(
    cylinder: SteeringCylinder,
    angle: ArrayLike,
    direction: ArrayLike,
    *,
    rate: float | None = None,
    chain: MeasuringChain = PUBLISHED,
) -> NDArray[np.float64]:
    """Joint flow [m³/s] (F, ...) as the measuring chain gives it, from a joint angle [rad] (F, ...).

    The angle is filtered, turned into oil by the cylinders' geometry, and differentiated by central differences, which
    add no delay (their gain is 0.984 at 5 Hz and 100 samples a second).

    Args:
        cylinder: One of the two steering cylinders; floats, or arrays of shape (N,) for angles (F, N).
        angle: Unfiltered samples, at least :data:`STANDSTILL` of rest before and after the motion.
        direction: +1 left, -1 right, scalar or (N,).
        rate: Samples a second [Hz]; by default those of the chain.
        chain: Whose filter it is.
    """
    rate = chain.rate if rate is None else rate
    return np.gradient(port_volume(cylinder, chain.filtered(angle, rate), direction), 1.0 / rate, axis=0)
