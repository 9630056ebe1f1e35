"""Arrival at the joint's stop: an instant that every twin reaches at its own time, and that pressures jump at.

A front that comes late by a tenth of a second differs by its full height, however alike the two are, and between two such
fronts there is no interpolating. So pressures of a prediction are read on the clock of the measurement: until the measured
arrival as they are, or held where the prediction arrives early; then by the time since arrival; later by the log's clock
again, which commands act on. When the joint arrives is what its angle tells: that of a prediction which arrives early goes
on as fast as it came, so that its distance from the measurement is what it would be without a stop.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aoro_gym.diagnosis.noise import Floats
from aoro_gym.diagnosis.recording import TICK

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


def arrivals(angle: Floats, steering: Floats) -> NDArray[np.intp]:
    """Sample (N,) at which joints with ``angle`` (F, N) [rad] arrive at a stop under the last piece of the signal
    ``steering`` (F − 1,); :data:`NEVER` where they do not."""
    commanded = np.flatnonzero(steering)
    if not commanded.size:
        return np.full(angle.shape[1], NEVER, dtype=np.intp)
    last = int(commanded[-1])
    changes = np.flatnonzero(np.diff(steering[: last + 1]))
    first = int(changes[-1]) + 1 if changes.size else 0
    if last - first <= BEFORE_END:
        return np.full(angle.shape[1], NEVER, dtype=np.intp)
    final = np.median(angle[last:], axis=0)
    near = np.abs(angle[first : last - BEFORE_END] - final) < NEAR
    arrives = np.any(near, axis=0) & (np.abs(final - angle[first]) > TRAVEL)
    return np.where(arrives, first + np.argmax(near, axis=0), NEVER)


def on_clock(
    values: Floats, own: NDArray[np.intp], measured: int, steering: Floats, *, goes_on: bool = False
) -> Floats:
    """``values`` (F, N) of predictions that arrive at ``own`` (N,), read on the clock of a measurement that arrives at the
    sample ``measured``, or :data:`NEVER`. Where a prediction arrives early, its values are held, or go on as they came."""
    count = len(values)
    time = np.arange(count)[:, None]
    arrives = own != NEVER
    early = np.where(arrives, own - AHEAD, count)
    if measured == NEVER:
        source = np.minimum(time, early)
    else:
        last = int(np.flatnonzero(steering)[-1])
        after = max(min(AFTER, last - measured - AHEAD), 0)
        before = np.minimum(time, early)
        since = time - measured + own
        later = np.maximum(time, own + after)
        source = np.where(time < measured - AHEAD, before, np.where(time < measured + after, since, later))
        # a prediction that does not arrive has nothing to show after that
        source = np.where(arrives, source, np.minimum(time, measured - AHEAD))
    read = np.take_along_axis(values, np.clip(source, 0, count - 1), axis=0)
    if goes_on and np.any(arrives):
        last = int(np.flatnonzero(steering)[-1])
        until = last if measured == NEVER else measured - AHEAD
        late = np.clip(np.minimum(time, until) - early, 0, None)
        if measured != NEVER:
            late = np.where(time < measured - AHEAD, late, 0)
        columns = np.arange(values.shape[1])
        begin = np.clip(early - 1, APPROACH, count - 1)
        rate = (values[begin, columns] - values[begin - APPROACH, columns]) / APPROACH
        read = read + np.where(arrives, late * rate, 0.0)
    return read
