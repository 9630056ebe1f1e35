"""Shape of the flow curve of a full left turn at 100 % signal: what the text of the publication says of its published twin.

The flow has three maxima before it is steady, at 0.10 s, about 0.4 s and about 0.7 s; the lowest undershoot comes after
the second of them; meanwhile the joint cylinders' pressures range mainly from 5 to 15 bar. Read as figures, on the clock
and from the flow of :mod:`aoro_gym.simulation.key_figures`:

* a maximum is a flow that rises above the lowest flow before it, and above the lowest flow after it until it is exceeded,
  by more than :data:`PROMINENCE` of the steady flow, within [0, :data:`SETTLED`]. Waves below that lie within the bound
  by which the steady flow itself is held to the published one: to a reader they are steady flow.
* of three maxima each is the published one of its place. Of fewer or more, each published maximum is the nearest one that
  is no farther than half way to the next published one, if there is any.
* the lowest undershoot is the lowest flow from the first maximum to 0.7 s; its place is the number of maxima before it.
* the range of the pressures: of each port the 10th and the 90th percentile from the first maximum to :data:`SETTLED`; the
  lower of the two ports', and the higher one.

*Mainly* is no number, so the last definition is a choice. Four fifths of the time, without the tenths at either end, is one
reading of it. Taken of each port on its own: in a pool of both a quiet return port would hide a fifth of the port that
drives. The rise to the first maximum is left out: the machine is set in motion then, which takes more than 15 bar in any
reading. The range is given in steps of 5 bar, so half a step is its tolerance. Beyond the choice stands only that a range
from 5 to 15 bar is no range to 50 bar.

The text's other statements are among the 21 key figures: less overshoot at 0.7 s at 75 and 50 % (8.0, 5.6 and 2.9 L/min
above the steady flow) and hardly an undershoot at 50 % (2.5 L/min below it, 6.0 at 100 %).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aoro_gym.machine import Machine
from aoro_gym.sensors.chain import measured_flow, sampling_rate
from aoro_gym.simulation.key_figures import STEADY, UNDERSHOOT_END, key_figures_batch, turn_span, vertex
from aoro_gym.units import BAR, LITRE_PER_MINUTE
from aoro_gym.validation.published import published
from aoro_gym.validation.turns import Turn

SHAPE_TURN = Turn("left", 100.0)
"""The turn that the figures belong to."""
PROMINENCE = 0.02
"""Share of the steady flow that a maximum stands out by: the bound on the steady flow."""
SETTLED = 0.8
"""Time [s] from which the published flow is steady."""
MAINLY = (0.1, 0.9)
"""Quantiles of a port's pressure that its range runs between."""

TIME_TOLERANCE = 0.04
"""How near [s] the maxima are to be to the published twin's."""
PRESSURE_TOLERANCE = 2.5
"""How near [bar] the ends of the pressures' range are to be: half of the steps that it is given in."""

MAXIMA = tuple(f"{which}_maximum_time_s" for which in ("first", "second", "third"))
SHAPE = {
    "maxima": ("maxima of the flow before it is steady", "1", 0.0),
    MAXIMA[0]: ("time of the first maximum", "s", TIME_TOLERANCE),
    MAXIMA[1]: ("time of the second maximum", "s", TIME_TOLERANCE),
    MAXIMA[2]: ("time of the third maximum", "s", TIME_TOLERANCE),
    "maxima_before_lowest_undershoot": ("maxima before the lowest undershoot", "1", 0.0),
    "low_pressure_bar": ("port pressures, low end of their range", "bar", PRESSURE_TOLERANCE),
    "high_pressure_bar": ("port pressures, high end of their range", "bar", PRESSURE_TOLERANCE),
}
"""Description, unit and bound of every figure; the published values stand with all others in ``data/``."""

_SLACK = 1e-6
"""Share of a sample by which an instant may miss the end of a period and still count."""

Figures = dict[str, NDArray[np.float64]]


