"""Arrival at the joint's stop: an instant that every twin reaches at its own time, and that pressures jump at.

A front that comes late by a tenth of a second differs by its full height, however alike the two are, and between two such
fronts there is no interpolating. So pressures of a prediction are read on the clock of the measurement: until the measured
arrival as they are, or held where the prediction arrives early; then by the time since arrival; later by the log's clock
again, which commands act on. When the joint arrives is what its angle tells: that of a prediction which arrives early goes
on as fast as it came, so that its distance from the measurement is what it would be without a stop.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from aoro_gym.diagnosis.noise import Floats
from aoro_gym.diagnosis.recording import TICK, Recording

CLOCKED = ("joint_angle", "pressure_a", "pressure_b", "pump_pressure")
"""Signals that the joint's arrival at a stop shows in."""

SMOOTH = 5
"""Samples that the angle is averaged over to find the instant, of measurements and predictions alike."""
BEFORE_END = round(0.08 / TICK)
"""Samples before the command's end by which the joint must have arrived; one that its command alone stops arrives later."""
NEAR = np.radians(0.5)
"""Angle [rad] before its last one at which the joint counts as arrived."""
TRAVEL = np.radians(3.0)
"""Least travel [rad] of a joint that arrives anywhere."""
AHEAD = 3
"""Samples before the arrival that belong to it."""
APPROACH = 12
"""Samples over which the rate before the arrival is taken."""
AFTER = round(0.5 / TICK)
"""Samples after it that are read by the time since arrival: the bounce."""
NEVER = -1


def arrivals(angle: Floats, steering: Floats) -> Floats:
    """Instants (N,), in samples, at which joints with ``angle`` (F, N) [rad] arrive at a stop under the last piece of the
    signal ``steering`` (F − 1,); :data:`NEVER` where they do not."""
    none = np.full(angle.shape[1], float(NEVER))
    commanded = np.flatnonzero(steering)
    if not commanded.size:
        return none
    last = int(commanded[-1])
    changes = np.flatnonzero(np.diff(steering[: last + 1]))
    first = int(changes[-1]) + 1 if changes.size else 0
    if last - first <= BEFORE_END:
        return none
    final = np.median(angle[last:], axis=0)
    distance = np.abs(uniform_filter1d(angle[first : last - BEFORE_END], SMOOTH, axis=0) - final)
    near = distance < NEAR
    arrives = np.any(near, axis=0) & (np.abs(final - angle[first]) > TRAVEL)
    # between two samples the joint is where a straight line has it, so that the instant moves as smoothly as the prediction
    after = np.maximum(np.argmax(near, axis=0), 1)
    columns = np.arange(angle.shape[1])
    before, behind = distance[after - 1, columns], distance[after, columns]
    share = np.clip((before - NEAR) / np.maximum(before - behind, 1e-12), 0.0, 1.0)
    return np.where(arrives, first + after - 1 + share, NEVER)


def arrival_of(angle: Floats, steering: Floats) -> int:
    """The sample next to the instant at which one joint with ``angle`` (F,) [rad] arrives, or :data:`NEVER`."""
    return round(float(arrivals(angle[:, None], steering)[0]))


def bounce(arrival: int) -> slice:
    """Samples of the bounce off the stop; none if the joint never arrives. Its blows are over in less than a sample, so that
    what is read of them jumps with the parameters."""
    return slice(0) if arrival == NEVER else slice(max(arrival - AHEAD, 0), arrival + AFTER)


def on_clock(values: Floats, own: Floats, measured: float, steering: Floats, *, goes_on: bool = False) -> Floats:
    """``values`` (F, N) of predictions that arrive at ``own`` (N,), read on the clock of a measurement that arrives at the
    instant ``measured``, in samples, or :data:`NEVER`. Where a prediction arrives early, its values are held, or go on as
    they came.

    Args:
        values: Predictions (F, N).
        own: Their instants of arrival (N,), in samples.
        measured: The measured instant, in samples, or :data:`NEVER`.
        steering: Steering signal (F − 1,).
        goes_on: Whether values go on after an early arrival, rather than are held.
    """
    count = len(values)
    time = np.arange(count, dtype=np.float64)[:, None]
    arrives = own != NEVER
    early = np.where(arrives, own - AHEAD, count)
    last = int(np.flatnonzero(steering)[-1]) if np.any(steering) else 0
    after = 0.0 if measured == NEVER else max(min(AFTER, last - measured - AHEAD), 0.0)
    ends = (count, count) if measured == NEVER else (measured - AHEAD, measured + after)
    first, second = (min(max(int(np.ceil(end)), 0), count) for end in ends)
    read = np.empty(values.shape)
    read[:first] = np.where(time[:first] < early, values[:first], _between(values, early[None]))
    if first < count:
        read[first:second] = _between(values, time[first:second] - measured + own)
        late = own + after
        read[second:] = np.where(time[second:] < late, _between(values, late[None]), values[second:])
        # a prediction that does not arrive has nothing to show after that
        read[first:, ~arrives] = _between(values, np.full((1, len(own)), ends[0]))[:, ~arrives]
    if goes_on and np.any(arrives):
        further = np.where(time[:first] < early, 0.0, np.minimum(time[:first], last) - early).clip(0.0)
        begin, end = _between(values, np.stack([early - APPROACH, early]))
        read[:first] += np.where(arrives, further * (end - begin) / APPROACH, 0.0)
    return read


def on_clock_of(recording: Recording, arrival: int, signals: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Signals (F, N) of machines under the commands of a ``recording`` whose joint comes to its stop at the sample
    ``arrival``, read on its clock."""
    steering = recording.commands[:, 0]
    own = arrivals(signals["joint_angle"], steering)
    clocked = {
        name: on_clock(values, own, arrival, steering, goes_on=name == "joint_angle")
        for name, values in signals.items()
        if name in CLOCKED
    }
    return {**signals, **clocked}


def _between(values: Floats, instants: Floats) -> Floats:
    """``values`` (F, N) at ``instants`` (K, N), in samples, on straight lines between them."""
    within = np.clip(instants, 0.0, len(values) - 1.0)
    lower = np.minimum(within.astype(np.intp), len(values) - 2)
    begin, end = (np.take_along_axis(values, index, axis=0) for index in (lower, lower + 1))
    return begin + (within - lower) * (end - begin)
