"""Where a gap lies: by manoeuvre, signal and phase, the share of its energy beyond what noise and a machine's days give.

A phase is what goes on since a command last changed. The energy of a part is Σ r²/σ² less the number of its samples, with
the residual r and its standard deviation σ of what differs without a cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aoro_gym.diagnosis.noise import Floats
from aoro_gym.diagnosis.recording import TICK, Recording
from aoro_gym.diagnosis.result import PHASES, Place

ENDS = {"onset": 0.15, "first_peak": 0.3, "undershoot": 0.55, "second_peak": 0.85}
"""Time [s] since the command last changed at which a phase ends; ``steady`` follows."""
JUMP = 0.05
"""Change of a command from one tick to the next that begins a new phase, as those from zero and to it do; within a ramp the
command goes on as it did."""
LEAST_SHARE = 0.005
"""Of parts that are named."""


@dataclass(frozen=True)
class Gap:
    """A signal of a recording beside its prediction.

    Attributes:
        recording: The later one.
        signal: Channel.
        residual: Measured less predicted (F,) SI.
        std: Of what differs without a cause, SI.
        arrival: Sample at which the joint arrives at its stop, −1 if it does not.
    """

    recording: Recording
    signal: str
    residual: Floats
    std: float
    arrival: int = -1


def places(gaps: Sequence[Gap]) -> tuple[Place, ...]:
    """Parts of the gap, largest share first; none where nothing is beyond what differs without a cause."""
    excess: dict[tuple[str, str, str], float] = {}
    for gap in gaps:
        squares = np.square(gap.residual / gap.std)
        phased = phases(gap.recording, gap.arrival)
        for number in np.unique(phased):
            mine = squares[phased == number]
            excess[gap.recording.name, gap.signal, PHASES[number]] = float(np.sum(mine)) - len(mine)
    above = {part: energy for part, energy in excess.items() if energy > 0.0}
    whole = sum(above.values())
    found = [
        Place("", phase, signal, name, energy / whole)
        for (name, signal, phase), energy in above.items()
        if energy > LEAST_SHARE * whole
    ]
    return tuple(sorted(found, key=lambda place: -place.share))


def phases(recording: Recording, arrival: float) -> NDArray[np.intp]:
    """Phase (F,) of every sample, by its number in :data:`~aoro_gym.diagnosis.result.PHASES`.

    By the time since a command last changed (:data:`ENDS`); ``stop`` after one went to zero until one changes again, and
    after the ``arrival`` at the joint's stop, to which the last one led. Standstill before the first is steady, too.
    """
    before = np.vstack([np.zeros_like(recording.commands[:1]), recording.commands[:-1]])
    now = recording.commands
    changed = np.any((np.abs(now - before) > JUMP) | ((now == 0.0) != (before == 0.0)), axis=1)
    ended = np.any((now == 0.0) & (before != 0.0), axis=1)
    starts = np.flatnonzero(changed)
    count = len(now) + 1
    last = np.searchsorted(starts, np.arange(count), side="right") - 1
    since = np.where(last >= 0, np.arange(count) - np.append(starts, 0)[last], count)
    found = np.searchsorted(np.round(np.array(list(ENDS.values())) / TICK), since, side="right")
    stopped = np.append(ended[starts], False)[last]
    if arrival >= 0:
        stopped |= np.arange(count) >= arrival
    return np.where(stopped, PHASES.index("stop"), found)