def shape_batch(
    time: ArrayLike,
    angle: NDArray[np.float64],
    machine: Machine,
    pressures: Sequence[ArrayLike],
    *,
    flow: NDArray[np.float64] | None = None,
    interpolate: bool = False,
) -> tuple[Figures, Figures]:
    """Figures (N,) by the names of :data:`SHAPE` of N full turns at 100 % signal, and their misses, without a loop over N.

    A miss is signed and in tolerances, for the cost of a fit:

    * of a time or a pressure: what is too much of it, over its tolerance;
    * of a maximum that there is not: half the distance of the published maxima over the tolerance of a time, and how far
      the flow at its time is from standing out by :data:`PROMINENCE` above the mean of those half a distance earlier and
      later, in units of that;
    * of the number of maxima: how many are too many;
    * of the lowest undershoot's place: by how much the lowest flow between second and third maximum lies above the lowest
      one elsewhere, over :data:`PROMINENCE` of the steady flow; zero where it lies below.

    NaN stands in the figures of a maximum that there is not, and everywhere where a turn is not complete.

    Args:
        time: Evenly spaced instants [s] (F,); 100 samples a second for the published chain.
        angle: Unfiltered joint angle [rad] (F, N), at rest in the first and in the last 0.5 s.
        machine: The machine, with one variant or N.
        pressures: Those of ports A and B [Pa] (F, N).
        flow: Joint flow [m³/s] (F, N), positive in the direction of the turn; by default the measuring chain's.
        interpolate: Times between samples, for optimisers. The published definition reads samples.
    """
    clock, cylinder = np.asarray(time, dtype=np.float64), machine.steering.cylinder
    span = turn_span(clock, angle, cylinder.half_range, interpolate=interpolate)
    if flow is None:
        flow = measured_flow(cylinder, angle, span.direction, rate=sampling_rate(clock))
    key = key_figures_batch(clock, angle, machine, flow=flow, interpolate=interpolate)
    steady = key["steady_flow_L_per_min"] * LITRE_PER_MINUTE
    since = clock[:, None] - span.began
    curve = _Curve(since, flow / steady, _SLACK * (clock[1] - clock[0]))
    end = STEADY[1] * key["turn_time_s"]
    maxima = prominent_maxima(curve.flow, curve.within(0.0, end), PROMINENCE) & curve.within(0.0, SETTLED)

    count = np.where(span.complete, maxima.sum(axis=0), np.nan)
    times = _times(curve, maxima, interpolate)
    low, high = _pressure_range(pressures, curve.within(key["first_peak_time_s"], SETTLED))
    place, rise = _undershoot(curve, maxima, key["first_peak_time_s"], times)
    figures = dict(zip(SHAPE, (count, *times, np.where(span.complete, place, np.nan), low, high), strict=True))

    known = {name: published(name) for name in SHAPE}
    misses = {name: (figures[name] - known[name]) / (bound or 1.0) for name, (_, _, bound) in SHAPE.items()}
    misses["maxima_before_lowest_undershoot"] = np.maximum(rise, 0.0) / PROMINENCE
    for name in MAXIMA:
        misses[name] = np.where(np.isfinite(figures[name]), misses[name], _absence(curve, known[name]))
    return figures, misses


class _Curve:
    """Flow curves (F, N) as shares of their steady flow, over the time (F, N) since each turn began."""

    def __init__(self, since: NDArray[np.float64], flow: NDArray[np.float64], slack: float):
        self.since, self.flow, self.slack = since, flow, slack

    def within(self, low: ArrayLike, high: ArrayLike) -> NDArray[np.bool_]:
        """Whether samples lie in the period."""
        return (self.since >= np.asarray(low) - self.slack) & (self.since <= np.asarray(high) + self.slack)

    def lowest(self, low: ArrayLike, high: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Lowest flow (N,) of a period and its row; infinite where the period holds no sample."""
        flow = np.where(self.within(low, high), self.flow, np.inf)
        return flow.min(axis=0), flow.argmin(axis=0)

    def at(self, time: float) -> NDArray[np.float64]:
        """Flow (N,) at a time [s], the nearest sample's."""
        return np.take_along_axis(self.flow, np.abs(self.since - time).argmin(axis=0)[None], axis=0)[0]


def prominent_maxima(flow: NDArray[np.float64], within: NDArray[np.bool_], prominence: ArrayLike) -> NDArray[np.bool_]:
    """Which samples (F, N) are maxima that stand out by at least ``prominence`` on both sides.

    One pass over time: the largest flow so far is a maximum once the flow has fallen by the prominence, the lowest since
    then a minimum once it has risen by it.

    Args:
        flow: Curves (F, N).
        within: Samples (F, N) that are looked at, a period each.
        prominence: Scalar or (N,), positive.
    """
    each = np.arange(flow.shape[1])
    marks = np.zeros(flow.shape, dtype=bool)
    sign = np.ones(len(each))  # +1 on the way to a maximum, -1 to a minimum
    extreme, row_of = np.full(len(each), -np.inf), np.zeros(len(each), dtype=np.int64)
    for row in np.flatnonzero(within.any(axis=1)):
        value = np.where(within[row], sign * flow[row], extreme)
        farther = value > extreme
        extreme, row_of = np.where(farther, value, extreme), np.where(farther, row, row_of)
        turned = within[row] & (value <= extreme - prominence)
        ended = turned & (sign > 0.0)
        marks[row_of[ended], each[ended]] = True
        sign = np.where(turned, -sign, sign)
        extreme, row_of = np.where(turned, -value, extreme), np.where(turned, row, row_of)
    return marks


def _times(curve: _Curve, maxima: NDArray[np.bool_], interpolate: bool) -> list[NDArray[np.float64]]:
    """Times (N,) of the three published maxima in the curves."""
    known = [published(name) for name in MAXIMA]
    halfway = [0.0, *np.mean([known[1:], known[:-1]], axis=0), SETTLED]
    number = np.cumsum(maxima, axis=0)
    three = number[-1] == len(MAXIMA)
    step = curve.since[1] - curve.since[0]
    times = []
    for place, name in enumerate(known):
        own = maxima & np.where(three, number == place + 1, curve.within(halfway[place], halfway[place + 1]))
        row = np.where(own, np.abs(curve.since - name), np.inf).argmin(axis=0)
        shift = vertex(curve.flow, row)[1] if interpolate else 0.0
        time = np.take_along_axis(curve.since, row[None], axis=0)[0] + shift * step
        times.append(np.where(own.any(axis=0), time, np.nan))
    return times


def _undershoot(
    curve: _Curve, maxima: NDArray[np.bool_], first: NDArray[np.float64], times: list[NDArray[np.float64]]
) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """Maxima (N,) before the lowest undershoot, and how far the lowest flow (N,) between second and third maximum lies above
    the lowest one elsewhere. A maximum that there is not is taken at its published time."""
    second, third = (
        np.where(np.isfinite(time), time, published(name)) for time, name in zip(times[1:], MAXIMA[1:], strict=True)
    )
    _, row = curve.lowest(first, UNDERSHOOT_END)
    place = (maxima & (np.arange(len(maxima))[:, None] < row)).sum(axis=0)
    between, _ = curve.lowest(second, np.minimum(third, UNDERSHOOT_END))
    before, after = curve.lowest(first, second)[0], curve.lowest(third, UNDERSHOOT_END)[0]
    return place, between - np.minimum(before, after)


def _absence(curve: _Curve, time: float) -> NDArray[np.float64]:
    """Miss (N,) of a maximum that there is not at a published ``time`` [s]."""
    half = 0.5 * (published(MAXIMA[2]) - published(MAXIMA[1]))
    stands_out = curve.at(time) - 0.5 * (curve.at(time - half) + curve.at(time + half))
    return half / TIME_TOLERANCE + np.maximum(PROMINENCE - stands_out, 0.0) / PROMINENCE


def _pressure_range(
    pressures: Sequence[ArrayLike], within: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lower of the ports' low quantiles and higher of their high ones [bar] (N,)."""
    count = within.sum(axis=0)
    ends = []
    for port in pressures:
        values = np.asarray(port, dtype=np.float64)
        rising = np.sort(np.where(within, values, values.max(axis=0)), axis=0)
        for share in MAINLY:
            place = share * np.maximum(count - 1, 0)
            low = np.floor(place).astype(np.int64)
            below, above = (
                np.take_along_axis(rising, row[None], axis=0)[0] for row in (low, np.minimum(low + 1, count - 1))
            )
            ends.append(np.where(count > 0, below + (place - low) * (above - below), np.nan) / BAR)
    return np.fmin(ends[0], ends[2]), np.fmax(ends[1], ends[3])
